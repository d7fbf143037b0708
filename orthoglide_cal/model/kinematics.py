"""Kinematics of three rails, and where the carriages of a real machine stand on them.

The general machine has three straight rails in any position and direction, and any leg lengths:

    carriage centre   b_i = a_i + q_i u_i          (q_i: true joint position)
    leg               |p − b_i| = L_i              (eq. 1 for any rails)

Direct kinematics is the intersection of three spheres, inverse kinematics that of a sphere and a
line. Everything is batched and valid for complex input, for derivatives by a complex step.

Functions take matrix and vector indices as the first axes and the batch as the last ones,
(3, 3, ...): many small vectors are then few long arrays. Methods have the batch first.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import PostureError
from orthoglide_cal.model.plan import Floats, Ints, Numbers, ReadOnly, read_only
from orthoglide_cal.model.readings import AXES

# Sine of the angle between the legs below which a posture counts as singular.
SINGULAR = 1e-9
UNREACHED = (
    "The legs do not reach each other at these joint positions.",
    "Use joint positions inside the limits of the machine.",
)


@dataclass(frozen=True, eq=False)
class Geometry(ReadOnly):
    """Rails and legs."""

    points: Numbers  # a_i, one point of each rail, shape (..., 3, 3), row i for rail i [mm]
    directions: Numbers  # u_i, unit vectors, shape (..., 3, 3), row i for rail i
    lengths: Numbers  # L_i, shape (..., 3) [mm]

    def tool_for(self, joints: Numbers, strict: bool = True) -> Numbers:
        """Direct kinematics: p (..., 3) [mm] for true joint positions (..., 3) [mm].

        NaN where the legs do not reach each other; if `strict`, that raises PostureError.
        """
        tool = Points.of(self, joints[..., None, :], strict).tool
        return np.asarray(Points.batch_first(tool, 1)[0])

    def joints_for(self, tool: Numbers) -> Numbers:
        """Inverse kinematics: true joint positions q (..., 3) that put the tool at p (..., 3) [mm].

        All signs of eq. (3) are +, the prototype's (errata). Raises PostureError: a leg is too
        short to reach the point from its rail.
        """
        from_rail = tool[..., None, :] - self.points
        along = (from_rail * self.directions).sum(axis=-1)
        root2 = self.lengths**2 - (from_rail**2).sum(axis=-1) + along**2
        if np.any(root2.real < 0.0):
            *place, leg = (int(k) for k in np.argwhere(root2.real < 0.0)[0])
            batch = np.broadcast_to(tool, (*root2.shape[:-1], 3))
            at = ", ".join(f"{c:.3f}" for c in batch[tuple(place)].real)
            fault = f"Leg {AXES[leg]} is too short to reach the point ({at}) mm from its rail."
            raise PostureError(fault, "Choose a point inside the workspace.")
        return np.asarray(along + np.sqrt(root2))


@dataclass(frozen=True, eq=False)
class Command(ReadOnly):
    """Places to which the controller sends the carriages, for n readings or positions."""

    joints: Floats  # indicated joint positions ρ, shape (n, 3) [mm]
    home: float  # joint position from which travel counts [mm]
    hours: Floats  # since the first reading, shape (n,) [h]
    entered: Floats  # offsets entered in the controller since the first of them, (n, 3) [mm]
    approach: Floats  # sign of each carriage's last motion, (n, 3); 0 before its first

    @cached_property
    def sent(self) -> Floats:
        """Joints as they would be indicated had nothing been entered, shape (n, 3) [mm]."""
        return read_only(self.joints - self.entered)

    @staticmethod
    def approach_of(joints: Floats, in_time: Ints) -> Floats:
        """`approach` on the way along joints (n, 3), by their indices from first to last."""
        approach, moves = np.zeros_like(joints), np.zeros((len(in_time), 3))
        moves[1:] = np.sign(np.diff(joints[in_time], axis=0))
        moments = np.arange(len(moves))[:, None]
        last = np.maximum.accumulate(np.where(moves != 0.0, moments, 0), axis=0)
        approach[in_time] = np.take_along_axis(moves, last, axis=0)
        return approach


# Derivative of the joints under a command by q unknowns, offsets first, (..., n, 3, q); and that of
# readings, (..., n, q), from it, or from None where only offsets move the carriages.
ByUnknowns = Callable[[Command], Floats]
Derivative = Callable[[ByUnknowns | None], Floats]
# What n gauges or probes are pushed to, (..., n) [mm]; what they touch: the place along the leg,
# from carriage joint (0) to tool (1), (..., n), or the tool, in radii of the bed, (..., n, 3); and
# the derivative, None where it is not known in closed form.
GaugeResponse = tuple[Numbers, Numbers, Derivative | None]


@dataclass(frozen=True, eq=False)
class RealMachine:
    """A machine with its accepted causes, as rails and joints."""

    geometry: Geometry
    # What moves the carriages away from where the offsets alone put them, in order: joints
    # (..., n, 3) and a `command` → joints [mm].
    motions: tuple[Callable[..., Numbers], ...]
    still: bool  # none of them does: the offsets alone move the carriages

    def joints(self, command: Command, offsets: Numbers) -> Numbers:
        """Places where the carriages really stand, shape (..., n, 3) [mm].

        True joint position = indicated + Δρ − entered, with `offsets` Δρ, shape (..., 3) [mm].
        """
        joints: Numbers = command.sent + offsets[..., None, :]
        for motion in self.motions:
            joints = motion(joints, command=command)
        return joints


class Points(NamedTuple):
    """The machine's points at m moments; components first, then moments, then the batch."""

    directions: Numbers  # u_i, shape (3, 3, 1, ...)
    centres: Numbers  # b_i, shape (3, 3, m, ...) [mm]
    tool: Numbers  # p, shape (3, m, ...) [mm]; see `trilaterate`

    @classmethod
    def of(cls, geometry: Geometry, joints: Numbers, strict: bool = False) -> "Points":
        """Direct kinematics for true joint positions (..., m, 3) [mm], as `Geometry.tool_for`."""
        rails, lengths = (geometry.points, geometry.directions), geometry.lengths
        batch = max(joints.ndim, *(values.ndim for values in rails), lengths.ndim + 1) - 2
        points, directions = (components(values, 2, batch + 1) for values in rails)
        lengths = components(lengths, 1, batch + 1)
        centres = points + components(joints.swapaxes(-1, -2), 2, batch)[:, None] * directions
        tool = trilaterate(centres, lengths)
        if strict and np.isnan(tool).any():
            raise PostureError(*UNREACHED)
        return cls(directions, centres, tool)

    @staticmethod
    def batch_first(values: Numbers, axes: int) -> Numbers:
        """Move the first `axes` axes behind the batch: the inverse of `components`."""
        return values.transpose(*range(axes, values.ndim), *range(axes))

    @property
    def tool_derivative(self) -> Numbers:
        """Jacobian ∂p/∂q (eq. 5 inverted), shape (3, 3, m, ...); NaN where it is singular.

        From the differentiated sphere equations (p − b_i)·(dp − u_i dq_i) = 0.
        """
        legs = self.tool - self.centres
        columns = [_cross(legs[k - 2], legs[k - 1]) for k in range(3)]
        volume = _dot(legs[0], columns[0])
        size2 = _dot(columns[0], columns[0]) * _dot(legs[0], legs[0])
        flat = np.abs(volume) <= SINGULAR * np.sqrt(np.abs(size2))
        inverse = 1.0 / np.where(flat, np.nan, volume)
        matrix = np.empty((3, *columns[0].shape), columns[0].dtype)
        for k in range(3):
            along = _dot(legs[k], self.directions[k])
            np.multiply(columns[k], along * inverse, out=matrix[:, k, ...])
        return matrix


def components(values: Numbers, axes: int, batch: int | None = None) -> Numbers:
    """Move the last `axes` axes to the front, with axes of length 1 up to `batch` behind them."""
    leading = values.ndim - axes
    moved = values.transpose(*range(leading, values.ndim), *range(leading)).copy()
    missing = 0 if batch is None else batch - leading
    return moved.reshape(moved.shape[:axes] + (1,) * missing + moved.shape[axes:])


def _cross(a: Numbers, b: Numbers) -> Numbers:
    """Cross product over the first axis, (3, ...)."""
    a, b = np.concatenate((a, a[:2])), np.concatenate((b, b[:2]))
    product = a[1:4] * b[2:5]
    product -= a[2:5] * b[1:4]
    return np.asarray(product)


def _dot(a: Numbers, b: Numbers) -> Numbers:
    """Scalar product over the first axis, (3, ...) → (...)."""
    return np.asarray(np.einsum("i...,i...->...", a, b))


def trilaterate(centres: Numbers, lengths: Numbers) -> Numbers:
    """The point p, shape (3, ...) [mm], at distance `lengths` from three centres.

    On the side of the prototype's assembly, m = −1 in eq. (4) (errata, sec. 2.4): the three centres
    run clockwise as seen from p.

    Centres are b_i, shape (3, 3, ...), lengths (3, ...) [mm]. NaN where the spheres have no common
    point, or the centres lie on a line.
    """
    first = centres[0]
    to_second, to_third = centres[1:] - first
    normal = _cross(to_second, to_third)
    area2 = _dot(normal, normal)
    second2, third2 = _dot(to_second, to_second), _dot(to_third, to_third)
    on_a_line = area2.real <= SINGULAR**2 * np.abs(second2 * third2)
    area2 = np.where(on_a_line, np.nan, area2)
    squares = lengths**2
    half_second = 0.5 * (second2 + squares[0] - squares[1])
    half_third = 0.5 * (third2 + squares[0] - squares[2])
    in_plane = _cross(half_second * to_third - half_third * to_second, normal) / area2
    height2 = squares[0] - _dot(in_plane, in_plane)
    height = np.sqrt(np.where(height2.real < 0.0, np.nan, height2) / area2)
    return np.asarray(first + in_plane - height * normal)
