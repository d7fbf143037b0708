"""What can be wrong with what was written down."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from orthoglide_cal.causes.base import (
    PatternCause,
    RelabelCause,
    later_readings,
    onwards,
    reading_label,
    series_of,
    series_places,
)
from orthoglide_cal.model.cause import Place, Stage
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.readings import AXES, Floats, Plan


class Misread(PatternCause):
    """Error of a single reading, of any size: a wrong digit, a wrong mark, a wrong line."""

    id = "misread"
    title = "one reading is wrong"
    stage = Stage.RECORD
    unit = "mm"
    hides_reading = True
    advice = "Take this reading again."

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        """Every reading."""
        return tuple(Place((i,)) for i in range(len(plan)))

    def label(self, place: Place, plan: Plan, machine: Machine) -> str:
        """The reading."""
        return reading_label(plan, machine, place.index[0])

    def patterns(self, plan: Plan, places: tuple[Place, ...]) -> Floats:
        """1 at the reading."""
        return np.eye(len(plan))[:, [place.index[0] for place in places]]


class GaugeSlip(PatternCause):
    """Turns added to one reading, or to all readings of a set-up from one on.

    The parameter is a whole number, nearly always one, so it is not estimated but tried.
    """

    id = "gauge_slip"
    title = "whole turns of the dial were miscounted"
    stage = Stage.RECORD
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

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        """Every reading alone, and every reading but the first of a set-up with all after it."""
        followed = onwards(plan).sum(axis=0) > 1
        kept = [i for i in later_readings(plan) if followed[i]]
        return (*(Place((i, 0)) for i in range(len(plan))), *(Place((i, 1)) for i in kept))

    def label(self, place: Place, plan: Plan, machine: Machine) -> str:
        """The reading, or the first of several."""
        reading = reading_label(plan, machine, place.index[0])
        return f"from {reading} on" if place.index[1] else reading

    def patterns(self, plan: Plan, places: tuple[Place, ...]) -> Floats:
        """1 where turns were miscounted (to be multiplied by the length of a revolution)."""
        both = np.stack((np.eye(len(plan)), onwards(plan)))
        reading, onward = np.array([place.index for place in places]).T
        return both[onward, :, reading].T


class SignFlip(RelabelCause):
    """All readings of one leg and direction have the opposite sign."""

    id = "sign_flip"
    title = "a gauge was read with the opposite sign"
    stage = Stage.RECORD
    advice = "Check which way + is on this gauge and turn the sign of its readings."

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        """Every (leg, direction)."""
        return series_places(plan)

    def label(self, place: Place, plan: Plan, machine: Machine) -> str:
        """The leg and direction."""
        return series_of(place).words

    def relabel(self, plan: Plan, place: Place) -> tuple[np.ndarray, Floats]:
        """Same readings, sign −1 in the series."""
        return np.arange(len(plan)), np.where(plan.of(series_of(place)), -1.0, 1.0)


class SwappedGauges(RelabelCause):
    """Each reading of one direction was written under the other direction of the same leg."""

    id = "swapped_gauges"
    title = "the two gauges of one leg were exchanged"
    stage = Stage.RECORD
    advice = "Check the cables or columns of the two gauges of this leg and exchange them back."

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        """Every leg that was read in two directions."""
        return tuple(
            Place((leg,))
            for leg in range(3)
            if np.unique(plan.direction[plan.leg == leg]).size == 2
        )

    def label(self, place: Place, plan: Plan, machine: Machine) -> str:
        """The leg."""
        return f"leg {AXES[place.index[0]]}"

    def relabel(self, plan: Plan, place: Place) -> tuple[np.ndarray, Floats]:
        """Exchange the readings of the two directions of the leg, where they pair up."""
        index = np.arange(len(plan))
        pairs = partners(plan, place.index[0])
        if pairs is not None:
            index[pairs[0]], index[pairs[1]] = pairs[1], pairs[0]
        return index, np.ones(len(plan))

    def reversible(self, plan: Plan, place: Place) -> bool:
        """Whether every reading has its partner."""
        return partners(plan, place.index[0]) is not None

    def really_read(self, plan: Plan, place: Place) -> Plan:
        """The leg's two directions exchanged."""
        own = plan.leg == place.index[0]
        total = np.unique(plan.direction[own]).sum()
        return replace(plan, direction=np.where(own, total - plan.direction, plan.direction))


def partners(plan: Plan, leg: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Readings of the leg's two directions, paired in time; None if they do not pair up."""
    directions = np.unique(plan.direction[plan.leg == leg])
    if directions.size != 2:
        return None
    first, second = (
        plan.in_time[(plan.leg[plan.in_time] == leg) & (plan.direction[plan.in_time] == k)]
        for k in directions
    )
    if first.size != second.size or np.any(plan.displacement[first] != plan.displacement[second]):
        return None
    return first, second


CAUSES = (Misread(), GaugeSlip(), SignFlip(), SwappedGauges())
