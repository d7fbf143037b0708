"""Which causes can be distinguished, before a reading is taken.

A cause of plausible size changes the readings; a rival explains them as well as it can, at its best
place and with whatever sizes, offsets, gauge zeros and influences suit it. What it then costs more
than the truth itself, squared residuals over the noise and squared sizes over the plausible ones,
is the squared separation in standard deviations. Everything is linear around a machine with
plausible offsets, so that all truths and all rivals are a few products of matrices.
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import product
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from orthoglide_cal.estimation.gaussian import condition, unexplained, whiten_shared
from orthoglide_cal.inference.data import Candidates, Placed, Whitened
from orthoglide_cal.inference.evidence import UNIT, Gaussian
from orthoglide_cal.inference.hypothesis import pattern_density
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Cause, Model, Place, Stage, differentiate_absent
from orthoglide_cal.model.plan import Floats, Plan

# A cause whose trace is smaller than this cannot be seen, nor two be distinguished [σ].
TRACE_SIGMA = 1.0


class Separations(NamedTuple):
    """How far apart causes of plausible size are, typically (root mean square) [σ]."""

    # Ids of two → the smaller one of their two directions; nearest first.
    pairs: Mapping[tuple[str, str], float]
    trace: Mapping[str, float]  # id → from nothing wrong; the machine's first


def separations(model: Model, plan: Plan, among: Collection[str] | None = None) -> Separations:
    """Every cause that a diagnosis of such readings would try against every other.

    The n readings of the plan determine the offsets. `among` are ids to look at; None for all.
    """
    white, points = Whitened.of_plan(plan, model), model.machine.linearization_points
    candidates = Candidates.of(model, ordered=True)
    extras = {one.cause.id: one for one in white.places(candidates.extras) if one.tried}
    possible: list[Cause] = [*candidates.broad, *(placed.cause for placed in extras.values())]
    asked = (cause for cause in possible if among is None or cause.id in among)
    # Of the machine first, then of the measurement.
    causes = tuple(sorted(asked, key=lambda cause: ([*Stage].index(cause.stage), cause.id)))
    columns = {
        id: placed.patterns.patterns.columns(slice(None)).T[..., None]
        for id, placed in extras.items()
        if placed.patterns
    }
    total = np.zeros((len(causes), len(causes) + 1))
    if causes:
        every = np.concatenate([one.columns for one in white.uncertain(points)], axis=-1)
        for offsets, carried in zip(points, every, strict=True):
            total += _margins(white, offsets, causes, extras, columns, carried) / len(points)
    sigma = np.sqrt(np.minimum(total[:, :-1], total[:, :-1].T)).tolist()
    ids = [cause.id for cause in causes]
    pairs = {(ids[b], ids[a]): sigma[a][b] for a in range(len(ids)) for b in range(a)}
    trace = dict(zip(ids, np.sqrt(total[:, -1]).tolist(), strict=True))
    return Separations(dict(sorted(pairs.items(), key=itemgetter(1))), trace)


def _margins(
    white: Whitened,
    offsets: Floats,
    causes: Sequence[Cause],
    extras: Mapping[str, Placed],
    columns: dict[str, Floats],
    carried: Floats,
) -> Floats:
    """Mean cost of each rival, and of nothing wrong, above each truth's own, (c, c + 1).

    On a machine with these offsets, of a linear model of its readings, with what one plausible size
    of each influence adds to the whitened data, `carried` (k, u) [mm]. What is left of readings
    counts in standard deviations: what offsets, zeros and influences of plausible size imitate has
    been taken out. `columns` are of one unit of causes at one of many places, (places, n, 1).
    """
    plan, machine, noise = white.plan, white.machine, white.machine.instrument.noise_mm
    broad = [cause for cause in causes if cause.id not in extras]
    readings, (slope, *slopes) = differentiate_absent(white.problem.model, offsets, plan, broad)
    columns = columns | {c.id: one[None] for c, one in zip(broad, slopes, strict=True)}
    contrasts = white.matrix @ np.eye(len(plan)) / noise
    leaves = unexplained(*whiten_shared(carried / noise, white.matrix @ slope, contrasts))

    def steadiness(unit: Floats) -> Floats:
        """Cost of scatter that is too small or too large by a factor of 1/unit, shape (r,)."""
        spare = len(leaves) - len(offsets)
        return np.asarray(spare * (unit**-2.0 - 1.0 + 2.0 * np.log(unit)))

    # What each cause of plausible size does, at each place and for each choice of signs: it adds
    # (n, r) [mm] to the readings, written down in a unit (r,) [mm]; and the share of each (r,).
    truths = []
    for cause in causes:
        if cause.exchanges:
            tried = extras[cause.id].tried
            unit, share = np.array([(cause.unit_mm(at), cause.share(at)) for at in tried]).T
            effects = (cause.at(np.zeros(0), at) for at in tried)
            recorded = [cause.record(readings, effect, plan, machine) for effect in effects]
            added = np.stack(recorded, axis=1) - readings[:, None]
        else:
            added = np.hstack([*(columns[cause.id] @ _plausible(cause, machine).T)])
            unit = share = np.ones(added.shape[1])
        truths.append((added, unit, share / share.sum()))
    changes, units = (np.concatenate([t[k] for t in truths], axis=-1) for k in (0, 1))
    left = leaves @ changes
    steady = steadiness(units)
    changed = readings + changes.T

    def undone(cause: Cause, place: Place) -> Floats:
        """Cost of each change if this exchange is behind it, shape (r,)."""
        right = cause.inverted(changed, cause.at(np.zeros(0), place), plan, machine)
        rest = leaves @ (right - readings).T
        return np.asarray((rest**2).sum(axis=0) + steadiness(units / cause.unit_mm(place)))

    costs = [
        np.min([undone(cause, place) for place in extras[cause.id].tried], axis=0)
        if cause.exchanges
        else _cost(leaves @ columns[cause.id], left, cause, machine) + steady
        for cause in causes
    ]
    ends = np.cumsum([len(share) for _, _, share in truths])
    blocks = np.split(np.stack([*costs, (left**2).sum(axis=0) + steady]), ends[:-1], axis=1)
    rows = enumerate(zip(blocks, truths, strict=True))
    return np.stack([np.maximum(b - b[k], 0.0) @ share for k, (b, (_, _, share)) in rows])


def _cost(columns: Floats, left: Floats, cause: Cause, machine: Machine) -> Floats:
    """Cost of changes (k, r) with a cause at its best place, and of its best size, shape (r,).

    One unit of each parameter adds columns (places, k, p). Of named parameters that cannot be
    negative the best choice acts, the others are zero; whole numbers cost what they are rarer than
    the most frequent ones.
    """
    if cause.counts:
        pattern, without = columns[..., 0].T, -0.5 * (left**2).sum(axis=0)[:, None]
        both = (pattern**2).sum(axis=0), (left.T @ pattern)[:, None]
        log = pattern_density(machine, cause, *both, without).max(axis=(1, 2, 3))
        return np.asarray(2.0 * (np.log(max(cause.counts.values())) - log))
    named = len(cause.names) if cause.positive else 0
    costs = []
    for acting in product((1.0, 0.0), repeat=named):
        some = columns * cause.prior_std(machine) * [*acting, *np.ones(cause.unknowns - named)]
        density = Gaussian(some, np.ones((1, cause.unknowns)), UNIT)
        changes = density.overlap(left, left[:, 0])
        cost, _ = density.against(changes, changes.some(slice(1)))
        sizes, _ = condition(some[0], left, np.ones(cause.unknowns), 1.0)
        impossible = np.any(sizes[:named] < 0.0, axis=0)
        costs.append(np.where(impossible, np.inf, cost.min(axis=(0, 1, 2))))
    return np.asarray(np.min(costs, axis=0))


def _plausible(cause: Cause, machine: Machine) -> Floats:
    """Parameters of one plausible size each, or one count, in every combination of signs, (r, p).

    One sign of all of them together changes no square, and is left out. So are terms that are
    smaller than the first.
    """
    first = 1 if not cause.positive else len(cause.names)
    others = product((1.0, -1.0), repeat=cause.freedom - first)
    small = (0.0,) * (cause.unknowns - cause.freedom)
    signs = np.array([(*(1.0 for _ in range(first)), *rest, *small) for rest in others])
    if cause.counts:
        return signs * cause.millimetres(machine)
    return signs * cause.prior_std(machine)
