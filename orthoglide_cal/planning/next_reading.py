"""The next reading: what can be done, ranked by what it decides and determines for the time.

If explanation h is true, new readings y change its log odds over a rival r by

    ln p(y | h) − ln p(y | r),   y ~ N(m_h, S_h) expected by h,  N(m_r, S_r) by r,

from the posterior of each. Its mean is the Kullback–Leibler divergence of the two, its variance
½ tr (A − 1)² + |b|² with A = S_h^½ S_r⁻¹ S_h^½, b = S_h^½ S_r⁻¹ (m_h − m_r). The rival is dismissed
where the odds then pass the diagnosis' own bound.

Readings that cannot be solved together with the first ones are judged alone: y is as the posterior
of h has it, but p(y | r) and p(y | h) are N(μ, P), of causes that may have any plausible size. With
D = P_r⁻¹ − P_h⁻¹ and b = P_r⁻¹ (m_h − μ_r) − P_h⁻¹ (m_h − μ_h) the variance is ½ tr (D S_h)² +
bᵀ S_h b.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from operator import ne
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from orthoglide_cal.diagnosis import Diagnosis, Verdict
from orthoglide_cal.diagnosis.assess import bound
from orthoglide_cal.diagnosis.candidates import Ids
from orthoglide_cal.diagnosis.fit import Fitted
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.estimation.budget import Contribution
from orthoglide_cal.estimation.influences import held, influences
from orthoglide_cal.model import (
    Floats,
    GaugePlan,
    Model,
    Plan,
    Readings,
    ReadOnly,
    simulate,
    simulate_with_jacobian,
    without_zeros,
)
from orthoglide_cal.model.influence import Origin
from orthoglide_cal.model.plan import Bools
from orthoglide_cal.planning.expected import estimator_for
from orthoglide_cal.planning.options import Option, beyond, joined, options
from orthoglide_cal.planning.outlook import Outlook, outlooks

# Explanations nearer than this to each other under every option cannot be told apart [σ].
WORTHLESS_SIGMA = 1.0
# Where no option has such a chance to leave one answer, none is worth its time: what is likeliest
# cannot be told from its rival, whatever else can be.
WORTH_TRYING = 0.1
# What a sitting costs beside its readings: stands fetched, the machine stopped and warmed up [min].
MINUTES_PER_SITTING = 30.0
# What one costs that leaves the answer open: coming back another day, a shift later [min].
MINUTES_TO_COME_BACK = 480.0
# So many explanations are looked at, the likeliest.
MOST = 8
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Next(ReadOnly):
    """An option and what it is worth.

    Attributes:
        option: what to do.
        separates: of the two likeliest explanations that it tells apart, the causes that the other
            lacks, or all if one has no more; None if nothing is open that readings tell.
        separation_sigma: expected distance between their predictions; 0 without them [standard
            deviations].
        chance: that it leaves one answer; 0 without them.
        expanded_mm: expanded uncertainty of the offsets that `solve` is expected to print of all
            readings together, or of a session of its own alone, shape (3,).
    """

    option: Option
    separates: tuple[Ids, Ids] | None
    separation_sigma: float
    chance: float
    expanded_mm: Floats


# `plan FILE` asks for all, and so does the calibration that it shows beside.
@functools.lru_cache(maxsize=1)
def ranked(diagnosis: Diagnosis) -> tuple[Next, ...]:
    """All that can be done next, best first.

    Beside differences and readings along a leg, which no others can be solved together with, these
    are sessions of their own.

    By the chance that one answer is left, per minute, with what coming back would take. Where
    nothing is open that readings tell, by how much it takes off the offsets' U per minute.
    """
    model, measured = diagnosis.model, diagnosis.measured
    plan = measured.plan if isinstance(measured, Readings) else None
    choice = beyond(plan, model)
    first = plan if choice or (plan is not None and plan.fixed) else None
    choice = choice or options(first, model.machine)
    likeliest = sorted(diagnosis.by_place, key=lambda each: -each[0])[:MOST]
    shares = np.array([share for share, _ in likeliest])
    fits = [fit for _, fit in likeliest]
    ids = [_ids(fit, again=first is None) for fit in fits]
    others = _others(fits, ids) & (diagnosis.verdict is Verdict.AMBIGUOUS)
    if first is not None:
        seen, known = outlooks(model, first, choice, fits), shares
        judged = seen
    else:
        both = outlooks(model, first, choice, [*fits, *(fit.unread for fit in fits)])
        halves = [each.halves() for each in both]
        seen, judged = [one for one, _ in halves], [two for _, two in halves]
        known = np.ones_like(shares)
    odds = [_odds(*pair) for pair in zip(seen, judged, strict=True)]
    distances = map(_apart, seen) if first is not None else (each.apart for each in odds)
    apart = np.stack(list(distances))
    spare = _spare(known, ids)
    chances = np.array([_chance(each, shares, spare, others) for each in odds])
    told = others & (apart.max(axis=0) >= WORTHLESS_SIGMA) & (chances.max() >= WORTH_TRYING)
    chances *= told.any()
    total = sum(share for share, _ in diagnosis.left_open)
    within_now = sum(share * fit.joint_covariance() for share, fit in diagnosis.left_open) / total
    between = diagnosis.covariance_mm2 - within_now
    found = []
    for option, each, sigma, chance in zip(choice, judged, apart, chances.tolist(), strict=True):
        pair = _pair(told, sigma, ids)
        within = np.tensordot(shares / shares.sum(), each.offsets, axes=1)
        variance = np.diag(within + (1.0 - chance) * between)
        whole = option.plan if first is None else joined(first, option.plan)
        variance = variance + _given(model, whole, fits[0])
        reach = half_width(np.inf) * np.sqrt(np.maximum(variance, 0.0))
        if first is not None and diagnosis.verdict is Verdict.NAMED:
            reach = _as_entered(model, joined(first, option.plan), fits[0], reach)
        found.append(
            Next(
                option,
                None if pair is None else _names(ids[pair[0]], ids[pair[1]]),
                0.0 if pair is None else float(sigma[pair]),
                chance,
                reach,
            )
        )
    taken = 0.0 if first is None else _given(model, first, fits[0])
    now = half_width(np.inf) * np.sqrt(np.diag(diagnosis.covariance_mm2) + taken)
    return tuple(sorted(found, key=lambda each: _rank(each, now, bool(told.any()))))


def best_next(diagnosis: Diagnosis) -> Next | None:
    """What tells apart the explanations that are left open; None if nothing is, or can be."""
    if diagnosis.verdict is not Verdict.AMBIGUOUS:
        return None
    first = ranked(diagnosis)[0]
    return first if first.separates is not None else None


def _rank(each: Next, now: Floats, telling: bool) -> tuple[float, ...]:
    """What to sort by, the smallest first."""
    minutes = each.option.minutes
    gained = -float(np.max(now) - np.max(each.expanded_mm)) / (minutes + MINUTES_PER_SITTING)
    if not telling:
        return (gained,)
    return -each.chance / (minutes + MINUTES_TO_COME_BACK), gained


def _apart(seen: Outlook) -> Floats:
    """Distances between all expectations, shape (f, f) [standard deviations]."""
    gap = seen.mean[:, None] - seen.mean
    covariance = 0.5 * (seen.covariance[:, None] + seen.covariance)
    solved = np.linalg.solve(covariance, gap[..., None])[..., 0]
    return np.asarray(np.sqrt((gap * solved).sum(axis=-1)))


def _spare(shares: Floats, ids: Sequence[Ids]) -> Floats:
    """ln of how far below its bound a rival (second index) is beside the true one, shape (f, f).

    A rival that may be at several places keeps at each its part of what its name may keep.
    """
    places = Counter(ids)
    bounds = np.array([[bound(other, true) / places[other] for other in ids] for true in ids])
    return np.asarray(np.log(shares[:, None] / shares * bounds))


def _others(fits: Sequence[Fitted], ids: Sequence[Ids]) -> Bools:
    """Whether two explanations are different answers: other causes, another remedy, (f, f)."""
    answers = [(frozenset(own), fit.remedy) for fit, own in zip(fits, ids, strict=True)]
    return np.array(
        [[all(map(ne, one, other)) for other in answers] for one in answers], dtype=np.bool_
    )


class _Odds(NamedTuple):
    """By how much new readings raise the log odds of the true explanation over a rival.

    Attributes:
        mean, deviation: shape (f, f); the true one first.
    """

    mean: Floats
    deviation: Floats

    @property
    def apart(self) -> Floats:
        """Distances that change the log odds by as much, shape (f, f) [standard deviations]."""
        return np.sqrt(np.maximum(self.mean + self.mean.T, 0.0))


def _odds(seen: Outlook, judged: Outlook) -> _Odds:
    """Of readings as f explanations have them, judged by what is known of these."""
    covariance, gap = seen.covariance[:, None], seen.mean[:, None] - judged.mean
    precision = np.linalg.inv(judged.covariance)
    weighed = (precision @ gap[..., None])[..., 0]
    each = np.arange(len(gap))
    cost = np.trace(precision @ covariance, axis1=-2, axis2=-1) + (gap * weighed).sum(axis=-1)
    cost += np.linalg.slogdet(judged.covariance)[1]
    other = (precision - precision[:, None]) @ covariance
    square = (other * other.swapaxes(-1, -2)).sum(axis=(-1, -2))
    slope = weighed - weighed[each, each][:, None]
    spread = (slope * (covariance @ slope[..., None])[..., 0]).sum(axis=-1)
    mean = 0.5 * (cost - cost[each, each][:, None])
    return _Odds(mean, np.sqrt(np.maximum(0.5 * square + spread, TINY)))


def _chance(odds: _Odds, shares: Floats, spare: Floats, others: Bools) -> float:
    """Chance that new readings dismiss all other answers than the true explanation."""
    if not others.any():
        return 0.0
    dismissed = np.where(others, ndtr((spare + odds.mean) / odds.deviation), 1.0).min(axis=1)
    return float(shares @ dismissed / shares.sum())


def _as_entered(model: Model, plan: GaugePlan, fit: Fitted, reach: Floats) -> Floats:
    """U (3,) [mm] of the offsets that are entered where causes are named.

    Causes that move them by less than their own uncertainty do not bar the offsets alone, and are
    then a part of it.

    Args:
        model: the machine.
        plan: of all readings.
        fit: of the named causes.
        reach: U of the offsets beside those causes, shape (3,) [mm].
    """
    if any(effect.covariance is None for effect in fit.effects):
        return reach  # exchanged labels or signs spoil the offsets altogether
    moved = simulate(model.extended(fit.effects), fit.offsets, plan)
    plain, slope = simulate_with_jacobian(model, fit.offsets, plan)
    estimator = estimator_for(model, plan, influences(model, fit.offsets, plan))
    shift = estimator @ (moved - plain)
    if np.any(np.abs(shift) > reach):
        return reach
    # What the offsets cannot take up of it looks like scatter.
    left = without_zeros(plan, moved - plain - slope @ shift)
    dof = len(plan) - plan.setups - len(shift)
    scatter = left @ left / dof * estimator @ estimator.T
    beyond = Contribution.beyond(Origin.EXPLANATIONS, np.outer(shift, shift) - scatter)
    more = np.diag(scatter + beyond.covariance_mm2)
    return np.asarray(np.sqrt(reach**2 + half_width(np.inf) ** 2 * more))


def _given(model: Model, plan: Plan, answer: Fitted) -> Floats:
    """What adds to the variance of each parameter that is taken as the controller has it, (p,).

    No reading tells it, so no diagnosis counts it either, unless it is the answer; `solve` does.
    """
    nominal = np.zeros(len(model.machine.parameter_names))
    taken = held(model, nominal, plan)
    columns = [each.columns for each in taken if each.source not in _ids(answer, again=False)]
    if not columns:
        return nominal
    estimator = estimator_for(model, plan, influences(model, nominal, plan))
    return np.asarray(((estimator @ np.hstack(columns)) ** 2).sum(axis=1))


def _pair(told: Bools, sigma: Floats, ids: Sequence[Ids]) -> tuple[int, int] | None:
    """The likeliest explanation that has a rival which can be told, and its likeliest such rival.

    Explanations come in the order of their probability, the accepted one first. A rival that is
    but a part of it is none that a diagnosis states, and comes behind all others.
    """
    pairs = [tuple(pair) for pair in np.argwhere(told).tolist() if pair[0] < pair[1]]
    pairs.sort(key=lambda pair: {*ids[pair[1]]} < {*ids[pair[0]]})
    able = [pair for pair in pairs if sigma[pair] >= WORTHLESS_SIGMA]
    if not pairs:
        return None
    first, second = (able or pairs)[0]
    return first, second


def _names(one: Ids, other: Ids) -> tuple[Ids, Ids]:
    """Of two explanations the causes that the other lacks; all where one adds to the other."""
    only = (
        tuple(id for id in one if id not in other),
        tuple(id for id in other if id not in one),
    )
    return (one, other) if () in only else only


def _ids(fit: Fitted, again: bool) -> Ids:
    """Its causes; if `again`, those that another session meets."""
    causes = (effect.cause for effect in fit.effects)
    return tuple(cause.id for cause in causes if cause.lasting or not again)
