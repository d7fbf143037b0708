"""Monte Carlo study of the estimators under gauge noise: Table 3 of the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.errors import NotConvergedError
from orthoglide_cal.estimation import Problem, fit_offsets
from orthoglide_cal.model import (
    DIFFERENCES,
    DataKind,
    Floats,
    Model,
    ReadOnly,
    ideal_plan,
    reduction,
    simulate,
)

METHODS = (DataKind.SIX, DataKind.TWELVE)
OFFSETS_MM = (0.1, 1.0)
SIGMA_MM = 0.01
REPLICATIONS = 20
RUNS = 10_000


@dataclass(frozen=True, eq=False)
class Study(ReadOnly):
    """One cell of Table 3.

    Attributes:
        method: six or twelve equations.
        offset_mm: true value of all three joint offsets.
        stds_mm: std(Δρ) of each replication, over its runs and the three joints.
    """

    method: DataKind
    offset_mm: float
    stds_mm: Floats

    @property
    def mean_mm(self) -> float:
        """Mean of std(Δρ) over the replications [mm]."""
        return float(self.stds_mm.mean())

    @property
    def spread_mm(self) -> float:
        """Largest departure of a replication from the mean [mm]."""
        return float(np.abs(self.stds_mm - self.mean_mm).max())


def monte_carlo(
    model: Model,
    rng: np.random.Generator,
    *,
    methods: Sequence[DataKind] = METHODS,
    offsets_mm: Sequence[float] = OFFSETS_MM,
    sigma_mm: float = SIGMA_MM,
    replications: int = REPLICATIONS,
    runs: int = RUNS,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Study, ...]:
    """Estimate the offsets from many noisy sessions by nonlinear least squares (eq. 25).

    Each reading gets its own noise, so a session's twelve differences share the noise of their
    isotropic readings (errata, eq. 30).

    Args:
        model: the machine.
        rng: source of the noise.
        methods: six equations, twelve, or both.
        offsets_mm: true offsets, the same for all three joints.
        sigma_mm: standard deviation of one reading.
        replications: repeats of the study; their spread shows how well it is determined.
        runs: sessions solved in each.
        progress: called with (solves done, all solves).

    Returns:
        One cell for each method and offset.

    Raises:
        NotConvergedError: any of the solves did not reach its optimum.
    """
    total = len(methods) * len(offsets_mm) * replications * runs
    cells = []
    done = 0
    for method in methods:
        plan = ideal_plan(method, model.orthoglide)
        problem = Problem(
            model, plan, reduction(method, DIFFERENCES[method], model.orthoglide, plan)
        )
        for offset in offsets_mm:
            signal = simulate(model, np.full(3, offset), plan)
            stds = np.empty(replications)
            for k in range(replications):
                noise = sigma_mm * rng.standard_normal((runs, len(plan)))
                stds[k] = _scatter(problem, (signal + noise) @ problem.matrix.T)
                done += runs
                if progress is not None:
                    progress(done, total)
            cells.append(Study(method, offset, stds))
    return tuple(cells)


def _scatter(problem: Problem, data: Floats) -> float:
    """Standard deviation of the offsets estimated from data (runs, k), r.m.s. over the joints."""
    fit = fit_offsets(problem, data)
    if not np.all(fit.converged):
        raise NotConvergedError(
            f"{np.sum(~fit.converged)} of {len(data)} solves did not reach their optimum.",
            "Use less noise or smaller offsets.",
        )
    return float(np.sqrt(fit.offsets_mm.var(axis=0, ddof=1).mean()))
