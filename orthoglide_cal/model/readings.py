"""What is read: axes, postures and plans, as arrays.

A plan says which gauge readings are (to be) taken and holds no measured value.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum, StrEnum
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

AXES = ("x", "y", "z")
MM_PER_INCH = 25.4

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
# Real in use; complex only while a derivative is taken by a complex step.
Numbers = NDArray[Any]


class Series(NamedTuple):
    """Readings of one leg in one direction, both 0, 1, 2 for x, y, z."""

    leg: int
    direction: int

    @property
    def name(self) -> str:
        """As the paper writes it, direction first, leg second: "y_x"."""
        return f"{AXES[self.direction]}_{AXES[self.leg]}"

    @property
    def words(self) -> str:
        """For people: "leg x, direction y"."""
        return f"leg {AXES[self.leg]}, direction {AXES[self.direction]}"


def other_axes(leg: int) -> tuple[int, int]:
    """The two directions in which the deviation of a leg can be read, in the paper's order."""
    first, second = (k for k in range(3) if k != leg)
    return first, second


def read_only(values: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """A private copy of `values` that nobody can write to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def freeze(value: object, *names: str) -> None:
    """Replace arrays of a frozen dataclass by read-only copies; for its `__post_init__`."""
    for name in names:
        given = getattr(value, name)
        if given is not None:
            object.__setattr__(value, name, read_only(given, np.asarray(given).dtype))


class Posture(StrEnum):
    """Where the carriage of the leg stands: at its isotropic place or at an end of its travel."""

    ISO = "iso"
    MAX = "max"
    MIN = "min"


class Contact(IntEnum):
    """Where a gauge touches the leg."""

    FIXED = 0  # stand fixed in space, the leg moves under it (double-posture protocol)
    JOINT = 1  # at the carriage joint of the leg (single-posture protocol)
    TOOL = 2  # at the tool centre point end of the leg (single-posture protocol)

    @cached_property
    def end(self) -> str | None:
        """The end of the leg that is touched: "joint" or "tool"; None for a fixed stand."""
        return None if self is Contact.FIXED else self.name.lower()


# Of the arrays of a plan; all others hold whole numbers.
_DTYPES: Mapping[str, Any] = MappingProxyType(
    dict.fromkeys(("displacement", "gauge_at", "hours", "entered"), np.float64)
    | {"turned": np.bool_}
)
_ONCE_FOR_ALL = ("part", "turned", "entered")


@dataclass(frozen=True, eq=False)
class Plan:
    """Readings to be taken; every array is read-only and, if not said otherwise, of shape (n,).

    Attributes:
        leg: 0, 1, 2 for the x-, y-, z-leg, whose carriage is displaced.
        direction: 0, 1, 2: the axis along which the gauge measures.
        displacement: of the leg's own carriage from the isotropic posture [mm].
        contact: values of `Contact`.
        gauge_at: where along the leg the gauge stood at the isotropic posture, from the
            carriage joint (0) to the tool centre point (1).
        setup: 0 … k−1; readings of one set-up share one unknown gauge zero.
        order: rank in time; equal only for readings that are never compared in time.
        hours: since the session began [h].
        part: 0 …; readings of one sitting: between parts the stands are set up, and the gauges
            told apart, anew. A fault of the measurement is one of a part.
        turned: the touched bar was turned half round its own axis.
        entered: what was entered in the controller since the first reading: the offsets then are
            Δρ − entered; shape (n, 3) [mm].

    The last three may be given once for all readings.
    """

    leg: Ints
    direction: Ints
    displacement: Floats
    contact: Ints
    gauge_at: Floats
    setup: Ints
    order: Ints
    hours: Floats
    part: Ints = field(default_factory=lambda: read_only(0, np.intp))
    turned: Bools = field(default_factory=lambda: read_only(False, np.bool_))
    entered: Floats = field(default_factory=lambda: read_only(np.zeros(3)))

    def __post_init__(self) -> None:
        n = np.shape(self.leg)
        for item in fields(self):
            array = np.asarray(getattr(self, item.name), _DTYPES.get(item.name, np.intp))
            shape = (*n, 3) if item.name == "entered" else n
            if item.name in _ONCE_FOR_ALL and array.ndim < len(shape):
                array = np.broadcast_to(array, shape)
            if array.shape != shape or len(n) != 1:
                raise ValueError(f"{item.name} has shape {array.shape}, leg has {n}")
            object.__setattr__(self, item.name, read_only(array, array.dtype))

    def __len__(self) -> int:
        return int(self.leg.size)

    @property
    def setups(self) -> int:
        """Number of gauge set-ups, each with its own unknown zero."""
        return int(self.setup.max()) + 1 if len(self) else 0

    @cached_property
    def parts(self) -> int:
        """Number of parts, empty ones before the last included."""
        return int(self.part.max()) + 1 if len(self) else 0

    @cached_property
    def stood(self) -> Floats:
        """What was entered when each reading's gauge was set up, shape (n, 3) [mm].

        That is when the first reading of its set-up was taken: a stand does not follow a leg that
        is moved by what is entered later.
        """
        if not self.entered.any():
            return self.entered
        _, first, setup = np.unique(
            self.setup[self.in_time], return_index=True, return_inverse=True
        )
        stood = np.empty_like(self.entered)
        stood[self.in_time] = self.entered[self.in_time][first][setup.reshape(-1)]
        return read_only(stood)

    @cached_property
    def in_time(self) -> Ints:
        """Indices of the readings from first to last, shape (n,)."""
        return read_only(np.argsort(self.order, kind="stable"), np.intp)

    @cached_property
    def zeros(self) -> Floats:
        """Design matrix of the gauge zeros, shape (n, setups): 1 where a reading has that zero."""
        return read_only(self.setup[:, None] == np.arange(self.setups), np.float64)

    @cached_property
    def cells(self) -> Ints:
        """Number of each reading's cell, shape (n,): leg, direction, posture, contact, state."""
        return _alike(self.leg, self.direction, self.displacement, self.contact, *self.state)[1]

    @cached_property
    def distinct(self) -> tuple[Ints, Ints]:
        """Readings equal but for set-up and time: one of each kind, (m,), each one's kind, (n,)."""
        if np.any(self.entered != self.stood):
            # Where something was entered within a set-up, what a gauge shows depends on when that
            # began: each reading is its own kind.
            alone = read_only(np.arange(len(self)), np.intp)
            return alone, alone
        where = (self.leg, self.direction, self.displacement, self.contact, self.gauge_at)
        return _alike(*where, *self.state)

    @cached_property
    def moments(self) -> tuple[Ints, Ints]:
        """Distinct true postures: a reading of each, (m,), and each reading's one, (n,)."""
        leg = np.where(self.displacement == 0.0, 0, self.leg)
        return _alike(leg, self.displacement, *_columns(self.entered))

    @property
    def as_found(self) -> Bools:
        """Readings with nothing entered, then and when their gauge was set up, shape (n,)."""
        return np.asarray(~np.any(self.entered != 0.0, axis=1) & ~np.any(self.stood != 0.0, axis=1))

    @cached_property
    def set_up_moments(self) -> tuple[Floats, Ints]:
        """Distinct `stood`, (s, 3) [mm], and each reading's one, (n,)."""
        if not self.stood.any():
            return self.stood[:1], np.zeros(len(self), dtype=np.intp)
        stood, which = np.unique(self.stood, axis=0, return_inverse=True)
        return read_only(stood), read_only(which.reshape(-1), np.intp)

    @cached_property
    def state(self) -> tuple[Floats, ...]:
        """What else readings must agree in to repeat each other, each (n,); () where all do."""
        return (*_columns(self.turned[:, None]), *_columns(self.entered))

    def subset(self, chosen: Ints) -> Plan:
        """The plan of some of its readings (indices or mask); set-ups are renumbered.

        The first chosen reading of a set-up is then the one at which it began.
        """
        parts = {item.name: getattr(self, item.name)[chosen] for item in fields(self)}
        parts["setup"] = np.unique(parts["setup"], return_inverse=True)[1]
        return Plan(**parts)

    @cached_property
    def series(self) -> tuple[Series, ...]:
        """The (leg, direction) of each reading."""
        pairs = zip(self.leg.tolist(), self.direction.tolist(), strict=True)
        return tuple(Series(leg, direction) for leg, direction in pairs)

    def of(self, series: Series) -> np.ndarray:
        """Mask of the readings of one leg and direction, shape (n,)."""
        return np.asarray((self.leg == series.leg) & (self.direction == series.direction))

    @cached_property
    def fixed(self) -> bool:
        """True if all gauges stand on fixed stands, as in the double-posture protocol."""
        return bool(np.all(self.contact == Contact.FIXED))


def number_setups(
    places: Sequence[Hashable], gauges: Sequence[str], in_time: Sequence[int], *, ordered: bool
) -> Ints:
    """Number the gauge set-ups, 0 … k−1 by first use, shape (n,): one unknown zero each.

    A gauge that stays in its place keeps its zero. A gauge known by its label that was used
    elsewhere and comes back has been set up anew: its zero is another one. That can only be said
    where the file states the order in time.

    Args:
        places: where each reading's gauge stood, as in `places_of`.
        gauges: labels; "" where unknown.
        in_time: indices of the readings from first to last.
        ordered: the order in time is stated, not assumed from the order of the rows.
    """
    setup = np.zeros(len(places), dtype=np.intp)
    known: dict[Hashable, int] = {}
    last: dict[str, Hashable] = {}
    count = 0
    for index in in_time:
        place, gauge = places[index], gauges[index]
        key = (place, gauge)
        returned = ordered and gauge and last.get(gauge, place) != place
        if returned or key not in known:
            known[key] = count
            count += 1
        last[gauge] = place
        setup[index] = known[key]
    return setup


def places_of(
    leg: Ints, direction: Ints, contact: Ints, gauge_at: Floats, part: Ints, turned: Bools
) -> list[tuple[float, ...]]:
    """Where each gauge stood: (part, leg, direction, position along the leg, bar turned).

    Both ends of a leg share a zero, so the end is no part of it. No plunger stays where it was
    while its bar is turned.
    """
    at = np.where(contact == Contact.FIXED, gauge_at, -1.0)
    columns = (part.tolist(), leg.tolist(), direction.tolist(), at.tolist(), turned.tolist())
    return list(zip(*columns, strict=True))


def _columns(state: Floats | Bools) -> tuple[Floats, ...]:
    """The columns of (n, k), none of them if they are all zero."""
    return tuple(state.T.astype(np.float64)) if state.any() else ()


def _alike(*keys: Floats | Ints) -> tuple[Ints, Ints]:
    """Rows that agree in all keys: the first of each kind, (m,), and each row's kind, (n,)."""
    rows = np.stack(keys, axis=1)
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return read_only(first, np.intp), read_only(kind.reshape(-1), np.intp)


def zero_free(plan: Plan) -> Floats:
    """Orthonormal contrasts that no gauge zero enters, shape (n − setups, n).

    Least squares on the contrasts is generalised least squares on the readings with one
    unknown zero per set-up.
    """
    q, _ = np.linalg.qr(plan.zeros, mode="complete")
    return np.ascontiguousarray(q[:, plan.setups :].T)


def cell_contrasts(plan: Plan) -> Floats:
    """`zero_free` for readings that repeat each other exactly: orthonormal contrasts of cells.

    A cell holds the repeats of one posture in one gauge set-up. Where the model says the same of
    all of them, only their mean matters: least squares on the weighted means, with the zeros
    removed, is least squares on all readings, with m cells instead of n readings.

    Returns:
        Shape (m − setups, n).
    """
    where = (plan.setup, plan.displacement, plan.contact, plan.gauge_at)
    keys = np.stack((*where, *plan.state), axis=1)
    cells, cell, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    weight = np.sqrt(count)
    zeros = weight[:, None] * (cells[:, :1] == np.arange(plan.setups))
    q, _ = np.linalg.qr(zeros, mode="complete")
    return np.ascontiguousarray((q[:, plan.setups :].T / weight)[:, cell.reshape(-1)])


def without_zeros(plan: Plan, values: Floats) -> Floats:
    """Values (..., n) less the mean of their gauge set-up: what no gauge zero can explain."""
    count = np.bincount(plan.setup, minlength=plan.setups)
    means = values @ (plan.zeros / count)
    return np.asarray(values - means[..., plan.setup])
