"""From what was measured to joint offsets with their uncertainty: the main entry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import NotConvergedError
from orthoglide_cal.estimation import linear
from orthoglide_cal.estimation.accuracy import (
    Scatter,
    chance_of_residual,
    half_width,
    scatter_of_repeats,
    scatter_of_residuals,
    unit_covariance,
)
from orthoglide_cal.estimation.identifiability import require_rank
from orthoglide_cal.estimation.methods import Method, Posed, choose_method, pose, pose_differences
from orthoglide_cal.estimation.nonlinear import fit_offsets
from orthoglide_cal.estimation.problem import OPTIMAL_MM
from orthoglide_cal.estimation.solution import Solution, TableRow
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Measured, Readings
from orthoglide_cal.plan import Contact
from orthoglide_cal.protocols import without_zeros
from orthoglide_cal.simulation import doubtful, simulate


@dataclass(frozen=True, eq=False)
class _Estimate:
    offsets: Floats
    slope: Floats  # J at the solution, (k, 3)
    estimator: Floats | None  # M of a linear method
    residual: Floats  # d − R·h, (k,)
    remaining: float
    iterations: int


def solve(
    measured: Measured,
    machine: Machine,
    method: str | None = None,
    effects: Sequence[Effect] = (),
) -> Solution:
    """Identify the joint offsets.

    Args:
        measured: readings or differences.
        machine: nominal machine and its gauge.
        method: name of an estimator; the default for this kind of data if None.
        effects: departures from the nominal machine that are already known.

    Returns:
        Offsets with covariance, intervals, residuals and the expected-improvement table.

    Raises:
        UsageError: the method does not exist or cannot use these data.
        RankDeficientError: the data do not determine the offsets; says what to add.
        NotConvergedError: no optimum was found; there is no result.
    """
    chosen = choose_method(measured, method)
    posed = pose(measured, machine, chosen, effects, folded=True)
    require_rank(posed.problem)
    estimate = _estimate(posed, chosen)
    if not estimate.remaining <= OPTIMAL_MM:
        raise NotConvergedError(
            "No offsets fit these data: the search ended where the residuals can still fall"
            f" (a step of {estimate.remaining:.2g} mm is left after {estimate.iterations}"
            " iterations).",
            "Check the machine file and run: orthocal validate",
        )
    residuals = _residual_scatter(measured, machine, posed, estimate, effects)
    floor, stated = machine.gauge.rounding_mm, machine.gauge.noise_mm
    if residuals is None:
        sigma, factor = stated, half_width(np.inf)
    else:
        sigma, factor = max(residuals.sigma_mm, floor), half_width(residuals.dof)
    covariance = sigma**2 * unit_covariance(posed.problem, estimate.slope, estimate.estimator)
    reach = factor * np.sqrt(np.diag(covariance))
    # What is known of the machine is known with an uncertainty of its own (normal: factor 1.96).
    doubt = _carried(posed, estimate, effects)
    reach = np.hypot(reach, half_width(np.inf) * np.sqrt(np.diag(doubt)))
    covariance = covariance + doubt
    before, after, predicted = _fit_quality(measured, machine, posed, estimate, effects)
    repeats = (
        scatter_of_repeats(measured.plan, measured.value)
        if isinstance(measured, Readings)
        else None
    )
    chance = None
    if residuals is not None:
        sum_of_squares = residuals.dof * residuals.sigma_mm**2
        chance = chance_of_residual(sum_of_squares, residuals.dof, stated)
    return Solution(
        source=measured.source,
        kind=measured.kind,
        count=len(measured),
        machine=machine.name,
        method=chosen.name,
        offsets_mm=estimate.offsets,
        covariance_mm2=covariance,
        interval_mm=np.stack((estimate.offsets - reach, estimate.offsets + reach), axis=1),
        sigma_mm=sigma,
        sigma_residuals_mm=None if residuals is None else residuals.sigma_mm,
        sigma_repeats_mm=None if repeats is None else repeats.sigma_mm,
        sigma_floor_mm=floor,
        sigma_stated_mm=stated,
        dof=0 if residuals is None else round(residuals.dof),
        rms_before_mm=before,
        rms_after_mm=after,
        converged=True,
        optimality=estimate.remaining,
        iterations=estimate.iterations,
        table=_table(measured, machine, estimate.offsets, effects),
        readings_mm=predicted,
        lack_of_fit_p=chance,
        warnings=_warnings(measured, residuals, machine),
    )


def _carried(posed: Posed, estimate: _Estimate, effects: Sequence[Effect]) -> Floats:
    """Covariance of the offsets that comes from known effects being uncertain, (3, 3) [mm²]."""
    problem = posed.problem
    matrix = np.linalg.pinv(estimate.slope) if estimate.estimator is None else estimate.estimator
    columns = (
        matrix @ problem.matrix @ doubtful(problem.machine, estimate.offsets, problem.plan, effects)
    )
    return np.asarray(columns @ columns.T)


def _estimate(posed: Posed, method: Method) -> _Estimate:
    problem, data = posed.problem, posed.data
    if not method.linear:
        fit = fit_offsets(problem, data)
        offsets = fit.offsets_mm
        slope = problem.model_with_jacobian(offsets, strict=False)[1]
        remaining = float(problem.remaining_step(data, offsets))
        return _Estimate(offsets, slope, None, fit.residuals_mm, remaining, int(fit.iterations))
    slope = linear.calibration_matrix(problem)
    sequential = method.name == "single-sequential"
    matrix = (
        linear.sequential(problem, posed.names) if sequential else linear.pseudoinverse(problem)
    )
    # At zero offsets every gauge of the nominal machine reads zero; known effects do not.
    shifted = data - problem.model(np.zeros(3))
    offsets = matrix @ shifted
    residual = shifted - slope @ offsets
    # The optimum of a linear method: its own estimator finds nothing left in its residual.
    remaining = float(np.abs(matrix @ residual).max())
    return _Estimate(offsets, slope, matrix, residual, remaining, 0)


def _residual_scatter(
    measured: Measured,
    machine: Machine,
    posed: Posed,
    estimate: _Estimate,
    effects: Sequence[Effect],
) -> Scatter | None:
    """σ of one reading from the residuals; for raw data from all of them, whatever the method."""
    if not isinstance(measured, Readings):
        return scatter_of_residuals(posed.problem, estimate.slope, estimate.residual)
    model = simulate(machine, estimate.offsets, measured.plan, effects)
    residual = without_zeros(measured.plan, measured.value - model)
    dof = len(measured) - measured.plan.setups - 3
    return Scatter(float(np.sqrt(residual @ residual / dof)), dof) if dof > 0 else None


def _fit_quality(
    measured: Measured,
    machine: Machine,
    posed: Posed,
    estimate: _Estimate,
    effects: Sequence[Effect],
) -> tuple[float, float, Floats | None]:
    """r.m.s. before and after [mm], and the predicted readings with fitted zeros (n,)."""

    def rms(values: Floats) -> float:
        return float(np.sqrt(np.mean(values**2)))

    if not isinstance(measured, Readings):
        # Of the printed differences, as in Table 4.
        return rms(posed.data), rms(estimate.residual), None
    models = simulate(machine, np.stack((np.zeros(3), estimate.offsets)), measured.plan, effects)
    zeros = np.linalg.lstsq(measured.plan.zeros, (measured.value - models).T, rcond=None)[0]
    before, after = models + (measured.plan.zeros @ zeros).T
    return rms(measured.value - before), rms(measured.value - after), after


def _table(
    measured: Measured, machine: Machine, offsets: Floats, effects: Sequence[Effect]
) -> tuple[TableRow, ...]:
    """Rows of the expected-improvement table (Table 4), from the nonlinear model."""
    if isinstance(measured, Readings):
        kind = "six" if np.all(measured.plan.contact == Contact.FIXED) else "single"
    else:
        kind = "single" if measured.kind == "single" else "six"
    posed = pose_differences(measured, machine, kind, effects)
    modelled = posed.problem.model(offsets)
    return tuple(
        TableRow(name, float(value), float(model))
        for name, value, model in zip(posed.names, posed.data, modelled, strict=True)
    )


def _warnings(measured: Measured, residuals: Scatter | None, machine: Machine) -> tuple[str, ...]:
    warnings = list(measured.remarks)
    floor = machine.gauge.rounding_mm
    if residuals is not None and residuals.sigma_mm < floor:
        warnings.append(
            "The residuals are smaller than the gauge's resolution allows"
            f" ({floor:.2g} mm); the intervals use the resolution."
        )
    return tuple(warnings)
