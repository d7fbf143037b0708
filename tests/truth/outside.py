"""Effects that stand in no list: the honest answer to them is `unexplained`.

Each is drawn with a size; `scale` enlarges it, so that a caller can insist on a clear one.
"""

from collections.abc import Callable

import numpy as np

from .forward import Disturbance
from .machines import Gauge
from .plan import SETUPS, Plan

Rng = np.random.Generator
Draw = Callable[[Plan, Gauge, Rng, float], Disturbance]


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def screw_period(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """A ball screw's error repeats with its lead: a sine of the position of one carriage."""
    motion = np.zeros((plan.count, 3))
    carriage = int(rng.integers(3))
    amplitude = scale * rng.uniform(0.05, 0.15)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    motion[:, carriage] = amplitude * np.sin(
        2.0 * np.pi * plan.indicated[:, carriage] / 20.0 + phase
    )
    return Disturbance.of(plan, motion=motion)


def leg_bending(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """A leg bends with the square of its displacement, across in both directions."""
    leg = int(rng.integers(3))
    contact = np.zeros(plan.count)
    for setup, (i, _) in enumerate(SETUPS):
        if i == leg:
            bend = _sign(rng) * rng.uniform(0.05, 0.15) * scale
            contact += (plan.setup == setup) * bend * (plan.displacement / 100.0) ** 2
    return Disturbance.of(plan, contact=contact)


def room_breathing(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """The room's temperature swings: the actuator zeros follow a sine in time."""
    period = rng.uniform(2.5, 6.0)
    swing = np.sin(2.0 * np.pi * plan.minutes / period + rng.uniform(0.0, 2.0 * np.pi))
    return Disturbance.of(plan, motion=scale * swing[:, None] * rng.uniform(0.02, 0.1, size=3))


def plunger_hysteresis(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """Sticky gauges lag behind the motion of their plungers."""
    return Disturbance.of(plan, hysteresis=scale * rng.uniform(0.02, 0.06))


def scattered_misreads(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """Four to six small misreadings, scattered over the session."""
    contact = np.zeros(plan.count)
    for row in rng.choice(plan.count, size=int(rng.integers(4, 7)), replace=False):
        contact[row] = _sign(rng) * rng.uniform(0.03, 0.08) * scale
    return Disturbance.of(plan, contact=contact)


def noisy_leg(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """Something is loose at one leg: its readings scatter several times more."""
    leg = int(rng.integers(3))
    extra = scale * rng.uniform(4.0, 8.0) * gauge.sigma * rng.normal(size=plan.count)
    return Disturbance.of(plan, contact=extra * (plan.leg == leg))


def warm_start(plan: Plan, gauge: Gauge, rng: Rng, scale: float) -> Disturbance:
    """A spindle is switched on: one or more zeros step and settle exponentially."""
    begin = rng.uniform(0.1, 0.8) * plan.minutes[-1]
    settle = rng.uniform(1.0, 2.5)
    rise = 1.0 - np.exp(-np.maximum(plan.minutes - begin, 0.0) / settle)
    sizes = rng.normal(size=3)
    sizes *= scale * rng.uniform(0.1, 0.3) / np.linalg.norm(sizes)
    return Disturbance.of(plan, motion=rise[:, None] * sizes)


OUTSIDE: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        screw_period, leg_bending, room_breathing, plunger_hysteresis, scattered_misreads,
        noisy_leg, warm_start,
    )
}  # fmt: skip
