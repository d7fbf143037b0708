"""Two families of causes at one of many places, and how places are called.

A pattern cause adds a known pattern to the readings; a relabelling one exchanges readings or their
signs. All others act on the whole machine at once and are `Cause`s of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.cause import Cause, Place, Stage
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.readings import Floats, Numbers, Plan, Series


class PatternCause(Cause):
    """A cause of one parameter that adds a known pattern of readings, at one of many places.

    Attributes:
        counts: sizes that it can take where they are whole numbers, with how plausible each is;
            empty for a size of any value.
        hides_reading: True if the reading at its place says nothing any more.
    """

    names = ("size",)
    counts: Mapping[int, float] = MappingProxyType({})
    hides_reading: bool = False

    def millimetres(self, machine: Machine) -> float:
        """One unit of its size in what the patterns are multiplied by."""
        return 1.0

    def patterns(self, plan: Plan, places: tuple[Place, ...]) -> Floats:
        """Readings added by one internal unit at each place, shape (n, places)."""
        raise NotImplementedError

    def contact(
        self,
        heights: Numbers,
        theta: Numbers,
        place: Place,
        fraction: Numbers,
        plan: Plan,
        machine: Machine,
    ) -> Numbers:
        """Reading += pattern · theta, shape (..., 1), if it acts in this stage."""
        if self.stage is not Stage.CONTACT:
            return heights
        return heights + self._added(theta, place, plan, machine)

    def record(
        self, readings: Numbers, theta: Numbers, place: Place, plan: Plan, machine: Machine
    ) -> Numbers:
        """Reading += pattern · theta, shape (..., 1), if it acts in this stage."""
        if self.stage is not Stage.RECORD:
            return readings
        return readings + self._added(theta, place, plan, machine)

    def _added(self, theta: Numbers, place: Place, plan: Plan, machine: Machine) -> Numbers:
        unit = self.millimetres(machine)
        return np.asarray(unit * (theta * self.patterns(plan, (place,))[:, 0]))


class RelabelCause(Cause):
    """A cause without size: readings written down with another sign or under another label."""

    unit = ""

    def relabel(self, plan: Plan, place: Place) -> tuple[np.ndarray, Floats]:
        """Indices and signs, shape (n,): recorded = signs · true[indices]; its own inverse."""
        raise NotImplementedError

    def reversible(self, plan: Plan, place: Place) -> bool:
        """Whether `relabel` can express it: each reading was written down in place of another."""
        return True

    def really_read(self, plan: Plan, place: Place) -> Plan:
        """The plan with each reading under the leg and direction that was really read."""
        return plan

    def record(
        self, readings: Numbers, theta: Numbers, place: Place, plan: Plan, machine: Machine
    ) -> Numbers:
        """Readings as they were written down."""
        index, sign = self.relabel(plan, place)
        return np.asarray(sign * readings[..., index])


def reading_label(plan: Plan, machine: Machine, index: int) -> str:
    """One reading in words: "leg x, direction y, min, cycle 2 (reading 12)"."""
    moved = float(plan.displacement[index])
    posture = machine.posture_at(moved) or f"{moved:g} mm"
    same = (plan.setup == plan.setup[index]) & (plan.displacement == moved)
    cycle = int(np.sum(same & (plan.order <= plan.order[index])))
    number = int(np.sum(plan.order <= plan.order[index]))
    return f"{plan.series[index].words}, {posture}, cycle {cycle} (reading {number})"


def series_places(plan: Plan) -> tuple[Place, ...]:
    """One place for each (leg, direction) that was read."""
    return tuple(Place(series) for series in sorted(set(plan.series)))


def series_of(place: Place) -> Series:
    """The leg and direction that a place names."""
    return Series(*place.index[:2])


def onwards(plan: Plan) -> Floats:
    """Column i is 1 at reading i and all later ones of its set-up, shape (n, n)."""
    same = plan.setup[:, None] == plan.setup
    return np.asarray(same & (plan.order[:, None] >= plan.order), dtype=np.float64)


def later_readings(plan: Plan) -> list[int]:
    """Readings that have an earlier one in their set-up."""
    same = plan.setup[:, None] == plan.setup
    earlier = same & (plan.order[:, None] > plan.order)
    return np.flatnonzero(earlier.any(axis=1)).tolist()
