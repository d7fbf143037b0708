"""One gauge or its stand was knocked between two readings."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import PatternCause, Step, Where, reading_label
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan
from orthoglide_cal.simulation import Commanded


def later_readings(plan: Plan) -> list[int]:
    """Readings that have an earlier one in their set-up, in file order."""
    first = [int(np.min(plan.order[plan.setup == s])) for s in range(plan.setups)]
    return [i for i in range(len(plan)) if plan.order[i] > first[plan.setup[i]]]


def from_reading_on(plan: Plan, index: int) -> np.ndarray:
    """Mask (n,) of a reading and all later ones of its set-up."""
    same = plan.setup == plan.setup[index]
    return np.asarray(same & (plan.order >= plan.order[index]))


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
        return tuple(
            Where(f"from {reading_label(plan, machine, i)} on", (i,)) for i in later_readings(plan)
        )

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """1 from the place on, within its set-up."""
        masks = [from_reading_on(plan, where.index[0]) for where in places]
        return np.stack(masks, axis=1).astype(np.float64)

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
