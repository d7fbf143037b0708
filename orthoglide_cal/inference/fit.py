"""One explanation fitted nonlinearly, its evidence at its own best fit, and what it predicts.

For a linear-Gaussian model of the whitened data d = W y with covariance S, the error of
predicting a block B of readings from all others is (K_BB)⁻¹ (K y)_B with K = Wᵀ S⁻¹ W, and the
model's own statement of its covariance is (K_BB)⁻¹; gauge zeros have no part in K, and no refit
is needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, log_ndtr

from orthoglide_cal.causes import UNLISTED
from orthoglide_cal.errors import PostureError
from orthoglide_cal.estimation.gaussian import condition, log_sum, shrink, shrinking
from orthoglide_cal.estimation.solution import OPTIMAL, Contrasts, rms
from orthoglide_cal.inference.data import ONE_CAUSE, TWO_CAUSES, Ids, Whitened, ids_of, unit_of
from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid
from orthoglide_cal.inference.hypothesis import (
    BLUNDER_SCALES,
    LOG_ALL,
    Hypothesis,
    Pattern,
    Shape,
    all_or_one,
    density_of,
    others_wrong,
    pattern_densities,
)
from orthoglide_cal.losses import NEEDLESS_HOLD, OPEN_ANSWER, surprising
from orthoglide_cal.model.machine import Influence, Origin
from orthoglide_cal.model.model import Effect, differentiate, simulate
from orthoglide_cal.model.plan import Bools, Floats, Ints, ReadOnly, altered, read_only

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
# The prior of the offsets belongs to the evidence. Their values follow from the data alone: to find
# these it is widened by this factor.
OF_ANY_SIZE = 1e3
# So many touches for each calibrated parameter say how rough a bed is.
ENOUGH = 2

# The fit of the best listed causes must leave no more than noise, which the evidence lets be larger
# than stated. If something beyond the list stands in their place, an open question costs a
# measurement in vain; if not, to look for it in the set-up costs a hold.
MISFIT = surprising(UNLISTED / (ONE_CAUSE + TWO_CAUSES), OPEN_ANSWER, NEEDLESS_HOLD)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit(ReadOnly):
    """An explanation at its best fit.

    The unknowns are the offsets, the parameters of each effect in turn, and those of all that is
    uncertain of the data in addition to noise.
    """

    hypothesis: Hypothesis
    # The data that it is of, and their noise; both are others where some readings have more noise.
    white: Whitened
    noise: NoiseGrid
    # See `Hypothesis`; how much likelier the data make it than the prior does that widths are
    # positive is part of it.
    log_evidence: float
    log_positive: float = 0.0  # that part
    effects: tuple[Effect, ...] = ()  # causes with their best parameters and own covariance
    start: Floats  # offsets where it was linearised, shape (3,) [mm]
    covariance: Floats  # of all unknowns, shape (q, q), internal units
    slots: tuple[slice, ...]  # unknowns of each effect; none without a size, or with a known one
    linear: Floats  # whitened data minus the linearised model at zero unknowns, shape (k,) [mm]
    columns: Floats  # whitened derivatives by the unknowns, shape (k, q)
    centre: Floats  # what they are before there are data, shape (q,): zero but for widths
    sizes: Floats  # their plausible sizes about that, shape (q,)
    sigma: float  # standard deviation of one reading under this explanation [mm]
    scale_factor: float = 1.0  # how many times as large as stated a local shape is
    uncertain: tuple[Influence, ...]  # what else is uncertain of the data; its unknowns come last
    seen: Floats  # what of it shows where it was linearised, shape (k, b) [mm]
    # That it was extended with; of each but more noise the unknowns come behind those of causes.
    patterns: Mapping[Pattern, Shape] = field(default_factory=dict)

    @cached_property
    def offsets(self) -> Floats:
        """Offsets at the fit, shape (3,) [mm]."""
        return read_only(self.start + self.moved[: len(self.start)])

    @property
    def derivatives(self) -> Floats:
        """Columns of the offsets and of the causes with many parameters, shape (k, 3 + p)."""
        base = self.hypothesis.base
        return self.columns[:, : self.slots[len(base) - 1].stop if base else len(self.start)]

    @property
    def state(self) -> tuple[Floats, list[Effect]]:
        """The offsets and the causes with many parameters as they are so far."""
        pairs = zip(self.hypothesis.base, self.slots, strict=False)
        return self.offsets, [cause.at(self.moved[slot]) for cause, slot in pairs]

    @property
    def ids(self) -> Ids:
        """Ids of its causes, in the order of its effects."""
        return tuple(effect.cause.id for effect in self.effects)

    def with_local_shape(self, scale_factor: float | None = None) -> Fit:
        """The fit with a local shape so many times as large as stated; None: as these data say."""
        local = self.is_local
        if scale_factor is None:
            if np.count_nonzero(local) < ENOUGH * len(self.start):
                return self  # so few touches cannot tell it from a fault
            assert self.noise.scale_factor is not None
            shares = np.exp(self.by_noise - log_sum(self.by_noise))
            scale_factor = math.sqrt(shares @ self.noise.scale_factor**2)
        sizes = np.where(local, scale_factor, self.sizes)
        return replace(self, sizes=sizes, scale_factor=scale_factor)

    def with_sigma(self, by_noise: Floats) -> Fit:
        """The fit with σ and the covariance that follow from ln p by σ of its noise, (..., g)."""
        shares = np.exp(by_noise - log_sum(by_noise))
        sigma = float(np.sqrt(np.sum(shares @ self.noise.sigma**2) + self.rest))
        return altered(self, sigma=sigma, covariance=read_only(self._at(sigma)[1]))

    def with_effects(self, drafts: Sequence[Effect]) -> Fit:
        """The fit with these effects, of the sizes that it gives them, and their covariance."""
        unknowns = self.centre + self.moved
        effects = [
            replace(effect, theta=unknowns[slot], covariance=self.covariance[slot, slot])
            if slot.start < slot.stop
            else effect
            for effect, slot in zip(drafts, self.slots, strict=True)
        ]
        return altered(self, effects=tuple(effects))

    @property
    def offsets_covariance(self) -> Floats:
        """Covariance of the offsets alone, shape (3, 3), internal units."""
        width = self.offsets.size
        return self.covariance[:width, :width]

    def estimator(self, sigma: float) -> Floats:
        """Derivatives of the offsets by the data if the noise of one reading is σ [mm], (p, k)."""
        covariance = self._at(sigma)[1][: len(self.start)]
        return np.asarray(covariance @ self.columns.T / sigma**2)

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

    @cached_property
    def first_uncertain(self) -> int:
        """Index of the first unknown that is of what is uncertain of the data."""
        widths = (influence.columns.shape[1] for influence in self.uncertain)
        return int(len(self.sizes) - sum(widths))

    @cached_property
    def is_local(self) -> Bools:
        """True for unknowns that are a local shape, shape (q,)."""
        widths = [influence.columns.shape[1] for influence in self.uncertain]
        local = np.repeat([influence.local for influence in self.uncertain], widths)
        return read_only(np.append(np.zeros(self.first_uncertain), local), np.bool_)

    @cached_property
    def rest(self) -> float:
        """Variance of a reading by what of a local shape is too fine to be described [mm²]."""
        return self.scale_factor**2 * sum(influence.rest for influence in self.uncertain)

    @cached_property
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
        return read_only(self._at(self.stated)[0])

    def _at(self, sigma: float) -> tuple[Floats, Floats]:
        """Mean and covariance of the unknowns if the noise of one reading is σ [mm]."""
        sizes = self.sizes.copy()
        sizes[: len(self.start)] *= OF_ANY_SIZE
        return condition(self.columns, self.unexpected, sizes, sigma, self._square)

    @cached_property
    def _square(self) -> Floats:
        """CᵀC of its columns, shape (q, q)."""
        return read_only(self.columns.T @ self.columns)

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
        """ln p of the data at the fit, without constant and sizes of causes, but with bounds."""
        return self.log_positive - 0.5 * self.square / self.noise.stated**2

    @property
    def judged(self) -> Hypothesis:
        """The hypothesis with the evidence of its fit."""
        likelihood = self.log_likelihood if unit_of(self.effects) == 1.0 else None
        return replace(self.hypothesis, log_evidence=self.log_evidence, log_likelihood=likelihood)

    @property
    def scaled(self) -> Floats:
        """Columns of unknowns of unit size, without a local shape: part of the noise, (k, r)."""
        kept = ~self.is_local  # not kept: of thousands of touches hundreds of fits are
        return np.asarray(self.columns[:, kept] * self.sizes[kept])

    def log_density(self, noise: NoiseGrid) -> Floats:
        """ln p of the data at each σ, with its weight, shape (g,)."""
        scaled = self.scaled
        density = Gaussian(scaled, np.ones((1, scaled.shape[1])), noise)
        return np.asarray(density.by_noise(self.unexpected)[0])

    @cached_property
    def by_noise(self) -> Floats:
        """The same of its own noise."""
        return read_only(self.log_density(self.noise))

    def whitened(self, values: Floats) -> Floats:
        """Values (k,) or (k, q) in units of all that is uncertain, at the stated noise."""
        return shrink(self.textured(values), *self.axes)

    @cached_property
    def axes(self) -> tuple[Floats, Floats]:
        """Its unknowns among values that are independent but for them: see `shrinking`."""
        axes, factors = shrinking(self.textured(self.scaled))
        return read_only(axes), read_only(factors)

    def textured(self, values: Floats) -> Floats:
        """Values (k,) or (k, q) in units of noise and of a local shape, at the stated noise."""
        sigma, texture = self.noise.stated, self.white.texture
        if texture is None:
            return np.asarray(values / sigma)
        general, factors = texture.whitened(sigma)
        return np.asarray(general * shrink(values, texture.axes, factors) / sigma)


# Parameters that no machine has show as NaN, and are refused there; warnings would say no more.
@np.errstate(invalid="ignore")
def fit_hypothesis(hypothesis: Hypothesis, scale_factor: float | None = None) -> Fit:
    """Fit an explanation by Gauss–Newton with its priors, then judge it there.

    First with the linear model that it was scored with. Where that moves any parameter (even
    only the offsets) farther than noise would, again with the linear model at that fit: enough
    for ranking; once more for causes far beyond their size. `scale_factor`: see `Fit`; None: as
    large as these data make it.
    """
    fit = begun = _begin(hypothesis, scale_factor)
    at, white, slopes = hypothesis.linearised, hypothesis.linearised.white, fit.derivatives
    step, rounds = math.inf, 0
    width, end = len(fit.start), slopes.shape[1]
    data = at.versions[hypothesis.version] - hypothesis.added
    # From where they were linearised: the offsets alone, fitted to the data as recorded.
    moved = np.abs(np.append(fit.offsets - at.offsets[0], fit.moved[width:end]))
    # The parameters alone are an optimum to the last digit that is shown.
    most = math.sqrt(len(slopes)) if hypothesis.ids else OPTIMAL
    if float(np.linalg.norm(slopes, axis=0) @ moved) > at.noise.stated * most:
        rounds = ROUNDS
    for _ in range(rounds):
        offsets, effects = fit.state
        try:
            readings, slopes = differentiate(white.problem.model, offsets, white.plan, effects)
        except PostureError:  # No machine is like that: such an explanation stays as it was scored.
            break
        # The linear model of where it stands, and how far that moves the prediction, r.m.s. [mm].
        slopes, theta = white.matrix @ slopes, np.append(np.zeros(width), fit.moved[width:end])
        linear = data - white.matrix @ readings + slopes @ theta
        columns = np.hstack([slopes, fit.columns[:, end:]])
        fit = replace(fit, start=offsets, linear=linear, columns=columns)
        before, step = step, rms(slopes @ (fit.moved[:end] - theta))
        if not FAR_MM < step < 0.5 * before:
            break
    fit = _settle(fit)
    if fit is begun and hypothesis.by_noise is not None:  # as it was scored
        return _concluded(fit, hypothesis.by_noise, hypothesis.log_evidence)
    return _concluded(fit, *_evidence(fit))


def _begin(hypothesis: Hypothesis, scale_factor: float | None) -> Fit:
    """The fit with the linear model that a hypothesis was scored with."""
    at, base, extra = hypothesis.linearised, hypothesis.base, hypothesis.extra
    version = hypothesis.version
    # What one unit of an extra of unknown size does.
    free, free_size = np.zeros((len(at.white), 0)), np.zeros(0)
    if extra is not None and not extra.theta.size and not extra.cause.exchanges:
        free = at.extras[extra.cause.id].columns(extra.place)
        free_size = extra.cause.prior_std(at.white.machine) * max(BLUNDER_SCALES)
    # Undone, other offsets fit: what is uncertain of the data acts as with those.
    uncertain = at.white.uncertain(at.offsets[version]) if version else at.uncertain
    seen = at.shown(uncertain, at.jacobian) if version else at.seen
    # A cause of this explanation is not counted as uncertain again.
    uncertain = tuple(one for one in uncertain if one.source not in ids_of(*base))
    carried = at.white.side_by_side(uncertain)
    derivatives, linear = at.columns(base), at.residuals[version] - hypothesis.added
    # Sizes of offsets and causes; where a cause leaves them open, the likeliest.
    known, choices = at.sizes(base, hypothesis.scale), max((len(c.shares) for c in base), default=0)
    if choices:
        tried = [(scale, number) for scale in at.scales for number in range(choices)]
        others = *free_size.tolist(), *np.ones(seen.shape[1])
        every = np.stack([np.append(at.sizes(base, *choice), others) for choice in tried])
        shares = np.log([at.scales[scale] for scale, _ in tried])
        density = Gaussian(np.hstack([derivatives, free, seen]), every, at.noise, shares)
        known = at.sizes(base, *tried[int(np.argmax(log_sum(density.by_noise(linear), 1)))])
    sizes = np.concatenate([known, free_size, np.ones(carried.shape[1])])
    widths = [*(cause.unknowns for cause in base), *[free_size.size] * (extra is not None)]
    ends = np.cumsum([at.offsets.shape[1], *widths])
    return Fit(
        hypothesis=hypothesis,
        white=hypothesis.at.white,
        noise=at.noise,
        log_evidence=hypothesis.log_evidence,
        start=at.offsets[version],
        covariance=np.diag(sizes**2),
        slots=tuple(slice(*pair) for pair in pairwise(ends.tolist())),
        linear=linear,
        columns=np.hstack([derivatives, free, carried]),
        centre=np.zeros(len(sizes)),
        sizes=sizes,
        sigma=at.noise.stated,
        uncertain=uncertain,
        seen=seen,
    ).with_local_shape(scale_factor)


def _settle(fit: Fit) -> Fit:
    """The fit with what is uncertain of the data as it acts on a machine with these causes."""
    at, derivatives, width = fit.hypothesis.linearised, fit.derivatives, len(fit.start)
    caused = derivatives[:, width:] @ fit.moved[width : derivatives.shape[1]]
    stands = any(influence.source == Origin.GAUGE_PLACEMENT for influence in fit.uncertain)
    if not stands or rms(caused) <= STEEP * fit.noise.stated:
        return fit
    (offsets, effects), white = fit.state, at.white
    known = white.problem.model.extended(effects)
    try:
        gauges = white.machine.uncertain(white.plan, lambda other: simulate(known, offsets, other))
        anew = {one.source: replace(one, columns=white.matrix @ one.columns) for one in gauges}
    except PostureError:
        return fit
    uncertain = tuple(anew.get(influence.source, influence) for influence in fit.uncertain)
    columns = [fit.columns[:, : fit.first_uncertain], white.side_by_side(uncertain)]
    seen = at.shown(uncertain, derivatives[:, :width])
    return replace(fit, uncertain=uncertain, columns=np.hstack(columns), seen=seen)


def _evidence(fit: Fit) -> tuple[Floats, float]:
    """ln p by σ, if all parameters act, (s, g), and the evidence of a fit where it ended.

    Of a relabelling only the place at which it was undone.
    """
    hypothesis, at, seen, weight = fit.hypothesis, fit.hypothesis.linearised, fit.seen, 0.0
    base, extra, data = hypothesis.base, hypothesis.extra, fit.linear + hypothesis.added
    placed = None if extra is None else hypothesis.at.extras[extra.cause.id]
    if extra is not None and placed is not None:
        if placed.patterns is None:
            weight = placed.log_weight[extra.place]
        else:
            wrong, weight = others_wrong(at, placed, hypothesis.wrong_readings[:-1])
            seen = np.hstack((seen, wrong))
    # No other fault limits the size of one cause with many parameters.
    alone = len(base) < 2 and (extra is None or hypothesis.replanned is not None)
    scales = at.scales if alone else at.usual
    density = density_of(at, [base], scales, [fit.derivatives], [seen])
    by_noise = density.by_noise(data)
    if placed is None or placed.patterns is None:
        log = by_noise[0]
    else:
        blocks = pattern_densities(at, placed, density, data, by_noise)
        log = log_sum(np.stack([log_sum(log[0], -1) for _, log in blocks]), 0)
    evidence = float(log_sum(log))
    if base and alone:
        (evidence,) = all_or_one(at, base, data, [evidence], [fit.derivatives])
    elif base:
        evidence += LOG_ALL
    return log, evidence + weight


def _concluded(fit: Fit, by_noise: Floats, log_evidence: float) -> Fit:
    """The fit with its evidence and σ, bounds of what is positive, and the causes that it finds."""
    base, extra, bounds = fit.hypothesis.base, fit.hypothesis.extra, 0.0
    moved, fit = fit.moved, fit.with_sigma(by_noise)
    centre, sizes = np.zeros(len(fit.sizes)), fit.sizes.copy()
    for cause, slot in zip(base, fit.slots, strict=False):
        named = slice(slot.start, slot.start + len(cause.names))
        if cause.positive:
            std = np.sqrt(np.diag(fit.covariance)[named])
            bounds += float((log_ndtr(moved[named] / std) - math.log(0.5)).sum())
            mean, spread = HALF_NORMAL
            centre[named], sizes[named] = mean * sizes[named], spread * sizes[named]
    if np.any(centre):
        fit = replace(fit, centre=centre, sizes=sizes).with_sigma(by_noise)
    fit = fit.with_effects([*(cause.at(np.zeros(0)) for cause in base), *filter(None, [extra])])
    if any(round(effect.times(fit.white.machine)) > LARGEST for effect in fit.effects):
        log_evidence = -math.inf
    return altered(fit, log_evidence=log_evidence + bounds, log_positive=bounds)


@dataclass(frozen=True)
class HeldOut:
    """Errors of predicting what was not fitted."""

    rms_mm: float  # root mean square error, each weighed as in `Whitened.rms`
    ratio: float  # errors divided by what the model itself states for them, root mean square
    chance: float = 1.0  # of a larger ratio if the model is right; 1 of what was not asked


def leave_out(fit: Fit, blocks: Sequence[Ints]) -> tuple[Ints, Floats, HeldOut]:
    """Predict blocks of readings, or of differences (see `left_out`), each from all others.

    Errors of different blocks depend on each other: the square of n of them has the mean n and the
    variance 2 tr M², M = D^(−1/2) K D^(−1/2) with the blocks D of K, and is about χ² (Welch and
    Satterthwaite). Of the few differences of a table nothing is asked. Returns which they are,
    (m,), the errors, weighed as in `Whitened.rms`, (m,), and all together.
    """
    white = fit.white
    # S⁻¹ = (I − A Aᵀ)/σ²
    axes, factors = shrinking(fit.columns * (fit.sizes / fit.sigma))
    axes = axes * np.sqrt(1.0 - factors**2)
    # What each printed difference adds to the whitened data, or each reading; of these
    # Wᵀ W = P (I − Z̃ Z̃ᵀ) P, with P how precise they are.
    entries = white.matrix if white.root is None else np.asarray(np.linalg.inv(white.root))
    weight, unit = white.weight, np.ones(len(white.in_file))
    weighted = (entries.T @ (fit.unexpected - axes @ (axes.T @ fit.unexpected))) / weight
    taken = (entries.T @ axes) / weight[:, None]
    if isinstance(entries, Contrasts):
        taken = np.hstack((entries.zeros, taken))
    else:  # of a table each difference is a block
        unit = (entries**2).sum(axis=0)
    errors, square, alone = list[Floats](), 0.0, 0.0
    together = np.zeros((taken.shape[1],) * 2)
    for block in blocks:
        mine, values = taken[block], weighted[block]
        solved, (size, rank) = np.column_stack((values, mine)), mine.shape
        if size > rank:
            inner = np.linalg.solve(np.eye(rank) - mine.T @ mine, mine.T @ solved)
            solved += mine @ inner
        else:
            solved[:] = np.linalg.solve(np.diag(unit[block]) - mine @ mine.T, solved)
        errors.append(solved[:, 0])
        square += float(solved[:, 0] @ values) / fit.sigma**2
        within = mine.T @ solved[:, 1:]
        alone += float((within * within.T).sum())
        together += within
    errors_mm, chance = np.concatenate(errors), 1.0
    n = errors_mm.size
    if isinstance(entries, Contrasts):
        dof = n**2 / (n + float(np.sum(together**2)) - alone)
        chance = float(chdtrc(dof, square * dof / n))
    held = HeldOut(rms(errors_mm), math.sqrt(square / n), chance)
    return np.concatenate(blocks), errors_mm, held


def left_out(white: Whitened, wrong: Sequence[int] = (), cells: Ints | None = None) -> list[Ints]:
    """Entries to leave out together, in blocks, each of shape (size,).

    Those of one (leg, direction, posture) cell of the plan, each difference, or those of `cells`,
    (n,). Wrong readings, each by itself, no model can predict; they are not scored.
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
    return [np.flatnonzero(kept & (cells == cell)) for cell in np.unique(cells[kept])]
