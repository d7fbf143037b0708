"""What explanations of some readings expect of further ones.

New readings are looked at in combinations that no new gauge zero enters and whose noise is
independent of that of the first readings: in a new set-up their deviations from its mean, in one
that goes on from the mean of what was read there. Of these only the few in which the explanations
can differ count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orthoglide_cal.diagnosis.explanations import UNSEEN, as_read
from orthoglide_cal.diagnosis.fit import Fitted, known_then
from orthoglide_cal.estimation.influences import influences
from orthoglide_cal.model import Floats, Model, Plan, ReadOnly, differentiate, without_zeros
from orthoglide_cal.planning.options import Option, joined


@dataclass(frozen=True, eq=False)
class Outlook(ReadOnly):
    """What f explanations expect of one option, in r combinations of its readings.

    Attributes:
        mean: shape (f, r) [mm].
        covariance: with noise, shape (f, r, r) [mm²].
        offsets: covariance of the offsets once it is read, shape (f, 3, 3) [mm²].
    """

    mean: Floats
    covariance: Floats
    offsets: Floats

    def halves(self) -> tuple[Outlook, Outlook]:
        """The first half of the explanations, and the second."""
        half = len(self.mean) // 2
        parts = (slice(half), slice(half, None))
        one, two = (Outlook(self.mean[p], self.covariance[p], self.offsets[p]) for p in parts)
        return one, two


@dataclass(frozen=True, eq=False)
class _Expected:
    """What one explanation says of n readings: their mean (n,) and a root (n, u) of its spread.

    `known` is the root (u, u) of the covariance of what they depend on, the offsets first.
    """

    mean: Floats
    spread: Floats
    known: Floats


def outlooks(
    model: Model, first: Any, choice: Sequence[Option], fits: Sequence[Fitted]
) -> list[Outlook]:
    """What explanations expect of each option.

    Args:
        model: the machine and its accepted causes.
        first: the readings that the explanations were fitted to; None if they are not known.
        choice: options.
        fits: the explanations.
    """
    found: dict[Option, Outlook] = {}
    for goes_on in (True, False):
        group = [option for option in choice if option.continues is goes_on]
        if not group:
            continue
        plan, starts = _together(first, group)
        expected = [_expected(model, plan, fit, first if goes_on else None) for fit in fits]
        for option, start in zip(group, starts, strict=True):
            found[option] = _outlook(first, option, start, expected, fits)
    return [found[option] for option in choice]


def _together(first: Any, group: Sequence[Option]) -> tuple[Plan, list[int]]:
    """One plan of the first readings and all options, and where each option begins in it.

    Every option comes behind the first readings' last travel, as if there were no other: the
    carriages come to it from where they would.
    """
    if first is None:
        parts = [option.plan for option in group]
        starts = np.cumsum([0, *map(len, parts)])[:-1].tolist()
    else:
        travel = first.subset(first.last_travel)
        parts, starts, end = [first], [], len(first)
        for option in group:
            starts.append(end + len(travel))
            parts += [travel, option.plan]
            end = starts[-1] + len(option.plan)
    order = np.concatenate([part.in_time.argsort() for part in parts])
    order += np.repeat(np.cumsum([0, *map(len, parts[:-1])]), [len(part) for part in parts])
    return replace(joined(*parts), order=order), starts


def _expected(model: Model, plan: Any, fit: Fitted, goes_on: Plan | None) -> _Expected:
    """What an explanation says of readings; `goes_on` are those whose stands are still there."""
    # What belongs to the set-up goes on only where the set-up does, a step of estimated size with
    # its uncertainty.
    stay = goes_on is not None
    sized = [e for e in fit.effects if e.cause.lasting or (stay and e.covariance is not None)]
    passing = [effect for effect in fit.effects if stay and effect not in sized]
    model, plan = model.extended(passing), as_read(plan, passing)
    mean, slopes = differentiate(model, fit.offsets, plan, sized)
    stands = 0 if goes_on is None else goes_on.setups
    columns, joint = known_then(
        fit, sized, slopes, influences(model, fit.offsets, plan), stands=stands
    )
    size2, turn = np.linalg.eigh(joint)
    known = turn * np.sqrt(np.maximum(size2, 0.0))
    return _Expected(mean, columns @ known, known)


def _outlook(
    first: Any,
    option: Option,
    start: int,
    expected: Sequence[_Expected],
    fits: Sequence[Fitted],
) -> Outlook:
    """One option, which begins at `start` in what is expected of all."""
    own = slice(start, start + len(option.plan))
    set_ups = option.plan.subset(np.arange(len(option.plan)))  # numbered from 0

    def free(values: Floats) -> Floats:
        """Values (n, c) in the combinations, with unit noise, shape (m, c)."""
        if first is None or not option.continues:
            return without_zeros(set_ups, values[own].T).T
        same = np.asarray(option.plan.setup[:, None] == first.setup, dtype=np.float64)
        mean = same / same.sum(axis=1, keepdims=True)
        root = np.linalg.cholesky(np.eye(len(mean)) + mean @ mean.T)
        apart = values[own] - mean @ values[: len(first)]
        return np.asarray(np.linalg.solve(root, apart))

    means = free(np.column_stack([each.mean for each in expected]))
    spreads = [free(each.spread) for each in expected]
    least = UNSEEN * min(fit.sigma for fit in fits)
    basis = _span(np.hstack((means[:, 1:] - means[:, :1], *spreads)), least)
    noise = np.eye(basis.shape[1])
    covariance, offsets = [], []
    for each, spread, fit in zip(expected, spreads, fits, strict=True):
        seen, known = basis.T @ spread, each.known[: len(fit.offsets)]
        covariance.append(fit.sigma**2 * noise + seen @ seen.T)
        cross = known @ seen.T
        offsets.append(known @ known.T - cross @ np.linalg.solve(covariance[-1], cross.T))
    return Outlook((basis.T @ means).T, np.stack(covariance), np.stack(offsets))


def _span(columns: Floats, least: float) -> Floats:
    """Orthonormal basis of columns (m, c), of what is larger than `least`, shape (m, r)."""
    m, c = columns.shape
    size2, vectors = np.linalg.eigh(columns @ columns.T if m <= c else columns.T @ columns)
    kept = size2 > least**2
    if m <= c:
        return np.asarray(vectors[:, kept])
    return np.asarray(columns @ (vectors[:, kept] / np.sqrt(size2[kept])))
