"""Where the plungers touch the bars, and whether they stay on them.

A carriage displaced by d takes its leg along under the gauge, which stands fixed in space: the
plunger then touches the bar at gauge_at + d/L (sec. 2.5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import PostureError
from orthoglide_cal.model import AXES, Contact, Floats, GaugePlan
from orthoglide_cal.model.orthoglide import Orthoglide

# The plunger keeps this share of the leg from both joints: forks, bolts and the stand's arm.
MARGIN = 0.1
ROUNDING = 1e-9
# Gauge places and limits are given in steps of this share of the leg.
PLACE_STEP = 0.05


class WorstTouch(NamedTuple):
    """The reading whose plunger comes nearest to an end of its bar, or beyond it.

    Attributes:
        leg: that is touched.
        displacement_mm: of its carriage.
        at: place along the leg, from carriage joint (0) to tool (1).
    """

    leg: int
    displacement_mm: float
    at: float

    @property
    def keeps(self) -> float:
        """Distance from the nearer joint as a share of the leg; negative off the bar."""
        return min(self.at, 1.0 - self.at)


def keeps_off(touched: Floats) -> np.ndarray:
    """Where plungers that touch legs there come too near to a joint; any shape."""
    return np.asarray((touched < MARGIN - ROUNDING) | (touched > 1.0 - MARGIN + ROUNDING))


def worst_touch(plan: GaugePlan, machine: Orthoglide) -> WorstTouch | None:
    """The touch nearest to a joint; None if no gauge stands fixed in space."""
    rows = np.flatnonzero(plan.contact == Contact.FIXED)
    if not rows.size:
        return None
    at = plan.gauge_at[rows] + plan.displacement[rows] / machine.leg_length_mm
    worst = int(np.argmin(np.minimum(at, 1.0 - at)))
    row = int(rows[worst])
    return WorstTouch(int(plan.leg[row]), float(plan.displacement[row]), float(at[worst]))


def reach_mm(machine: Orthoglide, gauge_at: float) -> tuple[float, float]:
    """Lowest and highest displacement within the limits at which the plunger keeps `MARGIN`.

    The isotropic posture is always among them: there the gauge was set up.
    """
    low, high = machine.joint_limits_mm
    length = machine.leg_length_mm
    return (
        min(max(low, (MARGIN - gauge_at) * length), 0.0),
        max(min(high, (1.0 - MARGIN - gauge_at) * length), 0.0),
    )


def places(machine: Orthoglide) -> tuple[float, float] | None:
    """The places farthest along the leg where the plunger stays on the bar over the whole travel.

    None if the travel is too long for any.
    """
    low, high = (limit / machine.leg_length_mm for limit in machine.joint_limits_mm)
    near = math.ceil((MARGIN - low) / PLACE_STEP - ROUNDING)
    far = math.floor((1.0 - MARGIN - high) / PLACE_STEP + ROUNDING)
    return (round(near * PLACE_STEP, 9), round(far * PLACE_STEP, 9)) if near <= far else None


class BarWarning(NamedTuple):
    """Plungers that leave their bar, or come near its end.

    Attributes:
        what: is wrong, in a sentence.
        remedy: how to mend it.
        leaves: whether one leaves the bar.
    """

    what: str
    remedy: str
    leaves: bool

    @property
    def lines(self) -> tuple[str, str]:
        """Both sentences."""
        return self.what, self.remedy


def bar_warning(plan: GaugePlan, machine: Orthoglide) -> BarWarning | None:
    """What is wrong with the touches of a plan; None if nothing is."""
    worst = worst_touch(plan, machine)
    if worst is None or worst.keeps >= MARGIN - ROUNDING:
        return None
    where = f"with carriage {AXES[worst.leg]} at {worst.displacement_mm:+g} mm"
    if worst.keeps < 0.0:
        end = "carriage joint" if worst.at < 0.5 else "tool"
        beyond = -worst.keeps * machine.leg_length_mm
        what = f"The plunger leaves the bar: {where} the gauge is {beyond:.3g} mm beyond the {end}."
    else:
        left = worst.keeps * machine.leg_length_mm
        what = f"The plunger comes near the end of the bar: {left:.3g} mm from it {where}."
    low, high = reach_mm(machine, 0.5)
    smaller = (
        f"make joint_limits_mm in the machine file smaller: [{_inwards(low)}, {_inwards(high)}]"
        " is safe with the gauges half-way."
    )
    remedy = f"Measure with --design best, whose postures and gauge place fit; or {smaller}"
    return BarWarning(what, remedy, worst.keeps < 0.0)


def require_on_bar(plan: GaugePlan, machine: Orthoglide) -> BarWarning | None:
    """The warning of a plan whose plungers stay on the bars, but barely; None without one.

    Raises:
        PostureError: a plunger leaves its bar.
    """
    warning = bar_warning(plan, machine)
    if warning is not None and warning.leaves:
        raise PostureError(*warning.lines)
    return warning


def _inwards(limit: float) -> str:
    """A limit in whole millimetres that are no farther out, if it has any."""
    return f"{math.trunc(limit + math.copysign(ROUNDING, limit)) or limit:g}"
