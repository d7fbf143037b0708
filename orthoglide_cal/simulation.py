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
from functools import cached_property

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Numbers, read_only
from orthoglide_cal.errors import UnreachableError
from orthoglide_cal.kinematics import Geometry, tool_derivative, trilaterate
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan

# Step of complex-step derivatives: its square vanishes beside 1, so they are exact.
STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Commanded:
    """A plan on a machine: where the controller sends the carriages for each reading."""

    machine: Machine
    plan: Plan

    @cached_property
    def joints(self) -> Floats:
        """Indicated joint positions ρ at each reading, shape (n, 3) [mm].

        Leg i displaced by d: ρ_i = L + d and ρ_j = √(L² − d²) (sec. 2.5).

        Raises:
            UnreachableError: a displacement is not shorter than the legs.
        """
        length, moved = self.machine.leg_length_mm, self.plan.displacement
        if np.any(np.abs(moved) >= length):
            worst = int(np.argmax(np.abs(moved)))
            raise UnreachableError(
                f"Leg {AXES[self.plan.leg[worst]]} cannot be displaced by {moved[worst]:g} mm:"
                f" the legs are {length:g} mm long.",
                "Use a posture inside the joint limits.",
            )
        joints = np.repeat(np.sqrt(length**2 - moved**2)[:, None], 3, axis=1)
        joints[np.arange(len(self.plan)), self.plan.leg] = length + moved
        return read_only(joints, np.float64)

    @cached_property
    def approach(self) -> Floats:
        """Sign of each carriage's last commanded motion, shape (n, 3); 0 before its first one."""
        order = self.plan.in_time
        moves = np.sign(np.diff(self.joints[order], axis=0))
        approach = np.zeros((len(self.plan), 3))
        for k, move in enumerate(moves, start=1):
            approach[order[k]] = np.where(move != 0.0, move, approach[order[k - 1]])
        return read_only(approach, np.float64)


class Effect:
    """Something that the nominal model leaves out; a subclass overrides exactly one step.

    Leading axes of an effect's own parameters broadcast with those of the offsets.
    """

    def geometry(self, geometry: Geometry) -> Geometry:
        """Rails and legs as they really are."""
        return geometry

    def motion(self, joints: Numbers, commanded: Commanded) -> Numbers:
        """True joint positions (..., n, 3) from those that the offsets alone would give [mm]."""
        return joints

    def contact(self, heights: Numbers, fraction: Numbers, commanded: Commanded) -> Numbers:
        """Gauge positions (..., n) [mm]; `fraction` is where on the leg the gauge touches."""
        return heights

    def record(self, readings: Numbers, commanded: Commanded) -> Numbers:
        """What was written down (..., n) [mm]."""
        return readings


@dataclass(frozen=True, eq=False)
class _Posture:
    """The machine's points at each moment, and which moment each reading belongs to."""

    geometry: Geometry  # arrays with an axis of length 1 for the moments
    joints: Numbers  # (..., m, 3)
    centres: Numbers  # (..., m, 3, 3)
    tool: Numbers  # (..., m, 3)

    @classmethod
    def of(cls, geometry: Geometry, joints: Numbers) -> _Posture:
        spread = Geometry(
            geometry.points[..., None, :, :],
            geometry.directions[..., None, :, :],
            geometry.lengths[..., None, :],
        )
        centres = spread.carriages(joints)
        return cls(spread, joints, centres, trilaterate(centres, spread.lengths))

    def tool_derivative(self) -> Numbers:
        return tool_derivative(self.geometry, self.joints, self.tool)


def _moments(commanded: Commanded, effects: Sequence[Effect]) -> tuple[Floats, np.ndarray]:
    """Distinct commanded joints (m, 3) and the moment of each reading (n,).

    A motion effect may depend on time, so with effects every reading is its own moment.
    """
    if effects:
        return commanded.joints, np.arange(len(commanded.plan))
    plan = commanded.plan
    keys = np.stack((np.where(plan.displacement == 0.0, 0, plan.leg), plan.displacement), axis=1)
    _, first, moment = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return commanded.joints[first], moment.reshape(-1)


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
    return _simulate(machine, np.asarray(offsets), plan, effects, geometry, derivative=False)[0]


def simulate_with_jacobian(
    machine: Machine, offsets: Floats, plan: Plan, geometry: Geometry | None = None
) -> tuple[Floats, Floats]:
    """`simulate` without effects, and its exact derivative by the offsets.

    Returns:
        Readings (..., n) [mm] and ∂readings/∂Δρ (..., n, 3).
    """
    return _simulate(machine, np.asarray(offsets), plan, (), geometry, derivative=True)


def _simulate(
    machine: Machine,
    offsets: Numbers,
    plan: Plan,
    effects: Sequence[Effect],
    geometry: Geometry | None,
    derivative: bool,
) -> tuple[Numbers, Numbers]:
    commanded = Commanded(machine, plan)
    real = Geometry.nominal(machine) if geometry is None else geometry
    for effect in effects:
        real = effect.geometry(real)

    indicated, moment = _moments(commanded, effects)
    joints = indicated + offsets[..., None, :]
    for effect in effects:
        joints = effect.motion(joints, commanded)
    isotropic = _Posture.of(real, machine.leg_length_mm + offsets[..., None, :])
    posture = _Posture.of(real, joints)

    n = np.arange(len(plan))
    leg, direction = plan.leg, plan.direction
    carriage = posture.centres[..., moment, leg, :]
    tool = posture.tool[..., moment, :]
    carriage_0, tool_0 = isotropic.centres[..., 0, leg, :], isotropic.tool
    # The gauge's place along the leg's axis, and the point of the leg that it now touches.
    along, along_0 = (n, leg), (np.zeros_like(n), leg)
    place = (1.0 - plan.gauge_at) * carriage_0[..., n, leg] + plan.gauge_at * tool_0[..., *along_0]
    span = tool[..., *along] - carriage[..., *along]
    fraction = np.where(
        plan.contact == Contact.FIXED,
        (place - carriage[..., *along]) / span,
        np.asarray(plan.contact == Contact.TOOL, dtype=np.float64),
    )
    across = tool[..., n, direction] - carriage[..., n, direction]
    heights = carriage[..., n, direction] + fraction * across
    for effect in effects:
        heights = effect.contact(heights, fraction, commanded)
    readings = heights
    for effect in effects:
        readings = effect.record(readings, commanded)
    if not derivative:
        return readings, readings

    # The same chain differentiated: d carriage = u_i dq_i, d tool = (∂p/∂q) dq.
    d_tool = posture.tool_derivative()[..., moment, :, :]
    d_tool_0 = isotropic.tool_derivative()[..., 0, :, :]
    own = np.eye(3)[leg]
    rail = real.directions[..., leg, :]
    d_carriage = rail[..., :, None] * own[:, None, :]
    d_place = (1.0 - plan.gauge_at)[:, None] * d_carriage[..., n, leg, :] + plan.gauge_at[
        :, None
    ] * d_tool_0[..., leg, :]
    d_along = d_carriage[..., n, leg, :]
    d_span = d_tool[..., n, leg, :] - d_along
    d_fraction = np.where(
        (plan.contact == Contact.FIXED)[:, None],
        (d_place - d_along - fraction[..., None] * d_span) / span[..., None],
        0.0,
    )
    d_side = d_carriage[..., n, direction, :]
    d_across = d_tool[..., n, direction, :] - d_side
    jacobian = d_side + d_fraction * across[..., None] + fraction[..., None] * d_across
    return readings, jacobian
