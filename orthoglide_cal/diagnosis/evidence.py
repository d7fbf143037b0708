"""Exact evidence of linear-Gaussian explanations.

An explanation says r = B b + e with b ~ N(0, I) (columns of B scaled by plausible sizes) and
e ~ N(0, σ² I). Its evidence is the density of r with b integrated out,

    −2 ln p(r) = rᵀ S⁻¹ r + ln det S,   S = σ² I + B Bᵀ,

averaged over a grid of σ around what the gauge's maker states. An explanation with more
freedom than it needs spreads its density thin and loses: that is what makes causes of
different size comparable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats

# ln(σ/stated): how far a gauge may differ from its statement, one standard deviation.
STATEMENT_SPREAD = 0.10
_LOG_RATIO = np.linspace(-0.6, 0.45, 8)


@dataclass(frozen=True, eq=False)
class NoiseGrid:
    """Plausible standard deviations of one reading and their log weights, shape (g,)."""

    sigma: Floats
    log_weight: Floats

    @classmethod
    def around(cls, stated_mm: float) -> NoiseGrid:
        """Log-normal around the stated noise."""
        weight = -0.5 * (_LOG_RATIO / STATEMENT_SPREAD) ** 2
        return cls(stated_mm * np.exp(_LOG_RATIO), weight - log_sum(weight))


def log_sum(values: Floats) -> float:
    """ln Σ exp of all entries."""
    top = float(values.max())
    return top + math.log(float(np.exp(values - top).sum()))


def log_sums(values: Floats, axis: int) -> Floats:
    """ln Σ exp along one axis."""
    top = values.max(axis=axis, keepdims=True)
    total = np.log(np.exp(values - top).sum(axis=axis))
    return np.asarray(total + top.squeeze(axis))


class Gaussian:
    """Density of residuals under B for each σ of a grid.

    Args:
        columns: B, shape (k, r), scaled by the plausible sizes [mm].
        noise: the grid.
    """

    def __init__(self, columns: Floats, noise: NoiseGrid) -> None:
        self._left, size2 = _principal(columns)
        self._sigma2 = noise.sigma**2
        sigma2 = self._sigma2[:, None]
        self._shrink = size2 / (sigma2 + size2)  # (g, r)
        self.log_det = np.log1p(size2 / sigma2).sum(axis=1) + len(columns) * np.log(self._sigma2)

    def quadratic(self, vectors: Floats) -> Floats:
        """vᵀ S⁻¹ v of each column of (k, q), shape (g, q)."""
        inside = (self._left.T @ vectors) ** 2
        outside = (vectors**2).sum(axis=0)
        return np.asarray((outside - self._shrink @ inside) / self._sigma2[:, None])

    def product(self, vectors: Floats, residual: Floats) -> Floats:
        """vᵀ S⁻¹ r of each column of (k, q) with one residual (k,), shape (g, q)."""
        inside = (self._left.T @ vectors) * (self._left.T @ residual)[:, None]
        return np.asarray((vectors.T @ residual - self._shrink @ inside) / self._sigma2[:, None])

    def log_density(self, residuals: Floats) -> Floats:
        """ln p of each column of (k, q), shape (g, q), without the constant."""
        return np.asarray(-0.5 * (self.quadratic(residuals) + self.log_det[:, None]))


# Squared sizes below this fraction of the largest are lost in rounding, and far below any noise.
_ROUNDING = 1e-13


def _principal(columns: Floats) -> tuple[Floats, Floats]:
    """Left singular vectors (k, r') of B and squared singular values (r',), largest parts only.

    From the smaller of BᵀB and BBᵀ, which costs much less than a singular value decomposition.
    """
    k, r = columns.shape
    if r < k:
        size2, right = np.linalg.eigh(columns.T @ columns)
        kept = size2 > _ROUNDING * size2[-1]
        return columns @ (right[:, kept] / np.sqrt(size2[kept])), size2[kept]
    size2, left = np.linalg.eigh(columns @ columns.T)
    kept = size2 > _ROUNDING * size2[-1]
    return left[:, kept], size2[kept]
