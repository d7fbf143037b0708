"""One gauge or its stand was knocked between two readings."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import PatternCause, Step, Where, reading_label
from orthoglide_cal.effects import Commanded
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


def onwards(plan: Plan) -> Floats:
    """Column i is 1 at reading i and all later ones of its set-up, shape (n, n)."""
    same = plan.setup[:, None] == plan.setup
    return np.asarray(same & (plan.order[:, None] >= plan.order), dtype=np.float64)


def later_readings(plan: Plan) -> list[int]:
    """Readings that have an earlier one in their set-up."""
    same = plan.setup[:, None] == plan.setup
    earlier = same & (plan.order[:, None] > plan.order)
    return np.flatnonzero(earlier.any(axis=1)).tolist()


class StandShift(PatternCause):
    """Step in the readings of one gauge set-up, from some reading on."""

    id = "stand_shift"
    title = "a gauge or its stand was knocked"
    step = Step.CONTACT
    unit = "mm"
    names = ("step",)
    timed = True
    advice = "Clamp the stand afresh and repeat this leg from its first isotropic reading."

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """From every reading on but the first of each set-up."""
        return tuple(Where((i,)) for i in later_readings(plan))

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """The first reading after the knock."""
        return f"from {reading_label(plan, machine, where.index[0])} on"

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """1 from the place on, within its set-up."""
        return onwards(plan)[:, [where.index[0] for where in places]]

    def contact(
        self,
        heights: Numbers,
        theta: Numbers,
        where: Where,
        fraction: Numbers,
        commanded: Commanded,
    ) -> Numbers:
        """Reading += step; theta (..., 1) [mm]."""
        return heights + self.added(theta, where, commanded.plan)


CAUSE = StandShift()
