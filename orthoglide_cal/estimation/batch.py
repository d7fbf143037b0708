"""Many sessions of one plan solved in one call, with the intervals of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.accuracy import half_width, unit_covariance
from orthoglide_cal.estimation.identifiability import require_rank
from orthoglide_cal.estimation.nonlinear import fit_offsets
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import NAMES, cell_contrasts, reduction, without_zeros, zero_free
from orthoglide_cal.simulation import simulate


@dataclass(frozen=True, eq=False)
class Batch:
    """Solutions of many sessions; look at `converged` before using a number.

    Attributes:
        offsets_mm: Δρ, shape (..., 3).
        std_mm: standard deviations, shape (..., 3).
        interval_mm: 95 % Student-t intervals, shape (..., 3, 2).
        sigma_mm: standard deviation of one reading from the residuals, not below the gauge's
            resolution allows, shape (...).
        converged: optimality recomputed from the data holds, shape (...).
    """

    offsets_mm: Floats
    std_mm: Floats
    interval_mm: Floats
    sigma_mm: Floats
    converged: np.ndarray


def solve_many(
    machine: Machine,
    plan: Plan,
    values: Floats,
    method: str = "readings",
    effects: Sequence[Effect] = (),
) -> Batch:
    """Identify the joint offsets of many sessions that share a plan.

    Args:
        machine: nominal machine and its gauge.
        plan: n readings; more than its set-ups and offsets together.
        values: readings, shape (..., n) [mm].
        method: "readings", "six" or "twelve".
        effects: known departures from the nominal machine.

    Raises:
        UsageError: another method, or no spare readings for the intervals.
        RankDeficientError: the plan does not determine the offsets.
    """
    if method not in ("readings", "six", "twelve"):
        raise UsageError(f"{method!r} does not solve batches.", "Use readings, six or twelve.")
    dof = len(plan) - plan.setups - 3
    if dof < 1:
        raise UsageError("These readings leave none to spare.", "Repeat them.")
    if method != "readings":
        matrix = _complete(machine, plan, method)
    else:
        matrix = zero_free(plan) if effects else cell_contrasts(plan)
    problem = Problem(machine, plan, matrix, effects)
    require_rank(problem)
    fit = fit_offsets(problem, values @ matrix.T)
    spare = without_zeros(plan, values - simulate(machine, fit.offsets_mm, plan, effects))
    sigma = np.sqrt((spare**2).sum(axis=-1) / dof)
    sigma = np.maximum(sigma, machine.gauge.rounding_mm)
    slope = problem.model_with_jacobian(fit.offsets_mm, strict=False)[1]
    covariance = unit_covariance(problem, slope)
    std = sigma[..., None] * np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    reach = half_width(dof) * std
    return Batch(
        fit.offsets_mm,
        std,
        np.stack((fit.offsets_mm - reach, fit.offsets_mm + reach), axis=-1),
        sigma,
        fit.converged,
    )


def _complete(machine: Machine, plan: Plan, kind: str) -> Floats:
    """The reduction to those differences that the plan holds."""
    matrix = reduction(kind, NAMES[kind], machine, plan)
    return np.asarray(matrix[np.abs(matrix).sum(axis=1) > 0.0])
