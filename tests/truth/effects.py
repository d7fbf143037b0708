"""The thirteen listed causes as the truth draws them: where, how large, and what they spoil.

Machine causes (and the bars) live in the condition vector of `forward`. The others live in the
measurement: they are added to the signals, or they change what the technician wrote down.
"""

from dataclasses import dataclass, field

import numpy as np

from .forward import MACHINE_CAUSES, PARTS, SIZE
from .machines import TOLERANCES, Gauge
from .plan import AXIS_NAMES, SETUPS, Floats, Plan

MEASUREMENT_CAUSES = (
    "gauge_drift", "stand_shift", "gauge_slip", "misread", "sign_flip", "swapped_gauges"
)  # fmt: skip
CAUSES = (*MACHINE_CAUSES, *MEASUREMENT_CAUSES)


@dataclass(frozen=True)
class Effect:
    """One hidden cause."""

    id: str
    where: str = ""
    """Human-readable place, e.g. `x.y` (leg.direction), `x.y#7` (reading with index 7 of all)."""
    parameters: tuple[float, ...] = ()
    """In the contract's units; machine causes in the order of `forward.PARTS`."""
    setup: int | None = None  # index into SETUPS
    row: int | None = None
    """First reading concerned (stand_shift) or the only one (gauge_slip, misread)."""
    leg: int | None = None  # leg (swapped_gauges)
    extra: dict[str, float] = field(default_factory=dict)


Times = tuple[float, float]
"""Least and greatest length of a cause's parameters together, in tolerances."""
USUAL: Times = (1.0, 3.0)


def sizes(rng: np.random.Generator, count: int, tolerance: float, times: Times) -> Floats:
    """A random direction with a length of so many tolerances."""
    values = rng.normal(size=count)
    return values / np.linalg.norm(values) * rng.uniform(*times) * tolerance


def _signed(rng: np.random.Generator, tolerance: float) -> float:
    """Either sign, one to four tolerances."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 4.0) * tolerance)


def draw_machine_cause(cause: str, rng: np.random.Generator, times: Times = USUAL) -> Effect:
    """Draw one cause of the machine or its bars."""
    tolerance = TOLERANCES[cause]
    if cause == "backlash":
        widths = np.abs(sizes(rng, 3, tolerance, times))
        lags = widths * rng.uniform(-0.5, 0.5, size=3)
        return Effect(cause, "machine", (*widths.tolist(), *lags.tolist()))
    part = PARTS[cause]
    values = sizes(rng, part.stop - part.start, tolerance, times)
    return Effect(cause, "machine", tuple(values.tolist()))


def draw_measurement_cause(cause: str, plan: Plan, rng: np.random.Generator) -> Effect:
    """Draw one cause of the contact or the record. A blunder's final size may await its digits."""
    setup = int(rng.integers(6))
    leg, direction = SETUPS[setup]
    name = f"{AXIS_NAMES[leg]}.{AXIS_NAMES[direction]}"
    if cause == "swapped_gauges":
        return Effect(cause, AXIS_NAMES[leg], leg=leg)
    if cause == "sign_flip":
        return Effect(cause, name, setup=setup)
    if cause == "gauge_drift":
        return Effect(cause, name, (_signed(rng, TOLERANCES[cause]),), setup=setup)
    rows, extra = np.flatnonzero(plan.setup == setup), {}
    row = int(rng.choice(rows[1:] if cause == "stand_shift" else rows))
    if cause == "gauge_slip":
        size = float(rng.choice([-1, 1]) * rng.choice([1, 1, 1, 2]))
    else:
        size = _signed(rng, TOLERANCES[cause])
    kind = rng.choice(["size", "digits", "mark"], p=[0.5, 0.25, 0.25]) if cause == "misread" else ""
    if kind == "mark":
        # The pointer is read from the wrong figured mark, or half a turn away.
        size = float(rng.choice([-1.0, 1.0]) * rng.choice([0.1, 0.2, 0.5]))
    elif kind == "digits":
        extra = {"digits": float(rng.integers(1, 3))}
    return Effect(cause, f"{name}#{row}", (size,), setup=setup, row=row, extra=extra)


def transposed(value: float, decimals: int, place: int) -> float:
    """The value with two neighbouring decimals exchanged, as a tired eye writes it.

    Args:
        value: reading, [mm].
        decimals: decimals the reading has.
        place: 1 exchanges the first and second decimal, 2 the second and third.
    """
    text = f"{abs(value):.{decimals}f}"
    dot = text.index(".")
    first = dot + min(place, decimals - 1)
    digits = list(text)
    digits[first], digits[first + 1] = digits[first + 1], digits[first]
    return float(np.copysign(float("".join(digits)), value))


def state_with(offsets: Floats, effects: tuple[Effect, ...]) -> Floats:
    """The condition vector, shape (30,), of a machine with these offsets [mm] and effects."""
    state = np.zeros(SIZE)
    state[PARTS["offsets"]] = offsets
    for effect in effects:
        if effect.id in PARTS:
            state[PARTS[effect.id]] = effect.parameters
    return state


def contact_shift(plan: Plan, effects: tuple[Effect, ...]) -> Floats:
    """What creeping and knocked stands add to the signals, shape (N,), [mm]."""
    shift = np.zeros(plan.count)
    for effect in effects:
        if effect.id == "gauge_drift":
            shift += _mine(plan, effect) * effect.parameters[0] * plan.hours
        elif effect.id == "stand_shift" and effect.row is not None:
            mine = plan.zero == plan.zero[effect.row]
            shift += mine * (np.arange(plan.count) >= effect.row) * effect.parameters[0]
    return shift


def _mine(plan: Plan, effect: Effect) -> np.ndarray:
    """Readings by the gauge that an effect has spoiled: it happened in the first sitting."""
    return np.asarray((plan.setup == effect.setup) & (plan.part == 0))


def write_down(plan: Plan, gauge: Gauge, shown: Floats, effects: tuple[Effect, ...]) -> Floats:
    """What stands in the record for what the gauges showed, shape (N,), [mm]."""
    written = shown.copy()
    for effect in effects:
        if effect.id == "gauge_slip":
            written[effect.row] += effect.parameters[0] * gauge.revolution
        elif effect.id == "misread":
            written[effect.row] += effect.parameters[0]
        elif effect.id == "sign_flip":
            written[_mine(plan, effect)] *= -1.0
        elif effect.id == "swapped_gauges":
            written = written[swapped_rows(plan, effect.leg)]
    return written


def swapped_rows(plan: Plan, leg: int | None) -> np.ndarray:
    """Row order after the two directions of a leg are exchanged at every posture, shape (N,)."""
    order = np.arange(plan.count)
    first, second = (np.flatnonzero(plan.setup == s) for s, (i, _) in enumerate(SETUPS) if i == leg)
    order[first], order[second] = second, first
    return order
