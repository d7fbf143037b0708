"""Tool positions all over the cube-like workspace, and rails bent out of shape."""

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.kinematics import Geometry
from orthoglide_cal.machine import Machine


def tool_positions(machine: Machine, count: int = 400, seed: int = 3) -> Floats:
    """Random points of the workspace, shape (count, 3) [mm]."""
    rng = np.random.default_rng(seed)
    low, high = machine.joint_limits_mm
    return rng.uniform(low, high, (count, 3))


def bent_geometry(machine: Machine, seed: int = 8) -> Geometry:
    """Rails that neither meet nor are orthogonal, unequal legs: degrees and millimetres."""
    rng = np.random.default_rng(seed)
    directions = np.eye(3) + rng.normal(0.0, 0.05, (3, 3))
    return Geometry(
        points=rng.normal(0.0, 5.0, (3, 3)),
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        lengths=machine.leg_length_mm + rng.normal(0.0, 3.0, 3),
    )
