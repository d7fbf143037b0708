"""Synthetic sessions: what a technician would write down on a machine that is known."""

from __future__ import annotations

from collections import Counter

import numpy as np

from orthoglide_cal.model.instrument import Gauge
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import GaugePlan

# Gauge zeros lie anywhere within this distance of the frame's origin [mm].
ZERO_RANGE_MM = 1.0


def written_down(
    signal: Floats,
    plan: GaugePlan,
    gauge: Gauge,
    rng: np.random.Generator,
    sessions: int | None = None,
) -> Floats:
    """Readings of gauges with arbitrary zeros, noise and a smallest step.

    Args:
        signal: what ideal gauges would read, shape (..., n) [mm].
        plan: n readings; those of one set-up share a zero.
        gauge: its repeatability is the noise; a resolution of 0 means no rounding.
        rng: source of zeros and noise.
        sessions: how many; None for one without an axis of its own.

    Returns:
        Shape (sessions, ..., n), or (..., n) [mm].
    """
    shape = signal.shape if sessions is None else (sessions, *signal.shape)
    zeros = rng.uniform(-ZERO_RANGE_MM, ZERO_RANGE_MM, (*shape[:-1], plan.setups))
    values = signal + zeros[..., plan.setup] + gauge.repeatability_mm * rng.standard_normal(shape)
    step = gauge.resolution_mm
    return np.asarray(np.rint(values / step) * step if step > 0.0 else values)


def synthetic_session(
    model: Model,
    plan: GaugePlan,
    offsets: Floats,
    rng: np.random.Generator,
    gauge: Gauge | None = None,
) -> Readings:
    """One session on a machine with these joint offsets.

    Args:
        model: the machine and whatever is wrong with it or with the measurement.
        plan: readings to take.
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
        cycle=np.array(_cycles(plan)),
        posture=tuple(str(machine.posture_at(d) or f"{d:g}") for d in plan.displacement.tolist()),
        temperature=np.full(n, np.nan),
        gauge=("",) * n,
        note=("",) * n,
        line=np.arange(2, n + 2),
        timed=True,
        source=Source("simulate", ""),
    )


def _cycles(plan: GaugePlan) -> list[int]:
    """Repeats of the same set-up, posture and contact, counted in time from 1."""
    seen: Counter[tuple[float, ...]] = Counter()
    cycles = [0] * len(plan)
    for i in plan.in_time.tolist():
        key = (plan.setup[i], plan.displacement[i], plan.contact[i], *(s[i] for s in plan.state))
        seen[key] += 1
        cycles[i] = seen[key]
    return cycles
