"""The sequence of steps of a session: which reading comes when, and what has to be moved for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from orthoglide_cal.axes import AXES
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols import double_posture, postures, single_posture
from orthoglide_cal.protocols.postures import MINUTES_PER_POSTURE, MINUTES_PER_SETUP

PROTOCOLS = ("double-posture", "single-posture")
ORDERS = ("paper", "fewest-moves")


@dataclass(frozen=True)
class Step:
    """One reading to take.

    Attributes:
        number: from 1, in the order of the session.
        leg, direction: 0, 1, 2 for x, y, z.
        posture: "iso", "max" or "min" of the leg.
        displacement_mm: of the leg's carriage from the isotropic posture.
        contact: what the gauge touches.
        cycle: repeat of this posture, from 1.
        stand: which of the gauges read side by side takes it, from 0.
        setup: number of the gauge set-up, from 1; the stands are moved between set-ups.
    """

    number: int
    leg: int
    direction: int
    posture: str
    displacement_mm: float
    contact: Contact
    cycle: int
    stand: int
    setup: int

    @property
    def series(self) -> tuple[int, int]:
        """Leg and direction: readings of one series share the gauge's zero."""
        return self.leg, self.direction

    @property
    def cell(self) -> tuple[int, int, str, Contact]:
        """Readings of one cell repeat each other."""
        return self.leg, self.direction, self.posture, self.contact

    @property
    def visit(self) -> tuple[int, int, str, int]:
        """Readings of one visit are taken without moving the machine or a stand in between."""
        return self.setup, self.leg, self.posture, self.cycle

    @property
    def end(self) -> str:
        """The end touched: "joint" or "tool"; "" for a gauge fixed in space."""
        return {Contact.FIXED: "", Contact.JOINT: "joint", Contact.TOOL: "tool"}[self.contact]

    def joints_mm(self, machine: Machine) -> tuple[float, float, float]:
        """Indicated joint positions to drive to (sec. 2.5) [mm]."""
        length, moved = machine.leg_length_mm, self.displacement_mm
        joints = [(length**2 - moved**2) ** 0.5] * 3
        joints[self.leg] = length + moved
        return joints[0], joints[1], joints[2]


@dataclass(frozen=True)
class _Visit:
    """A reading of the protocol before it is numbered."""

    leg: int
    direction: int
    posture: str
    displacement_mm: float
    contact: Contact
    cycle: int


def sequence(
    machine: Machine, protocol: str, cycles: int, order: str = "paper", stands: int = 2
) -> tuple[Step, ...]:
    """All steps of a session.

    Args:
        machine: its joint limits are the Max and Min postures.
        protocol: one of `PROTOCOLS`.
        cycles: repeats of Iso, Max, Min on each leg; a closing Iso follows.
        order: "paper" (sec. 4.1: both readings at every posture) or "fewest-moves" (a gauge
            stays at its place on the leg for all postures).
        stands: gauges that are read side by side. The single-posture protocol uses one.
    """
    single = protocol == "single-posture"
    visits = _single_visits(machine, cycles) if single else _double_visits(machine, cycles)
    if order == "fewest-moves" and single:
        visits = _grouped(visits, lambda v: (v.leg, v.contact))
    if stands == 1 and not single:
        visits = _grouped(visits, lambda v: (v.leg, v.direction))
    numbered = []
    setup, place = 0, None
    for number, visit in enumerate(visits, start=1):
        # A single gauge is carried over to the next series; two stand there together.
        here = (visit.leg, visit.direction if stands == 1 or single else None)
        setup, place = (setup + 1, here) if here != place else (setup, place)
        stand = 0
        if not single and stands == 2:
            stand = [axis for axis in range(3) if axis != visit.leg].index(visit.direction)
        numbered.append(
            Step(
                number,
                visit.leg,
                visit.direction,
                visit.posture,
                visit.displacement_mm,
                visit.contact,
                visit.cycle,
                stand,
                setup,
            )
        )
    return tuple(numbered)


def _double_visits(machine: Machine, cycles: int) -> list[_Visit]:
    plan = double_posture(machine, cycles=cycles)
    names = {machine.displacement_mm(name): name for name in ("iso", "max", "min")}
    return _counted(
        [
            _Visit(
                int(plan.leg[i]),
                int(plan.direction[i]),
                names[float(plan.displacement[i])],
                float(plan.displacement[i]),
                Contact(int(plan.contact[i])),
                0,
            )
            for i in plan.in_time
        ]
    )


def _single_visits(machine: Machine, cycles: int) -> list[_Visit]:
    """The protocol's plan, and a closing isotropic posture on each leg as in sec. 4.1."""
    plan = single_posture(machine, cycles=cycles)
    names = {machine.displacement_mm(name): name for name in ("iso", "max", "min")}
    visits: list[_Visit] = []
    for leg in (0, 1):
        chosen = [i for i in plan.in_time if plan.leg[i] == leg]
        for i in chosen:
            moved = float(plan.displacement[i])
            end = Contact(int(plan.contact[i]))
            visits.append(_Visit(leg, int(plan.direction[i]), names[moved], moved, end, 0))
        first = visits[-len(chosen) :]
        visits.extend(replace(visit) for visit in first[:2])
    return _counted(visits)


def _counted(visits: Sequence[_Visit]) -> list[_Visit]:
    """Number the repeats of each cell, from 1."""
    seen: dict[tuple[int, int, str, Contact], int] = {}
    counted = []
    for visit in visits:
        cell = (visit.leg, visit.direction, visit.posture, visit.contact)
        seen[cell] = seen.get(cell, 0) + 1
        counted.append(replace(visit, cycle=seen[cell]))
    return counted


def _grouped(visits: Sequence[_Visit], key: Callable[[_Visit], object]) -> list[_Visit]:
    """Bring visits with one key together, in the order in which the keys first appear."""
    groups: dict[object, list[_Visit]] = {}
    for visit in visits:
        groups.setdefault(key(visit), []).append(visit)
    return [visit for group in groups.values() for visit in group]


def plan_of(steps: Sequence[Step], minutes: Sequence[float] | None = None) -> Plan:
    """The readings of these steps in this order; `minutes` since the session began (default 0)."""
    times = [0.0] * len(steps) if minutes is None else minutes
    return postures.plan_of(
        [
            postures.Step(s.leg, s.direction, s.displacement_mm, s.contact, time)
            for s, time in zip(steps, times, strict=True)
        ]
    )


def gauge_moves(steps: Sequence[Step]) -> int:
    """How often a stand has to be put to another place, the first time not counted."""
    places: dict[int, object] = {}
    moves = 0
    for step in steps:
        here = (step.leg, step.direction, step.contact)
        if step.stand in places and places[step.stand] != here:
            moves += 1
        places[step.stand] = here
    return moves


def minutes_left(steps: Sequence[Step], pace_min: float | None = None) -> float:
    """Time that these steps will take [min]; `pace_min` is the time per visit seen so far."""
    if not steps:
        return 0.0
    pairs = list(pairwise(steps))
    visits = 1 + sum(a.visit != b.visit for a, b in pairs)
    setups = sum(a.setup != b.setup for a, b in pairs)
    return visits * (MINUTES_PER_POSTURE if pace_min is None else pace_min) + (
        setups * MINUTES_PER_SETUP
    )


def step_name(step: Step) -> str:
    """The step in a few words, e.g. "leg X, MAX, cycle 2, gauge Z"."""
    end = f", {step.end} end" if step.end else ""
    return (
        f"leg {AXES[step.leg].upper()}, {step.posture.upper()}, cycle {step.cycle},"
        f" gauge {AXES[step.direction].upper()}{end}"
    )
