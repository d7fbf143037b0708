"""Readings of any plan as explanations have them, later ones and those to come.

New readings are looked at in combinations that no new gauge zero enters and whose noise is
independent of that of the first readings: in a new set-up their deviations from its mean, in one
that goes on from the mean of what was read there. Of these only the few in which the explanations
can differ count.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, ndtr

from orthoglide_cal.causes import UNLISTED
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import Mixture, root_of, unexplained, whiten, whiten_shared
from orthoglide_cal.estimation.losses import MISSED_CHANGE, WRONG_STORY, surprising
from orthoglide_cal.estimation.methods import fit_offsets
from orthoglide_cal.inference.data import UNSEEN, Whitened, as_read
from orthoglide_cal.inference.fit import ENOUGH, Fit, HeldOut, left_out
from orthoglide_cal.model.contrasts import without_zeros
from orthoglide_cal.model.machine import Machine, Origin
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.plan import Floats, Ints, Plan, joined

# The origin of the endstops has moved where nothing but chance gives as much this seldom.
MOVED = surprising(UNLISTED / (1.0 - UNLISTED), MISSED_CHANGE, WRONG_STORY)

# Powers of x and y, in addition to what the calibrated parameters do.
QUARTIC = tuple((i, k - i) for k in (2, 3, 4) for i in range(k + 1))
TINY = 1e-30  # mm²
# Correlation from which maps of two dates are no noise; a definition: what repeats then has four
# times the variance, twice the size, of what does not.
REPEATS = 0.8

# What a fit says of readings: their mean (n,), their derivatives by the p parameters (n, p), and a
# root (n + p, u) of the covariance of them and of the parameters, without noise.
Expected = tuple[Floats, Floats, Floats]


def expect(fit: Fit, model: Model, plan: Plan, stay: Plan | None = None) -> Expected:
    """Readings of a plan as a fit to the first ones has them.

    What belongs to the set-up goes on only where the set-up does, a step of estimated size with its
    uncertainty; `stay` are the first readings if their stands are still there.
    """
    width = fit.offsets.size
    going_on = () if stay is None else fit.effects
    sized = [e for e in fit.effects if e.cause.lasting or (going_on and e.covariance is not None)]
    passing = [effect for effect in going_on if effect not in sized]
    model, plan = model.extended(passing), as_read(plan, passing)
    mean, slopes = differentiate(model, fit.offsets, plan, sized)
    slots = [slice(width), *(fit.slots[fit.effects.index(effect)] for effect in sized)]
    columns, fresh = [slopes], [slopes[:, :0]]
    widths = (influence.columns.shape[1] for influence in fit.uncertain)
    ends = fit.first_uncertain + np.cumsum([0, *widths])
    sources = (influence.source for influence in fit.uncertain)
    spans = dict(zip(sources, pairwise(ends.tolist()), strict=True))
    named = {effect.cause.id for effect in sized}
    for after in influences(model, fit.offsets, plan):
        if after.source in named:
            continue
        # What did not act on the first data is as uncertain as it was.
        start, end = spans.get(after.source, (0, 0))
        if after.local:
            # At other places another shape; at the same one more than it takes.
            fresh.append(fit.sizes[start:end].max(initial=0.0) * after.columns)
            continue
        known = end - start
        if after.source == Origin.GAUGE_PLACEMENT:
            known = 0 if stay is None else stay.setups  # before those that are new
        slots.append(slice(start, start + known))
        columns.append(after.columns[:, :known])
        fresh.append(after.columns[:, known:])
    chosen = np.r_[tuple(slots)]
    new = np.hstack(fresh)
    joint = np.eye(len(chosen) + new.shape[1])
    joint[: len(chosen), : len(chosen)] = fit.covariance[np.ix_(chosen, chosen)]
    root = root_of(joint)
    return mean, slopes[:, :width], np.vstack((np.hstack((*columns, new)) @ root, root[:width]))


def predict_later(
    later: Whitened, fit: Fit, applied: Floats, free: int = 0, before: Machine | None = None
) -> HeldOut:
    """Predict readings taken after the controller was corrected.

    The offsets that remain are those found minus those applied; causes of the contact and the
    record that belong to the first session alone are not expected again.

    Args:
        later, fit: the held-out data, and a fit to the first data only.
        applied: offsets entered in between, shape (3,) [mm].
        free: so many of the parameters, the first ones, are unknown again and fitted to the later
            data; nothing else is. All of them where the machine was calibrated again.
        before: the machine of the first data; None for the same as later.
    """
    error, jacobian, shared = _errors(later, fit, applied, free, before)
    jacobian = jacobian[:, :free]
    white, by_parameter = whiten_shared(*(one / fit.sigma for one in (shared, error, jacobian)))
    # What a fit to these errors leaves, of as many as it leaves free.
    error, white = unexplained(jacobian, error), unexplained(by_parameter, white)
    ratio = rms(white) * math.sqrt(error.size / max(error.size - free, 1))
    return HeldOut(rms(error if later.root is None else later.root @ error), ratio)


def chance_of_worse(
    later: Whitened, fit: Fit, alone: Fit, applied: Floats, free: int, before: Machine
) -> float:
    """Chance that a fit predicts later data that much worse than one without its causes.

    If it is right. The later data hold b times what it adds to their prediction, of which it says
    1 ± its statement, and the fit `alone` 0: it is worse where b < 1/2, else the chance is 1.
    Other arguments as of `predict_later`.
    """
    error, jacobian, shared = _errors(later, fit, applied, free, before)
    added = _errors(later, alone, applied, free, before)[0] - error
    values = (value / fit.sigma for value in (shared, error, added, jacobian[:, :free]))
    *pair, by_parameter = whiten_shared(*values)
    left, adds = unexplained(by_parameter, np.column_stack(pair)).T
    size = float(np.linalg.norm(adds))
    excess = float(left @ adds)  # (b − 1) size²
    return float(ndtr(excess / size)) if excess < -0.5 * size**2 < 0.0 else 1.0


def moved_origin(later: Whitened, fit: Fit, applied: Floats) -> Floats | None:
    """By how much the parameters that homing sets differ from what is expected later, (h,) [mm].

    None where nothing says that they do. Arguments as of `predict_later`.
    """
    homed = later.machine.homed
    error, jacobian, shared = (part / fit.sigma for part in _errors(later, fit, applied))
    error, by_origin = whiten_shared(shared, error, jacobian[:, :homed])
    left = unexplained(by_origin, error)
    if not homed or chdtrc(homed, float(error @ error - left @ left)) > MOVED:
        return None
    return np.asarray(np.linalg.lstsq(by_origin, error)[0])


def _errors(
    later: Whitened, fit: Fit, applied: Floats, free: int = 0, before: Machine | None = None
) -> tuple[Floats, Floats, Floats]:
    """Errors (k,) of predicting later data, their derivatives by the parameters, (k, 3), and what
    of them is uncertain in common, (k, u), all in mm. Arguments as of `predict_later`.
    """
    machine, problem = later.machine, later.problem
    effects = tuple(effect.transferred(before or machine, machine) for effect in fit.effects)
    offsets = fit.offsets - applied
    if free == offsets.size:
        lasting = [effect for effect in effects if effect.cause.lasting]
        extended = replace(problem, model=problem.model.extended(lasting))
        offsets = fit_offsets(extended, later.data).offsets_mm
    then = replace(fit, start=offsets - fit.moved[: offsets.size], effects=effects)
    mean, slopes, root = expect(then, problem.model, later.plan)
    jacobian, (spread, known) = later.matrix @ slopes, np.split(root, [len(mean)])
    shared = later.matrix @ spread - jacobian[:, :free] @ known[:free]
    return later.data - later.matrix @ mean, jacobian, shared


def predict(
    weighted: Sequence[tuple[float, Fit]],
    expected: Sequence[Expected],
    start: int,
    plan: Plan,
    stay: Plan | None,
) -> Mixture:
    """Combinations of the readings of a plan, and the parameters behind them.

    Args:
        weighted: the explanations and their probabilities.
        expected: of each; the readings of the plan begin at `start` in it.
        plan, stay: the new readings, and the first ones if their stands are still there.
    """
    new, fits = slice(start, start + len(plan)), [fit for _, fit in weighted]

    def free(values: Floats) -> Floats:
        """Values (n, c) in combinations without zeros, with unit noise, shape (m, c)."""
        if stay is None:
            set_ups = plan.subset(np.arange(len(plan)))  # numbered from 0
            return without_zeros(set_ups, values[new].T).T
        zeros = joined(stay, plan).zeros
        same = zeros[len(stay) :] @ zeros[: len(stay)].T
        mean = same / same.sum(axis=1, keepdims=True)
        noise = np.eye(len(mean)) + mean @ mean.T
        return whiten(noise, values[new] - mean @ values[: len(stay)])[0]

    means = free(np.column_stack([mean for mean, _, _ in expected]))
    roots = [free(root) for _, _, root in expected]
    columns = np.hstack((means[:, 1:] - means[:, :1], *roots))
    # An orthonormal basis of the directions that exceed the noise, shape (m, r).
    m, c = columns.shape
    size2, vectors = np.linalg.eigh(columns @ columns.T if m <= c else columns.T @ columns)
    kept = size2 > (UNSEEN * min(fit.sigma for fit in fits)) ** 2
    basis = vectors[:, kept] if m <= c else columns @ (vectors[:, kept] / np.sqrt(size2[kept]))
    noise = np.repeat((1.0, 0.0), (basis.shape[1], fits[0].offsets.size))
    both = [
        np.vstack((basis.T @ spread, root[len(mean) :]))
        for spread, (mean, _, root) in zip(roots, expected, strict=True)
    ]
    return Mixture(
        np.hstack(((basis.T @ means).T, np.stack([fit.offsets for fit in fits])))[..., None],
        np.stack([
            root @ root.T + fit.sigma**2 * np.diag(noise)
            for root, fit in zip(both, fits, strict=True)
        ]),
        np.log([[share] for share, _ in weighted]),
    )  # fmt: skip


# --- by what needs no cause: an extension that predicts no better has shown nothing ------------


def baselines(
    white: Whitened, later: Whitened | None, entered: Floats, free: int
) -> dict[str, float]:
    """`quartic_mm` and `earlier_map_mm` of the touches of a printer, all alike, where known.

    Args:
        white: the data.
        later: other touches, to be predicted; None predicts each patch of the bed from the others.
        entered: taken off the parameters in between, shape (6,) [mm, deg].
        free: so many of the parameters, the first ones, are fitted to the later data.
    """
    offsets = fit_offsets(white.problem, white.data).offsets_mm
    place, left, jacobian, _ = _touches(white, offsets)
    touch = white.plan.touches
    columns = np.hstack((jacobian, white.plan.zeros[touch], _surface(white, place)))
    enough = len(left) > np.linalg.matrix_rank(columns) == columns.shape[1]
    if later is None:
        errors, number = [], np.cumsum(touch) - 1
        for patch in (patch for patches in left_out(white) for patch in patches):
            omitted = number[patch[touch[patch]]]
            rest = np.setdiff1d(np.arange(len(left)), omitted)
            if omitted.size and enough:
                terms = np.linalg.lstsq(columns[rest], left[rest])[0]
                errors.append(left[omitted] - columns[omitted] @ terms)
        return {"quartic_mm": rms(np.concatenate(errors))} if errors else {}
    anew = free == offsets.size
    there, error, then, _ = _touches(later, None if anew else offsets - entered)
    mapped = unexplained(then[:, :free], error - _interpolated(place, left, there))
    held = {"earlier_map_mm": rms(mapped)}
    if enough:
        terms = np.linalg.lstsq(columns, left)[0]
        fixed = terms[: jacobian.shape[1]] * (np.arange(jacobian.shape[1]) >= free)
        predicted = then @ fixed + _surface(white, there) @ terms[-len(QUARTIC) :]
        held["quartic_mm"] = rms(unexplained(then[:, :free], error - predicted))
    return held


def repeats(white: Whitened, later: Whitened | None = None) -> float | None:
    """Correlation of the residual maps of two dates, of more the smallest.

    What calibrated parameters leave of the touches of each date; None for few, or of one date.
    """
    maps = [
        (place[dated], left[dated], jacobian[dated])
        for white_data in (white, later)
        if white_data is not None and white_data.plan.touches.any()
        for place, left, jacobian, date in (_touches(white_data),)
        for day in np.unique(date)
        for dated in (date == day,)
    ]
    correlations = []
    for (place, left, _), (there, after, then) in pairwise(maps):
        if min(len(left), len(after)) < ENOUGH * then.shape[1]:
            return None
        both = unexplained(then, np.stack((_interpolated(place, left, there), after), axis=1))
        size = np.sqrt(np.prod((both**2).sum(axis=0)))
        correlations.append(float(np.prod(both, axis=1).sum() / max(size, TINY)))
    return min(correlations, default=None)


def _touches(white: Whitened, offsets: Floats | None = None) -> tuple[Floats, Floats, Floats, Ints]:
    """Places (n, 2), what parameters leave of the touches there (n,), derivatives (n, 6), dates.

    The parameters are those that fit best if None.
    """
    plan = white.plan
    if offsets is None:
        offsets = fit_offsets(white.problem, white.data).offsets_mm
    readings, jacobian = differentiate(white.problem.model, offsets, plan)
    left = white.plain(white.data) / plan.precision - readings
    touch = plan.touches
    return plan.spots[touch, :2], left[touch], jacobian[touch], plan.date[touch]


def _surface(white: Whitened, place: Floats) -> Floats:
    """Terms of a quartic surface at places (n, 2), shape (n, 12)."""
    x, y = (place / np.abs(white.plan.spots[:, :2]).max()).T
    return np.stack([x**across * y**along for across, along in QUARTIC], axis=1)


def _interpolated(place: Floats, value: Floats, there: Floats) -> Floats:
    """Values (n,) of places (n, 2), between them; outside that of the nearest, shape (m,)."""
    from scipy.interpolate import griddata

    nearest = griddata(place, value, there, "nearest")
    between = griddata(place, value, there, "linear") if len(place) > 3 else nearest
    return np.where(np.isnan(between), nearest, between)
