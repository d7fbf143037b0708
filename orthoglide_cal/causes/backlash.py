"""Lost motion: a carriage lags behind the side that it came from."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step
from orthoglide_cal.effects import Commanded


class Backlash(Cause):
    """Full width of the lost motion of each carriage; it stands half of it behind its motion.

    Before its first motion in the session a carriage stands anywhere within the lost motion:
    the three nuisance parameters.
    """

    id = "backlash"
    title = "a carriage has lost motion"
    step = Step.MOTION
    unit = "mm"
    names = ("x", "y", "z")
    nuisance = (("start_x", 0.3), ("start_y", 0.3), ("start_z", 0.3))
    positive = True
    lasting = True
    timed = True
    advice = "Adjust the nut or belt of the carriage, or approach every posture from the same side."

    def motion(self, joints: Numbers, theta: Numbers, commanded: Commanded) -> Numbers:
        """q −= w/2 · sign of the last motion; theta (..., 6) [mm]: widths, first positions."""
        approach = commanded.approach
        lag = -0.5 * theta[..., None, :3] * approach
        start = theta[..., None, 3:] * np.asarray(approach == 0.0, dtype=np.float64)
        return np.asarray(joints + lag + start)


CAUSE = Backlash()
