"""A plan: which gauge readings are (to be) taken, as arrays with one entry per reading.

A plan holds no measured value; the simulation predicts one reading for each of its entries.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Ints, read_only


class Contact(IntEnum):
    """Where a gauge touches the leg."""

    FIXED = 0  # stand fixed in space, the leg moves under it (double-posture protocol)
    JOINT = 1  # at the carriage joint of the leg (single-posture protocol)
    TOOL = 2  # at the tool centre point end of the leg (single-posture protocol)


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

    def series(self) -> Ints:
        """Number of each reading's (leg, direction), 3·leg + direction, shape (n,)."""
        return 3 * self.leg + self.direction

    def series_name(self, index: int) -> str:
        """Name of reading `index`'s series as the paper writes it, e.g. "y_x": direction_leg."""
        return f"{AXES[self.direction[index]]}_{AXES[self.leg[index]]}"


def _alike(*keys: Floats | Ints) -> tuple[Ints, Ints]:
    """Rows that agree in all keys: the first of each kind, (m,), and each row's kind, (n,)."""
    rows = np.stack(keys, axis=1)
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return read_only(first, np.intp), read_only(kind.reshape(-1), np.intp)
