"""Nonlinear least squares of eq. (25), batched: one call solves many sessions at once.

Gauss–Newton with Levenberg–Marquardt damping where a step does not help. The exact Jacobian
of the forward model is used, not the one of eqs. (16), (17), which holds at zero offsets only.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.estimation.problem import OPTIMAL_MM, Problem, normal_step

MAX_ITERATIONS = 100
# Sessions solved together: few enough for the processor's cache, enough to outweigh Python.
BLOCK = 4096
# An undamped step shorter than this ends the iteration [mm]; well below OPTIMAL_MM.
SHORT_STEP_MM = 1e-10
# Rounding of predicted differences of lengths around a metre [mm], and of a sum of squares.
ROUNDING_MM = 1e-12
ROUNDING = 1e-12
FIRST_DAMPING = 1e-3


@dataclass(frozen=True, eq=False)
class Fit:
    """Offsets of a batch of sessions.

    Attributes:
        offsets_mm: shape (..., 3).
        residuals_mm: d − R·h, shape (..., k).
        remaining_mm: optimality check, shape (...); see `Problem.remaining_step`.
        iterations: steps tried, shape (...).
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
    # Sessions that start at the same offsets share their first evaluation.
    first = np.zeros((1, 3)) if start is None else start.reshape(-1, 3)
    shared = len(first) == 1

    def fit(at: int) -> tuple[Floats, Floats, Floats, Ints]:
        block = slice(at, at + BLOCK)
        return _fit_block(problem, flat[block], first if shared else first[block])

    offsets, residuals, remaining, iterations = (
        np.concatenate(part) for part in zip(*_in_parallel(fit, len(flat)), strict=True)
    )
    return Fit(
        offsets.reshape(*batch, 3),
        residuals.reshape(data.shape),
        remaining.reshape(batch),
        iterations.reshape(batch),
    )


def _in_parallel(fit: Callable[[int], Any], count: int) -> list[Any]:
    """The results of `fit` for each block; numpy lets go of the interpreter in long loops."""
    starts = range(0, count, BLOCK)
    if len(starts) <= 1:
        return [fit(0)]
    from concurrent.futures import ThreadPoolExecutor

    _hold_memory()
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(starts))) as pool:
        return list(pool.map(fit, starts))


def _hold_memory() -> None:
    """Make the C library keep freed memory: a third of the time went into fetching it anew.

    glibc returns free memory to the system above a threshold that grows to the largest block
    ever freed (mallopt(3), M_MMAP_THRESHOLD); the block below is never touched. Elsewhere this
    does nothing.
    """
    np.empty(31 << 20, dtype=np.uint8)


@dataclass(eq=False)
class _State:
    """Where the sessions still at work stand; the first axis runs over them."""

    which: Ints  # their places in the block
    data: Floats
    offsets: Floats
    residual: Floats
    slope: Floats
    damping: Floats

    def keep(self, mask: np.ndarray) -> None:
        """Go on with some of them."""
        for name in ("which", "data", "offsets", "residual", "slope", "damping"):
            setattr(self, name, _chosen(getattr(self, name), mask))

    def accept(self, better: np.ndarray, offsets: Floats, residual: Floats, slope: Floats) -> None:
        """Move those whose trial is better; damp the others more."""
        if np.all(better):
            self.offsets, self.residual, self.slope = offsets, residual, slope
        else:
            self.offsets = np.where(better[:, None], offsets, self.offsets)
            self.residual = np.where(better[:, None], residual, self.residual)
            self.slope = np.where(better[:, None, None], slope, self.slope)
        more = np.maximum(10.0 * self.damping, FIRST_DAMPING)
        self.damping = np.where(better, self.damping / 10.0, more)
        self.damping[self.damping < FIRST_DAMPING] = 0.0


def _chosen(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """values[mask], with the first axis still the fastest in memory."""
    return np.moveaxis(np.compress(mask, np.moveaxis(values, 0, -1), axis=-1), -1, 0)


# What fails on the way shows as NaN and is refused there; warnings would say nothing more.
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def _fit_block(
    problem: Problem, data: Floats, start: Floats
) -> tuple[Floats, Floats, Floats, Ints]:
    n = len(data)
    offsets = np.empty((n, 3))
    residuals = np.empty(data.shape)
    remaining = np.empty(n)
    iterations = np.zeros(n, dtype=np.intp)

    model, slope = problem.model_with_jacobian(start, strict=False)
    at = _State(
        which=np.arange(n),
        data=data,
        offsets=np.broadcast_to(start, (n, 3)),
        residual=data - model,
        slope=slope,
        damping=np.zeros(n),
    )
    for iteration in range(MAX_ITERATIONS + 1):
        newton = normal_step(at.slope, at.residual)
        size = np.abs(newton).max(axis=-1)
        open_ = (size > SHORT_STEP_MM) & (iteration < MAX_ITERATIONS)
        if not np.all(open_) or not n:
            done = ~open_
            offsets[at.which[done]] = at.offsets[done]
            residuals[at.which[done]] = at.residual[done]
            remaining[at.which[done]] = size[done]
            iterations[at.which[done]] = iteration
            if not np.any(open_):
                break
            at.slope = np.broadcast_to(at.slope, (len(done), *at.slope.shape[1:]))
            at.keep(open_)
            newton = _chosen(newton, open_)
        damped = at.damping > 0.0
        step = newton
        if np.any(damped):
            careful = normal_step(at.slope, at.residual, at.damping)
            step = np.where(damped[:, None], careful, newton)
        trial = at.offsets + step
        model, slope = problem.model_with_jacobian(trial, strict=False)
        residual = at.data - model
        # A step whose gain is lost in rounding is taken; a NaN cost (posture out of reach)
        # compares false and is refused like a worse one.
        cost = (at.residual**2).sum(axis=-1)
        slack = ROUNDING * cost + ROUNDING_MM * np.sqrt(cost)
        better = (residual**2).sum(axis=-1) <= cost + slack
        at.accept(better, trial, residual, slope)
    return offsets, residuals, remaining, iterations
