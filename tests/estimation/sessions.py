"""Measured data for tests, plans for them, and many sessions solved at once."""

from dataclasses import dataclass, fields, replace

import numpy as np

from orthoglide_cal.estimation import Fit, Problem, fit_offsets
from orthoglide_cal.estimation.accuracy import half_width, unit_covariance
from orthoglide_cal.model import (
    DIFFERENCES,
    DataKind,
    Difference,
    Differences,
    Floats,
    Gauge,
    GaugePlan,
    Model,
    Readings,
    Source,
    cell_contrasts,
    ideal_plan,
    reduction,
    simulate,
    simulate_with_jacobian,
    without_zeros,
)
from orthoglide_cal.model.synthetic import synthetic_session
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
    """The problem of one cycle of differences."""
    plan = ideal_plan(kind, model.machine)
    return Problem(model, plan, reduction(kind, DIFFERENCES[kind], model.machine, plan))


def of_values(kind: DataKind, values: Floats | list[float]) -> Differences:
    """All differences of one kind, in the paper's order."""
    return Differences(kind, DIFFERENCES[kind], np.array(values), NOWHERE)


def differences(kind: DataKind, model: Model, offsets: Floats = OFFSETS) -> Differences:
    """Exact differences of one kind."""
    return of_values(kind, problem_of(kind, model).predict(offsets))


def only(data: Differences, *names: str) -> Differences:
    """The named differences, in this order."""
    index = [data.which.index(NAMED[name]) for name in names]
    return replace(data, which=tuple(NAMED[name] for name in names), value=data.value[index])


def merged(*plans: GaugePlan) -> GaugePlan:
    """Plans one after the other, each with set-ups of its own."""
    parts = {
        item.name: np.concatenate([getattr(plan, item.name) for plan in plans])
        for item in fields(GaugePlan)
    }
    counts = np.cumsum([0, *(plan.setups for plan in plans)])
    parts["setup"] = np.concatenate([p.setup + n for p, n in zip(plans, counts, strict=False)])
    parts["order"] = np.arange(len(parts["leg"]))
    return GaugePlan(**parts)


@dataclass(frozen=True, eq=False)
class Many:
    """Sessions of one plan, solved as `solve` does each: fit (m, …), u and U (m, 3)."""

    fit: Fit
    sigma_mm: Floats
    std_mm: Floats
    expanded_mm: Floats


def solve_many(model: Model, plan: GaugePlan, values: Floats, kind: DataKind) -> Many:
    """Offsets and intervals of sessions (m, n) by the nonlinear method of this kind."""
    if kind is READINGS:
        matrix = cell_contrasts(plan)
    else:
        matrix = reduction(kind, DIFFERENCES[kind], model.machine, plan)
    problem = Problem(model, plan, matrix)
    fit = fit_offsets(problem, values @ matrix.T)
    assert np.all(fit.converged)
    spare = without_zeros(plan, values - simulate(model, fit.offsets_mm, plan))
    # Whatever the method, σ is of what no offsets explain.
    jacobian = simulate_with_jacobian(model, fit.offsets_mm, plan)[1]
    jacobian = without_zeros(plan, np.swapaxes(jacobian, -1, -2))
    off = np.linalg.solve(jacobian @ np.swapaxes(jacobian, -1, -2), jacobian @ spare[..., None])
    spare = spare - (np.swapaxes(jacobian, -1, -2) @ off)[..., 0]
    dof = len(plan) - plan.setups - 3
    sigma = np.sqrt((spare**2).sum(axis=-1) / dof)
    sigma = np.maximum(sigma, model.machine.gauge.rounding_mm)
    jacobian = problem.predict_with_jacobian(fit.offsets_mm)[1]
    variances = np.diagonal(unit_covariance(problem, jacobian), axis1=-2, axis2=-1)
    std = sigma[:, None] * np.sqrt(variances)
    return Many(fit, sigma, std, half_width(dof) * std)
