"""Measured data for tests, plans for them, and many sessions solved at once."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import shrinking
from orthoglide_cal.estimation.solution import Method, Problem, fit_offsets, pose_plan
from orthoglide_cal.model.measured import (
    DIFFERENCES,
    DataKind,
    Difference,
    Differences,
    Readings,
    Source,
)
from orthoglide_cal.model.model import Model, simulate, synthetic_session
from orthoglide_cal.model.orthoglide import Gauge, ideal_plan, reduction
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.readings import GaugePlan
from tests.machines import extended

NOWHERE = Source("test", "")
OFFSETS = np.array([0.83, -1.46, 0.57])
SMALL = 1e-3 * OFFSETS
PERFECT = Gauge.model_construct(
    resolution_mm=0.0, range_mm=10.0, revolution_mm=1.0, repeatability_mm=0.0
)
READINGS, SIX, TWELVE, SINGLE = (
    DataKind.READINGS, DataKind.SIX, DataKind.TWELVE, DataKind.SINGLE,
)  # fmt: skip
# The prototype with axes known to miss each other.
BENT = extended(axis_gap=(0.3, -0.4, 0.25))
NAMED: dict[str, Difference] = {
    each.name: each for kind in (SIX, TWELVE, SINGLE) for each in DIFFERENCES[kind]
}


def readings(
    model: Model, plan: GaugePlan, offsets: Floats = OFFSETS, seed: int | None = 1
) -> Readings:
    """A session with the machine's own gauge, or with a perfect one if `seed` is None."""
    rng = np.random.default_rng(0 if seed is None else seed)
    gauge = PERFECT if seed is None else model.machine.gauge
    session = synthetic_session(model, plan, offsets, rng, gauge)
    if seed is None:
        # Not rounded at all: zeros of a few figures keep the differences exact.
        zeros = np.round(np.linspace(-0.9, 0.8, plan.setups), 1)
        session = replace(session, value=simulate(model, offsets, plan) + zeros[plan.setup])
    return session


def problem_of(kind: DataKind, model: Model) -> Problem:
    plan = ideal_plan(kind, model.machine)
    return Problem(model, plan, reduction(kind, DIFFERENCES[kind], model.machine, plan))


def of_values(kind: DataKind, values: Floats | list[float]) -> Differences:
    """All differences of one kind, in the paper's order."""
    return Differences(kind, DIFFERENCES[kind], np.array(values), NOWHERE)


def differences(kind: DataKind, model: Model, offsets: Floats = OFFSETS) -> Differences:
    return of_values(kind, problem_of(kind, model).predict(offsets))


def only(data: Differences, *names: str) -> Differences:
    """The named differences, in this order."""
    index = [data.which.index(NAMED[name]) for name in names]
    return replace(data, which=tuple(NAMED[name] for name in names), value=data.value[index])


def merged(one: GaugePlan, other: GaugePlan) -> GaugePlan:
    """One after the other, each with set-ups of its own."""
    later = replace(other, setup=other.setup + one.setups, order=other.order + len(one))
    return Plan.joined(one, later)


def solved(
    model: Model, plan: Plan, values: Floats, expected: Floats, method: Method = Method.READINGS
) -> Floats:
    """Parameters from many sessions (m, n) of one plan, each solved as `solve` does, (m, p).

    Readings are weighted with influences as at the `expected` parameters.
    """
    problem = pose_plan(plan, model, method.uses)
    data = values @ problem.matrix.T
    if method.linear:
        return np.asarray((data - problem.at_zero[0]) @ method.estimator(problem).T)
    if method is Method.READINGS:
        columns = np.hstack([each.columns for each in influences(model, expected, plan)])
        ratio = problem.matrix @ columns / model.machine.instrument.noise_mm
        problem = problem.weighted(shrinking(ratio))
    fit = fit_offsets(problem, values @ problem.matrix.T)
    assert np.all(fit.converged)
    return fit.offsets_mm
