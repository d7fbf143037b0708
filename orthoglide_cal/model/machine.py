"""The machine: what is known of it before it is measured, and the kinematics of its rails.

The general machine has three straight rails in any position and direction, and any leg lengths:

    carriage centre   b_i = a_i + q_i u_i          (q_i: true joint position)
    leg               |p − b_i| = L_i              (eq. 1 for any rails)

Direct kinematics is the intersection of three spheres in closed form; inverse kinematics is
the intersection of a sphere and a line. Everything is batched and stays valid for complex
input, so that derivatives can be taken by a complex step. Lengths are mm; nothing reads files.

Functions named `…_components` take matrix and vector indices as the first axes and the batch
as the last ones, (3, 3, ...): many small vectors are then handled as few long arrays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import SingularError, UnreachableError
from orthoglide_cal.model.plan import Numbers, ReadOnly
from orthoglide_cal.model.readings import AXES, Posture

# Sine of the angle between the legs below which a posture counts as singular.
SINGULAR = 1e-9
# Where the machine file says nothing of a gauge: a stand put by eye or with a rule is within a
# millimetre or so; dial indicators may be off by 15 µm in 10 mm, and a plunger that leans by 2°
# reads 0.06 % short.
PLACEMENT_MM = 1.0
SCALE_U = 0.001


@dataclass(frozen=True)
class Gauge:
    """A dial indicator.

    Attributes:
        resolution_mm: smallest step that it shows.
        range_mm: travel of the plunger.
        revolution_mm: travel of one turn of the dial; None for a gauge without a dial.
        repeatability_mm: standard deviation of one reading as the maker or the last check states.
        placement_mm: how well its stand is put at its place along the leg, one standard deviation;
            None if nobody stated it.
        scale_u: standard uncertainty of its scale (1); None if nobody stated it.
    """

    resolution_mm: float
    range_mm: float
    revolution_mm: float | None
    repeatability_mm: float
    placement_mm: float | None = None
    scale_u: float | None = None

    @property
    def placement_std_mm(self) -> float:
        """`placement_mm`, or its default."""
        return PLACEMENT_MM if self.placement_mm is None else self.placement_mm

    @property
    def scale_std(self) -> float:
        """`scale_u`, or its default."""
        return SCALE_U if self.scale_u is None else self.scale_u

    @cached_property
    def rounding_mm(self) -> float:
        """Standard deviation q/√12 that the resolution q alone gives to a reading [mm]."""
        return self.resolution_mm / math.sqrt(12.0)

    @cached_property
    def noise_mm(self) -> float:
        """Standard deviation to expect of one reading: repeatability and rounding [mm]."""
        return math.hypot(self.repeatability_mm, self.rounding_mm)


class Entered(NamedTuple):
    """Offsets that were entered in the controller.

    Attributes:
        date: when, ISO 8601.
        before_mm, after_mm: active before and from then on (x, y, z).
        data_sha256: digest of the measurement that they came from.
    """

    date: str
    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]
    data_sha256: str


@dataclass(frozen=True)
class Details:
    """What the people who read a report want to see on it; None where it is not given.

    Attributes:
        organisation, place: who calibrates, and where.
        serial_number: of the machine.
        customer: whose it is.
        method: procedure by which it is calibrated.
        gauge_due: day on which the gauge is to be calibrated again, ISO 8601.
    """

    organisation: str | None = None
    place: str | None = None
    serial_number: str | None = None
    customer: str | None = None
    method: str | None = None
    gauge_due: str | None = None


@dataclass(frozen=True)
class Machine:
    """The nominal machine: three actuated rails, three legs, one tool centre point.

    Attributes:
        name: for people.
        leg_length_mm: L, parallelogram length.
        parallelogram_width_mm: d.
        tool_offset_mm: r, from the leg's end C to the tool centre point.
        joint_limits_mm: (min, max) displacement from the isotropic posture (errata, eq. 2).
        workspace_mm: edge of the cube-like workspace.
        gauge: the indicator normally used on it.
        offsets_mm: joint offsets already active in the controller (x, y, z).
        tolerances: cause id → plausible size (one standard deviation, contract's unit), 0 for a
            cause that is ruled out; `Cause.size` says what holds for the others.
        kind: id of the kind of machine, see `model.kinds`.
        homing_mm: how far a home switch can plausibly be off; None for what is usual of its kind.
        history: what was entered in the controller, oldest first.
        report: what its reports say of it beside the numbers.
    """

    name: str
    leg_length_mm: float
    parallelogram_width_mm: float
    tool_offset_mm: float
    joint_limits_mm: tuple[float, float]
    workspace_mm: float
    gauge: Gauge
    offsets_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    tolerances: Mapping[str, float] = field(default_factory=dict, hash=False)
    kind: str = "orthoglide"
    homing_mm: float | None = None
    history: tuple[Entered, ...] = ()
    report: Details = Details()

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerances", MappingProxyType(dict(self.tolerances)))

    def displacement_mm(self, posture: Posture) -> float:
        """Displacement of the leg's own carriage at a posture [mm]."""
        low, high = self.joint_limits_mm
        return {Posture.ISO: 0.0, Posture.MAX: high, Posture.MIN: low}[posture]

    def entered_from(self, sha256: str) -> Entered | None:
        """What was entered from the measurement with this digest; None if nothing was."""
        return next((each for each in self.history if each.data_sha256 == sha256), None)

    def posture_at(self, displacement: float) -> Posture | None:
        """The named posture at a displacement [mm]; None for any other."""
        return next((p for p in Posture if self.displacement_mm(p) == displacement), None)


@dataclass(frozen=True, eq=False)
class Geometry(ReadOnly):
    """Where the rails are and how long the legs are.

    Attributes:
        points: a_i, one point of each rail, shape (..., 3, 3), row i for rail i [mm].
        directions: u_i, unit vectors, shape (..., 3, 3), row i for rail i.
        lengths: L_i, shape (..., 3) [mm].
    """

    points: Numbers
    directions: Numbers
    lengths: Numbers

    def carriages(self, joints: Numbers) -> Numbers:
        """Carriage centres b_i for true joint positions (..., 3) → (..., 3, 3), row per leg."""
        return np.asarray(self.points + joints[..., None] * self.directions)


class Points(NamedTuple):
    """The machine's points at m moments; components first, then moments, then the batch.

    Attributes:
        directions: u_i, shape (3, 3, 1, ...).
        centres: b_i, shape (3, 3, m, ...) [mm].
        tool: p, shape (3, m, ...) [mm].
    """

    directions: Numbers
    centres: Numbers
    tool: Numbers

    @classmethod
    def of(cls, geometry: Geometry, joints: Numbers, batch: int, strict: bool) -> Points:
        """Direct kinematics for joints with components first, (3, m, ...), `batch` axes in all."""
        points, directions = (
            components(values, 2, batch + 1) for values in (geometry.points, geometry.directions)
        )
        lengths = components(geometry.lengths, 1, batch + 1)
        joints = joints.reshape(
            joints.shape[:2] + (1,) * (batch + 2 - joints.ndim) + joints.shape[2:]
        )
        centres = points + joints[:, None] * directions
        return cls(directions, centres, trilaterate_components(centres, lengths, strict=strict))


def batch_of(joints: Numbers, geometry: Geometry) -> int:
    """Number of batch axes of joints with components first, (3, m, ...), on rails of a batch."""
    own = geometry.points.ndim - 2, geometry.directions.ndim - 2, geometry.lengths.ndim - 1
    return max(joints.ndim - 2, *own)


def components(values: Numbers, axes: int, batch: int | None = None) -> Numbers:
    """Move the last `axes` axes to the front, with axes of length 1 up to `batch` behind them."""
    own = values.ndim - axes
    moved = values.transpose(*range(own, values.ndim), *range(own)).copy()
    missing = 0 if batch is None else batch - own
    return moved.reshape(moved.shape[:axes] + (1,) * missing + moved.shape[axes:])


def behind_batch(values: Numbers, axes: int) -> Numbers:
    """Undo `components`: move the first `axes` axes to the end."""
    return values.transpose(*range(axes, values.ndim), *range(axes))


def column(values: Numbers, batch: int) -> Numbers:
    """Append `batch` axes of length 1."""
    array = np.asarray(values)
    return array.reshape(array.shape + (1,) * batch)


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


def trilaterate(centres: Numbers, lengths: Numbers, strict: bool = True) -> Numbers:
    """The point at distance `lengths` from three centres, on the side of the prototype's assembly.

    That is p = 0 at the isotropic posture, m = −1 in eq. (4) (errata, sec. 2.4): the three centres
    run clockwise as seen from p.

    Args:
        centres: shape (..., 3, 3), row i is b_i [mm].
        lengths: shape (..., 3) [mm].
        strict: raise if any of the batch has no solution; otherwise its entry is NaN.

    Returns:
        p, shape (..., 3) [mm].

    Raises:
        UnreachableError: the three spheres have no common point.
        SingularError: the three centres lie on a line.
    """
    point = trilaterate_components(components(centres, 2), components(lengths, 1), strict)
    return behind_batch(point, 1)


def trilaterate_components(centres: Numbers, lengths: Numbers, strict: bool = True) -> Numbers:
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
    height = np.sqrt(np.where(apart, np.nan, height2) / area2)
    return np.asarray(first + in_plane - height * normal)


def rail_position(geometry: Geometry, tool: Numbers) -> Numbers:
    """Inverse kinematics: true joint positions that put the tool centre point at `tool`.

    The carriages stand ahead of the tool: all signs of eq. (3) are +, the prototype's.

    Args:
        geometry: the rails and legs.
        tool: p, shape (..., 3) [mm].

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
    return np.asarray(along + np.sqrt(root2))


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
        components(centres, 2), components(geometry.directions, 2), components(tool, 1)
    )
    if not np.all(np.isfinite(matrix)):
        raise SingularError(
            "The three legs lie in one plane: the machine is singular at this posture.",
            "Choose a posture inside the workspace.",
        )
    return behind_batch(matrix, 2)


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
