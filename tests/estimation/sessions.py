"""Measured data for tests: synthetic readings, differences, subsets."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.machine import Gauge, Machine
from orthoglide_cal.measured import Differences, Readings, Source
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import NAMES, ideal_plan, reduction, synthetic_session
from orthoglide_cal.simulation import simulate

NOWHERE = Source("test", "")
OFFSETS = np.array([0.83, -1.46, 0.57])
PERFECT = Gauge(resolution_mm=0.0, range_mm=10.0, revolution_mm=1.0, repeatability_mm=0.0)


def readings(
    machine: Machine,
    plan: Plan,
    offsets: Floats = OFFSETS,
    seed: int | None = 1,
    effects: tuple[Effect, ...] = (),
) -> Readings:
    """A session with the machine's own gauge, or with a perfect one if `seed` is None."""
    rng = np.random.default_rng(0 if seed is None else seed)
    gauge = PERFECT if seed is None else machine.gauge
    session = synthetic_session(machine, plan, offsets, rng, effects, gauge)
    if seed is None:
        # Not rounded at all: zeros of a few figures keep the differences exact.
        zeros = np.round(np.linspace(-0.9, 0.8, plan.setups), 1)
        exact = simulate(machine, offsets, plan, effects) + zeros[plan.setup]
        session = replace(session, value=exact)
    return session


def differences(kind: str, machine: Machine, offsets: Floats = OFFSETS) -> Differences:
    """Exact differences of one kind."""
    plan = ideal_plan(kind, machine)
    matrix = reduction(kind, NAMES[kind], machine, plan)
    return Differences(kind, NAMES[kind], matrix @ simulate(machine, offsets, plan), NOWHERE)


def some(data: Differences, *names: str) -> Differences:
    """Only the named differences."""
    index = [data.names.index(name) for name in names]
    return Differences(data.kind, names, data.value[index], data.source)
