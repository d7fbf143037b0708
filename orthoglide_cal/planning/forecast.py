"""The forecast of a session before its first reading is taken: on any kind of machine.

Everything here holds at the parameters that are plausible before anything is measured, with the
gauge's stated noise and the degrees of freedom that the readings will have. On average it is what
`solve` prints once they are there.
"""

from bisect import bisect_left
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from pydantic import Field, computed_field

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Method, Posed, pose_plan
from orthoglide_cal.estimation.accuracy import Scatter, determined, require_rank
from orthoglide_cal.estimation.budget import Budget, budget_of, fixed_influences, influences
from orthoglide_cal.model.machine import Influence, Layout, Origin
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.workspace import error_after
from orthoglide_cal.planning.separation import separations
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    MeasuringProtocol,
    Order,
    gauge_moves,
    sequence,
    timed_plan,
)
from orthoglide_cal.schema import Minutes, Schema
from orthoglide_cal.words import counted

# The scatter of readings: what their number averages.
AVERAGED = frozenset({Origin.NOISE, Origin.RESOLUTION})
TINY = 1e-18  # mm²


def lengths(model: Model, values: Sequence[float]) -> dict[str, float]:
    """Name → value of those calibrated parameters that are lengths; of p values."""
    machine = model.machine
    named = zip(machine.parameter_names, machine.parameter_units, values, strict=True)
    return {name: value for name, unit, value in named if unit == "mm"}


class SessionForecast(Schema):
    """The forecast of a `Layout`, or of a session like it."""

    model: Model = Field(exclude=True)
    plan: Plan = Field(exclude=True)
    # Of the calibrated parameters, at the degrees of freedom that the readings will have.
    budget: Budget = Field(exclude=True)
    name: str = Field(serialization_alias="layout")
    what: str
    cycles: int
    readings: int
    gauge_moves: int
    minutes: Minutes

    @classmethod
    def of(
        cls, model: Model, session: Layout, method: Method = Method.READINGS, **more: object
    ) -> Self:
        """Forecast what a method finds of a session's readings; `more` as of a subclass.

        Raises:
            UnusableResultError: they will not determine the parameters; says what to add.
        """
        plan, machine = session.plan, model.machine
        uncertain = _plausible_influences(model, plan)
        estimator = estimator_for(model, plan, uncertain, method)
        dof = len(plan) - plan.setups - len(machine.parameter_names)
        scatter = Scatter(machine.instrument.noise_mm, float(dof)) if dof > 0 else None
        taken = fixed_influences(model, np.zeros(len(machine.parameter_names)), plan)
        both = (*uncertain, *taken)
        budget = budget_of(estimator, machine.instrument, scatter, both, plan.precision)
        return cls(model=model, budget=budget, readings=len(plan), **session._asdict(), **more)

    @computed_field
    @cached_property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Of each parameter, in its unit: u from the scatter of the readings, U, whether it is
        determined, U of what other readings could reduce and of what is taken as stated."""
        machine, budget, zero = self.model.machine, self.budget, 0.0 * self.budget.std_mm
        fixed = machine.fixed_parameters
        others = {part.source for part in budget.contributions}.difference(fixed)
        parts = (_without(budget, sources) for sources in (fixed, others))
        lessened, stated = (zero if part is None else part.expanded_mm for part in parts)
        scatter = (part.std for part in budget.contributions if part.source in AVERAGED)
        columns = {
            "unit": machine.parameter_units,
            "noise_std": np.sqrt(np.sum(np.square([*scatter]), axis=0)).tolist(),
            "expanded": budget.expanded_mm.tolist(),
            "determined": determined(self.model, budget.expanded_mm),
            "lessened": lessened.tolist(),
            "fixed": stated.tolist(),
        }
        named = zip(machine.parameter_names, zip(*columns.values(), strict=True), strict=True)
        return {name: dict(zip(columns, row, strict=True)) for name, row in named}

    @computed_field(description="what the scatter of the readings leaves of each length")
    @property
    def noise_std_mm(self) -> dict[str, float]:
        return lengths(self.model, [row["noise_std"] for row in self.parameters.values()])

    @computed_field(description="U of each length")
    @cached_property
    def expanded_mm(self) -> dict[str, float]:
        return lengths(self.model, self.budget.expanded_mm.tolist())

    @computed_field
    @cached_property
    def tool_mm(self) -> float | None:
        """How far the tool may be off at the worst place of the workspace, offsets entered [mm].

        k·u of the tool position, and what accepted causes leave there; None without a workspace.
        """
        with suppress(UsageError):
            after = error_after(self.model, self.budget.covariance_mm2, self.budget.k)[1]
            return float(after.max())
        return None

    @computed_field
    @cached_property
    def rivals_sigma(self) -> float | None:
        """Between the causes that hide behind each other on this kind of machine [standard
        deviations]; None if it has none or one of the two cannot be."""
        return rivals_sigma(self.model, self.plan)

    @cached_property
    def floor(self) -> Budget | None:
        """The budget without the scatter of the readings; None if nothing is left of it."""
        return _without(self.budget, AVERAGED)


def _without(budget: Budget, sources: Collection[str]) -> Budget | None:
    left = budget.without(sources).contributions
    parts = tuple(part for part in left if np.any(np.square(part.std) > TINY))
    return Budget(parts) if parts else None


def rivals_sigma(model: Model, plan: Plan) -> float | None:
    """How far apart readings get the rivals of a kind of machine, see `SessionForecast`."""
    if not model.machine.rivals:
        return None
    return next(iter(separations(model, plan, model.machine.rivals).pairs.values()), None)


# Every method asks for the same sessions.
@lru_cache(maxsize=128)
def session_of(
    model: Model,
    protocol: MeasuringProtocol,
    cycles: int,
    stands: int = 2,
    order: Order = Order.PAPER,
) -> Layout:
    """A session as `measure` guides it: at least one cycle, `stands` gauges read side by side."""
    steps = sequence(model.machine, protocol, cycles, order, stands)
    plan, minutes = timed_plan(steps)
    words = f"{protocol}, {counted(cycles, 'cycle')}"
    return Layout(protocol, words, plan, minutes, cycles, gauge_moves(steps))


# The same sessions are asked for by number of cycles, by target and by comparison.
@lru_cache(maxsize=128)
def forecast(
    model: Model,
    protocol: MeasuringProtocol,
    cycles: int,
    method: Method = Method.READINGS,
    stands: int = 2,
) -> SessionForecast:
    """Forecast a `session_of` a protocol by a method that its readings can feed."""
    return SessionForecast.of(model, session_of(model, protocol, cycles, stands), method)


def estimator_for(
    model: Model, plan: Plan, uncertain: Sequence[Influence], method: Method = Method.READINGS
) -> Floats:
    """Derivatives of the parameters by n readings, (p, n), by a method that they can feed.

    `uncertain` acts on them in addition to noise. Raises UnusableResultError.
    """
    problem, which = pose_plan(plan, model, method.uses)
    require_rank(problem)
    posed = Posed(problem, problem.at_zero[0], which)
    if method is Method.READINGS:
        columns = np.hstack([influence.columns for influence in uncertain])
        posed = posed.weighted(problem.matrix @ columns / model.machine.instrument.noise_mm)
    # The slope hardly depends on the offsets: near zero every method is a linear one.
    return np.asarray(method.estimator(posed) @ posed.problem.matrix)


@lru_cache(maxsize=128)
def _plausible_influences(model: Model, plan: Plan) -> tuple[Influence, ...]:
    """Influences on these readings: their squares are the means over plausible parameters."""
    points = model.machine.linearization_points
    share = 1.0 / np.sqrt(len(points))
    return tuple(
        replace(influence, columns=share * np.hstack([*influence.columns]))
        for influence in influences(model, points, plan)
    )


def fewest_cycles(
    model: Model, protocol: MeasuringProtocol, method: Method, stands: int, wanted_mm: float
) -> SessionForecast | None:
    """The shortest session that leaves no U larger than wanted; None if `MOST_CYCLES` do not.

    Other arguments as of `forecast`.
    """

    def enough(cycles: int) -> bool:
        session = forecast(model, protocol, cycles, method, stands)
        return max(session.expanded_mm.values()) <= wanted_mm

    # More cycles never leave a larger U.
    fewest = 1 + bisect_left(range(1, MOST_CYCLES + 1), True, key=enough)
    return forecast(model, protocol, fewest, method, stands) if fewest <= MOST_CYCLES else None
