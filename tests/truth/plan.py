"""The standard double-posture session as a technician walks through it, with its own clock.

Legs x, y, z in turn; each leg iso, max, min three times and a closing iso; both directions across
the leg are read at every posture: 60 readings.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .machines import Machine

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

AXIS_NAMES = "xyz"
CYCLE = ("iso", "max", "min")
# The two gauges of each leg stand across it; a set-up is one (leg, direction).
SETUPS: tuple[tuple[int, int], ...] = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))


def frozen(values: ArrayLike, dtype: type = np.float64) -> NDArray:
    """A read-only copy."""
    out = np.array(values, dtype=dtype)
    out.setflags(write=False)
    return out


def frozen_ints(values: NDArray[np.generic] | list[int]) -> Ints:
    """A read-only integer copy."""
    return frozen(values, np.int64)


@dataclass(frozen=True, eq=False)
class Plan:
    """N readings in the order of time. Indices of axes are 0, 1, 2 = x, y, z."""

    leg: Ints
    """Leg of each reading, shape (N,)."""
    direction: Ints
    """Direction in which the gauge reads, shape (N,)."""
    posture: tuple[str, ...]
    """`iso`, `max` or `min` of the reading's own leg."""
    displacement: Floats
    """Commanded displacement of the tool along the leg's axis, shape (N,), [mm]."""
    cycle: Ints
    """Repeat of that posture, from 1, shape (N,)."""
    minutes: Floats
    """Time since the session began, as written down, shape (N,), [min]."""
    indicated: Floats
    """Indicated joint positions of the three carriages, shape (N, 3), [mm]."""
    approach: Floats
    """Sign of each carriage's last commanded motion, 0 before its first, shape (N, 3)."""
    setup: Ints
    """Index into `SETUPS` of each reading, shape (N,)."""
    stand: Ints
    """First row of each reading's gauge set-up, which began at the iso posture, shape (N,)."""
    zero: Ints
    """Number of that set-up, from 0: each has a gauge zero and a place of its own, shape (N,)."""
    gauge_at: Floats
    """Where along the leg that gauge was set up: carriage 0, tool 1, shape (N,)."""
    part: Ints
    """Sitting, from 0; all stands are set up again for each, shape (N,)."""
    turned: Ints
    """1 where the bar was turned half round its own axis, else 0, shape (N,)."""
    entered: Floats
    """Offsets entered in the controller since the first reading, shape (N, 3), [mm]."""

    @staticmethod
    def of(**columns: ArrayLike) -> "Plan":
        """Of columns by name, which need not be arrays; those that tell of a sitting may lack."""
        n = len(columns["posture"])
        usual = {"gauge_at": [0.5], "part": [0], "turned": [0], "entered": [[0.0] * 3]}
        columns = {name: one * n for name, one in usual.items()} | columns
        types = {item.name: item.type for item in fields(Plan)}
        columns = {
            name: frozen(values, np.int64 if types[name] is Ints else np.float64)
            for name, values in columns.items()
            if name != "posture"
        } | {"posture": tuple(columns["posture"])}
        return Plan(**columns)

    @property
    def count(self) -> int:
        """Number of readings N."""
        return len(self.posture)

    @property
    def hours(self) -> Floats:
        """Time since the session began, shape (N,), [h]."""
        return self.minutes / 60.0

    def rows(self, chosen: Ints) -> "Plan":
        """Some rows as a plan of their own; `stand` still counts the rows of this one."""
        arrays = {item.name: getattr(self, item.name) for item in fields(self)}
        posture = tuple(self.posture[row] for row in chosen)
        return Plan(**{k: v[chosen] for k, v in arrays.items() if k != "posture"}, posture=posture)


def joints_at(leg_length: float, leg: int, displacement: float) -> Floats:
    """Indicated joints for the tool at `displacement` [mm] along the axis of `leg`, shape (3,).

    From the right triangle over a leg that leaves its own axis: its foot stands back to
    sqrt(L^2 - d^2), while the leg along the axis is carried along.
    """
    joints = np.full(3, np.sqrt(leg_length**2 - displacement**2))
    joints[leg] = leg_length + displacement
    return joints


def _approach(leg: int, start: float, stop: float, before: Floats) -> Floats:
    """Signs of the carriages' last motions after a straight move of the tool along one axis."""
    if start == stop:
        return before
    forward = np.sign(stop - start)
    # The other feet stand highest at the isotropic posture: they rise towards it, sink away.
    signs = np.full(3, 1.0 if stop == 0.0 else -forward * np.sign(stop))
    signs[leg] = forward
    return signs


def standard_plan(
    machine: Machine,
    rng: np.random.Generator,
    cycles: int = 3,
    legs: tuple[int, ...] = (0, 1, 2),
    pace: float = 0.4,
) -> Plan:
    """Draw the clock of one standard session; `pace` is the mean time per posture [min]."""
    reach = {"iso": 0.0, "max": machine.upper, "min": machine.lower}
    postures = [*CYCLE * cycles, "iso"]
    rows = []
    last: Floats = np.zeros(3)
    minutes, place = float(rng.uniform(0.2, 1.0)), 0.0
    for nth, leg in enumerate(legs):
        if nth:
            minutes += float(rng.uniform(2.0, 5.0))
        first = len(rows)
        for step, posture in enumerate(postures):
            last = _approach(leg, place, reach[posture], last)
            place = reach[posture]
            for k, direction in enumerate(axis for axis in range(3) if axis != leg):
                rows.append({
                    "leg": leg, "direction": direction, "posture": posture, "displacement": place,
                    "cycle": step // 3 + 1, "minutes": round(minutes + 0.05 * k, 2),
                    "indicated": joints_at(machine.leg, leg, place), "approach": last,
                    "setup": SETUPS.index((leg, direction)), "stand": first + k,
                    "zero": SETUPS.index((leg, direction)),
                })  # fmt: skip
            minutes += pace * float(rng.uniform(0.75, 1.25))
    return Plan.of(**{name: [row[name] for row in rows] for name in rows[0]})
