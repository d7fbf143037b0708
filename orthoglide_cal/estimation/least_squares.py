"""The estimation problem, and the one least squares that solves it, batched.

    minimise |d − R·h(Δρ)|² over the joint offsets Δρ        (eq. 25)

d are the data, h the predicted readings and R the reduction of the method: differences of
readings for the paper's methods, zero-free contrasts of all readings for `readings`.

Gauss–Newton with Levenberg–Marquardt damping where a step does not help; one call solves many
sessions. The exact Jacobian of the forward model is used, not the one of eqs. (16), (17), which
holds at zero offsets only.
"""

import functools
import os
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.estimation.gaussian import whiten, whiten_shared
from orthoglide_cal.model.model import Model, simulate, simulate_with_jacobian
from orthoglide_cal.model.plan import (
    Contrasts,
    Floats,
    Ints,
    Plan,
    ReadOnly,
    Reduction,
    known_plan,
    read_only,
)

# A fit is an optimum if the step that is left is at most this [standard deviations].
OPTIMAL = 1e-3
MAX_ITERATIONS = 100
# Sessions solved together: few enough for the processor's cache, enough to outweigh Python.
BLOCK = 4096
# An undamped step shorter than this ends the iteration [standard deviations]: where it can be had,
# no digit that is shown depends on where a search began.
SHORT_STEP = 1e-7
# Rounding of predicted differences of lengths around a metre [mm], and of a sum of squares.
ROUNDING_MM = 1e-12
ROUNDING = 1e-12
FIRST_DAMPING = 1e-3
# Of no more numbers the order in memory does not matter.
SMALL = 4096
# More kinds of readings are predicted one by one: to fold them would take a matrix of that width.
MOST_KINDS = 64


@dataclass(frozen=True, eq=False)
class Problem(ReadOnly):
    """One estimation problem; many data sets may share it."""

    model: Model
    plan: Plan  # n readings
    matrix: Reduction  # R, shape (k, n)

    def predict(self, offsets: Floats) -> Floats:
        """R·h(Δρ), offsets (..., 3) → (..., k) [mm]."""
        plan, matrix = self._folded
        return _reduce(matrix, simulate(self.model, offsets, plan), -1)

    def predict_with_jacobian(self, offsets: Floats, strict: bool = True) -> tuple[Floats, Floats]:
        """R·h and R·∂h/∂Δρ: offsets (..., 3) → (..., k) [mm], (..., k, 3).

        Where a posture cannot be taken: an error if `strict`, NaN otherwise.
        """
        plan, matrix = self._folded
        if offsets.size == offsets.shape[-1]:
            point = _at_point(self.model, tuple(offsets.reshape(-1).tolist()), plan, strict)
            readings, jacobian = (np.reshape(a, (*offsets.shape[:-1], *a.shape)) for a in point)
        else:
            readings, jacobian = simulate_with_jacobian(self.model, offsets, plan, strict)
        return _reduce(matrix, readings, -1), _reduce(matrix, jacobian, -2)

    def change(self, offsets: Floats, entered: Floats) -> Floats:
        """Change of the data by entering offsets (3,) [mm] in the controller, shape (k,) [mm].

        What remains of the offsets Δρ (3,) [mm] before is Δρ − entered.
        """
        return self.predict(offsets - entered) - self.predict(offsets)

    @cached_property
    def at_zero(self) -> tuple[Floats, Floats]:
        """`predict_with_jacobian` at zero offsets, read-only: (k,) [mm], (k, 3)."""
        zero = np.zeros(len(self.model.machine.parameter_names))
        predicted, jacobian = self.predict_with_jacobian(zero)
        return read_only(predicted), read_only(jacobian)

    @cached_property
    def _folded(self) -> tuple[Plan, Reduction]:
        """Plan and R with readings that repeat each other predicted once.

        With a cause that may distinguish them nothing is folded.
        """
        first, kind = self.plan.distinct
        if not self.model.repeats or len(first) > MOST_KINDS:
            return self.plan, self.matrix
        fold = kind[:, None] == np.arange(len(first))
        return known_plan(self.plan.subset(first)), read_only(self.matrix @ fold)

    def covariance(self) -> Floats:
        """R Rᵀ: covariance of the data for unit variance of one reading (eqs. 28, 31), (k, k).

        Of one as precise as most; others have more or less noise. Of differences: contrasts are
        independent.
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
        moved = sum(jacobian[..., i] * step[..., i, None] for i in range(step.shape[-1]))
        noise = self.model.machine.instrument.noise_mm
        return np.asarray(np.sqrt(np.square(moved).sum(axis=-1)) / noise)


@functools.lru_cache(maxsize=4)
def _at_point(
    model: Model, offsets: tuple[float, ...], plan: Plan, strict: bool
) -> tuple[Floats, Floats]:
    """`simulate_with_jacobian` at one point: other weights of the same readings ask it again."""
    readings, jacobian = simulate_with_jacobian(model, np.array(offsets), plan, strict)
    return read_only(readings), read_only(jacobian)


def _reduce(matrix: Reduction, values: Floats, axis: int) -> Floats:
    """Apply R (k, n) along one axis; of much the order of the batch in memory is kept."""
    if values.size < SMALL or isinstance(matrix, Contrasts):
        return np.asarray(values @ matrix.T if axis == -1 else matrix @ values)
    reduced = np.tensordot(matrix, values, axes=(1, values.ndim + axis))
    return np.moveaxis(reduced, 0, axis)


def normal_step(jacobian: Floats, residual: Floats, damping: Floats | float = 0.0) -> Floats:
    """Solve (JᵀJ + λ diag JᵀJ) s = Jᵀr by cofactors: (..., k, 3), (..., k) → (..., 3)."""
    if jacobian.shape[-1] != 3:
        return _many_step(jacobian, residual, damping)
    columns = [jacobian[..., i] for i in range(3)]
    gradient = [(column * residual).sum(axis=-1) for column in columns]
    xx, yy, zz = ((column**2).sum(axis=-1) * (1.0 + damping) for column in columns)
    x, y, z = columns
    xy, yz, zx = ((a * b).sum(axis=-1) for a, b in ((x, y), (y, z), (z, x)))
    adjugate = (
        (yy * zz - yz**2, yz * zx - xy * zz, xy * yz - yy * zx),
        (yz * zx - xy * zz, zz * xx - zx**2, zx * xy - yz * xx),
        (xy * yz - yy * zx, zx * xy - yz * xx, xx * yy - xy**2),
    )
    determinant = xx * adjugate[0][0] + xy * adjugate[0][1] + zx * adjugate[0][2]
    return np.stack(
        [sum(a * g for a, g in zip(row, gradient, strict=True)) / determinant for row in adjugate],
        axis=-1,
    )


def _many_step(jacobian: Floats, residual: Floats, damping: Floats | float) -> Floats:
    """The same for any number of parameters; NaN where the model cannot be evaluated."""
    turned = np.swapaxes(jacobian, -1, -2)
    normal = turned @ jacobian
    more = np.asarray(damping)[..., None, None] * np.eye(jacobian.shape[-1])
    gradient = turned @ residual[..., None]
    # Scaled, so that lengths and angles weigh alike.
    size = np.sqrt(np.einsum("...ii->...i", normal))
    scaled = normal / (size[..., :, None] * size[..., None, :]) + more
    fine = np.isfinite(scaled).all(axis=(-1, -2), keepdims=True)
    solved = np.linalg.solve(
        np.where(fine, scaled, np.eye(jacobian.shape[-1])), gradient / size[..., None]
    )
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


def fit_offsets(problem: Problem, data: Floats, start: Floats | None = None) -> LeastSquaresFit:
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
    first = None if start is None else start.reshape(-1, start.shape[-1])

    def fit(at: int) -> tuple[Floats, Floats, Floats, Ints]:
        block = slice(at, at + BLOCK)
        # Sessions that start at the same offsets share their first evaluation.
        own = first if first is None or len(first) == 1 else first[block]
        return _fit_block(problem, flat[block], own)

    starts = range(0, len(flat), BLOCK)
    if len(starts) <= 1:
        parts = [fit(0)]
    else:
        from concurrent.futures import ThreadPoolExecutor

        # numpy lets go of the interpreter in long loops. A third of the time went into fetching
        # memory again: glibc returns what is freed to the system above a threshold that grows to
        # the largest block ever freed (mallopt(3), M_MMAP_THRESHOLD), such as this one.
        np.empty(31 << 20, dtype=np.uint8)
        with ThreadPoolExecutor(min(os.cpu_count() or 1, len(starts))) as pool:
            parts = list(pool.map(fit, starts))
    offsets, residuals, remaining, iterations = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return LeastSquaresFit(
        offsets.reshape(*batch, offsets.shape[-1]),
        residuals.reshape(data.shape),
        remaining.reshape(batch),
        iterations.reshape(batch),
    )


@dataclass(eq=False)
class _State:
    """Where the sessions still at work stand; the first axis runs over them."""

    which: Ints  # their places in the block
    data: Floats
    offsets: Floats
    residual: Floats
    jacobian: Floats
    damping: Floats

    def keep(self, mask: np.ndarray) -> None:
        """Go on with some of them."""
        for name in ("which", "data", "offsets", "residual", "jacobian", "damping"):
            setattr(self, name, _chosen(getattr(self, name), mask))

    def accept(
        self, better: np.ndarray, offsets: Floats, residual: Floats, jacobian: Floats
    ) -> None:
        """Move those whose trial is better; damp the others more."""
        if np.all(better):
            self.offsets, self.residual, self.jacobian = offsets, residual, jacobian
        else:
            self.offsets = np.where(better[:, None], offsets, self.offsets)
            self.residual = np.where(better[:, None], residual, self.residual)
            self.jacobian = np.where(better[:, None, None], jacobian, self.jacobian)
        more = np.maximum(10.0 * self.damping, FIRST_DAMPING)
        self.damping = np.where(better, self.damping / 10.0, more)
        self.damping[self.damping < FIRST_DAMPING] = 0.0


def _chosen(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """values[mask], with the first axis still the fastest in memory."""
    return np.moveaxis(np.compress(mask, np.moveaxis(values, 0, -1), axis=-1), -1, 0)


# What fails on the way shows as NaN and is refused there; warnings would say nothing more.
@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def _fit_block(
    problem: Problem, data: Floats, start: Floats | None
) -> tuple[Floats, Floats, Floats, Ints]:
    n, width = len(data), len(problem.model.machine.parameter_names)
    offsets = np.empty((n, width))
    residuals = np.empty(data.shape)
    remaining = np.empty(n)
    iterations = np.zeros(n, dtype=np.intp)

    if start is None:
        first, (model, jacobian) = np.zeros(width), (part[None] for part in problem.at_zero)
    else:
        first, (model, jacobian) = start, problem.predict_with_jacobian(start, strict=False)
    at = _State(
        which=np.arange(n),
        data=data,
        offsets=np.broadcast_to(first, (n, width)),
        residual=data - model,
        jacobian=jacobian,
        damping=np.zeros(n),
    )
    for iteration in range(MAX_ITERATIONS + 1):
        newton = normal_step(at.jacobian, at.residual)
        size = problem.length(at.jacobian, newton)
        open_ = (size > SHORT_STEP) & (iteration < MAX_ITERATIONS)
        if not np.all(open_) or not n:
            done = ~open_
            offsets[at.which[done]] = at.offsets[done]
            residuals[at.which[done]] = at.residual[done]
            remaining[at.which[done]] = size[done]
            iterations[at.which[done]] = iteration
            if not np.any(open_):
                break
            at.jacobian = np.broadcast_to(at.jacobian, (len(done), *at.jacobian.shape[1:]))
            at.keep(open_)
            newton = _chosen(newton, open_)
        damped = at.damping > 0.0
        step = newton
        if np.any(damped):
            careful = normal_step(at.jacobian, at.residual, at.damping)
            step = np.where(damped[:, None], careful, newton)
        trial = at.offsets + step
        model, jacobian = problem.predict_with_jacobian(trial, strict=False)
        residual = at.data - model
        # A step whose gain is lost in rounding is taken; a NaN cost (posture out of reach)
        # compares false and is refused like a worse one.
        cost = (at.residual**2).sum(axis=-1)
        slack = ROUNDING * cost + ROUNDING_MM * np.sqrt(cost)
        better = (residual**2).sum(axis=-1) <= cost + slack
        at.accept(better, trial, residual, jacobian)
    return offsets, residuals, remaining, iterations
