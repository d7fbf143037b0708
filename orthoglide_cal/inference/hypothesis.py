"""Evidence of every explanation, linearised where the offsets-only model fits best.

Of a cause with several parameters often one acts alone: one bar is skewed, the other five are not.
If all its parameters count, such a cause loses to one with fewer; so its evidence is the mean of
both cases. With another fault only the first is tried, which is a lower bound.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.gaussian import log_mean, log_sum
from orthoglide_cal.estimation.solution import require_rank
from orthoglide_cal.inference.data import ONE_CAUSE, TWO_CAUSES, Ids, Linearised, Placed, ids_of
from orthoglide_cal.inference.evidence import Gaussian
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Cause, Effect, Place
from orthoglide_cal.model.plan import AT_ONCE, Bools, Floats, Ints, Where, read_only

# Blunders have no typical size: each is tried at the tolerance and at larger scales.
BLUNDER_SCALES = (1.0, 6.0)
# Share of the cases in which all parameters of a cause act.
ALL = 0.5
LOG_ALL, LOG_ONE = math.log(ALL), math.log(1.0 - ALL)
# A log density this far below another one adds nothing to their sum.
LOST = 100.0
# ln weight of what a listed cause makes: all but one in a hundred of such effects have that cause.
LISTED = math.log(0.01)
# Limits of effort: no more shapes of a pattern count, and none below this share.
SHAPES, SHARE = 12, 0.01
# Of wrong readings, each by itself, no more are looked for than a tenth of all, and than so many:
# each costs a pass over the readings.
SHARE_WRONG, MOST_WRONG = 10, 40
# They are looked for with so many of the likeliest sets, and the same are then wrong with all
# others; beyond that many readings with one set, none is taken back, and so many others follow.
SEARCHED, FEW, OTHERS = 3, 1000, 16
# A further reading is wrong as a second cause acts, independently of the first.
LOG_FURTHER = math.log(TWO_CAUSES / ONE_CAUSE)

Bases = Sequence[tuple[Cause, ...]]
# Causes to fix, and readings to take again.
Remedy = tuple[Ids, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of unit size in v shapes, (n, v, q) [mm]: b of each of g movers, zero elsewhere."""

    movers: Bools  # readings of each, (g, n)
    parts: Sequence[Floats]  # its columns at these, each (r, v, b)
    number: Ints  # of the mover of each, (q,); none of what is no effect of a mover
    parameters: Floats | None = None  # of each shape, (v,): its moment, time constant, or span

    def written(self, shapes: Sequence[int] | Ints, chosen: Bools | np.bool_) -> Floats:
        """Write out some columns (q,) of some shapes, (n, v, c)."""
        places = zip(*np.divmod(np.flatnonzero(chosen), self.parts[0].shape[2]), strict=True)
        columns = np.zeros((self.movers.shape[1], len(shapes), np.count_nonzero(chosen)))
        for number, (mover, part) in enumerate(places):
            columns[self.movers[mover], :, number] = self.parts[mover][:, shapes, part]
        return columns

    def products(self, values: Floats) -> Floats:
        """Cᵀ v of each shape C and values (n, p), shape (v, q, p)."""
        blocks = []
        for mover, part in zip(self.movers, self.parts, strict=True):
            block = part.reshape(len(part), -1).T @ values[mover]
            blocks.append(block.reshape(*part.shape[1:], -1))
        return np.concatenate(blocks, axis=1)

    def squares(self, weight: Floats) -> Floats:
        """Cᵀ diag(w²) C of each shape C and weights (n,), shape (v, q, q)."""
        blocks = []
        for mover, part in zip(self.movers, self.parts, strict=True):
            weighed = weight[mover, None, None] * part
            square = weighed[..., :, None] * weighed[..., None, :]
            block = self.movers[:, mover] @ square.reshape(len(part), -1)
            blocks.append(block.reshape(-1, *square.shape[1:]))
        shapes, width = self.parts[0].shape[1:]
        square = np.stack(blocks).transpose(2, 0, 3, 1, 4)
        return square.reshape(shapes, *[len(blocks) * width] * 2)


class Shape(NamedTuple):
    """A shape of a pattern in the readings, with its probability.

    Of more noise the columns are the readings that have it.
    """

    share: float
    columns: Floats  # of unit size, shape (n, q) [mm]
    parameter: float  # the moment, or time constant [h], or span [K] that it is of; 0 without
    size: float  # plausible size [mm]


@dataclass(frozen=True, eq=False)
class Pattern:
    """A how at a where, which no listed cause makes; or a listed cause whose shapes are places."""

    at: Linearised
    how: str
    where: Where
    log_prior: float  # ln prior weight
    columns: Columns  # of the how at any where, in v shapes
    chosen: Bools  # which columns show here, and show nothing else, (v, q)
    sizes: Floats  # that are tried, (s,): in standard deviations of a reading, once scored in mm
    # Once it is scored: ln p of each shape and size up to a constant, (v, s), and by how much the
    # likeliest of them raised ln p.
    log_shape: Floats = field(default_factory=lambda: np.zeros((1, 1)))
    gain: float = 0.0

    @cached_property
    def _log_share(self) -> Floats:
        return np.full(len(self.chosen), np.nan)  # of those that were not asked for

    def log_share(self, likely: Bools) -> Floats:
        """ln weight of likely shapes, (v,): less if a listed cause makes it at a gauge; 0 else."""
        log, chosen, number = self._log_share, self.chosen.any(axis=0), self.columns.number
        if len(number) and len(np.unique(number[chosen])) == 1:
            shapes = np.flatnonzero(self.chosen.any(axis=1) & likely & np.isnan(log))
            some = max(AT_ONCE // (len(self.at.white) * int(chosen.sum())), 1)
            for part in (shapes[start : start + some] for start in range(0, len(shapes), some)):
                made = self.columns.written(part, chosen)
                shown = self.at.white.matrix @ made.reshape(len(made), -1)
                log[part] = LISTED * self.at.lists(shown.reshape(-1, *made.shape[1:]))
        return np.nan_to_num(log)

    @cached_property
    def shapes(self) -> list[Shape]:
        """The likeliest shapes."""
        share = np.exp(self.log_shape - log_sum(self.log_shape))
        best = np.argsort(-share, axis=None, kind="stable")[:SHAPES]
        columns, chosen, parameters = self.columns, self.chosen, self.columns.parameters
        values = np.zeros(len(chosen)) if parameters is None else parameters
        return [
            Shape(share[v, s], columns.written([v], chosen[v])[:, 0], values[v], self.sizes[s])
            for v, s in zip(*np.unravel_index(best, share.shape), strict=True)
            if share[v, s] >= min(SHARE, share.max())
        ]

    @property
    def label(self) -> str:
        """Name of how and where, in a word each."""
        return " ".join([self.how, *chain(*self.where.items())])


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A possible state of machine or record: listed causes, one of them placed, or a pattern."""

    at: Linearised  # the linear model that it was scored with
    log_evidence: float  # with the prior of places, without its own; averaged over sizes
    base: tuple[Cause, ...] = ()  # its causes with many parameters
    scale: float = 1.0  # of their sizes, the likeliest one
    extra: Effect | None = None  # its cause at one place, if any; without parameters of any value
    # Where the extra is an exchange that the data cannot undo, the linear model under the plan of
    # what was really read.
    replanned: Linearised | None = None
    # Shares of the extra's sizes and places, in the order of `Placed.numbered`; None without
    # others.
    by_place: Floats | None = None
    # Its log density at each scale and σ, all its parameters acting, (s, g); None with an extra.
    by_noise: Floats | None = None
    # On equal terms with the causes: where one wins, the data hold something real that no listed
    # cause explains, and its size goes into the uncertainty.
    patterns: tuple[Pattern, ...] = ()
    # ln p of the data in mm at its fit; None before it is fitted, and of data in another unit.
    log_likelihood: float | None = None

    @property
    def ids(self) -> Ids:
        """Its listed causes, sorted."""
        return ids_of(*self.base, *((self.extra.cause,) if self.extra else ()))

    @cached_property
    def log_prior(self) -> float:
        """ln prior weight."""
        listed, ids = sum(pattern.log_prior for pattern in self.patterns), self.ids
        return listed if self.patterns and not ids else self.at.candidates.log_prior[ids] + listed

    @property
    def log_weight(self) -> float:
        """ln of prior times evidence."""
        return self.log_evidence + self.log_prior

    @property
    def linearised(self) -> Linearised:
        """The linear model that it was scored with, and its fit begins with."""
        return self.replanned or self.at

    @cached_property
    def version(self) -> int:
        """Number of the version of the data that it explains."""
        if self.extra is None or self.replanned or not self.extra.cause.exchanges:
            return 0
        placed = self.at.extras[self.extra.cause.id]
        return placed.first + placed.tried.index(self.extra.place)

    @cached_property
    def added(self) -> Floats:
        """Effect of an extra of known size on the data, shape (k,) [mm]."""
        extra = self.extra
        if extra is None or not extra.theta.size:
            return read_only(np.zeros(len(self.at.white)))
        size = extra.theta * extra.cause.millimetres(self.at.white.machine)
        return read_only(self.at.extras[extra.cause.id].columns(extra.place) @ size)

    @property
    def wrong_readings(self) -> Place:
        """Numbers of the readings that it calls wrong, each by itself."""
        return self.extra.place if self.extra and self.extra.cause.hides_reading else ()

    @property
    def label(self) -> str:
        """Its patterns in words, and the ids of its listed causes."""
        return ", ".join([pattern.label for pattern in self.patterns] + [*self.ids])

    @cached_property
    def remedy(self) -> Remedy:
        """Actions that it asks for; explanations that ask for the same are one answer."""
        base, extra = _remedies(*self.base), self.extra
        if extra is None:
            return base, ()
        again = extra.cause.to_read_again(self.at.white.plan, extra.place)
        return (base, again) if again else (_remedies(*self.base, extra.cause), ())


@functools.lru_cache(maxsize=256)
def _remedies(*causes: Cause) -> Ids:
    return tuple(sorted({cause.same_remedy_as or cause.id for cause in causes}))


def score_all(at: Linearised, wrong: Place = ()) -> dict[Ids, Hypothesis]:
    """The score of every set of listed causes; `wrong` readings are several that are known to be.

    Where a reading lacks its counterpart, an exchange cannot be undone in the data. Then the same
    data are read under another plan instead, with a linear model of its own.
    """
    scores, plan = _listed(at), at.white.plan
    for placed in at.extras.values():
        cause = placed.cause
        for place in placed.replanned:
            problem = replace(at.white.problem, plan=cause.really_read(plan, place))
            try:
                require_rank(problem)
                fewer = replace(at.candidates, extras=(), pairs=())
                under = Linearised.of(replace(at.white, problem=problem), fewer)
            except UnusableResultError:  # what no offsets fit did not happen
                continue
            for score in _listed(under).values():
                ids = ids_of(*score.base, cause)
                log = score.log_evidence + placed.log_weight[place]
                if ids not in scores or log > scores[ids].log_evidence:
                    extra = cause.at(np.zeros(0), place)
                    scores[ids] = replace(
                        score, at=at, log_evidence=log, extra=extra, replanned=under
                    )
    slips = [placed for placed in at.extras.values() if placed.cause.hides_reading]
    return scores | {one.ids: one for placed in slips for one in _wrong(at, scores, placed, wrong)}


def _wrong(
    at: Linearised, scores: Mapping[Ids, Hypothesis], placed: Placed, known: Place
) -> list[Hypothesis]:
    """Scores of the sets with wrong readings, each with as many as make it likeliest.

    Also beside two causes; nothing where one wrong reading makes no set likelier.
    """
    one = [score for score in scores.values() if score.extra and score.extra.cause is placed.cause]
    likelier = [s for s in one if s.log_evidence > scores[ids_of(*s.base)].log_evidence]
    if not likelier:
        return []
    for pairs in _together(at, at.candidates.pairs):
        both = density_of(at, pairs, at.usual)
        likelier += _at_best_place(at, pairs, placed, both, both.log_density(at.residuals[:1].T))
    likelier.sort(key=attrgetter("log_weight"), reverse=True)
    few = len(at.white) <= FEW
    searched = 0 if known else SEARCHED if few else 1
    best, rest = [_several_wrong(at, one) for one in likelier[:searched]], likelier[searched:]
    if others := (known or max(best, key=attrgetter("log_weight")).wrong_readings)[:-1]:
        for number, score in enumerate(rest if few else rest[:OTHERS]):
            more = _further(at, score, others)
            rest[number] = max(score, more, key=attrgetter("log_evidence"))
    return best + rest


def _several_wrong(at: Linearised, score: Hypothesis) -> Hypothesis:
    """The score with as many wrong readings as make it likeliest: one more, again and again.

    One that adds nothing is passed once: some show only if the next is taken out, too.
    """
    most, best = min(len(at.white.plan) // SHARE_WRONG, MOST_WRONG), score
    for count in range(2, most + 1):
        score = _further(at, score, score.wrong_readings)
        if score.log_evidence > best.log_evidence:
            best = score
        elif count > len(best.wrong_readings) + 1:
            break
    score = best
    # What stood for others at first may be right.
    for number in best.wrong_readings[:-1] if len(at.white) <= FEW else ():
        kept = tuple(other for other in score.wrong_readings if other != number)
        score = max(score, _further(at, score, kept[:-1]), key=attrgetter("log_evidence"))
    return score


def _further(at: Linearised, score: Hypothesis, others: Place) -> Hypothesis:
    """The score with these readings wrong, and one more, which may be any."""
    assert score.extra is not None
    placed, base = at.extras[score.extra.cause.id], [score.base]
    wrong, price = others_wrong(at, placed, others)
    density = density_of(at, base, at.usual, seen=[np.hstack((at.seen, wrong))])
    by_version = density.log_density(at.residuals[:1].T)
    (further,) = _at_best_place(at, base, placed, density, by_version, others)
    return replace(further, log_evidence=further.log_evidence + price)


def others_wrong(at: Linearised, placed: Placed, others: Place) -> tuple[Floats, float]:
    """Wrong readings besides one more: columns (k, p) [mm], ln of their prior.

    Each as large as the larger of `BLUNDER_SCALES`, and at a place of its own.
    """
    if not others:
        return np.zeros((len(at.white), 0)), 0.0
    size = placed.cause.prior_std(at.white.machine)[0] * max(BLUNDER_SCALES)
    price = len(others) * (LOG_FURTHER - math.log(len(BLUNDER_SCALES)))
    return size * placed.columns(others), price + float(placed.weights[list(others)].sum())


def _listed(at: Linearised) -> dict[Ids, Hypothesis]:
    """Scores of all sets of which every relabelling can be undone in the data."""
    residual, singles = at.residuals[0], [(cause,) for cause in at.candidates.broad]
    scores: list[Hypothesis] = []
    for bases in _together(at, [(), *singles]):
        density = density_of(at, bases, at.scales)
        scores += _alone(at, bases, density.by_noise(residual))
        density = density.at_sizes(slice(len(at.usual)), np.log(list(at.usual.values())))
        by_version = density.log_density(at.residuals.T)
        for placed in at.extras.values():
            if placed.tried:
                scores += _at_best_place(at, bases, placed, density, by_version)
    for pairs in _together(at, at.candidates.pairs):
        both = density_of(at, pairs, at.usual)
        scores += _alone(at, pairs, both.by_noise(residual) + LOG_ALL)
    listed = {score.ids: score for score in scores}
    for bases in _together(at, singles):
        causes = [cause for (cause,) in bases]
        log_all = [listed[cause.id,].log_evidence for cause in causes]
        for cause, mean in zip(causes, all_or_one(at, causes, residual, log_all), strict=True):
            listed[cause.id,] = replace(listed[cause.id,], log_evidence=mean)
    return listed


def _together(at: Linearised, bases: Bases) -> Iterator[Bases]:
    """Bases that are weighed together: few where there are many readings."""
    some = max(AT_ONCE // (32 * len(at.white)), 1)
    return (bases[start : start + some] for start in range(0, len(bases), some))


def _alone(at: Linearised, bases: Bases, log: Floats) -> Iterator[Hypothesis]:
    """Scores of bases without an extra, from the log density for each, scale and σ, (b, s, g)."""
    by_scale = log_sum(log, 2)
    scales = np.array(list(at.scales))[by_scale.argmax(axis=1)]
    values = log_sum(by_scale, 1).tolist()
    for base, value, scale, one in zip(bases, values, scales.tolist(), read_only(log), strict=True):
        yield Hypothesis(at, value, base, scale, by_noise=one)


def density_of(
    at: Linearised,
    bases: Bases,
    scales: Mapping[float, float],
    columns: Sequence[Floats] = (),
    seen: Sequence[Floats] = (),
) -> Gaussian:
    """Densities under many bases at several scales of their sizes, with shares; axes (b, s, ...).

    `columns` are the derivatives by the offsets and the parameters of each base, shape (k, 3 + p),
    `seen` what is uncertain of the data and shows with it; without them as `at` has these.
    """
    columns, seen = columns or [*map(at.columns, bases)], seen or [at.seen] * len(bases)
    every = [np.concatenate(pair, 1) for pair in zip(columns, seen, strict=True)]
    width, first = max(one.shape[1] for one in every), at.jacobian.shape[1]
    padded = np.zeros((len(bases), len(at.white), width))
    sizes = np.ones((len(bases), len(scales), width))
    for number, (base, derivatives, one) in enumerate(zip(bases, columns, every, strict=True)):
        end = derivatives.shape[1]
        padded[number, :, : one.shape[1]] = one
        sizes[number, :, :end] = at.sizes(base)
        sizes[number, :, first:end] *= np.array(list(scales))[:, None]
    return Gaussian(padded, sizes, at.noise, np.log(list(scales.values())))


def all_or_one(
    at: Linearised,
    causes: Sequence[Cause],
    residual: Floats,
    log_all: Sequence[float],
    columns: Sequence[Floats] = (),
) -> list[float]:
    """Log evidence of causes of which all parameters act, or any one of them.

    From data minus the model without the cause, shape (k,) [mm], and the log evidence if all its
    parameters act; `columns`: see `density_of`.
    """
    width = at.jacobian.shape[1]
    always, nuisance = width + at.seen.shape[1], max(len(cause.nuisance) for cause in causes)
    others = np.zeros((len(causes), len(at.white), always + nuisance))
    ones = np.zeros((*others.shape[:2], max(len(cause.names) for cause in causes)))
    columns = columns or [at.columns((cause,)) for cause in causes]
    for cause, derivatives, filled, scaled in zip(causes, columns, others, ones, strict=True):
        end = width + len(cause.names)
        known = derivatives * at.sizes((cause,))
        scaled[:, : end - width] = known[:, width:end]
        parts = known[:, :width], at.seen, known[:, end:]
        filled[:, : always + known.shape[1] - end] = np.concatenate(parts, 1)
    tried = np.array(list(at.scales))[:, None]
    sizes = np.ones((len(tried), others.shape[-1]))
    sizes[:, always:] = tried
    density = Gaussian(others, sizes, at.noise, np.log(list(at.scales.values())))
    both = (density.overlap(values, residual) for values in (ones, residual[:, None]))
    one = density.against(*both)
    log = of_any_size(*one, tried[:, None] ** 2) + density.by_noise(residual)[..., None]
    by_one = log_sum(log, (1, 2))
    return [
        float(np.logaddexp(log + LOG_ALL, log_mean(row[: len(cause.names)]) + LOG_ONE))
        for cause, log, row in zip(causes, log_all, by_one, strict=True)
    ]


def _at_best_place(
    at: Linearised,
    bases: Bases,
    placed: Placed,
    density: Gaussian,
    by_version: Floats,
    others: Place = (),
) -> list[Hypothesis]:
    """Scores of an extra with each base, under their density: of each version (b, s, g, v).

    `others` are readings that are wrong as well.
    """
    cause, places = placed.cause, len(placed.tried)
    sizes = 1
    if placed.patterns is not None:
        sizes = len(cause.counts or BLUNDER_SCALES)
        logs = pattern_densities(at, placed, density, at.residuals[0], by_version[..., 0])
    else:
        undone = by_version[..., placed.first : placed.first + places] + placed.weights
        logs = iter([(np.arange(places), undone)])
    every = np.full((len(bases), sizes * places), -math.inf)
    likeliest = np.zeros(every.shape, dtype=np.int8)  # among the scales
    for numbers, log in logs:
        by_scale = log_sum(log, 2)
        every[:, numbers] = log_sum(by_scale, 1)
        likeliest[:, numbers] = by_scale.argmax(axis=1)
    every.reshape(len(bases), sizes, places)[..., list(others)] = -math.inf
    best, total = every.argmax(axis=1), log_sum(every, 1)
    shares = np.exp(every - total[:, None])
    # Sizes of any value are not distinguished: they are averaged over at each place.
    if not cause.counts:
        shares = shares.reshape(len(shares), -1, places).sum(axis=1)
    shares.setflags(write=False)
    effects = {number: placed.numbered(number, others) for number in {*best.tolist()}}
    number = likeliest[np.arange(len(bases)), best]
    scale = np.array(list(at.scales))[number].tolist()
    total += np.where([bool(base) for base in bases], LOG_ALL, 0.0)
    rows = zip(bases, scale, best.tolist(), total.tolist(), shares, strict=True)
    return [
        Hypothesis(at, value, base, size, effects[number], by_place=None if others else share)
        for base, size, number, value, share in rows
    ]


def pattern_densities(
    at: Linearised, placed: Placed, density: Gaussian, residual: Floats, by_noise: Floats
) -> Iterator[tuple[Ints, Floats]]:
    """`pattern_density` of a cause's places, some at a time: numbers (m,) and (..., s, g, m).

    The numbers are those of `Placed.numbered`. With the weight of each place; from a residual,
    shape (k,) [mm] or (..., k), and its log density without the cause at each σ, `by_noise`
    (..., s, g). Of sizes that are whole numbers not those at a place that add nothing to the
    likeliest one, and only this where the cause is out of the question.
    """
    cause, machine, places = placed.cause, at.white.machine, len(placed.tried)
    assert placed.patterns is not None
    every = density.overlap(placed.patterns, residual)
    data = density.overlap(residual[..., None], residual)
    sizes = len(cause.counts or BLUNDER_SCALES)
    some = max(AT_ONCE // (by_noise.size * sizes), 1)
    most = np.full(by_noise.shape[:-2], -math.inf)
    for start in range(0, places, some):
        chosen = np.arange(start, min(start + some, places))
        power, match = density.against(every.some(chosen), data)
        kept: Ints | slice = slice(None)
        if cause.counts:
            # With the least and the most noise: what is lost with both is lost.
            ends = [0, -1]
            log = pattern_density(
                machine, cause, power[..., ends, :], match[..., ends, :], by_noise[..., ends]
            ).max(axis=(-4, -3))
            most = np.maximum(most, log.max(axis=(-2, -1)))
            likely = most >= by_noise.max(axis=(-2, -1)) - LOST
            least = (most - LOST * likely)[..., None, None]
            counts = (log >= least).reshape(-1, *log.shape[-2:]).any(axis=0)
            at_all = counts.any(axis=0)
            if not at_all.any():
                continue
            chosen, power, match = chosen[at_all], power[..., at_all], match[..., at_all]
            kept = np.flatnonzero(counts[:, at_all])
        log = pattern_density(machine, cause, power, match, by_noise)
        log += placed.weights[chosen]
        numbers = np.add.outer(places * np.arange(sizes), chosen).reshape(-1)
        yield numbers[kept], log.reshape(*by_noise.shape, -1)[..., kept]


def pattern_density(
    machine: Machine, cause: Cause, power: Floats, match: Floats, without: Floats
) -> Floats:
    """Log density with a cause's pattern c at each size and place, and ln of the size's share.

    From cᵀ S⁻¹ c and cᵀ S⁻¹ r, shape (..., g, places), and the log density without it, shape
    (..., g), to shape (..., g, sizes, places).
    """
    power, match = power[..., None, :], match[..., None, :]
    if cause.counts:
        size = np.array(list(cause.counts))[:, None] * cause.millimetres(machine)
        log = match - (0.5 * size) * power
        log *= size
        share = np.log(list(cause.counts.values()))
    else:
        scales = np.array(BLUNDER_SCALES)
        log = of_any_size(power, match, ((cause.prior_std(machine)[0] * scales) ** 2)[:, None])
        share = np.full(len(scales), -math.log(len(scales)))
    log += (without[..., None] + share)[..., None]
    return log


def of_any_size(power: Floats, match: Floats, variance: Floats) -> Floats:
    """Gain of a log density by a column c of size N(0, variance), from cᵀ S⁻¹ c and cᵀ S⁻¹ r."""
    widened = variance * power
    widened += 1.0
    log = match**2 * variance
    log /= widened
    log -= np.log(widened)
    log *= 0.5
    return log
