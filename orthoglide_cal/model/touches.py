"""Synthetic touches of a printer's bed: what a firmware would store of a machine that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.model.instrument import Gauge
from orthoglide_cal.model.layouts import REACH, layout_of, mixed, rings
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.probe_plan import ProbePlan

# The gap closes by all but some per cent in each step.
_STEPS = 8


def bed_plan(
    machine: LinearDelta, places: int, heights: Sequence[float] = (0.0,), cycles: int = 1
) -> ProbePlan:
    """Touches spread evenly over the bed in a mixed order; all of one height, then the next.

    Args:
        machine: its bed.
        places: how many, at least 1.
        heights: of what lies under the probe [mm].
        cycles: repeats of all of them.
    """
    at = mixed(rings(places, REACH * machine.bed_radius_mm))
    parts = [(at, height) for height in heights] * cycles
    plan: ProbePlan = layout_of("simulated", "", parts).plan
    return plan


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
    n = len(plan)
    local = LinearDelta.require(model.machine).local_shape(plan).columns @ rng.standard_normal(n)
    touched = plan
    for _ in range(_STEPS):
        # The nozzle is sent lower or higher until it touches.
        height = plan.surface + simulate(model, parameters, touched)
        touched = replace(touched, place=np.column_stack((plan.place[:, :2], height)))
    shown = height + local + gauge.repeatability_mm * rng.standard_normal(n)
    step = gauge.resolution_mm
    shown = np.rint(shown / step) * step if step > 0.0 else shown
    value = np.round(shown, 6) - plan.surface
    return bed_readings(touched, value, Source("simulate", ""), np.arange(2, n + 2), timed=True)


def bed_readings(
    plan: ProbePlan,
    value: Floats,
    source: Source,
    line: Ints,
    *,
    cycle: Ints | None = None,
    note: tuple[str, ...] | None = None,
    timed: bool = False,
    remarks: tuple[str, ...] = (),
) -> Readings:
    """Touches and distances as readings, without what only gauges have.

    Args:
        plan: of n of them.
        value: shape (n,) [mm].
        source, line, timed, remarks: as of all readings.
        cycle: repeat of the same touch, shape (n,); None for the first of each.
        note: None for none.
    """
    n = len(plan)
    return Readings(
        plan=plan,
        value=value,
        cycle=np.ones(n, dtype=np.intp) if cycle is None else cycle,
        posture=("",) * n,
        temperature=np.full(n, np.nan),
        gauge=("",) * n,
        note=note or ("",) * n,
        line=line,
        timed=timed,
        source=source,
        remarks=remarks,
    )
