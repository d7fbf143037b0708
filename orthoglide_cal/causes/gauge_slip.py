"""Whole revolutions of the dial were miscounted."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import PatternCause, Step, Where, reading_label
from orthoglide_cal.causes.stand_shift import later_readings, onwards
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
        followed = np.flatnonzero(onwards(plan).sum(axis=0) > 1)
        kept = [i for i in later_readings(plan) if i in followed]
        return (*(Where((i, 0)) for i in range(len(plan))), *(Where((i, 1)) for i in kept))

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """The reading, or the first of several."""
        reading = reading_label(plan, machine, where.index[0])
        return f"from {reading} on" if where.index[1] else reading

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """1 where turns were miscounted (to be multiplied by the length of a revolution)."""
        both = np.stack((np.eye(len(plan)), onwards(plan)))
        reading, onward = np.array([where.index for where in places]).T
        return both[onward, :, reading].T

    def record(
        self, readings: Numbers, theta: Numbers, where: Where, commanded: Commanded
    ) -> Numbers:
        """Reading += turns · revolution; theta (..., 1)."""
        revolution = commanded.machine.gauge.revolution_mm or 0.0
        return readings + revolution * self.added(theta, where, commanded.plan)


CAUSE = GaugeSlip()
