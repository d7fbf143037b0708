"""One gauge or its stand creeps with time."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import (
    PatternCause,
    Step,
    Where,
    in_series,
    series_label,
    series_places,
)
from orthoglide_cal.effects import Commanded
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


class GaugeDrift(PatternCause):
    """Rate of the readings of one leg and direction."""

    id = "gauge_drift"
    title = "a gauge or its stand creeps"
    step = Step.CONTACT
    unit = "mm/h"
    names = ("rate",)
    timed = True
    advice = "Clamp the stand afresh on a clean surface and repeat this leg."

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Every (leg, direction)."""
        return series_places(plan)

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """The leg and direction."""
        return series_label(*where.index)

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """Hours since the session began, in the series."""
        return np.stack([in_series(plan, where) * plan.hours for where in places], axis=1)

    def contact(
        self,
        heights: Numbers,
        theta: Numbers,
        where: Where,
        fraction: Numbers,
        commanded: Commanded,
    ) -> Numbers:
        """Reading += rate · time; theta (..., 1) [mm/h]."""
        return heights + self.added(theta, where, commanded.plan)


CAUSE = GaugeDrift()
