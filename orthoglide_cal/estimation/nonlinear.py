"""Nonlinear least squares of eq. (25), batched: one call solves many sessions at once.

Gauss–Newton with Levenberg–Marquardt damping where a step does not help. The exact Jacobian
of the forward model is used, not the one of eqs. (16), (17), which holds at zero offsets only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.estimation.problem import OPTIMAL_MM, Problem, normal_step

MAX_ITERATIONS = 60
# Sessions solved together: few enough that their arrays stay in the processor's cache.
BLOCK = 1024
# A step shorter than this ends the iteration [mm].
SHORT_STEP_MM = 1e-10
# Relative rounding of a sum of squares: near the optimum a good step may seem this much worse.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Fit:
    """Offsets of a batch of sessions.

    Attributes:
        offsets_mm: shape (..., 3).
        residuals_mm: d − R·h, shape (..., k).
        remaining_mm: optimality check, shape (...); see `Problem.remaining_step`.
        iterations: shape (...).
    """

    offsets_mm: Floats
    residuals_mm: Floats
    remaining_mm: Floats
    iterations: Ints

    @property
    def converged(self) -> np.ndarray:
        """True where the recomputed optimality holds, shape (...)."""
        return np.asarray(self.remaining_mm <= OPTIMAL_MM)


def fit_offsets(problem: Problem, data: Floats, start: Floats | None = None) -> Fit:
    """Minimise |d − R·h(Δρ)|² for each data set.

    Args:
        problem: the common problem, of full rank.
        data: d, shape (..., k) [mm].
        start: first offsets, shape (..., 3) [mm]; zero if None.

    Returns:
        The fit; look at `converged` before using a number of it.
    """
    batch = data.shape[:-1]
    flat = data.reshape(-1, data.shape[-1])
    first = np.zeros((len(flat), 3)) if start is None else start.reshape(-1, 3)
    parts = [
        _fit_block(problem, flat[k : k + BLOCK], first[k : k + BLOCK])
        for k in range(0, len(flat), BLOCK)
    ]
    offsets, residuals, remaining, iterations = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return Fit(
        offsets.reshape(*batch, 3),
        residuals.reshape(data.shape),
        remaining.reshape(batch),
        iterations.reshape(batch),
    )


def _fit_block(
    problem: Problem, data: Floats, offsets: Floats
) -> tuple[Floats, Floats, Floats, Ints]:
    def evaluate(at: Floats) -> tuple[Floats, Floats, Floats]:
        model, slope = problem.model_with_jacobian(at, strict=False)
        residual = data - model
        return residual, slope, (residual**2).sum(axis=-1)

    residual, slope, cost = evaluate(offsets)
    damping = np.zeros(len(data))
    iterations = np.zeros(len(data), dtype=np.intp)
    done = np.zeros(len(data), dtype=bool)
    for _ in range(MAX_ITERATIONS):
        step = normal_step(slope, residual, damping)
        short = np.abs(step).max(axis=-1) <= SHORT_STEP_MM
        iterations += ~done
        done |= short
        if np.all(done):
            break
        trial = offsets + step
        new_residual, new_slope, new_cost = evaluate(trial)
        # A NaN cost (posture out of reach) compares false and is refused like a worse one.
        better = new_cost <= cost * (1.0 + ROUNDING)
        if np.all(better):
            offsets, residual, slope, cost = trial, new_residual, new_slope, new_cost
            damping /= 10.0
        else:
            offsets = np.where(better[:, None], trial, offsets)
            residual = np.where(better[:, None], new_residual, residual)
            slope = np.where(better[:, None, None], new_slope, slope)
            cost = np.where(better, new_cost, cost)
            damping = np.where(better, damping / 10.0, np.maximum(10.0 * damping, 1e-3))
        damping[damping < 1e-6] = 0.0
    remaining = np.abs(normal_step(slope, residual)).max(axis=-1)
    return offsets, residual, remaining, iterations
