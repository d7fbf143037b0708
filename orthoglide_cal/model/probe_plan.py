"""Touches of a bed and distances on printed objects, as readings of a plan; ways to take them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, alike, read_only

# Pace assumed where nobody measured the time: a touch, and putting a block under the probe [min].
MINUTES_PER_TOUCH = 5.0 / 60.0
MINUTES_PER_BLOCK = 0.5
BLOCKS_MM = (25.0, 50.0)  # blocks that lie about in a workshop, or are printed
HIGH_MM = max(BLOCKS_MM)  # the higher, the less a bed imitates a frame that is out of square
PLACES = (7, 13, 25, 49, 121)  # numbers of places
REACH = 0.95  # share of the bed's radius, within which they are
# A printed object to be measured: six pillars around one, at this share of the bed's radius.
PILLARS = 0.5
MINUTES_PER_PRINT, MINUTES_PER_DISTANCE = 60.0, 0.5
# To tell what a bed alone does not: so many places of the bed, so many of them on blocks, too.
SPREAD, RAISED = (25, 49, 81, 121, 169, 241), (7, 13, 19, 25, 31, 37, 49)
DECIMALS = 1  # with which places are sent to a printer [mm]
# Multiples of it, less their whole parts, are spread most evenly.
GOLDEN = (5.0**0.5 - 1.0) / 2.0
PATCH = 1.0 / 3.0  # side of the patches that are left out together, in radii of the bed
GRAIN_MM = 20.0  # over this distance the local shape of a bed is forgotten: glue, magnets, dirt
FINER = (7, 8)  # degrees of shapes that are finer than `bed_shape`
MOMENTS = 24  # at which readings that wander take a step


@dataclass(frozen=True, eq=False, kw_only=True)
class ProbePlan(Plan):
    """Touches and distances.

    No zero is unknown: a probe's and the endstops' are one and the same. Each reading is its own
    kind: the controller stopped elsewhere.
    """

    place: Floats  # where the controller believes the nozzle to be, shape (n, 3) [mm]
    other: Floats  # the second place of a distance; of a touch the place itself, (n, 3) [mm]
    surface: Floats  # height of the touched surface over the bed, (n,) [mm]; 0 for a distance
    distance: Bools  # whether it is a distance, (n,)
    weight: Floats  # how precise it is compared to a touch: ratio of the std. deviations, (n,)
    # On which day, 0 …, (n,). The calibrated parameters of each have values of their own; their
    # derivatives, (n, 6), are zero on the day whose values are looked for.
    date: Ints = field(default_factory=lambda: read_only(0, np.intp))
    slope: Floats = field(default_factory=lambda: read_only(0.0))

    rows = MappingProxyType({"place": 3, "other": 3, "slope": 6})

    @cached_property
    def zeros(self) -> Floats:
        """Of the parameters of each other day, shape (n, 6 for each)."""
        each = [self.slope * (self.date == day)[:, None] for day in np.unique(self.date)]
        return read_only(np.hstack([np.zeros((len(self), 0)), *(s for s in each if s.any())]))

    @property
    def wanted(self) -> Floats:
        """Commanded distances, shape (n,) [mm]; 0 of a touch."""
        return np.asarray(np.linalg.norm(self.other - self.place, axis=1))

    @property
    def precision(self) -> Floats:
        return self.weight

    @property
    def touches(self) -> Bools:
        return ~self.distance

    @cached_property
    def same(self) -> np.ndarray:
        """Whether two readings are touches of one part, shape (n, n)."""
        own = np.where(self.distance, -1 - np.arange(len(self)), self.part)
        return np.asarray(own[:, None] == own)

    @property
    def flat(self) -> bool:
        """Whether all are touches of one height: what makes a shape does not show in them."""
        return not self.distance.any() and len(np.unique(self.surface)) < 2

    @cached_property
    def repeats(self) -> Ints:
        """Number of the touches of the same spot, or of the same distance, shape (n,).

        The height at which the controller stopped is what was read.
        """
        ends = np.where(self.distance[:, None], self.other, 0.0)
        height = np.where(self.distance, self.place[:, 2], self.surface)
        kind = self.distance.astype(np.intp)
        where = (*self.place[:, :2].T, height, *ends.T)
        return alike(*where, self.weight, kind, self.part)[1]

    @cached_property
    def texture(self) -> Floats:
        """Local shape of the bed under each touch, columns of unit size, shape (n, touches).

        Neighbours share it: its covariance falls off as exp(−r/λ), λ = `GRAIN_MM`.
        """
        touches = np.flatnonzero(self.touches)
        place = self.place[touches, :2]
        local = np.zeros((len(self), len(touches)))
        apart = np.linalg.norm(place[:, None] - place, axis=-1)
        size2, vectors = np.linalg.eigh(np.exp(-apart / GRAIN_MM))
        local[touches] = vectors * np.sqrt(np.maximum(size2, 0.0))
        return read_only(local)

    @cached_property
    def cells(self) -> Ints:
        """Square patches of the bed; neighbours share what the bed has there, shape (n,)."""
        reach = float(np.abs(self.place[:, :2]).max(initial=1.0))
        patch = np.floor(self.place[:, :2] / (reach * PATCH)).astype(np.intp)
        own = np.where(self.distance, 1 + np.arange(len(self)), 0)
        return alike(*patch.T, own)[1]

    def entry(self, index: int) -> Mapping[str, object]:
        place = dict(zip(("x_mm", "y_mm", "z_mm"), self.place[index].tolist(), strict=True))
        surface, distance = float(self.surface[index]), bool(self.distance[index])
        return {**place, "surface_mm": surface, "distance": distance}

    def patterns(self, ordered: bool) -> Iterator[tuple[str, Floats]]:
        """Shapes of the bed that are finer than a cause has; with time: what wanders."""
        touch = self.touches
        reach = float(np.abs(self.place[:, :2]).max(initial=1.0))
        x, y = self.place[:, 0] / reach, self.place[:, 1] / reach
        coarse, fine = (
            np.stack([touch * x**i * y ** (k - i) for k in degrees for i in range(k + 1)], axis=1)
            for degrees in (range(FINER[0]), FINER)
        )
        # What a smooth surface follows is its own.
        fine -= coarse @ np.linalg.lstsq(coarse, fine)[0]
        yield "a bed that is bent in a finer way than a smooth surface", fine
        if ordered and touch.any():
            moments = self.in_time[touch[self.in_time]]
            steps = moments[:: max(len(moments) // MOMENTS, 1)]
            wander = self.onwards[:, steps] / np.sqrt(len(steps))
            # A steady drift is a cause's own.
            steady = touch[:, None] * np.stack((np.ones(len(self)), self.hours), axis=1)
            wander -= steady @ np.linalg.lstsq(steady, wander)[0]
            yield "readings that wander with time", wander


class Layout(NamedTuple):
    """A way to measure: which readings, in which order."""

    name: str  # one word, for tables and commands
    what: str  # in words
    plan: Plan
    minutes: float  # that it takes
    cycles: int = 1  # repeats of its postures
    gauge_moves: int = 0  # how often a stand is put to another place


def rings(count: int, radius: float) -> Floats:
    """The middle, and places on rings up to a radius [mm] around it, evenly, (count, 2) [mm]."""
    # Ring k of n has a share of places that grows with k: as many as stand equally close.
    n = max(round((np.sqrt(1.0 + 4.0 * (count - 1) / 3.0) - 1.0) / 2.0), 1)
    shares = np.cumsum(np.arange(1, n + 1)) / (n * (n + 1) / 2.0)
    ends = np.round((count - 1) * shares).astype(int)
    found = [np.zeros((1, 2))]
    for k, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True), start=1):
        turn = np.radians(30.0) + 2.0 * np.pi * (np.arange(end - begin) + k / 2.0) / (end - begin)
        away = radius * k / n
        found.append(away * np.stack((np.cos(turn), np.sin(turn)), axis=1))
    return np.asarray(np.round(np.vstack(found), DECIMALS) + 0.0, dtype=np.float64)


def mixed(places: Floats) -> Floats:
    """The same places, each once, in an order that has little to do with where they are, (m, 2).

    So what drifts with time is taken neither for a tilt nor for a shape, and every place is
    approached from another side. Row by row, time is the way across the bed.
    """
    at = np.unique(places, axis=0)
    return np.asarray(at[np.argsort(np.arange(len(at)) * GOLDEN % 1.0, kind="stable")])


def compared(radius: float, calliper: float) -> tuple[Layout, ...]:
    """Ways to measure that are worth comparing: few places or many, blocks, a printed object.

    Args:
        radius: of the bed [mm].
        calliper: how precise a distance is compared to a touch: ratio of the standard deviations.
    """
    heights = ", ".join(f"{height:g}" for height in BLOCKS_MM)
    turn = np.radians(30.0 + 60.0 * np.arange(6))
    ring = PILLARS * radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    first = np.vstack((np.zeros((6, 2)), ring))
    printed = first, np.vstack((ring, np.roll(ring, -1, axis=0)))
    flat, raised, measured = [], [], []
    for count in PLACES:
        at = mixed(rings(count, REACH * radius))
        bed, up = [(at, 0.0)], [(at, height) for height in BLOCKS_MM]
        flat.append(layout_of(f"bed-{count}", f"{count} places of the bed", bed))
        what = f"{count} places of the bed, and again on blocks of {heights} mm"
        raised.append(layout_of(f"blocks-{count}", what, bed + up))
        what = f"{count} places of the bed, and {len(first)} distances on a printed object"
        measured.append(layout_of(f"print-{count}", what, bed, printed, calliper))
    return (*flat, *raised, *measured)


def telling(radius: float) -> tuple[Layout, ...]:
    """Touches that distinguish skew frame and bent bed, of this radius [mm], quickest first."""
    found = []
    for some, count in product(RAISED, SPREAD):
        upper = rings(some, REACH * radius)
        # A place that is touched on both heights has one local shape.
        bed = mixed(np.vstack((rings(count, REACH * radius), upper)))
        what = (
            f"{len(bed)} places of the bed, and {some} of them again on a block of {HIGH_MM:g} mm"
        )
        found.append(layout_of("telling", what, [(bed, 0.0), (mixed(upper), HIGH_MM)]))
    return tuple(sorted(found, key=lambda each: each.minutes))


def bed_plan(
    radius: float, places: int, heights: Sequence[float] = (0.0,), cycles: int = 1
) -> ProbePlan:
    """Touches spread evenly over the bed in a mixed order; all of one height, then the next.

    Args:
        radius: of the bed [mm].
        heights: of what lies under the probe [mm].
        cycles: repeats of all of them.
    """
    at = mixed(rings(places, REACH * radius))
    parts = [(at, height) for height in heights] * cycles
    return ProbePlan.require(layout_of("simulated", "", parts).plan)


def layout_of(
    name: str,
    what: str,
    parts: Sequence[tuple[Floats, float]],
    printed: tuple[Floats, Floats] | None = None,
    calliper: float = 1.0,
) -> Layout:
    """Touches of places (m, 2), height by height, then distances between places (d, 2) [mm]."""
    first = np.vstack([np.column_stack((at, np.full(len(at), high))) for at, high in parts])
    other, touches = first, len(first)
    pace = np.where(first[:, 2] > 0.0, MINUTES_PER_TOUCH + MINUTES_PER_BLOCK, MINUTES_PER_TOUCH)
    if printed is not None:
        first, other = (
            np.vstack((first, np.column_stack((at, np.zeros(len(at)))))) for at in printed
        )
        other[:touches] = first[:touches]
        pace = np.append(pace, np.full(len(first) - touches, MINUTES_PER_DISTANCE))
        pace[touches] += MINUTES_PER_PRINT
    distance = np.arange(len(first)) >= touches
    plan = ProbePlan(
        order=np.arange(len(first)),
        hours=(np.cumsum(pace) - pace[0]) / 60.0,
        place=first,
        other=other,
        surface=np.where(distance, 0.0, first[:, 2]),
        distance=distance,
        weight=np.where(distance, calliper, 1.0),
    )
    return Layout(name, what, plan, float(pace.sum()))
