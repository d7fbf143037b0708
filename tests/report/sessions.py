"""Synthetic sessions in memory, shared by the tests of report, verify and export."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.data import default_machine
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings, Source
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import double_posture
from orthoglide_cal.simulation import Effect, simulate

NAMES = {0.0: "iso"}


def readings_of(machine: Machine, plan: Plan, value: Floats, path: str = "made.csv") -> Readings:
    """Readings as a file would give them; shape (n,) [mm]."""
    low, high = machine.joint_limits_mm
    names = {0.0: "iso", low: "min", high: "max"}
    seen: dict[tuple[int, ...], int] = {}
    cycle = []
    for key in zip(
        plan.setup.tolist(), plan.displacement.tolist(), plan.contact.tolist(), strict=True
    ):
        seen[key] = seen.get(key, 0) + 1
        cycle.append(seen[key])
    n = len(plan)
    return Readings(
        plan=plan,
        value=value,
        cycle=np.array(cycle),
        posture=tuple(names.get(d, f"{d:g}") for d in plan.displacement.tolist()),
        temperature=np.full(n, np.nan),
        gauge=("",) * n,
        note=("",) * n,
        line=np.arange(2, n + 2),
        timed=True,
        source=Source(path, "0" * 64),
    )


def session(
    offsets: Sequence[float],
    seed: int,
    machine: Machine | None = None,
    plan: Plan | None = None,
    effects: Sequence[Effect] = (),
    gain: float = 1.0,
) -> Readings:
    """A simulated session with noise, rounding and arbitrary gauge zeros.

    Args:
        offsets: true Δρ that the controller does not know [mm].
        gain: what the gauge shows for one millimetre.
    """
    machine = machine or default_machine()
    plan = plan or double_posture(machine)
    rng = np.random.default_rng(seed)
    signal = gain * simulate(machine, np.array(offsets, dtype=float), plan, effects)
    zeros = rng.uniform(0.5, 5.0, plan.setups)
    noisy = signal + zeros[plan.setup] + rng.normal(0.0, machine.gauge.repeatability_mm, len(plan))
    step = machine.gauge.resolution_mm
    return readings_of(machine, plan, np.round(noisy / step) * step)


def fine_gauge(machine: Machine) -> Machine:
    """The machine with a digital gauge of 1 µm."""
    return replace(
        machine, gauge=replace(machine.gauge, resolution_mm=0.001, repeatability_mm=0.003)
    )
