"""Which offsets the data determine, and which reading to add when they do not."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.errors import RankDeficientError
from orthoglide_cal.estimation.linear import calibration_matrix
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact
from orthoglide_cal.protocols import NAMES, ideal_plan, reduction

# Singular values below this fraction of the sensitivity of a good plan count as zero.
NEGLIGIBLE = 1e-6


def _free_directions(matrix: Floats, scale: float) -> Floats:
    """Offset directions that the rows of the matrix (k, 3) do not see, shape (m, 3)."""
    if not len(matrix):
        return np.eye(3)
    _, values, vectors = np.linalg.svd(matrix)
    size = np.zeros(3)
    size[: len(values)] = values
    return np.asarray(vectors[size <= NEGLIGIBLE * scale])


def require_rank(problem: Problem) -> None:
    """Do the data determine all three offsets?

    Raises:
        RankDeficientError: no; it names the offsets and the readings that mend it.
    """
    matrix = calibration_matrix(problem)
    scale = float(np.abs(matrix).max(initial=0.0)) or 1.0
    free = _free_directions(matrix, scale)
    if not len(free):
        return
    axes = [AXES[i] for i in range(3) if np.abs(free[:, i]).max() > NEGLIGIBLE]
    listed = " and ".join(f"Δρ_{axis}" for axis in axes)
    raise RankDeficientError(
        f"These readings do not determine {listed}.",
        f"Add readings of {_mend(problem, matrix)}.",
        axes,
    )


def _mend(problem: Problem, matrix: Floats) -> str:
    """The fewest differences that complete the rank, in words."""
    single = bool(np.any(problem.plan.contact != Contact.FIXED))
    kind = "single" if single else "six"
    rows = dict(zip(NAMES[kind], _rows(kind, problem.machine), strict=True))
    scale = max(float(np.abs(row).max()) for row in rows.values())
    chosen: list[str] = []
    while len(_free_directions(matrix, scale)):
        smallest = {
            name: np.sort(np.linalg.svd(np.vstack((matrix, row)), compute_uv=False))[::-1]
            for name, row in rows.items()
        }
        missing = len(_free_directions(matrix, scale))
        best = max(smallest, key=lambda name: _gain(smallest[name], 3 - missing))
        chosen.append(best)
        matrix = np.vstack((matrix, rows.pop(best)))
    return "; ".join(_instruction(name, single) for name in chosen)


def _gain(values: Floats, rank: int) -> float:
    """The singular value that an added row lifts above a matrix of this rank."""
    return float(values[rank]) if rank < len(values) else 0.0


def _rows(kind: str, machine: Machine) -> Floats:
    plan = ideal_plan(kind, machine)
    matrix = reduction(kind, NAMES[kind], machine, plan)
    return calibration_matrix(Problem(machine, plan, matrix))


def _instruction(name: str, single: bool) -> str:
    direction, leg = name[0], name[2]
    if single:
        posture = {"0": "iso", "+": "max", "-": "min"}[name[3]]
        where = f"at {posture}, joint end and tool end"
    else:
        where = "at max and min in one gauge set-up"
    return f"leg {leg}, direction {direction}, {where}"
