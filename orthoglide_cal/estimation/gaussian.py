"""Linear-Gaussian models: whiten, condition, predict, log density; sums of densities.

    d = C u + e,   unknowns u ~ N(0, P),   noise e ~ N(0, S)

Leading axes (...) are many models at once. Values are vectors (k,) or columns (..., k, q).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.special import erfc

from orthoglide_cal.model.plan import Floats, Ints, ReadOnly, read_only

Key = TypeVar("Key", bound=Hashable)

TINY = 1e-12  # a variance of log odds


def whiten(covariance: Floats, *values: Floats) -> tuple[Floats, ...]:
    """R⁻¹ v with S = R Rᵀ: values in units of independent noise.

    S of shape (..., k, k), values each (..., k, q), of one S also (k,). Raises
    numpy.linalg.LinAlgError: S is not positive definite.

    >>> whiten(np.diag([4.0, 9.0]), np.array([2.0, 6.0]))
    (array([1., 2.]),)
    """
    root = np.linalg.cholesky(covariance)
    return tuple(np.linalg.solve(root, value) for value in values)


def shrinking(columns: Floats) -> tuple[Floats, Floats]:
    """U, orthonormal (k, q), and f (q,) with S⁻¹ = (I − U diag(1 − f) Uᵀ)² of S = I + C Cᵀ (k, k).

    It makes values independent of which only a few unknowns are in common, C of shape (k, c).
    """
    axes, size, _ = np.linalg.svd(columns, full_matrices=False)
    return read_only(axes), read_only(1.0 / np.sqrt(1.0 + size**2))


def shrink(values: Floats, axes: Floats, factors: Floats) -> Floats:
    """(I − U diag(1 − f) Uᵀ) v of values (k,) or (..., k, m), with U and f as of `shrinking`."""
    return np.asarray(values - (axes * (1.0 - factors)) @ (axes.T @ values))


def whiten_shared(columns: Floats, *values: Floats) -> tuple[Floats, ...]:
    """Values, each (k,) or (k, q), in units of independent noise of S = I + C Cᵀ, C (k, c)."""
    axes, factors = shrinking(columns)
    return tuple(shrink(value, axes, factors) for value in values)


def condition(
    columns: Floats, data: Floats, sizes: Floats, sigma: float, square: Floats | None = None
) -> tuple[Floats, Floats]:
    """Unknowns u of d = C u + e with priors u ~ N(0, sizes²) and noise e ~ N(0, σ²).

    C of shape (k, q), d (k,), sizes (q,), CᵀC if it is known. Returns their mean, shape (q,), and
    covariance (CᵀC/σ² + diag(1/sizes²))⁻¹, shape (q, q).
    """
    square = columns.T @ columns if square is None else square
    precision = square / sigma**2 + np.diag(1.0 / sizes**2)
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    return covariance @ (columns.T @ data) / sigma**2, covariance


def unexplained(columns: Floats, values: Floats) -> Floats:
    """v − C C⁺ v: what unknowns of any size, C (k, q), leave of white values, (k,) or (k, m)."""
    return np.asarray(values - columns @ (np.linalg.pinv(columns) @ values))


def root_of(covariance: Floats) -> Floats:
    """R with R Rᵀ = P (q, q), columns by growing size; what rounding makes negative is zero."""
    size2, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(size2, 0.0)))


def log_sum(values: Floats, axis: int | tuple[int, ...] | None = None) -> Floats:
    """ln Σ exp along one axis or several, or of all entries."""
    if isinstance(axis, int) and values.shape[axis] == 1:
        return values.squeeze(axis)
    top = np.maximum.reduce(values, axis, keepdims=True)
    share = values - top
    np.exp(share, out=share)
    total = np.log(np.add.reduce(share, axis, keepdims=True))
    total += top
    return np.asarray(total.squeeze(axis))


def log_mean(values: Floats) -> float:
    """ln of the mean of exp of all entries."""
    return float(log_sum(values)) - math.log(values.size)


def probabilities(log_weight: Mapping[Key, float]) -> dict[Key, float]:
    """Probability of each hypothesis from ln of its prior times evidence, most probable first.

    Raises numpy.linalg.LinAlgError: rounding left no evidence of one.
    """
    total = float(log_sum(np.array([*log_weight.values()])))
    if math.isnan(total):
        raise np.linalg.LinAlgError("the evidence is no number")
    ordered = sorted(log_weight.items(), key=lambda pair: -pair[1])
    return {key: math.exp(value - total) for key, value in ordered}


def mixture(
    shares: Sequence[float], values: Sequence[Floats], covariances: Sequence[Floats]
) -> tuple[Floats, Floats]:
    """Mean (p,) and covariance (p, p) over hypotheses whose shares sum to 1.

    The choice among their values (p,) is added to the covariance (p, p) under each.
    """
    weights, means = np.array(shares), np.stack(values)
    mean = weights @ means
    apart = means - mean
    return mean, np.tensordot(weights, np.stack(covariances), axes=1) + (apart.T * weights) @ apart


@dataclass(frozen=True, eq=False)
class Mixture(ReadOnly):
    """A prediction of m values: a normal distribution for each of t explanations.

    From q data sets, which differ in means and weights only.
    """

    means: Floats  # shape (t, m, q)
    covariance: Floats  # noise included, shape (t, m, m)
    log_weight: Floats  # ln of the probability of each explanation, shape (t, q)

    def by_explanation(self, values: Floats, rows: Ints) -> Floats:
        """ln p of values (k, q) at `rows` (k,) under each, without its constant, shape (t, q)."""
        covariance = self.covariance[:, rows[:, None], rows]
        (white,) = whiten(covariance, values - self.means[:, rows])
        spread = np.linalg.slogdet(covariance)[1][:, None]
        return np.asarray(-0.5 * ((white**2).sum(axis=-2) + spread))

    def given(self, values: Floats, rows: Ints, others: Ints) -> Mixture:
        """The prediction of the values at `others` once those at `rows`, (k, q), are known."""
        seen, shared, prior = (
            self.covariance[:, one[:, None], other]
            for one, other in ((rows, rows), (rows, others), (others, others))
        )
        white, shared = whiten(seen, values - self.means[:, rows], shared)
        known = shared.swapaxes(-1, -2)
        weight = self.log_weight + self.by_explanation(values, rows)
        means = self.means[:, others] + known @ white
        return Mixture(means, prior - known @ shared, weight - log_sum(weight, 0))

    def part(self, some: slice, values: slice) -> Mixture:
        """Choose some of the explanations and of the values."""
        covariance = self.covariance[some, values, values]
        return Mixture(self.means[some, values], covariance, self.log_weight[some])

    def log_odds(self, judged: Mixture) -> tuple[Floats, Floats]:
        """Gain of the log odds of the true explanation (first axis) over a rival by values.

        Values as this mixture predicts them, weighed by the densities of `judged`, of the same
        explanations, both from one data set: mean and standard deviation, each (t, t).
        """
        covariance, gap = self.covariance[:, None], (self.means[:, None] - judged.means)[..., 0]
        precision = np.linalg.inv(judged.covariance)
        weighed = (precision @ gap[..., None])[..., 0]
        true = np.arange(len(gap))
        cost = np.trace(precision @ covariance, axis1=-2, axis2=-1) + (gap * weighed).sum(axis=-1)
        cost += np.linalg.slogdet(judged.covariance)[1]
        other = (precision - precision[:, None]) @ covariance
        square = (other * other.swapaxes(-1, -2)).sum(axis=(-1, -2))
        slope = weighed - weighed[true, true][:, None]
        spread = (slope * (covariance @ slope[..., None])[..., 0]).sum(axis=-1)
        mean = 0.5 * (cost - cost[true, true][:, None])
        return mean, np.sqrt(np.maximum(0.5 * square + spread, TINY))

    @property
    def distances(self) -> Floats:
        """Between the predictions by two explanations, (t, t) [standard deviations]."""
        gap = self.means[:, None] - self.means
        (white,) = whiten(0.5 * (self.covariance[:, None] + self.covariance), gap)
        return np.asarray(np.sqrt((white[..., 0] ** 2).sum(axis=-1)))

    @property
    def std_by_explanation(self) -> Floats:
        """Standard deviation of each value under each explanation, shape (t, m, 1)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))[..., None]

    @property
    def mean(self) -> Floats:
        """Expected values, shape (m, q)."""
        return np.asarray((np.exp(self.log_weight)[:, None] * self.means).sum(axis=0))

    @property
    def std(self) -> Floats:
        """Standard deviations of the prediction errors, shape (m, q)."""
        spread = self.std_by_explanation**2 + (self.means - self.mean) ** 2
        return np.asarray(np.sqrt((np.exp(self.log_weight)[:, None] * spread).sum(axis=0)))

    def tail(self, values: Floats) -> Floats:
        """Chance of each value being at least as far off as in (m, q), shape (m, q)."""
        far = np.abs(values - self.means) / self.std_by_explanation
        return np.asarray((np.exp(self.log_weight)[:, None] * erfc(far / 2.0**0.5)).sum(axis=0))
