"""Hypotheses about several sessions of one machine, judged by the evidence of one.

After a correction: did the machine respond as applied, opposite, not at all? Over several dates: is
it unchanged, did it change in a step, does it drift or scatter, or several of these?
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np

from orthoglide_cal.estimation.gaussian import (
    condition,
    log_mean,
    probabilities,
    root_of,
    whiten,
    whiten_shared,
)
from orthoglide_cal.inference.evidence import UNIT, Gaussian, NoiseGrid
from orthoglide_cal.losses import (
    FALSE_RELEASE,
    MISSED_CHANGE,
    MISSED_FAULT,
    NEEDLESS_HOLD,
    WRONG_STORY,
    is_dismissed,
    state,
)
from orthoglide_cal.model.plan import Floats, ReadOnly
from orthoglide_cal.words import MM_PER_INCH

# Stands a millimetre off change what a gauge shows of an offset by up to this share of it.
STANDS = 0.01
GAINS = 2.0 ** np.arange(-5.0, 6.0)  # prior ones of what is free, in units of what was applied
NOISE = 2.0 ** np.arange(-1.0, 7.0, 0.5)  # that are tried, in units of what is stated


class Behaviour(StrEnum):
    """Response of the machine."""

    AS_MODELLED = "as modelled"
    OPPOSITE = "opposite sign"
    EXCHANGED = "axes exchanged"
    NO_RESPONSE = "no response"
    OTHER_GAIN = "other gain"
    PARTLY = "in part"
    UNDETERMINED = "undetermined"


# A correction that has to be verified went wrong as often as not, in each of five ways as often.
PLAUSIBLE = dict.fromkeys(Behaviour, 0.1) | {Behaviour.AS_MODELLED: 0.5}
# Of exchanged axes half have kept their signs: five orders of 46.
SIGNS_KEPT, SIGNS_CHANGED = 0.5 / 5.0, 0.5 / 41.0


@dataclass(frozen=True, eq=False)
class Response:
    """One hypothesis: what each axis did."""

    behaviour: Behaviour
    share: float  # of the prior of that behaviour
    moved: Floats  # what the axes moved by, shape (3,) [mm]
    free: Floats  # columns of what is free about it, of size 1, shape (3, q) [mm]


def responses(applied: Floats) -> Iterator[Response]:
    """Every hypothesis about what was applied, (3,) [mm], not all zero; or all as one, (1,)."""
    nothing, every = np.zeros((len(applied), 0)), np.abs(applied).max() * np.eye(len(applied))
    yield Response(Behaviour.AS_MODELLED, 1.0, applied, nothing)
    yield Response(Behaviour.OPPOSITE, 1.0, -applied, nothing)
    yield Response(Behaviour.NO_RESPONSE, 1.0, 0.0 * applied, nothing)
    yield Response(Behaviour.OTHER_GAIN, 0.5, applied, applied[:, None])
    for gain in (MM_PER_INCH, 1.0 / MM_PER_INCH):
        yield Response(Behaviour.OTHER_GAIN, 0.25, gain * applied, nothing)
    if len(applied) == 1:
        return  # nothing is exchanged, and a part of it is another gain
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order != (0, 1, 2) or len(set(signs)) > 1:
            share = SIGNS_KEPT if min(signs) > 0.0 else SIGNS_CHANGED
            moved = np.array(signs) * applied[list(order)]
            yield Response(Behaviour.EXCHANGED, share, moved, nothing)
    subsets = [list(axes) for count in (1, 2, 3) for axes in combinations(range(3), count)]
    for subset in subsets:
        yield Response(Behaviour.PARTLY, 1.0 / len(subsets), applied, every[:, subset])


def decide_response(
    change: Floats, jacobian: Floats, applied: Floats, noise_mm: float
) -> tuple[Behaviour, Response]:
    """The statement of least expected loss about a correction, and its likeliest hypothesis.

        change = J m + e,   m = order·applied + C g,   g ~ N(0, size²),   e ~ N(0, σ² I)

    A hypothesis is a signed order of what was applied, and what is free about it, C g: the gain of
    all axes together, or axes by themselves. σ is unknown: two sessions often differ by more than
    the noise of one reading, `noise_mm`, as stated.

    The readings change by (k,) [mm] where the axes move by m; J is `jacobian`, (k, 3), and what was
    `applied` (3,) [mm] is not all zero.
    """
    noise, log_weight = NoiseGrid(noise_mm * NOISE, np.zeros(len(NOISE))), dict[Response, float]()
    for one in responses(applied):
        columns = jacobian @ np.hstack((np.diag(STANDS * one.moved), one.free))
        sizes = np.repeat(GAINS[:, None], columns.shape[1], axis=1)
        sizes[:, : len(one.moved)] = 1.0
        log = log_mean(Gaussian(columns, sizes, noise).by_noise(change - jacobian @ one.moved))
        log_weight[one] = log + math.log(one.share * PLAUSIBLE[one.behaviour])
    shares = probabilities(log_weight)
    belief = {key: sum(p for one, p in shares.items() if one.behaviour is key) for key in Behaviour}
    likeliest = {one.behaviour: one for one in reversed(shares)}
    stated, _ = state(belief, Behaviour.AS_MODELLED, MISSED_FAULT, NEEDLESS_HOLD)
    either = Behaviour.AS_MODELLED, Behaviour.NO_RESPONSE
    if stated in either and not is_dismissed(min(belief[key] for key in either), FALSE_RELEASE):
        return Behaviour.UNDETERMINED, likeliest[Behaviour.AS_MODELLED]
    return stated, likeliest[stated]


SPREADS = 2.0 ** np.arange(-1.0, 10.0)  # prior ones, in units of what a session knows
FREE = 1e4  # prior size, in the same units, of the parameters and of what is reported: any
LOG_FURTHER = math.log(0.5)  # log prior of one more step
MOST_STEPS = 20  # limit of effort
POSITIVE = 1e-6  # added share of variance, which keeps covariances positive definite
LEAST = 1e-4  # a direction of what is common that is so much smaller than the largest adds nothing


class Trend(StrEnum):
    """Course of a machine between the first session and the last; what matters most first."""

    CHANGED = "changed"
    DRIFTING = "drifting"
    SCATTERING = "scattering"
    UNCHANGED = "unchanged"


PRIOR = {Trend.CHANGED: 0.2, Trend.DRIFTING: 0.1, Trend.SCATTERING: 0.1}
Trends = tuple[Trend, ...]  # that act together, what matters most first


class Part(NamedTuple):
    """A step or a drift: of which parameters, of which prior size; a step after session `at`."""

    trend: Trend
    at: int
    subset: tuple[int, ...]
    size: float


@dataclass(frozen=True, eq=False)
class DatedValues(ReadOnly):
    """Findings of n sessions of p parameters, in the parameters' units.

        y_i = θ + steps + rate·t_i + scatter_i + L_i w + e_i,   w ~ N(0, 1),   e_i ~ N(0, V_i)

    y_i is what session i finds of each parameter. L_i w is common to the sessions (legs, gauge
    scale, the touched bed, the effect of the temperature): it cancels between them. Steps and rates
    are columns, scatter is covariance under the dates. All have priors of many sizes and of subsets
    of parameters, so the evidence of each trend is a sum of densities as `evidence` has them.
    """

    values: Floats  # shape (n, p)
    covariance: Floats  # of what each session has of its own, shape (n, p, p)
    # Of each session, by source, what one standard deviation of it adds in all, shape (p, q).
    common: Sequence[Mapping[Hashable, Floats]]
    times: Floats  # in days, or numbers of sessions, shape (n,)
    groups: Sequence[Sequence[int]]  # numbers of parameters that belong together

    @cached_property
    def unit(self) -> Floats:
        """Standard uncertainty of one session of each parameter, shape (p,)."""
        variance = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(np.sqrt(np.median(variance, axis=0)))

    @cached_property
    def shared(self) -> Floats:
        """Columns of what the sessions have in common, in those units, shape (n, p, q)."""
        joint = np.zeros((*self.values.shape, *self.values.shape))
        for at, one in enumerate(self.common):
            for k, other in enumerate(self.common):
                both = (one[source] @ other[source].T for source in one if source in other)
                joint[at, :, k] = sum(both, joint[at, :, k])
        unit, size = np.tile(self.unit, len(self.values)), self.values.size
        # Few directions hold what many unknowns do.
        columns = root_of(joint.reshape(size, size) / np.outer(unit, unit))
        length = np.linalg.norm(columns, axis=0)
        return columns[:, length > LEAST * length.max()].reshape(*self.values.shape, -1)

    @cached_property
    def span(self) -> float:
        """Time from the first session to the last."""
        return float(np.ptp(self.times)) or 1.0

    @cached_property
    def courses(self) -> Mapping[Trend, Floats]:
        """Course of each step, shape (n − 1, n), and of a drift over the whole time, (1, n)."""
        count = len(self.times)
        after = np.arange(count) > np.arange(count - 1)[:, None]
        line = (self.times - self.times.mean())[None] / self.span
        return {Trend.CHANGED: 1.0 * after, Trend.DRIFTING: line}

    @cached_property
    def subsets(self) -> list[tuple[int, ...]]:
        """Parameters that may change together: any one or two, those of a group, all."""
        every = range(len(self.unit))
        few = (chosen for size in (1, 2) for chosen in combinations(every, size))
        return list(dict.fromkeys(map(tuple, (*few, *self.groups, every))))

    def columns(self, parts: Sequence[Part], later: float = 0.0) -> Floats:
        """Derivatives of values so much later, (n, p, m): by θ, by w, by the sizes of each part."""
        every = np.eye(len(self.unit))
        columns = [np.broadcast_to(every, (len(self.values), *every.shape)), self.shared]
        for part in parts:
            shift = later / self.span if part.trend is Trend.DRIFTING else 0.0
            course = self.courses[part.trend][part.at] + shift
            columns.append(course[:, None, None] * every[:, list(part.subset)])
        return self.unit[:, None] * np.concatenate(columns, axis=2)


class TrendFit:
    """Steps and a drift with a scatter (p,) from session to session, fitted to dated values."""

    def __init__(self, data: DatedValues, parts: Sequence[Part], scatter: Floats) -> None:
        self.data, self.parts, self.scatter = data, parts, scatter
        columns, centre = data.columns(parts), data.values.mean(axis=0)
        # Of what each session has of its own, shape (n, p, p).
        self.spread = data.covariance + np.diag(scatter**2 + POSITIVE * data.unit**2)
        common = np.ones(data.shared.shape[2])
        sizes = (np.full(len(part.subset), part.size) for part in parts)
        self._prior = np.concatenate([np.full(len(scatter), FREE), common, *sizes])
        both = (data.values - centre)[..., None], columns
        values, white, self._every = whiten(self.spread, *both, np.diag(data.unit)[None])
        self._values, self._columns = values.reshape(-1), white.reshape(-1, len(self._prior))
        density = Gaussian(self._columns, self._prior[None], UNIT).by_noise(self._values)
        self.log_evidence = float(density[0, 0] - 0.5 * np.linalg.slogdet(self.spread)[1].sum())
        self.mean, self.covariance = condition(self._columns, self._values, self._prior, 1.0)
        self.mean[: len(scatter)] += centre / data.unit
        self.residual = data.values - columns @ self.mean

    def one_more(self, trend: Trend) -> tuple[float, Part]:
        """Log evidence that one more part adds, over all that it may be, and the likeliest."""
        subsets, course = self.data.subsets, self.data.courses[trend]
        # What it adds at each place, of each parameter, in addition to what acts already.
        new = np.einsum("gn,npq->npgq", course, self._every).reshape(len(self._values), -1)
        left, new = whiten_shared(self._columns * self._prior, self._values, new)
        new = new.reshape(len(left), len(course), -1).swapaxes(0, 1)
        tried = ((new[..., one], np.tile(SPREADS[:, None], len(one))) for one in map(list, subsets))
        logs = [Gaussian(*one, UNIT).by_noise(left)[..., 0] for one in tried]
        gain = np.stack(logs) + 0.5 * left @ left
        chosen, place, size = np.unravel_index(int(gain.argmax()), gain.shape)
        return log_mean(gain), Part(trend, int(place), subsets[chosen], float(SPREADS[size]))

    @property
    def homing(self) -> Floats:
        """Scatter that is left from session to session beyond what each does not know, (p,)."""
        known = np.median(self.data.covariance, axis=0).diagonal()
        spare = max(len(self.residual) - 1 - len(self.parts), 1)
        beyond = (self.residual**2).sum(axis=0) / spare - known
        return np.asarray(np.sqrt(np.maximum(beyond, 0.0)))

    def sizes(self, trend: Trend) -> Iterator[tuple[Part, Floats, Floats]]:
        """Each step, or drift, with its sizes or rates (q,) and their covariance (q, q)."""
        start = len(self.scatter) + self.data.shared.shape[2]
        for part in self.parts:
            slot = slice(start, start := start + len(part.subset))
            span = self.data.span if trend is Trend.DRIFTING else 1.0
            unit = self.data.unit[list(part.subset)] / span
            if part.trend is trend:
                spread = np.outer(unit, unit) * self.covariance[slot, slot]
                yield part, unit * self.mean[slot], spread

    def state(
        self, at: int, later: float = 0.0, measured: bool = False, more: int = 0
    ) -> tuple[Floats, Floats]:
        """Mean (p,) and covariance (p, p) of the parameters at a session, or so much later.

        As a session measures them if `measured`; or after so many `more` sessions.
        """
        data, covariance, width = self.data, self.covariance, len(self.scatter)
        columns = data.columns(self.parts, later)[at]
        spread = np.median(self.spread, axis=0)
        if more:
            gained = more * columns.T @ np.linalg.solve(spread, columns)
            covariance = np.linalg.inv(np.linalg.inv(covariance) + gained)
        columns[:, width : width + data.shared.shape[2]] *= measured
        return columns @ self.mean, columns @ covariance @ columns.T + spread * measured


def _fit(data: DatedValues, acting: Trends) -> tuple[float, TrendFit]:
    """Best parts of these trends, free in size; log weight over all that they may be."""
    scatter = np.zeros(len(data.unit))
    tried, rounds = [scatter], 1
    if Trend.SCATTERING in acting:
        shares = data.unit, *np.diag(data.unit)
        # Twice, because other parts fit with the likeliest scatter.
        tried, rounds = [size * share for share in shares for size in SPREADS], 2
    for _ in range(rounds):
        parts = _search(data, acting, scatter)
        fits = [TrendFit(data, parts, size) for size in tried]
        best = max(fits, key=lambda fit: fit.log_evidence)
        scatter = best.scatter
    log = log_mean(np.array([fit.log_evidence for fit in fits]))
    for part in parts:
        # The chosen one stands for all that the other parts leave open.
        others = TrendFit(data, [other for other in parts if other is not part], scatter)
        log += others.one_more(part.trend)[0] + others.log_evidence - best.log_evidence
    log += sum(math.log(p if trend in acting else 1.0 - p) for trend, p in PRIOR.items())
    steps = sum(part.trend is Trend.CHANGED for part in parts)
    # Steps between the same two sessions are one, of all parameters that change there.
    moved: dict[tuple[Trend, int], set[int]] = {}
    for part in sorted(parts, key=lambda part: part.at):
        moved.setdefault((part.trend, part.at), set()).update(part.subset)
    free = [Part(*place, tuple(sorted(subset)), FREE) for place, subset in moved.items()]
    return log + max(steps - 1, 0) * LOG_FURTHER, TrendFit(data, free, scatter)


def _search(data: DatedValues, acting: Trends, scatter: Floats) -> list[Part]:
    """The best step and drift, and further steps as long as they are likelier than not."""
    parts: list[Part] = []
    for trend in (trend for trend in acting if trend in data.courses):
        parts.append(TrendFit(data, parts, scatter).one_more(trend)[1])
    while parts and Trend.CHANGED in acting:
        for number, part in enumerate(parts):
            others = TrendFit(data, parts[:number] + parts[number + 1 :], scatter)
            parts[number] = others.one_more(part.trend)[1]
        log, more = TrendFit(data, parts, scatter).one_more(Trend.CHANGED)
        if log + LOG_FURTHER < 0.0 or len(parts) >= MOST_STEPS:
            break
        parts.append(more)
    return parts


def decide_trends(data: DatedValues) -> tuple[Trend, float, Trends, Trends, TrendFit]:
    """The verdict with its probability, its rivals, trends that act as well, and the best fit."""
    sets = (acting for size in range(3) for acting in combinations(PRIOR, size))
    possible = [acting for acting in sets if len(acting) < len(data.values)]
    # Log weights, and fits without priors.
    weighed = {acting or (Trend.UNCHANGED,): _fit(data, acting) for acting in possible}
    belief = probabilities({trends: log for trends, (log, _) in weighed.items()})
    share = {trend: sum(p for trends, p in belief.items() if trends[0] is trend) for trend in Trend}
    verdict, rivals = state(share, Trend.UNCHANGED, MISSED_CHANGE, WRONG_STORY)
    if len(data.values) == 2 and verdict is not Trend.UNCHANGED:
        # Two sessions do not distinguish a step from a drift or scatter.
        rivals = tuple(trend for trend in (verdict, *rivals) if trend is not Trend.CHANGED)
        verdict = Trend.CHANGED
    _, *others = best = next(trends for trends in belief if trends[0] is verdict)
    absent = (sum(p for trends, p in belief.items() if one not in trends) for one in others)
    also = tuple(one for one, p in zip(others, absent, strict=True) if is_dismissed(p, WRONG_STORY))
    return verdict, min(share[verdict], 1.0), rivals, also, weighed[best][1]
