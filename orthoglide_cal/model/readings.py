"""Readings of gauges on the legs: axes, postures, and the plan of such readings."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import cached_property
from itertools import count
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, Where, alike, of_steps, read_only

AXES = ("x", "y", "z")
MOST = 64  # limit of effort: where there are more postures, or cells, no pattern is of one of them


class Series(NamedTuple):
    """Readings of one leg in one direction, both 0, 1, 2 for x, y, z."""

    leg: int
    direction: int

    @property
    def name(self) -> str:
        """Name as the paper writes it, direction first, leg second: "y_x"."""
        return f"{AXES[self.direction]}_{AXES[self.leg]}"

    @property
    def words(self) -> str:
        """For people: "leg x, direction y"."""
        return f"leg {AXES[self.leg]}, direction {AXES[self.direction]}"


def other_axes(leg: int) -> tuple[int, int]:
    """The two directions in which the deviation of a leg can be read, in the paper's order."""
    return ((1, 2), (0, 2), (0, 1))[leg]


class Posture(StrEnum):
    """Place of the carriage of the leg: at its isotropic place or at an end of its travel."""

    ISO = "iso"
    MAX = "max"
    MIN = "min"


class Contact(IntEnum):
    """Place where a gauge touches the leg."""

    FIXED = 0  # stand fixed in space, the leg moves under it (double-posture protocol)
    JOINT = 1  # at the carriage joint of the leg (single-posture protocol)
    TOOL = 2  # at the tool centre point end of the leg (single-posture protocol)

    @cached_property
    def end(self) -> str | None:
        """The end of the leg that is touched: "joint" or "tool"; None for a fixed stand."""
        return None if self is Contact.FIXED else self.name.lower()


@dataclass(frozen=True, eq=False, kw_only=True)
class GaugePlan(Plan):
    """Readings of gauges that touch the legs; arrays have shape (n,), entered (n, 3)."""

    leg: Ints  # 0, 1, 2 for the x-, y-, z-leg, whose carriage is displaced
    direction: Ints  # 0, 1, 2: the axis along which the gauge measures
    displacement: Floats  # of the leg's own carriage from the isotropic posture [mm]
    contact: Ints  # values of `Contact`
    # Along the leg at the isotropic posture, from the carriage joint (0) to the tool (1).
    gauge_at: Floats
    setup: Ints  # 0 … k−1; readings of one set-up share one unknown gauge zero
    # Bars that were turned half round their own axis.
    turned: Bools = field(default_factory=lambda: read_only(False, np.bool_))
    # In the controller since the first reading [mm]: the offsets then are Δρ − entered.
    entered: Floats = field(default_factory=lambda: read_only(np.zeros(3)))

    rows = MappingProxyType({"entered": 3})

    @property
    def shared(self) -> Ints:
        return self.setup

    @cached_property
    def standing(self) -> Bools:
        """Readings by gauges on stands that were not moved since: of the leg read last, (n,)."""
        last = self.in_time[-1:]
        here = (self.leg == self.leg[last]) & (self.part == self.part[last])
        return read_only(here & (self.contact == Contact.FIXED), np.bool_)

    @of_steps
    def stood(self) -> Floats:
        """Offsets in force at the first reading of each set-up, shape (n, 3) [mm]: a stand does not
        follow what is entered later."""
        numbers, first = np.unique(self.setup[self.in_time], return_index=True)
        stood = self.entered[self.in_time[first]]
        return read_only(stood[np.searchsorted(numbers, self.setup)])

    @of_steps
    def zeros(self) -> Floats:
        setups = np.arange(self.setup.max(initial=-1) + 1)
        return read_only(self.setup[:, None] == setups, np.float64)

    @of_steps
    def cells(self) -> Ints:
        return alike(self.leg, self.direction, self.displacement, self.contact, *self.state)[1]

    @of_steps
    def moments(self) -> tuple[Ints, Ints]:
        """Distinct true postures: a reading of each, (m,), and each reading's one, (n,)."""
        leg = np.where(self.displacement == 0.0, 0, self.leg)
        return alike(leg, self.displacement, *_columns(self.entered))

    @of_steps
    def set_up_moments(self) -> tuple[Floats, Ints]:
        """Distinct `stood`, (s, 3) [mm], and each reading's one, (n,)."""
        stood, which = np.unique(self.stood, axis=0, return_inverse=True)
        return read_only(stood), read_only(which.reshape(-1), np.intp)

    @cached_property
    def state(self) -> tuple[Floats, ...]:
        """Further keys in which repeats must agree, each (n,); () where all do."""
        return (*_columns(self.turned[:, None]), *_columns(self.entered))

    @of_steps
    def cycles(self) -> Ints:
        """Repeats counted in time within each part and cell, from 1, shape (n,)."""
        kind = alike(self.part, self.cells)[1]
        rows = np.lexsort((self.order, kind))
        cycles = np.empty_like(rows)
        cycles[rows] = 1 + np.arange(len(self)) - np.searchsorted(kind[rows], kind[rows])
        return read_only(cycles, np.intp)

    @of_steps
    def repeats(self) -> Ints:
        where = (self.leg, self.direction, self.displacement, self.contact, self.gauge_at)
        return alike(self.setup, *where, *self.state)[1]

    def subset(self, chosen: Ints | Bools) -> Self:
        """Subset as of any plan; set-ups are renumbered."""
        part = super().subset(chosen)
        return replace(part, setup=np.unique(part.setup, return_inverse=True)[1])

    def entry(self, index: int) -> Mapping[str, object]:
        return {
            "leg": AXES[self.leg[index]],
            "direction": AXES[self.direction[index]],
            "end": Contact(self.contact[index]).end,
            "displacement_mm": float(self.displacement[index]),
            "gauge_at": float(self.gauge_at[index]),
            "part": int(self.part[index]) + 1,
        }

    @property
    def last_travel(self) -> Ints:
        """Back to one of another posture."""
        rows = self.in_time
        moved = np.flatnonzero(np.diff(self.displacement[rows]))
        return rows[moved[-1] :] if moved.size else rows[-1:]

    @property
    def returning(self) -> Floats:
        """Each cell by itself; none if there are too many."""
        cells = np.unique(self.cells)
        return np.asarray(self.cells[:, None] == cells[: len(cells) * (len(cells) <= MOST)], float)

    def wheres(self, ordered: bool) -> Iterator[tuple[Where, Bools]]:
        """A gauge, a leg, a direction, a posture."""
        columns = {"leg": self.leg, "direction": self.direction, "posture": self.displacement}
        for names in (("leg", "direction"), ("leg",), ("direction",), ("posture",)) * ordered:
            kinds, kind_of = np.unique([columns[n] for n in names], axis=1, return_inverse=True)
            for number, kind in enumerate(kinds.T.tolist() if kinds.shape[1] <= MOST else ()):
                pairs = zip(names, kind, strict=True)
                where = {n: f"{v:g}" if n == "posture" else AXES[int(v)] for n, v in pairs}
                yield where, kind_of.reshape(-1) == number
        yield from super().wheres(ordered)

    @cached_property
    def series(self) -> tuple[Series, ...]:
        """The (leg, direction) of each reading."""
        pairs = zip(self.leg.tolist(), self.direction.tolist(), strict=True)
        return tuple(Series(leg, direction) for leg, direction in pairs)

    def of(self, series: Series) -> np.ndarray:
        """Mask of the readings of one leg and direction, shape (n,)."""
        return np.asarray((self.leg == series.leg) & (self.direction == series.direction))

    @property
    def reductions(self) -> tuple[str, ...]:
        return ("six", "twelve") if self.fixed else ("single",)

    @cached_property
    def fixed(self) -> bool:
        return bool(np.all(self.contact == Contact.FIXED))


def number_setups(
    places: Sequence[Hashable], gauges: Sequence[str], in_time: Sequence[int], *, ordered: bool
) -> Ints:
    """Number the gauge set-ups, 0 … k−1 by first use, shape (n,): one unknown zero each.

    A gauge that stays in its place keeps its zero; one known by its label that was used elsewhere
    in between, where the order in time is stated, was set up again.

    Args:
        places: where each reading's gauge stood, as in `PlannedReading.place`.
        gauges: labels; "" where unknown.
        in_time: indices of the readings from first to last.
        ordered: the order in time is stated, not assumed from the order of the rows.
    """
    setup = np.zeros(len(places), dtype=np.intp)
    known: dict[Hashable, int] = {}
    last: dict[str, Hashable] = {}
    number = count()
    for index in in_time:
        place, gauge = places[index], gauges[index]
        key = place, gauge
        returned = ordered and gauge and last.get(gauge, place) != place
        if returned or key not in known:
            known[key] = next(number)
        last[gauge] = place
        setup[index] = known[key]
    return setup


def _columns(state: Floats | Bools) -> tuple[Floats, ...]:
    """The columns of (n, k), none of them if they are all zero."""
    return tuple(state.T.astype(np.float64)) if state.any() else ()
