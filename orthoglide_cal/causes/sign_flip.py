"""One gauge was read with the opposite sign."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes.base import (
    RelabelCause,
    Step,
    Where,
    in_series,
    series_label,
    series_places,
)
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


class SignFlip(RelabelCause):
    """All readings of one leg and direction have the opposite sign."""

    id = "sign_flip"
    title = "a gauge was read with the opposite sign"
    step = Step.RECORD
    advice = "Check which way + is on this gauge and turn the sign of its readings."

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Every (leg, direction)."""
        return series_places(plan)

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """The leg and direction."""
        return series_label(*where.index)

    def relabel(self, plan: Plan, where: Where) -> tuple[np.ndarray, Floats]:
        """Same readings, sign −1 in the series."""
        return np.arange(len(plan)), np.where(in_series(plan, where), -1.0, 1.0)


CAUSE = SignFlip()
