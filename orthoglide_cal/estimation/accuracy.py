"""How sure the offsets are: covariance (eqs. 26–33), σ from three sources, intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, stdtrit

from orthoglide_cal.axes import Floats
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.plan import Plan

CONFIDENCE = 0.95


def unit_covariance(problem: Problem, slope: Floats, estimator: Floats | None = None) -> Floats:
    """V(Δρ)/σ² = M G Mᵀ with G = R Rᵀ (eqs. 26, 29, 32), shape (..., 3, 3).

    Args:
        problem: gives G.
        slope: J at the solution, shape (..., k, 3).
        estimator: M, shape (..., 3, k); (JᵀJ)⁻¹Jᵀ if None.
    """
    matrix = np.linalg.pinv(slope) if estimator is None else estimator
    return np.asarray(matrix @ problem.covariance() @ matrix.swapaxes(-1, -2))


def sigma_rho(covariance: Floats) -> float:
    """σ_ρ = √(trace V / 3) (eq. 33), in the unit of √V."""
    return float(np.sqrt(np.trace(covariance) / 3.0))


@dataclass(frozen=True)
class Scatter:
    """A standard deviation of one reading [mm] and its (effective) degrees of freedom."""

    sigma_mm: float
    dof: float


def scatter_of_residuals(problem: Problem, slope: Floats, residual: Floats) -> Scatter | None:
    """σ of one reading from the residuals of differences; None without degrees of freedom.

    E(rᵀr) = σ² tr(P G) with P the projector onto what the offsets cannot explain; the degrees
    of freedom tr(PG)²/tr((PG)²) are Satterthwaite's, exact where G is a multiple of I.
    """
    projector = np.eye(len(residual)) - slope @ np.linalg.pinv(slope)
    spread = projector @ problem.covariance()
    trace = float(np.trace(spread))
    if trace < 1e-9:
        return None
    dof = trace**2 / float(np.trace(spread @ spread))
    return Scatter(float(np.sqrt(residual @ residual / trace)), dof)


def scatter_of_repeats(plan: Plan, values: Floats) -> Scatter | None:
    """σ from readings that repeat each other in one gauge set-up; None without repeats.

    Repeats in sequence share one set-up, so this may understate the real scatter.

    Args:
        plan: n readings.
        values: shape (n,) [mm].
    """
    keys = np.stack((plan.setup, plan.displacement, plan.contact), axis=1)
    _, cell = np.unique(keys, axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)
    dof = int(len(plan) - count.size)
    if dof == 0:
        return None
    mean = np.bincount(cell, weights=values) / count
    return Scatter(float(np.sqrt(((values - mean[cell]) ** 2).sum() / dof)), float(dof))


def half_width(dof: float, confidence: float = CONFIDENCE) -> float:
    """Student-t factor of a two-sided interval; the normal one for infinite dof."""
    return float(stdtrit(min(dof, 1e9), 0.5 + confidence / 2.0))


def chance_of_residual(sum_of_squares: float, dof: float, sigma_mm: float) -> float:
    """Probability that noise of σ alone leaves a larger residual sum of squares (χ² test)."""
    return float(chdtrc(dof, sum_of_squares / sigma_mm**2))
