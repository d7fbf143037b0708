"""What is read: axes, postures, plans, and what was measured, as arrays.

A plan says which gauge readings are (to be) taken and holds no measured value; readings are a plan
with values; differences are combinations of readings as the paper prints them.
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


@dataclass(frozen=True, eq=False)
class Plan:
    """Readings to be taken; every array has shape (n,) and is read-only.

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
    """

    leg: Ints
    direction: Ints
    displacement: Floats
    contact: Ints
    gauge_at: Floats
    setup: Ints
    order: Ints
    hours: Floats

    def __post_init__(self) -> None:
        n = np.shape(self.leg)
        for item in fields(self):
            floating = item.name in ("displacement", "gauge_at", "hours")
            array = read_only(getattr(self, item.name), np.float64 if floating else np.intp)
            if array.shape != n or array.ndim != 1:
                raise ValueError(f"{item.name} has shape {array.shape}, leg has {n}")
            object.__setattr__(self, item.name, array)

    def __len__(self) -> int:
        return int(self.leg.size)

    @property
    def setups(self) -> int:
        """Number of gauge set-ups, each with its own unknown zero."""
        return int(self.setup.max()) + 1 if len(self) else 0

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
        """Number of each reading's (leg, direction, posture, contact) cell, shape (n,)."""
        return _alike(self.leg, self.direction, self.displacement, self.contact)[1]

    @cached_property
    def distinct(self) -> tuple[Ints, Ints]:
        """Readings equal but for set-up and time: one of each kind, (m,), each one's kind, (n,)."""
        return _alike(self.leg, self.direction, self.displacement, self.contact, self.gauge_at)

    @cached_property
    def moments(self) -> tuple[Ints, Ints]:
        """Distinct commanded postures: a reading of each, (m,), and each reading's one, (n,)."""
        return _alike(np.where(self.displacement == 0.0, 0, self.leg), self.displacement)

    def subset(self, chosen: Ints) -> Plan:
        """The plan of some of its readings (indices or mask); set-ups are renumbered."""
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
        places: where each reading's gauge stood (leg, direction, position along the leg).
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


def places_of(leg: Ints, direction: Ints, contact: Ints, gauge_at: Floats) -> list[Hashable]:
    """Where each gauge stood: (leg, direction, position along the leg).

    Both ends of a leg share a zero, so the end is no part of it.
    """
    at = np.where(contact == Contact.FIXED, gauge_at, -1.0)
    return list(zip(leg.tolist(), direction.tolist(), at.tolist(), strict=True))


def _alike(*keys: Floats | Ints) -> tuple[Ints, Ints]:
    """Rows that agree in all keys: the first of each kind, (m,), and each row's kind, (n,)."""
    rows = np.stack(keys, axis=1)
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return read_only(first, np.intp), read_only(kind.reshape(-1), np.intp)


class DataKind(StrEnum):
    """What was measured: raw readings, or one of the paper's sets of differences."""

    READINGS = "readings"
    SIX = "six"  # max − min
    TWELVE = "twelve"  # max − iso and min − iso
    SINGLE = "single"  # tool end − joint end


_SIGNS = {Posture.MAX: "+", Posture.MIN: "-", Posture.ISO: "0"}


class Difference(NamedTuple):
    """One of the paper's differences.

    Attributes:
        series: leg and direction.
        posture: of the minuend, or of both ends; None for max − min.
    """

    series: Series
    posture: Posture | None = None

    @property
    def name(self) -> str:
        """As the paper writes it, direction first, leg second: "dy_x", "dy_x+", "dz_x0"."""
        return "d" + self.series.name + (_SIGNS[self.posture] if self.posture else "")


# The order of Table 4: direction first, leg second.
_SIX = tuple(Series(leg, k) for k in range(3) for leg in range(3) if leg != k)
DIFFERENCES: Mapping[DataKind, tuple[Difference, ...]] = MappingProxyType(
    {
        DataKind.SIX: tuple(Difference(series) for series in _SIX),
        DataKind.TWELVE: tuple(
            Difference(series, posture) for series in _SIX for posture in (Posture.MAX, Posture.MIN)
        ),
        DataKind.SINGLE: tuple(
            Difference(Series(leg, 2), posture)
            for leg, posture in (
                (0, Posture.ISO),
                (1, Posture.ISO),
                (0, Posture.MAX),
                (0, Posture.MIN),
                (1, Posture.MAX),
                (1, Posture.MIN),
            )
        ),
    }
)


@dataclass(frozen=True)
class Source:
    """Where data came from.

    Attributes:
        path: as the user gave it; "-" for standard input.
        sha256: hex digest of the bytes that were read.
    """

    path: str
    sha256: str


@dataclass(frozen=True, eq=False)
class Readings:
    """Raw gauge readings, in the order of the file; arrays have shape (n,).

    Attributes:
        plan: what each reading is of.
        value: as recorded [mm].
        cycle: repeat of the same (leg, direction, posture), from 1.
        posture: "iso", "max", "min" or the displacement as text.
        temperature: [°C]; NaN where not given.
        gauge: label of the gauge; "" where not given.
        note: remark; "" where not given.
        line: line in the file, from 1.
        timed: True if the times in the plan were recorded, False if they were assumed.
        source: where the readings came from.
        remarks: what the reader wants the user to know (unknown columns, assumed times).
    """

    plan: Plan
    value: Floats
    cycle: Ints
    posture: tuple[str, ...]
    temperature: Floats
    gauge: tuple[str, ...]
    note: tuple[str, ...]
    line: Ints
    timed: bool
    source: Source
    remarks: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        freeze(self, "value", "temperature", "cycle", "line")

    kind = DataKind.READINGS

    @property
    def kinds(self) -> tuple[DataKind, ...]:
        """What can be made of them: themselves, and the differences of their protocol."""
        differences = (DataKind.SIX, DataKind.TWELVE) if self.plan.fixed else (DataKind.SINGLE,)
        return (self.kind, *differences)

    def __len__(self) -> int:
        return len(self.plan)


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences of readings, as the paper prints them.

    Attributes:
        kind: which set they belong to.
        which: the differences, in the order of the file.
        value: shape (k,) [mm].
        source: where they came from.
        remarks: what the reader wants the user to know.
    """

    kind: DataKind
    which: tuple[Difference, ...]
    value: Floats
    source: Source
    remarks: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        freeze(self, "value")

    @property
    def kinds(self) -> tuple[DataKind, ...]:
        """What can be made of them: themselves, and of twelve also six."""
        return (self.kind, DataKind.SIX) if self.kind is DataKind.TWELVE else (self.kind,)

    def __len__(self) -> int:
        return len(self.which)


Measured = Readings | Differences


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
    keys = np.stack((plan.setup, plan.displacement, plan.contact, plan.gauge_at), axis=1)
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
