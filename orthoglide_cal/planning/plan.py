"""A plan: what sessions will give, what limits them, which causes they distinguish, what is best.

A plan holds at the parameters that are plausible before anything is measured, with the gauge's
stated noise and the degrees of freedom that the readings will have. On average it is what `solve`
prints once they are there.

A kind of machine that measures itself offers layouts, ways to spread its readings; the best is the
quickest that distinguishes what hides behind each other in the usual ones. Every other kind is
measured by protocols, and the best design takes the fewest readings for its U.
"""

import math
from bisect import bisect_left
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import product
from typing import Any, Literal

import numpy as np
from pydantic import Field, computed_field
from scipy.special import ndtr

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.budget import (
    Budget,
    Contribution,
    Scatter,
    budget_of,
    fixed_influences,
    influences,
)
from orthoglide_cal.estimation.gaussian import condition, shrinking, unexplained, whiten_shared
from orthoglide_cal.estimation.solution import Method, pose_plan, require_rank
from orthoglide_cal.inference.data import Candidates, Placed, Whitened
from orthoglide_cal.inference.evidence import UNIT, Gaussian
from orthoglide_cal.inference.hypothesis import pattern_density
from orthoglide_cal.inference.result import NextMeasurement
from orthoglide_cal.losses import DISMISSED, STILL_OPEN
from orthoglide_cal.model.machine import Influence, Machine, Origin, Suspicion
from orthoglide_cal.model.model import Cause, Model, Place, Stage, differentiate_absent
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.workspace import error_after
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    GuidedSession,
    MeasuringProtocol,
    Order,
    gauge_moves,
    timed_plan,
)
from orthoglide_cal.schema import Minutes, Schema
from orthoglide_cal.words import counted

# Repeats that are shown in addition to those asked for.
SHOWN_CYCLES = (1, 2, 3, 4, 6, 10)
_DIFFERENCES = Method.TWELVE, Method.TWELVE_LINEAR, Method.SIX, Method.SIX_LINEAR
# Every method that can be fed with the readings of a protocol.
METHODS: Mapping[MeasuringProtocol, tuple[Method, ...]] = {
    MeasuringProtocol.DOUBLE: (Method.READINGS, *_DIFFERENCES),
    MeasuringProtocol.SINGLE: (Method.READINGS, Method.SINGLE, Method.SINGLE_SEQUENTIAL),
    MeasuringProtocol.BEST: (Method.READINGS,),
}
# More repeats hardly change what can be distinguished, but the time that it takes to say so.
MOST_COMPARED = 10
ROUNDING = 1e-9

# A cause whose trace is smaller than this cannot be seen, nor two be distinguished [σ].
TRACE_SIGMA = 1.0
# The scatter of readings: what their number averages.
AVERAGED = frozenset({Origin.NOISE, Origin.RESOLUTION})
TINY = 1e-18  # mm²
_USUAL = GuidedSession()


class SessionForecast(Schema):
    """The forecast of a `Layout`, or of a session like it."""

    model: Model = Field(exclude=True)
    plan: Plan = Field(exclude=True)
    session: GuidedSession | None = Field(None, exclude=True)  # None for a layout
    name: str = Field(serialization_alias="layout")  # of a session its protocol
    what: str
    method: Method = Method.READINGS  # by which its readings are solved
    cycles: int = 1  # repeats of its postures
    gauge_moves: int = 0  # how often a stand is put to another place
    minutes: Minutes
    gauge_at: float | None = None  # along the leg; None for a layout, or for several places
    postures_mm: tuple[float, ...] = ()  # displacements, in their order

    @computed_field
    @property
    def readings(self) -> int:
        return len(self.plan)

    @cached_property
    def budget(self) -> Budget:
        """Uncertainty of the parameters; raises UnusableResultError where they are undetermined."""
        model, plan, gauge = self.model, self.plan, self.model.machine.instrument
        uncertain = _plausible_influences(model, plan)
        estimator = estimator_for(model, plan, uncertain, self.method)
        dof = len(plan) - plan.setups - len(estimator)
        scatter = Scatter(gauge.noise_mm, float(dof)) if dof > 0 else None
        both = (*uncertain, *fixed_influences(model, np.zeros(len(estimator)), plan))
        return budget_of(estimator, gauge, scatter, both, plan.precision)

    @computed_field
    @cached_property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Each parameter, in its unit: u from scatter, u and U of all, whether determined."""
        machine = self.model.machine
        scatter = [part.std for part in self.budget.contributions if part.source in AVERAGED]
        columns = {
            "unit": machine.parameter_units,
            "noise_std": np.sqrt(np.sum(np.square(scatter), axis=0)).tolist(),
            "std": self.budget.std_mm.tolist(),
            "expanded": self.budget.expanded_mm.tolist(),
            "determined": machine.determined(self.budget.expanded_mm),
        }
        named = zip(machine.parameter_names, zip(*columns.values(), strict=True), strict=True)
        return {name: dict(zip(columns, row, strict=True)) for name, row in named}

    @computed_field(description="what the scatter of the readings leaves of each length")
    @property
    def noise_std_mm(self) -> dict[str, float]:
        return lengths(self.model, [row["noise_std"] for row in self.parameters.values()])

    @computed_field(description="U of each length")
    @cached_property
    def expanded_mm(self) -> dict[str, float]:
        return lengths(self.model, self.budget.expanded_mm.tolist())

    @computed_field
    @cached_property
    def tool_mm(self) -> float | None:
        """k·u of the tool at the worst place of the workspace, with what causes leave there."""
        with suppress(UsageError):
            after = error_after(self.model, self.budget.covariance_mm2, self.budget.k)[1]
            return float(after.max())
        return None

    @computed_field
    @cached_property
    def rivals_sigma(self) -> float | None:
        """Between the causes that hide behind each other on this kind of machine [standard
        deviations]; None if it has none or one of the two cannot be."""
        pairs, _ = separations(self.model, self.plan, self.model.machine.rivals)
        return min(pairs.values(), default=None)

    @property
    def chance(self) -> float:
        """Probability that its readings dismiss the wrong one of the two."""
        sigma = max(self.rivals_sigma or 0.0, TINY)  # log odds are σ²/2, and as uncertain as σ
        return float(ndtr(sigma / 2.0 + math.log(DISMISSED) / sigma))

    @property
    def worst_mm(self) -> float:
        return max(self.expanded_mm.values())

    @cached_property
    def floor(self) -> Budget | None:
        """The budget without the scatter of the readings; None if nothing is left of it."""
        left = self.budget.without(AVERAGED).contributions
        parts = tuple(part for part in left if np.any(np.square(part.std) > TINY))
        return Budget(parts) if parts else None


def lengths(model: Model, values: Sequence[float]) -> dict[str, float]:
    """Name → value of those calibrated parameters that are lengths; of p values."""
    machine = model.machine
    named = zip(machine.parameter_names, machine.parameter_units, values, strict=True)
    return {name: value for name, unit, value in named if unit == "mm"}


def estimator_for(
    model: Model, plan: Plan, uncertain: Sequence[Influence], method: Method = Method.READINGS
) -> Floats:
    """Derivatives of the parameters by n readings, (p, n), by a method that they can feed.

    `uncertain` acts on them in addition to noise. Raises UnusableResultError.
    """
    problem = pose_plan(plan, model, method.uses)
    require_rank(problem)
    if method is Method.READINGS:
        columns = np.hstack([influence.columns for influence in uncertain])
        ratio = problem.matrix @ columns / model.machine.instrument.noise_mm
        problem = problem.weighted(shrinking(ratio))
    # The slope hardly depends on the offsets: near zero every method is a linear one.
    return np.asarray(method.estimator(problem) @ problem.matrix)


@lru_cache(maxsize=128)
def _plausible_influences(model: Model, plan: Plan) -> tuple[Influence, ...]:
    """Influences on these readings: their squares are the means over plausible parameters."""
    points = model.machine.linearization_points
    share = 1.0 / np.sqrt(len(points))
    return tuple(
        replace(influence, columns=share * np.hstack([*influence.columns]))
        for influence in influences(model, points, plan)
    )


# The same sessions are asked for by number of cycles, by target and by comparison.
@lru_cache(maxsize=128)
def forecast(
    model: Model, session: GuidedSession = _USUAL, method: Method = Method.READINGS
) -> SessionForecast:
    """Forecast a session, as `measure` guides it, by a method that its readings can feed."""
    steps = session.steps(model.machine)
    plan, minutes = timed_plan(steps)
    places = {step.cell.gauge_at for step in steps}
    return SessionForecast(
        model=model,
        plan=plan,
        session=session,
        name=session.protocol,
        what=f"{session.protocol}, {counted(session.cycles, 'cycle')}",
        method=method,
        cycles=session.cycles,
        gauge_moves=gauge_moves(steps),
        minutes=minutes,
        gauge_at=places.pop() if len(places) == 1 else None,
        postures_mm=tuple(dict.fromkeys(step.cell.displacement for step in steps)),
    )


def fewest_cycles(
    model: Model, session: GuidedSession, wanted_mm: float, method: Method = Method.READINGS
) -> SessionForecast | None:
    """The shortest session of this kind that leaves no U larger than wanted, if there is one."""

    def at(cycles: int) -> SessionForecast:
        return forecast(model, session.changed(cycles=cycles), method)

    # More cycles never leave a larger U.
    numbers = range(1, MOST_CYCLES + 1)
    fewest = 1 + bisect_left(numbers, True, key=lambda cycles: at(cycles).worst_mm <= wanted_mm)
    return at(fewest) if fewest in numbers else None


def separations(
    model: Model, plan: Plan, among: Collection[str] | None = None
) -> tuple[dict[tuple[str, str], float], dict[str, float]]:
    """Distances between causes of plausible size, typically (root mean square) [σ].

    Ids of every two that a diagnosis of such readings would try → the smaller one of their two
    directions, nearest first; and id → from nothing wrong, those of the machine first.

    A cause of plausible size changes the readings; a rival explains them as well as it can, at its
    best place and with whatever sizes, offsets, gauge zeros and influences suit it. What it then
    costs more than the truth itself, squared residuals over the noise and squared sizes over the
    plausible ones, is the squared separation in standard deviations, of a model that is linear
    around plausible offsets. `among` are ids to look at; None for all.
    """
    if among is not None and not among:
        return {}, {}  # without a simulation
    white, points = Whitened.of_plan(plan, model), model.machine.linearization_points
    candidates = Candidates.of(model, ordered=True)
    extras = {one.cause.id: one for one in white.places(candidates.extras) if one.tried}
    possible: list[Cause] = [*candidates.broad, *(placed.cause for placed in extras.values())]
    asked = (cause for cause in possible if among is None or cause.id in among)
    # Of the machine first, then of the measurement.
    causes = tuple(sorted(asked, key=lambda cause: ([*Stage].index(cause.stage), cause.id)))
    total = np.zeros((len(causes), len(causes) + 1))
    if causes:
        every = np.concatenate([one.columns for one in white.uncertain(points)], axis=-1)
        for offsets, carried in zip(points, every, strict=True):
            total += _margins(white, offsets, causes, extras, carried) / len(points)
    sigma = np.sqrt(np.minimum(total[:, :-1], total[:, :-1].T)).tolist()
    ids = [cause.id for cause in causes]
    pairs = {(ids[b], ids[a]): sigma[a][b] for a in range(len(ids)) for b in range(a)}
    trace = dict(zip(ids, np.sqrt(total[:, -1]).tolist(), strict=True))
    # What is as far apart but for rounding stays in the order of the causes.
    return dict(sorted(pairs.items(), key=lambda pair: round(pair[1], 9))), trace


def _margins(
    white: Whitened,
    offsets: Floats,
    causes: Sequence[Cause],
    extras: Mapping[str, Placed],
    carried: Floats,
) -> Floats:
    """Mean cost of each rival, and of nothing wrong, above each truth's own, (c, c + 1).

    On a machine with these offsets, with what one plausible size of each influence adds to the
    whitened data, `carried` (k, u) [mm]. What offsets, zeros and influences imitate is taken out.
    """
    plan, machine, noise = white.plan, white.machine, white.machine.instrument.noise_mm
    broad = [cause for cause in causes if cause.id not in extras]
    readings, (slope, *slopes) = differentiate_absent(white.problem.model, offsets, plan, broad)
    # What one unit of each cause adds, at each place where it may be one of many, (places, n, p).
    columns = {cause.id: one[None] for cause, one in zip(broad, slopes, strict=True)}
    patterns = {id: placed.patterns.patterns for id, placed in extras.items() if placed.patterns}
    columns |= {id: one.columns(slice(None)).T[..., None] for id, one in patterns.items()}
    contrasts = white.matrix @ np.eye(len(plan)) / noise
    leaves = unexplained(*whiten_shared(carried / noise, white.matrix @ slope, contrasts))

    def steadiness(unit: Floats) -> Floats:
        """Cost of scatter that is too small or too large by a factor of 1/unit, shape (r,)."""
        spare = len(leaves) - len(offsets)
        return np.asarray(spare * (unit**-2.0 - 1.0 + 2.0 * np.log(unit)))

    # What each cause of plausible size adds, at each place and with each choice of signs, (n, r)
    # [mm], the unit in which it is written down, (r,) [mm], and the share of each, (r,).
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
    left, steady, changed = leaves @ changes, steadiness(units), readings + changes.T

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

    One unit of each parameter adds columns (places, k, p). Named parameters that cannot be negative
    may be zero; whole numbers cost what they are rarer than the most frequent ones.
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

    Without their common sign, which changes no square, and terms smaller than the first.
    """
    first = (1.0,) * (len(cause.names) if cause.positive else 1)
    small = (0.0,) * (cause.unknowns - cause.freedom)
    others = product((1.0, -1.0), repeat=cause.freedom - len(first))
    signs = np.array([(*first, *rest, *small) for rest in others])
    return signs * (cause.millimetres(machine) if cause.counts else cause.prior_std(machine))


@dataclass(frozen=True)
class Target:
    """U that every offset is to reach, and the cycles that it takes, if any number does."""

    expanded_mm: float
    reached: bool
    cycles: int | None


class Pair(Schema):
    """Two causes, and how far apart readings typically put them [σ]."""

    causes: tuple[str, str]
    sigma: float


class MeasurementPlan(Schema):
    """The forecast of a session, and of other ways to measure; its dump is `plan --json`."""

    model: Model = Field(exclude=True)
    # As was asked for, or as long as the target takes.
    chosen: SessionForecast = Field(exclude=True)
    # What more readings leave besides their scatter; None if that is nothing.
    floor: Budget | None = Field(exclude=True)
    # Plungers that leave their bar in this session, or nearly; None if all stay.
    bar_warning: Suspicion | None = Field(default=None, exclude=True)
    schema_version: Literal[1] = 1
    simulated: bool = Field(False, description="the readings that there are already")
    machine: str  # its name
    protocol: str  # of a machine that has layouts the name of one
    gauges: int | None = None  # that are read side by side; None without any
    cycles: int
    target: Target | None = None
    by_cycles: tuple[SessionForecast, ...]  # other numbers of cycles, fewest first, or each layout
    noise_mm: float  # by which one reading scatters
    assumed_mm: float | None  # how far each parameter is taken to be off, if that matters
    now_mm: float | None = None  # largest U that the data have already; None without any
    budget: tuple[Contribution, ...]
    k: float  # of the budget, U/u
    # U that no number of readings reduces, its largest source, and cycles that stand for any.
    limits: Mapping[str, object]
    # Every protocol and method with the fewest cycles and moves for no larger U, if any.
    compare: tuple[SessionForecast, ...] = ()
    # What its readings, or those of `MOST_COMPARED` cycles, can distinguish; nearest first.
    separation: tuple[Pair, ...]
    invisible: tuple[str, ...]  # causes that leave no trace
    trace: dict[str, float]  # of the others: how far each is from nothing wrong [σ]
    # The fewest readings, or what distinguishes rivals; None where nothing is to be gained.
    design: SessionForecast | None
    next: tuple[NextMeasurement, ...] = ()  # in addition to existing data, best first


def measurement_plan(
    chosen: SessionForecast,
    target_mm: float | None = None,
    following: tuple[NextMeasurement, ...] = (),
    details: bool = True,
) -> MeasurementPlan:
    """The plan of the session that was chosen, perhaps for a U to reach, and other ways to measure.

    `following` is what to measure in addition to existing data, best first; without `details` only
    the best design is compared. Raises UnusableResultError: nothing determines the parameters.
    """
    model, session, floor, plan = chosen.model, chosen.session, chosen.floor, chosen.plan
    machine, compare, (shown, design) = model.machine, list[SessionForecast](), _offered(model)
    if session is not None:
        numbers = sorted({*SHOWN_CYCLES, session.cycles})
        shown = tuple(forecast(model, session.changed(cycles=n)) for n in numbers)
        floor = forecast(model, session.changed(cycles=MOST_CYCLES)).floor
        compared = session.changed(cycles=min(session.cycles, MOST_COMPARED))
        plan, worst_mm = forecast(model, compared).plan, chosen.worst_mm * (1.0 + ROUNDING)
        # Two gauges move as rarely in either order.
        order = Order.FEWEST_MOVES if session.stands == 1 else session.order
        best = session.changed(protocol=MeasuringProtocol.BEST, order=order)
        # For the same U; with as many cycles where no number reaches it.
        design = fewest_cycles(model, best, worst_mm) or forecast(model, best)
        for protocol, methods in METHODS.items() if details else ():
            way = session.changed(protocol=protocol, order=Order.FEWEST_MOVES)
            compare += filter(None, map(partial(fewest_cycles, model, way, worst_mm), methods))
    cycles = chosen.cycles if target_mm is not None and chosen.worst_mm <= target_mm else None
    pairs, trace = separations(model, plan)
    size = float(np.sqrt(np.mean(machine.linearization_points**2)))
    return MeasurementPlan(
        model=model,
        chosen=chosen,
        floor=floor,
        bar_warning=machine.bar_warning(chosen.plan),
        machine=machine.name,
        protocol=chosen.name,
        gauges=session and session.stands,
        cycles=chosen.cycles,
        target=None if target_mm is None else Target(target_mm, cycles is not None, cycles),
        by_cycles=shown,
        noise_mm=machine.instrument.noise_mm,
        assumed_mm=size or None,
        budget=chosen.budget.contributions,
        k=chosen.budget.k,
        limits={
            "expanded_mm": floor and lengths(model, floor.expanded_mm.tolist()),
            "source": floor and floor.largest.source,
            "cycles": session and MOST_CYCLES,
        },
        compare=tuple(compare),
        separation=tuple(Pair(causes=ids, sigma=sigma) for ids, sigma in pairs.items()),
        invisible=tuple(id for id, sigma in trace.items() if sigma < TRACE_SIGMA),
        trace={id: sigma for id, sigma in trace.items() if sigma >= TRACE_SIGMA},
        design=design,
        next=following,
    )


def chosen_session(
    model: Model,
    session: GuidedSession | None = None,
    target_mm: float | None = None,
    layout: str | None = None,
) -> SessionForecast:
    """Forecast the layout of that name, or the session, with the cycles that the target takes.

    Of layouts the best where none is named. Raises UsageError: the machine has no such session.
    """
    offered, design = _offered(model)
    if offered:
        if session is not None or target_mm is not None:
            raise UsageError("A printer has no gauges and no protocol.", "Name a --layout instead.")
        names = {forecast.name: forecast for forecast in offered}
        name = layout or (design or offered[0]).name
        if name not in names:
            raise UsageError(f"There is no layout {name!r}.", f"Choose one of {', '.join(names)}.")
        return names[name]
    model.machine.check_guided()
    if layout is not None:
        raise UsageError("--layout is for printers.", "Name a --protocol instead.")
    session = session or _USUAL
    shortest = target_mm and fewest_cycles(model, session, target_mm)
    return shortest or forecast(model, session)


@lru_cache(maxsize=8)
def _offered(model: Model) -> tuple[tuple[SessionForecast, ...], SessionForecast | None]:
    """All layouts, and that of least expected loss; none of a machine that follows protocols."""
    machine, best, least = model.machine, None, math.inf
    for layout in machine.distinguishing_layouts():
        design = SessionForecast(model=model, **layout._asdict())
        if layout.minutes >= least or design.rivals_sigma is None:
            break
        loss = layout.minutes + (1.0 - design.chance) * STILL_OPEN
        if loss < least:
            best, least = design, loss
    offered = (SessionForecast(model=model, **one._asdict()) for one in machine.layouts())
    return (*offered, *filter(None, [best])), best
