"""The next reading: what can be done, ranked by what it decides and determines for the time.

If explanation h is true, new readings y change its log odds over a rival r by

    ln p(y | h) − ln p(y | r),   y ~ N(m_h, S_h) expected by h,  N(m_r, S_r) by r,

from the posterior of each. Its mean is the Kullback–Leibler divergence of the two, its variance
½ tr (A − 1)² + |b|² with A = S_h^½ S_r⁻¹ S_h^½, b = S_h^½ S_r⁻¹ (m_h − m_r). The rival is dismissed
where the odds then pass the diagnosis' own bound.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from orthoglide_cal.diagnosis import Diagnosis, Verdict
from orthoglide_cal.diagnosis.assess import bound
from orthoglide_cal.diagnosis.candidates import Ids
from orthoglide_cal.diagnosis.fit import Fitted
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.estimation.budget import Contribution
from orthoglide_cal.estimation.influences import influences
from orthoglide_cal.model import (
    Floats,
    GaugePlan,
    Model,
    Readings,
    freeze,
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
# An option that settles the name with this chance needs no second attempt.
SETTLES = 0.95
# What an attempt costs beside its readings: stands fetched, the machine stopped and warmed up once
# more, a diagnosis [min].
MINUTES_PER_ATTEMPT = 30.0
# So many explanations are looked at, the likeliest.
MOST = 8
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Next:
    """An option and what it is worth.

    Attributes:
        option: what to do.
        separates: of the two likeliest explanations that it tells apart, the causes that the other
            lacks, or all if one has no more; None if nothing is open that it could tell.
        separation_sigma: expected distance between their predictions; 0 without them [standard
            deviations].
        chance: that it leaves one name, of all that can be told apart at all; 0 without them.
        expanded_mm: expanded uncertainty of the offsets that `solve` is expected to print of all
            readings together, shape (3,).
    """

    option: Option
    separates: tuple[Ids, Ids] | None
    separation_sigma: float
    chance: float
    expanded_mm: Floats

    def __post_init__(self) -> None:
        freeze(self, "expanded_mm")


def ranked(diagnosis: Diagnosis) -> tuple[Next, ...]:
    """All that can be done next, best first.

    First what settles the name almost surely, the quickest first; then by the chance that it does
    per minute. Where nothing is open, by how much it takes off the offsets' uncertainty per minute.
    """
    model, measured = diagnosis.model, diagnosis.measured
    first = measured.plan if isinstance(measured, Readings) else None
    choice = beyond(first, model) or options(first, model.machine)
    likeliest = sorted(diagnosis.by_place, key=lambda each: -each[0])[:MOST]
    shares = np.array([share for share, _ in likeliest])
    fits = [fit for _, fit in likeliest]
    seen = outlooks(model, first, choice, fits)
    apart = np.stack([_apart(each) for each in seen])
    names = [frozenset(_ids(fit)) for fit in fits]
    told = np.array([[one != other for other in names] for one in names])
    told &= (apart.max(axis=0) >= WORTHLESS_SIGMA) & (diagnosis.verdict is Verdict.AMBIGUOUS)
    spare = _spare(shares, fits)
    total = sum(share for share, _ in diagnosis.left_open)
    within_now = sum(share * fit.joint_covariance() for share, fit in diagnosis.left_open) / total
    between = diagnosis.covariance_mm2 - within_now
    found = []
    for option, each, sigma in zip(choice, seen, apart, strict=True):
        chance = _chance(each, shares, spare, told)
        pair = _pair(told, sigma)
        within = np.tensordot(shares / shares.sum(), each.offsets, axes=1)
        variance = np.diag(within + (1.0 - chance) * between)
        reach = half_width(np.inf) * np.sqrt(np.maximum(variance, 0.0))
        if first is not None and diagnosis.verdict is Verdict.NAMED:
            reach = _as_entered(model, joined(first, option.plan), fits[0], reach)
        found.append(
            Next(
                option,
                None if pair is None else _names(fits[pair[0]], fits[pair[1]]),
                0.0 if pair is None else float(sigma[pair]),
                chance,
                reach,
            )
        )
    now = half_width(np.inf) * diagnosis.std_mm
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
    gained = -float(np.max(now) - np.max(each.expanded_mm)) / (minutes + MINUTES_PER_ATTEMPT)
    if not telling:
        return (gained,)
    if each.chance >= SETTLES:
        return 0.0, minutes, gained
    return 1.0, -each.chance / (minutes + MINUTES_PER_ATTEMPT), gained


def _apart(seen: Outlook) -> Floats:
    """Distances between all expectations, shape (f, f) [standard deviations]."""
    gap = seen.mean[:, None] - seen.mean
    covariance = 0.5 * (seen.covariance[:, None] + seen.covariance)
    solved = np.linalg.solve(covariance, gap[..., None])[..., 0]
    return np.asarray(np.sqrt((gap * solved).sum(axis=-1)))


def _spare(shares: Floats, fits: Sequence[Fitted]) -> Floats:
    """ln of how far below its bound a rival (second index) is beside the true one, shape (f, f).

    A rival that may be at several places keeps at each its part of what its name may keep.
    """
    ids = [_ids(fit) for fit in fits]
    places = Counter(ids)
    bounds = np.array([[bound(other, true) / places[other] for other in ids] for true in ids])
    return np.asarray(np.log(shares[:, None] / shares * bounds))


def _chance(seen: Outlook, shares: Floats, spare: Floats, told: Bools) -> float:
    """Chance that new readings dismiss all rivals of the true explanation that can be told."""
    covariance, gap = seen.covariance, seen.mean[:, None] - seen.mean
    precision = np.linalg.inv(covariance)
    log_det = np.linalg.slogdet(covariance)[1]
    mixed = precision @ covariance[:, None]  # S_r⁻¹ S_h, like A, shape (f, f, r, r)
    weighed = (precision @ gap[..., None])[..., 0]
    trace = np.trace(mixed, axis1=-2, axis2=-1) - gap.shape[-1]
    mean = 0.5 * (trace + (gap * weighed).sum(axis=-1) + log_det - log_det[:, None])
    square = (mixed * mixed.swapaxes(-1, -2)).sum(axis=(-1, -2)) - 2.0 * trace - gap.shape[-1]
    spread = (weighed * (covariance[:, None] @ weighed[..., None])[..., 0]).sum(axis=-1)
    deviation = np.sqrt(np.maximum(0.5 * square + spread, TINY))
    dismissed = np.where(told, ndtr((spare + mean) / deviation), 1.0).min(axis=1)
    asked = shares * told.any(axis=1)
    return float(asked @ dismissed / asked.sum()) if asked.any() else 0.0


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


def _pair(told: Bools, sigma: Floats) -> tuple[int, int] | None:
    """The likeliest explanation that has a rival which can be told, and its likeliest such rival.

    Explanations come in the order of their probability, the accepted one first.
    """
    pairs = [tuple(pair) for pair in np.argwhere(told).tolist() if pair[0] < pair[1]]
    able = [pair for pair in pairs if sigma[pair] >= WORTHLESS_SIGMA]
    if not pairs:
        return None
    first, second = (able or pairs)[0]
    return first, second


def _names(first: Fitted, second: Fitted) -> tuple[Ids, Ids]:
    """Of two explanations the causes that the other lacks; all where one adds to the other."""
    one, other = _ids(first), _ids(second)
    only = (
        tuple(id for id in one if id not in other),
        tuple(id for id in other if id not in one),
    )
    return (one, other) if () in only else only


def _ids(fit: Fitted) -> Ids:
    return tuple(effect.cause.id for effect in fit.effects)
