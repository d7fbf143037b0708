"""Linear-Gaussian models: whiten, condition, predict, log density; sums of densities.

    d = C u + e,   unknowns u ~ N(0, P),   noise e ~ N(0, S)

Leading axes (...) are many models at once. Values are vectors (k,) or columns (..., k, q).
"""

import math

import numpy as np

from orthoglide_cal.model.plan import Floats, Ints

# A common size is found to within this share of it, or in so many rounds.
SIZE_WITHIN, SIZE_ROUNDS = 0.02, 20


def whiten(covariance: Floats, *values: Floats) -> tuple[Floats, ...]:
    """R⁻¹ v with S = R Rᵀ: values in units of independent noise.

    Args:
        covariance: S, positive definite, shape (..., k, k).
        values: each of shape (k,) or (..., k, q).

    Returns:
        The same values whitened, one by one.

    Raises:
        numpy.linalg.LinAlgError: S is not positive definite.

    >>> whiten(np.diag([4.0, 9.0]), np.array([2.0, 6.0]))
    (array([1., 2.]),)
    """
    root = np.linalg.cholesky(covariance)
    columns = [each[:, None] if each.ndim == 1 else each for each in values]
    shape = np.broadcast_shapes(*(each.shape[:-2] for each in (root, *columns)))
    whole = [np.broadcast_to(each, (*shape, *each.shape[-2:])) for each in columns]
    white = np.linalg.solve(root, np.concatenate(whole, axis=-1))
    parts = np.split(white, np.cumsum([each.shape[-1] for each in columns])[:-1], axis=-1)
    return tuple(
        part[..., 0] if each.ndim == 1 else part for each, part in zip(values, parts, strict=True)
    )


def log_density(covariance: Floats, residuals: Floats) -> Floats:
    """ln N(r; 0, S) without its constant, −½ (rᵀ S⁻¹ r + ln det S), shape (..., q).

    S is of shape (..., k, k), columns r of shape (..., k, q).
    """
    root = np.linalg.cholesky(covariance)
    log_scale = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
    white = np.linalg.solve(root, residuals)
    return np.asarray(-0.5 * (white**2).sum(axis=-2) - log_scale[..., None])


def condition(columns: Floats, data: Floats, sizes: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Unknowns u of d = C u + e with priors u ~ N(0, sizes²) and noise e ~ N(0, σ²).

    Args:
        columns, data: C, shape (k, q), and d, shape (k,) [mm].
        sizes: plausible size of each unknown, one standard deviation, shape (q,).
        sigma: σ [mm].

    Returns:
        Their mean, shape (q,), and covariance (CᵀC/σ² + diag(1/sizes²))⁻¹, shape (q, q).
    """
    precision = columns.T @ columns / sigma**2 + np.diag(1.0 / sizes**2)
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    return covariance @ (columns.T @ data) / sigma**2, covariance


def fit_size(columns: Floats, data: Floats, sizes: Floats, sigma: float, chosen: Ints) -> float:
    """The likeliest size that some unknowns have in common (expectation and maximisation).

    Arguments as of `condition`; of those with the `chosen` indices the first size is 1.
    """
    others = np.delete(np.arange(len(sizes)), chosen)
    precision, pull = columns.T @ columns / sigma**2, columns.T @ data / sigma**2
    # What the others leave of the chosen ones; along its axes these are independent.
    inner = precision[np.ix_(others, others)] + np.diag(1.0 / sizes[others] ** 2)
    taken = np.linalg.solve(inner, precision[np.ix_(others, chosen)]).T
    own, axes = np.linalg.eigh(
        precision[np.ix_(chosen, chosen)] - taken @ precision[np.ix_(others, chosen)]
    )
    along = axes.T @ (pull[chosen] - taken @ pull[others])
    size = 1.0
    for _ in range(SIZE_ROUNDS):
        variance = 1.0 / (own + 1.0 / size**2)
        before, size = size, float(np.sqrt(np.mean((along * variance) ** 2 + variance)))
        if abs(size / before - 1.0) < SIZE_WITHIN:
            break
    return size


def predict(
    covariance: Floats, values: Floats, shared: Floats, prior: Floats
) -> tuple[Floats, Floats]:
    """What values less their expectation (..., k, q) say of others that are jointly normal.

    From S of the values, noise included (..., k, k), their covariance `shared` with the others
    (..., k, m), and that of the others before, `prior` (..., m, m).

    Returns:
        Mean of the others less their expectation (..., m, q), and their covariance (..., m, m).
    """
    white, seen = whiten(covariance, values, shared)
    known = seen.swapaxes(-1, -2)
    return known @ white, prior - known @ seen


def unexplained(columns: Floats, values: Floats) -> Floats:
    """v − C C⁺ v: what free unknowns, of any size, leave of white values.

    C is of shape (k, q), v and what is left of it (k,) or (k, m).
    """
    return np.asarray(values - columns @ (np.linalg.pinv(columns) @ values))


def root_of(covariance: Floats) -> Floats:
    """R with R Rᵀ = P for any P (q, q) without negative variances, columns by growing size.

    What rounding makes negative is zero.
    """
    size2, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(size2, 0.0)))


def log_sum(values: Floats, axis: int | tuple[int, ...] | None = None) -> Floats:
    """ln Σ exp along one axis or several, or of all entries."""
    if isinstance(axis, int) and values.shape[axis] == 1:
        return values.squeeze(axis)
    top = values.max(axis=axis, keepdims=True)
    share = values - top
    np.exp(share, out=share)
    return np.asarray(np.log(share.sum(axis=axis)) + top.squeeze(axis))


def log_mean(values: Floats) -> float:
    """ln of the mean of exp of all entries."""
    return float(log_sum(values)) - math.log(values.size)
