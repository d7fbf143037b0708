"""Readings of any plan as explanations have them, and what readings to come would tell.

New readings are looked at in combinations that no new gauge zero enters and whose noise is
independent of that of the first readings: in a new set-up their deviations from its mean, in one
that goes on from the mean of what was read there. Of these only the few in which the explanations
can differ count.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import Mixture, root_of, whiten
from orthoglide_cal.inference.data import UNSEEN, as_read
from orthoglide_cal.inference.fit import Fit, known_then
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.plan import Bools, Floats, Plan, joined, without_zeros

# What a fit says of readings: their mean (n,), and a root (n + p, u) of the covariance of them and
# of the p parameters, without noise.
Expected = tuple[Floats, Floats]


def expect(fit: Fit, model: Model, plan: Plan, stay: Plan | None) -> Expected:
    """Readings of a plan as a fit to the first ones has them.

    What belongs to the set-up goes on only where the set-up does, a step of estimated size with its
    uncertainty; `stay` are the first readings if their stands are still there.
    """
    going_on = () if stay is None else fit.effects
    sized = [e for e in fit.effects if e.cause.lasting or (going_on and e.covariance is not None)]
    passing = [effect for effect in going_on if effect not in sized]
    model, plan = model.extended(passing), as_read(plan, passing)
    mean, slopes = differentiate(model, fit.offsets, plan, sized)
    stands = 0 if stay is None else stay.setups
    uncertain = influences(model, fit.offsets, plan)
    columns, covariance = known_then(fit, sized, slopes, uncertain, stands)
    root = root_of(covariance)
    return mean, np.vstack((columns @ root, root[: fit.offsets.size]))


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

    means = free(np.column_stack([mean for mean, _ in expected]))
    roots = [free(root) for _, root in expected]
    columns = np.hstack((means[:, 1:] - means[:, :1], *roots))
    # An orthonormal basis of the directions that exceed the noise, shape (m, r).
    m, c = columns.shape
    size2, vectors = np.linalg.eigh(columns @ columns.T if m <= c else columns.T @ columns)
    kept = size2 > (UNSEEN * min(fit.sigma for fit in fits)) ** 2
    basis = vectors[:, kept] if m <= c else columns @ (vectors[:, kept] / np.sqrt(size2[kept]))
    noise = np.repeat((1.0, 0.0), (basis.shape[1], fits[0].offsets.size))
    both = [
        np.vstack((basis.T @ spread, root[len(mean) :]))
        for spread, (mean, root) in zip(roots, expected, strict=True)
    ]
    return Mixture(
        np.hstack(((basis.T @ means).T, np.stack([fit.offsets for fit in fits])))[..., None],
        np.stack([
            root @ root.T + fit.sigma**2 * np.diag(noise)
            for root, fit in zip(both, fits, strict=True)
        ]),
        np.log([[share] for share, _ in weighted]),
    )  # fmt: skip


def chance_of_one_answer(
    odds: tuple[Floats, Floats], spare: Floats, shares: Floats, others: Bools
) -> float:
    """Chance that new readings dismiss all other answers than the true explanation.

    Args:
        odds: as of `Mixture.log_odds`.
        spare: ln of how far below its bound a rival is against the true one already, (f, f).
        shares: probability of each explanation, shape (f,).
        others: which rivals are other answers, (f, f).
    """
    mean, std = odds
    dismissed = np.where(others, ndtr((spare + mean) / std), 1.0).min(axis=1)
    return float(shares @ dismissed) if others.any() else 0.0
