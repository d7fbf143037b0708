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
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.estimation.gaussian import log_sum
from orthoglide_cal.model.plan import Floats, ReadOnly

# ln(σ/stated): how far a gauge may differ from its statement, one standard deviation.
STATEMENT_SPREAD = 0.10
_LOG_RATIO = np.linspace(-0.6, 0.45, 8)
# The same of a probe, and of the local shape of a bed: where they are stated, and assumed.
PROBE_SPREAD = {False: 0.15, True: 0.3}
_PROBE_RATIO = np.array([0.7, 1.0, 1.4])
ROUGH_SPREAD = {False: math.log(1.4), True: math.log(2.0)}
SMOOTH = 0.5
_ROUGH = np.array([0.25, 0.5, 1.0, 2.0, 4.0])
# Squared sizes below this fraction of the largest are lost in rounding, and far below any noise.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class NoiseGrid(ReadOnly):
    """Plausible standard deviations of one reading and their log weights, shape (g,)."""

    sigma: Floats  # of noise that no two readings share [mm]
    log_weight: Floats  # of each
    # Additional variance of each datum, where neighbours share a local shape of the size that is
    # stated, (k,) [mm²]; the data are those in which it is independent.
    spectrum: Floats | None = None
    scale_factor: Floats | None = None  # how many times as large that shape is, (g,)

    @classmethod
    def around(
        cls, stated_mm: float, spectrum: Floats | None = None, assumed: bool = False
    ) -> NoiseGrid:
        """Log-normal around the stated noise [mm]; with a local shape also around its size.

        `assumed` if nobody stated that there is a local shape: as likely there is none.
        """
        if spectrum is not None:
            ratio = -0.5 * (np.log(_PROBE_RATIO) / PROBE_SPREAD[assumed]) ** 2
            size = -0.5 * (np.log(_ROUGH) / ROUGH_SPREAD[assumed]) ** 2
            sizes, size = _ROUGH, size - log_sum(size)
            if assumed:
                sizes = np.append(sizes, 0.0)
                size = np.append(size + math.log(1.0 - SMOOTH), math.log(SMOOTH))
            weight = np.add.outer(ratio - log_sum(ratio), size)
            sigma = np.broadcast_to(stated_mm * _PROBE_RATIO[:, None], weight.shape)
            scale_factor = np.broadcast_to(sizes, weight.shape)
            return cls(sigma.reshape(-1), weight.reshape(-1), spectrum, scale_factor.reshape(-1))
        weight = -0.5 * (_LOG_RATIO / STATEMENT_SPREAD) ** 2
        return cls(stated_mm * np.exp(_LOG_RATIO), weight - log_sum(weight))

    def with_spectrum(self, spectrum: Floats, sizes: Sequence[float]) -> NoiseGrid:
        """The same noise with a further shape (k,) [mm²], of each of some sizes in turn."""
        sigma, log_weight = (np.tile(each, len(sizes)) for each in (self.sigma, self.log_weight))
        return NoiseGrid(sigma, log_weight, spectrum, np.repeat(sizes, len(self.sigma)))

    @cached_property
    def stated(self) -> float:
        """The likeliest of them: what the gauge's maker states [mm]."""
        return float(self.sigma[np.argmax(self.log_weight)])

    @property
    def variance(self) -> Floats:
        """Of each datum, shape (g, k); (g, 1) where no two readings share anything [mm²]."""
        own = self.sigma[:, None] ** 2
        if self.spectrum is None or self.scale_factor is None:
            return own
        return np.asarray(own + self.scale_factor[:, None] ** 2 * self.spectrum)

    def density(self, columns: Floats, sizes: Floats, log_share: Floats | float = 0.0) -> Gaussian:
        """Density of residuals under the same columns (..., k, r) at several sizes.

        `sizes` are the plausible ones of the unknown of each column, shape (..., s, r); `log_share`
        is ln of their prior shares, shape (s,).
        """
        if self.spectrum is None:
            return Gaussian(columns[..., None, :, :] * sizes[..., None, :], self, log_share)
        return Patchy(columns, sizes, self, log_share)


class Gaussian:
    """Density of residuals under B for each σ of a grid, of noise that no two data share.

    B (..., k, r) is scaled by the plausible sizes [mm]; a column of zeros adds nothing. `log_share`
    is ln of the prior share of each B, of the shape of the leading axes.
    """

    def __init__(self, columns: Floats, noise: NoiseGrid, log_share: Floats | float = 0.0) -> None:
        # Left singular vectors of B and squared singular values, from the smaller of BᵀB and BBᵀ,
        # which costs much less than a singular value decomposition.
        k, r = columns.shape[-2:]
        turned = np.swapaxes(columns, -1, -2)
        size2, self._left = np.linalg.eigh(turned @ columns if r < k else columns @ turned)
        size2 = np.where(size2 > _ROUNDING * size2[..., -1:], size2, 0.0)[..., None, :]
        if r < k:
            stretch = np.divide(1.0, np.sqrt(size2), out=np.zeros_like(size2), where=size2 > 0.0)
            self._left = columns @ (self._left * stretch)
        self._sigma2 = noise.sigma[:, None] ** 2
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
        """How columns c of (..., k, q) weigh and match one residual (..., k).

        Returns:
            cᵀ S⁻¹ c and cᵀ S⁻¹ r, each of shape (..., g, q).
        """
        inside = self._inside(patterns)
        outside = np.swapaxes(np.swapaxes(patterns, -1, -2) @ residual[..., None], -1, -2)
        match = outside - self._shrink @ (inside * self._inside(residual[..., None]))
        match /= self._sigma2
        return self._quadratic(patterns, inside), match

    def _inside(self, vectors: Floats) -> Floats:
        return np.asarray(np.swapaxes(self._left, -1, -2) @ vectors)

    def _quadratic(self, vectors: Floats, inside: Floats) -> Floats:
        """vᵀ S⁻¹ v of each column."""
        outside = (vectors**2).sum(axis=-2)[..., None, :]
        return np.asarray((outside - self._shrink @ inside**2) / self._sigma2)


class Patchy(Gaussian):
    """The same of noise that differs from datum to datum: S = diag(σ² + rough²·spectrum) + B Bᵀ.

    By the lemma of Woodbury, with M = I + Bᵀ D⁻¹ B for the diagonal D. Arguments as of
    `NoiseGrid.density`, for a grid with a spectrum.
    """

    def __init__(
        self, columns: Floats, sizes: Floats, noise: NoiseGrid, log_share: Floats | float = 0.0
    ) -> None:
        variance = noise.variance
        self._weight = 1.0 / variance  # (g, k)
        self._columns = columns
        self._sizes = sizes[..., None, :, None]  # (..., s, 1, r, 1)
        both = self._sizes * sizes[..., None, None, :]
        inner = self._turned(columns[..., None, :, :])
        root = np.linalg.cholesky(np.eye(columns.shape[-1]) + both * inner)
        self._root = np.linalg.inv(root)  # (..., s, g, r, r)
        log_det = 2.0 * np.log(np.einsum("...ii->...i", root)).sum(axis=-1)
        share = np.asarray(log_share)[..., None] + noise.log_weight
        self._log_share = share - 0.5 * (log_det + np.log(variance).sum(axis=-1))

    def log_density(self, residuals: Floats) -> Floats:
        """As of `Gaussian`."""
        inside = self._inside(residuals)
        quadratic = self._weight @ residuals**2 - (inside**2).sum(axis=-2)
        return np.asarray(self._log_share[..., None] - 0.5 * quadratic)

    def against(self, patterns: Floats, residual: Floats) -> tuple[Floats, Floats]:
        """As of `Gaussian`."""
        power, match, own = [], [], self._inside(residual[..., None])
        for g, weight in enumerate(self._weight):
            inside = self._inside_at(g, patterns)
            power.append(weight @ patterns**2 - (inside**2).sum(axis=-2))
            weighed = ((weight * residual)[..., None, :] @ patterns)[..., 0, :]
            match.append(weighed - (inside * own[..., g, :, :]).sum(axis=-2))
        return np.stack(power, axis=-2), np.stack(match, axis=-2)

    def _turned(self, vectors: Floats) -> Floats:
        """Bᵀ D⁻¹ v of columns (..., s, k, q) at every σ, sizes of B left out: (..., s, g, r, q)."""
        turned = np.swapaxes(self._columns, -1, -2)[..., None, None, :, :]
        return np.asarray(turned @ (self._weight[..., None] * vectors[..., None, :, :]))

    def _inside(self, vectors: Floats) -> Floats:
        """L⁻¹ Bᵀ D⁻¹ v of each column of (..., s, k, q) at every σ, shape (..., s, g, r, q)."""
        return np.asarray((self._root * np.swapaxes(self._sizes, -1, -2)) @ self._turned(vectors))

    def _inside_at(self, g: int, vectors: Floats) -> Floats:
        """The same at one σ, shape (..., s, r, q)."""
        turned = np.swapaxes(self._columns, -1, -2)[..., None, :, :]
        scaled = self._root[..., g, :, :] * self._sizes[..., 0, :, 0][..., None, :]
        return np.asarray(scaled @ (turned @ (self._weight[g][:, None] * vectors)))
