"""Patterns that readings may hold, not written out as columns: they cost as much as the readings.

Σ = σ² I + a² P Pᵀ   of n readings, P one of the patterns, a its size
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, ReadOnly, Structure, read_only

# So many numbers of a pattern are worked off at a time.
AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class Patterns(ReadOnly):
    """Columns of unit size, shape (n, P): a reading, or all from one on that share what it does.

    Others are written out; they come last.
    """

    plan: Plan
    reading: Ints  # of each of the first columns, shape (p,)
    onward: Bools  # whether the later ones belong to it, shape (p,)
    other: Floats  # shape (n, P − p)

    @classmethod
    def at(cls, plan: Plan, reading: Ints, onward: bool | Bools) -> "Patterns":
        """One column for each of some readings, (p,)."""
        return cls(
            plan,
            np.asarray(reading, np.intp),
            np.array(np.broadcast_to(onward, len(reading))),
            np.zeros((len(plan), 0)),
        )

    @classmethod
    def of(cls, plan: Plan, columns: Floats) -> "Patterns":
        """Columns that are written out, (n, P)."""
        return cls(plan, np.zeros(0, np.intp), np.zeros(0, np.bool_), columns)

    def __len__(self) -> int:
        return len(self.reading) + int(self.other.shape[1])

    def products(self, values: Floats) -> Floats:
        """Pᵀ v of columns (..., n, c), shape (..., P, c)."""
        single = values[..., self.reading, :]
        if self.onward.any():
            late = later_sums(self.plan, values)[..., self.reading[self.onward], :]
            single[..., self.onward, :] = late
        return np.concatenate((single, self.other.T @ values), axis=-2)

    def squares(self, weight: Floats) -> Floats:
        """Σ w² p² of weights (n, 1), shape (P,)."""
        weight2 = weight**2
        single = Patterns(self.plan, self.reading, self.onward, self.other**2)
        return np.asarray(single.products(weight2)[:, 0])

    def columns(self, chosen: slice) -> Floats:
        """Some of the columns, written out, shape (n, q)."""
        reading, onward = self.reading[chosen], self.onward[chosen]
        plan, index = self.plan, np.arange(len(self.plan))[:, None]
        later = (plan.shared[:, None] == plan.shared[reading]) & (
            plan.order[:, None] >= plan.order[reading]
        )
        first = np.where(onward, later, index == reading).astype(np.float64)
        start, stop, _ = chosen.indices(len(self))
        before = len(self.reading)
        return np.hstack((first, self.other[:, max(start - before, 0) : max(stop - before, 0)]))


def later_sums(plan: Plan, values: Floats) -> Floats:
    """Sums of columns (..., n, c) over each reading and all later ones that share what it does."""
    rows, first = plan.sequence
    to_end = np.cumsum(values[..., rows[::-1], :], axis=-2)[..., ::-1, :]
    beyond = np.zeros((*values.shape[:-2], np.count_nonzero(first), values.shape[-1]))
    beyond[..., :-1, :] = to_end[..., np.flatnonzero(first)[1:], :]
    sums = np.empty_like(to_end)
    sums[..., rows, :] = to_end - beyond[..., np.cumsum(first) - 1, :]
    return sums


@dataclass(frozen=True, eq=False)
class Groups(ReadOnly, Structure):
    """The same deviation in all readings of a group; each group has its own."""

    group: Ints  # number of each reading's group; −1 for none, shape (n,)

    @cached_property
    def _count(self) -> Ints:
        return read_only(np.bincount(self.group[self.group >= 0]), np.intp)

    def products(self, values: Floats) -> Floats:
        sums = np.zeros((self._count.size, values.shape[1]))
        member = self.group >= 0
        np.add.at(sums, self.group[member], values[member])
        return sums

    def weigh(self, values: Floats, noise2: Floats, size2: Floats) -> tuple[Floats, Floats]:
        sums, number = self.products(values), np.unique(self._count)
        inner = np.stack([part.T @ part for part in (sums[self._count == m] for m in number)])
        groups = np.bincount(self._count)[number]
        widened = noise2[:, None] + size2[:, None] * number
        share = size2[:, None] / (noise2[:, None] * widened)
        square = values.T @ values / noise2[:, None, None] - np.tensordot(share, inner, axes=1)
        log_det = np.log(widened / noise2[:, None]) @ groups + len(values) * np.log(noise2)
        return square, log_det


@dataclass(frozen=True, eq=False)
class Wander(ReadOnly, Structure):
    """A step at each reading, which stays in all later ones that share what it shares.

    D takes from each reading the one before it: D P is the unit matrix, and D Σ Dᵀ tridiagonal.
    """

    plan: Plan

    @cached_property
    def _share(self) -> float:
        """Square of a step: the longest sequence wanders by unit size."""
        return 1.0 / float(np.bincount(self.plan.shared).max())

    def products(self, values: Floats) -> Floats:
        return np.asarray(np.sqrt(self._share) * later_sums(self.plan, values))

    def weigh(self, values: Floats, noise2: Floats, size2: Floats) -> tuple[Floats, Floats]:
        rows, first = self.plan.sequence
        steps = values[rows]
        steps[1:] -= np.where(first[1:, None], 0.0, values[rows[:-1]])
        some = max(AT_ONCE // steps.size, 1)
        parts = [
            _eliminated(
                noise2[at : at + some, None] * np.where(first, 1.0, 2.0)
                + self._share * size2[at : at + some, None],
                -noise2[at : at + some, None] * ~first[1:],
                steps[None],
            )
            for at in range(0, len(noise2), some)
        ]
        square, log_det = (np.concatenate(part) for part in zip(*parts, strict=True))
        return square, log_det


def _eliminated(diagonal: Floats, beside: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Vᵀ T⁻¹ V (g, c, c) and ln det T (g,) of tridiagonal matrices, by cyclic reduction.

    Every second unknown is eliminated, until none is left.

    Args:
        diagonal, beside: of T, shape (g, n) and (g, n − 1).
        values: V, shape (1 or g, n, c).
    """
    c = values.shape[-1]
    square, log_det = np.zeros((len(diagonal), c, c)), np.zeros(len(diagonal))
    while diagonal.shape[1]:
        pivot, own = diagonal[:, 1::2], values[:, 1::2]
        if diagonal.shape[1] == 1:
            pivot, own = diagonal, values
        scaled = own / pivot[..., None]
        square += np.swapaxes(own, -1, -2) @ scaled
        log_det += np.log(pivot).sum(axis=1)
        if diagonal.shape[1] == 1:
            break
        left, right = beside[:, 0::2], beside[:, 1::2]
        m, r = left.shape[1], right.shape[1]
        diagonal, values = (
            diagonal[:, 0::2].copy(),
            np.repeat(values[:, 0::2], len(diagonal) // len(values), axis=0),
        )
        diagonal[:, :m] -= left**2 / pivot
        diagonal[:, 1 : r + 1] -= right**2 / pivot[:, :r]
        values[:, :m] -= left[..., None] * scaled
        values[:, 1 : r + 1] -= right[..., None] * scaled[:, :r]
        beside = -left[:, :r] * right / pivot[:, :r]
    return square, log_det
