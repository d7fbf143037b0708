"""Jacobian of the nominal Orthoglide and its special forms: eqs. (5) to (9)."""

from __future__ import annotations

import math

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.errors import SingularError


def inverse_jacobian(tool: Floats, joints: Floats) -> Floats:
    """J⁻¹ = ∂ρ/∂p (eq. 5): entry (i, j) is p_j/(p_i − ρ_i), 1 on the diagonal.

    Args:
        tool: p, shape (..., 3) [mm].
        joints: true joint positions ρ + Δρ, shape (..., 3) [mm].

    Returns:
        Shape (..., 3, 3), row i for joint i.

    Raises:
        SingularError: a leg stands square to its rail (p_i = ρ_i).
    """
    p = np.asarray(tool, dtype=np.float64)
    q = np.asarray(joints, dtype=np.float64)
    reach = p - q
    if np.any(reach == 0.0):
        leg = AXES[int(np.argwhere(reach == 0.0)[0][-1])]
        raise SingularError(
            f"Leg {leg} stands square to its rail: its carriage cannot move the tool.",
            "Choose a posture inside the workspace.",
        )
    matrix = p[..., None, :] / reach[..., :, None]
    return np.asarray(np.where(np.eye(3, dtype=bool), 1.0, matrix))


def jacobian(tool: Floats, joints: Floats) -> Floats:
    """J = ∂p/∂ρ, the inverse of eq. (5), shape (..., 3, 3).

    Raises:
        SingularError: J⁻¹ has no inverse (the three legs lie in one plane).
    """
    rates = inverse_jacobian(tool, joints)
    flat = np.abs(np.linalg.det(rates)) < 1e-12
    if np.any(flat):
        points = np.broadcast_to(np.asarray(tool, dtype=np.float64), (*flat.shape, 3))
        at = ", ".join(f"{c:.3f}" for c in points[flat][0])
        raise SingularError(
            f"The three legs lie in one plane with the tool at ({at}) mm: the machine is singular"
            " there.",
            "Choose a posture inside the workspace.",
        )
    return np.asarray(np.linalg.inv(rates))


def isotropic_jacobian() -> Floats:
    """J at the isotropic posture: the identity (eq. 6), so Δp = Δρ (eq. 7)."""
    return np.eye(3)


def leg_angle(displacement: float, leg_length: float) -> float:
    """α = asin(d/L) at displacement d of one leg; negative at the min posture [rad].

    Raises:
        SingularError: |d| ≥ L.
    """
    if abs(displacement) >= leg_length:
        raise SingularError(
            f"A displacement of {displacement:g} mm is not shorter than the leg"
            f" ({leg_length:g} mm).",
            "Use a displacement inside the joint limits.",
        )
    return math.asin(displacement / leg_length)


def displaced_jacobian(leg: int, displacement: float, leg_length: float) -> Floats:
    """J at leg `leg` displaced by d along its axis: identity plus T_α in column `leg` (eq. 8).

    Gives Δp_leg = Δρ_leg and Δp_j = T_α Δρ_leg + Δρ_j for the other axes (eq. 9, Table 1).
    """
    tangent = math.tan(leg_angle(displacement, leg_length))
    matrix = np.eye(3)
    matrix[:, leg] = tangent
    matrix[leg, leg] = 1.0
    return matrix
