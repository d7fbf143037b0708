"""Synthetic sessions in memory, shared by the tests of report, verify and export."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.data import (
    MachineModel,
    SessionReading,
    SessionRecord,
    default_machine,
    write_session,
)
from orthoglide_cal.effects import Effect
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings, Source
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import double_posture
from orthoglide_cal.simulation import simulate


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


def recorded(measured: Readings, machine: Machine, **given: Any) -> SessionRecord:
    """A session file's record of readings; `given` are further keys of the file."""
    plan = measured.plan
    readings = tuple(
        SessionReading(
            leg=AXES[plan.leg[k]],
            direction=AXES[plan.direction[k]],
            posture=measured.posture[k],
            reading_mm=float(measured.value[k]),
            cycle=int(measured.cycle[k]),
            seq=k + 1,
            minutes=float(plan.hours[k] * 60.0),
            note=measured.note[k],
        )
        for k in range(len(measured))
    )
    return SessionRecord(machine=MachineModel.from_machine(machine), readings=readings, **given)


# When each session of the shared history was finished, and the offsets active in it.
HISTORY = (
    ("2026-01-12T09:30:00+00:00", (0.0, 0.0, 0.0)),
    ("2026-02-10T09:30:00+00:00", (-0.527, 0.595, -1.748)),
    ("2026-04-20T09:30:00+00:00", (-0.527, 0.595, -1.748)),
    ("2026-10-30T09:30:00+00:00", (-0.527, 0.595, -1.748)),
)
# True offsets at the first session, and their drift from one session to the next [mm].
FIRST, DRIFT = (-0.53, 0.59, -1.76), (0.03, 0.0, 0.0)


def write_history(folder: Path) -> None:
    """Four sessions of one machine that was adjusted after the first, and other files."""
    prototype = default_machine()
    for k, (finished, active) in enumerate(HISTORY):
        machine = replace(prototype, offsets_mm=active)
        left = np.array(FIRST) + k * np.array(DRIFT) - np.array(active)
        record = recorded(session(left.tolist(), 100 + k), machine, finished=finished)
        write_session(record, folder / f"session-{k}.yaml")
    (folder / "notes.yaml").write_text("title: no session\n")
    (folder / "broken.yaml").write_text("machine: {}\nreadings:\n- {leg: q}\n")
    os.utime(folder / "broken.yaml", (0, 0))
