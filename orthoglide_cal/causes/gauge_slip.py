"""Whole revolutions of the dial were miscounted."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import PatternCause, Step, Where, reading_label
from orthoglide_cal.causes.stand_shift import from_reading_on, later_readings
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan
from orthoglide_cal.simulation import Commanded

# How plausible each miscount is: nearly always one turn.
TURNS = {-1: 0.42, 1: 0.42, -2: 0.07, 2: 0.07, -3: 0.01, 3: 0.01}


class GaugeSlip(PatternCause):
    """Turns added to one reading, or to all readings of a set-up from one on.

    The parameter is a whole number, so it is not estimated but tried.
    """

    id = "gauge_slip"
    title = "whole turns of the dial were miscounted"
    step = Step.RECORD
    unit = "turns"
    names = ("turns",)
    advice = "Count the turns again: add or take off whole revolutions at this reading."

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Every reading alone, and every reading but the first of a set-up with all after it."""
        alone = [Where(reading_label(plan, machine, i), (i, 0)) for i in range(len(plan))]
        onwards = [
            Where(f"from {reading_label(plan, machine, i)} on", (i, 1))
            for i in later_readings(plan)
            if from_reading_on(plan, i).sum() > 1
        ]
        return (*alone, *onwards)

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """1 where turns were miscounted (to be multiplied by the length of a revolution)."""
        alone = np.eye(len(plan))
        columns = [
            from_reading_on(plan, where.index[0]) if where.index[1] else alone[where.index[0]]
            for where in places
        ]
        return np.stack(columns, axis=1).astype(np.float64)

    def record(
        self, readings: Numbers, theta: Numbers, where: Where, commanded: Commanded
    ) -> Numbers:
        """Reading += turns · revolution; theta (..., 1)."""
        revolution = commanded.machine.gauge.revolution_mm or 0.0
        return readings + revolution * self.added(theta, where, commanded.plan)


CAUSE = GaugeSlip()
