"""The estimation problem, the methods that pose it, and the one least squares that solves it.

    minimise |d − R·h(Δρ)|² over the joint offsets Δρ        (eq. 25)

d are the data, h the predicted readings and R the reduction of the method: differences of
readings for the paper's methods, zero-free contrasts of all readings for `readings`.

Gauss–Newton with Levenberg–Marquardt damping where a step does not help; one call solves many
sessions. The exact Jacobian of the forward model is used, not the one of eqs. (16), (17), which
holds at zero offsets only.

single            eq. 10, pseudoinverse              single-posture differences
single-sequential eq. 11, one offset after the other
six-linear        eq. 17, pseudoinverse              max − min
twelve-linear     eq. 16, pseudoinverse              max − iso, min − iso
six, twelve       eq. 25, nonlinear least squares on the same differences
readings          all raw readings at once, one unknown zero per gauge set-up
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation.gaussian import shrinking, whiten, whiten_shared
from orthoglide_cal.model.contrasts import Contrasts, Reduction, zero_free
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference, Measured, Readings
from orthoglide_cal.model.model import Model, differentiate, simulate
from orthoglide_cal.model.orthoglide import ideal_plan, reduction
from orthoglide_cal.model.plan import Floats, Plan, ReadOnly, read_only
from orthoglide_cal.model.readings import Posture

# A fit is an optimum if the step that is left is at most this [standard deviations].
OPTIMAL = 1e-3
MAX_ITERATIONS = 100
# An undamped step shorter than this is the last one [standard deviations]: over it the model is as
# good as linear, so that no digit that is shown depends on where a search began.
SHORT_STEP = 1e-5
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
    which: tuple[Difference, ...] = ()  # differences that its data are, if they are any

    def weighted(self, ratio: Floats) -> Problem:
        """The same of contrasts whose covariance is σ² (I + C Cᵀ/σ²), made independent.

        `ratio` is C/σ, what else is uncertain of the data, shape (k, p).
        """
        matrix, (axes, factors) = self.matrix, shrinking(ratio)
        assert isinstance(matrix, Contrasts)
        return replace(self, matrix=replace(matrix, axes=axes, factors=factors))

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
            readings, jacobian = differentiate(self.model, offsets, plan, strict=strict)
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
    """`differentiate` at one point (3,), kept for other weights and other sessions."""
    same = plan.steps if model.repeats else plan
    readings, jacobian = _simulate_at(model, tuple(offsets.tolist()), same)
    if strict and not np.isfinite(readings).all():
        simulate(model, offsets, plan)  # raises an error that says where
    return readings, jacobian


@functools.lru_cache(maxsize=8)
def _simulate_at(model: Model, offsets: tuple[float, ...], plan: Plan) -> tuple[Floats, Floats]:
    readings, jacobian = differentiate(model, np.array(offsets), plan, strict=False)
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
    remaining: Floats  # as of `Problem.remaining`, before the last short step, (...)

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
    count, width = len(flat), len(problem.model.machine.parameter_names)
    first = np.zeros((1, width)) if start is None else start.reshape(-1, width)
    if start is None:
        model, slope = problem.at_zero
    else:
        model, slope = problem.predict_with_jacobian(first, strict=False)
    offsets = np.broadcast_to(first, (count, width)).copy()
    jacobian = np.broadcast_to(slope, (count, *slope.shape[-2:])).copy()
    residual, damping = flat - model, np.zeros(count)
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
    last = np.where(left <= SHORT_STEP, step.T, 0.0).T
    offsets += last
    residual -= (jacobian @ last[..., None])[..., 0]
    return LeastSquaresFit(
        offsets.reshape(*batch, width),
        residual.reshape(data.shape),
        left.reshape(batch),
    )


DESCRIPTIONS = {
    DataKind.READINGS: "raw readings",
    DataKind.SIX: "six differences (max − min)",
    DataKind.TWELVE: "twelve differences (relative to iso)",
    DataKind.SINGLE: "single-posture differences",
}


class Method(StrEnum):
    """An estimator, by the name that users know."""

    SINGLE = "single"
    SINGLE_SEQUENTIAL = "single-sequential"
    SIX_LINEAR = "six-linear"
    TWELVE_LINEAR = "twelve-linear"
    SIX = "six"
    TWELVE = "twelve"
    READINGS = "readings"

    @property
    def uses(self) -> DataKind:
        """Data that it compares with the model: all readings, or differences of them."""
        return DataKind(self.partition("-")[0])

    @property
    def linear(self) -> bool:
        """True if it solves with the Jacobian at zero offsets instead of iterating."""
        return self not in (Method.SIX, Method.TWELVE, Method.READINGS)

    def estimator(self, problem: Problem) -> Floats:
        """M of a linear method, Δρ = M d with the Jacobian J at zero offsets, shape (3, k).

        (JᵀJ)⁻¹Jᵀ (eqs. 10, 16, 17), or one offset after the other (eq. 11).

        Raises:
            UnusableResultError: eq. (11) lacks one of its six differences.
        """
        jacobian = problem.at_zero[1]
        if self is Method.SINGLE_SEQUENTIAL:
            return _sequential(jacobian, problem.which)
        return np.asarray(np.linalg.pinv(jacobian), dtype=np.float64)


def choose_method(measured: Measured, name: str | None) -> Method:
    """The method asked for, or the default for this kind of data.

    Raises:
        UsageError: unknown name, or a method that these data cannot feed.
    """
    if name is None:
        return Method(measured.kind)
    if name not in list(Method):
        raise UsageError(f"There is no method {name!r}.", f"Choose one of {', '.join(Method)}.")
    usable = [method for method in Method if method.uses in measured.kinds]
    if name not in usable:
        raise UsageError(
            f"Method {name} cannot use {DESCRIPTIONS[measured.kind]}.",
            f"Choose one of {', '.join(usable)}.",
        )
    return Method(name)


def table_kind(measured: Measured) -> DataKind:
    """The differences in which results are shown: those of Table 4, or single-posture ones."""
    return DataKind.SIX if DataKind.SIX in measured.kinds else DataKind.SINGLE


@functools.lru_cache(maxsize=8)
def pose_plan(plan: Plan, model: Model, kind: DataKind) -> Problem:
    """The problem that a method makes of readings, whatever these will be.

    Differences that the plan lacks are left out.
    """
    if kind is DataKind.READINGS:
        return Problem(model, plan, zero_free(plan))
    wanted = DIFFERENCES[kind]
    matrix = reduction(kind, wanted, model.machine, plan.steps)
    present = np.abs(matrix).sum(axis=1) > 0.0
    kept = tuple(difference for difference, ok in zip(wanted, present, strict=True) if ok)
    return Problem(model, plan, matrix[present], kept)


def pose(measured: Measured, model: Model, kind: DataKind) -> tuple[Problem, Floats]:
    """Reduce the data to what is compared with the model, of a kind that can be made of them.

    The problem, and its data (k,) [mm]. Differences that they lack are left out.
    """
    if isinstance(measured, Readings):
        problem = pose_plan(measured.plan, model, kind)
        return problem, problem.matrix @ measured.value
    wanted = DIFFERENCES[kind]
    values = dict(zip(measured.which, measured.value.tolist(), strict=True))
    if measured.kind is DataKind.TWELVE and kind is DataKind.SIX:
        ends = [(Difference(s, Posture.MAX), Difference(s, Posture.MIN)) for s, _ in wanted]
        values = {
            six: values[high] - values[low]
            for six, (high, low) in zip(wanted, ends, strict=True)
            if high in values and low in values
        }
    kept = tuple(difference for difference in wanted if difference in values)
    # The readings behind the printed differences: one of each cell, so that a difference of
    # the twelve shares its isotropic reading with its partner (errata, eq. 30).
    plan = ideal_plan(measured.kind, model.machine)
    problem = Problem(model, plan, reduction(kind, kept, model.machine, plan), kept)
    return problem, np.array([values[difference] for difference in kept])


def _sequential(jacobian: Floats, which: Sequence[Difference]) -> Floats:
    """M of eq. (11): Δρ_z from the isotropic posture, then Δρ_x and Δρ_y, shape (3, 6).

        Δρ_z = (Δz_x0 + Δz_y0)/2,  Δρ_i = Σ_k a_k (Δz_i^k − Δρ_z)/Σ_k a_k²,  k = max, min

    These are three weighted sums W d = W J Δρ of the differences, solved for the offsets. Written
    so, it also holds where accepted causes couple the isotropic differences with Δρ_x and Δρ_y.

    Args:
        jacobian: Jacobian at zero offsets, shape (6, 3).
        which: the differences of its rows.
    """
    needed = DIFFERENCES[DataKind.SINGLE]
    missing = [difference.name for difference in needed if difference not in which]
    if missing:
        raise UnusableResultError(
            f"Eq. (11) needs all six differences; {', '.join(missing)} missing.",
            "Measure them, or use --method single.",
        )
    at_iso, moved = needed[:2], (needed[2:4], needed[4:])
    weights = np.zeros((3, len(which)))
    weights[2, [which.index(difference) for difference in at_iso]] = 1.0
    for axis, pair in enumerate(moved):
        rows = [which.index(difference) for difference in pair]
        weights[axis, rows] = jacobian[rows, axis]
    return np.asarray(np.linalg.solve(weights @ jacobian, weights), dtype=np.float64)
