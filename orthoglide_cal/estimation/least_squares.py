"""The estimation problem, and the one least squares that solves it, batched.

    minimise |d − R·h(Δρ)|² over the joint offsets Δρ        (eq. 25)

d are the data, h the predicted readings and R the reduction of the method: differences of
readings for the paper's methods, zero-free contrasts of all readings for `readings`.

Gauss–Newton with Levenberg–Marquardt damping where a step does not help; one call solves many
sessions. The exact Jacobian of the forward model is used, not the one of eqs. (16), (17), which
holds at zero offsets only.
"""

import functools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.estimation.gaussian import whiten, whiten_shared
from orthoglide_cal.model.model import Model, simulate, simulate_with_jacobian
from orthoglide_cal.model.plan import Contrasts, Floats, Ints, Plan, ReadOnly, Reduction, read_only

# A fit is an optimum if the step that is left is at most this [standard deviations].
OPTIMAL = 1e-3
MAX_ITERATIONS = 100
# An undamped step shorter than this ends the iteration [standard deviations]: where it can be had,
# no digit that is shown depends on where a search began.
SHORT_STEP = 1e-7
# Rounding of predicted differences of lengths around a metre [mm], and of a sum of squares.
ROUNDING_MM = 1e-12
ROUNDING = 1e-12
FIRST_DAMPING = 1e-3


@dataclass(frozen=True, eq=False)
class Problem(ReadOnly):
    """One estimation problem; many data sets may share it."""

    model: Model
    plan: Plan  # n readings
    matrix: Reduction  # R, shape (k, n)

    def predict(self, offsets: Floats) -> Floats:
        """R·h(Δρ), offsets (..., 3) → (..., k) [mm]."""
        return np.asarray(simulate(self.model, offsets, self.plan) @ self.matrix.T)

    def predict_with_jacobian(self, offsets: Floats, strict: bool = True) -> tuple[Floats, Floats]:
        """R·h and R·∂h/∂Δρ: offsets (..., 3) → (..., k) [mm], (..., k, 3).

        Where a posture cannot be taken: an error if `strict`, NaN otherwise.
        """
        plan, matrix = self.plan, self.matrix
        if offsets.size == offsets.shape[-1]:
            point = simulate_at(self.model, offsets.reshape(-1), plan, strict)
            readings, jacobian = (np.reshape(a, (*offsets.shape[:-1], *a.shape)) for a in point)
        else:
            readings, jacobian = simulate_with_jacobian(self.model, offsets, plan, strict)
        return np.asarray(readings @ matrix.T), np.asarray(matrix @ jacobian)

    @cached_property
    def at_zero(self) -> tuple[Floats, Floats]:
        """`predict_with_jacobian` at zero offsets, read-only: (k,) [mm], (k, 3)."""
        zero = np.zeros(len(self.model.machine.parameter_names))
        predicted, jacobian = self.predict_with_jacobian(zero)
        return read_only(predicted), read_only(jacobian)

    def covariance(self) -> Floats:
        """R Rᵀ: covariance of the data for unit variance of a common reading (eqs. 28, 31), (k, k).

        Of differences: contrasts are independent.
        """
        return self.spread(np.eye(len(self.matrix)))

    def spread(self, estimator: Floats) -> Floats:
        """M R Rᵀ Mᵀ: the same of what an estimator M (..., p, k) makes of the data, (..., p, p)."""
        moved = (estimator @ self.matrix) / self.plan.precision
        return np.asarray(moved @ moved.swapaxes(-1, -2))

    def whitened(self, ratio: Floats, *values: Floats) -> tuple[Floats, ...]:
        """Values, each (k,) or (k, q), made independent if their covariance is R Rᵀ + C Cᵀ.

        `ratio` is C, shape (k, c), in standard deviations of one reading.
        """
        if not isinstance(self.matrix, Contrasts):
            return whiten(self.covariance() + ratio @ ratio.T, *values)
        return whiten_shared(ratio, *values)

    def remaining(self, data: Floats, offsets: Floats) -> Floats:
        """Distance of the offsets from the least-squares optimum, recomputed from the data.

        |J s|/σ of the Gauss–Newton step s = (JᵀJ)⁻¹Jᵀr that would still be taken, with the stated
        noise σ: no offset would move by more than as many of its standard deviations. Zero at a
        stationary point of eq. (25), NaN where the model cannot be evaluated.

        Data (..., k) [mm], offsets (..., 3) [mm] → (...) [standard deviations].
        """
        predicted, jacobian = self.predict_with_jacobian(offsets, strict=False)
        return self.length(jacobian, normal_step(jacobian, data - predicted))

    def length(self, jacobian: Floats, step: Floats) -> Floats:
        """|J s|/σ of steps: (..., k, 3), (..., 3) → (...) [standard deviations]."""
        moved = np.einsum("...kp,...p->...k", jacobian, step)
        noise = self.model.machine.instrument.noise_mm
        return np.asarray(np.sqrt(np.square(moved).sum(axis=-1)) / noise)


def simulate_at(
    model: Model, offsets: Floats, plan: Plan, strict: bool = True
) -> tuple[Floats, Floats]:
    """`simulate_with_jacobian` at one point (3,), kept for other weights and other sessions."""
    same = plan.steps if model.repeats else plan
    readings, jacobian = _simulate_at(model, tuple(offsets.tolist()), same)
    if strict and not np.isfinite(readings).all():
        simulate(model, offsets, plan)  # raises an error that says where
    return readings, jacobian


@functools.lru_cache(maxsize=8)
def _simulate_at(model: Model, offsets: tuple[float, ...], plan: Plan) -> tuple[Floats, Floats]:
    readings, jacobian = simulate_with_jacobian(model, np.array(offsets), plan, strict=False)
    return read_only(readings), read_only(jacobian)


def normal_step(jacobian: Floats, residual: Floats, damping: Floats | float = 0.0) -> Floats:
    """Solve (JᵀJ + λ diag JᵀJ) s = Jᵀr: (..., k, p), (..., k) → (..., p).

    NaN where the model cannot be evaluated.
    """
    turned = np.swapaxes(jacobian, -1, -2)
    normal, gradient = turned @ jacobian, turned @ residual[..., None]
    # Scaled, so that lengths and angles weigh alike.
    size = np.sqrt(np.einsum("...ii->...i", normal))
    unit = np.eye(jacobian.shape[-1])
    scaled = normal / (size[..., :, None] * size[..., None, :])
    scaled = scaled + np.asarray(damping)[..., None, None] * unit
    fine = np.isfinite(scaled).all(axis=(-1, -2), keepdims=True)
    solved = np.linalg.solve(np.where(fine, scaled, unit), gradient / size[..., None])
    return np.asarray(np.where(fine[..., 0], solved[..., 0] / size, np.nan))


@dataclass(frozen=True, eq=False)
class LeastSquaresFit(ReadOnly):
    """Offsets of a batch of sessions."""

    offsets_mm: Floats  # (..., 3)
    residuals_mm: Floats  # d − R·h, (..., k)
    remaining: Floats  # as of `Problem.remaining`, (...)
    iterations: Ints  # steps tried, (...)

    @property
    def converged(self) -> np.ndarray:
        """True where nothing is left of the step, shape (...); a NaN is no."""
        return np.asarray(self.remaining <= OPTIMAL)


# What fails on the way shows as NaN and is refused there; warnings would say nothing more.
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def fit_offsets(problem: Problem, data: Floats, start: Floats | None = None) -> LeastSquaresFit:
    """Minimise |d − R·h(Δρ)|² for each data set d, shape (..., k) [mm], of one problem.

    `start` are first offsets, shape (..., p) [mm]; zero if None. Look at `converged` before using a
    number of the fit.
    """
    batch, flat = data.shape[:-1], data.reshape(-1, data.shape[-1])
    model, slope = problem.at_zero
    count, width = len(flat), slope.shape[-1]
    first = np.zeros(width) if start is None else start.reshape(-1, width)
    if start is not None:
        model, slope = problem.predict_with_jacobian(first, strict=False)
    offsets = np.broadcast_to(first, (count, width)).copy()
    jacobian = np.broadcast_to(slope, (count, *slope.shape[-2:])).copy()
    residual, damping = flat - model, np.zeros(count)
    iterations = np.zeros(count, dtype=np.intp)
    step = normal_step(jacobian, residual)
    left = problem.length(jacobian, step)
    for _ in range(MAX_ITERATIONS):
        which = np.flatnonzero(left > SHORT_STEP)
        if not which.size:
            break
        if np.any(damping[which]):
            careful = which[damping[which] > 0.0]
            step[careful] = normal_step(jacobian[careful], residual[careful], damping[careful])
        trial = offsets[which] + step[which]
        model, slope = problem.predict_with_jacobian(trial, strict=False)
        after = flat[which] - model
        # A step whose gain is lost in rounding is taken; a NaN cost (posture out of reach)
        # compares false and is refused like a worse one.
        cost = (residual[which] ** 2).sum(axis=-1)
        slack = ROUNDING * cost + ROUNDING_MM * np.sqrt(cost)
        better = (after**2).sum(axis=-1) <= cost + slack
        moved = which[better]
        offsets[moved], residual[moved] = trial[better], after[better]
        jacobian[moved] = slope[better]
        step[moved] = normal_step(jacobian[moved], residual[moved])
        left[moved] = problem.length(jacobian[moved], step[moved])
        more = np.maximum(10.0 * damping[which], FIRST_DAMPING)
        less = damping[which] / 10.0
        damping[which] = np.where(better, np.where(less < FIRST_DAMPING, 0.0, less), more)
        iterations[which] += 1
    return LeastSquaresFit(
        offsets.reshape(*batch, width),
        residual.reshape(data.shape),
        left.reshape(batch),
        iterations.reshape(batch),
    )
