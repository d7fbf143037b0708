"""Where the plungers touch the bars, and whether they stay on them.

A carriage displaced by d takes its leg along under the gauge, which stands fixed in space: the
plunger then touches the bar at gauge_at + d/L (sec. 2.5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import PostureError
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Plan
from orthoglide_cal.model.readings import AXES, Contact, GaugePlan

# The plunger keeps this share of the leg from both joints: forks, bolts and the stand's arm.
MARGIN = 0.1
ROUNDING = 1e-9
# Gauge places and limits are given in steps of this share of the leg.
PLACE_STEP = 0.05


def reach_mm(machine: Orthoglide, gauge_at: float) -> tuple[float, float]:
    """Lowest and highest displacement within the limits at which the plunger keeps `MARGIN`.

    The isotropic posture is always among them: there the gauge was set up.
    """
    low, high = machine.joint_limits_mm
    near, far = ((at - gauge_at) * machine.leg_length_mm for at in (MARGIN, 1.0 - MARGIN))
    return min(max(low, near), 0.0), max(min(high, far), 0.0)


def places(machine: Orthoglide) -> tuple[float, ...]:
    """The places farthest along the leg where the plunger stays on the bar over the whole travel.

    Nearest to the carriage first; none if the travel is too long.
    """
    low, high = (limit / machine.leg_length_mm for limit in machine.joint_limits_mm)
    near = math.ceil((MARGIN - low) / PLACE_STEP - ROUNDING)
    far = math.floor((1.0 - MARGIN - high) / PLACE_STEP + ROUNDING)
    if near > far:
        return ()
    return tuple(round(at * PLACE_STEP, 9) for at in sorted({near, far}))


class BarWarning(NamedTuple):
    """Plungers that leave their bar, or come near its end."""

    lines: tuple[str, str]  # what is wrong, and the remedy
    leaves: bool


def bar_warning(plan: Plan, machine: Orthoglide) -> BarWarning | None:
    """What is wrong where plungers touch their bars; None if nothing is, or no gauge is fixed."""
    plan = GaugePlan.require(plan)
    rows = np.flatnonzero(plan.contact == Contact.FIXED)
    if not rows.size:
        return None
    at = plan.gauge_at[rows] + plan.displacement[rows] / machine.leg_length_mm
    # From the nearer joint, as a share of the leg; negative off the bar.
    keeps = np.minimum(at, 1.0 - at)
    worst = int(np.argmin(keeps))
    if keeps[worst] >= MARGIN - ROUNDING:
        return None
    row, left = rows[worst], float(keeps[worst]) * machine.leg_length_mm
    where = f"with carriage {AXES[plan.leg[row]]} at {plan.displacement[row]:+g} mm"
    if left < 0.0:
        end = "carriage joint" if at[worst] < 0.5 else "tool"
        what = f"The plunger leaves the bar: {where} the gauge is {-left:.3g} mm beyond the {end}."
    else:
        what = f"The plunger comes near the end of the bar: {left:.3g} mm from it {where}."
    # In whole millimetres that are no farther out, if there are any.
    reach = reach_mm(machine, 0.5)
    low, high = (math.trunc(end + math.copysign(ROUNDING, end)) or end for end in reach)
    remedy = (
        "Measure with --design best, whose postures and gauge place fit; or make joint_limits_mm in"
        f" the machine file smaller: [{low:g}, {high:g}] is safe with the gauges half-way."
    )
    return BarWarning((what, remedy), left < 0.0)


def require_on_bar(plan: Plan, machine: Orthoglide) -> BarWarning | None:
    """The warning of a plan whose plungers stay on the bars, but barely; None without one.

    Raises:
        PostureError: a plunger leaves its bar.
    """
    warning = bar_warning(plan, machine)
    if warning is not None and warning.leaves:
        raise PostureError(*warning.lines)
    return warning
