"""Readings of any plan as explanations have them, later ones and those to come."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import ndtr

from orthoglide_cal.causes import UNLISTED
from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import root_of, unexplained, whiten_shared
from orthoglide_cal.estimation.solution import chance_of_residual, fit_offsets, rms
from orthoglide_cal.inference.data import Ids, Whitened, as_read
from orthoglide_cal.inference.fit import ENOUGH, MISFIT, Fit, HeldOut, left_out
from orthoglide_cal.inference.patterns import under_plan
from orthoglide_cal.losses import MISSED_CHANGE, WRONG_STORY, surprising
from orthoglide_cal.model.machine import Machine, Origin
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, ReadOnly
from orthoglide_cal.schema import Reason

# The origin of the endstops has moved where nothing but chance gives as much this seldom.
MOVED = surprising(UNLISTED / (1.0 - UNLISTED), MISSED_CHANGE, WRONG_STORY)

# Powers of x and y, in addition to what the calibrated parameters do.
QUARTIC = tuple((i, k - i) for k in (2, 3, 4) for i in range(k + 1))
TINY = 1e-30  # mm²
# Cosine of the angle between columns of a pattern beyond which they are the same.
ALIKE = 0.9
# Correlation from which maps of two dates are no noise; a definition: what repeats then has four
# times the variance, twice the size, of what does not.
REPEATS = 0.8

# What a fit says of readings: their mean (n,), their derivatives by the p parameters (n, p), and a
# root (n + p, u) of the covariance of them and of the parameters, without noise.
Expected = tuple[Floats, Floats, Floats]


def expect(
    fit: Fit, model: Model, plan: Plan, first: Plan | None = None, continues: bool = False
) -> Expected:
    """Readings of a plan as a fit to the first ones has them.

    What belongs to the set-up goes on only where the set-up does, a step of estimated size with its
    uncertainty. What no cause makes acts as in the first readings at their gauges and places, and
    by any plausible size at others. `first` are those, which the plan begins with; None if it does
    not, or they are not known. Their stands are still there if it `continues`.
    """
    width, stay = fit.offsets.size, first if continues else None
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
    end = fit.first_uncertain
    for pattern, shape in [*fit.patterns.items()][::-1]:
        if pattern.how == "scatters":
            continue
        then, before = under_plan(pattern, shape, plan, mean), shape.columns
        there = before[:, :0] if first is None else then[: len(before)]
        old, again = np.nonzero(_alike(before, there))
        end -= before.shape[1]
        slots.append(end + old)
        columns.append(then[:, again])
        mean = mean + then[:, again] @ fit.moved[end + old]
        fresh.append(shape.size * np.delete(then, again, axis=1))
    chosen, new = np.r_[tuple(slots)], np.hstack(fresh)
    root = root_of(fit.covariance[np.ix_(chosen, chosen)])
    readings = np.hstack((np.hstack(columns) @ root, new))
    parameters = np.hstack((root[:width], np.zeros((width, new.shape[1]))))
    return mean, slopes[:, :width], np.vstack((readings, parameters))


def _alike(before: Floats, after: Floats) -> Bools:
    """Match columns (n, q) of a pattern with those that it has then, (n, r); shape (q, r).

    The same but for what the movements of a plunger that are expected differ by.
    """
    sizes = np.outer(*(np.linalg.norm(one, axis=0) for one in (before, after)))
    likeness = np.abs(before.T @ after) / np.maximum(sizes, TINY)
    best = likeness == likeness.max(axis=1, initial=ALIKE, keepdims=True)
    return np.asarray(best, np.bool_)


@dataclass(frozen=True, eq=False)
class Later(ReadOnly):
    """Readings that no fit has seen, and what was done to the machine before they were taken.

    The offsets that remain are those found minus those entered; causes of the contact and the
    record that belong to the first session alone are not expected again.
    """

    white: Whitened
    before: Machine  # as it was for the first readings
    entered: Floats  # taken off the parameters in between, shape (p,) [mm]
    # So many of the parameters, the first ones, are unknown again and fitted to these readings;
    # nothing else is. All of them where the machine was calibrated again.
    free: int = 0

    def held_out(self, fit: Fit) -> HeldOut:
        """Errors of predicting these by a fit to the first readings."""
        error, jacobian, shared = self._errors(fit)
        jacobian = jacobian[:, : self.free]
        white, by_parameter = whiten_shared(*(one / fit.sigma for one in (shared, error, jacobian)))
        # What a fit to these errors leaves, of as many as it leaves free.
        error, white = unexplained(jacobian, error), unexplained(by_parameter, white)
        ratio = rms(white) * math.sqrt(error.size / max(error.size - self.free, 1))
        return HeldOut(rms(error if self.white.root is None else self.white.root @ error), ratio)

    def refute(self, ids: Ids, fit: Fit, alone: Fit) -> Reason | None:
        """Reason why they refute the causes of a fit, `alone` is one without; None if they do not.

        They hold b times what the causes add to their prediction, of which the fit says 1 ± its
        statement, and the other one 0: it is worse where b < 1/2, and refuted if that is rare.
        """
        error, jacobian, shared = self._errors(fit)
        added = self._errors(alone)[0] - error
        values = (value / fit.sigma for value in (shared, error, added, jacobian[:, : self.free]))
        *pair, by_parameter = whiten_shared(*values)
        left, adds = unexplained(by_parameter, np.column_stack(pair)).T
        size = float(np.linalg.norm(adds))
        excess = float(left @ adds)  # (b − 1) size²
        if not excess < -0.5 * size**2 < 0.0 or ndtr(excess / size) >= MISFIT:
            return None
        without_mm, with_mm = (self.held_out(one).rms_mm for one in (alone, fit))
        return Reason.of("refuted_later", ids=ids, without_mm=without_mm, with_mm=with_mm)

    def moved_origin(self, fit: Fit) -> Floats | None:
        """Unexpected change of the parameters that homing sets, (h,) [mm]; None if none shows."""
        homed = self.white.machine.homed
        error, jacobian, shared = (part / fit.sigma for part in self._errors(fit))
        error, by_origin = whiten_shared(shared, error, jacobian[:, :homed])
        left = unexplained(by_origin, error)
        if chance_of_residual(float(error @ error - left @ left), homed, 1.0) > MOVED:
            return None
        return np.asarray(np.linalg.lstsq(by_origin, error)[0])

    def _errors(self, fit: Fit) -> tuple[Floats, Floats, Floats]:
        """Errors (k,) of predicting them, their derivatives by the parameters, (k, 3), and what
        of them is uncertain in common, (k, u), all in mm.
        """
        white, problem, free = self.white, self.white.problem, self.free
        effects = tuple(effect.transferred(self.before, white.machine) for effect in fit.effects)
        offsets = fit.offsets - self.entered
        if free == offsets.size:
            lasting = [effect for effect in effects if effect.cause.lasting]
            extended = replace(problem, model=problem.model.extended(lasting))
            offsets = fit_offsets(extended, white.data).offsets_mm
        then = replace(fit, start=offsets - fit.moved[: offsets.size], effects=effects)
        mean, slopes, root = expect(then, problem.model, white.plan)
        jacobian, (spread, known) = white.matrix @ slopes, np.split(root, [len(mean)])
        shared = white.matrix @ spread - jacobian[:, :free] @ known[:free]
        return white.data - white.matrix @ mean, jacobian, shared


def baselines(white: Whitened, later: Later | None) -> dict[str, float]:
    """`quartic_mm` and `earlier_map_mm` of the touches of a printer, all alike, where known.

    `later` are other touches, to be predicted; None predicts each patch of the bed from the others.
    """
    offsets = fit_offsets(white.problem, white.data).offsets_mm
    place, left, jacobian, _ = _touches(white, offsets)
    touch = white.plan.touches
    columns = np.hstack((jacobian, white.plan.zeros[touch], _surface(white, place)))
    enough = len(left) > np.linalg.matrix_rank(columns) == columns.shape[1]
    if later is None:
        errors, number = [], np.cumsum(touch) - 1
        for patch in left_out(white):
            omitted = number[patch[touch[patch]]]
            rest = np.setdiff1d(np.arange(len(left)), omitted)
            if omitted.size and enough:
                terms = np.linalg.lstsq(columns[rest], left[rest])[0]
                errors.append(left[omitted] - columns[omitted] @ terms)
        return {"quartic_mm": rms(np.concatenate(errors))} if errors else {}
    free = later.free
    known = None if free == offsets.size else offsets - later.entered
    there, error, then, _ = _touches(later.white, known)
    mapped = unexplained(then[:, :free], error - _interpolated(place, left, there))
    held = {"earlier_map_mm": rms(mapped)}
    if enough:
        terms = np.linalg.lstsq(columns, left)[0]
        fixed = terms[: jacobian.shape[1]] * (np.arange(jacobian.shape[1]) >= free)
        predicted = then @ fixed + _surface(white, there) @ terms[-len(QUARTIC) :]
        held["quartic_mm"] = rms(unexplained(then[:, :free], error - predicted))
    return held


def repeats(white: Whitened, later: Later | None = None) -> float | None:
    """Correlation of the residual maps of two dates, of more the smallest.

    What calibrated parameters leave of the touches of each date; None for few, or of one date.
    """
    touched = (data for data in (white, later and later.white) if data and data.plan.touches.any())
    maps = [
        [values[date == day] for values in (place, left, jacobian)]
        for place, left, jacobian, date in map(_touches, touched)
        for day in np.unique(date)
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
    """Places (n, 2), what parameters, or the best, leave there (n,), derivatives (n, 6), dates."""
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
