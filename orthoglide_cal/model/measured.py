"""Measurements as arrays: readings, or differences of readings as the paper prints them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import product
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, ReadOnly, read_only
from orthoglide_cal.model.readings import Posture, Series
from orthoglide_cal.schema import Reason


class DataKind(StrEnum):
    """Kind of a measurement: raw readings, or one of the paper's sets of differences."""

    READINGS = "readings"
    SIX = "six"  # max − min
    TWELVE = "twelve"  # max − iso and min − iso
    SINGLE = "single"  # tool end − joint end


_SIGNS = {Posture.MAX: "+", Posture.MIN: "-", Posture.ISO: "0"}


class Difference(NamedTuple):
    """One of the paper's differences."""

    series: Series
    posture: Posture | None = None  # of the minuend, or of both ends; None for max − min

    @property
    def name(self) -> str:
        """Name as the paper writes it, direction first, leg second: "dy_x", "dy_x+", "dz_x0"."""
        return "d" + self.series.name + (_SIGNS[self.posture] if self.posture else "")


_ENDS = (Posture.MAX, Posture.MIN)
# The order of Table 4: direction first, leg second.
_SIX = tuple(Series(leg, k) for k in range(3) for leg in range(3) if leg != k)
DIFFERENCES: Mapping[DataKind, tuple[Difference, ...]] = MappingProxyType(
    {
        DataKind.SIX: tuple(Difference(series) for series in _SIX),
        DataKind.TWELVE: tuple(Difference(series, posture) for series in _SIX for posture in _ENDS),
        DataKind.SINGLE: tuple(
            Difference(Series(leg, 2), posture)
            for leg, posture in (*product((0, 1), (Posture.ISO,)), *product((0, 1), _ENDS))
        ),
    }
)


@dataclass(frozen=True)
class Excerpt:
    """Part that was read of a file with several measurements."""

    data: str  # its name: "calibration" or "mesh"
    words: str  # how much of what
    firmware: str = "klipper"  # whose the file is, as an export names it
    unknown: str = ""  # why the settings in force are not known, in a sentence
    steps: str = ""  # that it was reckoned from with the settings in force, as stored


@dataclass(frozen=True)
class Source:
    """Origin of data."""

    path: str  # as the user gave it; "-" for standard input
    sha256: str  # hex digest of the bytes that were read
    excerpt: Excerpt | None = None  # what of the file was read; None for all that it holds
    earlier: tuple[str, ...] = ()  # other files that were read together with it, oldest first
    simulated: bool = False  # a simulator made some of it, or all


@dataclass(frozen=True, eq=False)
class Readings(ReadOnly):
    """Raw gauge readings, in the order of the file; arrays have shape (n,)."""

    plan: Plan  # what each reading is of, in the form of the kind of machine
    value: Floats  # as recorded [mm]
    line: Ints  # in the file, from 1
    timed: bool  # the times in the plan were recorded, not assumed
    source: Source
    # Repeat of the same (leg, direction, posture), from 1.
    cycle: Ints = field(default_factory=lambda: read_only((), np.intp))
    posture: tuple[str, ...] = ()  # "iso", "max", "min" or the displacement as text; "" for none
    temperature: Floats = field(default_factory=lambda: read_only(()))  # °C; NaN where not given
    gauge: tuple[str, ...] = ()  # its label; "" where not given
    note: tuple[str, ...] = ()  # remark; "" where not given
    timestamp: tuple[str, ...] = ()  # ISO 8601; "" where not given
    remarks: tuple[Reason, ...] = ()  # on the file: unknown columns, assumed times

    kind = DataKind.READINGS

    def __post_init__(self) -> None:
        """Fill in what is not given."""
        n = len(self)
        nothing = {
            "cycle": np.ones(n, dtype=np.intp),
            "temperature": np.full(n, np.nan),
            **dict.fromkeys(("posture", "gauge", "note", "timestamp"), ("",) * n),
        }
        for name, values in nothing.items():
            if not len(getattr(self, name)):
                object.__setattr__(self, name, values)
        super().__post_init__()

    @property
    def kinds(self) -> tuple[DataKind, ...]:
        """Themselves, and the differences of their protocol."""
        return (self.kind, *map(DataKind, self.plan.reductions))

    @property
    def weight(self) -> Floats:
        """Weight of an error of each in a root mean square, shape (n,)."""
        return self.plan.precision

    def __len__(self) -> int:
        return len(self.plan)

    def subset(self, chosen: Bools) -> Self:
        """The plan and values of some of them."""
        plan, value, line = self.plan.subset(chosen), self.value[chosen], self.line[chosen]
        return type(self)(plan, value, line, self.timed, self.source)


@dataclass(frozen=True, eq=False)
class Differences(ReadOnly):
    """Differences of readings, as the paper prints them."""

    kind: DataKind
    which: tuple[Difference, ...]  # in the order of the file
    value: Floats  # shape (k,) [mm]
    source: Source
    remarks: tuple[Reason, ...] = ()

    @property
    def kinds(self) -> tuple[DataKind, ...]:
        return (self.kind, DataKind.SIX) if self.kind is DataKind.TWELVE else (self.kind,)

    @property
    def weight(self) -> Floats:
        return np.ones(len(self))

    def __len__(self) -> int:
        return len(self.which)


Measured = Readings | Differences
# Codes of remarks that are cautions, and no notes.
CAUTIONS = ("stale_mesh", "unused_data", "beyond_range", "dropped")
# Those on where entering the result lets the nozzle go.
NOZZLE = ("nozzle_raised", "nozzle_lowered")


def notes_on(measured: Measured) -> tuple[Reason, ...]:
    """The remarks on a file, cautions left out."""
    return tuple(remark for remark in measured.remarks if remark.code not in CAUTIONS)


def weighing(measured: Measured) -> str:
    """Words behind "r.m.s."; empty where all readings count alike."""
    return " (a distance counts by its precision)" if np.any(measured.weight != 1.0) else ""
