"""Linear estimators: Δρ = M d, with the Jacobian at zero offsets (eqs. 10, 11, 16, 17)."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.errors import RankDeficientError
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.protocols import SINGLE


def calibration_matrix(problem: Problem) -> Floats:
    """The matrix of eqs. (10), (16), (17): R·∂h/∂Δρ at zero offsets, shape (k, 3)."""
    return problem.at_zero[1]


def pseudoinverse(problem: Problem) -> Floats:
    """M = (JᵀJ)⁻¹Jᵀ (Moore–Penrose), shape (3, k)."""
    return np.asarray(np.linalg.pinv(calibration_matrix(problem)), dtype=np.float64)


def sequential(problem: Problem, names: tuple[str, ...]) -> Floats:
    """M of eq. (11): Δρ_z from the isotropic posture, then Δρ_x and Δρ_y, shape (3, 6).

        Δρ_z = (Δz_x0 + Δz_y0)/2,  Δρ_i = Σ_k a_k (Δz_i^k − Δρ_z)/Σ_k a_k²,  k = max, min

    Raises:
        RankDeficientError: one of the six differences is missing.
    """
    missing = [f"d{name}" for name in SINGLE if name not in names]
    if missing:
        raise RankDeficientError(
            f"Eq. (11) needs all six differences; {', '.join(missing)} missing.",
            "Measure them, or use --method single.",
            ("x", "y", "z"),
        )
    slope = calibration_matrix(problem)
    row = {name: names.index(name) for name in SINGLE}
    matrix = np.zeros((3, len(names)))
    matrix[2, [row["z_x0"], row["z_y0"]]] = 0.5
    for axis, name in ((0, "z_x"), (1, "z_y")):
        pair = [row[f"{name}+"], row[f"{name}-"]]
        tangents = slope[pair, axis]
        weights = tangents / (tangents**2).sum()
        matrix[axis, pair] += weights
        matrix[axis] -= weights.sum() * matrix[2]
    return matrix
