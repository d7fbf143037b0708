"""The least cost of one hypothesis with the full forward model."""

from dataclasses import dataclass

import numpy as np

from .forward import MACHINE_CAUSES, PARTS, prior_sd, signals
from .linear import Neighbourhood
from .plan import Floats

ZEROS = slice(0, 6)
OFFSETS = slice(6, 9)
FREE = 9


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One claim at its best place, ready to be refined."""

    cause: str
    record: Floats
    """The record to be explained, shape (N,), [mm] (with a claimed flip or swap undone)."""
    columns: tuple[int, ...] = ()
    """Numbers of the condition vector that may differ from healthy."""
    pattern: Floats | None = None
    """Pattern in the record, shape (N,), in sigma."""
    turns: float | None = None
    """Fixed size of the pattern, for slips."""


def _penalised(near: Neighbourhood, claim: Hypothesis) -> Floats:
    """Patterns of the parameters with a penalty, shape (N, k): condition numbers, then pattern."""
    everything = np.concatenate([near.families[part] for part in MACHINE_CAUSES], axis=1)
    chosen = everything[:, [c - PARTS["offsets"].stop for c in claim.columns]]
    if claim.pattern is None or claim.turns is not None:
        return chosen
    return np.concatenate((chosen, claim.pattern[:, None]), axis=1)


def _solver(near: Neighbourhood, penalised: Floats) -> Floats:
    """Least-squares operator from (misfit, -sizes) to a step of all parameters."""
    count = penalised.shape[1]
    whole = np.block([[near.free, penalised], [np.zeros((count, FREE)), np.eye(count)]])
    return np.linalg.solve(whole.T @ whole, whole.T)


def refined_costs(near: Neighbourhood, claims: list[Hypothesis], rounds: int = 4) -> Floats:
    """Least costs of the claims, shape (len(claims),).

    Gauss-Newton with the centre's derivatives: over the way they change by about way/300 mm, so
    each round leaves a few per cent of the error at most. The least cost seen is returned.
    """
    sigma = near.gauge.sigma
    # One tolerance of each number of the condition vector, behind the three offsets.
    unit = np.concatenate((np.ones(3), *(prior_sd(part) for part in MACHINE_CAUSES)))
    zeros = near.free[:, ZEROS]
    blocks = [_penalised(near, claim) for claim in claims]
    solvers = [_solver(near, block) for block in blocks]
    sizes = [np.zeros(block.shape[1]) for block in blocks]
    states = np.tile(near.state, (len(claims), 1))
    costs = np.full(len(claims), np.inf)
    for _ in range(rounds):
        modelled = signals(near.plan, near.machine, states)
        for k, claim in enumerate(claims):
            misfit = (claim.record - modelled[k]) / sigma
            turns = claim.turns or 0.0
            if claim.pattern is not None:
                misfit = misfit - claim.pattern * (turns if claim.turns else sizes[k][-1])
            level = misfit - zeros @ ((zeros.T @ misfit) / (zeros * zeros).sum(axis=0))
            cost = float(level @ level + sizes[k] @ sizes[k]) + turns**2
            costs[k] = min(costs[k], cost)
            step = solvers[k] @ np.concatenate((misfit, -sizes[k]))
            states[k, PARTS["offsets"]] += step[OFFSETS]
            sizes[k] = sizes[k] + step[FREE:]
            columns = list(claim.columns)
            states[k, columns] = sizes[k][: len(columns)] * unit[columns]
    return costs
