"""The readings so far and the one to come, as arrays for the live checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.effects import Effect
from orthoglide_cal.estimation.forecast import Forecast, forecast
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan
from orthoglide_cal.session.doubts import MODEL_DOUBTS
from orthoglide_cal.session.events import Questioned, Taken
from orthoglide_cal.session.record import segment
from orthoglide_cal.session.state import State
from orthoglide_cal.session.steps import Step, plan_of

# Pairs of repeats needed before their scatter may replace the gauge's stated repeatability.
_ENOUGH = 9


@dataclass(frozen=True, eq=False)
class History:
    """What is known when a reading arrives.

    Attributes:
        steps: those measured, in time order, then the step that is asked for (n + 1 in all).
        value: readings of the first n, shape (n,) [mm].
        forecast: model of 2·(n + 1) readings: these, and the same as they would be if the two
            gauges of each leg were exchanged (`exchanged_row`).
        doubted: shape (n,); readings that were kept although questioned; nothing is concluded
            from them.
        fresh: shape (n + 1,); not 0 where such a reading began the comparison anew.
        setup: set-up of each reading, shape (n + 1,).
        settled: doubts about whole legs that were answered already, with the step from which on.
        partner: set-up of the other gauge of the same leg, shape (n + 1,); −1 without one.
    """

    steps: tuple[Step, ...]
    value: Floats
    forecast: Forecast
    doubted: np.ndarray
    fresh: Ints
    setup: Ints
    partner: Ints
    settled: frozenset[tuple[str, int]]

    @property
    def step(self) -> Step:
        """The step that is asked for."""
        return self.steps[-1]

    @property
    def past(self) -> Ints:
        """Indices of the readings that the next one is compared with."""
        return np.flatnonzero(~self.doubted)

    def exchanged_row(self, index: int) -> int:
        """Row of the forecast for reading `index` taken by the other gauge of its leg."""
        return index + len(self.steps)

    def repeats(self) -> list[int]:
        """Earlier readings of the same cell and gauge set-up, in time order."""
        return [i for i in self.series() if self.steps[i].cell == self.step.cell]

    def series(self) -> list[int]:
        """Earlier readings by the same gauge in the same set-up, in time order."""
        return [i for i in self.past.tolist() if self.setup[i] == self.setup[-1]]


def history(
    state: State,
    steps: Sequence[Step],
    machine: Machine,
    step: Step,
    minutes: float,
    effects: Sequence[Effect] = (),
) -> History:
    """Everything that the checks of a reading at `step` need.

    Args:
        state: the session before it.
        steps: all steps of the session.
        machine: nominal machine.
        step: the one that is asked for.
        minutes: time of the reading since the session began.
        effects: causes accepted for this machine.
    """
    numbered = {item.number: item for item in steps}
    taken = [(number, item) for number, item in state.in_time() if number != step.number]
    order = [numbered[number] for number, _ in taken] + [step]
    ranks = [item.rank for _, item in taken] + [state.count]
    times = [item.take.minutes for _, item in taken] + [minutes]
    value = np.array([item.take.value_mm for _, item in taken], dtype=np.float64)
    takes = [item.take for _, item in taken]
    # A reading that showed that its stand was moved is right: only the zero before it is not.
    doubted = np.array(
        [
            _is_doubted(item.take, numbered) and (number, item.rank) not in state.moved
            for number, item in taken
        ],
        dtype=bool,
    )
    settled = frozenset(
        (take.doubt, take.about) for take in takes if isinstance(take, Questioned) and take.about
    )
    fresh = _fresh(order, doubted)
    places = [
        (*item.series, segment(state, steps, item, rank) or 0, int(anew))
        for item, rank, anew in zip(order, ranks, fresh, strict=True)
    ]
    setup = np.unique(np.array(places), axis=0, return_inverse=True)[1].reshape(-1)
    partner = _partners(order, setup)
    plan = replace(plan_of(order, times), setup=setup)
    sigma = max(machine.gauge.noise_mm, _scatter(order, setup, value))
    both = _with_exchanged(plan, partner)
    model = forecast(machine, both, effects, np.tile(fresh, 2), sigma)
    return History(tuple(order), value, model, doubted, fresh, setup, partner, settled)


def _partners(order: Sequence[Step], setup: Ints) -> Ints:
    """The set-up in which the other gauge of the same leg was read last; −1 without one."""
    last = {(s.setup, s.leg, s.stand): int(k) for s, k in zip(order, setup, strict=True)}
    others = [last.get((s.setup, s.leg, 1 - s.stand), -1) for s in order]
    return np.array(others, dtype=np.intp)


def _with_exchanged(plan: Plan, partner: Ints) -> Plan:
    """The plan followed by itself with the gauges of each leg exchanged."""
    doubled = {item.name: np.tile(getattr(plan, item.name), 2) for item in fields(plan)}
    n = len(plan)
    paired = partner >= 0
    doubled["direction"][n:][paired] = (3 - plan.leg - plan.direction)[paired]
    doubled["setup"][n:][paired] = partner[paired]
    return Plan(**doubled)


def _is_doubted(take: Taken, numbered: Mapping[int, Step]) -> bool:
    """Kept although it did not fit; a doubt about an earlier set-up says nothing of this one."""
    if not isinstance(take, Questioned) or take.doubt not in MODEL_DOUBTS:
        return False
    return not take.about or numbered[take.about].setup == numbered[take.step].setup


def _fresh(order: Sequence[Step], doubted: np.ndarray) -> Ints:
    """Numbers the readings of a series anew after each doubtful reading that was kept."""
    begun: dict[tuple[int, int], int] = {}
    fresh = np.zeros(len(order), dtype=np.intp)
    for index, step in enumerate(order):
        fresh[index] = begun.get(step.series, 0)
        if index < len(doubted) and doubted[index]:
            begun[step.series] = index + 1
    return fresh


def _scatter(order: Sequence[Step], setup: Ints, value: Floats) -> float:
    """Standard deviation of a reading from successive repeats; the median forgives blunders."""
    last: dict[tuple[object, ...], float] = {}
    jumps = []
    for index, reading in enumerate(value.tolist()):
        cell = (order[index].cell, int(setup[index]))
        if cell in last:
            jumps.append(abs(reading - last[cell]))
        last[cell] = reading
    if len(jumps) < _ENOUGH:
        return 0.0
    return 1.4826 * float(np.median(jumps)) / float(np.sqrt(2.0))
