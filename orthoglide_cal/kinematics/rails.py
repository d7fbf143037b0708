"""The general machine: three straight rails in any position and direction, any leg lengths.

    carriage centre   b_i = a_i + q_i u_i          (q_i: true joint position)
    leg               |p − b_i| = L_i              (eq. 1 for any rails)

Direct kinematics is the intersection of three spheres in closed form; inverse kinematics is
the intersection of a sphere and a line. Everything is batched and stays valid for complex
input, so that derivatives can be taken by a complex step.

Functions named `…_components` take matrix and vector indices as the first axes and the batch
as the last ones, (3, 3, ...): many small vectors are then handled as few long arrays.
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
        return np.asarray(self.points + joints[..., None] * self.directions)


def _cross(a: Numbers, b: Numbers) -> Numbers:
    """Cross product over the first axis, (3, ...)."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=product[i, ...])
        product[i] -= a[k] * b[j]
    return product


def _dot(a: Numbers, b: Numbers) -> Numbers:
    """Scalar product over the first axis, (3, ...) → (...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _first(values: Numbers, axes: int) -> Numbers:
    """Move the last `axes` axes to the front."""
    return np.moveaxis(values, range(-axes, 0), range(axes))


def trilaterate(
    centres: Numbers, lengths: Numbers, assembly: int = -1, strict: bool = True
) -> Numbers:
    """The point at distance `lengths` from three centres.

    Args:
        centres: shape (..., 3, 3), row i is b_i [mm].
        lengths: shape (..., 3) [mm].
        assembly: −1 for the prototype's assembly (p = 0 at the isotropic posture), +1 for the
            mirror one; the sign m of eq. (4) (errata, sec. 2.4).
        strict: raise if any of the batch has no solution; otherwise its entry is NaN.

    Returns:
        p, shape (..., 3) [mm].

    Raises:
        UnreachableError: the three spheres have no common point.
        SingularError: the three centres lie on a line.
    """
    point = trilaterate_components(_first(centres, 2), _first(lengths, 1), assembly, strict)
    return np.moveaxis(point, 0, -1)


def trilaterate_components(
    centres: Numbers, lengths: Numbers, assembly: int = -1, strict: bool = True
) -> Numbers:
    """`trilaterate` with components first: (3, 3, ...), (3, ...) → (3, ...)."""
    first = centres[0]
    to_second = centres[1] - first
    to_third = centres[2] - first
    normal = _cross(to_second, to_third)
    area2 = _dot(normal, normal)
    second2, third2 = _dot(to_second, to_second), _dot(to_third, to_third)
    on_a_line = area2.real <= SINGULAR**2 * np.abs(second2 * third2)
    if strict and np.any(on_a_line):
        raise SingularError(
            "The three carriage joints lie on a line: the tool position is not determined.",
            "Change the joint positions.",
        )
    area2 = np.where(on_a_line, np.nan, area2)
    squares = lengths**2
    half_second = 0.5 * (second2 + squares[0] - squares[1])
    half_third = 0.5 * (third2 + squares[0] - squares[2])
    in_plane = _cross(half_second * to_third - half_third * to_second, normal) / area2
    height2 = squares[0] - _dot(in_plane, in_plane)
    apart = height2.real < 0.0
    if strict and np.any(apart):
        missing = float(np.sqrt(-height2.real.min()))
        raise UnreachableError(
            "The legs do not reach each other at these joint positions"
            f" (the spheres miss by {missing:.3g} mm).",
            "Use joint positions inside the limits of the machine.",
        )
    height = assembly * np.sqrt(np.where(apart, np.nan, height2) / area2)
    return np.asarray(first + in_plane + height * normal)


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
    along = (from_rail * geometry.directions).sum(axis=-1)
    root2 = geometry.lengths**2 - (from_rail**2).sum(axis=-1) + along**2
    if np.any(root2.real < 0.0):
        *place, leg = (int(k) for k in np.argwhere(root2.real < 0.0)[0])
        batch = np.broadcast_to(tool, (*root2.shape[:-1], 3))
        at = ", ".join(f"{c:.3f}" for c in batch[tuple(place)].real)
        raise UnreachableError(
            f"Leg {AXES[leg]} is too short to reach the point ({at}) mm from its rail.",
            "Choose a point inside the workspace.",
        )
    return np.asarray(along + np.asarray(mode) * np.sqrt(root2))


def tool_derivative(geometry: Geometry, joints: Numbers, tool: Numbers) -> Numbers:
    """Jacobian ∂p/∂q of the general machine (eq. 5 inverted), shape (..., 3, 3).

    Args:
        geometry: the rails and legs.
        joints: true joint positions q, shape (..., 3) [mm].
        tool: p at these joints, shape (..., 3) [mm].

    Raises:
        SingularError: the three legs lie in one plane.
    """
    centres = geometry.carriages(joints)
    matrix = tool_derivative_components(
        _first(centres, 2), _first(geometry.directions, 2), _first(tool, 1)
    )
    if not np.all(np.isfinite(matrix)):
        raise SingularError(
            "The three legs lie in one plane: the machine is singular at this posture.",
            "Choose a posture inside the workspace.",
        )
    return np.moveaxis(matrix, (0, 1), (-2, -1))


def tool_derivative_components(centres: Numbers, directions: Numbers, tool: Numbers) -> Numbers:
    """∂p/∂q with components first, (3, 3, ...); NaN where the machine is singular.

    From the differentiated sphere equations (p − b_i)·(dp − u_i dq_i) = 0.
    """
    legs = tool - centres
    columns = (
        _cross(legs[1], legs[2]),
        _cross(legs[2], legs[0]),
        _cross(legs[0], legs[1]),
    )
    volume = _dot(legs[0], columns[0])
    size2 = _dot(columns[0], columns[0]) * _dot(legs[0], legs[0])
    flat = np.abs(volume) <= SINGULAR * np.sqrt(np.abs(size2))
    inverse = 1.0 / np.where(flat, np.nan, volume)
    matrix = np.empty((3, *columns[0].shape), columns[0].dtype)
    for k in range(3):
        np.multiply(columns[k], _dot(legs[k], directions[k]) * inverse, out=matrix[:, k, ...])
    return matrix
