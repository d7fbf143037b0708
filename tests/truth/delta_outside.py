"""Effects on a printer's touches that stand in no list: the honest answer is `unexplained`.

Each is drawn with a size; `scale` enlarges it, so that a caller can insist on a clear one.
"""

from dataclasses import replace

import numpy as np

from .delta import Delta, DeltaSession, Disturb, Layout, Truth, grain, make_delta_session
from .delta_separation import GRAIN, delta_clear
from .plan import Floats, frozen

Rng = np.random.Generator


def knocked_probe(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """The probe is knocked, and sits higher or lower from then on."""
    when = rng.uniform(0.2, 0.8) * minutes[-1]
    size = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.15)
    return truth, size * (minutes > when)


def warm_start(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """A heater is switched on: the probe's height moves, and settles."""
    begin = rng.uniform(0.1, 0.6) * minutes[-1]
    settle = rng.uniform(0.05, 0.15) * minutes[-1]
    size = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.15)
    return truth, size * (1.0 - np.exp(-np.maximum(minutes - begin, 0.0) / settle))


def room_breathing(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """A bed heater switches on and off: its plate rises and falls."""
    period = rng.uniform(0.2, 0.5) * minutes[-1]
    swing = np.sin(2.0 * np.pi * minutes / period + rng.uniform(0.0, 2.0 * np.pi))
    return truth, rng.uniform(0.02, 0.06) * swing


def scattered_misreads(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """Dirt under four to six touches."""
    wrong = np.zeros(len(minutes))
    rows = rng.choice(len(minutes), size=int(rng.integers(4, 7)), replace=False)
    wrong[rows] = rng.choice([-1.0, 1.0], size=len(rows)) * rng.uniform(0.1, 0.3, size=len(rows))
    return truth, wrong


def eccentric_pulley(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
    """A pulley runs out of true: its carriage follows a sine of its height.

    On one height that is the same as a wavy bed.
    """
    pulleys = np.zeros((3, 2))
    pulleys[rng.integers(3)] = rng.uniform(0.05, 0.15), rng.uniform(0.0, 2.0 * np.pi)
    return replace(truth, pulleys=frozen(pulleys)), np.zeros(len(minutes))


DELTA_OUTSIDE: dict[str, tuple[Disturb, int]] = {
    disturb.__name__: (disturb, 3 if disturb is eccentric_pulley else 1)
    for disturb in (knocked_probe, warm_start, room_breathing, scattered_misreads, eccentric_pulley)
}
"""Each with the number of heights at which it can be told from a bed."""


def clear_delta_outside(
    seed: int, machine: Delta, layout: Layout, outside: str, tries: int = 60
) -> DeltaSession:
    """Redraw, each time 10 % larger, until the effect stands clear of everything listed.

    Raises:
        RuntimeError: the effect cannot be made clear.
    """
    bumps = machine.texture, GRAIN

    def enlarged(scale: float) -> Disturb:
        def disturb(truth: Truth, minutes: Floats, rng: Rng) -> tuple[Truth, Floats]:
            truth, contact = DELTA_OUTSIDE[outside][0](truth, minutes, rng)
            return replace(truth, pulleys=frozen(truth.pulleys * [scale, 1.0])), scale * contact

        return disturb

    for attempt in range(tries):
        disturb = enlarged(1.1 ** min(attempt, 20))
        session = make_delta_session(
            seed * tries + attempt, machine, (), layout, bumps, grain, (outside, disturb)
        )
        if delta_clear(session):
            return session
    raise RuntimeError(f"{outside} does not stand out on {machine.name} with {layout}")
