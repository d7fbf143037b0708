"""The general machine: three straight rails in any position and direction, any leg lengths.

    carriage centre   b_i = a_i + q_i u_i          (q_i: true joint position)
    leg               |p − b_i| = L_i              (eq. 1 for any rails)

Direct kinematics is the intersection of three spheres in closed form; inverse kinematics is
the intersection of a sphere and a line. Everything is batched over leading axes and stays
valid for complex input, so that derivatives can be taken by a complex step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Numbers
from orthoglide_cal.errors import SingularError, UnreachableError
from orthoglide_cal.machine import Machine

# Sine of the angle between the legs below which a posture counts as singular.
SINGULAR = 1e-9


@dataclass(frozen=True, eq=False)
class Geometry:
    """Where the rails are and how long the legs are.

    Attributes:
        points: a_i, one point of each rail, shape (..., 3, 3), row i for rail i [mm].
        directions: u_i, unit vectors, shape (..., 3, 3), row i for rail i.
        lengths: L_i, shape (..., 3) [mm].
    """

    points: Numbers
    directions: Numbers
    lengths: Numbers

    @classmethod
    def nominal(cls, machine: Machine) -> Geometry:
        """Orthogonal rails that meet in the origin, equal legs (modelling assumption iv)."""
        return cls(np.zeros((3, 3)), np.eye(3), np.full(3, machine.leg_length_mm))

    def carriages(self, joints: Numbers) -> Numbers:
        """Carriage centres b_i for true joint positions (..., 3) → (..., 3, 3), row per leg."""
        return self.points + joints[..., None] * self.directions


def _cross(a: Numbers, b: Numbers) -> Numbers:
    """Cross product over the last axis; unlike numpy's, cheap for many small vectors."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0), axis=-1)


def _dot(a: Numbers, b: Numbers) -> Numbers:
    return np.asarray((a * b).sum(axis=-1))


def trilaterate(centres: Numbers, lengths: Numbers, assembly: int = -1) -> Numbers:
    """The point at distance `lengths` from three centres.

    Args:
        centres: shape (..., 3, 3), row i is b_i [mm].
        lengths: shape (..., 3) [mm].
        assembly: −1 for the prototype's assembly (p = 0 at the isotropic posture), +1 for the
            mirror one; the sign m of eq. (4) (errata, sec. 2.4).

    Returns:
        p, shape (..., 3) [mm].

    Raises:
        UnreachableError: the three spheres have no common point.
        SingularError: the three centres lie on a line.
    """
    first = centres[..., 0, :]
    to_second = centres[..., 1, :] - first
    to_third = centres[..., 2, :] - first
    normal = _cross(to_second, to_third)
    area2 = _dot(normal, normal)
    size2 = _dot(to_second, to_second) * _dot(to_third, to_third)
    if np.any(area2.real <= SINGULAR**2 * np.abs(size2)):
        raise SingularError(
            "The three carriage joints lie on a line: the tool position is not determined.",
            "Change the joint positions.",
        )
    squares = lengths**2
    half_second = 0.5 * (_dot(to_second, to_second) + squares[..., 0] - squares[..., 1])
    half_third = 0.5 * (_dot(to_third, to_third) + squares[..., 0] - squares[..., 2])
    in_plane = (
        half_second[..., None] * _cross(to_third, normal)
        + half_third[..., None] * _cross(normal, to_second)
    ) / area2[..., None]
    height2 = squares[..., 0] - _dot(in_plane, in_plane)
    if np.any(height2.real < 0.0):
        missing = float(np.sqrt(-height2.real.min()))
        raise UnreachableError(
            "The legs do not reach each other at these joint positions"
            f" (the spheres miss by {missing:.3g} mm).",
            "Use joint positions inside the limits of the machine.",
        )
    height = -assembly * np.sqrt(height2 / area2)
    return np.asarray(first + in_plane - height[..., None] * normal)


def rail_position(
    geometry: Geometry, tool: Numbers, mode: tuple[int, int, int] = (1, 1, 1)
) -> Numbers:
    """Inverse kinematics: true joint positions that put the tool centre point at `tool`.

    Args:
        geometry: the rails and legs.
        tool: p, shape (..., 3) [mm].
        mode: signs s_i of the working mode; (1, 1, 1) is the prototype's (eq. 3).

    Returns:
        q, shape (..., 3) [mm].

    Raises:
        UnreachableError: a leg is too short to reach the point from its rail.
    """
    from_rail = tool[..., None, :] - geometry.points
    along = _dot(from_rail, geometry.directions)
    root2 = geometry.lengths**2 - _dot(from_rail, from_rail) + along**2
    if np.any(root2.real < 0.0):
        leg = int(np.argwhere(root2.real < 0.0)[0][-1])
        raise UnreachableError(
            f"Leg {AXES[leg]} is too short to reach this point from its rail.",
            "Choose a point inside the workspace.",
        )
    return np.asarray(along + np.asarray(mode) * np.sqrt(root2))


def leg_matrix(tool: Numbers, centres: Numbers) -> Numbers:
    """Rows p − b_i, shape (..., 3, 3): the matrix of the differentiated sphere equations."""
    return np.asarray(tool[..., None, :] - centres)


def tool_derivative(geometry: Geometry, joints: Numbers, tool: Numbers) -> Numbers:
    """Jacobian ∂p/∂q of the general machine (eq. 5 inverted), shape (..., 3, 3).

    From (p − b_i)·(dp − u_i dq_i) = 0.

    Raises:
        SingularError: the three legs lie in one plane.
    """
    legs = leg_matrix(tool, geometry.carriages(joints))
    columns = (
        _cross(legs[..., 1, :], legs[..., 2, :]),
        _cross(legs[..., 2, :], legs[..., 0, :]),
        _cross(legs[..., 0, :], legs[..., 1, :]),
    )
    volume = _dot(legs[..., 0, :], columns[0])
    if np.any(np.abs(volume) <= SINGULAR * np.abs(np.prod(geometry.lengths, axis=-1))):
        raise SingularError(
            "The three legs lie in one plane: the machine is singular at this posture.",
            "Choose a posture inside the workspace.",
        )
    drive = _dot(legs, geometry.directions)
    return np.stack(columns, axis=-1) * (drive / volume[..., None])[..., None, :]
