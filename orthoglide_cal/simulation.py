"""What every gauge should read on a given machine: the forward model used everywhere.

A reading is made in four steps, and whatever is wrong with it acts in exactly one of them:

    geometry   where the rails and legs are            a_i, u_i, L_i
    motion     where the carriages really stand        q = ρ + Δρ
    contact    what the gauge touches                  Table 2, eqs. (18)–(24)
    record     what was written down

Predicted readings are those of gauges whose zero is the frame's origin; each real gauge adds
its own unknown zero, which the estimation removes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Ints, Numbers
from orthoglide_cal.effects import Commanded, Effect
from orthoglide_cal.errors import PostureError
from orthoglide_cal.kinematics.rails import (
    Geometry,
    tool_derivative_components,
    trilaterate_components,
)
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan

# Step of complex-step derivatives: its square vanishes beside 1, so they are exact.
STEP = 1e-30
# Place of the isotropic posture, where the gauges were set up, behind the moments of a plan.
ISO = -1


def doubtful(machine: Machine, offsets: Floats, plan: Plan, effects: Sequence[Effect]) -> Floats:
    """What one standard deviation of each doubt about known effects adds to readings, (n, p)."""
    moved = [
        (*effects[:k], other, *effects[k + 1 :])
        for k, effect in enumerate(effects)
        for other in effect.doubts()
    ]
    if not moved:
        return np.zeros((len(plan), 0))
    before = simulate(machine, offsets, plan, effects)
    columns = [simulate(machine, offsets, plan, others) - before for others in moved]
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class _Posture:
    """The machine's points at m moments; components first, then moments, then the batch."""

    directions: Numbers  # u_i, (3, 3, 1, ...)
    centres: Numbers  # b_i, (3, 3, m, ...)
    tool: Numbers  # p, (3, m, ...)

    @classmethod
    def of(cls, geometry: Geometry, joints: Numbers, batch: int, strict: bool) -> _Posture:
        """Direct kinematics for joints with components first, (3, m, ...), `batch` axes in all."""
        points, directions = (
            _components(values, 2, batch + 1) for values in (geometry.points, geometry.directions)
        )
        lengths = _components(geometry.lengths, 1, batch + 1)
        joints = joints.reshape(
            joints.shape[:2] + (1,) * (batch + 2 - joints.ndim) + joints.shape[2:]
        )
        centres = points + joints[:, None] * directions
        return cls(directions, centres, trilaterate_components(centres, lengths, strict=strict))


def _moments(commanded: Commanded, effects: Sequence[Effect]) -> tuple[Floats, Ints]:
    """Distinct commanded joints (m, 3) and the moment of each reading (n,).

    A motion effect may depend on time, so with effects every reading is its own moment.
    """
    if effects:
        return commanded.joints, np.arange(len(commanded.plan))
    first, moment = commanded.plan.moments
    return commanded.joints[first], moment


def _true_joints(
    commanded: Commanded, indicated: Floats, offsets: Numbers, effects: Sequence[Effect]
) -> Numbers:
    """Where the carriages stand at each moment and, last, at the isotropic posture.

    Args:
        commanded: the plan on its machine.
        indicated: joints at m moments, shape (m, 3) [mm].
        offsets: Δρ, shape (..., 3) [mm].
        effects: their motions are applied.

    Returns:
        Components first, shape (3, m + 1, ...) [mm].
    """
    isotropic = np.full((1, 3), commanded.machine.leg_length_mm)
    if not effects:
        both = np.concatenate((indicated, isotropic)).T
        return _column(both, offsets.ndim - 1) + _components(offsets, 1)[:, None]
    joints = indicated + offsets[..., None, :]
    for effect in effects:
        joints = effect.motion(joints, commanded)
    gauged = np.broadcast_to(isotropic + offsets[..., None, :], (*joints.shape[:-2], 1, 3))
    return _components(np.concatenate((joints, gauged), axis=-2).swapaxes(-1, -2), 2)


def simulate(
    machine: Machine,
    offsets: Numbers,
    plan: Plan,
    effects: Sequence[Effect] = (),
    geometry: Geometry | None = None,
) -> Numbers:
    """Predicted readings for joint offsets on a machine (Table 2 with the errata).

    Args:
        machine: nominal machine; the controller computes its commands from it.
        offsets: Δρ, shape (..., 3) [mm].
        plan: n readings to predict.
        effects: what the nominal model leaves out, applied in the order given in each step.
        geometry: rails and legs before any effect; nominal if None. Its leading axes broadcast
            with those of the offsets, so that many machines are simulated in one call.

    Returns:
        Readings, shape (..., n) [mm], with the gauge zeros at the origin of the frame.

    Raises:
        UnreachableError, SingularError: a posture that this machine cannot take.
    """
    return _simulate(machine, np.asarray(offsets), plan, effects, geometry)[0]


def simulate_with_jacobian(
    machine: Machine,
    offsets: Floats,
    plan: Plan,
    effects: Sequence[Effect] = (),
    geometry: Geometry | None = None,
    strict: bool = True,
) -> tuple[Floats, Floats]:
    """`simulate`, and its exact derivative by the offsets.

    In closed form without effects, by complex steps with them.

    Args:
        strict: raise if any of the batch is unreachable; otherwise its readings are NaN.

    Returns:
        Readings (..., n) [mm] and ∂readings/∂Δρ (..., n, 3).
    """
    point = np.asarray(offsets, dtype=np.float64)
    if not effects:
        return _simulate(machine, point, plan, (), geometry, strict, derivative=True)
    readings, _ = _simulate(machine, point, plan, effects, geometry, strict)
    steps = point[..., None, :] + 1j * STEP * np.eye(3)
    stepped = [
        _simulate(machine, steps[..., k, :], plan, effects, geometry, strict)[0].imag / STEP
        for k in range(3)
    ]
    return readings, np.stack(stepped, axis=-1)


def _simulate(
    machine: Machine,
    offsets: Numbers,
    plan: Plan,
    effects: Sequence[Effect],
    geometry: Geometry | None,
    strict: bool = True,
    derivative: bool = False,
) -> tuple[Numbers, Numbers]:
    commanded = Commanded(machine, plan)
    real = Geometry.nominal(machine) if geometry is None else geometry
    for effect in effects:
        real = effect.geometry(real)

    indicated, moment = _moments(commanded, effects)
    joints = _true_joints(commanded, indicated, offsets, effects)
    batch = max(
        joints.ndim - 2, real.points.ndim - 2, real.directions.ndim - 2, real.lengths.ndim - 1
    )
    try:
        posture = _Posture.of(real, joints, batch, strict)
    except PostureError as error:
        named = _which(_Posture.of(real, joints, batch, strict=False), plan, moment)
        raise type(error)(f"{named}: {error.what}", error.remedy) from error

    leg, direction = plan.leg, plan.direction
    gauge_at = _column(plan.gauge_at, batch)
    carriage, side = posture.centres[leg, leg, moment], posture.centres[leg, direction, moment]
    # The gauge's place along the leg's axis, and the point of the leg that it now touches.
    place = (1.0 - gauge_at) * posture.centres[leg, leg, ISO] + gauge_at * posture.tool[leg, ISO]
    span = posture.tool[leg, moment] - carriage
    across = posture.tool[direction, moment] - side
    fixed = plan.contact == Contact.FIXED
    fraction = (place - carriage) / span
    if not np.all(fixed):
        at_tool = _column(plan.contact == Contact.TOOL, batch)
        fraction = np.where(_column(fixed, batch), fraction, at_tool)
    readings = np.moveaxis(side + fraction * across, 0, -1)
    for effect in effects:
        readings = effect.contact(readings, np.moveaxis(fraction, 0, -1), commanded)
    for effect in effects:
        readings = effect.record(readings, commanded)
    if not derivative:
        return readings, readings

    # The same chain differentiated by q: d carriage = u_i dq_i, d tool = (∂p/∂q) dq, and
    # d fraction = (d place − d carriage − fraction·d span)/span, zero where the gauge is not fixed.
    # In place, because fresh memory for such long arrays costs more than the arithmetic.
    slope = tool_derivative_components(posture.centres, posture.directions, posture.tool)
    turn = _column(fixed, batch) * across / span
    jacobian = slope[direction, :, moment]
    jacobian *= fraction[:, None]
    part = slope[leg, :, moment]
    part *= (turn * fraction)[:, None]
    jacobian -= part
    np.take(slope[:, :, ISO], leg, axis=0, out=part)
    part *= (turn * gauge_at)[:, None]
    jacobian += part
    own, sideways = posture.directions[leg, leg, 0], posture.directions[leg, direction, 0]
    jacobian[np.arange(len(plan)), leg] += turn * (fraction - gauge_at) * own
    jacobian[np.arange(len(plan)), leg] += (1.0 - fraction) * sideways
    return readings, np.moveaxis(jacobian, (0, 1), (-2, -1))


def _which(posture: _Posture, plan: Plan, moment: Ints) -> str:
    """The first posture that the machine cannot take, in words."""
    failed = np.isnan(posture.tool[0])
    bad = np.flatnonzero(failed.any(axis=tuple(range(1, failed.ndim)))[moment])
    if not bad.size:
        return "Isotropic posture"
    return f"Leg {AXES[plan.leg[bad[0]]]} displaced by {plan.displacement[bad[0]]:g} mm"


def _components(values: Numbers, axes: int, batch: int | None = None) -> Numbers:
    """Move the last `axes` axes to the front, with axes of length 1 up to `batch` behind them."""
    own = values.ndim - axes
    moved = values.transpose(*range(own, values.ndim), *range(own)).copy()
    missing = 0 if batch is None else batch - own
    return moved.reshape(moved.shape[:axes] + (1,) * missing + moved.shape[axes:])


def _column(values: Numbers, batch: int) -> Numbers:
    """Append `batch` axes of length 1."""
    array = np.asarray(values)
    return array.reshape(array.shape + (1,) * batch)
