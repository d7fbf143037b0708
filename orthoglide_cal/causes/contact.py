"""What can be wrong with what the gauges touch, and with their stands."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from orthoglide_cal.causes.base import (
    PatternCause,
    apart,
    later_readings,
    series_places,
    there,
    words_of,
)
from orthoglide_cal.model.cause import Cause, Effect, Place, Stage
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Floats, Numbers, Plan
from orthoglide_cal.model.readings import GaugePlan, Series, other_axes

# Parameters in the order (leg, direction): x_y is what a gauge along x meets on leg y.
_SERIES = tuple(Series(leg, k) for leg in range(3) for k in other_axes(leg))


class BarSkew(Cause):
    """Slope of the bar per leg and direction: rise along + per length towards the tool."""

    id = "bar_skew"
    title = "a touched bar is not parallel to its leg"
    stage = Stage.CONTACT
    unit = "mrad"
    sizes = MappingProxyType({Orthoglide: 1.0})
    size_reason = "the face of the bar that the plunger runs on, to its centre line"
    scale = 1e-3
    names = tuple(series.name for series in _SERIES)
    lasting = True
    instrument = "the same readings once more with the bar turned half round"
    advice = (
        "Measure on a ground surface parallel to the joint centres, or with the gauge on the"
        " opposite bar."
    )

    def contact(
        self, heights: Numbers, effect: Effect, where: Numbers, plan: Plan, machine: Machine
    ) -> Numbers:
        """Reading += slope · distance from the carriage joint; theta (..., 6) [rad]."""
        plan = GaugePlan.require(plan)
        own = np.array([plan.of(series) for series in _SERIES])
        # Turned half round, a bar rises where it fell.
        slope: Numbers = effect.theta @ (own * np.where(plan.turned, -1.0, 1.0))
        return heights + slope * where * Orthoglide.require(machine).leg_length_mm


class GaugeDrift(PatternCause):
    """Rate of the readings of one leg and direction."""

    id = "gauge_drift"
    title = "a gauge or its stand creeps"
    stage = Stage.CONTACT
    unit = "mm/h"
    sizes = MappingProxyType({Orthoglide: 0.05})
    size_reason = "a magnetic stand settling, a plunger arm creeping"
    names = ("rate",)
    timed = True
    instrument = "the gauge left on its bar for an hour, machine standing"
    advice = "Clamp the stand of {where} again on a clean surface, and repeat this leg."

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        return series_places(plan)

    def label(self, place: Place, plan: Plan, machine: Machine) -> str:
        return words_of(plan, place)

    def patterns(self, plan: Plan, places: tuple[Place, ...]) -> Floats:
        return np.stack([there(plan, at) * plan.hours for at in places], axis=1)


class StandShift(PatternCause):
    """Step in the readings of one gauge set-up, from some reading on."""

    id = "stand_shift"
    title = "a gauge or its stand was knocked"
    stage = Stage.CONTACT
    unit = "mm"
    sizes = MappingProxyType({Orthoglide: 0.1})
    size_reason = "a light knock against the stand"
    names = ("step",)
    timed = True
    instrument = "a last reading at the first posture, before a stand is moved"
    advice = (
        "The stand was knocked: {where}. Clamp it again and repeat this leg from its first"
        " isotropic reading."
    )

    def places(self, plan: Plan, machine: Machine) -> tuple[Place, ...]:
        return tuple((i,) for i in later_readings(plan))

    def to_read_again(self, plan: Plan, place: Place) -> tuple[int, ...]:
        """The only reading before it, or the only one after it with the stand gone; else none.

        That is one wrong reading: nothing that is read later can show that it was a knock.
        """
        (knocked,) = place
        again = apart(plan, self.spoiled(place, plan))
        will_show = bool(GaugePlan.require(plan).standing[knocked]) and knocked in again
        return () if will_show or len(again) > 1 else again

    def label(self, place: Place, plan: Plan, machine: Machine) -> str:
        return f"from {machine.reading_words(plan, place[0])} on"

    def patterns(self, plan: Plan, places: tuple[Place, ...]) -> Floats:
        return plan.onwards[:, [place[0] for place in places]]


CAUSES = (BarSkew(), GaugeDrift(), StandShift())
