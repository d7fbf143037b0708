"""Touches of a bed, and distances on printed objects, as readings of a plan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, alike, read_only

# Side of the patches that are left out together, in radii of the bed.
PATCH = 1.0 / 3.0
# Over this distance the local shape of a bed is forgotten: glue, magnets, dirt.
GRAIN_MM = 20.0
# Degrees of shapes that are finer than `bed_shape`.
FINER = (4, 5, 6)
# Moments at which readings that wander take a step.
MOMENTS = 24


@dataclass(frozen=True, eq=False, kw_only=True)
class ProbePlan(Plan):
    """Touches and distances.

    Attributes:
        place: where the controller believes the nozzle to be, shape (n, 3) [mm].
        other: the second place of a distance; of a touch the place itself, shape (n, 3) [mm].
        surface: height of the touched surface over the bed, (n,) [mm]; 0 for a distance.
        distance: True for a distance, (n,).
        weight: how precise it is compared to a touch: ratio of the standard deviations, (n,).
    """

    place: Floats
    other: Floats
    surface: Floats
    distance: Bools
    weight: Floats

    rows = MappingProxyType({"place": 3, "other": 3})
    setups = 0  # a probe's zero and the endstops are one and the same

    @property
    def zeros(self) -> Floats:
        return np.zeros((len(self), 0))

    @property
    def precision(self) -> Floats:
        return self.weight

    @property
    def weighing(self) -> str:
        return " (a distance counts by its precision)" if np.any(self.weight != 1.0) else ""

    @cached_property
    def same(self) -> np.ndarray:
        """Whether two readings are touches of one part, shape (n, n)."""
        own = np.where(self.distance, -1 - np.arange(len(self)), self.part)
        return np.asarray(own[:, None] == own)

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
        """Local shape of the bed under each touch, columns of unit size, shape (n, touches)."""
        touches = np.flatnonzero(~self.distance)
        local = np.zeros((len(self), len(touches)))
        local[touches] = texture(self.place[touches, :2])
        return read_only(local)

    @property
    def distinct(self) -> tuple[Ints, Ints]:
        """Each reading is its own kind: the controller stopped elsewhere."""
        alone = read_only(np.arange(len(self)), np.intp)
        return alone, alone

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
        touch = ~self.distance
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


def texture(place: Floats) -> Floats:
    """Local shapes of a bed, shared by neighbours: columns of unit size, shape (n, n).

    Its covariance falls off as exp(−r/λ), λ = `GRAIN_MM`.

    Args:
        place: shape (n, 2) [mm].
    """
    apart = np.linalg.norm(place[:, None] - place, axis=-1)
    size2, vectors = np.linalg.eigh(np.exp(-apart / GRAIN_MM))
    return np.asarray(vectors * np.sqrt(np.maximum(size2, 0.0)))
