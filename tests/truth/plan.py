"""The standard double-posture session as a technician walks through it, with its own clock.

Legs x, y, z in turn; each leg iso, max, min three times and a closing iso; both directions across
the leg are read at every posture: 60 readings.
"""

from collections import Counter
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


@dataclass(frozen=True, eq=False)
class Plan:
    """N readings in the order of time, arrays of shape (N,) unless stated; axes are 0, 1, 2."""

    leg: Ints  # leg of each reading
    direction: Ints  # direction in which the gauge reads
    posture: tuple[str, ...]  # `iso`, `max` or `min` of the reading's own leg
    displacement: Floats  # commanded displacement of the tool along the leg's axis, [mm]
    cycle: Ints  # repeat of that posture, from 1
    minutes: Floats  # time since the session began, as written down, [min]
    indicated: Floats  # indicated joint positions of the three carriages, shape (N, 3), [mm]
    approach: Floats
    """Sign of each carriage's last commanded motion, 0 before its first, shape (N, 3)."""
    setup: Ints  # index into `SETUPS` of each reading
    stand: Ints  # first row of each reading's gauge set-up, which began at the iso posture
    zero: Ints  # number of that set-up, from 0: each has a gauge zero and a place of its own
    gauge_at: Floats  # where along the leg that gauge was set up: carriage 0, tool 1
    part: Ints  # sitting, from 0; all stands are set up again for each
    turned: Ints  # 1 where the bar was turned half round its own axis, else 0
    entered: Floats  # offsets entered in the controller since the first reading, shape (N, 3), [mm]

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


def plan_of(machine: Machine, **given: ArrayLike) -> Plan:
    """The plan of readings in the order of time, all in one history of the carriages.

    Args:
        given: `leg`, `direction`, `displacement` and `minutes`, and what tells of a sitting.
    """
    n = len(given["leg"])
    usual = {"gauge_at": [0.5] * n, "part": [0] * n, "turned": [0] * n, "entered": [[0.0] * 3] * n}
    types = {item.name: item.type for item in fields(Plan)}
    columns = {
        name: frozen(values, np.int64 if types[name] is Ints else np.float64)
        for name, values in (usual | given).items()
    }
    legs, part, gauge_at, moved = (
        columns[name].tolist() for name in ("leg", "part", "gauge_at", "displacement")
    )
    indicated = frozen([joints_at(machine.leg, *row) for row in zip(legs, moved, strict=True)])
    # Sign of each carriage's last motion by its own scale.
    approach = [np.zeros(3)]
    for move in np.diff(indicated - columns["entered"], axis=0):
        approach.append(np.where(move == 0.0, approach[-1], np.sign(move)))
    names_of = {0.0: "iso", machine.upper: "max", machine.lower: "min"}
    posture = tuple(names_of.get(one, f"{one:g}") for one in moved)
    pairs = list(zip(legs, columns["direction"].tolist(), strict=True))
    stands = list(zip(part, pairs, gauge_at, strict=True))
    number = {key: k for k, key in enumerate(dict.fromkeys(stands))}
    seen: Counter[object] = Counter()
    cycle = []
    for key in zip(part, pairs, posture, strict=True):
        seen[key] += 1
        cycle.append(seen[key])
    counted = {
        "cycle": cycle,
        "setup": [SETUPS.index(pair) for pair in pairs],
        "zero": [number[key] for key in stands],
        "stand": [stands.index(key) for key in stands],
    }
    columns |= {name: frozen(values, np.int64) for name, values in counted.items()}
    return Plan(**columns, posture=posture, indicated=indicated, approach=frozen(approach))


def standard_plan(
    machine: Machine, rng: np.random.Generator, cycles: int = 3, pace: float = 0.4
) -> Plan:
    """Draw the clock of one standard session; `pace` is the mean time per posture [min]."""
    reach = {"iso": 0.0, "max": machine.upper, "min": machine.lower}
    rows = []
    minutes = float(rng.uniform(0.2, 1.0))
    for leg in range(3):
        if leg:
            minutes += float(rng.uniform(2.0, 5.0))
        for posture in (*CYCLE * cycles, "iso"):
            for k, direction in enumerate(axis for axis in range(3) if axis != leg):
                rows.append((leg, direction, reach[posture], round(minutes + 0.05 * k, 2)))
            minutes += pace * float(rng.uniform(0.75, 1.25))
    names = "leg", "direction", "displacement", "minutes"
    return plan_of(machine, **dict(zip(names, zip(*rows, strict=True), strict=True)))
