"""What no listed cause makes: patterns of the readings, each a *how* at a *where*.

A how is one function of the course of a session and of the rows that the where selects; it gives
columns of unit size [mm] in one or several shapes (a moment, a time constant), which are averaged
over. Pattern and causes are weighed by one evidence: with C the columns, of size s, and S what
acts without them,

    ln p = ln p0 − ½ ln det(1 + s² G) + ½ mᵀ (1/s² + G)⁻¹ m,   G = Cᵀ S⁻¹ C,  m = Cᵀ S⁻¹ r

S is taken as large as the noise: for each σ of the grid the S of the stated one, times its square.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.special import erf

from orthoglide_cal.causes import UNLISTED, PatternCause
from orthoglide_cal.estimation.gaussian import condition, fit_size, log_sum
from orthoglide_cal.inference.data import Linearised, Whitened
from orthoglide_cal.inference.evidence import NoiseGrid, Texture
from orthoglide_cal.inference.fit import ENOUGH, Fit
from orthoglide_cal.inference.hypothesis import (
    BLUNDER_SCALES,
    Hypothesis,
    Pattern,
    of_any_size,
)
from orthoglide_cal.model.plan import (
    AT_ONCE,
    Bools,
    Contrasts,
    Floats,
    Ints,
    Plan,
    Reduction,
    Where,
    zero_free,
)

# Sizes at which a pattern is tried, and those of more noise, in standard deviations of a reading.
SIZES = np.array((5.0, 30.0))
NOISIER = np.geomspace(1.0, 16.0, 7)
# Time constants and periods, as shares of the longest set-up: from, to, and how many; of data that
# are not sound so many. A period holds so many readings, and the shortest is within these bounds.
# Moments of a step.
SETTLING, LONGEST, COARSE, FINE = (0.08, 0.8), 4.0, 5, 40
SMOOTH, SHORTEST = 5, (1.0 / 6.0, 0.5)
MOMENTS = 64
# Rounds in which the movements of plungers are found that lag.
ROUNDS = 3
# So many columns at most; cells beyond that number are no pattern.
MOST_COLUMNS = 64
MOST_PLACES = 512  # of more no cause is tried beside a pattern
# Cosine from which columns of one gauge can follow what a listed cause does there, and ln of the
# weight of these: all but one in a hundred of such effects have that cause.
ALIKE, LISTED, ROUNDING = 0.97, math.log(0.01), 1e-9
ABSENT = -1e9  # ln of the share of a shape that does not show


@dataclass(frozen=True, eq=False)
class Course:
    """What readings may follow, each of shape (n,)."""

    plan: Plan
    ordered: bool  # their order in time is known
    turned: Floats  # expected sign of the movement of a reading's own plunger before it
    kelvin: Floats  # the recorded temperature, less the first; zeros where none was
    fine: bool = False  # shapes are tried closely

    @classmethod
    def of(cls, white: Whitened, predicted: Floats, fine: bool) -> Course:
        """Of readings of which a model predicts this, whitened, shape (k,) [mm]."""
        plan, turned = white.plan, np.zeros(len(white.plan))
        if white.raw:
            rows, first = plan.sequence
            moved = np.diff(white.plain(predicted)[rows], prepend=0.0)
            noise = white.machine.instrument.noise_mm
            turned[rows] = np.where(first, 0.0, erf(0.5 * moved / noise))
        kelvin = np.zeros(len(plan)) if white.kelvin is None else white.kelvin
        return cls(plan, white.raw, turned, kelvin, fine)

    @property
    def longest(self) -> float:
        """How long the longest set-up takes, or 1 [h]."""
        return float(self.since.max(initial=0.0)) or 1.0

    def by_mover(self, values: Floats, parameters: Floats | None = None) -> Made:
        """Values (n,), or (n, v, b), in columns of their own for each of what moves as one."""
        movers, shapes = self.plan.movers, 1 if parameters is None else len(parameters)
        wide = values.reshape(len(self.plan), shapes, 1, -1)
        columns = movers.T[:, None, :, None] * wide
        number = np.repeat(np.arange(len(movers)), wide.shape[-1])
        return Made(columns.reshape(*wide.shape[:2], -1), number, parameters)

    @cached_property
    def since(self) -> Floats:
        """Time since each reading's set-up began, shape (n,) [h]."""
        began = np.full(int(self.plan.shared.max(initial=0)) + 1, np.inf)
        np.minimum.at(began, self.plan.shared, self.plan.hours)
        return np.asarray(self.plan.hours - began[self.plan.shared])


class Made(NamedTuple):
    """Columns of a how at every where: of each where those whose readings it selects."""

    columns: Floats  # of unit size, in v shapes, shape (n, v, q) [mm]
    mover: Ints  # number of the mover that each column is of, shape (q,)
    parameters: Floats | None = None  # of each shape, (v,): its moment, time constant, or span


def _repeats(course: Course) -> Made:
    """The same in each cycle."""
    columns = course.plan.returning
    # The first mover is part of nothing larger.
    return Made(columns[:, None], course.plan.movers[:, np.abs(columns).argmax(axis=0)].argmax(0))


def _drifts(course: Course) -> Made:
    """Smooth in time: a sine of each gauge, of a period that they share."""
    least = SMOOTH / np.bincount(course.plan.shared, minlength=1).max()
    least = float(np.clip(least, *SHORTEST))
    # Neighbours differ by the same part of a turn over the longest set-up.
    count = (FINE if course.fine else COARSE) * SHORTEST[1] / least
    turns = np.linspace(1.0 / LONGEST, 1.0 / least, round(count))
    periods = course.longest / turns
    turn = 2.0 * np.pi * course.since[:, None] / periods
    terms = np.stack((np.sin(turn), np.cos(turn)), axis=2) * np.any(course.since)
    return course.by_mover(terms, periods)


def _settles(course: Course) -> Made:
    """From each set-up on, to rest."""
    constants = course.longest * np.geomspace(*SETTLING, FINE if course.fine else COARSE)
    fallen = np.exp(-course.since[:, None] / constants)
    return course.by_mover(np.any(course.since) * fallen, constants)


def _steps(course: Course) -> Made:
    """At one moment."""
    hours = course.plan.hours
    moments = np.unique(hours)[1:]
    moments = moments[:: -(-len(moments) // MOMENTS) or 1]
    return course.by_mover((hours[:, None] >= moments).astype(np.float64), moments)


def _hysteresis(course: Course) -> Made:
    """By the direction in which the plunger moved last: half of it behind."""
    return course.by_mover(-0.5 * course.turned * ~course.plan.touches)


def _temperature(course: Course) -> Made:
    """As the recorded temperature."""
    span = float(np.ptp(course.kelvin))
    return course.by_mover(course.kelvin / (span or 1.0), np.array([span]))


HOWS: Mapping[str, Callable[[Course], Made]] = MappingProxyType(
    {
        "repeats": _repeats,
        "drifts": _drifts,
        "settles": _settles,
        "steps": _steps,
        "hysteresis": _hysteresis,
        "temperature": _temperature,
    }
)
UNORDERED = ("repeats",)  # needs no order in time
MEASURED = ("hysteresis", "temperature")  # follow what was measured, not the plan alone
# What does not return with its posture, whenever that is read again.
PASSING = frozenset(("drifts", "settles", "steps", "scatters", "temperature"))


@dataclass(frozen=True, eq=False)
class Tried:
    """A how at some wheres, as far as it shows there, and shows nothing else."""

    at: Linearised
    how: str
    made: Made
    wheres: Sequence[Where]
    chosen: Bools  # which columns of which shape belong to each where, shape (w, v, q)
    sizes: Floats  # at which it is tried, in standard deviations of a reading, (s,)
    log_prior: float  # ln prior weight at each where
    # Numbers of wheres → `log_share`, worked out when first asked for.
    _log_share: dict[int, Floats] = field(default_factory=dict)

    @cached_property
    def by_width(self) -> list[tuple[Ints, Ints, Bools]]:
        """Wheres of as many columns together, since most have few.

        Their numbers, (m,), their columns, (m, c), and which of them each shape has, (m, v, c).
        """
        columns = np.asarray(self.chosen.any(axis=1))
        width, groups = columns.sum(axis=1), []
        for count in np.unique(width).tolist():
            where = np.flatnonzero(width == count)
            number = np.nonzero(columns[where])[1].reshape(-1, count)
            shown = np.take_along_axis(self.chosen[where], number[:, None], 2)
            groups.append((where, number, shown))
        return groups

    def log_share(self, number: int) -> Floats:
        """ln weight of each shape at a where, (v,): less if a listed cause makes it at a gauge."""
        if number not in self._log_share:
            chosen, log = self.chosen[number], np.zeros(self.chosen.shape[1])
            columns, shapes = chosen.any(axis=0), np.flatnonzero(chosen.any(axis=1))
            if self.how in HOWS and len(np.unique(self.made.mover[columns])) == 1:
                some = self.made.columns[:, shapes][:, :, columns]
                shown = self.at.white.matrix @ some.reshape(len(some), -1)
                log[shapes] = LISTED * _is_listed(self.at, shown.reshape(-1, *some.shape[1:]))
            self._log_share[number] = log
        return self._log_share[number]


def tried(at: Linearised, course: Course) -> list[Tried]:
    """Every how at every where."""
    wheres, selected, _ = _wheres(course.plan.steps, course.ordered)
    hows = [how for how in HOWS if course.ordered or how in UNORDERED]
    share = math.log(UNLISTED / (len(hows) + 1) / len(wheres))
    every = []
    for how in hows:
        if how in MEASURED or not course.ordered:
            made, chosen = _made(at.white.matrix, course, how)
        else:
            plan = course.plan if how in PASSING else course.plan.steps
            made, chosen = _made_of_plan(plan, course.fine, how)
        every.append((how, made, chosen, SIZES))
    # More noise is no column: the readings that have it.
    several, columns = selected.sum(axis=1) > 2, selected.T[:, None].astype(np.float64)
    noisier = NOISIER[:: 1 if course.fine else 2]
    made = Made(columns, np.zeros(len(wheres), np.intp))
    every.append(("scatters", made, np.diag(several)[:, None], noisier))
    return [
        Tried(at, how, made, [wheres[k] for k in shown], chosen[shown], sizes, share)
        for how, made, chosen, sizes in every
        for shown in [np.flatnonzero(chosen.any(axis=(1, 2)))]
        if len(shown)
    ]


@functools.lru_cache(maxsize=8)
def _wheres(plan: Plan, ordered: bool) -> tuple[list[Where], Bools, Bools]:
    """Wheres of a plan, the readings of each, (w, n), and movers in larger ones that it holds."""
    wheres, rows = zip(*plan.wheres(ordered), strict=True)
    selected = np.stack(rows)
    held = (~selected).astype(np.float64) @ plan.movers.T == 0.0
    outside = plan.movers.astype(np.float64) @ ~plan.movers.T
    inside = (outside == 0.0) & (outside.T > 0.0)  # which movers are part of which others
    return list(wheres), selected, held @ inside.T


@functools.lru_cache(maxsize=32)
def _made_of_plan(plan: Plan, fine: bool, how: str) -> tuple[Made, Bools]:
    """`_made` of readings in time, of what follows their plan alone."""
    nothing = np.zeros(len(plan))
    return _made(zero_free(plan), Course(plan, True, nothing, nothing, fine), how)


def _made(matrix: Reduction, course: Course, how: str) -> tuple[Made, Bools]:
    """Columns of a how, and which of them show at each where and at no narrower, (w, v, q)."""
    made = HOWS[how](course)
    wheres, selected, covered = _wheres(course.plan.steps, course.ordered)
    n, v, q = made.columns.shape
    if not 0 < q <= MOST_COLUMNS:
        return made, np.zeros((len(wheres), v, q), np.bool_)
    flat, some = made.columns.reshape(n, -1), max(AT_ONCE // n, 1)
    parts = (flat[:, start : start + some] for start in range(0, v * q, some))
    square = [((matrix @ part) ** 2).sum(axis=0) for part in parts]
    shows = np.concatenate(square) * SIZES[-1] ** 2 > 1.0
    # Of each where those columns of which it holds all readings, of the largest movers.
    outside = (~selected).astype(np.float64) @ (flat != 0.0)
    chosen = (shows & (outside == 0.0)).reshape(-1, v, q)
    chosen = chosen & ~covered[:, None, made.mover]
    # What shows the same as a narrower where is no other pattern.
    code = chosen @ (1 << np.arange(q))
    narrower = np.tri(len(code), k=-1, dtype=np.bool_)[..., None]
    repeated = np.any(narrower & (code[:, None] == code), axis=1)
    return made, chosen & ~repeated[..., None]


def _is_listed(at: Linearised, shown: Floats) -> Bools:
    """Which columns (k, v, q) can follow what a listed cause does at one of its places, (v,)."""
    axes, size, _ = np.linalg.svd(shown.swapaxes(0, 1), full_matrices=False)
    axes = axes * (size > ROUNDING * size[:, :1])[:, None]
    flat, made = axes.swapaxes(0, 1).reshape(len(shown), -1), np.zeros(len(axes), np.bool_)
    for places in (placed.patterns for placed in at.extras.values() if placed.patterns is not None):
        match = (places.products(flat) ** 2).reshape(len(axes), -1, len(places)).sum(axis=1)
        made |= np.any(match > ALIKE**2 * places.power, axis=1)
    broad = np.hstack([shown[:, 0, :0], *at.jacobians.values()])
    match = ((axes.swapaxes(-1, -2) @ broad) ** 2).sum(axis=1)
    return np.asarray(made | np.any(match > ALIKE**2 * (broad**2).sum(axis=0), axis=1))


def at_usual_size(fit: Fit) -> Fit:
    """The fit with causes of usual size: fitted alone, one may follow what a pattern does."""
    at, sizes, centre = fit.at, fit.sizes.copy(), fit.centre.copy()
    for effect, slot in zip(fit.effects, fit.slots, strict=True):
        if effect.cause in at.candidates.broad:
            # Of what is positive the first numbers are narrower, and not about zero.
            ratio = at.sizes((effect.cause,))[-1] / sizes[slot][-1]
            sizes[slot] *= ratio
            centre[slot] *= ratio
    if np.array_equal(sizes, fit.sizes):
        return fit
    anew = replace(fit, sizes=sizes, centre=centre)
    log = float(log_sum(anew.by_noise)) + math.log(at.scales[min(at.scales)])
    offsets = fit.offsets + (anew.moved - fit.moved)[: fit.offsets.size]
    return replace(anew, log_evidence=log, offsets=offsets)


def _least_by_noise(fit: Fit) -> Floats:
    """ln p at each σ as `_gains` has it, with S by σ², where that is less, shape (g,).

    Below the stated σ a bad fit is far less likely with it: what a pattern gains there is real.
    """
    ratio2 = (fit.noise.sigma / fit.noise.stated) ** 2
    left, stated = fit.whitened(fit.unexpected), int(np.argmax(fit.noise.log_weight))
    log = fit.noise.log_weight - 0.5 * (left @ left / ratio2 + left.size * np.log(ratio2))
    return np.asarray(np.minimum(fit.by_noise, log - log[stated] + fit.by_noise[stated]))


def _gains(fit: Fit, one: Tried) -> Floats:
    """Gain of ln p at each where by each shape at each size and σ, (w, v, s, g)."""
    (n, v, q), sizes = one.made.columns.shape, one.sizes
    power, match, left = np.empty((v, q, q)), np.empty((v, q)), fit.whitened(fit.unexpected)
    together = max(AT_ONCE // (n * q), 1)
    for some in (slice(start, start + together) for start in range(0, v, together)):
        columns = fit.white.matrix @ one.made.columns[:, some].reshape(n, -1)
        own = fit.whitened(columns).reshape(len(left), -1, q).swapaxes(0, 1)
        turned = own.swapaxes(-1, -2)
        power[some], match[some] = turned @ own, turned @ left
    noise2 = ((fit.noise.sigma / fit.noise.stated) ** 2)[:, None]
    variance = ((sizes * fit.noise.stated) ** 2)[:, None, None]
    gains = np.full((*one.chosen.shape[:2], len(sizes), len(noise2)), ABSENT)
    for where, number, shown in one.by_width:
        inner = power[:, number[:, :, None], number[:, None]].swapaxes(0, 1)
        inner, axes = np.linalg.eigh(inner * (shown[..., None] & shown[..., None, :]))
        along = axes.swapaxes(-1, -2) @ (match[:, number].swapaxes(0, 1) * shown)[..., None]
        weights, matches = np.maximum(inner, 0.0)[:, :, None, None], along[:, :, None, None, :, 0]
        log = of_any_size(weights / noise2, matches / noise2, variance).sum(axis=-1)
        shows = np.asarray(shown.any(axis=2))
        gains[where] = np.where(shows[..., None, None], log, ABSENT)
    return gains


def _gains_of_noise(fit: Fit, one: Tried) -> Floats:
    """The same of readings with more noise, (w, 1, s, g)."""
    factors = one.sizes
    rows = one.made.columns[:, 0] @ one.chosen[:, 0].T > 0.0
    everywhere = rows.all(axis=0)
    gains = np.full((rows.shape[1], len(factors), len(fit.noise.sigma)), ABSENT)
    wider = fit.noise.wider(np.sqrt(1.0 + factors**2))
    gains[everywhere] = fit.log_density(wider).reshape(len(factors), -1) - fit.by_noise
    contrasts, some = fit.white.matrix, rows[:, ~everywhere].astype(np.float64)
    if not isinstance(contrasts, Contrasts):
        return gains[:, None]
    texture = fit.white.texture
    shape = () if texture is None else (texture.columns,)
    # What of a local shape is too fine to be described is noise, too, but of the bed.
    unit = _general(fit.white, fit.noise) / fit.noise.stated
    more2 = (unit * fit.noise.stated * factors) ** 2
    values = contrasts.T @ np.column_stack((*shape, fit.scaled, fit.unexpected))
    values = np.hstack((contrasts.zeros, unit * values))
    zeros, end = contrasts.zeros.shape[1], values.shape[1] - 1
    whole = values.T @ values
    whole[np.arange(zeros, end), np.arange(zeros, end)] += 1.0
    own = values.T @ (some.T[:, :, None] * values)
    share = (more2 / (1.0 + more2))[:, None, None]
    square = np.concatenate((whole[None], (whole - share * own[:, None]).reshape(-1, *whole.shape)))
    inner, cross = square[:, :end, :end], square[:, :end, end:]
    root = np.linalg.cholesky(inner)
    log_det = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    left = square[:, end, end] - (np.linalg.solve(root, cross) ** 2).sum(axis=(1, 2))
    log_det[1:] += np.outer(some.sum(axis=0), np.log1p(more2)).reshape(-1)
    noise2 = (fit.noise.sigma / fit.noise.stated) ** 2
    gain = (left[0] - left[1:])[:, None] / noise2 + (log_det[0] - log_det[1:])[:, None]
    gains[~everywhere] = 0.5 * gain.reshape(-1, len(factors), len(noise2))
    return gains[:, None]


def _general(white: Whitened, noise: NoiseGrid) -> float:
    """The stated noise over that of any combination, which a local shape's finest part adds to."""
    return 1.0 if white.texture is None else white.texture.whitened(noise.stated)[0]


def extended(fit: Fit, pattern: Pattern, number: int = 0) -> tuple[Fit, slice]:
    """The fit with one of a pattern's likeliest shapes; and which unknowns are that pattern's."""
    white, noise, uncertain = fit.white, fit.noise, fit.uncertain
    shape, start = pattern.shapes[number], fit.first_uncertain
    columns, unexpected, sizes, centre = fit.columns, fit.unexpected, fit.sizes, fit.centre
    end = start
    if pattern.how == "scatters":
        more = shape.size / noise.stated * shape.columns[:, 0]
        if np.ptp(more):
            weight = 1.0 / np.hypot(1.0, _general(white, noise) * more)
            contrasts = white.matrix
            assert isinstance(contrasts, Contrasts)
            zeros, _ = np.linalg.qr(weight[:, None] * contrasts.zeros)
            after = Contrasts(zeros, contrasts.precision * weight)

            def weighed(values: Floats) -> Floats:
                return np.asarray(after @ (contrasts.T @ values))

            columns, unexpected = weighed(columns), weighed(unexpected)
            uncertain = tuple(replace(one, columns=weighed(one.columns)) for one in uncertain)
            plan, texture = replace(white.plan, precision=after.precision), white.texture
            problem = replace(white.problem, plan=plan, matrix=after)
            if texture is not None:
                texture = Texture.of(weighed(texture.columns), texture.rest, texture.assumed)
                noise = replace(noise, texture=texture)
            white = replace(white, problem=problem, data=weighed(white.data), texture=texture)
        else:
            noise = replace(noise, sigma=noise.sigma * math.hypot(1.0, more[0]))
    else:
        more = white.matrix @ shape.columns
        end = start + more.shape[1]
        columns = np.insert(columns, [start], more, axis=1)
        sizes = np.insert(sizes, start, np.full(end - start, shape.size))
        centre = np.insert(centre, start, np.zeros(end - start))
    draft = replace(
        fit, white=white, noise=noise, uncertain=uncertain, columns=columns,
        linear=unexpected + columns @ centre, sizes=sizes, centre=centre,
    )  # fmt: skip
    width, local = fit.offsets.size, draft.is_local
    if np.count_nonzero(local) >= ENOUGH * width:
        # What the pattern makes is no local shape.
        stated = math.hypot(noise.stated, math.sqrt(sum(one.rest for one in uncertain)))
        sizes = np.where(local, 1.0, sizes)
        size = fit_size(columns, unexpected, sizes, stated, np.flatnonzero(local))
        sizes = np.where(local, size, sizes)
        draft = replace(draft, sizes=sizes, scale_factor=size)
    log = draft.by_noise - log_sum(draft.by_noise)
    sigma = float(np.sqrt(np.exp(log) @ noise.sigma**2 + draft.rest))
    offsets = fit.offsets + draft.moved[:width] - fit.moved[:width]
    covariance = condition(columns, unexpected, sizes, sigma)[1]
    return replace(draft, offsets=offsets, covariance=covariance, sigma=sigma), slice(start, end)


def scores_of(fit: Fit, every: Sequence[Tried]) -> list[Hypothesis]:
    """Every pattern in addition to a fit; log evidence and prior without those of its causes."""
    scored = []
    noise = _least_by_noise(fit) - log_sum(fit.by_noise)
    for one in every:
        sizes = one.sizes
        gains = _gains_of_noise(fit, one) if one.how == "scatters" else _gains(fit, one)
        by_shape = log_sum(gains + noise, 3)
        # Shapes that do not show at a where are none.
        number = np.log(len(sizes) * np.count_nonzero(one.chosen.any(axis=2), axis=1))
        gained = log_sum(by_shape, (1, 2)) - number
        for k, where in enumerate(one.wheres):
            gain, log_shape = gained[k], by_shape[k]
            if gain > 0.0:  # else whatever makes it is not there
                log_shape = log_shape + one.log_share(k)[:, None]
                gain = log_sum(log_shape) - number[k]
            pattern = Pattern(
                one.how, where, one.log_prior, one.made.columns, one.chosen[k],
                one.made.parameters, sizes * fit.noise.stated, log_shape,
                float(by_shape[k].flat[log_shape.argmax()]),
            )  # fmt: skip
            log = fit.log_evidence + float(gain)
            scored.append(Hypothesis(fit.at, log, patterns=(pattern,)))
    return scored


def placed_causes(at: Linearised) -> list[Tried]:
    """Listed causes with a place, as patterns whose shapes are the places, at usual sizes and more.

    Fitted alone such a cause would stand where a pattern acts.
    """
    every = []
    for id, placed in at.extras.items():
        cause, places = placed.cause, placed.patterns
        if places is None or not isinstance(cause, PatternCause) or cause.counts:
            continue
        if len(places) > MOST_PLACES:
            continue
        unit = cause.prior_std(at.white.machine)[0] / at.noise.stated
        columns = unit * places.patterns.columns(slice(None))[:, :, None]
        shown, sizes = np.full((1, *columns.shape[1:]), True), np.array(BLUNDER_SCALES)
        log_prior = at.candidates.log_prior[(id,)]
        made = Made(columns, np.zeros(columns.shape[2], np.intp))
        every.append(Tried(at, id, made, [{}], shown, sizes, log_prior))
    return every


def course_of(fit: Fit, *, fine: bool) -> Course:
    """What readings may follow; plungers that lag are followed in rounds if looked at closely.

    `fit` is of the offsets alone.
    """
    at = fit.at
    predicted = at.versions[0] - at.residuals[0]
    course = Course.of(at.white, predicted, fine)
    for _ in range(ROUNDS * (fine and bool(course.turned.any()))):
        lagging = [one for one in tried(at, course) if one.how == "hysteresis"]
        scores = scores_of(fit, lagging)
        if not scores:
            break
        after, _ = extended(fit, scores[-1].patterns[0])
        moved = at.jacobian @ (after.offsets - at.offsets[0])
        course = Course.of(at.white, predicted + moved, fine)
    return course


def fits_of(hypothesis: Hypothesis, fit: Fit) -> list[tuple[float, Fit, slice]]:
    """Fits with a hypothesis' patterns, at each likely shape of the last of them.

    Of each its share, and which unknowns are that pattern's.
    """
    fit = at_usual_size(fit)
    *before, last = hypothesis.patterns
    for pattern in before:
        fit, _ = extended(fit, pattern)
    total = sum(shape.share for shape in last.shapes)
    return [
        (shape.share / total, *extended(fit, last, number))
        for number, shape in enumerate(last.shapes)
    ]


def weight_of(hypothesis: Hypothesis) -> float:
    """ln of prior times evidence."""
    return hypothesis.log_evidence + hypothesis.log_prior


def combined(hypothesis: Hypothesis, fit: Fit, every: Sequence[Tried]) -> list[Hypothesis]:
    """A hypothesis, of whose listed causes `fit` is, with every pattern in addition."""
    if math.isinf(fit.log_evidence):  # no explanation, whatever acts besides
        return []
    before, patterns = at_usual_size(fit), hypothesis.patterns
    if not hypothesis.label:
        return scores_of(before, every)
    gained = (hypothesis.log_evidence if patterns else fit.log_evidence) - fit.log_evidence
    for pattern in patterns:
        after, _ = extended(before, pattern)
        if pattern.how != "scatters":
            # Scored alone where it leaves far more than noise, it may gain far less than it seems.
            exact = float(log_sum(after.by_noise) - log_sum(before.by_noise))
            gained += exact - pattern.gain
        before = after
    known = {pattern.label for pattern in patterns}
    return [
        replace(
            hypothesis,
            log_evidence=scored.log_evidence + gained,
            patterns=(*patterns, *scored.patterns),
        )
        for scored in scores_of(before, every)
        if known.isdisjoint(one.label for one in scored.patterns)
    ]
