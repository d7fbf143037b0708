"""Direct kinematics of the nominal Orthoglide: eq. (4) with the errata."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.errors import SingularError, UnreachableError


def direct(
    joints: Floats,
    leg_length: float,
    offsets: Floats | tuple[float, float, float] = (0.0, 0.0, 0.0),
    assembly: int = -1,
) -> Floats:
    """Tool position p for indicated joint positions ρ.

        p_i = q_i/2 + t/q_i,   q = ρ + Δρ                              (eq. 4)
        A t² + B t + B C = 0,  A = Σ (q_i q_j)²  (errata, eq. 4, A),
        B = (q_x q_y q_z)²,    C = (Σ q_i² − 4 L²)/4

    Args:
        joints: ρ, shape (..., 3) [mm].
        leg_length: L [mm].
        offsets: Δρ, shape (..., 3) [mm].
        assembly: m; −1 is the prototype's, with p = 0 at ρ = (L, L, L) (errata, sec. 2.4).

    Returns:
        p, shape (..., 3) [mm].

    Raises:
        UnreachableError: the quadratic has no real root.
        SingularError: a joint stands at zero, where eq. (4) divides by it.
    """
    q = np.asarray(joints, dtype=np.float64) + np.asarray(offsets, dtype=np.float64)
    if np.any(q == 0.0):
        raise SingularError(
            "A carriage stands at the meeting point of the rails.", "Move it along its rail."
        )
    # Divided by B: (Σ 1/q²) t² + t + C = 0, which stays well scaled.
    a = (1.0 / q**2).sum(axis=-1)
    c = ((q**2).sum(axis=-1) - 4.0 * leg_length**2) / 4.0
    discriminant = 1.0 - 4.0 * a * c
    if np.any(discriminant < 0.0):
        at = ", ".join(f"{v:.3f}" for v in q.reshape(-1, 3)[np.argmin(discriminant)])
        raise UnreachableError(
            f"The legs of {leg_length:g} mm do not meet with the carriages at ({at}) mm.",
            "Use joint positions inside the limits of the machine.",
        )
    t = (-1.0 + assembly * np.sqrt(discriminant)) / (2.0 * a)
    return np.asarray(q / 2.0 + t[..., None] / q)
