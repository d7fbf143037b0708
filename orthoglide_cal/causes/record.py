"""Faults of the record: a wrong reading, miscounted turns, exchanged labels, signs or units."""

import functools
from abc import ABC, abstractmethod
from copy import copy
from dataclasses import replace
from types import MappingProxyType
from typing import Self

import numpy as np

from orthoglide_cal.causes.base import PatternCause, series_places, there, words_of
from orthoglide_cal.model.gauge import UNITS
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import EVERYWHERE, Cause, Effect, Place
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import AnyPlan, Floats, Ints, Numbers, Plan
from orthoglide_cal.model.readings import GaugePlan

CLERICAL = 0.1  # how likely a fault of a whole table is compared to that of one gauge
_UNITS = tuple(UNITS)


def whole_table(plan: Plan) -> tuple[Place, ...]:
    """The whole table, as the place of a slip in writing it; none where parts were joined."""
    return () if plan.parts > 1 else (EVERYWHERE,)


class Misread(PatternCause):
    """Error of a single reading, of any size: a wrong digit, a wrong mark, a wrong line."""

    id = "misread"
    unit = "mm"
    sizes = MappingProxyType({Orthoglide: 0.1, LinearDelta: 0.1})  # a slip of one numbered division
    hides_reading = True
    any_size = True

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        return tuple((i,) for i in range(len(plan)))

    def several(self, count: int) -> Self:
        cause = copy(self)
        cause.names = tuple(f"size_{number}" for number in range(1, count + 1))
        return cause

    def label(self, place: Place, plan: AnyPlan, machine: Machine) -> str:
        return "; ".join(machine.reading_words(plan, reading) for reading in place)

    record = PatternCause.added

    def to_read_again(self, plan: AnyPlan, place: Place) -> tuple[int, ...]:
        return tuple(sorted(place))

    def _pattern(self, place: Place, plan: AnyPlan) -> Floats:
        return self.patterns(plan, tuple((reading,) for reading in place)).columns(slice(None))


class GaugeSlip(PatternCause):
    """Turns, a whole number, added to one reading, or to all readings of a set-up from one on."""

    id = "gauge_slip"
    unit = "turns"
    sizes = MappingProxyType({Orthoglide: 1.0})  # the small pointer was misjudged by one
    names = ("turns",)
    counts = MappingProxyType({-1: 0.42, 1: 0.42, -2: 0.07, 2: 0.07, -3: 0.01, 3: 0.01})

    def possible(self, machine: Machine) -> bool:
        return super().possible(machine) and machine.instrument.turn_mm > 0.0

    record = PatternCause.added

    def to_read_again(self, plan: Plan, place: Place) -> tuple[int, ...]:
        return self.minority(place, plan)

    def millimetres(self, machine: Machine) -> float:
        return machine.instrument.turn_mm

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        rows, first = plan.sequence
        kept = np.sort(rows[~first & ~np.append(first[1:], True)]).tolist()
        return (*((i, 0) for i in range(len(plan))), *((i, 1) for i in kept))

    def onward(self, place: Place) -> bool:
        return place[1] == 1


class RelabelCause(Cause):
    """A cause without size: readings written down with another sign, label or unit."""

    unit = ""
    placed = True
    sizes = MappingProxyType({Orthoglide: 1.0})

    def record(self, readings: Numbers, effect: Effect, plan: AnyPlan, machine: Machine) -> Numbers:
        index, sign = self.relabel(plan, effect.place)
        return np.asarray(sign * readings[..., index] / self.unit_mm(effect.place))

    def inverted(self, readings: Floats, effect: Effect, plan: AnyPlan, machine: Machine) -> Floats:
        index, sign = self.relabel(plan, effect.place)
        return np.asarray(sign * readings[..., index] * self.unit_mm(effect.place))


class ExchangeCause(RelabelCause, ABC):
    """Readings of one leg and direction were written under another, and the other way round.

    Each is exchanged with that of the same step in the same part. Where these do not pair up, the
    readings are looked at under another plan.
    """

    @abstractmethod
    def really(self, plan: GaugePlan, place: Place) -> tuple[Ints, Ints]:
        """Leg and direction that each reading was of, shape (n,); its own inverse."""

    def relabel(self, plan: GaugePlan, place: Place) -> tuple[Ints, Floats]:
        unchanged, signs = super().relabel(plan, place)
        index = _partners(self, plan.steps, place)
        return unchanged if index is None else index, signs

    def reversible(self, plan: GaugePlan, place: Place) -> bool:
        return _partners(self, plan.steps, place) is not None

    def really_read(self, plan: GaugePlan, place: Place) -> GaugePlan:
        """Each reading under the leg and direction that was read, at the posture of that leg."""
        leg, direction = self.really(plan, place)
        return replace(plan, leg=leg, direction=direction)


# Asked again and again of one plan while it is diagnosed.
@functools.lru_cache(maxsize=64)
def _partners(cause: ExchangeCause, plan: GaugePlan, place: Place) -> np.ndarray | None:
    """The partner of each reading, shape (n,); None if they do not pair up, or none has one."""

    def in_turn(leg: Ints, direction: Ints) -> tuple[Ints, Floats]:
        """Indices of the readings by leg and direction, then in time; what partners agree in."""
        rows = np.lexsort((plan.order, direction, leg, plan.part))
        keys = plan.part, leg, direction, plan.displacement, plan.contact, *plan.state
        return rows, np.stack(keys)[:, rows]

    partners, written = in_turn(plan.leg, plan.direction)
    rows, read = in_turn(*cause.really(plan, place))
    index = np.empty_like(rows)
    index[rows] = partners
    # Readings that share a zero must do so after the exchange.
    zeros = set(zip(plan.setup.tolist(), plan.setup[index].tolist(), strict=True))
    changed = np.any(index != np.arange(len(plan)))
    return index if changed and len(zeros) == plan.setups and np.all(written == read) else None


class SignFlip(RelabelCause):
    """Readings of one leg and direction have the opposite sign, or, rarely, the whole table: to
    first order as with opposite offsets."""

    id = "sign_flip"

    def places(self, plan: GaugePlan, machine: Machine) -> tuple[Place, ...]:
        return (*series_places(plan), *whole_table(plan))

    def share(self, place: Place) -> float:
        return CLERICAL if place == EVERYWHERE else 1.0

    def label(self, place: Place, plan: GaugePlan, machine: Machine) -> str:
        return "all readings" if place == EVERYWHERE else words_of(plan, place)

    def relabel(self, plan: GaugePlan, place: Place) -> tuple[Ints, Floats]:
        turned = True if place == EVERYWHERE else there(plan, place)
        return np.arange(len(plan)), np.where(turned, -1.0, np.ones(len(plan)))


class SwappedGauges(ExchangeCause):
    """Each reading of one direction was written under the other one of the same leg; or, which
    no reading distinguishes, the two other legs, with their axes, for each other."""

    id = "swapped_gauges"

    def places(self, plan: GaugePlan, machine: Machine) -> tuple[Place, ...]:
        legs = ((leg, part) for part in range(plan.parts) for leg in range(3))
        return tuple(at for at in legs if np.unique(plan.direction[there(plan, at)]).size == 2)

    def label(self, place: Place, plan: GaugePlan, machine: Machine) -> str:
        return words_of(plan, place)

    def really(self, plan: GaugePlan, place: Place) -> tuple[Ints, Ints]:
        other = 3 - plan.leg - plan.direction
        return plan.leg, np.where(there(plan, place), other, plan.direction)


class ExchangedColumns(ExchangeCause):
    """The columns leg and direction stand under each other's headings, in the whole table."""

    id = "exchanged_columns"
    weight = CLERICAL

    def places(self, plan: GaugePlan, machine: Machine) -> tuple[Place, ...]:
        return whole_table(plan)

    def really(self, plan: GaugePlan, place: Place) -> tuple[Ints, Ints]:
        """Leg and direction exchanged; the posture is that of the leg that was moved."""
        return plan.direction, plan.leg


class WrongUnit(RelabelCause):
    """All readings are in another unit than the file says."""

    id = "wrong_unit"
    weight = CLERICAL

    def places(self, plan: GaugePlan, machine: Machine) -> tuple[Place, ...]:
        return tuple((k,) for _ in whole_table(plan) for k in range(len(_UNITS)))

    def label(self, place: Place, plan: GaugePlan, machine: Machine) -> str:
        return UNITS[self.unit_mm(place)][0]

    def unit_mm(self, place: Place) -> float:
        return _UNITS[place[0]]


CAUSES = (
    Misread(), GaugeSlip(), SignFlip(), SwappedGauges(), ExchangedColumns(), WrongUnit(),
)  # fmt: skip
