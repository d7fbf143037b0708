"""Whole revolutions of the dial were miscounted."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from orthoglide_cal.axes import Floats, Numbers
from orthoglide_cal.causes.base import PatternCause, Step, Where, reading_label
from orthoglide_cal.causes.stand_shift import later_readings, onwards
from orthoglide_cal.effects import Commanded
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


class GaugeSlip(PatternCause):
    """Turns added to one reading, or to all readings of a set-up from one on.

    The parameter is a whole number, nearly always one, so it is not estimated but tried.
    """

    id = "gauge_slip"
    title = "whole turns of the dial were miscounted"
    step = Step.RECORD
    unit = "turns"
    names = ("turns",)
    counts = MappingProxyType({-1: 0.42, 1: 0.42, -2: 0.07, 2: 0.07, -3: 0.01, 3: 0.01})
    advice = "Count the turns again: add or take off whole revolutions at this reading."

    def possible(self, machine: Machine) -> bool:
        """Only a gauge with a dial has turns to miscount."""
        return super().possible(machine) and machine.gauge.revolution_mm is not None

    def millimetres(self, machine: Machine) -> float:
        """One revolution of the dial [mm]."""
        return machine.gauge.revolution_mm or 0.0

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Every reading alone, and every reading but the first of a set-up with all after it."""
        followed = onwards(plan).sum(axis=0) > 1
        kept = [i for i in later_readings(plan) if followed[i]]
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
        turn = self.millimetres(commanded.machine)
        return readings + turn * self.added(theta, where, commanded.plan)


CAUSE = GaugeSlip()
