"""From what was measured to joint offsets with their uncertainty: the main entry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.errors import NotConvergedError
from orthoglide_cal.estimation.accuracy import (
    Scatter,
    half_width,
    require_rank,
    scatter_of_residuals,
    unit_covariance,
)
from orthoglide_cal.estimation.least_squares import fit_offsets
from orthoglide_cal.estimation.methods import (
    Method,
    Posed,
    choose_method,
    pose,
)
from orthoglide_cal.estimation.solution import Solution
from orthoglide_cal.model import (
    Floats,
    Measured,
    Model,
    Readings,
    carried_uncertainty,
    simulate,
    without_zeros,
)


@dataclass(frozen=True, eq=False)
class _Estimate:
    offsets: Floats
    slope: Floats  # J at the solution, (k, 3)
    estimator: Floats  # M: what a small change of the data does to the offsets, (3, k)
    residual: Floats  # d − R·h, (k,)
    iterations: int


def solve(measured: Measured, model: Model, method: str | None = None) -> Solution:
    """Identify the joint offsets.

    Args:
        measured: readings or differences.
        model: the machine, its gauge and its accepted causes.
        method: name of an estimator; the default for this kind of data if None.

    Returns:
        Offsets with covariance, intervals, residuals and the expected-improvement table.

    Raises:
        UsageError: the method does not exist or cannot use these data.
        RankDeficientError: the data do not determine the offsets; says what to add.
        NotConvergedError: no optimum was found; there is no result.
    """
    chosen = choose_method(measured, method)
    posed = pose(measured, model, chosen, folded=True)
    require_rank(posed.problem)
    found = _estimate(posed, chosen)
    scatter = _residual_scatter(measured, posed, found)
    gauge = model.machine.gauge
    if scatter is None:
        sigma, factor = gauge.noise_mm, half_width(np.inf)
    else:
        sigma, factor = max(scatter.sigma_mm, gauge.rounding_mm), half_width(scatter.dof)
    noise = sigma**2 * unit_covariance(posed.problem, found.slope, found.estimator)
    # What is known of the machine is known with an uncertainty of its own (normal: factor 1.96).
    carried = _carried(posed, found)
    reach = np.hypot(
        factor * np.sqrt(np.diag(noise)), half_width(np.inf) * np.sqrt(np.diag(carried))
    )
    return Solution(
        measured=measured,
        method=chosen,
        posed=posed,
        offsets_mm=found.offsets,
        residuals_mm=found.residual,
        covariance_mm2=noise + carried,
        interval_mm=np.stack((found.offsets - reach, found.offsets + reach), axis=1),
        sigma_mm=sigma,
        scatter=scatter,
        iterations=found.iterations,
    )


def _estimate(posed: Posed, method: Method) -> _Estimate:
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
    fit = fit_offsets(problem, data)
    remaining = float(fit.remaining_mm)
    if not fit.converged:
        raise NotConvergedError(
            "No offsets fit these data: the search ended where the residuals can still fall"
            f" (a step of {remaining:.2g} mm is left after {int(fit.iterations)} iterations).",
            "Check the machine file and run: orthocal validate",
        )
    slope = problem.predict_with_jacobian(fit.offsets_mm, strict=False)[1]
    estimator = np.asarray(np.linalg.pinv(slope), dtype=np.float64)
    return _Estimate(fit.offsets_mm, slope, estimator, fit.residuals_mm, int(fit.iterations))


def _carried(posed: Posed, found: _Estimate) -> Floats:
    """Covariance of the offsets that comes from accepted causes being uncertain, (3, 3) [mm²]."""
    problem = posed.problem
    if not problem.model.accepted:
        return np.zeros((len(found.offsets),) * 2)
    added = carried_uncertainty(problem.model, found.offsets, problem.plan)
    columns = found.estimator @ problem.matrix @ added
    return np.asarray(columns @ columns.T)


def _residual_scatter(measured: Measured, posed: Posed, found: _Estimate) -> Scatter | None:
    """σ of one reading from the residuals; for raw data from all of them, whatever the method."""
    if not isinstance(measured, Readings):
        return scatter_of_residuals(posed.problem, found.slope, found.residual)
    predicted = simulate(posed.problem.model, found.offsets, measured.plan)
    residual = without_zeros(measured.plan, measured.value - predicted)
    dof = len(measured) - measured.plan.setups - len(found.offsets)
    return Scatter(float(np.sqrt(residual @ residual / dof)), dof) if dof > 0 else None
