"""One explanation fitted nonlinearly, its evidence at its own best fit, and what it predicts.

For a linear-Gaussian model of the whitened data d = W y with covariance S, the error of
predicting a block B of readings from all others is (K_BB)⁻¹ (K y)_B with K = Wᵀ S⁻¹ W, and the
model's own statement of its covariance is (K_BB)⁻¹; gauge zeros have no part in K, and no refit
is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, log_ndtr

from orthoglide_cal.causes import RelabelCause
from orthoglide_cal.errors import PostureError
from orthoglide_cal.estimation.accuracy import Scatter, rms
from orthoglide_cal.estimation.budget import Budget, Contribution, budget_of
from orthoglide_cal.estimation.gaussian import (
    condition,
    fit_size,
    log_sum,
    shrinking,
)
from orthoglide_cal.inference.candidates import Ids, ids_of
from orthoglide_cal.inference.data import Linearised, Whitened
from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid
from orthoglide_cal.inference.hypothesis import (
    BLUNDER_SCALES,
    LOG_ALL,
    Hypothesis,
    Remedy,
    all_or_one,
    density_of,
    others_wrong,
    pattern_densities,
)
from orthoglide_cal.model.cause import Effect
from orthoglide_cal.model.machine import Influence, Instrument
from orthoglide_cal.model.plan import Bools, Contrasts, Floats, Ints, ReadOnly, read_only

# Mean and standard deviation of what cannot be negative, of those without that bound.
HALF_NORMAL = math.sqrt(2.0 / math.pi), math.sqrt(1.0 - 2.0 / math.pi)
# A search that has just moved by more than this goes on: what is of second order in less, over the
# length of a leg, is far below any gauge. No more rounds than so many.
FAR_MM, ROUNDS = 0.1, 6
# Causes that move the readings by so many times the noise tilt what the gauges touch so much that
# it matters where a stand is.
STEEP = 100.0
# What needs a cause of more than so many times its plausible size is no explanation.
LARGEST = 30
# So many touches for each calibrated parameter say how rough a bed is.
ENOUGH = 2


@dataclass(frozen=True, eq=False)
class Fit(ReadOnly):
    """An explanation at its best fit.

    The unknowns are the offsets, the parameters of each effect in turn, and those of all that is
    uncertain of the data in addition to noise.
    """

    at: Linearised  # the linear model that it began with
    # The data that it is of, and their noise; both are others where some readings have more noise.
    white: Whitened
    noise: NoiseGrid
    # As of `Hypothesis`; how much likelier the data make it than the prior does that widths are
    # positive is part of it.
    log_evidence: float
    log_positive: float  # that part
    effects: tuple[Effect, ...]  # causes with their best parameters and own covariance
    offsets: Floats  # shape (3,) [mm]
    covariance: Floats  # of all unknowns, shape (q, q), internal units
    slots: tuple[slice, ...]  # unknowns of each effect; none without a size, or with a known one
    linear: Floats  # whitened data minus the linearised model at zero unknowns, shape (k,) [mm]
    columns: Floats  # whitened derivatives by the unknowns, shape (k, q)
    centre: Floats  # what they are before there are data, shape (q,): zero but for widths
    sizes: Floats  # their plausible sizes about that, shape (q,)
    sigma: float  # standard deviation of one reading under this explanation [mm]
    scale_factor: float  # how many times as large as stated a local shape is
    uncertain: tuple[Influence, ...]  # what else is uncertain of the data; its unknowns come last
    remedy: Remedy

    @property
    def ids(self) -> Ids:
        """Ids of its causes, in the order of its effects."""
        return tuple(effect.cause.id for effect in self.effects)

    @property
    def offsets_covariance(self) -> Floats:
        """Covariance of the offsets alone, shape (3, 3), internal units."""
        width = self.offsets.size
        return self.covariance[:width, :width]

    @property
    def unread(self) -> Fit:
        """The explanation as it was before there were data: causes of any plausible size."""
        effects = (
            e if e.covariance is None else replace(e, theta=self.centre[slot])
            for e, slot in zip(self.effects, self.slots, strict=True)
        )
        return replace(self, effects=tuple(effects), covariance=np.diag(self.sizes**2))

    @property
    def wrong_readings(self) -> tuple[int, ...]:
        """Indices of the readings that it calls wrong by an unknown amount."""
        return sum((effect.place for effect in self.effects if effect.cause.hides_reading), ())

    @property
    def unknowns(self) -> float:
        """Degrees of freedom that a fit with priors takes up: trace of its hat matrix."""
        return float(np.trace(self.covariance @ self.columns.T @ self.columns)) / self.sigma**2

    @property
    def first_uncertain(self) -> int:
        """Index of the first unknown that is of what is uncertain of the data."""
        widths = (influence.columns.shape[1] for influence in self.uncertain)
        return int(len(self.sizes) - sum(widths))

    @cached_property
    def is_local(self) -> Bools:
        """Which unknowns are a local shape, shape (q,)."""
        widths = [influence.columns.shape[1] for influence in self.uncertain]
        local = np.repeat([influence.local for influence in self.uncertain], widths)
        return read_only(np.append(np.zeros(self.first_uncertain), local), np.bool_)

    @property
    def rest(self) -> float:
        """Variance of a reading by what of a local shape is too fine to be described [mm²]."""
        return self.scale_factor**2 * sum(influence.rest for influence in self.uncertain)

    @property
    def stated(self) -> float:
        """Standard deviation of a reading as stated, that included [mm]."""
        return math.hypot(self.noise.stated, math.sqrt(self.rest))

    @cached_property
    def unexpected(self) -> Floats:
        """Data minus what is expected of them before there are any, shape (k,) [mm]."""
        return read_only(self.linear - self.columns @ self.centre)

    @cached_property
    def moved(self) -> Floats:
        """The unknowns, from where they were expected, shape (q,)."""
        return read_only(condition(self.columns, self.unexpected, self.sizes, self.stated)[0])

    @cached_property
    def residual(self) -> Floats:
        """Whitened data minus prediction, shape (k,) [mm]."""
        return read_only(self.unexpected - self.columns @ self.moved)

    @property
    def left(self) -> Floats:
        """Remainder after offsets and causes, a local shape included, shape (k,) [mm]."""
        return self.residual + self.columns[:, self.is_local] @ self.moved[self.is_local]

    @property
    def square(self) -> float:
        """Sum of squares that noise must have left, σ²·χ² [mm²].

        Of residuals, and how far what is uncertain of the data had to be stretched; of k − 3
        degrees of freedom, of the offsets alone.
        """
        stretched = self.stated * (self.moved / self.sizes)[self.first_uncertain :]
        square = float(self.residual @ self.residual + stretched @ stretched)
        return square * (self.noise.stated / self.stated) ** 2

    @property
    def log_likelihood(self) -> float:
        """ln p of the data at the fit, without its constant.

        The sizes of causes do not count, but that widths are positive does.
        """
        return self.log_positive - 0.5 * self.square / self.noise.stated**2

    @cached_property
    def scaled(self) -> Floats:
        """Columns of unknowns of unit size, without a local shape: part of the noise, (k, r)."""
        return read_only((self.columns * self.sizes)[:, ~self.is_local])

    def log_density(self, noise: NoiseGrid) -> Floats:
        """ln p of the data at each σ, with its weight, shape (g,)."""
        density = Gaussian(self.scaled, np.ones((1, self.scaled.shape[1])), noise)
        return np.asarray(density.by_noise(self.unexpected)[0])

    @cached_property
    def by_noise(self) -> Floats:
        """The same of its own noise."""
        return read_only(self.log_density(self.noise))

    def whitened(self, values: Floats) -> Floats:
        """Values (k,) or (k, q) in units of all that is uncertain, at the stated noise."""
        axes, factors = self._axes
        values = self._textured(values)
        return np.asarray(values - axes @ ((1.0 - factors) * (axes.T @ values).T).T)

    @cached_property
    def _axes(self) -> tuple[Floats, Floats]:
        axes, factors = shrinking(self._textured(self.scaled))
        return read_only(axes), read_only(factors)

    def _textured(self, values: Floats) -> Floats:
        sigma, texture = self.noise.stated, self.white.texture
        if texture is None:
            return np.asarray(values / sigma)
        general, factors = texture.whitened(sigma)
        along = texture.axes.T @ values
        values = values - texture.axes @ ((1.0 - factors) * along.T).T
        return np.asarray(general * values / sigma)

    def budget(self, gauge: Instrument) -> Budget:
        """The uncertainty of its offsets by source; what its causes leave open comes last."""
        width = len(self.offsets)
        estimator = self.covariance[:width] @ self.columns.T / self.sigma**2
        known = budget_of(estimator, gauge, Scatter(self.sigma, np.inf), self.uncertain)
        sized = [effect.cause.id for effect in self.effects if effect.covariance is not None]
        if not sized:
            return known
        left = self.offsets_covariance - known.covariance_mm2
        return known.extended([Contribution.beyond(" and ".join(sized), left)])


def fit_explanations(scores: Sequence[Hypothesis], scale_factor: float | None = None) -> list[Fit]:
    """Fit explanations by Gauss–Newton with their priors, then judge each there.

    First with the linear model that it was scored with. Where that moves any parameter (even
    only the offsets) farther than noise would, again with the linear model at that fit: enough
    for ranking; once more for causes far beyond their size. `scale_factor`: see `Fit`; None: as
    large as these data make it.
    """
    searches = [_Search(score.replanned or score, scale_factor) for score in scores]
    # One simulation gives the next linear models of all; the second is enough but for large causes.
    moving = [search for search in searches if search.beyond_noise]
    for _ in range(ROUNDS):
        far: list[_Search] = []
        for white in dict.fromkeys(search.at.white for search in moving):
            together = [search for search in moving if search.at.white is white]
            points = [(search.offsets, search.effects) for search in together]
            try:
                models = white.linearised(*points)
            except PostureError:
                # No machine is like that: such an explanation stays as it was scored.
                together = [search for search in together if search.possible]
                models = white.linearised(
                    *((search.offsets, search.effects) for search in together)
                )
            for search, (predicted, derivatives) in zip(together, models, strict=True):
                before, search.moved = search.moved, search.move(predicted, derivatives)
                if FAR_MM < search.moved < 0.5 * before:
                    far.append(search)
        moving = far
    for search in searches:
        search.settle()
    weighed: dict[_Search, tuple[Floats, float]] = {}
    for at in dict.fromkeys(search.at for search in searches):
        weighed |= _weighed(at, [search for search in searches if search.at is at])
    return [
        search.fitted(score, *weighed[search])
        for search, score in zip(searches, scores, strict=True)
    ]


def _weighed(at: Linearised, group: Sequence[_Search]) -> dict[_Search, tuple[Floats, float]]:
    """Log density by scale and σ if all parameters act, (s, g), and log evidence, where they ended.

    Of a relabelling only the place at which it was undone.
    """
    # What stays where it was scored is as likely as its score says.
    densities = {search: search.by_noise for search in group if search.by_noise is not None}
    moved = [search for search in group if search not in densities]
    logs = {search: search.score.log_evidence for search in densities}
    alone = [search for search in moved if search.score.extra is None and len(search.base) < 2]
    others = [search for search in moved if search not in alone]
    for scales, some in ((at.scales, alone), (at.usual, others)):
        if some:
            parts = ((search.derivatives, search.base, search.seen) for search in some)
            columns, bases, seen = zip(*parts, strict=True)
            density = density_of(at, columns, bases, scales, seen)
            residuals = np.stack([search.linear + search.added for search in some])[..., None]
            densities |= zip(some, density.log_density(residuals)[..., 0], strict=True)
    for search in others:
        extra = search.score.extra
        if extra is None:
            continue
        placed = at.extras[extra.cause.id]
        if isinstance(extra.cause, RelabelCause):
            densities[search] = densities[search] + placed.log_weight[extra.place]
            continue
        wrong, price = others_wrong(at, placed, search.score.wrong_readings[:-1])
        more = np.hstack((search.seen, wrong))
        density = density_of(at, [search.derivatives], [search.base], at.usual, [more])
        residual = search.linear + search.added
        by_noise = density.by_noise(residual) if wrong.size else densities[search][None]
        blocks = pattern_densities(at, placed, density, residual, by_noise)
        by_block = [log_sum(log[0] + placed.weights[where], (-2, -1)) for where, log in blocks]
        densities[search] = log_sum(np.stack(by_block), 0) + price
    logs |= {
        search: float(log_sum(densities[search])) + LOG_ALL * bool(search.base) for search in moved
    }
    if acting := [search for search in alone if search.base]:
        causes, columns = zip(*((s.base[0], s.derivatives) for s in acting), strict=True)
        log_all = [float(log_sum(densities[search])) for search in acting]
        either = all_or_one(at, causes, columns, [search.linear for search in acting], log_all)
        logs.update(zip(acting, either, strict=True))
    return {search: (by_noise, logs[search]) for search, by_noise in densities.items()}


class _Search:
    """An explanation on the way to its best fit."""

    def __init__(self, score: Hypothesis, scale_factor: float | None) -> None:
        at, self.base, extra = score.at, score.base, score.extra
        self.version, self.moved = 0, math.inf
        # What an extra of known size adds, and what one unit of one of unknown size does.
        self.added, self.free = np.zeros(len(at.white)), np.zeros((len(at.white), 0))
        free_size = np.zeros(0)
        if extra is not None:
            placed, machine = at.extras[extra.cause.id], at.white.machine
            if isinstance(placed.cause, RelabelCause):
                self.version = placed.first + placed.tried.index(extra.place)
            elif extra.theta.size:
                size = extra.theta * placed.cause.millimetres(machine)
                self.added = placed.columns(extra.place) @ size
            else:
                self.free = placed.columns(extra.place)
                free_size = extra.cause.prior_std(machine) * max(BLUNDER_SCALES)
        self.at, self.score, self.derivatives = at, score, at.columns(self.base)
        self.by_noise = score.by_noise  # as long as it stays where it was scored
        # A cause of this explanation is not counted as uncertain again.
        ids = ids_of(*self.base)
        offsets = at.offsets[self.version]
        uncertain = at.white.uncertain(offsets) if self.version else at.uncertain
        self.uncertain = tuple(influence for influence in uncertain if influence.source not in ids)
        self.carried = at.carried
        if self.uncertain != at.uncertain:
            nothing = np.zeros((len(at.white), 0))
            self.carried = np.hstack(
                [nothing, *(influence.columns for influence in self.uncertain)]
            )
        widths = [influence.columns.shape[1] for influence in self.uncertain]
        local = np.repeat([influence.local for influence in self.uncertain], widths)
        # Undone, other offsets fit: what is uncertain of the data acts as with those.
        self.seen = at.shown(uncertain, at.jacobian) if self.version else at.seen
        self.width = width = at.offsets.shape[1]
        own_sizes = self._own_sizes(free_size)
        self.sizes = np.concatenate([own_sizes, free_size, np.ones(local.size)])
        ends = np.cumsum([width, *(cause.unknowns for cause in self.base), free_size.size])
        self.slots = tuple(slice(*pair) for pair in pairwise(ends.tolist()))
        self.offsets = offsets
        self.linear = at.residuals[self.version] - self.added
        self.local = np.flatnonzero(local) + self.derivatives.shape[1] + free_size.size
        # Few touches cannot tell a local shape from a fault.
        many = self.local.size >= ENOUGH * width
        if scale_factor is None and many:
            columns = np.hstack([self.derivatives, self.free, self.carried])
            stated = math.hypot(at.noise.stated, math.sqrt(sum(e.rest for e in self.uncertain)))
            scale_factor = fit_size(columns, self.linear, self.sizes, stated, self.local)
        self.scale_factor = 1.0 if scale_factor is None else scale_factor
        self.sizes[self.local] = self.scale_factor
        # What of a local shape is too fine to be described, and the noise with it [mm², mm].
        self.rest = self.scale_factor**2 * sum(influence.rest for influence in self.uncertain)
        self.stated = math.hypot(at.noise.stated, math.sqrt(self.rest))
        self._solve()

    def _own_sizes(self, beside: Floats) -> Floats:
        """Plausible sizes of offsets and causes; where a cause leaves them open, the likeliest.

        `beside` is that of an extra of unknown size, shape (1,) or (0,).
        """
        at, scale = self.at, self.score.scale
        choices = max((len(cause.shares) for cause in self.base), default=0)
        if not choices:
            return at.sizes(self.base, scale)
        tried = [(s, n) for s in at.scales for n in range(choices)]
        sizes = np.stack([at.sizes(self.base, *choice) for choice in tried])
        rest = np.concatenate([beside, np.ones(self.seen.shape[1])])
        every = np.hstack([sizes, np.tile(rest, (len(sizes), 1))])
        shares = np.log([at.scales[s] for s, _ in tried])
        columns = np.hstack([self.derivatives, self.free, self.seen])
        density = Gaussian(columns, every, at.noise, shares)
        residual = at.residuals[self.version] - self.added
        likeliest = int(np.argmax(log_sum(density.by_noise(residual), 1)))
        return np.asarray(sizes[likeliest])

    @property
    def effects(self) -> list[Effect]:
        """The causes of the base as found so far."""
        pairs = zip(self.base, self.slots, strict=False)
        return [cause.at(self.unknowns[slot]) for cause, slot in pairs]

    @property
    def beyond_noise(self) -> bool:
        """True if it moves the data, each unknown by itself, by more than noise does.

        From where they were linearised: the offsets alone, fitted to the data as recorded.
        """
        theta = self.unknowns[self.width : self.derivatives.shape[1]]
        unknowns = np.concatenate([self.offsets - self.at.offsets[0], theta])
        moved = np.sqrt(np.mean(self.derivatives**2, axis=0)) @ np.abs(unknowns)
        return float(moved) > self.at.noise.stated

    @property
    def possible(self) -> bool:
        """True if a machine with its causes can take the postures of the plan."""
        try:
            self.at.white.linearised((self.offsets, self.effects))
        except PostureError:
            return False
        return True

    def _solve(self) -> None:
        # Derivatives of the data by all unknowns, shape (k, q).
        self.columns = np.hstack([self.derivatives, self.free, self.carried])
        self.columns.setflags(write=False)
        self.unknowns, _ = condition(self.columns, self.linear, self.sizes, self.stated)
        self.offsets = self.offsets + self.unknowns[: self.width]

    def move(self, predicted: Floats, derivatives: Floats) -> float:
        """Solve with the linear model of where it stands: prediction (k,), derivatives.

        How far this moves the prediction, r.m.s. [mm].
        """
        self.derivatives, self.by_noise = derivatives, None
        theta = self.unknowns[self.width : derivatives.shape[1]]
        self.linear = self.at.versions[self.version] - self.added - predicted
        self.linear += derivatives[:, self.width :] @ theta
        self._solve()
        step = self.unknowns[: derivatives.shape[1]].copy()
        step[self.width :] -= theta
        return rms(derivatives @ step)

    def settle(self) -> None:
        """Carry what is uncertain of the data as it acts on a machine with these causes."""
        at, uncertain = self.at, self.uncertain
        theta = self.unknowns[self.width : self.derivatives.shape[1]]
        caused = self.derivatives[:, self.width :] @ theta
        if rms(caused) > STEEP * at.noise.stated and self.possible:
            self.uncertain = at.white.with_effects(uncertain, self.offsets, self.effects)
        if self.uncertain is not uncertain:
            self.by_noise = None
            self.carried = np.hstack([influence.columns for influence in self.uncertain])
            self.seen = at.shown(self.uncertain, self.derivatives[:, : self.width])
            # Once more from where the last step began.
            self.offsets = self.offsets - self.unknowns[: self.width]
            self._solve()

    def fitted(self, score: Hypothesis, by_noise: Floats, log_evidence: float) -> Fit:
        """The fit, of this explanation or of the score of one that also holds an exchange; the rest
        as `_weighed` gives it."""
        at, columns, linear = self.at, self.columns, self.linear
        log = float(log_sum(by_noise))
        sigma = float(np.sqrt(np.sum(np.exp(by_noise - log) @ at.noise.sigma**2) + self.rest))
        _, covariance = condition(columns, linear, self.sizes, sigma)
        centre, sizes, unknowns = np.zeros(len(self.sizes)), self.sizes.copy(), self.unknowns
        bounds = 0.0
        for cause, slot in zip(self.base, self.slots, strict=False):
            named = slice(slot.start, slot.start + len(cause.names))
            if cause.positive:
                std = np.sqrt(np.diag(covariance)[named])
                bounds += float((log_ndtr(unknowns[named] / std) - math.log(0.5)).sum())
                mean, spread = HALF_NORMAL
                centre[named], sizes[named] = mean * sizes[named], spread * sizes[named]
        if np.any(centre):
            beyond = linear - columns @ centre
            unknowns = centre + condition(columns, beyond, sizes, self.stated)[0]
            _, covariance = condition(columns, beyond, sizes, sigma)
        effects = [
            Effect(cause, unknowns[slot], covariance=covariance[slot, slot])
            for cause, slot in zip(self.base, self.slots, strict=False)
        ]
        slots = self.slots[: len(effects)]
        if score.extra is not None:
            extra, slot = score.extra, self.slots[-1]
            if slot.start < slot.stop:
                known = covariance[slot, slot]
                extra = replace(extra, theta=unknowns[slot], covariance=known)
            effects.append(extra)
            slots = (*slots, slot)
        if any(round(effect.times(at.white.machine)) > LARGEST for effect in effects):
            log_evidence = -math.inf
        if score.replanned is not None:
            log_evidence += score.log_evidence - score.replanned.log_evidence
        return Fit(
            at=score.at,
            white=score.at.white,
            noise=score.at.noise,
            log_evidence=log_evidence + bounds,
            log_positive=bounds,
            effects=tuple(effects),
            offsets=self.offsets + (unknowns - self.unknowns)[: self.width],
            covariance=covariance,
            slots=slots,
            linear=linear,
            columns=columns,
            centre=centre,
            sizes=sizes,
            sigma=sigma,
            scale_factor=self.scale_factor,
            uncertain=self.uncertain,
            remedy=score.remedy,
        )


@dataclass(frozen=True)
class HeldOut:
    """Errors of predicting what was not fitted."""

    rms_mm: float  # root mean square error, each weighed as in `Whitened.rms`
    ratio: float  # errors divided by what the model itself states for them, root mean square
    chance: float = 1.0  # of a larger ratio if the model is right; 1 of what was not asked


def leave_out_cells(white: Whitened, fit: Fit, judged: Fit) -> HeldOut:
    """Predict each (leg, direction, posture) cell, or each difference, from all others by a fit.

    Readings that the accepted explanation, `judged`, calls wrong, each by itself, cannot be
    predicted by any model; they are not scored.
    """
    return leave_out(white, fit, left_out(white, judged.wrong_readings))[2]


def leave_out(white: Whitened, fit: Fit, blocks: Iterable[Ints]) -> tuple[Ints, Floats, HeldOut]:
    """Predict blocks of readings, or of differences, each from all others by a fit.

    Errors of different blocks depend on each other: the square of n of them has the mean n and the
    variance 2 tr M², M = D^(−1/2) K D^(−1/2) with the blocks D of K, and is about χ² (Welch and
    Satterthwaite). Of the few differences of a table nothing is asked.

    Returns:
        Which they are, (m,), the errors, weighed as in `Whitened.rms`, (m,), and all together.
    """
    # S⁻¹ = (I − A Aᵀ)/σ²
    axes, factors = shrinking(fit.columns * (fit.sizes / fit.sigma))
    axes = axes * np.sqrt(1.0 - factors**2)
    # What each printed difference adds to the whitened data, or each reading; of these
    # Wᵀ W = P (I − Z̃ Z̃ᵀ) P, with P how precise they are.
    entries = white.matrix if white.root is None else np.asarray(np.linalg.inv(white.root))
    weight = white.weight
    weighted = (entries.T @ (fit.unexpected - axes @ (axes.T @ fit.unexpected))) / weight
    taken = (entries.T @ axes) / weight[:, None]
    if isinstance(entries, Contrasts):
        taken = np.hstack((entries.zeros, taken))
    errors, square, alone, every = [], 0.0, 0.0, list(blocks)
    together = np.zeros((taken.shape[1],) * 2)
    for some in every:
        mine, values = taken[some], weighted[some][..., None]
        turned, (size, rank) = mine.swapaxes(-1, -2), mine.shape[1:]
        both = np.concatenate((values, mine), axis=-1)
        if size > rank:
            inner = np.linalg.solve(np.eye(rank) - turned @ mine, turned @ both)
            solved = np.asarray(both + mine @ inner)
        else:
            unit = np.eye(size) if isinstance(entries, Contrasts) else _gram(entries, some)
            solved = np.asarray(np.linalg.solve(unit - mine @ turned, both))
        error, spread = solved[..., :1], solved[..., 1:]
        errors.append(error.reshape(-1))
        square += float((error * values).sum()) / fit.sigma**2
        within = turned @ spread if size > rank else spread @ turned
        alone += float((within * within.swapaxes(-1, -2)).sum())
        together += np.tensordot(mine, spread, ((0, 1), (0, 1)))
    errors_mm, chance = np.concatenate(errors), 1.0
    n = errors_mm.size
    if isinstance(entries, Contrasts):
        dof = n**2 / (n + float(np.sum(together**2)) - alone)
        chance = float(chdtrc(dof, square * dof / n))
    held = HeldOut(rms(errors_mm), math.sqrt(square / n), chance)
    return np.concatenate([some.reshape(-1) for some in every]), errors_mm, held


def _gram(entries: Floats, blocks: Ints) -> Floats:
    """Eᵀ E of blocks (b, m) of columns of E, shape (b, m, m)."""
    return np.asarray((entries.T @ entries)[blocks[:, :, None], blocks[:, None, :]])


def left_out(white: Whitened, wrong: Sequence[int] = (), cells: Ints | None = None) -> list[Ints]:
    """Entries to leave out together; blocks of one size in one array, shape (blocks, size).

    Those of one cell of the plan, or of `cells`, (n,).
    """
    kept = np.full(len(white.in_file), True)
    if cells is None:
        cells = white.plan.cells if white.raw else np.arange(len(white))
    if white.raw:
        if white.plan.setups:
            # A set-up that leaves with its cell takes its zero along: nothing can predict it.
            shared = white.plan.shared
            _, first = np.unique(shared, return_index=True)
            several = np.bincount(shared[cells != cells[first][shared]], minlength=first.size) > 0
            kept = several[shared]
        kept[list(wrong)] = False
    by_size: dict[int, list[Ints]] = {}
    for cell in np.unique(cells[kept]):
        block = np.flatnonzero(kept & (cells == cell))
        by_size.setdefault(block.size, []).append(block)
    return [np.stack(blocks) for blocks in by_size.values()]
