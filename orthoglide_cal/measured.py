"""What was measured, as arrays: raw gauge readings, or the paper's differences of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from orthoglide_cal.axes import Floats, Ints, read_only
from orthoglide_cal.plan import Plan


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
        for name in ("value", "temperature"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.float64))
        for name in ("cycle", "line"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.intp))

    kind = "readings"

    def __len__(self) -> int:
        return len(self.plan)

    def subset(self, chosen: Ints) -> Readings:
        """Some of the readings (indices or mask)."""
        index = np.arange(len(self))[chosen]
        return Readings(
            plan=self.plan.subset(index),
            value=self.value[index],
            cycle=self.cycle[index],
            posture=tuple(self.posture[i] for i in index),
            temperature=self.temperature[index],
            gauge=tuple(self.gauge[i] for i in index),
            note=tuple(self.note[i] for i in index),
            line=self.line[index],
            timed=self.timed,
            source=self.source,
            remarks=self.remarks,
        )


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences of readings, as the paper prints them.

    Attributes:
        kind: "six" (max − min), "twelve" (relative to iso) or "single" (tool − joint end).
        names: e.g. ("x_y", …), ("x_y+", …) or ("z_x0", …), in the order of the file.
        value: shape (k,) [mm].
        source: where they came from.
    """

    kind: str
    names: tuple[str, ...]
    value: Floats
    source: Source
    remarks: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", read_only(self.value, np.float64))

    def __len__(self) -> int:
        return len(self.names)


Measured = Readings | Differences
