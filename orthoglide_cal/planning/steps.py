"""The steps of a session: which reading comes when, and what has to be moved for it.

The postures of the session are the paper's, or those of the best design: the fewest readings for an
accuracy.
"""

import functools
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import product

import numpy as np

from orthoglide_cal.errors import PostureError, UnusableResultError
from orthoglide_cal.files.text import number_text
from orthoglide_cal.model.machine import Machine, Suspicion
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.orthoglide import (
    MARGIN,
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    ROUNDING,
    PlannedReading,
    double_posture,
    plan_of,
    planned_readings,
    single_posture,
    visiting,
)
from orthoglide_cal.model.plan import Floats, Ints, Plan
from orthoglide_cal.model.readings import AXES, GaugePlan, Posture, Series

# Pace assumed for what else is done between readings [min].
MINUTES_PER_TURN = 3.0  # turn a bar half round
MINUTES_PER_SLIDE = 0.5  # slide a stand from one end of a leg to the other
NOTHING_ENTERED = (0.0, 0.0, 0.0)
CYCLES = 3  # of a session, if nothing else is said
MOST_CYCLES = 50  # that `measure --cycles` takes
# Postures that are tried for the best design, as shares of the lower and of the upper joint limit.
SHARES = np.array([(0.0, 0.0), (0.0, 1.0), (0.0, 0.5), (0.5, 0.0), (1.0, 0.0)])
# A gauge is read at most so often in a cycle.
MOST_VISITS = 5
# Places along the leg that are tried, half-way first: a rule is enough to find a twentieth.
PLACES = sorted((k / 20 for k in range(21)), key=lambda place: abs(place - 0.5))
# Precision [1] of an offset that no reading sees.
NOTHING = 1e-12
# What the best design shows less well than the double-posture protocol: with two postures a track
# that is bent looks like one that leans.
GIVES_UP = (
    "rails that do not meet, axes out of square and a tilted bar look alike; a wrong scale, lost"
    " motion and a creeping stand show much less, a knocked stand a little less"
)


class MeasuringProtocol(StrEnum):
    """How the readings are taken (sec. 3.3 and 3.2)."""

    DOUBLE = "double-posture"
    SINGLE = "single-posture"
    BEST = "best-design"  # the double-posture protocol with the postures that tell most


class Order(StrEnum):
    """Order of the steps."""

    PAPER = "paper"  # sec. 4.1: all readings of a posture, then the next posture
    FEWEST_MOVES = "fewest-moves"  # a gauge stays at its place on the leg for all postures


@dataclass(frozen=True)
class SessionStep:
    """One reading to take; leg and direction are 0, 1, 2 for x, y, z."""

    number: int  # from 1, in the order of the session
    cell: PlannedReading  # what is read, at no time at all; readings of one cell repeat each other
    posture: str  # iso, max, min, or the displacement [mm] as text
    cycle: int  # repeat of this posture, from 1
    stand: int  # which of the gauges read side by side takes it, from 0
    setup: int  # number of the gauge set-up, from 1; the stands are moved between set-ups
    block: int  # of the posture program: 10, 20 …, one for each visit of a posture

    @property
    def leg(self) -> int:
        """The leg that is touched, and whose carriage is displaced."""
        return self.cell.leg

    @property
    def direction(self) -> int:
        """The axis along which the gauge measures."""
        return self.cell.direction

    @property
    def series(self) -> Series:
        """Leg and direction."""
        return self.cell.series

    @property
    def zero(self) -> tuple[int, int]:
        """Readings that agree in it share the gauge's zero."""
        return self.setup, self.stand

    @property
    def visit(self) -> tuple[object, ...]:
        """Readings of one visit are taken without moving the machine or a stand in between."""
        return self.setup, self.leg, self.posture, self.cycle, self.cell.entered


def sequence(
    machine: Machine, protocol: MeasuringProtocol, cycles: int, order: Order, stands: int
) -> tuple[SessionStep, ...]:
    """All steps of a session.

    Args:
        machine: its joint limits are the Max and Min postures.
        protocol, cycles: which readings; repeats of Iso, Max, Min on each leg, and a closing Iso.
        order, stands: as of `steps_of`; the single-posture protocol uses one gauge.
    """
    match protocol:
        case MeasuringProtocol.DOUBLE:
            plan = double_posture(machine, cycles)
        case MeasuringProtocol.SINGLE:
            plan = single_posture(machine, cycles, closing=True)
        case MeasuringProtocol.BEST:
            displacements, gauge_at = design_of(machine)
            plan = visiting(displacements * cycles, gauge_at)
    return steps_of(plan, machine, order, stands)


def sequence_options(protocol: MeasuringProtocol, cycles: int, order: Order, stands: int) -> str:
    """Options of `measure` and `plan` for a `sequence`; none for the usual one."""
    single = protocol is MeasuringProtocol.SINGLE
    options = {
        "--protocol single": single,
        "--design best": protocol is MeasuringProtocol.BEST,
        f"--cycles {cycles}": cycles != CYCLES,
        f"--order {order}": order is not Order.PAPER,
        f"--gauges {stands}": stands != 2 and not single,
    }
    return " ".join(option for option, needed in options.items() if needed)


def steps_of(plan: Plan, machine: Machine, order: Order, stands: int) -> tuple[SessionStep, ...]:
    """The steps of any plan.

    Args:
        plan: the readings, in time order; readings of one set-up of it share a zero.
        machine: for the names of the postures.
        order: may bring readings at one end of a leg together.
        stands: gauges that are read side by side. One gauge takes one direction of a leg after
            the other, and slides alone between the ends of a leg.
    """
    rows, readings, zero_of = plan.in_time.tolist(), planned_readings(plan), plan.shared.tolist()
    alone = stands == 1 or not plan.fixed
    if alone and (plan.fixed or order is Order.FEWEST_MOVES):
        keys = [(zero, cell.contact) for zero, cell in zip(zero_of, readings, strict=True)]
        # Equal keys come together, in the order in which they first appear.
        first: dict[object, int] = {}
        rows = sorted(rows, key=lambda i: first.setdefault(keys[i], len(first)))
    steps: list[SessionStep] = []
    seen: Counter[PlannedReading] = Counter()
    setup, place, zeros, block = 0, None, dict[int, int](), 0
    for number, i in enumerate(rows, start=1):
        planned = readings[i]
        leg, direction = planned.leg, planned.direction
        posture = machine.posture_at(planned.displacement) or number_text(planned.displacement)
        seen[planned] += 1
        # A single gauge is carried over to the next series; two stand there together.
        here = (leg, direction if alone else None)
        if here != place or zeros.get(direction, zero_of[i]) != zero_of[i]:
            setup, place, zeros = setup + 1, here, {}
        zeros[direction] = zero_of[i]
        stand = 0 if alone else int(direction > min({0, 1, 2} - {leg}))
        visit = (setup, leg, posture, seen[planned], planned.entered)
        if not steps or visit != steps[-1].visit:
            block += 10
        steps.append(SessionStep(number, planned, posture, seen[planned], stand, setup, block))
    return tuple(steps)


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
        here = (step.zero, step.cell.contact)
        moves += places.get(step.stand, here) != here
        places[step.stand] = here
    return moves


def clock(steps: Sequence[SessionStep]) -> list[float]:
    """When each of n steps is read, and when all are, shape (n + 1,) [min].

    It begins when the stands of the first are set up, and a bar for it is still to be turned.
    """
    turned: set[tuple[int, int]] = set()
    times, now = [], 0.0
    for before, step in zip((None, *steps), steps, strict=False):
        if before is not None:
            now += MINUTES_PER_POSTURE * (before.visit != step.visit)
            if before.setup != step.setup:
                now += MINUTES_PER_SETUP
            elif before.cell.contact is not step.cell.contact:
                now += MINUTES_PER_SLIDE
        bar = (step.cell.part, step.leg)
        if step.cell.turned and bar not in turned:
            turned.add(bar)
            now += MINUTES_PER_TURN
        times.append(now)
    return [*times, now + MINUTES_PER_POSTURE if times else now]


def timed_plan(steps: Sequence[SessionStep], begin_min: float = 0.0) -> tuple[GaugePlan, float]:
    """Readings of steps, the first after `begin_min`, and when all are taken [min]."""
    *times, minutes = (begin_min + at for at in clock(steps))
    timed = zip(steps, times, strict=True)
    return plan_of([step.cell._replace(minutes=at) for step, at in timed]), minutes


def step_name(step: SessionStep) -> str:
    """The step in a few words, e.g. "leg X, MAX, cycle 2, gauge Z"."""
    end = f", {step.cell.contact.end} end" if step.cell.contact.end else ""
    return (
        f"leg {AXES[step.leg].upper()}, {posture_name(step)}, cycle {step.cycle},"
        f" gauge {AXES[step.direction].upper()}{end}"
    )


def posture_name(step: SessionStep) -> str:
    """The posture as it is spoken of: "MAX", "+30 mm"."""
    named = isinstance(step.posture, Posture)
    return step.posture.upper() if named else f"{step.cell.displacement:+g} mm"


# --- the best design --------------------------------------------------------------------------


# A plan asks for it once for each number of cycles.
@functools.lru_cache(maxsize=8)
def design_of(machine: Machine) -> tuple[tuple[float, ...], float]:
    """The postures and the gauge place that reach any accuracy with the fewest readings.

    The offsets show in differences of readings that share a gauge zero. With w_d readings at
    posture d of each gauge, the precision of the offsets is

        Σ_gauges Σ_d w_d (J_d − J̄)ᵀ (J_d − J̄) / σ²,   J̄ = Σ w_d J_d / Σ w_d

    Searched are all whole numbers w_d up to a few readings per cycle, and the places of the gauges,
    for the smallest product of the largest variance and the number of readings: so many readings a
    wanted accuracy takes. Postures that displace other carriages, too, as far as the plunger
    follows (5 mm), would save 3 to 5 % more: not worth a stand that has to be watched.

    Displacements [mm] of one cycle in their order, within the joint limits, and a place along the
    leg, one per leg and direction, as of `visiting`; each plunger stays `MARGIN` from both joints.

    Raises UnusableResultError: no such postures determine the offsets.
    """
    postures = SHARES @ np.array(machine.limits_mm)
    every = np.array(list(product(range(MOST_VISITS + 1), repeat=len(postures))), dtype=np.intp)
    every = every[np.isin(every.sum(axis=1), range(2, MOST_VISITS + 1))]
    # Of designs that are equally good the shortest comes first.
    every = every[np.argsort(every.sum(axis=1), kind="stable")]
    # All readings with the gauges at each of the places; ∂readings/∂Δρ, (places, 6, postures, 3).
    plan = visiting(tuple(postures.tolist()))
    everywhere = replace(
        plan.subset(np.tile(np.argsort(plan.setup, kind="stable"), len(PLACES))),
        gauge_at=np.repeat(PLACES, len(plan)),
    )
    slopes = differentiate(Model(machine), np.zeros(3), everywhere)[1]
    jacobians = slopes.reshape(len(PLACES), plan.setups, len(postures), 3)
    least, best = 1.0 / NOTHING**0.5, None
    for place, jacobian in zip(PLACES, jacobians, strict=True):
        near_joint = np.abs(place + postures / machine.leg_mm - 0.5) > 0.5 - MARGIN + ROUNDING
        count = every[~np.any(every[:, near_joint], axis=1)]
        needed = _cost(jacobian, count)
        if needed.min(initial=least) < least * (1.0 - ROUNDING):
            least = float(needed.min())
            chosen = count[int(np.argmax(needed <= least * (1.0 + ROUNDING)))]
            # In turn: what is alike stands apart in time.
            turns = np.concatenate([np.flatnonzero(chosen > turn) for turn in range(MOST_VISITS)])
            best = tuple(postures[turns].tolist()), place
    if best is None:
        raise UnusableResultError(
            "No postures within the joint limits let the gauges see the joint offsets.",
            "Check joint_limits_mm and leg_length_mm in the machine file.",
        )
    return best


def _cost(jacobian: Floats, count: Ints) -> Floats:
    """Readings for a variance of σ² of c designs that visit postures (c, p), shape (c,)."""
    total = count.sum(axis=1)
    # Σ w J Jᵀ − (Σ w J)(Σ w J)ᵀ/Σ w, summed over the gauges.
    squares = np.tensordot(count, np.einsum("gpi,gpj->pij", jacobian, jacobian), axes=1)
    sums = np.tensordot(count, jacobian, axes=(1, 1))
    precision = squares - np.einsum("cgi,cgj->cij", sums, sums) / total[:, None, None]
    covariance = np.linalg.inv(precision + NOTHING * np.eye(3))
    largest = np.diagonal(covariance, axis1=1, axis2=2).max(axis=1)
    return np.asarray(largest * total * len(jacobian))


def require_on_bar(plan: Plan, machine: Machine) -> Suspicion | None:
    """The warning of a plan whose plungers stay on the bars, but barely; None without one.

    Raises PostureError: a plunger leaves its bar.
    """
    warning = machine.bar_warning(plan)
    if warning is not None and warning.size > 0.0:
        raise PostureError(warning.what, warning.remedy)
    return warning
