"""Two families of causes at one of many places, and how places are called.

A pattern cause adds a known pattern to the readings; a relabelling one exchanges readings, their
signs or their unit. All others act on the whole machine at once and are `Cause`s of the model.
"""

import functools
from abc import ABC, abstractmethod
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Cause, Effect, Place
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import AnyPlan, Bools, Floats, Ints, Numbers, Patterns, Plan
from orthoglide_cal.model.readings import AXES, GaugePlan, Series, part_words


class PatternCause(Cause):
    """A cause that adds a known pattern of readings, at one of many places.

    Of one parameter; of several readings that are wrong, each by itself, of one for each.
    """

    names: tuple[str, ...] = ("size",)
    placed = True

    def onward(self, place: Place) -> bool:
        """True if it concerns all later readings that share a zero with the one at its place."""
        return False

    def label(self, place: Place, plan: AnyPlan, machine: Machine) -> str:
        reading = machine.reading_words(plan, place[0])
        return f"from {reading} on" if self.onward(place) else reading

    def patterns(self, plan: AnyPlan, places: tuple[Place, ...]) -> Patterns:
        """Readings added by one internal unit at each place, a reading, shape (n, places)."""
        return Patterns.at(plan, [place[0] for place in places], list(map(self.onward, places)))

    def spoiled(self, place: Place, plan: AnyPlan) -> Ints:
        """Indices of the readings that it changes at a place."""
        return np.flatnonzero(self._pattern(place, plan).any(axis=1))

    def _pattern(self, place: Place, plan: AnyPlan) -> Floats:
        """Readings added by one internal unit of each parameter, shape (n, p)."""
        return self.patterns(plan, (place,)).columns(slice(None))

    def added(
        self,
        readings: Numbers,
        effect: Effect,
        plan: AnyPlan,
        machine: Machine,
        where: object = None,
    ) -> Numbers:
        """Reading += pattern · theta, shape (..., 1): its method of contact, or of record."""
        pattern = self._pattern(effect.place, plan)
        return readings + self.millimetres(machine) * (effect.theta @ pattern.T)

    def inverted(self, readings: Floats, effect: Effect, plan: AnyPlan, machine: Machine) -> Floats:
        return self.added(readings, replace(effect, theta=-effect.theta), plan, machine)


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

    Each reading is exchanged with the one of the same step of the other leg and direction, in the
    same part. Where these do not pair up, the readings are looked at under another plan.
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


# A fault of the measurement is of one part, at the place (leg, direction) or (leg,). The first part
# is not written: (0, 1) is leg x, direction y in part 0, (0, 1, 2) the same in part 2.


def place_in(part: int, *where: int) -> Place:
    """The place that means a leg, and a direction, in this part."""
    return (*where, part) if part else where


def series_places(plan: GaugePlan) -> tuple[Place, ...]:
    """One place for each (leg, direction) that was read, in each part."""
    places = sorted(set(zip(plan.part.tolist(), plan.series, strict=True)))
    return tuple(place_in(part, *series) for part, series in places)


def _part(place: Place, width: int) -> int:
    """The part of a place that begins with `width` indices; the first is not written."""
    return place[width] if len(place) > width else 0


def there(plan: GaugePlan, place: Place, width: int = 2) -> Bools:
    """Which readings are at a place that begins with `width` indices, shape (n,)."""
    same = np.stack((plan.leg, plan.direction), axis=1)[:, :width] == place[:width]
    return np.asarray(same.all(axis=1) & (plan.part == _part(place, width)))


def words_of(plan: GaugePlan, place: Place, width: int = 2) -> str:
    """Such a place for people: "leg x, direction y"; with the part where the plan has several."""
    where = Series(*place[:2]).words if width == 2 else f"leg {AXES[place[0]]}"
    return where + part_words(plan, _part(place, width))


def apart(plan: Plan, readings: Ints) -> tuple[int, ...]:
    """The fewer of some readings of a set-up and the rest of it: its zero is unknown.

    A step that leaves one reading behind is one wrong reading, as is one that moves one.
    """
    rest = np.setdiff1d(np.flatnonzero(plan.shared == plan.shared[readings[0]]), readings)
    fewer = rest if 0 < rest.size <= readings.size else readings
    return tuple(fewer.tolist())
