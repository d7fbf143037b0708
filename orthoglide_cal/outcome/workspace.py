"""How far the tool is from where the controller believes it to be, over the workspace.

The controller commands ρ = inverse kinematics of p on the nominal machine. The tool really goes
to p' = direct kinematics of the real machine at ρ + Δρ.

    before: |p' − p| with the identified offsets (and accepted causes)
    after:  |p' − p| with the offsets entered, plus k·u of the tool position that their
            uncertainty leaves: an upper bound
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Commanded, Effect
from orthoglide_cal.kinematics import (
    Geometry,
    inverse,
    rail_position,
    tool_derivative,
    trilaterate,
)
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan

SAMPLES = 17  # along each edge of the cube


@dataclass(frozen=True, eq=False)
class WorkspaceError:
    """Tool-position error over a cube inside the joint limits [mm].

    Attributes:
        axis_mm: grid along each edge, shape (n,).
        levels_mm: heights z of the slices, shape (3,).
        before_mm, after_mm: at [slice, y, x], shape (3, n, n).
        before_max_mm, before_mean_mm, after_max_mm, after_mean_mm: over the whole cube.
        nominal_edge_mm: edge of the workspace as the machine file states it.
    """

    axis_mm: Floats
    levels_mm: Floats
    before_mm: Floats
    after_mm: Floats
    before_max_mm: float
    before_mean_mm: float
    after_max_mm: float
    after_mean_mm: float
    nominal_edge_mm: float


@dataclass(frozen=True, eq=False)
class Standing(Commanded):
    """Carriages standing at given indicated joints, without a past and at time zero."""

    indicated: Floats

    @property
    def joints(self) -> Floats:
        """Indicated joint positions ρ, shape (n, 3) [mm]."""
        return self.indicated

    @property
    def approach(self) -> Floats:
        """No carriage has moved, shape (n, 3)."""
        return np.zeros_like(self.indicated)


def standing(machine: Machine, joints: Floats) -> Standing:
    """The controller's command of joints (n, 3) [mm], for effects that act on motion."""
    n = len(joints)
    zero = np.zeros(n)
    index = np.zeros(n, dtype=np.intp)
    plan = Plan(index, index + 1, zero, index, zero, index, np.arange(n), zero)
    return Standing(machine, plan, joints)


def real_geometry(machine: Machine, effects: Sequence[Effect]) -> Geometry:
    """Rails and legs with the effects."""
    geometry = Geometry.nominal(machine)
    for effect in effects:
        geometry = effect.geometry(geometry)
    return geometry


def true_joints(
    machine: Machine, indicated: Floats, offsets: Floats, effects: Sequence[Effect]
) -> Floats:
    """Where the carriages really stand, shape (n, 3) [mm]."""
    command = standing(machine, indicated)
    joints: Floats = indicated + offsets
    for effect in effects:
        joints = effect.motion(joints, command)
    return joints


def reachable_cube(machine: Machine) -> tuple[float, float]:
    """(low, high): the cube [low, high]³ within the joint limits, no larger than the workspace.

    The limits are displacements of the carriages: p_i + √(L² − p_j² − p_k²) − L. The largest is
    at the middle of the upper face; the smallest at the corner (low, ±m, ±m), m the larger of
    |low| and high.
    """
    low_limit, high_limit = machine.joint_limits_mm
    length = machine.leg_length_mm
    # Whatever the limits allow, no farther than half a leg from the origin: legs stay long enough.
    high = min(high_limit, length / 2.0)

    def smallest(low: float) -> float:
        reach2 = length**2 - 2.0 * max(-low, high) ** 2
        return low + float(np.sqrt(reach2)) - length if reach2 > 0.0 else -np.inf

    inner, outer = 0.0, -length / 2.0
    for _ in range(60):
        middle = (inner + outer) / 2.0
        inner, outer = (middle, outer) if smallest(middle) >= low_limit else (inner, middle)
    low = outer if smallest(outer) >= low_limit else inner
    excess = max(high - low - machine.workspace_mm, 0.0) / 2.0
    return low + excess, high - excess


def workspace_error(
    machine: Machine,
    offsets: Floats,
    covariance: Floats,
    k: float,
    effects: Sequence[Effect] = (),
) -> WorkspaceError:
    """Tool-position error before and after the offsets are entered.

    Args:
        offsets: Δρ that the controller does not know yet, shape (3,) [mm].
        covariance: of the offsets, shape (3, 3) [mm²].
        k: coverage factor for the uncertainty that remains.
        effects: accepted causes; entering offsets does not compensate them.
    """
    low, high = reachable_cube(machine)
    axis = np.linspace(low, high, SAMPLES)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    points = np.stack((x, y, z), axis=-1).reshape(-1, 3)
    indicated = inverse(points, machine.leg_length_mm)
    geometry = real_geometry(machine, effects)

    def reached(remaining: Floats) -> tuple[Floats, Floats]:
        joints = true_joints(machine, indicated, remaining, effects)
        return joints, trilaterate(geometry.carriages(joints), geometry.lengths)

    before = np.linalg.norm(reached(offsets)[1] - points, axis=-1)
    joints, tool = reached(np.zeros(3))
    slope = tool_derivative(geometry, joints, tool)
    spread = np.einsum("nij,jk,nik->n", slope, covariance, slope)
    after = np.linalg.norm(tool - points, axis=-1) + k * np.sqrt(spread)
    shape = (SAMPLES, SAMPLES, SAMPLES)
    levels = [0, SAMPLES // 2, SAMPLES - 1]
    return WorkspaceError(
        axis_mm=axis,
        levels_mm=axis[levels],
        before_mm=before.reshape(shape)[levels],
        after_mm=after.reshape(shape)[levels],
        before_max_mm=float(before.max()),
        before_mean_mm=float(before.mean()),
        after_max_mm=float(after.max()),
        after_mean_mm=float(after.mean()),
        nominal_edge_mm=machine.workspace_mm,
    )


def required_joints(machine: Machine, points: Floats, effects: Sequence[Effect]) -> Floats:
    """Indicated joints that really put the tool at `points`, offsets entered, (n, 3) → (n, 3).

    Motion effects are nearly the identity, so that a fixed-point iteration converges.

    Raises:
        UnreachableError: a leg is too short.
    """
    wanted = rail_position(real_geometry(machine, effects), points)
    indicated = wanted
    for _ in range(50):
        missing = wanted - true_joints(machine, indicated, np.zeros(3), effects)
        indicated = indicated + missing
        if float(np.abs(missing).max()) < 1e-9:
            break
    return np.asarray(indicated)
