"""The steps of a session: which reading comes when, and what has to be moved for it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise

from orthoglide_cal.model import (
    AXES,
    Contact,
    Ints,
    Machine,
    Posture,
    Series,
    double_posture,
    single_posture,
)
from orthoglide_cal.model.kinds import MINUTES_PER_POSTURE, MINUTES_PER_SETUP, PlannedReading


class MeasuringProtocol(StrEnum):
    """How the readings are taken (sec. 3.3 and 3.2)."""

    DOUBLE = "double-posture"
    SINGLE = "single-posture"


class Order(StrEnum):
    """Order of the steps."""

    PAPER = "paper"  # sec. 4.1: all readings of a posture, then the next posture
    FEWEST_MOVES = "fewest-moves"  # a gauge stays at its place on the leg for all postures


@dataclass(frozen=True)
class SessionStep:
    """One reading to take; leg and direction are 0, 1, 2 for x, y, z."""

    number: int  # from 1, in the order of the session
    leg: int
    direction: int
    posture: Posture
    displacement_mm: float  # of the leg's carriage from the isotropic posture
    contact: Contact
    cycle: int  # repeat of this posture, from 1
    stand: int  # which of the gauges read side by side takes it, from 0
    setup: int  # number of the gauge set-up, from 1; the stands are moved between set-ups

    @cached_property
    def series(self) -> Series:
        """Leg and direction: readings of one series share the gauge's zero."""
        return Series(self.leg, self.direction)

    @property
    def planned(self) -> PlannedReading:
        """The reading as part of a plan, at no time at all."""
        return PlannedReading(*self.series, self.displacement_mm, self.contact)

    @cached_property
    def cell(self) -> tuple[int, int, Posture, Contact]:
        """Readings of one cell repeat each other."""
        return self.leg, self.direction, self.posture, self.contact

    @property
    def visit(self) -> tuple[int, int, Posture, int]:
        """Readings of one visit are taken without moving the machine or a stand in between."""
        return self.setup, self.leg, self.posture, self.cycle

    @property
    def end(self) -> str | None:
        """The end of the leg that is touched; None for a gauge fixed in space."""
        return self.contact.end


def sequence(
    machine: Machine, protocol: MeasuringProtocol, cycles: int, order: Order, stands: int
) -> tuple[SessionStep, ...]:
    """All steps of a session.

    Args:
        machine: its joint limits are the Max and Min postures.
        protocol, order: which readings, and in which order.
        cycles: repeats of Iso, Max, Min on each leg; a closing Iso follows.
        stands: gauges that are read side by side. The single-posture protocol uses one.
    """
    single = protocol is MeasuringProtocol.SINGLE
    alone = single or stands == 1
    plan = single_posture(machine, cycles) if single else double_posture(machine, cycles)
    rows = plan.in_time.tolist()
    if single:  # with a closing isotropic posture on each leg, as in sec. 4.1
        legs = ([i for i in rows if plan.leg[i] == leg] for leg in (0, 1))
        rows = [i for mine in legs for i in (*mine, *mine[:2])]
    if single and order is Order.FEWEST_MOVES:
        rows = _grouped(rows, plan.leg, plan.contact)
    elif alone and not single:
        rows = _grouped(rows, plan.leg, plan.direction)
    postures = {machine.displacement_mm(posture): posture for posture in Posture}
    steps: list[SessionStep] = []
    seen: Counter[object] = Counter()
    setup, place = 0, None
    for number, i in enumerate(rows, start=1):
        leg, direction = int(plan.leg[i]), int(plan.direction[i])
        moved, contact = float(plan.displacement[i]), Contact(plan.contact[i])
        posture = postures[moved]
        seen[leg, direction, posture, contact] += 1
        cycle = seen[leg, direction, posture, contact]
        # A single gauge is carried over to the next series; two stand there together.
        here = (leg, direction if alone else None)
        setup, place = (setup, place) if here == place else (setup + 1, here)
        stand = 0 if alone else int(direction > min({0, 1, 2} - {leg}))
        step = SessionStep(number, leg, direction, posture, moved, contact, cycle, stand, setup)
        steps.append(step)
    return tuple(steps)


def _grouped(rows: Sequence[int], *keys: Ints) -> list[int]:
    """Bring rows with equal keys together, in the order in which the keys first appear."""
    first: dict[object, int] = {}
    return sorted(rows, key=lambda i: first.setdefault(tuple(key[i] for key in keys), len(first)))


def with_set_ups(
    chosen: Sequence[SessionStep],
    here: int,
    steps: Sequence[SessionStep],
    accepted: Collection[int],
) -> list[SessionStep]:
    """Steps, with all that must be read again with them while the stands are in set-up `here`.

    For other set-ups the stands are moved: the zeros are then new ones, also those of the set-up
    in hand, to which they come back. `accepted` are the numbers of the steps that were read.
    """
    numbers, setups = {step.number for step in chosen}, {step.setup for step in chosen}
    moved = set() if setups <= {here} else setups | {here}
    return [
        step
        for step in steps
        if step.number in numbers or (step.setup in moved and step.number in accepted)
    ]


def gauge_moves(steps: Sequence[SessionStep]) -> int:
    """How often a stand has to be put to another place, the first time not counted."""
    places: dict[int, object] = {}
    moves = 0
    for step in steps:
        here = (*step.series, step.contact)
        moves += places.get(step.stand, here) != here
        places[step.stand] = here
    return moves


def minutes_left(steps: Sequence[SessionStep], pace_min: float | None = None) -> float:
    """Time that these steps will take [min]; `pace_min` is the time per visit seen so far."""
    if not steps:
        return 0.0
    visits = 1 + sum(a.visit != b.visit for a, b in pairwise(steps))
    setups = sum(a.setup != b.setup for a, b in pairwise(steps))
    pace = MINUTES_PER_POSTURE if pace_min is None else pace_min
    return visits * pace + setups * MINUTES_PER_SETUP


def step_name(step: SessionStep) -> str:
    """The step in a few words, e.g. "leg X, MAX, cycle 2, gauge Z"."""
    end = f", {step.end} end" if step.end else ""
    return (
        f"leg {AXES[step.leg].upper()}, {step.posture.upper()}, cycle {step.cycle},"
        f" gauge {AXES[step.direction].upper()}{end}"
    )
