"""The data as a diagnosis sees them, and the explanations that compete for them.

The data are combinations of readings with equal, independent noise:

    d = W y,   W whitens, so that the noise of d is σ² I

For raw readings W are the zero-free contrasts, for differences the whitened differences. A
cause that relabels readings by T acts on d as the orthogonal matrix W T Wᵀ (W Wᵀ = I).

Tried are "nothing is wrong", one cause, and two causes, these also with wrong readings. A base is a
set of causes with many parameters acting everywhere (none, one of the machine or the bars, or
both); an extra is one cause at one of many places, or one that relabels readings.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from operator import attrgetter

import numpy as np

from orthoglide_cal.causes import CAUSES, UNLISTED
from orthoglide_cal.estimation.budget import influences
from orthoglide_cal.estimation.gaussian import shrink, shrinking, unexplained, whiten
from orthoglide_cal.estimation.solution import (
    Contrasts,
    LeastSquaresFit,
    Problem,
    Reduction,
    fit_offsets,
    pose,
    pose_plan,
    require_optimum,
    require_rank,
    require_travel,
    rms,
)
from orthoglide_cal.inference.evidence import NoiseGrid, Places, Texture
from orthoglide_cal.model.machine import Influence, Machine
from orthoglide_cal.model.measured import DataKind, Measured, Readings
from orthoglide_cal.model.model import Cause, Effect, Model, Place, Stage, differentiate_absent
from orthoglide_cal.model.orthoglide import ideal_plan, reduction
from orthoglide_cal.model.plan import Bools, Floats, Ints, Plan, ReadOnly, read_only

# Between a quick session and a slow one: factor on the pace where no times were written down.
UNKNOWN_PACE = 3.0
# Of one standard deviation of a reading: what changes the data by less changes no evidence.
UNSEEN = 0.1
# No larger, in plausible sizes, is tried together with another fault; scales grow.
BESIDE = 12.0
# Cosine from which columns of one gauge can follow what a listed cause does there.
ALIKE, ROUNDING = 0.97, 1e-9
# Standard deviation of the prior of the offsets, so wide that their size is not judged [mm].
OFFSETS_MM = 10.0
# Prior weight of the kinds of explanation; the last but one is shared by the unlisted patterns.
ONE_CAUSE = 0.38
TWO_CAUSES = ONE_CAUSE**2 / 2.0  # independent of each other
MANY = 1000  # places of a bed: enough for every term of a shape

Ids = tuple[str, ...]  # of causes that act together, sorted; () is "nothing is wrong"


@functools.lru_cache(maxsize=1024)
def ids_of(*causes: Cause) -> Ids:
    """Ids of a set of causes, sorted."""
    return tuple(sorted(cause.id for cause in causes))


@dataclass(frozen=True)
class Candidates:
    """The causes to be tried on one data set."""

    broad: tuple[Cause, ...]  # causes with machine-wide parameters
    pairs: tuple[tuple[Cause, ...], ...]  # of them, those that may act together
    # Causes that add one pattern at one of many places, then those that relabel.
    extras: tuple[Cause, ...]
    log_prior: Mapping[Ids, float]  # ln prior weight of each set of ids

    @classmethod
    @functools.lru_cache(maxsize=8)
    def of(cls, model: Model, ordered: bool, spots: int = MANY) -> Candidates:
        """Causes that are possible on the machine, and sets of one or two of them.

        Two act together only if at least one lies in the contact or the record, or is a companion
        of all on that kind of machine; two others of the machine at once are left to "unlisted".

        Not those that the model knows already or rules out; `ordered` if the time order of the
        readings is known, `spots` the number of places of a bed that were touched.
        """
        machine = model.machine
        # What a controller corrects may be more by now.
        known = {effect.cause.id for effect in model.accepted} - machine.corrected.keys()
        usable = [
            cause
            for cause in (cause.within(spots) for cause in CAUSES.values())
            if cause is not None and cause.possible(machine)
            if cause.id not in known and cause.id not in model.ruled_out
            # Readings without known times show none of it, others hold some of themselves.
            if not cause.timed or (ordered and cause.id not in machine.unobservable)
        ]
        placed = (cause for cause in usable if cause.placed)
        extras = tuple(sorted(placed, key=attrgetter("exchanges")))
        broad = tuple(cause for cause in usable if not cause.placed)
        of_machine = [cause for cause in broad if cause.in_machine]
        contact = [cause for cause in broad if cause.stage is Stage.CONTACT]
        beside = [cause for cause in broad if cause.id in machine.companions]
        alone = [cause for cause in of_machine if cause not in beside]
        pairs = (*product(of_machine, contact), *product(alone, beside))
        both = [*pairs, *product(broad, extras)]
        log_prior: dict[Ids, float] = {}
        for share, sets in ((ONE_CAUSE, [(cause,) for cause in usable]), (TWO_CAUSES, both)):
            weight = {ids_of(*causes): math.prod(c.weight for c in causes) for causes in sets}
            total = sum(weight.values())
            log_prior |= {ids: math.log(share * w / total) for ids, w in weight.items()}
        # A slip happens whatever else is wrong.
        for slip, pair in product((cause for cause in extras if cause.hides_reading), pairs):
            log_prior[ids_of(*pair, slip)] = log_prior[ids_of(*pair)] + log_prior[slip.id,]
        log_prior[()] = math.log(1.0 - UNLISTED - sum(map(math.exp, log_prior.values())))
        return cls(broad, pairs, extras, log_prior)


# Of the calibrated parameters alone.
NOTHING = Candidates((), (), (), {(): 0.0})


@dataclass(frozen=True, eq=False)
class Whitened(ReadOnly):
    """Data and model in whitened form."""

    problem: Problem  # the model, the plan of n readings, and W, shape (k, n)
    data: Floats  # d, shape (k,) [mm]
    root: Floats | None  # un-whitens differences, shape (k, k); None for readings
    raw: bool  # readings, whose order in time is known; False for differences
    in_file: Ints  # where each entry of the file stands in the data as read, shape (m,)
    # The only other unit that the readings may be in [mm]; None without one.
    unit_mm: float | None = None
    texture: Texture | None = None  # a local shape of what is touched; None without one
    # Recorded temperature of each reading, less the first, (n,) [K]; None where it was not.
    kelvin: Floats | None = None

    @classmethod
    def of(cls, measured: Measured, model: Model) -> Whitened:
        """Whiten what was measured. Raises UnusableResultError: the offsets are not determined."""
        if isinstance(measured, Readings):
            white = cls.of_plan(measured.plan, model, measured.timed)
            require_rank(white.problem)
            plan, warm, kelvin = measured.plan, measured.temperature, None
            known = plan.in_time[np.isfinite(warm[plan.in_time])]
            if known.size > 1:
                kelvin = np.interp(plan.order, plan.order[known], warm[known] - warm[known[0]])
            unit = model.machine.instrument.mistaken_unit(measured)
            return replace(white, data=white.matrix @ measured.value, unit_mm=unit, kelvin=kelvin)
        problem, values = pose(measured, model, measured.kind)
        require_rank(problem)
        plan, matrix = problem.plan, problem.matrix @ np.eye(len(problem.plan))
        if measured.kind is DataKind.SIX:
            # The readings behind max − min, with the isotropic ones that the carriages pass.
            plan = ideal_plan(DataKind.TWELVE, model.machine)
            matrix = reduction(DataKind.SIX, problem.which, model.machine, plan)
        rows, data = whiten(matrix @ matrix.T, matrix, values)
        root = np.asarray(np.linalg.cholesky(matrix @ matrix.T))
        in_file = np.array([problem.which.index(difference) for difference in measured.which])
        return cls(Problem(model, plan, rows), data, root, False, in_file)

    @classmethod
    @functools.lru_cache(maxsize=8)
    def of_plan(cls, plan: Plan, model: Model, timed: bool = True) -> Whitened:
        """Readings that are taken to a plan, all of them zero; on a known clock or not."""
        problem, texture = pose_plan(plan, model, DataKind.READINGS), None
        local = model.machine.local_shape(plan)
        if local is not None:
            texture = Texture.of(problem.matrix @ local.columns, local.rest, local.assumed)
        zero = np.zeros(len(problem.matrix))
        white = cls(problem, zero, None, True, np.arange(len(plan)), texture=texture)
        # Rates of change as plausible as before, on a clock that was only assumed.
        rates = (cause for cause in CAUSES.values() if cause.is_rate)
        return white if timed else white.scaled(UNKNOWN_PACE, rates)

    def __len__(self) -> int:
        return len(self.data)

    @property
    def machine(self) -> Machine:
        return self.problem.model.machine

    @property
    def plan(self) -> Plan:
        return self.problem.plan

    @property
    def matrix(self) -> Reduction:
        """W, shape (k, n)."""
        return self.problem.matrix

    def places(self, extras: Iterable[Cause]) -> list[Placed]:
        """Places of each extra; most act the same whenever the readings were taken."""
        problem = whenever = self.problem
        if self.raw:
            whenever = pose_plan(self.plan.steps, problem.model, DataKind.READINGS)
        return [places_of(problem if e.is_rate else whenever, e) for e in extras]

    def scaled(self, factor: float, causes: Iterable[Cause]) -> Whitened:
        """The same with the plausible sizes of these causes multiplied."""
        machine = self.machine
        usual = (cause for cause in causes if cause.usual(machine) is not None)
        sizes = {cause.id: factor * cause.stated(machine) for cause in usual}
        machine = machine.changed(tolerances={**machine.tolerances, **sizes})
        model = replace(self.problem.model, machine=machine)
        return replace(self, problem=replace(self.problem, model=model))

    def plain(self, residual: Floats) -> Floats:
        """A whitened residual (k,) in each reading, or difference, shape (m,) [mm]."""
        if self.root is not None:
            return np.asarray(self.root @ residual)
        return np.asarray(self.matrix.T @ residual / self.plan.precision**2)

    @property
    def weight(self) -> Floats:
        """Weight of an error of each reading, or difference, (m,): how precise it is."""
        return self.plan.precision if self.raw else np.ones(len(self.in_file))

    def rms(self, residual: Floats) -> float:
        """Root mean square of a whitened residual over readings, or differences, weighed [mm]."""
        return rms(self.weight * self.plain(residual))

    def relabelled(self, values: Floats, *changes: tuple[Cause, Place]) -> Floats:
        """Whitened values (k,) with signs or labels exchanged, or put right again, (changes, k)."""
        index, sign = _relabelling(self.plan.steps, changes)
        return np.asarray((self.matrix @ (sign * (self.matrix.T @ values)[index])).T)

    def fit_versions(self, versions: Floats) -> LeastSquaresFit:
        """Offsets fitted to versions of the data (v, k), less precise by a stated local shape."""
        problem, texture = self.problem, self.texture
        if texture is None or not isinstance(self.matrix, Contrasts):
            return fit_offsets(problem, versions)
        general, factors = texture.whitened(self.machine.instrument.noise_mm)
        shrunk, precision = (texture.axes, factors), general * self.matrix.precision
        matrix = replace(self.matrix, precision=precision, shrunk=shrunk)
        white = general * shrink(versions.T, *shrunk).T
        fit = fit_offsets(replace(problem, matrix=matrix), white)
        predicted, _ = problem.predict_with_jacobian(fit.offsets_mm, strict=False)
        return replace(fit, residuals_mm=versions - predicted)

    def optimum(self, uncertain: Sequence[Influence], start: Floats) -> Floats:
        """Offsets (p,) that fit readings best, weighted by what is uncertain of them.

        Searched from others (p,). Raises UnusableResultError: there is no optimum.
        """
        variance = self.machine.instrument.noise_mm**2 + sum(one.rest for one in uncertain)
        shrunk = shrinking(self.side_by_side(uncertain) / math.sqrt(variance))
        problem, data = self.problem.weighted(shrunk), shrink(self.data, *shrunk)
        return require_optimum(problem, fit_offsets(problem, data, start)).offsets_mm

    def uncertain(self, offsets: Floats) -> tuple[Influence, ...]:
        """Influences on the data in addition to noise, for offsets (..., 3) [mm]."""
        acting = influences(self.problem.model, offsets, self.plan)
        return tuple(replace(one, columns=self.matrix @ one.columns) for one in acting)

    def side_by_side(self, influences: Iterable[Influence]) -> Floats:
        """Columns of influences on the data, shape (k, c) [mm]."""
        return np.hstack([np.zeros((len(self), 0)), *(one.columns for one in influences)])


@functools.lru_cache(maxsize=8)
def _relabelling(plan: Plan, changes: tuple[tuple[Cause, Place], ...]) -> tuple[Ints, Floats]:
    """`Cause.relabel` of several exchanges: indices and signs, each (n, changes)."""
    pairs = [cause.relabel(plan, place) for cause, place in changes]
    index, sign = np.array(pairs).reshape(-1, 2, len(plan)).transpose(1, 2, 0)
    return read_only(index, np.intp), read_only(sign)


def as_read(plan: Plan, effects: Sequence[Effect]) -> Plan:
    """The plan of what was really read, where an exchange cannot be expressed in the data."""
    for effect in effects:
        if not effect.cause.reversible(plan, effect.place):
            plan = effect.cause.really_read(plan, effect.place)
    return plan


def unit_of(effects: Sequence[Effect]) -> float:
    """The unit of the data, if these effects are behind them [mm]."""
    return math.prod(effect.cause.unit_mm(effect.place) for effect in effects)


@dataclass(frozen=True)
class Placed:
    """Data, not an explanation: where an extra cause may act, its weights, columns or versions."""

    cause: Cause
    tried: tuple[Place, ...]  # where it may act; of a relabelling only where the data can undo it
    first: int  # number of the version of the data with the first of them undone
    log_weight: Mapping[Place, float]  # ln of what the density of the data is multiplied by
    replanned: tuple[Place, ...] = ()  # where the data cannot undo a relabelling
    # W·pattern of one unit at each place of a pattern cause [mm per unit]; None of others.
    patterns: Places | None = None

    def numbered(self, number: int, others: Place = ()) -> Effect:
        """One size and place, all places in turn for each size; empty if it may have any size.

        `others` are readings that are wrong as well.
        """
        size, at = divmod(number, len(self.tried))
        cause, count = self.cause, np.array([*self.cause.counts][size : size + 1], np.float64)
        if others:
            cause = cause.several(len(others) + 1)
        return cause.at(count, (*others, *self.tried[at]))

    def columns(self, place: Place) -> Floats:
        """W·pattern of one unit at a place, of several readings for each, (k, p) [mm]."""
        assert self.patterns is not None
        hidden = self.cause.hides_reading
        return self.patterns.columns([*place] if hidden else [self.tried.index(place)])

    @cached_property
    def weights(self) -> Floats:
        """`log_weight` of the places that are tried, shape (tried,)."""
        return read_only([self.log_weight[place] for place in self.tried])


@functools.lru_cache(maxsize=32)
def places_of(problem: Problem, cause: Cause) -> Placed:
    """Places of an extra, whatever the data, and W·pattern of all places of a pattern cause.

    Each place with ln of what the density of the data there is multiplied by: its prior share; and
    where the data were put into another unit, the factor of each number beyond the offsets: the
    size of the offsets does not count, in whatever unit.
    """
    plan, machine, matrix = problem.plan, problem.model.machine, problem.matrix
    spare = len(matrix) - len(machine.parameter_names)
    places = tuple(cause.places(plan, machine))
    total = sum(map(cause.share, places))
    weights = {
        place: math.log(cause.share(place) / total) + spare * math.log(cause.unit_mm(place))
        for place in places
    }
    tried = tuple(place for place in places if cause.reversible(plan, place))
    others = tuple(place for place in places if not cause.reversible(plan, place))
    shown = cause.patterns(plan, places) if places else None
    patterns = None if shown is None else Places(matrix, shown)
    return Placed(cause, tried, 0, weights, others, patterns)


@dataclass(frozen=True, eq=False)
class Linearised(ReadOnly):
    """Effects of every candidate on these data, where the offsets-only model fits best."""

    white: Whitened
    candidates: Candidates
    noise: NoiseGrid
    extras: Mapping[str, Placed]  # by id, where each may act
    jacobian: Floats  # derivative of the data by the offsets at the fit to version 0, shape (k, 3)
    # Id of a broad cause → derivative by its parameters there, where it is absent, shape (k, p).
    jacobians: Mapping[str, Floats]
    # What is uncertain of the data in addition to noise and causes, as recorded.
    uncertain: tuple[Influence, ...]
    versions: Floats  # the data as recorded, then with each relabelling undone, (v, k) [mm]
    # Fitted to each version, (v, 3) [mm]; to the first weighted by what is uncertain, too.
    offsets: Floats
    residuals: Floats  # what is left then, shape (v, k) [mm]
    # False if something uncertain is left out because it shows, and may be named as a cause.
    complete: bool

    @classmethod
    def of(cls, white: Whitened, candidates: Candidates) -> Linearised:
        """Enumerate the places and fit the offsets to each version of the data.

        Raises UnusableResultError: no offsets fit them as recorded, or they hardly determine any.
        """
        noise = NoiseGrid.around(white.machine.instrument.noise_mm, white.texture)
        places = white.places(candidates.extras)
        # Faults of the record put right, where the data can express it, and the gauge shows
        # readings in that unit.
        undone = [
            (placed.cause, place)
            for placed in places
            if placed.cause.exchanges
            for place in placed.tried
            if placed.cause.unit_mm(place) in (1.0, white.unit_mm)
        ]
        units = np.array([cause.unit_mm(place) for cause, place in undone])
        right = white.relabelled(white.data, *undone) * units[:, None]
        versions = np.vstack([white.data, right])
        fit = require_optimum(white.problem, white.fit_versions(versions))
        # A relabelling that no offsets fit did not happen.
        possible = [key for key, fits in zip(undone, fit.converged[1:], strict=True) if fits]
        extras, first = dict[str, Placed](), 1
        for placed in places:
            if placed.cause.exchanges:
                tried = tuple(place for cause, place in possible if cause is placed.cause)
                placed, first = replace(placed, tried=tried, first=first), first + len(tried)
            extras[placed.cause.id] = placed
        offsets, broad, left = fit.offsets_mm[0], candidates.broad, fit.residuals_mm[0]
        require_travel(white.problem, offsets)
        uncertain = list(white.uncertain(offsets))
        if white.raw:
            offsets = white.optimum(uncertain, offsets)
            left = white.data - white.problem.predict(offsets)
        _, slopes = differentiate_absent(white.problem.model, offsets, white.plan, broad)
        columns, ends = white.matrix @ np.hstack(slopes), np.cumsum([s.shape[1] for s in slopes])
        jacobian, *jacobians = np.split(columns, ends[:-1], axis=1)
        by_cause = {cause.id: slope for cause, slope in zip(broad, jacobians, strict=True)}
        complete = True
        for number, influence in enumerate(uncertain):
            if influence.source in by_cause:
                shown = unexplained(jacobian, influence.columns)
                if np.linalg.norm(shown) > noise.stated:
                    # What offsets imitate stays uncertain.
                    columns, complete = influence.columns - shown, False
                    uncertain[number] = replace(influence, columns=columns)
        rows = fit.converged
        return cls(
            white=white,
            candidates=candidates,
            noise=noise,
            extras=extras,
            jacobian=jacobian,
            jacobians=by_cause,
            uncertain=tuple(uncertain),
            versions=versions[rows],
            offsets=np.vstack((offsets, fit.offsets_mm[1:]))[rows],
            residuals=np.vstack((left, fit.residuals_mm[1:]))[rows],
            complete=complete,
        )

    @property
    def scales(self) -> Mapping[float, float]:
        """Scales of the sizes of a base, as multiples of its tolerances, and their shares."""
        return self.white.machine.tolerance_scales

    @cached_property
    def usual(self) -> Mapping[float, float]:
        """Scales up to `BESIDE`, and shares: two causes of any size follow nearly any pattern."""
        few = {scale: share for scale, share in self.scales.items() if scale <= BESIDE}
        return {scale: share / sum(few.values()) for scale, share in few.items()}

    @cached_property
    def seen(self) -> Floats:
        """`shown` where the offsets-only model fits best, shape (k, b) [mm]."""
        return read_only(self.shown(self.uncertain, self.jacobian))

    def shown(self, uncertain: Iterable[Influence], jacobian: Floats) -> Floats:
        """Influences on the data that show, in as few columns as tell them, (k, b) [mm].

        A local shape is part of the noise. What the offsets, of derivatives (k, 3), imitate changes
        no evidence, and what stays far below the noise none that matters.
        """
        carried = self.white.side_by_side(one for one in uncertain if not one.local)
        left, size, _ = np.linalg.svd(unexplained(jacobian, carried), full_matrices=False)
        kept = size > UNSEEN * self.noise.stated
        return np.asarray(left[:, kept] * size[kept])

    def lists(self, shown: Floats) -> Bools:
        """Return which columns (k, v, q) can follow a listed cause at one of its places, (v,)."""
        axes, size, _ = np.linalg.svd(shown.swapaxes(0, 1), full_matrices=False)
        axes = axes * (size > ROUNDING * size[:, :1])[:, None]
        flat, made = axes.swapaxes(0, 1).reshape(len(shown), -1), np.zeros(len(axes), np.bool_)
        for places in (p.patterns for p in self.extras.values() if p.patterns is not None):
            match = (places.products(flat) ** 2).reshape(len(axes), -1, len(places)).sum(axis=1)
            made |= np.any(match > ALIKE**2 * places.power, axis=1)
        broad = np.hstack([shown[:, 0, :0], *self.jacobians.values()])
        match = ((axes.swapaxes(-1, -2) @ broad) ** 2).sum(axis=1)
        return np.asarray(made | np.any(match > ALIKE**2 * (broad**2).sum(axis=0), axis=1))

    def columns(self, base: Sequence[Cause]) -> Floats:
        """Derivatives by the offsets and the parameters of a base, shape (k, 3 + p)."""
        return np.concatenate([self.jacobian, *(self.jacobians[cause.id] for cause in base)], 1)

    @cached_property
    def _stds(self) -> Mapping[str, Sequence[Floats]]:
        """Plausible sizes of the parameters of each broad cause, by choice of its shares."""
        machine, broad = self.white.machine, self.candidates.broad
        return {
            cause.id: [cause.prior_std(machine, k) for k in range(len(cause.shares) or 1)]
            for cause in broad
        }

    def sizes(self, base: Sequence[Cause], scale: float = 1.0, choice: int = 0) -> Floats:
        """Plausible sizes of the same unknowns, shape (3 + p,), internal units.

        Those of the parameters are `scale` times the tolerances; `choice` is among their shares.
        """
        stds = [scale * self._stds[cause.id][choice if cause.shares else 0] for cause in base]
        return np.concatenate([np.full(self.jacobian.shape[1], OFFSETS_MM), *stds])
