"""A plan: what a session will give, what limits it, and what other ways there are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

from orthoglide_cal.estimation import Method
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.model import Cause, Model
from orthoglide_cal.planning.bar import BarWarning, bar_warning
from orthoglide_cal.planning.design import Design, design_of, readings_needed
from orthoglide_cal.planning.expected import (
    Expected,
    Session,
    expected,
    fewest_cycles,
    tool_error_mm,
)
from orthoglide_cal.planning.separation import TRACE_SIGMA, Separations, separations
from orthoglide_cal.planning.steps import MOST_CYCLES, MeasuringProtocol, Order

# Repeats that are shown beside those asked for.
SHOWN_CYCLES = (1, 2, 3, 4, 6, 10)
# Every method that can be fed with the readings of a protocol.
METHODS: Mapping[MeasuringProtocol, tuple[Method, ...]] = MappingProxyType(
    {
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
)
# More repeats hardly change what can be told apart, but the time that it takes to say so.
MOST_COMPARED = 10
ROUNDING = 1e-9


@dataclass(frozen=True)
class Comparison:
    """A way to measure beside the one that was asked for.

    Attributes:
        protocol, method: which.
        same_cycles: as many cycles as were asked for, with the fewest moves of a gauge.
        as_sure: the same with as many as make no U larger than the session's largest; None if no
            number does.
    """

    protocol: MeasuringProtocol
    method: Method
    same_cycles: Expected
    as_sure: Expected | None


@dataclass(frozen=True)
class GivenUp:
    """What the best design shows less well than the usual protocol, for the same U.

    Attributes:
        cause: a cause.
        rival: what it is to be told from; None for nothing wrong.
        usual_sigma, best_sigma: how far the two are apart [σ].
    """

    cause: Cause
    rival: Cause | None
    usual_sigma: float
    best_sigma: float


@dataclass(frozen=True, eq=False)
class Prospect:
    """What a session will give, before a reading is taken.

    Attributes:
        model: the machine, its gauge and its accepted causes.
        chosen: the session: as long as was asked for, or as long as the target takes.
        stands: gauges that are read side by side.
        target_mm: U that every offset is to reach; None if nobody said.
        reached: whether the session reaches it; True without one.
    """

    model: Model
    chosen: Expected
    stands: int
    target_mm: float | None
    reached: bool

    @property
    def protocol(self) -> MeasuringProtocol:
        """How the readings are taken."""
        return self.chosen.session.protocol

    @property
    def cycles(self) -> int:
        """Repeats of the postures on each leg."""
        return self.chosen.session.cycles

    @cached_property
    def by_cycles(self) -> tuple[Expected, ...]:
        """The same with other numbers of cycles, fewest first."""
        numbers = sorted({*SHOWN_CYCLES, self.cycles})
        return tuple(
            expected(self.model, self.protocol, n, Method.READINGS, self.stands) for n in numbers
        )

    @cached_property
    def floor(self) -> Budget | None:
        """What `MOST_CYCLES` leave beside the scatter of the readings; None if that is nothing.

        Less than what this session leaves beside it: more readings tell more of what else is
        uncertain.
        """
        return expected(self.model, self.protocol, MOST_CYCLES, Method.READINGS, self.stands).floor

    @cached_property
    def bar_warning(self) -> BarWarning | None:
        """Plungers that leave their bar in this session, or nearly; None if all stay on it."""
        return bar_warning(self.chosen.session.plan, self.model.machine)

    def tool_mm(self, found: Expected) -> float:
        """How far the tool may be off at the worst place of the workspace [mm]."""
        return tool_error_mm(self.model, found.budget)

    @cached_property
    def compared(self) -> tuple[Comparison, ...]:
        """Every protocol with every method, for the U that this session gives."""
        wanted = float(self.chosen.expanded_mm.max()) * (1.0 + ROUNDING)
        found = []
        for protocol, methods in METHODS.items():
            for method in methods:
                same = expected(self.model, protocol, self.cycles, method, self.stands)
                as_sure = fewest_cycles(self.model, protocol, method, self.stands, wanted)
                few = self._fewest_moves(same), as_sure and self._fewest_moves(as_sure)
                found.append(Comparison(protocol, method, *few))
        return tuple(found)

    def _fewest_moves(self, found: Expected) -> Expected:
        """The same readings in the order that moves the gauges least, which leaves U as it is."""
        way = found.session
        order = Order.FEWEST_MOVES
        session = Session.of(self.model, way.protocol, way.cycles, self.stands, order)
        return replace(found, session=session)

    @cached_property
    def separations(self) -> Separations:
        """Which causes its readings, or as many as `MOST_COMPARED` cycles, can tell apart."""
        return self._separations(self.protocol, self.cycles)

    def _separations(self, protocol: MeasuringProtocol, cycles: int) -> Separations:
        session = Session.of(self.model, protocol, min(cycles, MOST_COMPARED), self.stands)
        return separations(self.model, session.plan)

    @cached_property
    def design(self) -> Design:
        """Postures and gauge place of the best design."""
        return design_of(self.model.machine)

    @cached_property
    def best(self) -> Expected:
        """The best design for the same U; with as many cycles where no number reaches it."""
        way = next(way for way in self.compared if way.protocol is MeasuringProtocol.BEST)
        return way.as_sure or way.same_cycles

    @cached_property
    def share(self) -> float:
        """Readings of the best design for each of the usual protocol, for the same noise."""
        usual = Session.of(self.model, MeasuringProtocol.DOUBLE, self.cycles).plan
        best = self.design.plan(self.cycles)
        return readings_needed(self.model, best) / readings_needed(self.model, usual)

    @cached_property
    def given_up(self) -> tuple[GivenUp, ...]:
        """What the best design no longer shows: causes first, then pairs, largest loss first."""
        usual = self._separations(MeasuringProtocol.DOUBLE, self.cycles)
        best = self._separations(MeasuringProtocol.BEST, self.best.session.cycles)
        lost = [*_traces(usual, best), *_pairs(usual, best)]
        return tuple(sorted(lost, key=lambda each: (each.rival is not None, -each.usual_sigma)))


def _traces(usual: Separations, best: Separations) -> Iterator[GivenUp]:
    """Causes that show less."""
    for cause, before, after in zip(usual.causes, usual.trace, best.trace, strict=True):
        if after < before and (cause.timed or after < TRACE_SIGMA <= before):
            yield GivenUp(cause, None, float(before), float(after))


def _pairs(usual: Separations, best: Separations) -> Iterator[GivenUp]:
    """Pairs that can be told apart no longer."""
    after = {(a.id, b.id): sigma for a, b, sigma in best.pairs}
    for a, b, sigma in usual.pairs:
        if after[a.id, b.id] < TRACE_SIGMA <= sigma:
            yield GivenUp(a, b, sigma, after[a.id, b.id])


def prospect(
    model: Model,
    protocol: MeasuringProtocol = MeasuringProtocol.DOUBLE,
    cycles: int = 3,
    stands: int = 2,
    target_mm: float | None = None,
) -> Prospect:
    """What a session will give.

    Args:
        model: the machine, its gauge and its accepted causes.
        protocol, cycles, stands: how it is measured, see `Session.of`.
        target_mm: U that every offset is to reach, in place of a number of cycles.

    Raises:
        RankDeficientError: such readings will not determine the offsets.
    """
    if target_mm is not None:
        found = fewest_cycles(model, protocol, Method.READINGS, stands, target_mm)
        if found is not None:
            return Prospect(model, found, stands, target_mm, True)
    found = expected(model, protocol, cycles, Method.READINGS, stands)
    reached = target_mm is None or float(found.expanded_mm.max()) <= target_mm
    return Prospect(model, found, stands, target_mm, reached)
