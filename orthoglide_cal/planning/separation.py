"""Which causes can be distinguished, before a reading is taken.

A cause of plausible size changes the readings; a rival explains them as well as it can, at its best
place and with whatever sizes, offsets, gauge zeros and influences suit it. What it then costs more
than the truth itself, squared residuals over the noise and squared sizes over the plausible ones,
is the squared separation in standard deviations. Everything is linear around a machine with
plausible offsets, so that all truths and all rivals are a few products of matrices.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress, product
from typing import NamedTuple

import numpy as np

from orthoglide_cal.causes import CAUSES, PatternCause, RelabelCause
from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import unexplained, whiten
from orthoglide_cal.model.cause import Cause, Place, Stage
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.plan import Floats, Plan, ReadOnly, zero_free

# A cause whose trace is smaller than this cannot be seen, nor two be distinguished [σ].
TRACE_SIGMA = 1.0


@dataclass(frozen=True)
class SeparatedPair:
    """Ids of two causes, and how far apart they are [standard deviations]."""

    causes: tuple[str, str]
    sigma: float


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
    def pairs(self) -> tuple[SeparatedPair, ...]:
        """Each pair with its separation, nearest first."""
        found = [
            SeparatedPair((self.causes[b].id, self.causes[a].id), float(self.sigma[a, b]))
            for a in range(len(self.causes))
            for b in range(a)
        ]
        return tuple(sorted(found, key=lambda pair: pair.sigma))


def separations(model: Model, plan: Plan, among: Collection[str] | None = None) -> Separations:
    """Every cause that is possible on this machine against every other.

    Args:
        model: its machine gives the plausible sizes; what is accepted already is no candidate.
        plan: n readings that determine the offsets.
        among: ids of those to look at; None for all.
    """
    machine, known = model.machine, {effect.cause.id for effect in model.accepted}
    possible = [
        cause
        for id, cause in CAUSES.items()
        if (among is None or id in among)
        and cause.possible(machine)
        and id not in known
        and _places(cause, plan, machine)
    ]
    # Of the machine first, then of the measurement.
    causes = tuple(sorted(possible, key=lambda cause: list(Stage).index(cause.stage)))
    supposed = machine.linearization_points
    total = np.zeros((len(causes), len(causes) + 1))
    if causes:
        columns = np.concatenate([u.columns for u in influences(model, supposed, plan)], axis=-1)
        for offsets, carried in zip(supposed, columns, strict=True):
            total += _Near(model, plan, offsets, causes, carried).margins() / len(supposed)
    sigma = np.sqrt(np.minimum(total[:, :-1], total[:, :-1].T))
    return Separations(causes, sigma, np.sqrt(total[:, -1]))


def _places(cause: Cause, plan: Plan, machine: Machine) -> Sequence[Place]:
    """The places at which the readings can express it."""
    found = cause.places(plan, machine)
    if isinstance(cause, RelabelCause):
        return [at for at in found if cause.reversible(plan, at)]
    return found


class _Changes(NamedTuple):
    """What r faults do to n readings."""

    added: Floats  # to each reading, shape (n, r) [mm]
    share: Floats  # of each among the plausible ones of its cause, shape (r,)
    unit: Floats  # in which the readings were written down, shape (r,) [mm]


class _Near:
    """The surroundings of a machine with given offsets, as a linear model of its readings.

    With what one plausible size of each influence adds to these, `carried` (n, u) [mm].
    Readings are in mm; what is left of them is whitened, so that it counts in standard deviations:
    what offsets, zeros and influences of plausible size imitate has been taken out.
    """

    def __init__(
        self,
        model: Model,
        plan: Plan,
        offsets: Floats,
        causes: tuple[Cause, ...],
        carried: Floats,
    ) -> None:
        self._machine, self._plan = model.machine, plan
        self._offsets, self._causes = offsets, causes
        sigma = model.machine.instrument.noise_mm
        broad = [c for c in causes if not isinstance(c, PatternCause | RelabelCause)]
        absent = [cause.at(np.zeros(cause.unknowns)) for cause in broad]
        self._readings, columns = differentiate(model, offsets, plan, absent)
        ends = np.cumsum([len(offsets), *(cause.unknowns for cause in broad)])
        slope, *slopes = np.split(columns, ends[:-1], axis=1)
        # Readings that one plausible size of each parameter adds, shape (n, p) [mm].
        self._columns = {
            cause.id: own * cause.prior_std(self._machine)
            for cause, own in zip(broad, slopes, strict=True)
        }
        contrasts = zero_free(plan) / sigma
        shown = contrasts @ carried
        noise = np.eye(len(contrasts)) + shown @ shown.T
        white, white_slope = whiten(noise, contrasts, contrasts @ slope)
        self._left = unexplained(white_slope, white)

    def margins(self) -> Floats:
        """Mean cost of each rival, and of nothing wrong, above each truth's own, (c, c + 1)."""
        truths = [self._truth(cause) for cause in self._causes]
        every = _Changes(*(np.concatenate(part, axis=-1) for part in zip(*truths, strict=True)))
        left = self._left @ every.added
        plain = (left**2).sum(axis=0) + self._steadiness(every.unit)
        cost = np.stack([*(self._cost(c, every, left, plain) for c in self._causes), plain])
        blocks = np.split(cost, np.cumsum([len(each.share) for each in truths])[:-1], axis=1)
        pairs = zip(blocks, truths, strict=True)
        return np.stack(
            [np.maximum(b - b[k], 0.0) @ truth.share for k, (b, truth) in enumerate(pairs)]
        )

    def _steadiness(self, unit: Floats) -> Floats:
        """Cost of scatter that is too small or too large by a factor of 1/unit, shape (r,)."""
        spare = len(self._left) - len(self._offsets)
        return np.asarray(spare * (unit**-2.0 - 1.0 + 2.0 * np.log(unit)))

    def _truth(self, cause: Cause) -> _Changes:
        """What a cause of plausible size does, at each place and for each choice of signs."""
        if isinstance(cause, RelabelCause):
            places = _places(cause, self._plan, self._machine)
            nothing, unit = np.zeros((len(self._plan), 1)), [cause.unit_mm(at) for at in places]
            pairs = zip(places, unit, strict=True)
            found = [self._exchanged(cause, at, nothing, 1.0 / mm) for at, mm in pairs]
            share = np.array([cause.share(at) for at in places])
            return _Changes(np.hstack(found), share / share.sum(), np.array(unit))
        if isinstance(cause, PatternCause):
            added = self._patterns(cause)
        else:
            added = self._columns[cause.id] @ _signs(cause).T
        ones = np.ones(added.shape[1])
        return _Changes(added, ones / ones.sum(), ones)

    def _patterns(self, cause: PatternCause) -> Floats:
        """What one plausible size, or one count, adds at each place, shape (n, places) [mm]."""
        size = 1.0 if cause.counts else cause.prior_std(self._machine)[0]
        places = cause.places(self._plan, self._machine)
        unit = size * cause.millimetres(self._machine)
        return np.asarray(unit * cause.patterns(self._plan, places))

    def _cost(self, cause: Cause, changes: _Changes, left: Floats, plain: Floats) -> Floats:
        """Least cost of a rival's explanation of r changes that show as `left` (k, r), (r,).

        `plain` is their cost if nothing is wrong.
        """
        if isinstance(cause, RelabelCause):
            costs = []
            for place in _places(cause, self._plan, self._machine):
                unit = cause.unit_mm(place)
                undone = self._left @ self._exchanged(cause, place, changes.added, unit)
                costs.append((undone**2).sum(axis=0) + self._steadiness(changes.unit / unit))
            return np.asarray(np.min(costs, axis=0))
        if isinstance(cause, PatternCause):
            patterns = self._left @ self._patterns(cause)
            square, overlap = (patterns**2).sum(axis=0)[:, None], patterns.T @ left
            if not cause.counts:
                return np.asarray(plain - (overlap**2 / (1.0 + square)).max(axis=0))
            likeliest = max(cause.counts.values())
            costs = [
                (size**2 * square - 2.0 * size * overlap).min(axis=0)
                - 2.0 * np.log(share / likeliest)
                for size, share in cause.counts.items()
            ]
            return np.asarray(plain + np.min(costs, axis=0))
        return plain - _explained(self._left @ self._columns[cause.id], left, cause)

    def _exchanged(
        self, cause: RelabelCause, place: Place, changes: Floats, factor: float
    ) -> Floats:
        """How changed readings (n, r) differ from unchanged ones once they are relabelled [mm]."""
        index, sign = cause.relabel(self._plan, place)
        unchanged = self._readings[:, None]
        return np.asarray(factor * sign[:, None] * (unchanged + changes)[index] - unchanged)


def _explained(columns: Floats, left: Floats, cause: Cause) -> Floats:
    """By how much sizes of one standard deviation each (k, p) reduce the cost of changes (k, r).

    Of named parameters that cannot be negative the best choice acts, the others are zero.
    """
    gram, overlap = columns.T @ columns + np.eye(columns.shape[1]), columns.T @ left
    if not cause.positive:
        return np.asarray((overlap * np.linalg.solve(gram, overlap)).sum(axis=0))
    best = np.zeros(left.shape[1])
    for acting in product((True, False), repeat=len(cause.names)):
        kept = np.flatnonzero([*acting, *(True for _ in cause.nuisance)])
        sizes = np.linalg.solve(gram[np.ix_(kept, kept)], overlap[kept])
        gained = (overlap[kept] * sizes).sum(axis=0)
        possible = np.all(sizes[: sum(acting)] >= 0.0, axis=0)
        best = np.where(possible & (gained > best), gained, best)
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
