"""Synthetic readings: what would be written down, or stored, on a machine that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Instrument
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.probe_plan import REACH, ProbePlan, layout_of, mixed, rings
from orthoglide_cal.model.readings import GaugePlan

_STEPS = 8  # in each the gap between a nozzle and the bed closes by all but some per cent
ZERO_RANGE_MM = 1.0  # gauge zeros lie anywhere within this distance of the frame's origin


def written_down(
    signal: Floats, plan: GaugePlan, gauge: Instrument, rng: np.random.Generator
) -> Floats:
    """Readings (..., n) [mm] of gauges with arbitrary zeros, noise and a smallest step.

    Args:
        signal: what ideal gauges would read, shape (..., n) [mm].
        plan: n readings; those of one set-up share a zero.
        gauge: its repeatability is the noise; a resolution of 0 means no rounding.
        rng: source of zeros and noise.
    """
    zeros = rng.uniform(-ZERO_RANGE_MM, ZERO_RANGE_MM, (*signal.shape[:-1], plan.setups))
    noise = gauge.repeatability_mm * rng.standard_normal(signal.shape)
    return gauge.shown(signal + zeros[..., plan.setup] + noise)


def synthetic_session(
    model: Model,
    plan: GaugePlan,
    offsets: Floats,
    rng: np.random.Generator,
    gauge: Instrument | None = None,
) -> Readings:
    """One session on a machine with these joint offsets, of this plan.

    Args:
        model: the machine and whatever is wrong with it or with the measurement.
        offsets: Δρ, shape (3,) [mm].
        rng: source of zeros and noise.
        gauge: the machine's own if None.

    Raises:
        UnreachableError, SingularError: a posture that this machine cannot take.
    """
    machine, n = model.orthoglide, len(plan)
    signal = simulate(model, offsets, plan)
    values = written_down(signal, plan, machine.gauge if gauge is None else gauge, rng)
    return Readings(
        plan=plan,
        # Rounded again, because 3 · 0.01 is not 0.03.
        value=np.round(values, 9),
        cycle=plan.cycles,
        posture=tuple(str(machine.posture_at(d) or f"{d:g}") for d in plan.displacement.tolist()),
        line=np.arange(2, n + 2),
        timed=True,
        source=Source("simulate", ""),
    )


def bed_plan(
    machine: LinearDelta, places: int, heights: Sequence[float] = (0.0,), cycles: int = 1
) -> ProbePlan:
    """Touches spread evenly over the bed in a mixed order; all of one height, then the next.

    Args:
        heights: of what lies under the probe [mm].
        cycles: repeats of all of them.
    """
    at = mixed(rings(places, REACH * machine.bed_radius_mm))
    parts = [(at, height) for height in heights] * cycles
    return ProbePlan.require(layout_of("simulated", "", parts).plan)


def synthetic_probe_points(
    model: Model, plan: ProbePlan, parameters: Floats, rng: np.random.Generator, gauge: Instrument
) -> Readings:
    """What a probe would show on a machine with these parameters.

    Args:
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
    shown = gauge.shown(height + local + gauge.repeatability_mm * rng.standard_normal(n))
    value = np.round(shown, 6) - plan.surface
    return Readings(touched, value, np.arange(2, n + 2), timed=True, source=Source("simulate", ""))
