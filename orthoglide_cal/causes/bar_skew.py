"""The touched surface is not parallel to the leg's kinematic line."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step, Where
from orthoglide_cal.effects import Commanded

# Parameters in the order (leg, direction): x_y is what a gauge along x meets on leg y.
_SERIES = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))


class BarSkew(Cause):
    """Slope of the bar per leg and direction: rise along + per length towards the tool."""

    id = "bar_skew"
    title = "a touched bar is not parallel to its leg"
    step = Step.CONTACT
    unit = "mrad"
    scale = 1e-3
    names = ("y_x", "z_x", "x_y", "z_y", "x_z", "y_z")
    lasting = True
    advice = (
        "Measure on a ground surface parallel to the joint centres, or repeat with the gauge on"
        " the opposite bar; this is not an error of the machine's motion."
    )

    def contact(
        self,
        heights: Numbers,
        theta: Numbers,
        where: Where,
        fraction: Numbers,
        commanded: Commanded,
    ) -> Numbers:
        """Reading += slope · distance from the carriage joint; theta (..., 6) [rad]."""
        plan = commanded.plan
        own = np.array([(plan.leg == leg) & (plan.direction == k) for leg, k in _SERIES])
        slope = theta @ own.astype(np.float64)
        return heights + slope * fraction * commanded.machine.leg_length_mm


CAUSE = BarSkew()
