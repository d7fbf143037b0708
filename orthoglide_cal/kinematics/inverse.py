"""Inverse kinematics of the nominal Orthoglide: eq. (3) with the errata."""

from __future__ import annotations

import itertools

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.errors import UnreachableError

Mode = tuple[int, int, int]

WORKING_MODES: tuple[Mode, ...] = tuple(itertools.product((1, -1), repeat=3))  # type: ignore[arg-type]


def inverse(
    tool: Floats,
    leg_length: float,
    offsets: Floats | tuple[float, float, float] = (0.0, 0.0, 0.0),
    mode: Mode = (1, 1, 1),
) -> Floats:
    """Indicated joint positions ρ for a tool position p.

        ρ_i = p_i + s_i √(L² − p_j² − p_k²) − Δρ_i      (eq. 3; errata, rows y and z)

    Args:
        tool: p, shape (..., 3) [mm].
        leg_length: L [mm].
        offsets: Δρ, shape (..., 3) [mm].
        mode: s, one of the eight `WORKING_MODES`; (1, 1, 1) is the prototype's.

    Returns:
        ρ, shape (..., 3) [mm].

    Raises:
        UnreachableError: the point is farther than L from a rail.
    """
    point = np.asarray(tool, dtype=np.float64)
    squares = point**2
    root2 = leg_length**2 - (squares.sum(axis=-1, keepdims=True) - squares)
    if np.any(root2 < 0.0):
        *batch, leg = (int(k) for k in np.argwhere(root2 < 0.0)[0])
        at = ", ".join(f"{c:.3f}" for c in point[tuple(batch)])
        raise UnreachableError(
            f"The point ({at}) mm is farther from rail {AXES[leg]} than the leg is long"
            f" ({leg_length:g} mm).",
            "Choose a point inside the workspace.",
        )
    return np.asarray(point + np.asarray(mode) * np.sqrt(root2) - np.asarray(offsets))
