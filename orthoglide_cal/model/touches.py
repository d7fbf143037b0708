"""Synthetic touches of a printer's bed: what a firmware would store of a machine that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.model.kinds.layouts import MINUTES_PER_TOUCH, REACH
from orthoglide_cal.model.kinds.linear_delta import DeltaMachine
from orthoglide_cal.model.kinds.probe_plan import ProbePlan
from orthoglide_cal.model.machine import Gauge
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.plan import Floats

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
# The gap closes by all but some per cent in each step.
_STEPS = 8


def bed_plan(
    machine: DeltaMachine, places: int, heights: Sequence[float] = (0.0,), cycles: int = 1
) -> ProbePlan:
    """Touches spread evenly over the bed, row by row to and fro; all of one height, then the next.

    Args:
        machine: its bed.
        places: how many, at least 1.
        heights: of what lies under the probe [mm].
        cycles: repeats of all of them.
    """
    number = np.arange(places)
    away = REACH * machine.bed_radius_mm * np.sqrt((number + 0.5) / places)
    at = np.stack((away * np.cos(_GOLDEN * number), away * np.sin(_GOLDEN * number)), axis=1)
    rows = max(round(places**0.5), 1)
    row = np.floor((at[:, 1] / away.max() + 1.0) / 2.0 * rows)
    at = at[np.lexsort((np.where(row % 2, -at[:, 0], at[:, 0]), row))].round(2)
    surface = np.tile(np.repeat(np.asarray(heights, dtype=np.float64), places), cycles)
    place = np.column_stack((np.tile(at, (len(heights) * cycles, 1)), surface))
    order = np.arange(len(place))
    return ProbePlan(
        order=order,
        hours=np.asarray(MINUTES_PER_TOUCH * order / 60.0, dtype=np.float64),
        place=place,
        other=place,
        surface=surface,
        distance=np.zeros(len(place), dtype=np.bool_),
        weight=np.ones(len(place)),
    )


def synthetic_touches(
    model: Model, plan: ProbePlan, parameters: Floats, rng: np.random.Generator, gauge: Gauge
) -> Readings:
    """What a probe would show on a machine with these parameters.

    Args:
        model: the machine and whatever is wrong with it or with the measurement.
        plan: touches to make.
        parameters: what each real value exceeds the controller's by, shape (6,) [mm, deg].
        rng: source of noise and of the bed's local shape.
        gauge: the probe; its repeatability is the noise, a resolution of 0 means no rounding.

    Raises:
        UnreachableError, SingularError: a place that this machine cannot reach.
    """
    machine, n = model.machine, len(plan)
    local = model.kind.local(machine, plan).columns @ rng.standard_normal(n)
    touched = plan
    for _ in range(_STEPS):
        # The nozzle is sent lower or higher until it touches.
        height = plan.surface + simulate(model, parameters, touched)
        touched = replace(touched, place=np.column_stack((plan.place[:, :2], height)))
    shown = height + local + gauge.repeatability_mm * rng.standard_normal(n)
    step = gauge.resolution_mm
    shown = np.rint(shown / step) * step if step > 0.0 else shown
    return Readings(
        plan=touched,
        value=np.round(shown, 6) - plan.surface,
        cycle=np.ones(n, dtype=np.intp),
        posture=("",) * n,
        temperature=np.full(n, np.nan),
        gauge=("",) * n,
        note=("",) * n,
        line=np.arange(2, n + 2),
        timed=True,
        source=Source("simulate", ""),
    )
