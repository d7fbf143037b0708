"""The steps of a session: which reading comes when, and what has to be moved for it."""

import functools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from operator import attrgetter

import numpy as np

from orthoglide_cal.errors import PostureError, UnusableResultError
from orthoglide_cal.files.text import number_text
from orthoglide_cal.model.machine import Machine, Suspicion
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.orthoglide import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    ROUNDING,
    PlannedReading,
    double_posture,
    planned_readings,
    single_posture,
    visiting,
)
from orthoglide_cal.model.plan import Plan
from orthoglide_cal.model.readings import AXES, GaugePlan, Posture
from orthoglide_cal.schema import Schema

# Pace assumed for what else is done between readings [min].
MINUTES_PER_TURN = 3.0  # turn a bar half round
MINUTES_PER_SLIDE = 0.5  # slide a stand from one end of a leg to the other
NOTHING_ENTERED = (0.0, 0.0, 0.0)
CYCLES = 3  # of a session, if nothing else is said
MOST_CYCLES = 50  # that `measure --cycles` takes
# Precision [1] of an offset that no reading sees.
NOTHING = 1e-12
# What the best design shows less well than the double-posture protocol: with two postures a track
# that is bent looks like one that leans.
GIVES_UP = (
    "rails that do not meet, axes out of square and a tilted bar look alike; a wrong scale, lost"
    " motion and a creeping stand show much less, a knocked stand a little less"
)


class MeasuringProtocol(StrEnum):
    """Protocol by which the readings are taken (sec. 3.3 and 3.2)."""

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
    cell: PlannedReading  # what is read; readings of one cell repeat each other
    posture: str  # iso, max, min, or the displacement [mm] as text
    cycle: int  # repeat of this posture, from 1
    stand: int  # which of the gauges read side by side takes it, from 0
    setup: int  # number of the gauge set-up, from 1; the stands are moved between set-ups
    block: int  # of the posture program: 10, 20 …, one for each visit of a posture

    @property
    def leg(self) -> int:
        return self.cell.leg

    @property
    def direction(self) -> int:
        return self.cell.direction

    @property
    def zero(self) -> tuple[int, int]:
        """Readings that agree in it share the gauge's zero."""
        return self.setup, self.stand

    @property
    def visit(self) -> tuple[object, ...]:
        """Readings of one visit are taken without moving the machine or a stand in between."""
        return self.setup, self.leg, self.posture, self.cycle, self.cell.entered

    @property
    def name(self) -> str:
        """The step in a few words, e.g. "leg X, MAX, cycle 2, gauge Z"."""
        end = f", {self.cell.contact.end} end" if self.cell.contact.end else ""
        return (
            f"leg {AXES[self.leg].upper()}, {self.posture_name}, cycle {self.cycle},"
            f" gauge {AXES[self.direction].upper()}{end}"
        )

    @property
    def posture_name(self) -> str:
        """The posture as it is spoken of: "MAX", "+30 mm"."""
        named = isinstance(self.posture, Posture)
        return self.posture.upper() if named else f"{self.cell.displacement:+g} mm"


class GuidedSession(Schema):
    """Readings of one sitting, by a protocol; the usual one where nothing is said."""

    protocol: MeasuringProtocol = MeasuringProtocol.DOUBLE
    cycles: int = CYCLES  # repeats of its postures on each leg, and a closing one
    order: Order = Order.PAPER
    stands: int = 2  # gauges read side by side; the single-posture protocol uses one

    def steps(self, machine: Machine) -> tuple[SessionStep, ...]:
        """All steps; the joint limits of the machine are the Max and Min postures."""
        if self.protocol is MeasuringProtocol.SINGLE:
            plan = single_posture(machine, self.cycles, closing=True)
        elif self.protocol is MeasuringProtocol.BEST:
            displacements, gauge_at = design_of(machine)
            plan = visiting(displacements * self.cycles, gauge_at)
        else:
            plan = double_posture(machine, self.cycles)
        return steps_of(plan, machine, self.order, self.stands)

    @property
    def options(self) -> str:
        """Options of `measure` and `plan` for it; none for the usual one."""
        single = self.protocol is MeasuringProtocol.SINGLE
        options = {
            "--protocol single": single,
            "--design best": self.protocol is MeasuringProtocol.BEST,
            f"--cycles {self.cycles}": self.cycles != CYCLES,
            f"--order {self.order}": self.order is not Order.PAPER,
            "--gauges 1": self.stands == 1 and not single,
        }
        return " ".join(option for option, needed in options.items() if needed)


def steps_of(plan: Plan, machine: Machine, order: Order, stands: int) -> tuple[SessionStep, ...]:
    """The steps of any plan; its readings of one set-up share a zero.

    The order may bring readings at one end of a leg together. Of `stands` gauges read side by side
    a single one takes one direction after the other, and slides alone between the ends of a leg.
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
        step = SessionStep(number, planned, posture, seen[planned], stand, setup, block)
        if not steps or step.visit != steps[-1].visit:
            block += 10
        steps.append(replace(step, block=block))
    return tuple(steps)


def gauge_moves(steps: Sequence[SessionStep]) -> int:
    """Number of times that a stand is put to another place, the first time not counted."""
    by_stand = sorted(steps, key=attrgetter("stand"))
    places = [(step.stand, step.zero, step.cell.contact) for step in by_stand]
    return sum(one[0] == other[0] and one != other for one, other in pairwise(places))


def clock(steps: Sequence[SessionStep]) -> list[float]:
    """Moments of n steps from the set-up of the first, and of the end, (n + 1,) [min]."""
    turned: set[tuple[int, int]] = set()
    times, now = [], 0.0
    for before, step in zip((*steps[:1], *steps), steps, strict=False):
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
    cells, hours = [step.cell for step in steps], np.array(times) / 60.0
    return PlannedReading.planned(cells, hours=hours), minutes


@functools.lru_cache(maxsize=8)  # a plan asks for it once for each number of cycles
def design_of(machine: Machine) -> tuple[tuple[float, float], float]:
    """The postures and the gauge place that reach any accuracy with the fewest readings.

    The offsets show in differences of readings that share a gauge zero. These are largest between
    the ends of the travel, with the gauge as far along the leg as its plunger stays on the bar. Of
    the places nearest to the joint and to the tool that is taken where the largest variance of an
    offset is smaller, diag (Σ D Dᵀ)⁻¹ with D = J_high − J_low of each gauge.

    Displacements [mm], the higher one first, and a place along the leg, as of `visiting`. Raises
    UnusableResultError: no such postures determine the offsets.
    """
    least, best = NOTHING**-0.5, None
    for place in sorted((0.5, *machine.gauge_places), key=lambda at: abs(at - 0.5)):
        low, high = machine.reach_mm(place)
        plan = visiting((high, low), place)
        slopes = differentiate(Model(machine), np.zeros(3), plan)[1]
        apart = slopes[plan.displacement == high] - slopes[plan.displacement == low]
        largest = np.diag(np.linalg.inv(apart.T @ apart + NOTHING * np.eye(3))).max()
        if largest < least * (1.0 - ROUNDING):
            least, best = float(largest), ((high, low), place)
    if best is None:
        raise UnusableResultError(
            "No postures within the joint limits let the gauges see the joint offsets.",
            "Check joint_limits_mm and leg_length_mm in the machine file.",
        )
    return best


def require_on_bar(plan: Plan, machine: Machine) -> Suspicion | None:
    """The warning of a plan whose plungers stay on the bars, but barely; None without one.

    Raises PostureError: a plunger leaves its bar.
    """
    warning = machine.bar_warning(plan)
    if warning is not None and warning.size > 0.0:
        raise PostureError(warning.fault, warning.remedy)
    return warning
