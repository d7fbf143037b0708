"""Exact evidence of linear-Gaussian explanations.

An explanation says r = B b + e with b ~ N(0, I) (columns of B scaled by plausible sizes) and
e ~ N(0, σ² I). Its evidence is the density of r with b integrated out,

    −2 ln p(r) = rᵀ S⁻¹ r + ln det S,   S = σ² I + B Bᵀ,

averaged over a grid of σ around what the gauge's maker states. An explanation with more freedom
than it needs spreads its density thin and loses: so causes of different size are comparable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from orthoglide_cal.estimation.gaussian import log_sum
from orthoglide_cal.estimation.solution import Contrasts, Reduction
from orthoglide_cal.model.plan import Floats, Ints, Patterns, ReadOnly, read_only

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
        """Make it of a shape whose independent parts add these columns to the data, (k, m)."""
        axes, size, _ = np.linalg.svd(columns, full_matrices=False)
        return cls(axes, size**2, rest, assumed)

    @property
    def columns(self) -> Floats:
        """Its parts along the axes, shape (k, m) [mm]."""
        return np.asarray(self.axes * np.sqrt(self.spectrum))

    def precision(self, ratio: float) -> tuple[float, Floats, float]:
        """(1 + ratio²·shape)⁻¹: in general, and how much more along each axis; ln det before."""
        general, along = 1.0 + ratio**2 * self.rest, 1.0 + ratio**2 * self.spectrum
        log_det = np.log(along).sum() + (len(self.axes) - along.size) * math.log(general)
        return 1.0 / general, 1.0 / along - 1.0 / general, float(log_det)

    def whitened(self, noise_mm: float) -> tuple[float, Floats]:
        """Factors that make the data independent, of unit noise: in general, along each axis."""
        general, more, _ = self.precision(1.0 / noise_mm)
        return math.sqrt(general), np.sqrt(1.0 + more / general)


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
        if texture is None:
            weight = -0.5 * (_LOG_RATIO / STATEMENT_SPREAD) ** 2
            return cls(stated_mm * np.exp(_LOG_RATIO), weight - log_sum(weight))
        assumed, sizes = texture.assumed, _ROUGH
        ratio = -0.5 * (np.log(_PROBE_RATIO) / PROBE_SPREAD[assumed]) ** 2
        size = -0.5 * (np.log(sizes) / ROUGH_SPREAD[assumed]) ** 2
        size -= log_sum(size)
        if assumed:
            sizes = np.append(sizes, 0.0)
            size = np.append(size + math.log(1.0 - SMOOTH), math.log(SMOOTH))
        weight = np.add.outer(ratio - log_sum(ratio), size).reshape(-1)
        sigma = np.repeat(stated_mm * _PROBE_RATIO, len(sizes))
        return cls(sigma, weight, texture, np.tile(sizes, len(ratio)))

    @cached_property
    def stated(self) -> float:
        """The likeliest of them: what the gauge's maker states [mm]."""
        return float(self.sigma[np.argmax(self.log_weight)])

    def wider(self, factors: Floats) -> NoiseGrid:
        """The same of noise that is larger by each factor (f,), one after the other, (f·g,)."""
        sigma, times, scale = np.outer(factors, self.sigma), len(factors), self.scale_factor
        scale = None if scale is None else np.tile(scale, times)
        return NoiseGrid(sigma.reshape(-1), np.tile(self.log_weight, times), self.texture, scale)

    @cached_property
    def by_ratio(self) -> Sequence[tuple[float, Ints | slice]]:
        """Ratios of that shape to the noise, each with the numbers of the σ that it belongs to."""
        if self.scale_factor is None:
            return [(0.0, slice(None))]
        ratios, number = np.unique(self.scale_factor / self.sigma, return_inverse=True)
        return [(ratio, np.flatnonzero(number == k)) for k, ratio in enumerate(ratios.tolist())]


# The noise of whitened values.
UNIT = NoiseGrid(np.ones(1), np.zeros(1))


@dataclass(frozen=True, eq=False)
class Places(ReadOnly):
    """W·patterns, one column for each place, shape (k, P), not written out."""

    reduction: Reduction
    patterns: Patterns

    def __len__(self) -> int:
        return len(self.patterns)

    def products(self, columns: Floats) -> Floats:
        """Products with columns (..., k, c), shape (..., c, P)."""
        return self.patterns.products(self.reduction.T @ columns).swapaxes(-1, -2)

    @cached_property
    def power(self) -> Floats:
        """Sum of squares of each, shape (P,)."""
        if not isinstance(self.reduction, Contrasts):
            return read_only((self.products(np.eye(len(self.reduction))) ** 2).sum(axis=0))
        precision = self.reduction.precision[:, None]
        taken = self.patterns.products(precision * self.reduction.zeros)
        return read_only(self.patterns.squares(precision) - (taken**2).sum(axis=1))

    def columns(self, chosen: slice | Sequence[int]) -> Floats:
        """Write out some of them, shape (k, q)."""
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


class _OneRatio(NamedTuple):
    """Parts that the densities for several σ share if a local shape is a multiple of each."""

    rows: Ints | slice  # numbers of these σ, shape (g,)
    variance: Floats  # their squares, (g, 1) [mm²]
    general: float  # σ² D⁻¹ in general
    more: Floats  # and in addition along each axis, shape (m,)
    along: Floats  # Bᵀ along the axes, by the latter, (..., r, m)
    turn: Floats  # takes σ² Bᵀ D⁻¹ v to components along singular vectors of B, (..., s, r, r)
    shrink: Floats  # share of each that B explains, by σ², (..., s, g, r) [mm⁻²]

    def turned(self, columns: Overlap) -> Floats:
        """Components of columns, shape (..., s, r, q)."""
        inside = columns.inside
        if self.more.size:
            inside = self.general * inside + self.along @ columns.along
        return np.asarray(self.turn @ inside[..., None, :, :])


class Gaussian:
    """Density of residuals under B at several sizes for each noise of a grid: S = D + B Bᵀ.

    D = σ² (1 + ρ² texture) of noise and of a local shape, ρ times as large as the noise; for one ρ
    all σ have the same axes. All follows from products of columns: nothing is of shape (k, k).

    `columns` are B without sizes, (..., k, r): columns of zeros add nothing, leading axes (...) are
    many densities at once. Of each unknown `sizes` are plausible, (..., s, r), ln of their prior
    shares is `log_share`, (s,).
    """

    def __init__(
        self, columns: Floats, sizes: Floats, noise: NoiseGrid, log_share: Floats | float = 0.0
    ) -> None:
        without = Texture(np.zeros((columns.shape[-2], 0)), np.zeros(0), 0.0, assumed=False)
        texture = noise.texture or without
        self._columns, self._axes = columns, texture.axes
        gram, along = np.swapaxes(columns, -1, -2) @ columns, texture.axes.T @ columns
        leading = np.broadcast_shapes(columns.shape[:-2], sizes.shape[:-2])
        log_det = np.empty((*leading, sizes.shape[-2], len(noise.sigma)))
        self._by_ratio: list[_OneRatio] = []
        for ratio, rows in noise.by_ratio:
            general, more, log_texture = texture.precision(ratio)
            weighted, variance = np.swapaxes(along, -1, -2) * more, noise.sigma[rows, None] ** 2
            scaled = sizes[..., :, None] * (general * gram + weighted @ along)[..., None, :, :]
            size2, axes = np.linalg.eigh(scaled * sizes[..., None, :])
            size2 = np.where(size2 > _ROUNDING * size2[..., -1:], size2, 0.0)[..., None, :]
            stretch = np.divide(1.0, np.sqrt(size2), out=np.zeros_like(size2), where=size2 > 0.0)
            turn = np.swapaxes(axes * stretch, -1, -2) * sizes[..., None, :]
            shrink = size2 / (variance + size2) / variance
            self._by_ratio.append(_OneRatio(rows, variance, general, more, weighted, turn, shrink))
            log_det[..., rows] = np.log1p(size2 / variance).sum(axis=-1) + log_texture
        log_det += len(texture.axes) * np.log(noise.sigma**2)
        self._by_size = noise.log_weight - 0.5 * log_det
        self._log_share = np.asarray(log_share)[..., None] + self._by_size

    def at_sizes(self, some: slice, log_share: Floats) -> Gaussian:
        """The same at some of the sizes only, with other prior shares."""
        other = copy(self)
        other._by_ratio = [
            one._replace(turn=one.turn[..., some, :, :], shrink=one.shrink[..., some, :, :])
            for one in self._by_ratio
        ]
        other._by_size = self._by_size[..., some, :]
        other._log_share = log_share[:, None] + other._by_size
        return other

    def log_density(self, residuals: Floats) -> Floats:
        """ln p of columns (..., k, q) with each σ's weight, (..., s, g, q); without constant."""
        columns = self.overlap(residuals, residuals[..., 0])
        (quadratic,) = self._weigh(columns, (columns.power, columns))
        return np.asarray(self._log_share[..., None] - 0.5 * quadratic)

    def by_noise(self, residual: Floats) -> Floats:
        """The same of one residual (k,), shape (..., s, g)."""
        return np.asarray(self.log_density(residual[:, None])[..., 0])

    def overlap(self, columns: Floats | Places, residual: Floats) -> Overlap:
        """Products of columns (..., k, q), or of all places, and one residual (..., k)."""
        ours, axes, values = self._columns, self._axes, residual[..., None]
        if isinstance(columns, Places):
            leading = np.broadcast_shapes(values.shape[:-1], ours.shape[:-1])
            both = [np.broadcast_to(part, (*leading, part.shape[-1])) for part in (values, ours)]
            products = columns.products(np.concatenate(both, axis=-1))
            along = columns.products(axes) if axes.size else np.zeros((0, len(columns)))
            return Overlap(columns.power, products[..., 0, :], products[..., 1:, :], along)
        match, inside = (np.swapaxes(one, -1, -2) @ columns for one in (values, ours))
        return Overlap((columns**2).sum(axis=-2), match[..., 0, :], inside, axes.T @ columns)

    def against(self, columns: Overlap, data: Overlap) -> tuple[Floats, Floats]:
        """cᵀ S⁻¹ c and cᵀ S⁻¹ r, each (..., s, g, q), of columns c; `data` is r as one column."""
        power, match = self._weigh(columns, (columns.power, columns), (columns.match, data))
        return power, match

    def _weigh(self, columns: Overlap, *others: tuple[Floats, Overlap]) -> list[Floats]:
        """cᵀ S⁻¹ v of columns c with as many others v, or one, (..., s, g, q); of cᵀ v (..., q)."""
        shape = self._log_share.shape
        weighed = [np.empty((*shape, plain.shape[-1])) for plain, _ in others]
        across = [columns.along * other.along for _, other in others]
        for one in self._by_ratio:
            turned = one.turned(columns)
            for filled, along, (plain, other) in zip(weighed, across, others, strict=True):
                taken = one.shrink @ (turned * (turned if other is columns else one.turned(other)))
                left = (one.general * plain + one.more @ along)[..., None, None, :] / one.variance
                filled[..., one.rows, :] = np.subtract(left, taken, out=taken)
        return weighed
