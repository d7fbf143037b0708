"""The truth's neighbourhood as a linear model with free and penalised parameters.

Everything here is in units of the standard deviation of one reading. Zeros and offsets are free:
their span is projected out. The other parameters are counted in tolerances, each with a unit
penalty, so that a fit's cost is |residual|^2 + |parameters|^2.
"""

from dataclasses import dataclass

import numpy as np

from .effects import state_with, swapped_rows
from .forward import MACHINE_CAUSES, PARTS, jacobian, prior_sd, signals
from .machines import TOLERANCES, Gauge, Machine
from .plan import SETUPS, Floats, Plan

MAX_TURNS = 3


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """Linear model around a healthy machine with given offsets; N readings."""

    plan: Plan
    machine: Machine
    gauge: Gauge
    state: Floats
    """Healthy condition in the centre, shape (30,)."""
    centre: Floats
    """Its signals, shape (N,), [mm]."""
    free: Floats
    """Patterns of six zeros and three offsets, shape (N, 9)."""
    basis: Floats
    """Orthonormal basis of `free`, shape (N, 9)."""
    families: dict[str, Floats]
    """Patterns of the machine causes, one column per parameter, shape (N, k), not projected."""
    places: dict[str, Floats]
    """Patterns of the causes with a place, one column for each place: per tolerance (or turn)."""

    def project(self, patterns: Floats) -> Floats:
        """Take out what zeros and offsets can imitate; shape (N, ...) in and out."""
        out: Floats = patterns - self.basis @ (self.basis.T @ patterns)
        return out

    def residual(self, record: Floats) -> Floats:
        """A noise-free record [mm] as its projected distance from the centre, shape (N,)."""
        return self.project((record - self.centre) / self.gauge.sigma)


def neighbourhood(machine: Machine, gauge: Gauge, plan: Plan, offsets: Floats) -> Neighbourhood:
    """Linearise around a healthy machine with these offsets, shape (3,), [mm]."""
    state = state_with(offsets, ())
    slopes = jacobian(plan, machine, state) / gauge.sigma
    zeros = np.eye(len(SETUPS))[plan.setup] / gauge.sigma
    free = np.concatenate((zeros, slopes[:, PARTS["offsets"]]), axis=1)
    families = {part: slopes[:, PARTS[part]] * prior_sd(part) for part in MACHINE_CAUSES}
    centre = signals(plan, machine, state[None])[0]
    basis = np.linalg.qr(free)[0]
    places = _places(plan, gauge)
    return Neighbourhood(plan, machine, gauge, state, centre, free, basis, families, places)


def _places(plan: Plan, gauge: Gauge) -> dict[str, Floats]:
    """Patterns of drifts, knocks, misreadings and slips at each of their places."""
    every, setups = np.arange(plan.count), np.arange(len(SETUPS))
    mine = plan.setup[:, None] == setups
    later = np.setdiff1d(every, [np.flatnonzero(plan.setup == s)[0] for s in setups])
    shift = (plan.setup[:, None] == plan.setup[later]) & (every[:, None] >= later)
    return {
        "gauge_drift": mine * plan.hours[:, None] * TOLERANCES["gauge_drift"] / gauge.sigma,
        "stand_shift": shift * TOLERANCES["stand_shift"] / gauge.sigma,
        "misread": np.eye(plan.count) * TOLERANCES["misread"] / gauge.sigma,
        "gauge_slip": np.eye(plan.count) * gauge.revolution / gauge.sigma,
    }


def undone(plan: Plan, record: Floats) -> dict[str, Floats]:
    """The record as it would be without a flip or swap that a rival claims.

    Returns:
        `sign_flip`: shape (6, N), one per set-up; `swapped_gauges`: shape (3, N), one per leg.
    """
    flips = np.where(plan.setup == np.arange(len(SETUPS))[:, None], -record, record)
    swaps = np.stack([record[swapped_rows(plan, leg)] for leg in range(3)])
    return {"sign_flip": flips, "swapped_gauges": swaps}


def marginal(patterns: Floats) -> Floats:
    """Weight matrix W, shape (N, N), with r W r = min over t of |r - patterns t|^2 + |t|^2."""
    inner = np.eye(patterns.shape[1]) + patterns.T @ patterns
    weight: Floats = np.eye(patterns.shape[0]) - patterns @ np.linalg.solve(inner, patterns.T)
    return weight


def backlash_cost(patterns: Floats, residual: Floats) -> tuple[float, tuple[int, ...]]:
    """The same for backlash, whose three widths must not be negative.

    The best of the eight choices of carriages with lost motion that gives no negative width.

    Returns:
        The cost and the columns in use.
    """
    best = float(residual @ residual)
    chosen: tuple[int, ...] = ()
    gram, overlap = patterns.T @ patterns, patterns.T @ residual
    for subset in range(1, 8):
        carriages = [c for c in range(3) if subset >> c & 1]
        columns = (*carriages, *(c + 3 for c in carriages))
        inner = gram[np.ix_(columns, columns)] + np.eye(len(columns))
        sizes = np.linalg.solve(inner, overlap[list(columns)])
        cost = float(residual @ residual - overlap[list(columns)] @ sizes)
        if cost < best and np.all(sizes[: len(carriages)] >= 0.0):
            best, chosen = cost, columns
    return best, chosen


def place_costs(
    cause: str, overlap: Floats, square: Floats, total: Floats | float
) -> tuple[Floats, Floats]:
    """Cost of the best size at each place, by the rank-one formula.

    Args:
        cause: slips come in whole turns, everything else in any size.
        overlap: c . r per place, shape (..., M).
        square: c . c per place, shape (..., M).
        total: r . r, broadcastable.

    Returns:
        Costs and sizes (tolerances or turns), each shape (..., M).
    """
    if cause != "gauge_slip":
        sizes = overlap / (1.0 + square)
        return total - overlap * sizes, sizes
    turns = np.clip(np.round(overlap / (1.0 + square)), -MAX_TURNS, MAX_TURNS)
    # No turn at all is not a slip: the nearest whole turn is then one.
    turns = np.where(turns == 0.0, np.where(overlap < 0.0, -1.0, 1.0), turns)
    return total - 2.0 * turns * overlap + turns**2 * (1.0 + square), turns
