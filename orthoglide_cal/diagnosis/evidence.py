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

from orthoglide_cal.model import Floats, freeze

# ln(σ/stated): how far a gauge may differ from its statement, one standard deviation.
STATEMENT_SPREAD = 0.10
_LOG_RATIO = np.linspace(-0.6, 0.45, 8)


@dataclass(frozen=True, eq=False)
class NoiseGrid:
    """Plausible standard deviations of one reading and their log weights, shape (g,)."""

    sigma: Floats
    log_weight: Floats

    def __post_init__(self) -> None:
        freeze(self, "sigma", "log_weight")

    @classmethod
    def around(cls, stated_mm: float) -> NoiseGrid:
        """Log-normal around the stated noise."""
        weight = -0.5 * (_LOG_RATIO / STATEMENT_SPREAD) ** 2
        return cls(stated_mm * np.exp(_LOG_RATIO), weight - log_sum(weight))

    @property
    def stated(self) -> float:
        """The likeliest of them: what the gauge's maker states [mm]."""
        return float(self.sigma[np.argmax(self.log_weight)])


def log_sum(values: Floats, axis: int | tuple[int, ...] | None = None) -> Floats:
    """ln Σ exp along one axis or several, or of all entries."""
    top = values.max(axis=axis, keepdims=True)
    share = values - top
    np.exp(share, out=share)
    return np.asarray(np.log(share.sum(axis=axis)) + top.squeeze(axis))


def log_mean(values: Floats) -> float:
    """ln of the mean of exp of all entries."""
    return float(log_sum(values)) - math.log(values.size)


class Gaussian:
    """Density of residuals under B for each σ of a grid; leading axes of B are many B at once.

    Args:
        columns: B, shape (..., k, r), scaled by the plausible sizes [mm]; a column of zeros
            adds nothing.
        noise: the grid.
        log_share: ln prior share of each B, of the shape of the leading axes.
    """

    def __init__(self, columns: Floats, noise: NoiseGrid, log_share: Floats | float = 0.0) -> None:
        self._left, size2 = _principal(columns)
        self._sigma2 = noise.sigma[:, None] ** 2
        size2 = size2[..., None, :]
        self._shrink = size2 / (self._sigma2 + size2)  # (..., g, r)
        own = columns.shape[-2] * np.log(self._sigma2[:, 0])
        log_det = np.log1p(size2 / self._sigma2).sum(axis=-1) + own
        share = np.asarray(log_share)[..., None] + noise.log_weight
        self._log_share = share - 0.5 * log_det

    def log_density(self, residuals: Floats) -> Floats:
        """ln p of each column of (..., k, q) with each σ's weight, (..., g, q); no constant."""
        quadratic = self._quadratic(residuals, self._inside(residuals))
        return np.asarray(self._log_share[..., None] - 0.5 * quadratic)

    def by_noise(self, residual: Floats) -> Floats:
        """The same of one residual (k,), shape (..., g)."""
        return np.asarray(self.log_density(residual[:, None])[..., 0])

    def against(self, patterns: Floats, residual: Floats) -> tuple[Floats, Floats]:
        """How columns c of (..., k, q) weigh and match one residual (k,).

        Returns:
            cᵀ S⁻¹ c and cᵀ S⁻¹ r, each of shape (..., g, q).
        """
        inside = self._inside(patterns)
        outside = (np.swapaxes(patterns, -1, -2) @ residual)[..., None, :]
        match = (outside - self._shrink @ (inside * self._inside(residual[:, None]))) / self._sigma2
        return self._quadratic(patterns, inside), match

    def _inside(self, vectors: Floats) -> Floats:
        return np.asarray(np.swapaxes(self._left, -1, -2) @ vectors)

    def _quadratic(self, vectors: Floats, inside: Floats) -> Floats:
        """vᵀ S⁻¹ v of each column."""
        outside = (vectors**2).sum(axis=-2)[..., None, :]
        return np.asarray((outside - self._shrink @ inside**2) / self._sigma2)


# Squared sizes below this fraction of the largest are lost in rounding, and far below any noise.
_ROUNDING = 1e-13


def _principal(columns: Floats) -> tuple[Floats, Floats]:
    """Left singular vectors (..., k, r') of B and squared singular values (..., r').

    Those lost in rounding are zero. From the smaller of BᵀB and BBᵀ, which costs much less than
    a singular value decomposition.
    """
    k, r = columns.shape[-2:]
    turned = np.swapaxes(columns, -1, -2)
    size2, vectors = np.linalg.eigh(turned @ columns if r < k else columns @ turned)
    kept = size2 > _ROUNDING * size2[..., -1:]
    size2 = np.where(kept, size2, 0.0)
    if r >= k:
        return vectors, size2
    stretch = np.divide(1.0, np.sqrt(size2), out=np.zeros_like(size2), where=kept)
    return columns @ (vectors * stretch[..., None, :]), size2
