"""Lead from measured data to joint offsets: the problem, the methods that pose it, its solution.

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
readings          all raw readings at once, one unknown zero per gauge set-up: the fit of the
                  empty hypothesis (`inference.alone`)
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from itertools import compress
from typing import NoReturn

import numpy as np
from pydantic import Field
from scipy.special import chdtrc

from orthoglide_cal.causes import UNLISTED
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation.budget import (
    Budget,
    Scatter,
    budget_of,
    fixed_influences,
    half_width,
    influences,
)
from orthoglide_cal.estimation.gaussian import shrink, unexplained, whiten, whiten_shared
from orthoglide_cal.losses import MISSED_FAULT, surprising
from orthoglide_cal.model.machine import Machine, Origin
from orthoglide_cal.model.measured import (
    DIFFERENCES,
    DataKind,
    Difference,
    Differences,
    Measured,
    Readings,
)
from orthoglide_cal.model.model import NORMAL_K, Effect, Model, differentiate, simulate
from orthoglide_cal.model.orthoglide import ideal_plan, reduction
from orthoglide_cal.model.plan import Bools, Floats, Numbers, Plan, ReadOnly, altered, read_only
from orthoglide_cal.model.readings import Posture
from orthoglide_cal.schema import Schema

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
# Singular values below this fraction of the sensitivity of a good plan count as zero.
NEGLIGIBLE = 1e-6


def suspicious(machine: Machine) -> float:
    """The chance below which residuals are called larger than noise."""
    return surprising(UNLISTED / (1.0 - UNLISTED), MISSED_FAULT, machine.needless_hold)


# Nobody measures twice at the same pace: standard deviation of its ratio, assumed.
PACE = 0.1


@dataclass(frozen=True, eq=False)
class Contrasts(ReadOnly):
    """W of shape (k, n), as what it does to readings: combinations that no zero enters.

        W y = D (Qᵀ F y)[s:],   D = I − U diag(1 − f) Uᵀ,   Q = I − V T Vᵀ

    F takes the readings as precise as they are. Q is orthogonal, and its first s columns span the
    zeros (Householder). It costs n·s steps and numbers instead of n².
    """

    zeros: Floats  # s columns that span the zeros, orthonormal, (n, s)
    precision: Floats  # of each reading, shape (n,)
    # U, orthonormal columns, (k, q), and f, (q,), as of `shrinking`; None where D = I.
    shrunk: tuple[Floats, Floats] | None = None
    turned: bool = False  # Wᵀ instead, of shape (n, k)

    # Arrays leave `values @ W` to this class.
    __array_ufunc__ = None

    @cached_property
    def _reflected(self) -> tuple[Floats, Floats]:
        """V, shape (n, s), and the last k rows of V Tᵀ, shape (k, s)."""
        width = self.zeros.shape[1]
        packed, _ = np.linalg.qr(self.zeros, mode="raw")
        v = np.tril(packed.T, -1)
        v[np.arange(width), np.arange(width)] = 1.0
        inner = v.T @ v
        t = np.linalg.inv(np.triu(inner, 1) + np.diag(0.5 * np.diag(inner)))
        return read_only(v), read_only(v[width:] @ t.T)

    def __len__(self) -> int:
        return len(self.zeros) - int(self.zeros.shape[1])

    @property
    def T(self) -> Contrasts:
        return altered(self, turned=not self.turned, _reflected=self._reflected)

    def __matmul__(self, values: Floats) -> Floats:
        """W y of readings (n,), or of columns (..., n, q); Wᵀ d of data if it is turned."""
        if values.ndim == 1:
            return np.asarray((self @ values[:, None])[:, 0])
        v, last = self._reflected
        width, precision = v.shape[1], self.precision[:, None]
        if self.turned:
            values = self._weighed(values)
            spread = -v @ (last.T @ values)
            spread[..., width:, :] += values
            spread *= precision
            return np.asarray(spread)
        values = precision * values
        inner = v.T @ values
        values = values[..., width:, :]
        values -= last @ inner
        return self._weighed(values)

    def __rmatmul__(self, values: Floats) -> Floats:
        """Y W of rows (..., q, k), or of one row (k,)."""
        if values.ndim == 1:
            return self.T @ values
        return np.asarray(np.swapaxes(self.T @ np.swapaxes(values, -1, -2), -1, -2))

    def _weighed(self, values: Floats) -> Floats:
        """D d of columns (..., k, q)."""
        return shrink(values, *self.shrunk) if self.shrunk else values


# What reduces readings (n,) to data (k,): a few differences, or contrasts of all of them.
Reduction = Floats | Contrasts


@functools.lru_cache(maxsize=8)
def zero_free(plan: Plan) -> Contrasts:
    """Contrasts that no zero enters, of independent, equal noise, shape (n − setups, n).

    Orthonormal where all readings are equally precise. Least squares on the contrasts is
    generalised least squares on the readings with one unknown zero per set-up.
    """
    if plan is not plan.steps:
        return zero_free(plan.steps)
    return Contrasts(np.linalg.qr(plan.precision[:, None] * plan.zeros)[0], plan.precision)


def without_zeros(plan: Plan, values: Floats) -> Floats:
    """Values (..., n) less what gauge zeros can explain: the mean of their set-up."""
    zeros, _ = np.linalg.qr(plan.zeros)
    return np.asarray(values - (values @ zeros) @ zeros.T)


@dataclass(frozen=True, eq=False)
class Problem(ReadOnly):
    """One estimation problem; many data sets may share it."""

    model: Model
    plan: Plan  # n readings
    matrix: Reduction  # R, shape (k, n)
    which: tuple[Difference, ...] = ()  # differences that its data are, if they are any

    def only(self, rows: Bools) -> Problem:
        """The same of some of its k differences."""
        which = tuple(compress(self.which, rows))
        return replace(self, matrix=np.asarray(self.matrix)[rows], which=which)

    def weighted(self, shrunk: tuple[Floats, Floats]) -> Problem:
        """The same of contrasts of which only a few unknowns are in common: see `shrinking`.

        Its data are made independent as `shrink` makes values.
        """
        assert isinstance(self.matrix, Contrasts)
        return replace(self, matrix=altered(self.matrix, shrunk=shrunk))

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
        """R Rᵀ: covariance of differences for unit variance of a reading (eqs. 28, 31), (k, k)."""
        return self.spread(np.eye(len(self.matrix)))

    def spread(self, estimator: Numbers) -> Floats:
        """M R Rᵀ Mᵀ: the same of what an estimator M (..., p, k) makes of the data, (..., p, p).

        V(Δρ)/σ² where M = (JᵀJ)⁻¹Jᵀ, of J at the solution (eqs. 26, 29, 32).
        """
        moved = (estimator @ self.matrix) / self.plan.precision
        return np.asarray(moved @ moved.swapaxes(-1, -2))

    def whitened(self, ratio: Floats, *values: Floats) -> tuple[Floats, ...]:
        """Values, (k,) or (k, q), of covariance R Rᵀ + C Cᵀ, C (k, c) in σ, made independent."""
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
    converged: Bools  # where nothing is left of the step, as of `Problem.remaining`, (...)


# What fails on the way shows as NaN and is refused there; warnings would say nothing more.
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def fit_offsets(problem: Problem, data: Floats, start: Floats | None = None) -> LeastSquaresFit:
    """Minimise |d − R·h(Δρ)|² for each data set d, shape (..., k) [mm], of one problem.

    From `start`, (..., p) [mm], or zero. Look at `converged` before using a number of the fit.
    """
    batch, flat = data.shape[:-1], data.reshape(-1, data.shape[-1])
    count, width = len(flat), len(problem.model.machine.parameter_names)
    first = np.zeros((1, width)) if start is None else start.reshape(-1, width)
    model, slope = (
        problem.at_zero if start is None else problem.predict_with_jacobian(first, strict=False)
    )
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
        less = np.where(damping[which] < 10.0 * FIRST_DAMPING, 0.0, damping[which] / 10.0)
        damping[which] = np.where(better, less, np.maximum(10.0 * damping[which], FIRST_DAMPING))
    last = np.where(left <= SHORT_STEP, step.T, 0.0).T
    offsets += last
    residual -= (jacobian @ last[..., None])[..., 0]
    converged = (left <= OPTIMAL).reshape(batch)
    return LeastSquaresFit(offsets.reshape(*batch, width), residual.reshape(data.shape), converged)


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

        (JᵀJ)⁻¹Jᵀ (eqs. 10, 16, 17), or one offset after the other (eq. 11); raises
        UnusableResultError: this lacks one of its six differences.
        """
        jacobian = problem.at_zero[1]
        if self is Method.SINGLE_SEQUENTIAL:
            return _sequential(jacobian, problem.which)
        return np.asarray(np.linalg.pinv(jacobian), dtype=np.float64)


def choose_method(measured: Measured, name: str | None) -> Method:
    """The method of this name, or the default; raises UsageError: not one for these data."""
    if name is None:
        return Method(measured.kind)
    usable = [method for method in Method if method.uses in measured.kinds]
    if name in usable:
        return Method(name)
    fault = f"There is no method {name!r}."
    if name in list(Method):
        fault = f"Method {name} cannot use data of the kind {measured.kind}."
    raise UsageError(fault, f"Choose one of {', '.join(usable)}.")


def table_kind(measured: Measured) -> DataKind:
    """The differences in which results are shown: those of Table 4, or single-posture ones."""
    return DataKind.SIX if DataKind.SIX in measured.kinds else DataKind.SINGLE


@functools.lru_cache(maxsize=8)
def pose_plan(plan: Plan, model: Model, kind: DataKind) -> Problem:
    """The problem that a method makes of readings, without differences that the plan lacks."""
    if kind is DataKind.READINGS:
        return Problem(model, plan, zero_free(plan))
    wanted = DIFFERENCES[kind]
    matrix = reduction(kind, wanted, model.machine, plan.steps)
    return Problem(model, plan, matrix, wanted).only(np.abs(matrix).sum(axis=1) > 0.0)


def pose(measured: Measured, model: Model, kind: DataKind) -> tuple[Problem, Floats]:
    """The problem of a kind that the data can feed, without what they lack; its data (k,) [mm]."""
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

    These are three weighted sums W d = W J Δρ of the differences, J of shape (6, 3) at zero
    offsets, solved for the offsets. Written so, it also holds where accepted causes couple the
    isotropic differences with Δρ_x and Δρ_y.
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


def _free_directions(matrix: Floats, scale: float) -> Floats:
    """Offset directions that the rows of the matrix (k, 3) do not see, shape (m, 3)."""
    # Not fewer rows than columns: each direction has a singular value.
    padded = np.vstack((matrix, np.zeros((matrix.shape[1], matrix.shape[1]))))
    _, values, vectors = np.linalg.svd(padded, full_matrices=False)
    return np.asarray(vectors[values <= NEGLIGIBLE * scale])


@functools.lru_cache(maxsize=8)
def require_rank(problem: Problem) -> None:
    """Raise UnusableResultError if data do not determine all offsets, with readings that would."""
    matrix = problem.at_zero[1]
    free = _free_directions(matrix, float(np.abs(matrix).max(initial=0.0)) or 1.0)
    if len(free):
        _refuse(problem, np.abs(free).max(axis=0) > NEGLIGIBLE)


def require_determined(problem: Problem) -> None:
    """Raise UnusableResultError if data tell no more of a parameter than of any such machine.

    On the nominal machine with the stated noise: what a search must stand on.
    """
    machine, estimator = problem.model.machine, np.linalg.pinv(problem.at_zero[1])
    std = machine.instrument.noise_mm * np.sqrt(np.diag(problem.spread(estimator)))
    free = ~np.array(machine.determined(NORMAL_K * std))
    if free.any():
        _refuse(problem, free)


def require_optimum(problem: Problem, fit: LeastSquaresFit) -> LeastSquaresFit:
    """The fit; raises UnusableResultError: no optimum of the data, or of the first of several."""
    if not fit.converged.flat[0]:
        require_determined(problem)
        many = problem.model.machine.vocabulary.many
        raise UnusableResultError(
            f"No {many} fit these data: the search does not settle.",
            "Check the machine file and the readings; validate names every fault.",
        )
    return fit


def _refuse(problem: Problem, free: np.ndarray) -> NoReturn:
    """Raise UnusableResultError for `free` parameters (p,), with the fewest differences to add."""
    machine, matrix = problem.model.machine, problem.at_zero[1]
    fault = ", ".join(machine.parameter_symbols[i] for i in np.flatnonzero(free))
    fault = f"These readings do not determine {fault}."
    kind = DataKind.SIX if problem.plan.fixed else DataKind.SINGLE
    try:
        ideal = pose_plan(ideal_plan(kind, machine), Model(machine), kind)
    except UsageError as error:  # no differences of postures
        raise UnusableResultError(fault, machine.vocabulary.fewest) from error
    sensitivity = ideal.at_zero[1]
    scale, chosen = np.abs(sensitivity).max(), list[str]()
    while len(free := _free_directions(matrix, scale)):
        # The one that sees most of what no other does.
        best = int(np.argmax(np.linalg.norm(sensitivity @ free.T, axis=1)))
        series, posture = ideal.which[best]
        where = f"at {posture}, joint end and tool end"
        if posture is None:
            where = f"at {Posture.MAX} and {Posture.MIN} in one gauge set-up"
        chosen.append(f"{series.words}, {where}")
        matrix = np.vstack((matrix, sensitivity[best]))
    raise UnusableResultError(fault, f"Add readings of {'; '.join(chosen)}.")


def rms(values: Floats) -> float:
    """Root mean square, in the unit of the values."""
    return math.sqrt(np.vdot(values, values) / values.size)


def scatter_of_repeats(plan: Plan, values: Floats) -> Scatter | None:
    """σ from readings (n,) [mm] that repeat each other exactly; None without repeats.

    They share a gauge set-up, or a spot of the bed, so this may understate the real scatter.
    """
    cell = plan.repeats
    count = np.bincount(cell)
    dof = int(len(plan) - count.size)
    if dof == 0:
        return None
    mean = np.bincount(cell, weights=values) / count
    apart = plan.precision * (values - mean[cell])
    return Scatter(float(np.sqrt((apart**2).sum() / dof)), float(dof))


def chance_of_residual(sum_of_squares: float, dof: float, sigma_mm: float) -> float:
    """Chance that noise of σ alone leaves a larger sum of squares (χ² test); 1 without dof."""
    return float(chdtrc(dof, sum_of_squares / sigma_mm**2)) if dof > 0 else 1.0


@dataclass(frozen=True, eq=False)
class Solution(ReadOnly):
    """Joint offsets Δρ identified from one file; true joint position = indicated + Δρ."""

    model: Model  # the machine and its accepted causes, with their uncertainty
    offsets_mm: Floats  # that the controller does not know yet, shape (p,)
    budget: Budget  # where their uncertainty comes from
    noise: Scatter  # of one reading
    measured: Measured
    method: Method
    problem: Problem  # that was solved
    data: Floats  # its data, shape (k,) [mm]
    scatter: Scatter | None  # of one reading, from the residuals; None without degrees of freedom
    stated_mm: float  # of one reading, as stated, with what of a local shape is too fine to show

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return 0 if self.scatter is None else round(self.scatter.dof)

    @property
    def lack_of_fit_p(self) -> float:
        """Probability of a residual this large from noise alone; 1 without degrees of freedom."""
        if self.scatter is None:
            return 1.0
        sum_of_squares = self.scatter.dof * self.scatter.sigma_mm**2
        return chance_of_residual(sum_of_squares, self.scatter.dof, self.stated_mm)

    @cached_property
    def predicted_mm(self) -> Floats:
        """For each entry of the file, with fitted gauge zeros, shape (count,) [mm]."""
        measured, model = self.measured, self.model
        if isinstance(measured, Differences):
            every, _ = pose(measured, model, measured.kind)
            order = [every.which.index(difference) for difference in measured.which]
            return read_only(every.predict(self.offsets_mm)[order])
        readings, _ = simulate_at(model, self.offsets_mm, measured.plan)
        return read_only(measured.value - without_zeros(measured.plan, measured.value - readings))

    @property
    def residuals_mm(self) -> Floats:
        """Remainder of the data that the method compares, shape (k,)."""
        if self.method.linear:
            predicted, jacobian = self.problem.at_zero
            predicted = predicted + jacobian @ self.offsets_mm
        else:
            predicted, _ = self.problem.predict_with_jacobian(self.offsets_mm)
        return np.asarray(self.data - predicted)

    @property
    def rms_before_mm(self) -> float:
        """Root mean square with zero offsets: of differences themselves, as in Table 4."""
        if isinstance(self.measured, Differences):
            return rms(self.data)
        return replace(self, offsets_mm=0.0 * self.offsets_mm).rms_after_mm

    @property
    def rms_after_mm(self) -> float:
        """Root mean square of the residuals."""
        if isinstance(self.measured, Differences):
            return rms(self.residuals_mm)
        # Of readings that are less precise than most, as much less counts.
        return rms(self.measured.plan.precision * (self.measured.value - self.predicted_mm))

    @cached_property
    def converged(self) -> bool:
        """True if the offsets are the optimum of the data held here, recomputed; a NaN is no.

        A nonlinear method: by the step that it would still take. A linear one: by what its own
        estimator finds in its residual.
        """
        problem = self.problem
        if not self.method.linear:
            return bool(problem.remaining(self.data, self.offsets_mm) <= OPTIMAL)
        left = self.method.estimator(problem) @ self.residuals_mm / self.budget.std_mm
        return bool(np.abs(left).max() <= OPTIMAL)


def solve_by(method: Method, measured: Measured, model: Model) -> Solution:
    """Identify the joint offsets from differences of readings, as the paper has it.

    Raises UnusableResultError: the data do not determine the offsets, with what to add; no optimum
    was found; or no machine has these offsets.
    """
    problem, data = pose(measured, model, method.uses)
    require_rank(problem)
    if method.linear:
        # At zero offsets every gauge of the nominal machine reads zero; known causes do not.
        estimator = method.estimator(problem)
        offsets = estimator @ (data - problem.at_zero[0])
    else:
        offsets = require_optimum(problem, fit_offsets(problem, data)).offsets_mm
        estimator = np.asarray(np.linalg.pinv(problem.predict_with_jacobian(offsets)[1]))
    require_travel(problem, offsets)
    return conclude(method, measured, problem, data, offsets, estimator @ problem.matrix)


def require_travel(problem: Problem, offsets: Floats) -> None:
    """Raise UnusableResultError: a carriage cannot be as far off as these offsets (3,) [mm]."""
    machine = problem.model.machine
    if (largest := float(np.abs(offsets).max())) > machine.travel_mm / 2.0:
        require_determined(problem)
        raise UnusableResultError(
            f"The {machine.vocabulary.many} would be as large as {largest:.0f} mm, more than half"
            " of the travel.",
            "Check the unit and the decimal marks of the readings, and the machine file.",
        )


def fitted_here(measured: Measured, model: Model) -> dict[str, int]:
    """Accepted causes that were fitted to these very data: id → number of parameters.

    The noise of the data holds their uncertainty already.
    """
    return {
        effect.cause.id: int(np.count_nonzero(effect.std))
        for effect in model.accepted
        if effect.data_sha256 == measured.source.sha256
    }


def conclude(
    method: Method,
    measured: Measured,
    problem: Problem,
    data: Floats,
    offsets: Floats,
    estimator: Floats,
    scale_factor: float = 1.0,
) -> Solution:
    """The solution of a problem, with the noise of one reading and the uncertainty budget.

    Args:
        data: of the problem, shape (k,) [mm].
        offsets: as the method found them, shape (p,).
        estimator: their derivatives by the readings, shape (p, n).
        scale_factor: how many times as large as stated a local shape is.
    """
    model, plan, gauge = problem.model, problem.plan, problem.model.machine.instrument
    here = fitted_here(measured, model)
    uncertain = [one.scaled(scale_factor) for one in influences(model, offsets, plan)]
    left = [influence for influence in uncertain if influence.source not in here]
    stated_mm = math.hypot(gauge.noise_mm, math.sqrt(sum(one.rest for one in left)))
    # Noise of one reading is what no offsets explain, of raw data in all readings, whatever the
    # method; what a cause of the machine would explain is none.
    plain, all_data = problem, data
    if isinstance(measured, Readings):
        plain, all_data = pose(measured, model, DataKind.READINGS)
    hidden = set(model.machine.unobservable) - {effect.cause.id for effect in model.accepted}
    ratio = np.hstack([one.columns / stated_mm for one in left if one.source not in hidden])
    # What was fitted to these very readings took its part of their noise away.
    dof = len(all_data) - len(offsets) - sum(here.values())
    scatter, noise, matrix = None, Scatter(stated_mm, math.inf), plain.matrix
    if dof > 0:
        readings, jacobian = simulate_at(model, offsets, plan)
        residual, slopes = all_data - matrix @ readings, matrix @ jacobian
        # Generalised least squares: rᵀ Λᵀ P Λ r with (ΛᵀΛ)⁻¹ = G + C Cᵀ/σ², of C what influences
        # add, and P the projector onto what the offsets cannot explain. Whichever estimator left
        # the residual, it is the same.
        left_over = unexplained(*plain.whitened(matrix @ ratio, slopes, residual))
        scatter = Scatter(math.sqrt(left_over @ left_over / dof), dof)
        noise = Scatter(max(scatter.sigma_mm, gauge.rounding_mm), dof)
    uncertain += fixed_influences(model, offsets, plan)
    return Solution(
        model=model,
        offsets_mm=offsets,
        budget=budget_of(estimator, gauge, scatter, uncertain, plan.precision),
        noise=noise,
        measured=measured,
        method=method,
        problem=problem,
        data=data,
        scatter=scatter,
        stated_mm=stated_mm,
    )


def require_settings(measured: Measured) -> None:
    """Raise UnusableResultError if nobody knows the settings with which it was measured."""
    if (excerpt := measured.source.excerpt) and excerpt.unknown:
        remedy = "Copy it from the printer (/sys). If there is none, delete M501 from this copy."
        raise UnusableResultError(excerpt.unknown, remedy)


class PromisedDifference(Schema):
    """One difference of readings (Table 4 of the paper)."""

    name: str
    measured_mm: float
    modelled_mm: float
    expected_mm: float = Field(description="after the parameters are entered")
    expanded_mm: float = Field(description="U of the expected value, as many new readings included")


def promise(
    measured: Measured,
    known: Solution,
    entered: Floats,
    right: Measured | None = None,
    corrected: Iterable[Effect] = (),
    unsure_mm: Floats | float = 0.0,
) -> tuple[PromisedDifference, ...]:
    """Measured, modelled and expected differences, in the order of Table 4.

    expected = measured + R·h(Δρ − entered) − R·h(Δρ): entering offsets takes away what they do on
    this machine with all its accepted causes, and nothing else. On the nominal machine that is
    the paper's measured − modelled. Its uncertainty is that of the readings before and after,
    and of what the change depends on.

    Args:
        entered: added to the controller's offsets, shape (3,) [mm].
        right: the data without faults that will not return, such as a misreading; None: the same.
        corrected: what the controller does from then on against causes, besides the offsets.
        unsure_mm: standard deviation of each reading besides its noise, shape (n,).
    """
    if all(kind is DataKind.READINGS for kind in measured.kinds):
        return ()  # no differences of the paper can be made of these data
    kind = table_kind(measured)
    problem, data = pose(measured, known.model, kind)
    kept = data if right is None else pose(right, known.model, kind)[1]
    after = known.offsets_mm - entered
    both = np.stack((known.offsets_mm, after))
    modelled, first = problem.predict_with_jacobian(known.offsets_mm)
    later = replace(problem, model=known.model.extended(corrected))
    left, second = later.predict_with_jacobian(after)
    expected = kept + (left - modelled)  # nothing entered, exactly what was measured
    # The same readings are taken once before and once after.
    scatter = 2.0 * known.noise.sigma_mm**2 * np.diag(problem.covariance())
    scatter += 2.0 * ((np.asarray(problem.matrix) * unsure_mm) ** 2).sum(axis=1)
    # What one standard deviation of each other source changes in the effect of what is entered.
    sources = [(second - first) @ np.linalg.cholesky(known.budget.covariance_mm2)]
    for influence in influences(known.model, both, problem.plan):
        was, is_left = problem.matrix @ influence.columns
        # The stands are put there again; machine and gauge are the same.
        anew = influence.source == Origin.GAUGE_PLACEMENT
        sources += [was, is_left] if anew else [is_left - was]
    if not problem.model.repeats:
        # The effect of a drift depends on the pace of measuring.
        slower = replace(problem.plan, hours=(1.0 + PACE) * problem.plan.hours)
        sources.append((replace(later, plan=slower).predict(after) - left)[:, None])
    variance = scatter + (np.hstack(sources) ** 2).sum(axis=1)
    # Effective degrees of freedom by Welch–Satterthwaite; of all but the noise infinitely many.
    factor = [half_width(known.noise.dof * ratio**2) for ratio in (variance / scatter).tolist()]
    reach = np.array(factor) * np.sqrt(variance)
    rows = np.stack((data, modelled, expected, reach), axis=1).tolist()
    names = ("measured_mm", "modelled_mm", "expected_mm", "expanded_mm")
    return tuple(
        PromisedDifference(name=which.name, **dict(zip(names, row, strict=True)))
        for which, row in zip(problem.which, rows, strict=True)
    )
