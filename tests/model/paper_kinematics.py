"""The paper's kinematics written again for the tests, with the errata.

Closed forms that hold for the nominal machine alone (eqs. 3, 4), and Newton's method for rails in
any place. The program uses neither.
"""

import numpy as np

from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.plan import Floats

NONE = np.zeros(3)


def inverse(tool: Floats, leg_length: float) -> Floats:
    """ρ_i = p_i + √(L² − p_j² − p_k²), no offsets (eq. 3; errata, rows y and z), (..., 3)."""
    squares = tool**2
    others = squares.sum(axis=-1, keepdims=True) - squares
    return np.asarray(tool + np.sqrt(leg_length**2 - others))


def direct(joints: Floats, leg_length: float, offsets: Floats = NONE) -> Floats:
    """Tool position p for indicated joint positions ρ, shape (..., 3) [mm].

        p_i = q_i/2 + t/q_i,   q = ρ + Δρ                              (eq. 4)
        A t² + B t + B C = 0,  A = Σ (q_i q_j)²  (errata, eq. 4, A),
        B = (q_x q_y q_z)²,    C = (Σ q_i² − 4 L²)/4

    In the prototype's assembly, with p = 0 at ρ = (L, L, L) (errata, sec. 2.4: m = −1).
    """
    q = joints + offsets
    # Divided by B: (Σ 1/q²) t² + t + C = 0, which stays well scaled.
    a = (1.0 / q**2).sum(axis=-1)
    c = ((q**2).sum(axis=-1) - 4.0 * leg_length**2) / 4.0
    t = (-1.0 - np.sqrt(1.0 - 4.0 * a * c)) / (2.0 * a)
    return np.asarray(q / 2.0 + t[..., None] / q)


def tool_near(rails: Geometry, joints: Floats, start: Floats = NONE) -> Floats:
    """The point at the legs' lengths from the carriages that is near `start`, shape (3,) [mm]."""
    centres = np.array([rails.points[i] + joints[i] * rails.directions[i] for i in range(3)])
    point = start.copy()
    for _ in range(50):
        legs = point - centres
        step = np.linalg.solve(2.0 * legs, (legs**2).sum(axis=1) - rails.lengths**2)
        point = point - step
        if np.abs(step).max() < 1e-13:
            break
    return point


def nominal_rails(length: float) -> Geometry:
    """Orthogonal rails that meet in the origin, equal legs."""
    return Geometry(np.zeros((3, 3)), np.diag([1.0, 1.0, 1.0]), np.full(3, length))
