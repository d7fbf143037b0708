"""Uncertainty of the offsets, and whether the data determine them at all.

Covariance (eqs. 26–33), σ of one reading from three sources, intervals, the digits worth writing;
and, where the rank is missing, which offsets stay free and which reading to add.
"""

import functools
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from scipy.special import chdtrc, stdtrit

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.methods import LeastSquaresFit, Problem, pose_plan
from orthoglide_cal.model.cause import CONFIDENCE, NORMAL_K
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import ideal_plan
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.readings import Posture

# Singular values below this fraction of the sensitivity of a good plan count as zero.
NEGLIGIBLE = 1e-6


def unit_covariance(problem: Problem, jacobian: Floats) -> Floats:
    """V(Δρ)/σ² = M G Mᵀ with M = (JᵀJ)⁻¹Jᵀ, G = R Rᵀ (eqs. 26, 29, 32), shape (..., 3, 3).

    `jacobian` is J at the solution, shape (..., k, 3).
    """
    return problem.spread(np.asarray(np.linalg.pinv(jacobian), np.float64))


def rms(values: Floats) -> float:
    """Root mean square, in the unit of the values."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class Scatter:
    """A standard deviation of one reading [mm] and its (effective) degrees of freedom."""

    sigma_mm: float
    dof: float


def scatter_of_repeats(plan: Plan, values: Floats) -> Scatter | None:
    """σ from readings (n,) [mm] that repeat each other exactly; None without repeats.

    They share a gauge set-up, or a spot of the bed, so this may understate the real scatter.
    """
    cell = plan.repeats
    count = np.bincount(cell)
    dof = int(len(plan) - count.size)
    if dof == 0:
        return None
    mean = np.bincount(cell, weights=values) / count
    apart = plan.precision * (values - mean[cell])
    return Scatter(float(np.sqrt((apart**2).sum() / dof)), float(dof))


def half_width(dof: float, confidence: float = CONFIDENCE) -> float:
    """Student-t factor of a two-sided interval; the normal one for infinite dof."""
    return float(stdtrit(dof, 0.5 + confidence / 2.0))


def chance_of_residual(sum_of_squares: float, dof: float, sigma_mm: float) -> float:
    """Chance that noise of σ alone leaves a larger sum of squares (χ² test); 1 without dof."""
    return float(chdtrc(dof, sum_of_squares / sigma_mm**2)) if dof > 0 else 1.0


def determined(model: Model, expanded: Floats) -> tuple[bool, ...]:
    """True of each parameter that is known well enough to state, from U (p,)."""
    machine = model.machine
    return tuple((expanded < (machine.max_reportable_u or machine.plausible)).tolist())


def _free_directions(matrix: Floats, scale: float) -> Floats:
    """Offset directions that the rows of the matrix (k, 3) do not see, shape (m, 3)."""
    # Not fewer rows than columns: each direction has a singular value.
    padded = np.vstack((matrix, np.zeros((matrix.shape[1], matrix.shape[1]))))
    _, values, vectors = np.linalg.svd(padded, full_matrices=False)
    return np.asarray(vectors[values <= NEGLIGIBLE * scale])


@functools.lru_cache(maxsize=8)
def require_rank(problem: Problem) -> None:
    """Refuse data that do not determine all offsets.

    Raises UnusableResultError, with the offsets and the readings that fix it.
    """
    matrix = problem.at_zero[1]
    free = _free_directions(matrix, float(np.abs(matrix).max(initial=0.0)) or 1.0)
    if len(free):
        _refuse(problem, np.abs(free).max(axis=0) > NEGLIGIBLE)


def require_determined(problem: Problem) -> None:
    """Refuse data that tell no more of a parameter than is known of any such machine.

    On the nominal machine with the stated noise: what a search must stand on. Raises as
    `require_rank`.
    """
    model, jacobian = problem.model, problem.at_zero[1]
    std = model.machine.instrument.noise_mm * np.sqrt(np.diag(unit_covariance(problem, jacobian)))
    free = ~np.array(determined(model, NORMAL_K * std))
    if free.any():
        _refuse(problem, free)


def require_optimum(problem: Problem, fit: LeastSquaresFit) -> None:
    """Refuse a fit that found no optimum of the data, or of the first of several sets.

    Raises UnusableResultError.
    """
    if not fit.converged.flat[0]:
        require_determined(problem)
        many = problem.model.machine.vocabulary.many
        raise UnusableResultError(
            f"No {many} fit these data: the search does not settle.",
            "Check the machine file and the readings; validate names every fault.",
        )


def _refuse(problem: Problem, free: np.ndarray) -> NoReturn:
    """Raises UnusableResultError for the parameters that are `free`, shape (p,).

    With the fewest differences that complete the rank.
    """
    machine, matrix = problem.model.machine, problem.at_zero[1]
    fault = ", ".join(machine.parameter_symbols[i] for i in np.flatnonzero(free))
    fault = f"These readings do not determine {fault}."
    if machine.vocabulary.fewest:
        raise UnusableResultError(fault, machine.vocabulary.fewest)
    kind = DataKind.SIX if problem.plan.fixed else DataKind.SINGLE
    ideal = pose_plan(ideal_plan(kind, machine), Model(machine), kind)
    sensitivity = ideal.at_zero[1]
    scale, chosen = np.abs(sensitivity).max(), list[str]()
    while len(free := _free_directions(matrix, scale)):
        # The one that sees most of what no other does.
        best = int(np.argmax(np.linalg.norm(sensitivity @ free.T, axis=1)))
        series, posture = ideal.which[best]
        where = f"at {posture}, joint end and tool end"
        if posture is None:
            where = f"at {Posture.MAX} and {Posture.MIN} in one gauge set-up"
        chosen.append(f"{series.words}, {where}")
        matrix = np.vstack((matrix, sensitivity[best]))
    raise UnusableResultError(fault, f"Add readings of {'; '.join(chosen)}.")
