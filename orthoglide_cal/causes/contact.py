"""Faults of what gauges and probes touch, of their stands, and of a bed."""

import math
from collections import Counter
from copy import copy
from itertools import product
from types import MappingProxyType
from typing import Self

import numpy as np

from orthoglide_cal.causes.base import PatternCause, series_places, there, words_of
from orthoglide_cal.model.linear_delta import LinearDelta, ProbePlan
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Cause, Effect, Place, Screw
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Numbers, Patterns
from orthoglide_cal.model.readings import AXES, GaugePlan, Series, other_axes

# Parameters in the order (leg, direction): x_y is what a gauge along x meets on leg y.
_SERIES = tuple(Series(leg, k) for leg in range(3) for k in other_axes(leg))


class BarSkew(Cause):
    """Slope of the bar per leg and direction: rise along + per length towards the tool."""

    id = "bar_skew"
    unit = "mrad"
    # The face of the bar that the plunger runs on, to its centre line.
    sizes = MappingProxyType({Orthoglide: 1.0})
    scale = 1e-3
    names = tuple(series.name for series in _SERIES)
    lasting = True

    def adjustment(self, name: str) -> Screw:
        leg = _SERIES[self.names.index(name)].leg
        return Screw(leg, f"the bar of leg {AXES[leg].upper()} at the tool", "this end of the bar")

    def contact(
        self, readings: Numbers, effect: Effect, plan: GaugePlan, machine: Machine, where: Numbers
    ) -> Numbers:
        """Reading += slope · distance from the carriage joint; theta (..., 6) [rad]."""
        members = np.array([plan.of(series) for series in _SERIES])
        # Turned half round, a bar rises where it fell.
        slope: Numbers = effect.theta @ (members * np.where(plan.turned, -1.0, 1.0))
        return np.asarray(readings + slope * where * machine.nominal_rails.lengths[plan.leg])


class GaugeDrift(PatternCause):
    """Rate of the readings of one leg and direction."""

    id = "gauge_drift"
    unit = "mm/h"
    # A magnetic stand settling, a plunger arm creeping.
    sizes = MappingProxyType({Orthoglide: 0.05})
    names = ("rate",)
    timed = True

    def places(self, plan: GaugePlan, machine: Machine) -> tuple[Place, ...]:
        return series_places(plan)

    def label(self, place: Place, plan: GaugePlan, machine: Machine) -> str:
        return words_of(plan, place)

    contact = PatternCause.added

    def patterns(self, plan: GaugePlan, places: tuple[Place, ...]) -> Patterns:
        hours = [there(plan, at) * plan.hours for at in places]
        return Patterns.of(plan, np.stack(hours, axis=1))


class StandShift(PatternCause):
    """Step in the readings of one gauge set-up, from some reading on."""

    id = "stand_shift"
    unit = "mm"
    sizes = MappingProxyType({Orthoglide: 0.1})  # a light knock against the stand
    names = ("step",)
    timed = True
    any_size = True

    def places(self, plan: GaugePlan, machine: Machine) -> tuple[Place, ...]:
        rows, first = plan.sequence
        return tuple((i,) for i in np.sort(rows[~first]).tolist())

    contact = PatternCause.added

    def onward(self, place: Place) -> bool:
        return True

    def to_read_again(self, plan: GaugePlan, place: Place) -> tuple[int, ...]:
        """The only reading before it, or the only one after it with the stand gone; else none.

        That is one wrong reading: nothing that is read later can show that it was a knock.
        """
        (knocked,) = place
        again = self.minority(place, plan)
        will_show = bool(plan.standing[knocked]) and knocked in again
        return () if will_show or len(again) > 1 else again


def _zernike(name: str) -> dict[tuple[int, int], int]:
    """Powers of x and y → coefficient, of Zernike's polynomial "z4_-2": degree 4, angle −2; without
    height and tilt, which are the endstops'."""
    n, m = map(int, name[1:].split("_"))
    coefficients = Counter[tuple[int, int]]()
    for k in range((n - abs(m)) // 2 + 1):
        rest = (n - abs(m)) // 2 - k  # r^(n−2k) cos mφ = (x² + y²)^rest · Re (x + iy)^m
        radial = (-1) ** k * math.comb(n - k, k) * math.comb(n - 2 * k, rest)
        for p, q in product(range(rest + 1), range(m < 0, abs(m) + 1, 2)):
            sign = math.comb(rest, p) * math.comb(abs(m), q) * (-1) ** (q // 2)
            coefficients[2 * (rest - p) + abs(m) - q, 2 * p + q] += radial * sign
    return {powers: value for powers, value in coefficients.items() if sum(powers) > 1}


_TERMS = (
    *("xx", "xy", "yy", "xxx", "xxy", "xyy", "yyy"),
    *(f"z{n}_{m}" for n in (4, 5, 6) for m in range(-n, n + 1, 2)),
)


def _falling(share: float, above: int = 2) -> tuple[float, ...]:
    """Plausible size of each term, in those of low degrees: less by a share per degree above."""
    return tuple(share ** max(_degree(name) - above, 0) for name in _TERMS)


def _degree(name: str) -> int:
    return int(name[1]) if name[0] == "z" else len(name)


PLACES_PER_TERM = 3  # of fewer it follows what nothing else would show


class _Surface(Cause):
    """A height over the bed: a sum of terms, each of one unit at the edge.

    A term's name is its formula: "xxy" is x²y, "z4_2" Zernike's polynomial of degree 4.
    """

    unit = "mm"
    lasting = True

    def __init__(self) -> None:
        terms = [
            _zernike(name) if name[0] == "z" else {(name.count("x"), name.count("y")): 1}
            for name in self.names
        ]
        self._powers = sorted({powers for term in terms for powers in term})
        self._terms = np.array([[term.get(p, 0.0) for p in self._powers] for term in terms])

    def within(self, spots: int) -> Self | None:
        """The cause with terms of whole degrees: which they are depends on no axis of the bed."""
        degrees = [_degree(name) for name in self.names]
        most = spots // PLACES_PER_TERM
        kept = [degree for degree in degrees if sum(other <= degree for other in degrees) <= most]
        if not 0 < len(kept) < len(degrees):
            return self if kept else None
        first = copy(self)
        first.names = self.names[: len(kept)]
        first.shares = tuple(share[: len(kept)] for share in self.shares)
        return first

    def contact(
        self, readings: Numbers, effect: Effect, plan: ProbePlan, machine: Machine, where: Numbers
    ) -> Numbers:
        """Reading of a touch += height of the surface; theta (..., terms) [mm at the edge]."""
        x, y, _ = np.moveaxis(where, -1, 0)
        # The first terms alone where fewer are given, as files of old have them.
        sizes = effect.theta @ self._terms[: effect.theta.shape[-1]]
        # Each power once: complex ones cost most of a simulated bed.
        every = [[np.ones_like(one)] + [one] * max(map(max, self._powers)) for one in (x, y)]
        across, along = (np.cumprod(factors, axis=0) for factors in every)
        shape = sum(
            sizes[..., k, None] * across[p] * along[q] for k, (p, q) in enumerate(self._powers)
        )
        return np.asarray(readings + plan.touches * shape)


class BedShape(_Surface):
    """A smooth shape that rises and falls over the bed; tilt and height are the endstops'.

    A Gaussian process of fixed rank: independent terms, the smaller the finer they are. The data
    choose by how much.
    """

    id = "bed_shape"
    # Glass and spring steel on a printed frame bend by a tenth towards the edge.
    sizes = MappingProxyType({LinearDelta: 0.1})
    names = _TERMS
    shares = (_falling(0.1, above=3), *map(_falling, (0.25, 0.35, 0.5, 0.7, 1.0)))


class ProbeTilt(_Surface):
    """The effector tilts as it moves, and a probe next to the nozzle rises or falls with it."""

    id = "probe_tilt"
    # Arms of a pair that differ by 0.1 mm, a probe 20 mm from the nozzle.
    sizes = MappingProxyType({LinearDelta: 0.05})
    names = ("xx", "xy", "yy")


class ProbeDrift(Cause):
    """The height at which the probe triggers drifts while it warms up or cools."""

    id = "probe_drift"
    unit = "mm/h"
    # An inductive probe or its mount cooling by some degrees.
    sizes = MappingProxyType({LinearDelta: 0.05})
    names = ("rate",)
    timed = True
    same_remedy_as = "thermal_drift"

    def contact(
        self, readings: Numbers, effect: Effect, plan: ProbePlan, machine: Machine, where: Numbers
    ) -> Numbers:
        """Reading += rate · hours; theta (..., 1) [mm/h]."""
        return readings + plan.touches * effect.theta * plan.elapsed


CAUSES = (
    BarSkew(), GaugeDrift(), StandShift(), BedShape(), ProbeTilt(), ProbeDrift(),
)  # fmt: skip
