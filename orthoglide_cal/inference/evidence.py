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
from functools import cached_property
from typing import NamedTuple

import numpy as np

from orthoglide_cal.estimation.gaussian import log_sum
from orthoglide_cal.model.plan import (
    Contrasts,
    Floats,
    Ints,
    Patterns,
    ReadOnly,
    Reduction,
    read_only,
)

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
class Texture(ReadOnly):
    """Variance of the data through a local shape that neighbours share, as large as is stated."""

    axes: Floats  # along which it is independent, orthonormal, shape (k, m)
    spectrum: Floats  # variance along each, shape (m,) [mm²]
    rest: float  # in any other direction [mm²]
    assumed: bool  # nobody stated how large that shape is

    @classmethod
    def of(cls, columns: Floats, rest: float, assumed: bool) -> Texture:
        """Of a shape whose independent parts add these columns to the data, shape (k, m)."""
        axes, size, _ = np.linalg.svd(columns, full_matrices=False)
        return cls(axes, size**2, rest, assumed)

    @property
    def columns(self) -> Floats:
        """Its parts along the axes, shape (k, m) [mm]."""
        return np.asarray(self.axes * np.sqrt(self.spectrum))

    def whitened(self, noise_mm: float) -> tuple[float, Floats]:
        """Factors that make the data independent, of unit noise: in general, along each axis."""
        general = 1.0 / math.sqrt(1.0 + self.rest / noise_mm**2)
        return general, 1.0 / np.sqrt(1.0 + self.spectrum / noise_mm**2) / general


@dataclass(frozen=True, eq=False)
class NoiseGrid(ReadOnly):
    """Plausible standard deviations of one reading and their log weights, shape (g,)."""

    sigma: Floats  # of noise that no two readings share [mm]
    log_weight: Floats  # of each
    texture: Texture | None = None
    scale_factor: Floats | None = None  # how many times as large that shape is, (g,)

    @classmethod
    def around(cls, stated_mm: float, texture: Texture | None = None) -> NoiseGrid:
        """Log-normal around the stated noise [mm]; with a local shape also around its size.

        If nobody stated that there is one, it is as likely that there is none.
        """
        if texture is not None:
            assumed = texture.assumed
            ratio = -0.5 * (np.log(_PROBE_RATIO) / PROBE_SPREAD[assumed]) ** 2
            size = -0.5 * (np.log(_ROUGH) / ROUGH_SPREAD[assumed]) ** 2
            sizes, size = _ROUGH, size - log_sum(size)
            if assumed:
                sizes = np.append(sizes, 0.0)
                size = np.append(size + math.log(1.0 - SMOOTH), math.log(SMOOTH))
            weight = np.add.outer(ratio - log_sum(ratio), size)
            sigma = np.broadcast_to(stated_mm * _PROBE_RATIO[:, None], weight.shape)
            scale_factor = np.broadcast_to(sizes, weight.shape)
            return cls(sigma.reshape(-1), weight.reshape(-1), texture, scale_factor.reshape(-1))
        weight = -0.5 * (_LOG_RATIO / STATEMENT_SPREAD) ** 2
        return cls(stated_mm * np.exp(_LOG_RATIO), weight - log_sum(weight))

    @cached_property
    def stated(self) -> float:
        """The likeliest of them: what the gauge's maker states [mm]."""
        return float(self.sigma[np.argmax(self.log_weight)])

    def wider(self, factors: Floats) -> NoiseGrid:
        """The same of noise that is larger by each factor (f,), one after the other, (f·g,)."""
        sigma = np.outer(factors, self.sigma).reshape(-1)
        times = len(factors)
        scale = None if self.scale_factor is None else np.tile(self.scale_factor, times)
        return NoiseGrid(sigma, np.tile(self.log_weight, times), self.texture, scale)

    def density(self, columns: Floats, sizes: Floats, log_share: Floats | float = 0.0) -> Gaussian:
        """Density of residuals under the same columns (..., k, r) at several sizes.

        `sizes` are the plausible ones of the unknown of each column, shape (..., s, r); `log_share`
        is ln of their prior shares, shape (s,).
        """
        kind = Gaussian if self.texture is None else Patchy
        return kind(columns, sizes, self, log_share)


@dataclass(frozen=True, eq=False)
class Places(ReadOnly):
    """W·patterns, one column for each place, shape (k, P), not written out."""

    reduction: Reduction
    patterns: Patterns

    def __len__(self) -> int:
        return len(self.patterns)

    def products(self, columns: Floats) -> Floats:
        """With columns (..., k, c), shape (..., c, P)."""
        return self.patterns.products(self.reduction.T @ columns).swapaxes(-1, -2)

    @cached_property
    def power(self) -> Floats:
        """Sum of squares of each, shape (P,)."""
        if not isinstance(self.reduction, Contrasts):
            return read_only((self.products(np.eye(len(self.reduction))) ** 2).sum(axis=0))
        precision = self.reduction.precision[:, None]
        taken = self.patterns.products(precision * self.reduction.zeros)
        return read_only(self.patterns.squares(precision) - (taken**2).sum(axis=1))

    def columns(self, chosen: slice) -> Floats:
        """Some of them, written out, shape (k, q)."""
        return self.reduction @ self.patterns.columns(chosen)


class Overlap(NamedTuple):
    """Products of columns c (..., k, q) with a density, and with one residual r."""

    power: Floats  # cᵀ c, shape (..., q)
    match: Floats  # cᵀ r, shape (..., q)
    inside: Floats  # Bᵀ c without sizes, shape (..., r, q)
    along: Floats  # along the axes of a texture, shape (..., m, q)

    def some(self, chosen: slice | Ints) -> Overlap:
        """The same of some of the columns."""
        return Overlap(*(part[..., chosen] for part in self))


class Gaussian:
    """Density of residuals under B at several sizes for each σ of a grid: S = σ² I + B Bᵀ.

    Arguments as of `NoiseGrid.density`: columns of zeros add nothing, and leading axes (...) are
    many densities at once. All follows from products of columns: nothing is of shape (k, k).
    """

    def __init__(
        self, columns: Floats, sizes: Floats, noise: NoiseGrid, log_share: Floats | float = 0.0
    ) -> None:
        self._columns, self._axes = columns, np.zeros((columns.shape[-2], 0))
        gram = np.swapaxes(columns, -1, -2) @ columns
        scaled = sizes[..., :, None] * gram[..., None, :, :] * sizes[..., None, :]
        size2, axes = np.linalg.eigh(scaled)
        size2 = np.where(size2 > _ROUNDING * size2[..., -1:], size2, 0.0)[..., None, :]
        stretch = np.divide(1.0, np.sqrt(size2), out=np.zeros_like(size2), where=size2 > 0.0)
        # Takes Bᵀ v to its components along the left singular vectors of B, (..., s, r, r).
        self._turn = np.swapaxes(axes * stretch, -1, -2) * sizes[..., None, :]
        self._sigma2 = noise.sigma[:, None] ** 2
        self._shrink = size2 / (self._sigma2 + size2)  # (..., s, g, r)
        constant = columns.shape[-2] * np.log(self._sigma2[:, 0])
        log_det = np.log1p(size2 / self._sigma2).sum(axis=-1) + constant
        self._log_share = np.asarray(log_share)[..., None] + noise.log_weight - 0.5 * log_det

    def log_density(self, residuals: Floats) -> Floats:
        """ln p of columns (..., k, q) with each σ's weight, (..., s, g, q); without constant."""
        quadratic = self._quadratic(self.overlap(residuals, residuals[..., 0]))
        return np.asarray(self._log_share[..., None] - 0.5 * quadratic)

    def by_noise(self, residual: Floats) -> Floats:
        """The same of one residual (k,), shape (..., s, g)."""
        return np.asarray(self.log_density(residual[:, None])[..., 0])

    def overlap(self, columns: Floats | Places, residual: Floats) -> Overlap:
        """Products of columns (..., k, q), or of all places, and one residual (..., k)."""
        ours, axes, values = self._columns, self._axes, residual[..., None]
        if isinstance(columns, Places):
            match, inside, along = map(columns.products, (values, ours, axes))
            return Overlap(columns.power, match[..., 0, :], inside, along)
        match, inside = (np.swapaxes(one, -1, -2) @ columns for one in (values, ours))
        return Overlap((columns**2).sum(axis=-2), match[..., 0, :], inside, axes.T @ columns)

    def against(self, columns: Overlap, residual: Floats) -> tuple[Floats, Floats]:
        """Weights of columns c and their matches with the residual r (..., k) of their overlap.

        Returns:
            cᵀ S⁻¹ c and cᵀ S⁻¹ r, each of shape (..., s, g, q).
        """
        turned = self._turned(columns)
        along = self._turned(self.overlap(residual[..., None], residual))
        match = columns.match[..., None, None, :] - self._shrink @ (turned * along)
        match /= self._sigma2
        return self._quadratic(columns, turned), match

    def _turned(self, columns: Overlap) -> Floats:
        """Components along the left singular vectors of B, shape (..., s, r, q)."""
        return np.asarray(self._turn @ columns.inside[..., None, :, :])

    def _quadratic(self, columns: Overlap, turned: Floats | None = None) -> Floats:
        """cᵀ S⁻¹ c, shape (..., s, g, q)."""
        turned = self._turned(columns) if turned is None else turned
        power = columns.power[..., None, None, :]
        return np.asarray((power - self._shrink @ turned**2) / self._sigma2)


class Patchy(Gaussian):
    """The same of data that also share a local shape: S = σ² I + rough²·texture + B Bᵀ.

    By the lemma of Woodbury, with M = I + Bᵀ D⁻¹ B and D what is left without B.
    """

    def __init__(
        self, columns: Floats, sizes: Floats, noise: NoiseGrid, log_share: Floats | float = 0.0
    ) -> None:
        texture, factor = noise.texture, noise.scale_factor
        assert texture is not None
        assert factor is not None
        self._columns, self._axes = columns, texture.axes
        general = noise.sigma**2 + factor**2 * texture.rest
        variance = noise.sigma[:, None] ** 2 + factor[:, None] ** 2 * texture.spectrum
        self._general = 1.0 / general  # D⁻¹ in general, (g,)
        self._more = 1.0 / variance - self._general[:, None]  # and in addition along each axis
        self._along = texture.axes.T @ columns  # (..., m, r)
        gram = np.swapaxes(columns, -1, -2) @ columns
        inner = np.stack(
            [self._between(g, gram, self._along) for g in range(len(general))], axis=-3
        )
        both = sizes[..., :, None] * sizes[..., None, :]
        root = np.linalg.cholesky(
            np.eye(columns.shape[-1]) + both[..., None, :, :] * inner[..., None, :, :, :]
        )
        self._turn = np.linalg.inv(root) * sizes[..., None, None, :]  # (..., s, g, r, r)
        log_det = 2.0 * np.log(np.einsum("...ii->...i", root)).sum(axis=-1)
        other = columns.shape[-2] - len(texture.spectrum)
        log_det += np.log(variance).sum(axis=-1) + other * np.log(general)
        self._log_share = np.asarray(log_share)[..., None] + noise.log_weight - 0.5 * log_det

    def against(self, columns: Overlap, residual: Floats) -> tuple[Floats, Floats]:
        """As of `Gaussian`."""
        data, match = self.overlap(residual[..., None], residual), []
        for g, (general, more) in enumerate(zip(self._general, self._more, strict=True)):
            plain = general * columns.match + ((more[:, None] * data.along) * columns.along).sum(-2)
            inside = (self._inside(g, columns) * self._inside(g, data)).sum(axis=-2)
            match.append(plain[..., None, :] - inside)
        return self._quadratic(columns), np.stack(match, axis=-2)

    def _between(self, g: int, inside: Floats, along: Floats) -> Floats:
        """Bᵀ D⁻¹ c at one σ without sizes, shape (..., r, q)."""
        more = np.swapaxes(self._along, -1, -2) @ (self._more[g][:, None] * along)
        return np.asarray(self._general[g] * inside + more)

    def _inside(self, g: int, columns: Overlap) -> Floats:
        """L⁻¹ Bᵀ D⁻¹ c with M = L Lᵀ at one σ, shape (..., s, r, q)."""
        between = self._between(g, columns.inside, columns.along)
        return np.asarray(self._turn[..., g, :, :] @ between[..., None, :, :])

    def _quadratic(self, columns: Overlap, turned: Floats | None = None) -> Floats:
        """As of `Gaussian`."""
        along2, squares = columns.along**2, []
        for g, (general, more) in enumerate(zip(self._general, self._more, strict=True)):
            plain = general * columns.power + more @ along2
            inside = (self._inside(g, columns) ** 2).sum(axis=-2)
            squares.append(plain[..., None, :] - inside)
        return np.stack(squares, axis=-2)
