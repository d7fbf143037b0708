"""From what was measured to joint offsets with their uncertainty: the main entry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orthoglide_cal.errors import NotConvergedError, UnusableResultError
from orthoglide_cal.estimation.accuracy import (
    Scatter,
    require_determined,
    require_rank,
    sum_of_squares,
)
from orthoglide_cal.estimation.budget import Budget, budget_of
from orthoglide_cal.estimation.influences import held, influences
from orthoglide_cal.estimation.least_squares import Problem, fit_offsets
from orthoglide_cal.estimation.methods import Method, Posed, choose_method, pose
from orthoglide_cal.estimation.solution import Solution
from orthoglide_cal.model import (
    Floats,
    Gauge,
    Measured,
    Model,
    Plan,
    Readings,
    simulate,
    without_zeros,
)
from orthoglide_cal.model.influence import Influence


@dataclass(frozen=True, eq=False)
class _Estimate:
    offsets: Floats
    slope: Floats  # J at the solution, (k, 3)
    estimator: Floats  # M: what a small change of the data does to the offsets, (3, k)
    residual: Floats  # d − R·h, (k,)
    iterations: int


def solve(measured: Measured, model: Model, method: str | None = None) -> Solution:
    """Identify the joint offsets.

    All readings at once are weighted by what is uncertain of them beside noise, such as where
    along its leg each gauge stands; the paper's methods are as the paper has them.

    Args:
        measured: readings or differences.
        model: the machine, its gauge and its accepted causes.
        method: name of an estimator; the default for this kind of data if None.

    Returns:
        Offsets with their uncertainty budget, and residuals.

    Raises:
        UsageError: the method does not exist or cannot use these data.
        RankDeficientError: the data do not determine the offsets, or so little that no search ends;
            says what to add.
        NotConvergedError: no optimum was found; there is no result.
        UnusableResultError: the offsets are larger than any machine has.
    """
    chosen = choose_method(measured, method)
    plain = posed = pose(measured, model, chosen, folded=True)
    require_rank(posed.problem)
    found = _estimate(posed, chosen)
    _require_plausible(found.offsets, posed.problem)
    plan = posed.problem.plan
    uncertain = influences(model, found.offsets, plan)
    # Causes that were fitted to these very data are not uncertain beside their noise.
    here = _fitted_here(measured, model)
    columns = np.hstack([each.columns for each in uncertain if each.source not in here])
    stated = model.machine.gauge.noise_mm
    if chosen is Method.READINGS:
        posed = posed.weighted(posed.problem.matrix @ columns / stated)
        found = _estimate(posed, chosen, start=found.offsets)
    scatter = _scatter(measured, plain, found, columns / stated)
    return Solution(
        measured=measured,
        method=chosen,
        posed=posed,
        offsets_mm=found.offsets,
        residuals_mm=found.residual,
        budget=budget_of_readings(
            found.estimator @ posed.problem.matrix,
            plan,
            model.machine.gauge,
            scatter,
            (*uncertain, *held(model, found.offsets, plan)),
        ),
        scatter=scatter,
        iterations=found.iterations,
    )


def budget_of_readings(
    estimator: Floats,
    plan: Plan,
    gauge: Gauge,
    scatter: Scatter | None,
    uncertain: Sequence[Influence],
) -> Budget:
    """Of parameters that a linear estimator makes of readings, (p, n): of equally precise ones."""
    equal = [replace(each, columns=plan.precision[:, None] * each.columns) for each in uncertain]
    return budget_of(estimator / plan.precision, gauge, scatter, equal)


def _require_plausible(offsets: Floats, problem: Problem) -> None:
    """No carriage stands half of its travel from where it seems to be: then it could not move."""
    low, high = problem.model.machine.joint_limits_mm
    largest = float(np.abs(offsets).max())
    if largest > (high - low) / 2.0:
        require_determined(problem)
        many = problem.model.machine.vocabulary.many
        raise UnusableResultError(
            f"The {many} would be as large as {largest:.0f} mm, more than half of the travel.",
            "Check the unit and the decimal marks of the readings, and the machine file.",
        )


def _estimate(posed: Posed, method: Method, start: Floats | None = None) -> _Estimate:
    """The offsets of one data set.

    Raises:
        NotConvergedError: the search ended where the residuals can still fall.
    """
    problem, data = posed.problem, posed.data
    if method.linear:
        predicted, slope = problem.at_zero
        estimator = method.estimator(posed)
        # At zero offsets every gauge of the nominal machine reads zero; known causes do not.
        shifted = data - predicted
        offsets = estimator @ shifted
        return _Estimate(offsets, slope, estimator, shifted - slope @ offsets, 0)
    fit = fit_offsets(problem, data, start)
    remaining = float(fit.remaining_mm)
    if not fit.converged:
        require_determined(problem)
        raise NotConvergedError(
            f"No {problem.model.machine.vocabulary.many} fit these data: the search ended where the"
            " residuals can still fall"
            f" (a step of {remaining:.2g} mm is left after {int(fit.iterations)} iterations).",
            "Check the machine file and the readings; validate names every fault.",
        )
    slope = problem.predict_with_jacobian(fit.offsets_mm, strict=False)[1]
    estimator = np.asarray(np.linalg.pinv(slope), dtype=np.float64)
    return _Estimate(fit.offsets_mm, slope, estimator, fit.residuals_mm, int(fit.iterations))


def _fitted_here(measured: Measured, model: Model) -> dict[str, int]:
    """Accepted causes that were fitted to these very data: id → number of parameters."""
    return {
        effect.cause.id: int(np.count_nonzero(effect.std))
        for effect in model.accepted
        if effect.data_sha256 == measured.source.sha256
    }


def _scatter(measured: Measured, posed: Posed, found: _Estimate, ratio: Floats) -> Scatter | None:
    """σ of one reading from what no offsets explain; None without degrees of freedom.

    Of raw data from all readings, whatever the method.

    Args:
        posed: without weights.
        ratio: what the influences add to the readings of the plan, in standard deviations, (n, p).
    """
    # What was fitted to these very readings took its part of their noise away.
    model = posed.problem.model
    known = len(found.offsets) + sum(_fitted_here(measured, model).values())
    total, dof = 0.0, len(posed.data) - known
    if isinstance(measured, Readings):
        if posed.which:
            posed = pose(measured, model, Method.READINGS, folded=True)
        dof = len(measured) - measured.plan.setups - known
    if dof <= 0:
        return None
    problem = posed.problem
    predicted, slope = problem.predict_with_jacobian(found.offsets)
    residual = posed.data - predicted
    if isinstance(measured, Readings):
        # Of readings that repeat each other only the means are in the problem.
        apart = measured.value - simulate(problem.model, found.offsets, measured.plan)
        apart = measured.plan.precision * apart
        total = float((without_zeros(measured.plan, apart) ** 2).sum() - (residual**2).sum())
    total += sum_of_squares(problem, slope, residual, problem.matrix @ ratio)
    return Scatter(float(np.sqrt(max(total, 0.0) / dof)), dof)
