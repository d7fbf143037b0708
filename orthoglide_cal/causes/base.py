"""Causes that add a known pattern to the readings at one of many places; words for places."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Cause, Effect, Place
from orthoglide_cal.model.plan import AnyPlan, Bools, Floats, Numbers, Patterns
from orthoglide_cal.model.readings import AXES, GaugePlan, Series


class PatternCause(Cause):
    """A cause that adds a known pattern of readings, of one parameter, at one of many places."""

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

    def minority(self, place: Place, plan: AnyPlan) -> tuple[int, ...]:
        """The readings that it changes, or the others of their set-up, whichever are fewer: with
        an unknown zero a step that leaves one behind is as one that moves one."""
        at, same = place[0], np.flatnonzero(plan.shared == plan.shared[place[0]])
        moved = plan.order[same] >= plan.order[at] if self.onward(place) else same == at
        rest, readings = same[~moved], same[moved]
        return tuple((rest if 0 < rest.size <= readings.size else readings).tolist())

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


# A fault of the measurement is of one part, at the place (leg, direction, part) or (leg, part).


def series_places(plan: GaugePlan) -> tuple[Place, ...]:
    """One place for each (leg, direction) that was read, in each part."""
    places = sorted(set(zip(plan.part.tolist(), plan.series, strict=True)))
    return tuple((*series, part) for part, series in places)


def there(plan: GaugePlan, place: Place) -> Bools:
    """True for readings at such a place, shape (n,)."""
    *where, part = place
    same = np.stack((plan.leg, plan.direction), axis=1)[:, : len(where)] == where
    return np.asarray(same.all(axis=1) & (plan.part == part))


def words_of(plan: GaugePlan, place: Place) -> str:
    """Such a place for people: "leg x, direction y"; with the part where the plan has several."""
    *where, part = place
    words = Series(*where).words if len(where) > 1 else f"leg {AXES[where[0]]}"
    return words + plan.part_words(part)
