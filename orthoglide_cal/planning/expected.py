"""What readings will be worth before the first is taken: covariance and budget of the offsets.

Everything here holds at the joint offsets that are plausible before anything is measured, with the
gauge's stated noise and the degrees of freedom that the readings will have. On average it is what
`solve` prints once they are there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from orthoglide_cal.estimation import Method, Posed, pose_plan
from orthoglide_cal.estimation.accuracy import Scatter, require_rank
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.estimation.influences import held, influences
from orthoglide_cal.estimation.solution import budget_of_readings
from orthoglide_cal.model import Floats, GaugePlan, Model
from orthoglide_cal.model.influence import Influence, Origin
from orthoglide_cal.model.protocols import plan_of
from orthoglide_cal.model.workspace import workspace_error
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    MeasuringProtocol,
    Order,
    SessionStep,
    clock,
    gauge_moves,
    minutes_left,
    sequence,
)

# The scatter of readings: what their number averages.
AVERAGED = frozenset({Origin.NOISE, Origin.RESOLUTION})
TINY = 1e-18  # mm²


@dataclass(frozen=True, eq=False)
class Session:
    """A session that could be measured.

    Attributes:
        protocol: how the readings are taken.
        cycles: repeats of the postures on each leg.
        steps: all readings, in order.
        plan: the same.
    """

    protocol: MeasuringProtocol
    cycles: int
    steps: tuple[SessionStep, ...]
    plan: GaugePlan

    # Every method asks for the same sessions.
    @classmethod
    @functools.lru_cache(maxsize=128)
    def of(
        cls,
        model: Model,
        protocol: MeasuringProtocol,
        cycles: int,
        stands: int = 2,
        order: Order = Order.PAPER,
    ) -> Session:
        """As `measure` guides it: at least one cycle, `stands` gauges read side by side.

        The single-posture protocol always takes one.
        """
        stands = 1 if protocol is MeasuringProtocol.SINGLE else stands
        steps = sequence(model.machine, protocol, cycles, order, stands)
        timed = zip(steps, clock(steps), strict=False)
        plan = plan_of([step.planned._replace(minutes=at) for step, at in timed])
        return cls(protocol, cycles, steps, plan)

    @property
    def readings(self) -> int:
        """How many."""
        return len(self.steps)

    @property
    def moves(self) -> int:
        """How often a stand is put to another place."""
        return gauge_moves(self.steps)

    @property
    def minutes(self) -> float:
        """How long it takes, as `measure` says at its start."""
        return minutes_left(self.steps)


class Foreseen:
    """What readings will give: what follows from the budget of their p calibrated parameters."""

    budget: Budget

    @cached_property
    def noise_std_mm(self) -> Floats:
        """What the scatter of the readings leaves of each, shape (p,) [mm, or its unit]."""
        parts = [c.std_mm**2 for c in self.budget.contributions if c.source in AVERAGED]
        return np.asarray(np.sqrt(np.sum(parts, axis=0)))

    @property
    def expanded_mm(self) -> Floats:
        """Expanded uncertainties U, shape (p,) [mm, or its unit]."""
        return self.budget.expanded_mm

    @cached_property
    def floor(self) -> Budget | None:
        """What is left of it beside the scatter of the readings; None if that is nothing."""
        found = (each for each in self.budget.contributions if each.source not in AVERAGED)
        parts = tuple(each for each in found if np.any(each.std_mm))
        return Budget(parts) if parts else None


@dataclass(frozen=True, eq=False)
class Expected(Foreseen):
    """What a session will give.

    Attributes:
        session: how it is measured.
        budget: of the offsets, at the degrees of freedom that the readings will have.
    """

    session: Session
    budget: Budget


# The same sessions are asked for by number of cycles, by target and by comparison.
@functools.lru_cache(maxsize=128)
def expected(
    model: Model,
    protocol: MeasuringProtocol,
    cycles: int,
    method: Method = Method.READINGS,
    stands: int = 2,
) -> Expected:
    """What a session will give.

    Args:
        model: the machine, its gauge and its accepted causes.
        protocol, cycles, stands: how the readings are taken, see `Session.of`.
        method: an estimator that such readings can feed.

    Raises:
        RankDeficientError: the readings will not determine the offsets.
    """
    session = Session.of(model, protocol, cycles, stands)
    return Expected(session, expected_budget(model, session.plan, method))


def expected_budget(model: Model, plan: Any, method: Method = Method.READINGS) -> Budget:
    """The budget of the offsets that a method will find from readings of a plan.

    Args:
        model: the machine, its gauge and its accepted causes.
        plan: n readings.
        method: an estimator that they can feed.

    Raises:
        RankDeficientError: they will not determine the offsets; says what to add.
    """
    gauge, uncertain = model.machine.gauge, _plausible_influences(model, plan)
    estimator = estimator_for(model, plan, uncertain, method)
    dof = len(plan) - plan.setups - len(model.machine.parameter_names)
    scatter = Scatter(gauge.noise_mm, float(dof)) if dof > 0 else None
    taken = held(model, np.zeros(len(model.machine.parameter_names)), plan)
    return budget_of_readings(estimator, plan, gauge, scatter, (*uncertain, *taken))


def estimator_for(
    model: Model, plan: Any, uncertain: Sequence[Influence], method: Method = Method.READINGS
) -> Floats:
    """What a small change of each reading does to the offsets, shape (3, n).

    Args:
        model, plan, method: as in `expected_budget`.
        uncertain: what acts on the readings beside noise.

    Raises:
        RankDeficientError: the readings do not determine the offsets.
    """
    problem, which = pose_plan(plan, model, method.uses, folded=True)
    require_rank(problem)
    posed = Posed(problem, problem.at_zero[0], which)
    if method is Method.READINGS:
        columns = np.hstack([each.columns for each in uncertain])
        posed = posed.weighted(problem.matrix @ columns / model.machine.gauge.noise_mm)
    # The slope hardly depends on the offsets: near zero every method is a linear one.
    return np.asarray(method.estimator(posed) @ posed.problem.matrix)


@functools.lru_cache(maxsize=128)
def _plausible_influences(model: Model, plan: Any) -> tuple[Influence, ...]:
    """Influences on these readings: their squares are the means over plausible offsets."""
    alike = [influences(model, offsets, plan) for offsets in model.machine.linearization_points]
    share = 1.0 / np.sqrt(len(alike))
    return tuple(
        replace(each[0], columns=share * np.hstack([one.columns for one in each]))
        for each in zip(*alike, strict=True)
    )


def fewest_cycles(
    model: Model,
    protocol: MeasuringProtocol,
    method: Method,
    stands: int,
    wanted_mm: float,
) -> Expected | None:
    """The shortest session that leaves no U larger than wanted; None if `MOST_CYCLES` do not.

    Args:
        model, protocol, method, stands: as in `expected`.
        wanted_mm: largest U of an offset.
    """
    low, high, best = 0, MOST_CYCLES + 1, None
    tried = expected(model, protocol, 1, method, stands)
    while True:
        cycles = tried.session.cycles
        if float(tried.expanded_mm.max()) <= wanted_mm:
            high, best = cycles, tried
        else:
            low = cycles
        if high - low == 1:
            return best
        guess = _cycles_for(tried, wanted_mm)
        tried = expected(model, protocol, min(max(guess, low + 1), high - 1), method, stands)


def _cycles_for(found: Expected, wanted_mm: float) -> int:
    """About so many cycles leave the wanted U: what is averaged falls with their number."""
    k2, cycles = found.budget.k**2, found.session.cycles
    left = 0.0 if found.floor is None else np.diag(found.floor.covariance_mm2)
    noise = found.noise_std_mm**2 * cycles
    spare = wanted_mm**2 / k2 - left
    needed = np.where(spare * MOST_CYCLES > noise, noise / np.maximum(spare, TINY), MOST_CYCLES)
    return math.ceil(float(needed.max()))


def tool_error_mm(model: Model, budget: Budget) -> float:
    """How far the tool may be off at the worst place of the workspace, offsets entered [mm].

    k·u of the tool position, and what accepted causes leave there.
    """
    return workspace_error(model, np.zeros(3), budget.covariance_mm2, budget.k).after_max_mm
