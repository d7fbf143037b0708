"""One reading is wrong."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import PatternCause, Step, Where, reading_label
from orthoglide_cal.effects import Commanded
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


class Misread(PatternCause):
    """Error of a single reading, of any size: a wrong digit, a wrong mark, a wrong line."""

    id = "misread"
    title = "one reading is wrong"
    step = Step.RECORD
    unit = "mm"
    hides_reading = True
    advice = "Take this reading again."

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Every reading."""
        return tuple(Where((i,)) for i in range(len(plan)))

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """The reading."""
        return reading_label(plan, machine, where.index[0])

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """1 at the reading."""
        return np.eye(len(plan))[:, [where.index[0] for where in places]]

    def record(
        self, readings: Numbers, theta: Numbers, where: Where, commanded: Commanded
    ) -> Numbers:
        """Reading += size; theta (..., 1) [mm]."""
        return readings + self.added(theta, where, commanded.plan)


CAUSE = Misread()
