"""Plans of any kind of machine: which readings are, or are to be, taken.

It holds no measured value. Readings may share unknown zeros and differ in precision.
"""

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
# Real in use; complex only while a derivative is taken by a complex step.
Numbers = NDArray[Any]
PlanT = TypeVar("PlanT", bound="Plan")
T = TypeVar("T")
# A plan of the kind of machine whose methods take it; these name its class, the base cannot.
AnyPlan = Any
AnyCell = Any  # likewise a reading to take: see `PlannedReading`
# Where a pattern acts: leg, direction, posture, as far as these matter; empty for everywhere.
Where = Mapping[str, str]


def read_only(values: ArrayLike, dtype: DTypeLike = np.float64) -> Numbers:
    """A private copy of `values` that nobody can write to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def altered(value: T, **fields: object) -> T:
    """A copy with other fields, on which nothing that it has worked out depends."""
    other = object.__new__(type(value))
    vars(other).update(vars(value) | fields)
    return other


def of_steps(work: Callable[[PlanT], T]) -> cached_property[T]:
    """A property of a plan in which no time is: worked out once for all plans of the same steps."""

    @functools.wraps(work)
    def once(plan: PlanT) -> T:
        known: T = work(plan) if plan.steps is plan else getattr(plan.steps, work.__name__)
        return known

    return cached_property(once)


class ReadOnly:
    """Base of frozen dataclasses: arrays that somebody could write to are replaced by copies."""

    def __post_init__(self) -> None:
        for name, given in list(vars(self).items()):
            if isinstance(given, np.ndarray) and (given.flags.writeable or given.base is not None):
                object.__setattr__(self, name, read_only(given, given.dtype))


# Of the arrays of a plan, by their annotations.
_DTYPES: Mapping[object, type] = MappingProxyType({Floats: float, Ints: np.intp, Bools: bool})


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan(ABC):
    """Readings to be taken; every array is read-only, of shape (n, ...).

    What is given once for all readings is repeated for each.
    """

    order: Ints  # rank in time; equal only for readings that are never compared in time, (n,)
    hours: Floats  # since the session began, (n,) [h]
    # Sitting, 0 …, (n,): between parts the gauges are set up, and numbered, again.
    part: Ints = field(default_factory=lambda: read_only(0, np.intp))
    # On which day, 0 …, each is taken, (n,).
    date: Ints = field(default_factory=lambda: read_only(0, np.intp))
    # Standard deviation of a common reading divided by that of each, (n,).
    precision: Floats = field(default_factory=lambda: read_only(1.0))

    # Length of a row of the arrays that have more than one number for each reading.
    rows: ClassVar[Mapping[str, int]] = MappingProxyType({})

    def __post_init__(self) -> None:
        n = np.shape(self.order)
        for item in fields(self):
            array: Numbers = np.asarray(getattr(self, item.name), _DTYPES[item.type])
            shape = (*n, self.rows[item.name]) if item.name in self.rows else n
            if item.default_factory is not MISSING and array.ndim < len(shape):
                array = np.broadcast_to(array, shape)
            if array.shape != shape or len(n) != 1:
                raise ValueError(f"{item.name} has shape {array.shape}, order has {n}")
            object.__setattr__(self, item.name, read_only(array, array.dtype))

    @classmethod
    def require(cls, plan: "Plan") -> Self:
        """The plan, if it is of this kind; raises TypeError for another one."""
        if not isinstance(plan, cls):
            raise TypeError(f"{cls.__name__} is wanted, not {type(plan).__name__}")
        return plan

    def __len__(self) -> int:
        return int(self.order.size)

    @cached_property
    def _content(self) -> tuple[type, bytes]:
        arrays: Iterator[Numbers] = (getattr(self, item.name) for item in fields(self))
        return type(self), b"".join(array.tobytes() for array in arrays)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Plan) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @cached_property
    def steps(self) -> Self:
        """The same readings at no time: one plan for all sessions of these steps."""
        unhurried = replace(self, hours=np.zeros(len(self))) if self.hours.any() else self
        steps: Self = known_plan(unhurried)
        return steps

    @cached_property
    def elapsed(self) -> Floats:
        """Time since the first reading, (n,) [h]: the clock of a table may show the time of day."""
        return read_only(self.hours - self.hours.min(initial=np.inf))

    @property
    def parts(self) -> int:
        """Number of parts, empty ones before the last included."""
        return int(self.part.max()) + 1 if len(self) else 0

    def part_words(self, part: int) -> str:
        """Such as ", part 2", where it has several."""
        return f", part {part + 1}" if self.parts > 1 else ""

    @of_steps
    def in_time(self) -> Ints:
        """Indices of the readings from first to last, shape (n,)."""
        return read_only(np.argsort(self.order, kind="stable"), np.intp)

    @property
    def fixed(self) -> bool:
        """True if all are of gauges on stands that are fixed in space; not by default."""
        return False

    @property
    def flat(self) -> bool:
        """True if they show a shape but not its reason; not by default."""
        return False

    @property
    def touches(self) -> Bools:
        """True for touches of a bed, shape (n,); none by default."""
        return np.zeros(len(self), dtype=np.bool_)

    @property
    def spots(self) -> Floats:
        """Place of the tool for each of them, (n, 3) [mm]; NaN for a gauge on a leg."""
        return np.full((len(self), 3), np.nan)

    @property
    def stood(self) -> Floats:
        """Offsets in force when each one's gauge was set up, (n, 3) [mm]; none by default."""
        return np.zeros((len(self), 3))

    @property
    def reductions(self) -> tuple[str, ...]:
        """Kinds of differences that can be made of such readings; none by default."""
        return ()

    @property
    def setups(self) -> int:
        """Number of unknown zeros that the readings share."""
        return int(self.zeros.shape[1])

    @property
    def zeros(self) -> Floats:
        """Design matrix of these zeros, shape (n, setups): 1 where a reading has that zero."""
        return np.zeros((len(self), 0))

    @property
    @abstractmethod
    def shared(self) -> Ints:
        """Number, from 0, of what creeps or is knocked with each reading, shape (n,)."""

    @of_steps
    def sequence(self) -> tuple[Ints, Bools]:
        """Indices of the readings by what they share, then in time; which come first, both (n,)."""
        rows = np.lexsort((self.order, self.shared))
        number = self.shared[rows]
        first = np.append(True, number[1:] != number[:-1])[: len(rows)]
        return read_only(rows, np.intp), read_only(first, np.bool_)

    @property
    @abstractmethod
    def cells(self) -> Ints:
        """Number of each reading's cell, shape (n,): those that are left out together."""

    @property
    @abstractmethod
    def repeats(self) -> Ints:
        """Number of the readings that each one repeats exactly, zero and all, shape (n,)."""

    @abstractmethod
    def entry(self, index: int) -> Mapping[str, object]:
        """One reading: name → value, in the unit of the name."""

    @property
    def last_travel(self) -> Ints:
        """The last readings, in time order, on the way to the next one."""
        return self.in_time[-1:]

    def subset(self, chosen: Ints | Bools) -> Self:
        """The plan of some of its readings (indices or mask)."""
        return type(self)(**{item.name: getattr(self, item.name)[chosen] for item in fields(self)})

    @staticmethod
    def joined(*plans: PlanT) -> PlanT:
        """Plans as one; set-ups and parts of the same number are the same, and so is the order."""
        names = [item.name for item in fields(plans[0])]
        every = {name: np.concatenate([getattr(plan, name) for plan in plans]) for name in names}
        return replace(plans[0], **every)

    @property
    @abstractmethod
    def returning(self) -> Floats:
        """Columns of unit size (n, q) that may return with their place though no cause has them."""

    @cached_property
    def movers(self) -> Bools:
        """Readings that a pattern in time moves by one size, in one row each, shape (g, n)."""
        return read_only(self.shared == np.unique(self.shared)[:, None], np.bool_)

    def wheres(self, ordered: bool) -> Iterator[tuple[Where, Bools]]:
        """Readings at which a pattern may act, (n,), narrow ones before those that hold them; only
        all of them unless they are `ordered` in time."""
        yield {}, np.full(len(self), True)


@functools.lru_cache(maxsize=16)
def known_plan(plan: PlanT) -> PlanT:
    """The first of equal plans, with all that was worked out of it."""
    return plan


def alike(*keys: Floats | Ints) -> tuple[Ints, Ints]:
    """Rows that agree in all keys: the first of each kind, (m,), and each row's kind, (n,)."""
    rows = np.stack(keys, axis=1)
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return read_only(first, np.intp), read_only(kind.reshape(-1), np.intp)


# --- patterns that readings may hold: they cost as much as the readings -----------------------

AT_ONCE = 1 << 18  # numbers of a pattern that are worked off at a time


@dataclass(frozen=True, eq=False)
class Patterns(ReadOnly):
    """Columns of unit size, (n, P): a reading, or all from one on that share what it does; last
    those that are written out."""

    plan: Plan
    reading: Ints  # of each of the first columns, shape (p,)
    onward: Bools  # whether the later ones belong to it, shape (p,)
    other: Floats  # shape (n, P − p)

    @classmethod
    def at(cls, plan: Plan, reading: ArrayLike, onward: ArrayLike) -> "Patterns":
        """One column for each of some readings."""
        bare = np.zeros((len(plan), 0))
        return cls(plan, np.array(reading, np.intp), np.array(onward, np.bool_), bare)

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

    def columns(self, chosen: slice | Sequence[int]) -> Floats:
        """Return some of the columns, in ascending order, written out, shape (n, q)."""
        numbers, before = np.arange(len(self))[chosen], len(self.reading)
        single = numbers[numbers < before]
        reading, onward = self.reading[single], self.onward[single]
        plan, index = self.plan, np.arange(len(self.plan))[:, None]
        later = (plan.shared[:, None] == plan.shared[reading]) & (
            plan.order[:, None] >= plan.order[reading]
        )
        first = np.where(onward, later, index == reading).astype(np.float64)
        return np.hstack((first, self.other[:, numbers[len(single) :] - before]))


def later_sums(plan: Plan, values: Floats) -> Floats:
    """Sums of columns (..., n, c) over each reading and all later ones that share what it does."""
    rows, first = plan.sequence
    to_end = np.cumsum(values[..., rows[::-1], :], axis=-2)[..., ::-1, :]
    beyond = np.zeros((*values.shape[:-2], np.count_nonzero(first), values.shape[-1]))
    beyond[..., :-1, :] = to_end[..., np.flatnonzero(first)[1:], :]
    sums = np.empty_like(to_end)
    sums[..., rows, :] = to_end - beyond[..., np.cumsum(first) - 1, :]
    return sums
