"""The actuator zeros grow with time, as a drive that warms up does."""

from __future__ import annotations

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step
from orthoglide_cal.effects import Commanded


class ThermalDrift(Cause):
    """Rate of each actuator zero; the offsets are those at the start of the session."""

    id = "thermal_drift"
    title = "the actuator zeros drift with time"
    step = Step.MOTION
    unit = "mm/h"
    names = ("x", "y", "z")
    lasting = True
    timed = True
    advice = "Let the machine warm up before measuring, and repeat the session."

    def motion(self, joints: Numbers, theta: Numbers, commanded: Commanded) -> Numbers:
        """q += r·t; theta (..., 3) [mm/h]."""
        return joints + theta[..., None, :] * commanded.plan.hours[:, None]


CAUSE = ThermalDrift()
