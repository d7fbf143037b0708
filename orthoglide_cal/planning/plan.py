"""A plan: what sessions will give, what limits them, which causes they distinguish, what is best.

A kind of machine that measures itself offers layouts, ways to spread its readings; they are
compared on equal terms, and the best is the quickest that distinguishes what hides behind each
other in the usual ones. Every other kind is measured by protocols: a session is compared with other
numbers of cycles, protocols and methods, and the best design takes the fewest readings for its U.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field, field_serializer

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Method
from orthoglide_cal.estimation.budget import Budget, BudgetTotal, Contribution, budget_lines
from orthoglide_cal.inference import NextMeasurement
from orthoglide_cal.model.machine import Suspicion
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import MARGIN
from orthoglide_cal.planning.design import design_of, readings_needed
from orthoglide_cal.planning.forecast import (
    SessionForecast,
    fewest_cycles,
    forecast,
    lengths,
    rivals_sigma,
    session_of,
)
from orthoglide_cal.planning.separation import TRACE_SIGMA, Separations, separations
from orthoglide_cal.planning.steps import CYCLES, MOST_CYCLES, MeasuringProtocol, Order
from orthoglide_cal.schema import Schema

# Repeats that are shown in addition to those asked for.
SHOWN_CYCLES = (1, 2, 3, 4, 6, 10)
# Every method that can be fed with the readings of a protocol.
METHODS: Mapping[MeasuringProtocol, tuple[Method, ...]] = {
    MeasuringProtocol.DOUBLE: (
        Method.READINGS,
        Method.TWELVE,
        Method.TWELVE_LINEAR,
        Method.SIX,
        Method.SIX_LINEAR,
    ),
    MeasuringProtocol.SINGLE: (Method.READINGS, Method.SINGLE, Method.SINGLE_SEQUENTIAL),
    MeasuringProtocol.BEST: (Method.READINGS,),
}
# More repeats hardly change what can be distinguished, but the time that it takes to say so.
MOST_COMPARED = 10
ROUNDING = 1e-9
# Causes that are separated by more than this are distinguished [standard deviations].
CERTAIN_SIGMA = 5.0


class Wanted(NamedTuple):
    """A wish what to measure; None where nothing is said."""

    protocol: MeasuringProtocol | None = None
    cycles: int | None = None
    stands: int = 2
    target_mm: float | None = None  # U that every offset is to reach, in place of `cycles`
    layout: str | None = None  # name of one of the machine's


@dataclass(frozen=True)
class Alternative:
    """A way to measure besides the one that was asked for, with the fewest moves of a gauge."""

    protocol: MeasuringProtocol
    method: Method
    same_cycles: SessionForecast  # as were asked for
    # With as many as make no U larger than the session's largest; None if no number does.
    same_expanded: SessionForecast | None


class BestDesign(SessionForecast):
    """The best session that is known: the fewest readings, or what distinguishes rivals."""

    causes: tuple[str, ...] = ()  # the rivals; empty for the fewest readings
    wanted_sigma: float | None = None
    reached: bool = True  # whether they are that far apart, or U is as wanted
    gauge_at: float | None = None  # along the leg
    margin: float | None = None  # share of the leg that the plungers keep from its joints
    postures_mm: tuple[float, ...] = ()
    share_of_readings: float | None = None  # of the usual protocol, for the same noise
    places_mm: tuple[dict[str, float], ...] = ()  # where a machine that measures itself goes


@dataclass(frozen=True)
class Target:
    """U that every offset is to reach, and the cycles that it takes, if any number does."""

    expanded_mm: float
    reached: bool
    cycles: int | None


class MeasurementPlan(Schema):
    """The forecast of a session, and of other ways to measure; its dump is `plan --json`.

    The floor is less than what the session leaves in addition to scatter: more readings say more
    about what else is uncertain.
    """

    model: Model = Field(exclude=True)
    # As was asked for, or as long as the target takes.
    chosen: SessionForecast = Field(exclude=True)
    # What more readings leave besides their scatter; None if that is nothing.
    floor: Budget | None = Field(exclude=True)
    # Which causes its readings, or as many as `MOST_COMPARED` cycles, can distinguish.
    apart: Separations = Field(exclude=True)
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
    budget: tuple[Contribution, ...]  # its dump also names what a line adds to each length
    total: BudgetTotal
    # What no number of readings reduces, its largest source, and the cycles that stand for any
    # number; None for nothing, or for a layout.
    limits: Mapping[str, object]
    compare: tuple[Alternative, ...] = ()  # every protocol with every method, for the same U
    separation: tuple[Mapping[str, object], ...]  # two causes, and sigma; nearest first
    invisible: tuple[str, ...]  # causes that leave no trace
    trace: dict[str, float]  # of the others: how far each is from nothing wrong [σ]
    pairs: int  # how many these others make
    alike: int  # of these pairs, how many cannot be distinguished
    design: BestDesign | None  # None where nothing is to be gained
    next: tuple[NextMeasurement, ...] = ()  # in addition to existing data, best first

    @field_serializer("budget")
    def _with_lengths(self, lines: tuple[Contribution, ...]) -> list[dict[str, object]]:
        stds = (lengths(self.model, line.std) for line in lines)
        return [{**line.model_dump(), "std_mm": std} for line, std in zip(lines, stds, strict=True)]


def measurement_plan(
    model: Model, wanted: Wanted, following: tuple[NextMeasurement, ...] = (), details: bool = True
) -> MeasurementPlan:
    """Forecast the session that is wanted, and other ways to measure.

    `following` is what to measure in addition to existing data, best first. Without `details` only
    the best design is compared with the session.

    Raises:
        UsageError: the machine has no such session.
        UnusableResultError: such readings will not determine the parameters.
    """
    machine, stands, compare = model.machine, wanted.stands, tuple[Alternative, ...]()
    if offer := _offered(model, wanted):
        chosen, shown, design = offer
        floor, most, plan = chosen.floor, None, chosen.plan
    else:
        chosen, most = chosen_session(model, wanted), MOST_CYCLES
        protocol, best = MeasuringProtocol(chosen.name), MeasuringProtocol.BEST
        numbers = sorted({*SHOWN_CYCLES, chosen.cycles})
        shown = tuple(forecast(model, protocol, n, Method.READINGS, stands) for n in numbers)
        floor = forecast(model, protocol, most, Method.READINGS, stands).floor
        plan = session_of(model, protocol, min(chosen.cycles, MOST_COMPARED), stands).plan
        ways = METHODS if details else {best: METHODS[best]}
        compare = tuple(_compared(model, chosen, stands, ways))
        design = _fewest_readings(model, chosen.cycles, compare[-1])
    target = None
    if wanted.target_mm is not None:
        reached = max(chosen.expanded_mm.values()) <= wanted.target_mm
        target = Target(wanted.target_mm, reached, chosen.cycles if reached else None)
    apart, (lines, total) = separations(model, plan), budget_lines(chosen.budget)
    seen, size = apart.visible, float(np.sqrt(np.mean(machine.linearization_points**2)))
    return MeasurementPlan(
        model=model,
        chosen=chosen,
        floor=floor,
        apart=apart,
        bar_warning=machine.bar_warning(chosen.plan),
        machine=machine.name,
        protocol=chosen.name,
        gauges=None if most is None else stands,
        cycles=chosen.cycles,
        target=target,
        by_cycles=shown,
        noise_mm=machine.instrument.noise_mm,
        assumed_mm=size or None,
        budget=lines,
        total=total,
        limits={
            "expanded_mm": floor and lengths(model, floor.expanded_mm.tolist()),
            "source": floor and floor.largest.source,
            "cycles": most,
        },
        compare=compare if details else (),
        separation=tuple({"causes": ids, "sigma": sigma} for ids, sigma in apart.pairs.items()),
        invisible=tuple(cause.id for cause in apart.invisible),
        trace=dict(zip([cause.id for cause in seen.causes], seen.trace.tolist(), strict=True)),
        pairs=len(seen.pairs),
        alike=sum(sigma < TRACE_SIGMA for sigma in seen.pairs.values()),
        design=design,
        next=following,
    )


def chosen_session(model: Model, wanted: Wanted) -> SessionForecast:
    """The layout that is wanted, or the session with the cycles that are, or that the target takes.

    Arguments and errors as of `measurement_plan`.
    """
    if offer := _offered(model, wanted):
        return offer[0]
    if wanted.layout is not None:
        raise UsageError("--layout is for printers.", "Name a --protocol instead.")
    protocol, method = wanted.protocol or MeasuringProtocol.DOUBLE, Method.READINGS
    if wanted.target_mm is not None:
        shortest = fewest_cycles(model, protocol, method, wanted.stands, wanted.target_mm)
        if shortest is not None:
            return shortest
    return forecast(model, protocol, wanted.cycles or CYCLES, method, wanted.stands)


def _compared(
    model: Model,
    chosen: SessionForecast,
    stands: int,
    ways: Mapping[MeasuringProtocol, Sequence[Method]],
) -> Iterator[Alternative]:
    """Each way, with as many cycles and for the same U; the best design comes last."""
    wanted = max(chosen.expanded_mm.values()) * (1.0 + ROUNDING)

    def fewest_moves(usual: SessionForecast) -> SessionForecast:
        """The same readings in the order that moves the gauges least, which leaves U as it is."""
        protocol = MeasuringProtocol(usual.name)
        session = session_of(model, protocol, usual.cycles, stands, Order.FEWEST_MOVES)
        return usual.changed(**session._asdict())

    for protocol, methods in ways.items():
        for method in methods:
            same = forecast(model, protocol, chosen.cycles, method, stands)
            as_sure = fewest_cycles(model, protocol, method, stands, wanted)
            yield Alternative(
                protocol, method, fewest_moves(same), as_sure and fewest_moves(as_sure)
            )


def _fewest_readings(model: Model, cycles: int, way: Alternative) -> BestDesign:
    """The best design for the same U; with as many cycles where no number reaches it."""
    session, (postures, gauge_at) = way.same_expanded or way.same_cycles, design_of(model.machine)
    usual, best = (
        session_of(model, protocol, cycles).plan
        for protocol in (MeasuringProtocol.DOUBLE, MeasuringProtocol.BEST)
    )
    return BestDesign(
        **{name: getattr(session, name) for name in SessionForecast.model_fields},
        reached=way.same_expanded is not None,
        gauge_at=gauge_at,
        margin=MARGIN,
        postures_mm=postures,
        share_of_readings=readings_needed(model, best) / readings_needed(model, usual),
    )


def _offered(
    model: Model, wanted: Wanted
) -> tuple[SessionForecast, tuple[SessionForecast, ...], BestDesign | None] | None:
    """Which layout is chosen, all that there are, and the best; None where protocols are followed.

    Chosen is the one that is wanted, else the best, or without one the quickest.
    """
    layouts = model.machine.layouts()
    if not layouts:
        model.machine.check_guided()
        return None
    if wanted != Wanted(layout=wanted.layout):
        raise UsageError("A printer has no gauges and no protocol.", "Name a --layout instead.")
    best = _distinguishing(model)
    usual = (SessionForecast.of(model, layout) for layout in layouts)
    offered = (*usual,) if best is None else (*usual, best)
    names = {session.name: session for session in offered}
    name = wanted.layout or (offered[0] if best is None else best).name
    if name not in names:
        raise UsageError(f"There is no layout {name!r}.", f"Choose one of {', '.join(names)}.")
    return names[name], offered, best


def _distinguishing(model: Model) -> BestDesign | None:
    """The quickest layout that distinguishes the rivals, or the one that does it best."""
    best, most = None, 0.0
    for layout in model.machine.distinguishing_layouts():
        sigma = rivals_sigma(model, layout.plan)
        if sigma is None:
            return None
        if sigma > most:
            best, most = layout, sigma
        if sigma >= CERTAIN_SIGMA:
            break
    if best is None:
        return None
    return BestDesign.of(
        model,
        best,
        causes=model.machine.rivals,
        wanted_sigma=CERTAIN_SIGMA,
        reached=most >= CERTAIN_SIGMA,
        places_mm=tuple(
            dict(zip(("x", "y", "z"), place, strict=True)) for place in best.plan.spots.tolist()
        ),
    )
