"""Which causes can be distinguished, before a reading is taken.

A cause of plausible size changes the readings; a rival explains them as well as it can, at its best
place and with whatever sizes, offsets, gauge zeros and influences suit it. What it then costs more
than the truth itself, squared residuals over the noise and squared sizes over the plausible ones,
is the squared separation in standard deviations. Everything is linear around a machine with
plausible offsets, so that all truths and all rivals are a few products of matrices.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import compress, product
from operator import itemgetter

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import unexplained, whiten
from orthoglide_cal.inference.prediction import Exchange, columns_of, exchanges_of
from orthoglide_cal.model.cause import Cause, Stage
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, Plan, ReadOnly, zero_free

# A cause whose trace is smaller than this cannot be seen, nor two be distinguished [σ].
TRACE_SIGMA = 1.0


@dataclass(frozen=True, eq=False)
class Separations(ReadOnly):
    """How far apart c causes of plausible size are, typically (root mean square) [σ]."""

    causes: tuple[Cause, ...]  # in the order of the table
    sigma: Floats  # between each pair, the smaller one of its two directions, shape (c, c)
    trace: Floats  # between each of them and nothing wrong, shape (c,)

    @cached_property
    def invisible(self) -> tuple[Cause, ...]:
        """Those that leave no trace in such readings."""
        return tuple(compress(self.causes, self.trace < TRACE_SIGMA))

    @cached_property
    def visible(self) -> "Separations":
        """Only the others."""
        seen = self.trace >= TRACE_SIGMA
        causes = tuple(compress(self.causes, seen))
        return Separations(causes, self.sigma[np.ix_(seen, seen)], self.trace[seen])

    @cached_property
    def pairs(self) -> Mapping[tuple[str, str], float]:
        """Ids of each two causes → their separation, nearest first."""
        ids, sigma = [cause.id for cause in self.causes], self.sigma.tolist()
        pairs = {(ids[b], ids[a]): sigma[a][b] for a in range(len(ids)) for b in range(a)}
        return dict(sorted(pairs.items(), key=itemgetter(1)))


def separations(model: Model, plan: Plan, among: Collection[str] | None = None) -> Separations:
    """Every cause that is possible on this machine and not accepted yet against every other.

    The n readings of the plan determine the offsets. `among` are ids to look at; None for all.
    """
    machine, known = model.machine, {effect.cause.id for effect in model.accepted}
    possible = [
        cause
        for id, cause in CAUSES.items()
        if (among is None or id in among) and id not in known and cause.possible(machine)
        if (cause.places if cause.unknowns else partial(exchanges_of, cause))(plan, machine)
    ]
    # Of the machine first, then of the measurement.
    causes = tuple(sorted(possible, key=lambda cause: list(Stage).index(cause.stage)))
    supposed = machine.linearization_points
    total = np.zeros((len(causes), len(causes) + 1))
    if causes:
        columns = np.concatenate([u.columns for u in influences(model, supposed, plan)], axis=-1)
        for offsets, carried in zip(supposed, columns, strict=True):
            total += _margins(model, plan, offsets, causes, carried) / len(supposed)
    sigma = np.sqrt(np.minimum(total[:, :-1], total[:, :-1].T))
    return Separations(causes, sigma, np.sqrt(total[:, -1]))


def _margins(
    model: Model, plan: Plan, offsets: Floats, causes: Sequence[Cause], carried: Floats
) -> Floats:
    """Mean cost of each rival, and of nothing wrong, above each truth's own, (c, c + 1).

    On a machine with these offsets, of a linear model of its readings, with what one plausible size
    of each influence adds to these, `carried` (n, u) [mm]. What is left of readings is whitened, so
    that it counts in standard deviations: what offsets, zeros and influences of plausible size
    imitate has been taken out.
    """
    readings, slope, columns = columns_of(model, offsets, plan, causes)
    exchanges = {c.id: exchanges_of(c, plan, model.machine) for c in causes if not c.unknowns}
    contrasts = zero_free(plan) @ (np.eye(len(plan)) / model.machine.instrument.noise_mm)
    shown = contrasts @ carried
    white, white_slope = whiten(np.eye(len(shown)) + shown @ shown.T, contrasts, contrasts @ slope)
    leaves = unexplained(white_slope, white)

    def steadiness(unit: Floats) -> Floats:
        """Cost of scatter that is too small or too large by a factor of 1/unit, shape (r,)."""
        spare = len(leaves) - len(offsets)
        return np.asarray(spare * (unit**-2.0 - 1.0 + 2.0 * np.log(unit)))

    # What each cause of plausible size does, at each place and for each choice of signs: it adds
    # (n, r) [mm] to the readings, written down in a unit (r,) [mm]; and the share of each (r,).
    truths = []
    for cause in causes:
        if cause.unknowns:
            added = np.hstack([*(columns[cause.id] @ _signs(cause).T)])
            unit = share = np.ones(added.shape[1])
        else:
            unit, share = np.array([(one.unit_mm, one.share) for one in exchanges[cause.id]]).T
            recorded = [one.exchanged(readings) / one.unit_mm for one in exchanges[cause.id]]
            added = np.stack(recorded, axis=1) - readings[:, None]
        truths.append((added, unit, share / share.sum()))
    changes, units = (np.concatenate([t[k] for t in truths], axis=-1) for k in (0, 1))
    left = leaves @ changes
    plain = (left**2).sum(axis=0) + steadiness(units)
    changed = readings[:, None] + changes

    def undone(one: Exchange) -> Floats:
        """Cost of each change if this exchange is behind it, shape (r,)."""
        rest = leaves @ (one.exchanged(changed) * one.unit_mm - readings[:, None])
        return np.asarray((rest**2).sum(axis=0) + steadiness(units / one.unit_mm))

    costs = [
        plain - _explained(leaves @ columns[cause.id], left, cause)
        if cause.unknowns
        else np.min([undone(one) for one in exchanges[cause.id]], axis=0)
        for cause in causes
    ]
    ends = np.cumsum([len(share) for _, _, share in truths])
    blocks = np.split(np.stack([*costs, plain]), ends[:-1], axis=1)
    rows = enumerate(zip(blocks, truths, strict=True))
    return np.stack([np.maximum(b - b[k], 0.0) @ share for k, (b, (_, _, share)) in rows])


def _explained(columns: Floats, left: Floats, cause: Cause) -> Floats:
    """By how much a cause reduces the cost of changes (k, r) at its best place, shape (r,).

    Sizes of one standard deviation each add columns (places, k, p). Of named parameters that cannot
    be negative the best choice acts, the others are zero; whole numbers cost what they are rarer
    than the most frequent ones.
    """
    turned = columns.swapaxes(-1, -2)
    gram, overlap = turned @ columns, turned @ left
    if cause.counts:
        likeliest = max(cause.counts.values())
        gained = [
            2.0 * size * overlap - size**2 * gram + 2.0 * np.log(share / likeliest)
            for size, share in cause.counts.items()
        ]
        return np.asarray(np.max(gained, axis=(0, 1, 2)))
    gram = gram + np.eye(gram.shape[-1])
    best = np.zeros(left.shape[1])
    named = len(cause.names) if cause.positive else 0
    for acting in product((True, False), repeat=named):
        kept = np.flatnonzero([*acting, *(True for _ in range(cause.unknowns - named))])
        pull = overlap[:, kept]
        sizes = np.linalg.solve(gram[:, kept[:, None], kept], pull)
        gain = (pull * sizes).sum(axis=1)
        possible = np.all(sizes[:, : sum(acting)] >= 0.0, axis=1)
        best = np.maximum(best, np.where(possible, gain, 0.0).max(axis=0))
    return best


def _signs(cause: Cause) -> Floats:
    """Parameters of one plausible size each, in every combination of signs, shape (r, p).

    One sign of all of them together changes no square, and is left out. So are terms that are
    smaller than the first.
    """
    first = 1 if not cause.positive else len(cause.names)
    others = product((1.0, -1.0), repeat=cause.freedom - first)
    small = (0.0,) * (cause.unknowns - cause.freedom)
    return np.array([(*(1.0 for _ in range(first)), *rest, *small) for rest in others])
