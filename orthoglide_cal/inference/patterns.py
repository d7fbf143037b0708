"""Patterns of the readings that no listed cause makes, each a *how* at a *where*.

A how is one function of the course of a session and of the rows that the where selects; it gives
columns of unit size [mm] in one or several shapes (a moment, a time constant), which are averaged
over. Pattern and causes are weighed by one evidence: with C the columns, of size s, and S what
acts without them,

    ln p = ln p0 − ½ ln det(1 + s² G) + ½ mᵀ (1/s² + G)⁻¹ m,   G = Cᵀ S⁻¹ C,  m = Cᵀ S⁻¹ r

S is taken as large as the noise: for each σ of the grid the S of the stated one, times its square.
The likeliest patterns are described in numbers.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.special import erf

from orthoglide_cal.causes import UNLISTED
from orthoglide_cal.estimation.gaussian import log_sum, shrink
from orthoglide_cal.estimation.solution import Contrasts, Reduction, rms, without_zeros, zero_free
from orthoglide_cal.inference.data import Linearised, Whitened
from orthoglide_cal.inference.evidence import NoiseGrid, Texture
from orthoglide_cal.inference.fit import Fit, leave_out, left_out
from orthoglide_cal.inference.hypothesis import (
    BLUNDER_SCALES,
    LOST,
    Columns,
    Hypothesis,
    Pattern,
    Shape,
    of_any_size,
)
from orthoglide_cal.inference.result import FoundPattern
from orthoglide_cal.model.measured import Measured, Readings
from orthoglide_cal.model.model import NORMAL_K, Estimate
from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, Where, altered

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
ABSENT = -1e9  # ln of the share of a shape that does not show
MINUTES = 60.0  # in an hour
# Pattern → name of the parameter of its shapes.
_SHAPE_NAMES = {"drifts": "period", "settles": "time_constant", "steps": "moment"}

_Fits = Sequence[tuple[float, Fit]]


def _by_mover(plan: Plan, values: Floats, parameters: Floats | None = None) -> Columns:
    """Values (n,), or (n, v, b), in columns of their own for each of what moves as one."""
    movers, shapes = plan.steps.movers, 1 if parameters is None else len(parameters)
    wide = values.reshape(len(plan), shapes, -1)
    number = np.repeat(np.arange(len(movers)), wide.shape[-1])
    return Columns(movers, [wide[mover] for mover in movers], number, parameters)


def _everywhere(columns: Floats, movers: Sequence[int] | Ints = ()) -> Columns:
    """Columns (n, v, q) that may act on all readings."""
    return Columns(np.full((1, len(columns)), True), [columns], np.array(movers, np.intp))


def _clock(plan: Plan) -> tuple[Floats, float]:
    """Time since each reading's set-up began, (n,), and how long the longest takes, or 1 [h]."""
    began = np.full(int(plan.shared.max(initial=0)) + 1, np.inf)
    np.minimum.at(began, plan.shared, plan.hours)
    since = np.asarray(plan.hours - began[plan.shared])
    return since, float(since.max(initial=0.0)) or 1.0


def _repeats(plan: Plan, fine: bool, _: Floats | None = None) -> Columns:
    """The same in each cycle."""
    columns = plan.returning
    # The first mover is part of nothing larger.
    movers = plan.movers[:, np.abs(columns).argmax(axis=0)].argmax(axis=0)
    return _everywhere(columns[:, None], movers)


def _drifts(plan: Plan, fine: bool, periods: Floats | None = None) -> Columns:
    """Smooth in time: a sine of each gauge, of a period that they share."""
    since, longest = _clock(plan)
    if periods is None:
        least = SMOOTH / np.bincount(plan.shared, minlength=1).max()
        least = float(np.clip(least, *SHORTEST))
        # Neighbours differ by the same part of a turn over the longest set-up.
        count = (FINE if fine else COARSE) * SHORTEST[1] / least
        periods = longest / np.linspace(1.0 / LONGEST, 1.0 / least, round(count))
    values = np.zeros((len(plan), len(periods), 2))
    if np.any(since):
        turn = 2.0 * np.pi * since[:, None] / periods
        np.sin(turn, out=values[..., 0])
        np.cos(turn, out=values[..., 1])
    return _by_mover(plan, values, periods)


def _settles(plan: Plan, fine: bool, constants: Floats | None = None) -> Columns:
    """Shapes that begin with each set-up and come to rest."""
    since, longest = _clock(plan)
    if constants is None:
        constants = longest * np.geomspace(*SETTLING, FINE if fine else COARSE)
    return _by_mover(plan, np.any(since) * np.exp(-since[:, None] / constants), constants)


def _steps(plan: Plan, fine: bool, moments: Floats | None = None) -> Columns:
    """At one moment."""
    if moments is None:
        moments = np.unique(plan.hours)[1:]
        moments = moments[:: -(-len(moments) // MOMENTS) or 1]
    return _by_mover(plan, (plan.hours[:, None] >= moments).astype(np.float64), moments)


# Those that follow the plan alone, in shapes of these parameters, or in those that are tried; of
# data without an order in time the first is tried only.
PLANNED: Mapping[str, Callable[[Plan, bool, Floats | None], Columns]] = MappingProxyType(
    {"repeats": _repeats, "drifts": _drifts, "settles": _settles, "steps": _steps}
)
# What does not return with its posture, whenever that is read again.
PASSING = frozenset(("drifts", "settles", "steps", "scatters", "temperature"))


def pattern_candidates(fit: Fit, *, fine: bool) -> list[list[Pattern]]:
    """Every how at every where, those of one how together; `fit` is of the offsets alone.

    Plungers that lag are followed in rounds if looked at closely.
    """
    at, white, moved = fit.hypothesis.at, fit.hypothesis.at.white, np.zeros(1)
    predicted, noise = at.versions[0] - at.residuals[0], white.machine.instrument.noise_mm
    for rounds in range(ROUNDS if fine else 0, -1, -1):
        expected = white.plain(predicted + moved)
        every = _candidates(at, _lags(white.plan, expected, noise) if white.raw else None, fine)
        lagging = [patterns for patterns in every if patterns[0].how == "hysteresis"]
        if not (rounds and lagging):
            break
        lag = scores_of(fit, lagging)[-1].patterns[0]
        moved = at.jacobian @ (extended(fit, lag).offsets - at.offsets[0])
    return every


def _lags(plan: Plan, readings: Floats, noise_mm: float) -> Columns:
    """Shapes by the direction in which the plunger moved last: half of it behind.

    `readings` are expected, (n,) [mm]; of small movements the sign is uncertain.
    """
    rows, first = plan.sequence
    moved, turned = np.diff(readings[rows], prepend=0.0), np.empty(len(plan))
    turned[rows] = np.where(first, 0.0, erf(0.5 * moved / noise_mm))
    return _by_mover(plan, -0.5 * turned * ~plan.touches)


def _candidates(at: Linearised, lags: Columns | None, fine: bool) -> list[list[Pattern]]:
    """Every how at the wheres where it shows; `lags` are of plungers, None without an order."""
    white, plan = at.white, at.white.plan
    wheres, selected, _ = _wheres(plan.steps, white.raw)
    more, hows = {"repeats": _repeats(plan, fine)}, 2
    every = dict[str, tuple[Columns, Bools]]()
    if lags is not None:
        more, hows = {"hysteresis": lags}, len(PLANNED) + 3
        for how in PLANNED:
            every[how] = _shown_of_plan(plan if how in PASSING else plan.steps, fine, how)
    if white.kelvin is not None and (span := float(np.ptp(white.kelvin))):
        more["temperature"] = _by_mover(plan, white.kelvin / span, np.array([span]))
    for how, columns in more.items():
        every[how] = columns, _shown(white.matrix, plan, white.raw, columns)
    # More noise is no column: the readings that have it.
    noise, several = selected.T[:, None].astype(np.float64), np.diag(selected.sum(axis=1) > 2)
    every["scatters"] = _everywhere(noise), several[:, None]
    share, sizes = math.log(UNLISTED / hows / len(wheres)), {"scatters": NOISIER[:: 2 - fine]}
    candidates = (
        [
            Pattern(at, how, wheres[k], share, columns, chosen[k], sizes.get(how, SIZES))
            for k in np.flatnonzero(chosen.any(axis=(1, 2)))
        ]
        for how, (columns, chosen) in every.items()
    )
    return [*filter(None, candidates)]


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
def _shown_of_plan(plan: Plan, fine: bool, how: str) -> tuple[Columns, Bools]:
    """Columns of what follows the plan of readings in time alone, and `_shown` of them."""
    columns = PLANNED[how](plan, fine, None)
    return columns, _shown(zero_free(plan), plan, True, columns)


def _shown(matrix: Reduction, plan: Plan, ordered: bool, columns: Columns) -> Bools:
    """Return which columns of a how show at each where and at no narrower, (w, v, q)."""
    _, selected, covered = _wheres(plan.steps, ordered)
    if len(columns.number) > MOST_COLUMNS or not any(part.any() for part in columns.parts):
        return np.zeros((len(selected), 1, 1), np.bool_)
    square = np.diagonal(_power(columns, matrix), axis1=1, axis2=2)
    # Of each where those columns of which it holds all readings, of the largest movers.
    acting = replace(columns, parts=[part != 0.0 for part in columns.parts])
    outside = acting.products((~selected.T).astype(np.float64)).transpose(2, 0, 1)
    chosen = (square * SIZES[-1] ** 2 > 1.0) & (outside == 0.0)
    chosen = chosen & ~covered[:, None, columns.number]
    # What shows the same as a narrower where is no other pattern.
    code = chosen @ (1 << np.arange(chosen.shape[-1]))
    narrower = np.tri(len(code), k=-1, dtype=np.bool_)[..., None]
    repeated = np.any(narrower & (code[:, None] == code), axis=1)
    return np.asarray(chosen & ~repeated[..., None])


def _power(
    columns: Columns, matrix: Reduction, texture: Texture | None = None, noise_mm: float = 1.0
) -> Floats:
    """Cᵀ Wᵀ S⁻¹ W C of each shape C, (v, q, q); S of noise and of a local shape."""
    if isinstance(matrix, Contrasts):
        return (
            _power_of_readings(columns, matrix, texture, noise_mm if texture else 1.0) / noise_mm**2
        )
    data = columns.products(matrix.T)
    return np.asarray(data @ data.swapaxes(-1, -2) / noise_mm**2)


@functools.lru_cache(maxsize=32)
def _power_of_readings(
    columns: Columns, matrix: Contrasts, texture: Texture | None, noise_mm: float
) -> Floats:
    """The same, times the variance of the noise."""
    weight = matrix.precision
    taken = columns.products(weight[:, None] * matrix.zeros)
    power = columns.squares(weight) - taken @ taken.swapaxes(-1, -2)
    if texture is None:
        return power
    general, factors = texture.whitened(noise_mm)
    taken = columns.products(matrix.T @ (texture.axes * np.sqrt(1.0 - factors**2)))
    return np.asarray(general**2 * (power - taken @ taken.swapaxes(-1, -2)))


def at_usual_size(fit: Fit) -> Fit:
    """The fit with causes of usual size: fitted alone, one may follow what a pattern does."""
    at, sizes, centre = fit.hypothesis.at, fit.sizes.copy(), fit.centre.copy()
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
    return replace(anew, log_evidence=log)


def _gains(fit: Fit, one: Pattern, chosen: Bools, noise: Floats) -> Floats:
    """Gain of ln p at each where by each shape at each size, (w, v, s).

    `one` is the how at any where, `chosen` its columns at each, (w, v, q); ln p at each σ without
    it is `noise`, (g,).
    """
    sizes, white, (axes, factors) = one.sizes, fit.white, fit.axes
    lost = fit.textured(axes * np.sqrt(1.0 - factors**2))
    left = fit.textured(shrink(fit.whitened(fit.unexpected), axes, factors))
    along = one.columns.products(white.matrix.T @ np.column_stack((lost, left)))
    match, taken = along[..., -1], along[..., :-1]
    power = _power(one.columns, white.matrix, white.texture, fit.noise.stated)
    power = power - taken @ taken.swapaxes(-1, -2)
    noise2 = ((fit.noise.sigma / fit.noise.stated) ** 2)[:, None]
    variance = ((sizes * fit.noise.stated) ** 2)[:, None, None]
    shown, shapes = chosen.reshape(-1, chosen.shape[2]), chosen.shape[1]
    gains, width = np.full((len(shown), len(sizes)), ABSENT), shown.sum(axis=1)
    # Those of as many columns together, since most have few.
    for count in {*width.tolist()} - {0}:
        rows = np.flatnonzero(width == count)
        number, shape = np.nonzero(shown[rows])[1].reshape(-1, count), rows[:, None] % shapes
        inner = power[shape[..., None], number[:, :, None], number[:, None]]
        size2, along = inner[..., 0], match[shape, number]
        if count > 1:
            size2, axes = np.linalg.eigh(inner)
            along = (axes.swapaxes(-1, -2) @ along[..., None])[..., 0]
        weights, matches = np.maximum(size2, 0.0)[:, None, None], along[:, None, None]
        log = of_any_size(weights / noise2, matches / noise2, variance).sum(axis=-1)
        gains[rows] = log_sum(log + noise, 2)
    return gains.reshape(*chosen.shape[:2], -1)


def _gains_of_noise(fit: Fit, one: Pattern, chosen: Bools, noise: Floats) -> Floats:
    """The same of readings with more noise, (w, 1, s)."""
    factors = one.sizes
    rows = one.columns.parts[0][:, 0] @ chosen[:, 0].T > 0.0
    everywhere = rows.all(axis=0)
    gains = np.full((rows.shape[1], len(factors), len(fit.noise.sigma)), ABSENT)
    wider = fit.noise.wider(np.sqrt(1.0 + factors**2))
    gains[everywhere] = fit.log_density(wider).reshape(len(factors), -1) - fit.by_noise
    contrasts, texture = fit.white.matrix, fit.white.texture
    if not isinstance(contrasts, Contrasts):
        return log_sum(gains + noise, 2)[:, None]
    shape = () if texture is None else (texture.columns,)
    # What of a local shape is too fine to be described is noise, too, but of the bed.
    unit = _general(fit.white, fit.noise) / fit.noise.stated
    known = unit * (contrasts.T @ np.column_stack((*shape, fit.scaled, fit.unexpected)))
    columns = np.hstack((contrasts.zeros, known[:, :-1]))
    # Of unit size but for zeros of gauges, which may be any.
    prior = np.repeat((0.0, 1.0), (contrasts.zeros.shape[1], known.shape[1] - 1))
    columns = np.linalg.solve(np.linalg.cholesky(columns.T @ columns + np.diag(prior)), columns.T).T
    left = known[:, -1] - columns @ (columns.T @ known[:, -1])
    more2 = (unit * fit.noise.stated * factors) ** 2
    share, noise2 = more2 / (1.0 + more2), (fit.noise.sigma / fit.noise.stated) ** 2
    some = rows[:, ~everywhere].T
    by_where = []
    # A bed has more unknowns than a where of it readings; of gauges all wheres at once.
    for part in [some] if texture is None and len(some) else some[:, None]:
        # With less weight of some readings, by the eigenvalues of their part of the hat matrix.
        here = columns[part[0]]
        if len(part) == 1 and len(here) < here.shape[1]:
            size2, axes = np.linalg.eigh((here @ here.T)[None])
            match2 = size2 * (left[part[0]] @ axes) ** 2
        else:
            size2, axes = np.linalg.eigh([columns[rows].T @ columns[rows] for rows in part])
            match2 = (((part * left) @ columns)[:, None] @ axes)[:, 0] ** 2
        kept = 1.0 - share[:, None] * size2[:, None]
        square = share * (part @ left**2)[:, None] + share**2 * (match2[:, None] / kept).sum(-1)
        log_det = np.log(kept).sum(axis=-1) + part.sum(axis=1)[:, None] * np.log1p(more2)
        by_where.append(0.5 * (square[..., None] / noise2 - log_det[..., None]))
    gains[~everywhere] = np.concatenate((gains[:0], *by_where))
    return log_sum(gains + noise, 2)[:, None]


def _general(white: Whitened, noise: NoiseGrid) -> float:
    """The stated noise over that of any combination, which a local shape's finest part adds to."""
    return 1.0 if white.texture is None else white.texture.whitened(noise.stated)[0]


def extended(fit: Fit, pattern: Pattern, number: int = 0) -> Fit:
    """The fit with one of a pattern's likeliest shapes; its unknowns are the last but uncertain."""
    white, noise, shape = fit.white, fit.noise, pattern.shapes[number]
    if pattern.how != "scatters":
        more, start = white.matrix @ shape.columns, fit.first_uncertain
        unknowns = np.array([[shape.size], [0.0]]) * np.ones(more.shape[1])
        columns = np.insert(fit.columns, [start], more, axis=1)
        sizes, centre = np.insert([fit.sizes, fit.centre], [start], unknowns, axis=1)
        draft = replace(fit, columns=columns, sizes=sizes, centre=centre)
    elif not np.ptp(noisier := shape.size / noise.stated * shape.columns[:, 0]):
        draft = replace(fit, noise=replace(noise, sigma=noise.sigma * math.hypot(1.0, noisier[0])))
    else:
        weight, contrasts = 1.0 / np.hypot(1.0, _general(white, noise) * noisier), white.matrix
        assert isinstance(contrasts, Contrasts)
        zeros, _ = np.linalg.qr(weight[:, None] * contrasts.zeros)
        after = Contrasts(zeros, contrasts.precision * weight)

        def weighed(values: Floats) -> Floats:
            return np.asarray(after @ (contrasts.T @ values))

        plan, texture = replace(white.plan, precision=after.precision), white.texture
        if texture is not None:
            texture = Texture.of(weighed(texture.columns), texture.rest, texture.assumed)
            noise = replace(noise, texture=texture)
        problem = replace(white.problem, plan=plan, matrix=after)
        draft = replace(
            fit,
            white=replace(white, problem=problem, data=weighed(white.data), texture=texture),
            noise=noise,
            uncertain=tuple(replace(o, columns=weighed(o.columns)) for o in fit.uncertain),
            columns=weighed(fit.columns),
            linear=weighed(fit.linear),
        )
    # What the pattern makes is no local shape.
    draft = draft.with_local_shape()
    draft = draft.with_sigma(draft.by_noise)
    return replace(draft, patterns={**fit.patterns, pattern: shape})


def under_plan(pattern: Pattern, shape: Shape, plan: Plan, readings: Floats) -> Floats:
    """Columns of unit size of a shape of a pattern under any plan, (n, q).

    `readings` are expected there, (n,) [mm]. None of more noise, unknown temperature, or one place.
    """
    if pattern.how in PLANNED:
        made = PLANNED[pattern.how](plan, True, np.array([shape.parameter]))
    elif pattern.how == "hysteresis":
        made = _lags(plan, readings, pattern.at.white.machine.instrument.noise_mm)
    else:
        return np.zeros((len(plan), 0))
    columns = made.written([0], np.full(len(made.number), True))[:, 0]
    for where, rows in plan.wheres(True):
        if where == pattern.where:
            return columns[:, columns.any(axis=0) & ~columns[~rows].any(axis=0)]
    return columns[:, :0]


def scores_of(fit: Fit, candidates: Sequence[Sequence[Pattern]]) -> list[Hypothesis]:
    """Every pattern in addition to a fit; log evidence and prior without those of its causes."""
    scored, at = [], fit.hypothesis.at
    # ln p at each σ as `_gains` has it, with S by σ², where that is less: below the stated σ a bad
    # fit is far less likely with it, and what a pattern gains there is real.
    ratio2 = (fit.noise.sigma / fit.noise.stated) ** 2
    left, stated = fit.whitened(fit.unexpected), int(np.argmax(fit.noise.log_weight))
    log = fit.noise.log_weight - 0.5 * (left @ left / ratio2 + left.size * np.log(ratio2))
    least = np.minimum(fit.by_noise, log - log[stated] + fit.by_noise[stated])
    noise = least - log_sum(fit.by_noise)
    for patterns in candidates:
        one, chosen = patterns[0], np.stack([pattern.chosen for pattern in patterns])
        gains_of = _gains_of_noise if one.how == "scatters" else _gains
        by_shape = gains_of(fit, one, chosen, noise)
        log_shape, rows = by_shape.copy(), np.arange(len(patterns))
        # Shapes that do not show at a where are none.
        number = np.log(len(one.sizes) * np.count_nonzero(chosen.any(axis=2), axis=1))
        gained = log_sum(by_shape, (1, 2)) - number
        for k in np.flatnonzero(gained > 0.0).tolist():  # else whatever makes it is not there
            likely = log_shape[k].max(axis=1) > log_shape[k].max() - LOST
            log_shape[k] += patterns[k].log_share(likely)[:, None]
            gained[k] = log_sum(log_shape[k]) - number[k]
        best = log_shape.reshape(len(rows), -1).argmax(axis=1)
        best = by_shape.reshape(len(rows), -1)[rows, best].tolist()
        sizes, logs = one.sizes * fit.noise.stated, (fit.log_evidence + gained).tolist()
        for tried, log, shape, gain in zip(patterns, logs, log_shape, best, strict=True):
            pattern = altered(tried, sizes=sizes, log_shape=shape, gain=gain)
            scored.append(Hypothesis(at, log, patterns=(pattern,)))
    return scored


def placed_causes(at: Linearised) -> list[list[Pattern]]:
    """Listed causes with a place, as patterns whose shapes are the places, at usual sizes and more.

    Fitted alone such a cause would stand where a pattern acts.
    """
    candidates = []
    for id, placed in at.extras.items():
        cause, places = placed.cause, placed.patterns
        if places is None or cause.counts or len(places) > MOST_PLACES:
            continue
        unit = cause.prior_std(at.white.machine)[0] / at.noise.stated
        columns = _everywhere(unit * places.patterns.columns(slice(None))[:, :, None])
        shown, sizes = np.full((len(places), 1), True), np.array(BLUNDER_SCALES)
        log_prior = at.candidates.log_prior[(id,)]
        candidates.append([Pattern(at, id, {}, log_prior, columns, shown, sizes)])
    return candidates


def fits_of(hypothesis: Hypothesis, fit: Fit) -> list[tuple[float, Fit]]:
    """Fits with a hypothesis' patterns, at each likely shape of the last, and their shares."""
    *others, last = hypothesis.patterns
    before = functools.reduce(extended, others, at_usual_size(fit))
    total = sum(shape.share for shape in last.shapes)
    return [
        (shape.share / total, extended(before, last, number).with_effects(fit.effects))
        for number, shape in enumerate(last.shapes)
    ]


def residual_of(hypothesis: Hypothesis, fit: Fit, fits: Sequence[tuple[float, Fit]]) -> Floats:
    """Residuals under `fits_of` both, shape (k,) [mm]; more noise takes nothing away."""
    patterns = tuple(one for one in hypothesis.patterns if one.how != "scatters")
    if len(patterns) < len(hypothesis.patterns):
        fits = fits_of(replace(hypothesis, patterns=patterns), fit) if patterns else [(1.0, fit)]
    return np.asarray(sum(share * after.left for share, after in fits))


def combined(
    hypothesis: Hypothesis, fit: Fit, candidates: Sequence[Sequence[Pattern]]
) -> list[Hypothesis]:
    """A hypothesis, of whose listed causes `fit` is, with every pattern in addition."""
    if math.isinf(fit.log_evidence):  # no explanation, whatever acts besides
        return []
    before, patterns = at_usual_size(fit), hypothesis.patterns
    if not hypothesis.label:
        return scores_of(before, candidates)
    gained = (hypothesis.log_evidence if patterns else fit.log_evidence) - fit.log_evidence
    for pattern in patterns:
        after = extended(before, pattern)
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
        for scored in scores_of(before, candidates)
        if known.isdisjoint(one.label for one in scored.patterns)
    ]


# --- a pattern in numbers -----------------------------------------------------------------------


def describe(
    hypothesis: Hypothesis,
    base: Fit,
    measured: Measured,
    probability: float,
    accepted: bool,
    before_mm: float,
    after_mm: float,
) -> FoundPattern | None:
    """The last pattern of a hypothesis in numbers; None where no readings of one gauge differ.

    `base` is the fit of its listed causes. The offsets alone leave `before_mm`, all that acts
    `after_mm`.
    """
    pattern, white = hypothesis.patterns[-1], hypothesis.at.white
    how, plan = pattern.how, white.plan
    fits, others = fits_of(hypothesis, base), hypothesis.patterns[:-1]
    before, after = functools.reduce(extended, others, at_usual_size(base)), fits[0][1]
    rows = next(rows for where, rows in plan.wheres(white.raw) if where == pattern.where)
    gauges = list(_gauges(pattern, fits, rows))
    if not gauges:
        return None
    _, size, std, _ = max(gauges, key=lambda gauge: abs(gauge[1]))
    unit = "mm/K" if how == "temperature" else "mm"
    parameters = [
        Estimate(name=name, unit=unit, value=value / span, std=spread / abs(span))
        for name, value, spread, span in gauges
    ]
    where, start, between = dict(pattern.where), None, tuple[Where, ...]()
    heldout, late = None, None
    effect: list[tuple[float, ...]] = [(), ()]
    if how in _SHAPE_NAMES:
        moment, u = _mean_and_std(fits, [MINUTES * shape.parameter for shape in pattern.shapes])
        name = _SHAPE_NAMES[how]
        parameters.append(Estimate(name=name, unit="min", value=float(moment), std=float(u)))
        if how == "steps":
            start = float(moment)
        elif how == "settles":
            start = MINUTES * float(plan.hours[rows].min())
        # The last third of each set-up; the other readings stay.
        ordered, first = plan.sequence
        setup = np.cumsum(first) - 1
        rank = np.arange(len(ordered)) - np.flatnonzero(first)[setup]
        thirds = np.empty(len(ordered), np.intp)
        thirds[ordered] = np.where(3 * rank >= 2 * np.bincount(setup)[setup], 0, -1)
        late = _heldout(rows, before, after, thirds)
    if isinstance(measured, Readings):
        if "posture" in where:
            where["posture"] = measured.posture[int(np.argmax(rows))]
        if how == "steps":
            between = tuple(_between(measured, rows, float(moment), float(u)))
        heldout = _heldout(rows, before, after, measured.cycle)
        effect = [tuple(values.tolist()) for values in _effect(pattern, fits, rows)]
    return FoundPattern(
        how=how,
        where=where,
        from_minutes=start,
        between=between,
        size_mm=abs(size),
        expanded_mm=NORMAL_K * std,
        parameters=parameters,
        probability=probability,
        accepted=accepted,
        rms_before_mm=before_mm,
        rms_after_mm=after_mm,
        heldout_before_mm=heldout and heldout[0],
        heldout_after_mm=heldout and heldout[1],
        heldout_ratio=heldout and heldout[1] / heldout[0],
        last_third_before_mm=late and late[0],
        last_third_after_mm=late and late[1],
        effect_mm=effect[0],
        effect_expanded_mm=effect[1],
    )


def _effect(pattern: Pattern, fits: _Fits, rows: Bools) -> tuple[Floats, Floats]:
    """Effect on each reading, and its U, both (n,) [mm]; more noise adds U alone."""
    columns = [shape.columns for shape in pattern.shapes]
    if pattern.how == "scatters":
        variances = np.outer([shape.size**2 for shape in pattern.shapes], rows)
        mean, std = _mean_and_std(fits, np.zeros_like(variances), variances)
    else:
        if pattern.how == "repeats":  # of a gauge the zero hides their mean
            columns = [without_zeros(pattern.at.white.plan, one.T).T for one in columns]
        mean, std = _sizes(fits, columns)
    return mean, NORMAL_K * std


def _sizes(fits: _Fits, columns: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Mean and standard deviation of what the columns (m, q) under each fit add up to, (m,)."""
    values, variances = [], []
    for one, (_, fit) in zip(columns, fits, strict=True):
        slot = slice(fit.first_uncertain - one.shape[1], fit.first_uncertain)
        values.append(one @ fit.moved[slot])
        variances.append(((one @ fit.covariance[slot, slot]) * one).sum(axis=1))
    return _mean_and_std(fits, values, np.array(variances))


def _mean_and_std(
    fits: _Fits, values: Sequence[Floats | float] | Floats, variances: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Mean and standard deviation of values with variances under each fit, (f, ...), by shares."""
    shares, under = np.array([share for share, _ in fits]), np.array(values)
    mean = shares @ under
    return mean, np.sqrt(shares @ ((under - mean) ** 2 + variances))


def _between(measured: Readings, rows: Bools, minutes: float, std: float) -> Iterator[Where]:
    """The last of some readings before a moment, and the first after it, as far as it is known."""
    plan, reach = measured.plan, NORMAL_K * std
    ranks = np.flatnonzero(rows[plan.in_time])
    times = MINUTES * plan.hours[plan.in_time[ranks]] + 1e-6
    for rank in (*ranks[times < minutes - reach][-1:], *ranks[times >= minutes + reach][:1]):
        k = int(plan.in_time[rank])
        entry = {**plan.entry(k), "posture": measured.posture[k], "cycle": measured.cycle[k]}
        names = ("leg", "direction", "posture", "cycle") if "leg" in entry else ()
        yield {"order": str(rank + 1)} | {name: str(entry[name]) for name in names}


def _gauges(
    pattern: Pattern, fits: _Fits, rows: Bools
) -> Iterator[tuple[str, float, float, float]]:
    """Effect on each gauge: name, peak to peak, its standard deviation [mm], span [K] or 1.

    Positive where the later of the two readings is the larger. More noise is one for all.
    """
    shapes, plan = pattern.shapes, pattern.at.white.plan
    if pattern.how == "scatters":
        sizes = np.array([shape.size for shape in shapes])
        # Sizes between those that were tried are as likely.
        between = sizes * math.log(pattern.sizes[1] / pattern.sizes[0]) / math.sqrt(12.0)
        size, std = _mean_and_std(fits, sizes, between**2)
        yield "noise", float(size), float(std), 1.0
        return
    fit, columns = fits[0][1], shapes[0].columns
    effect = columns @ fit.moved[fit.first_uncertain - columns.shape[1] : fit.first_uncertain]
    in_time = plan.in_time
    for gauge in dict.fromkeys(plan.shared[in_time[rows[in_time]]].tolist()):
        read = in_time[plan.shared[in_time] == gauge]
        ends = read[effect[read].argmin()], read[effect[read].argmax()]
        first, last = sorted(ends, key=plan.order.__getitem__)
        apart = [(shape.columns[last] - shape.columns[first])[None] for shape in shapes]
        if np.any(apart[0]):
            mean, std = _sizes(fits, apart)
            entry = plan.entry(int(first))
            name = f"{entry['direction']}_{entry['leg']}" if "leg" in entry else "readings"
            kelvin = pattern.how == "temperature"
            span = shapes[0].parameter * float(apart[0].sum()) if kelvin else 1.0
            yield name, float(mean[0]), float(std[0]), span


def _heldout(rows: Bools, before: Fit, after: Fit, cells: Ints) -> tuple[float, float] | None:
    """Errors of predicting some readings, without and with the pattern, r.m.s. [mm].

    One of the cells (n,) is left out at a time, none below 0; None where there are no two.
    """
    blocks = [block for block in left_out(before.white, (), cells) if cells[block[0]] >= 0]
    if len(np.unique(cells)) < 2 or not any(rows[block].any() for block in blocks):
        return None
    errors = []
    for fit in (before, after):
        which, error, _ = leave_out(fit, blocks)
        errors.append(rms((error / fit.white.plan.precision[which])[rows[which]]))
    return errors[0], errors[1]
