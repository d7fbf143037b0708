"""Readings in memory: from values, and some of those that there are."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import GaugePlan


def readings_of(
    machine: Machine, plan: GaugePlan, value: Floats, path: str = "made.csv"
) -> Readings:
    """Readings (n,) [mm] as a file would give them."""
    return Readings(
        plan=plan,
        value=value,
        cycle=plan.cycles,
        posture=tuple(str(machine.posture_at(d) or f"{d:g}") for d in plan.displacement.tolist()),
        line=np.arange(2, len(plan) + 2),
        timed=True,
        source=Source(path, "0" * 64),
    )


def some(readings: Readings, chosen: Ints) -> Readings:
    """Some of the readings (indices in any order, or a mask); set-ups are renumbered."""
    index = np.arange(len(readings))[chosen]
    return replace(
        readings,
        plan=readings.plan.subset(index),
        value=readings.value[index],
        cycle=readings.cycle[index],
        posture=tuple(readings.posture[i] for i in index),
        temperature=readings.temperature[index],
        gauge=tuple(readings.gauge[i] for i in index),
        note=tuple(readings.note[i] for i in index),
        line=readings.line[index],
    )
