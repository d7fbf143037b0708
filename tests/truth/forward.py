"""What perfect gauges would read: from joints, rails, time and touched surfaces to signals.

A machine's condition is one vector of 30 numbers, so that many conditions are simulated at once
and derivatives are plain differences. Its parts are named by `PARTS`.
"""

from dataclasses import dataclass, replace

import numpy as np

from .machines import TOLERANCES, Machine
from .plan import Floats, Plan

PARTS: dict[str, slice] = {
    "offsets": slice(0, 3),  # mm, carriages x, y, z
    "axis_gap": slice(3, 6),  # mm, pairs xy, yz, zx
    "axis_squareness": slice(6, 9),  # mrad, pairs xy, yz, zx
    "leg_length": slice(9, 12),  # mm, legs x, y, z
    "encoder_scale": slice(12, 15),  # 1e-3, carriages
    "backlash": slice(15, 21),  # mm: three widths, then three lags before the first motion
    "thermal_drift": slice(21, 24),  # mm/h, carriages
    "bar_skew": slice(24, 30),  # mrad, in the order of SETUPS
}
SIZE = 30
MACHINE_CAUSES = tuple(part for part in PARTS if part != "offsets")
PAIRS = ((0, 1), (1, 2), (2, 0))


def prior_sd(part: str) -> Floats:
    """Plausible size of each number of a part, one standard deviation, in the part's units."""
    sd = np.full(PARTS[part].stop - PARTS[part].start, TOLERANCES[part])
    if part == "backlash":
        sd[3:] = TOLERANCES[part] / np.sqrt(12.0)  # anywhere within a width of one tolerance
    return sd


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Something that is not in the list, as it acts in this session (see `outside`)."""

    motion: Floats  # added to the true joint positions, shape (N, 3), [mm]
    contact: Floats  # added to each signal, shape (N,), [mm]
    hysteresis: float = 0.0  # full width by which a plunger's reading lags behind its motion [mm]

    @staticmethod
    def of(
        plan: Plan,
        motion: Floats | float = 0.0,
        contact: Floats | float = 0.0,
        hysteresis: float = 0.0,
    ) -> "Disturbance":
        """What is not given is not disturbed."""
        n = plan.count
        return Disturbance(motion + np.zeros((n, 3)), contact + np.zeros(n), hysteresis)


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product along the first axis of arrays of shape (3, ...)."""
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])


def tool_from_carriages(carriages: Floats, legs: Floats, start: Floats, steps: int = 6) -> Floats:
    """Solve |P - B_i| = L_i for P near `start`, for many moments at once.

    A Newton step solves 2 (P - B_i) . dP = L_i^2 - |P - B_i|^2 by Cramer's rule. From within 5 mm
    the error after n steps is about 300 mm * (5/300)^(2^n); behind a step below 1e-7 mm it is below
    rounding.

    Args:
        carriages: B, shape (3 legs, 3 components, ...), [mm].
        legs: L, shape (3 legs, ...) or (3 legs, 1...), [mm].
        start: first guess of P, shape (3 components, ...), [mm].
        steps: Newton steps at most.

    Returns:
        P, shape (3 components, ...), [mm].
    """
    tool = np.broadcast_to(start, carriages.shape[1:]).copy()
    for _ in range(steps):
        spans = tool[None] - carriages
        excess = ((spans * spans).sum(axis=1) - legs * legs) / 2.0
        normals = [_cross(spans[(i + 1) % 3], spans[(i + 2) % 3]) for i in range(3)]
        volume = (spans[0] * normals[0]).sum(axis=0)
        step = (excess[0] * normals[0] + excess[1] * normals[1] + excess[2] * normals[2]) / volume
        tool -= step
        if np.abs(step).max() < 1e-7:
            break
    return tool


def _rails(states: Floats) -> tuple[Floats, Floats]:
    """Points and unit directions of the rails, each shape (3 rails, 3 components, S)."""
    count = states.shape[0]
    points = np.zeros((3, 3, count))
    ways = np.zeros((3, 3, count))
    gaps, angles = states[:, PARTS["axis_gap"]], states[:, PARTS["axis_squareness"]]
    for rail in range(3):
        ways[rail, rail] = 1.0
    for k, (first, second) in enumerate(PAIRS):
        across = 3 - first - second
        points[first, across] += gaps[:, k] / 2.0
        points[second, across] -= gaps[:, k] / 2.0
        ways[first, second] += angles[:, k] * 0.5e-3
        ways[second, first] += angles[:, k] * 0.5e-3
    ways /= np.sqrt((ways * ways).sum(axis=1, keepdims=True))
    return points, ways


def true_joints(plan: Plan, machine: Machine, states: Floats, motion: Floats) -> Floats:
    """True distance of each carriage along its rail, shape (3, S, N), [mm].

    Args:
        plan: N readings.
        machine: its leg length is the indicated isotropic joint value.
        states: shape (S, 30).
        motion: extra motion, shape (N, 3), [mm].
    """

    def each(values: Floats) -> Floats:
        return values.T[:, :, None]

    travel = (plan.indicated - machine.leg).T[:, None, :]
    signs = plan.approach.T[:, None, :]
    widths, lags = states[:, 15:18], states[:, 18:21]
    return (
        machine.leg
        + (1.0 + 1e-3 * each(states[:, PARTS["encoder_scale"]])) * travel
        + each(states[:, PARTS["offsets"]])
        - plan.entered.T[:, None, :]
        - each(widths) / 2.0 * signs
        - each(lags) * (signs == 0.0)
        + each(states[:, PARTS["thermal_drift"]]) * plan.hours
        + motion.T[:, None, :]
    )


def carriages_and_tool(
    plan: Plan, machine: Machine, states: Floats, motion: Floats
) -> tuple[Floats, Floats]:
    """Carriage centres, shape (3 legs, 3, S, N), and the tool, shape (3, S, N), [mm]."""
    points, ways = _rails(states)
    joints = true_joints(plan, machine, states, motion)
    carriages = points[..., None] + ways[..., None] * joints[:, None]
    legs = machine.leg + states[:, PARTS["leg_length"]].T[:, :, None]
    guess = np.zeros((3, 1, plan.count))
    guess[plan.leg, 0, np.arange(plan.count)] = plan.displacement
    return carriages, tool_from_carriages(carriages, legs, guess)


def _deflect(plan: Plan, signal: Floats, disturbance: Disturbance) -> Floats:
    """What sticking plungers and moved surfaces make of the signals, shape (S, N)."""
    out: Floats = signal + disturbance.contact
    if disturbance.hysteresis:
        for zero in range(plan.zero.max() + 1):
            rows = np.flatnonzero(plan.zero == zero)
            moves = np.sign(np.diff(out[:, rows], axis=1))
            out[:, rows[1:]] -= 0.5 * disturbance.hysteresis * moves
    return out


def signals(
    plan: Plan,
    machine: Machine,
    states: Floats,
    disturbance: Disturbance | None = None,
    misplaced: Floats | None = None,
) -> Floats:
    """Noise-free surface positions at the gauges for S conditions, without zeros.

    The gauge of leg i stands fixed at that place along axis i where the leg's middle (or another
    point, `gauge_at`) was when it was set up; it touches the straight line from carriage to tool
    there.

    Args:
        plan: N readings.
        machine: nominal dimensions.
        states: conditions, shape (S, 30), see `PARTS`.
        disturbance: something outside the list.
        misplaced: how far along the leg each set-up's gauge is from its place, one for each
            `zero`, [mm].

    Returns:
        Shape (S, N), [mm].
    """
    extra = Disturbance.of(plan) if disturbance is None else disturbance
    carriages, tool = carriages_and_tool(plan, machine, states, extra.motion)
    rows, axes = np.arange(plan.count), (plan.leg, plan.direction)
    foot_along, foot_across = (carriages[plan.leg, axis, :, rows].T for axis in axes)
    tool_along, tool_across = (tool[axis, :, rows].T for axis in axes)
    span = tool_along - foot_along
    gauge = (foot_along + plan.gauge_at * span)[:, plan.stand]
    if plan.displacement[plan.stand].any():
        # Some set-up has no reading at the isotropic posture to tell where its gauge stands.
        home, nothing = np.full((plan.count, 3), machine.leg), np.zeros(plan.count)
        there = replace(plan.rows(plan.stand), indicated=home, displacement=nothing)
        feet, tools = carriages_and_tool(there, machine, states, extra.motion[plan.stand])
        foot = feet[plan.leg, plan.leg, :, rows].T
        gauge = foot + plan.gauge_at * (tools[plan.leg, :, rows].T - foot)
    if misplaced is not None:
        # Towards the tool, which lies below the carriage on the leg's axis.
        gauge = gauge + (np.sign(span) * misplaced[plan.zero])
    share = (gauge - foot_along) / span
    slope = 1e-3 * states[:, PARTS["bar_skew"]][:, plan.setup] * (1.0 - 2.0 * plan.turned)
    surface = foot_across + share * (tool_across - foot_across) + slope * machine.leg * share
    return _deflect(plan, surface, extra)


def jacobian(plan: Plan, machine: Machine, state: Floats, step: float = 1e-3) -> Floats:
    """Derivatives of the signals by each number of a condition, shape (N, 30), central differences.

    The step is 1e-3 in every unit: truncation about (1e-3 / 300)^2, rounding about 1e-10.
    """
    moves = step * np.eye(SIZE)
    both = signals(plan, machine, np.concatenate((state + moves, state - moves)))
    return (both[:SIZE] - both[SIZE:]).T / (2.0 * step)
