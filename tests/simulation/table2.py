"""Table 2 written anew for the tests: eqs. (18) to (24) with the errata, one reading at a time.

The tool is found by Newton's method on the sphere equations, not by eq. (4).
"""

import math

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.machine import Machine


def tool(length: float, joints: Floats) -> Floats:
    """p with |p − q_i e_i| = L for the three legs, near the origin, shape (3,) [mm]."""
    p = np.zeros(3)
    for _ in range(50):
        legs = p - np.diag(joints)
        step = np.linalg.solve(2.0 * legs, (legs**2).sum(axis=1) - length**2)
        p = p - step
        if np.abs(step).max() < 1e-13:
            break
    return p


def joints(machine: Machine, leg: int, displacement: float) -> Floats:
    """Commanded joints: L + L S_α on the displaced leg, L C_α on the others (eq. 21)."""
    length = machine.leg_length_mm
    angle = math.asin(displacement / length)
    commanded = np.full(3, length * math.cos(angle))
    commanded[leg] = length + length * math.sin(angle)
    return commanded


def gauge_reading(
    machine: Machine,
    offsets: Floats,
    leg: int,
    direction: int,
    displacement: float,
    gauge_at: float = 0.5,
) -> float:
    """μ p_direction, with μ from the gauge's fixed place along the leg's axis (eqs. 20, 23)."""
    length = machine.leg_length_mm
    isotropic = tool(length, np.full(3, length) + offsets)
    place = (1.0 - gauge_at) * (length + offsets[leg]) + gauge_at * isotropic[leg]
    moved = joints(machine, leg, displacement) + offsets
    p = tool(length, moved)
    mu = (place - moved[leg]) / (p[leg] - moved[leg])
    return float(mu * p[direction])
