"""The Orthoglide: three orthogonal rails, gauges that touch the legs, two measuring protocols.

Everything that another kind of machine does differently is here: where the nominal rails are, how
the controller turns a wanted place into joints, which parameters a calibration determines, what a
gauge touches, and which readings a protocol takes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import UnreachableError
from orthoglide_cal.model.cause import Command
from orthoglide_cal.model.machine import (
    Geometry,
    Machine,
    Points,
    column,
    rail_position,
    tool_derivative_components,
)
from orthoglide_cal.model.readings import (
    AXES,
    Contact,
    Floats,
    Ints,
    Numbers,
    Plan,
    Posture,
    other_axes,
    places_of,
    read_only,
)

# Pace assumed where nobody measured the time: readings, and moves of the stand [min].
MINUTES_PER_POSTURE = 0.4
MINUTES_PER_SETUP = 4.0
POSTURES = (Posture.ISO, Posture.MAX, Posture.MIN)
HEIGHT = 2  # single-posture gauges can stand on the xy-surface only, so they measure along z


class Moments(NamedTuple):
    """Which of the machine's moments belong to n readings, as indices of shape (n,).

    Attributes:
        reading: when each was taken.
        set_up: when its gauge was set up, at the isotropic posture.
    """

    reading: Ints
    set_up: Ints


class Touch(NamedTuple):
    """What n gauges touch; readings first, then the batch.

    Attributes:
        heights: of the touched points, shape (n, ...) [mm].
        fraction: where on the leg, from carriage joint (0) to tool (1), shape (n, ...).
    """

    heights: Numbers
    fraction: Numbers


class Orthoglide:
    """The kind of machine of the paper; its joint offsets are what a calibration determines."""

    id = "orthoglide"
    calibrated = AXES
    # Causes that no reading tells from the offsets: a longer leg looks like a smaller offset.
    unseen = ("leg_length",)
    # The home switch or index pulse of such a carriage is set to within a few millimetres; an
    # offset beyond that is a wrong unit, label or machine file.
    homing_mm = 5.0

    def rails(self, machine: Machine) -> Geometry:
        """Orthogonal rails that meet in the origin, equal legs (modelling assumption iv)."""
        return Geometry(np.zeros((3, 3)), np.eye(3), np.full(3, machine.leg_length_mm))

    def home(self, machine: Machine) -> float:
        """Joint value of the isotropic posture, from which displacements count [mm]."""
        return machine.leg_length_mm

    def indicated(self, machine: Machine, tool: Floats) -> Floats:
        """Inverse kinematics of the controller: joints ρ for tool positions p (eq. 3, errata).

            ρ_i = p_i + √(L² − p_j² − p_k²)

        Args:
            machine: nominal machine.
            tool: p, shape (..., 3) [mm].

        Raises:
            UnreachableError: the point is farther than L from a rail.
        """
        return np.asarray(rail_position(self.rails(machine), np.asarray(tool, dtype=np.float64)))

    def joints_at(self, machine: Machine, leg: Ints | int, displacement: Floats | float) -> Floats:
        """Indicated joints with one leg displaced by d: ρ_i = L + d, ρ_j = √(L² − d²) (sec. 2.5).

        Args:
            machine: nominal machine.
            leg: 0, 1, 2, shape (...).
            displacement: d, shape (...) [mm].

        Returns:
            Shape (..., 3) [mm].

        Raises:
            UnreachableError: a displacement is not shorter than the legs.
        """
        length, moved = machine.leg_length_mm, np.asarray(displacement, dtype=np.float64)
        if np.any(np.abs(moved) >= length):
            worst = np.argmax(np.abs(moved))
            raise UnreachableError(
                f"Leg {AXES[int(np.ravel(leg)[worst])]} cannot be displaced by"
                f" {np.ravel(moved)[worst]:g} mm: the legs are {length:g} mm long.",
                "Use a posture inside the joint limits.",
            )
        own = np.asarray(leg)[..., None] == np.arange(3)
        return np.where(own, (length + moved)[..., None], np.sqrt(length**2 - moved**2)[..., None])

    def reachable_cube(self, machine: Machine) -> tuple[float, float]:
        """(low, high): the cube [low, high]³ within the joint limits, no larger than the workspace.

        The limits are displacements of the carriages: p_i + √(L² − p_j² − p_k²) − L. The largest is
        at the middle of the upper face; the smallest at the corner (low, ±m, ±m), m the larger of
        |low| and high.
        """
        low_limit, high_limit = machine.joint_limits_mm
        length = machine.leg_length_mm
        # No farther than half a leg from the origin, whatever the limits: legs stay long enough.
        high = min(high_limit, length / 2.0)

        def smallest(low: float) -> float:
            return low + math.sqrt(length**2 - 2.0 * max(-low, high) ** 2) - length

        low, outer = 0.0, -length / 2.0
        for _ in range(60):
            middle = (low + outer) / 2.0
            low, outer = (middle, outer) if smallest(middle) >= low_limit else (low, middle)
        excess = max(high - low - machine.workspace_mm, 0.0) / 2.0
        return low + excess, high - excess

    def command(self, machine: Machine, plan: Plan) -> Command:
        """Where the controller sends the carriages for each reading of a plan.

        Raises:
            UnreachableError: a displacement is not shorter than the legs.
        """
        joints = self.joints_at(machine, plan.leg, plan.displacement)
        return Command(
            read_only(joints), self.home(machine), plan.hours, plan.in_time, plan.entered
        )

    def touched(self, points: Points, plan: Plan, moments: Moments) -> Touch:
        """The points that the gauges touch (Table 2, eqs. 18–24, errata).

        Args:
            points: of the machine at all moments.
            plan: n readings.
            moments: of each reading.
        """
        moment, set_up = moments
        leg, direction, batch = plan.leg, plan.direction, points.tool.ndim - 2
        gauge_at = column(plan.gauge_at, batch)
        carriage, side = points.centres[leg, leg, moment], points.centres[leg, direction, moment]
        # The gauge's place along the leg's axis, and the point of the leg that it now touches.
        place = (1.0 - gauge_at) * points.centres[leg, leg, set_up]
        place = place + gauge_at * points.tool[leg, set_up]
        span = points.tool[leg, moment] - carriage
        across = points.tool[direction, moment] - side
        fraction = (place - carriage) / span
        if not plan.fixed:
            fixed = column(plan.contact == Contact.FIXED, batch)
            fraction = np.where(fixed, fraction, column(plan.contact == Contact.TOOL, batch))
        return Touch(side + fraction * across, fraction)

    def touched_derivative(
        self, points: Points, plan: Plan, moments: Moments, fraction: Numbers
    ) -> Floats:
        """∂heights/∂Δρ in closed form, shape (n, 3, ...).

        d carriage = u_i dq_i, d tool = (∂p/∂q) dq, and d fraction = (d place − d carriage −
        fraction·d span)/span, zero where the gauge is not fixed. In place, because fresh memory
        for such long arrays costs more than the arithmetic.
        """
        moment, set_up = moments
        leg, direction, batch = plan.leg, plan.direction, points.tool.ndim - 2
        gauge_at = column(plan.gauge_at, batch)
        span = points.tool[leg, moment] - points.centres[leg, leg, moment]
        across = points.tool[direction, moment] - points.centres[leg, direction, moment]
        slope = tool_derivative_components(points.centres, points.directions, points.tool)
        turn = column(plan.contact == Contact.FIXED, batch) * across / span
        jacobian = slope[direction, :, moment]
        jacobian *= fraction[:, None]
        part = slope[leg, :, moment]
        part *= (turn * fraction)[:, None]
        jacobian -= part
        part[...] = slope[leg, :, set_up]
        part *= (turn * gauge_at)[:, None]
        jacobian += part
        own, sideways = points.directions[leg, leg, 0], points.directions[leg, direction, 0]
        jacobian[np.arange(len(plan)), leg] += turn * (fraction - gauge_at) * own
        jacobian[np.arange(len(plan)), leg] += (1.0 - fraction) * sideways
        return jacobian


class PlannedReading(NamedTuple):
    """One reading to take, in the terms of `Plan`; the place of a gauge at an end is that end."""

    leg: int
    direction: int
    displacement: float  # mm
    contact: Contact
    minutes: float = 0.0
    gauge_at: float = 0.5
    part: int = 0
    turned: bool = False
    entered: tuple[float, float, float] = (0.0, 0.0, 0.0)  # mm


def plan_of(readings: Sequence[PlannedReading]) -> Plan:
    """The plan of readings in time order; one set-up for each of `places_of`."""
    leg = np.array([r.leg for r in readings], dtype=np.intp)
    direction = np.array([r.direction for r in readings], dtype=np.intp)
    contact = np.array([r.contact for r in readings], dtype=np.intp)
    part = np.array([r.part for r in readings], dtype=np.intp)
    gauge_at = np.array([r.gauge_at for r in readings], dtype=np.float64)
    turned = np.array([r.turned for r in readings], dtype=np.bool_)
    places = places_of(leg, direction, contact, gauge_at, part, turned)
    return Plan(
        leg=leg,
        direction=direction,
        displacement=np.array([r.displacement for r in readings]),
        contact=contact,
        gauge_at=np.where(contact == Contact.FIXED, gauge_at, contact == Contact.TOOL),
        setup=np.unique(np.reshape(places, (-1, 5)), axis=0, return_inverse=True)[1].reshape(-1),
        order=np.arange(len(readings)),
        hours=np.array([r.minutes for r in readings]) / 60.0,
        part=part,
        turned=turned,
        entered=np.reshape([r.entered for r in readings], (-1, 3)),
    )


def double_posture(
    machine: Machine,
    cycles: int = 3,
    closing: bool = True,
    postures: Sequence[Posture] = POSTURES,
    gauge_at: float = 0.5,
) -> Plan:
    """Iso → Max → Min, repeated, for the x-, y- and z-leg in turn (sec. 3.3, 4.1).

    Two gauges stand at mid-leg, fixed in space; the leg moves under them.

    Args:
        machine: its joint limits are the Max and Min postures.
        cycles: repeats of the postures on each leg, at least 1.
        closing: take a last isotropic reading on each leg; it shows drift and knocks.
        postures: of one cycle.
        gauge_at: place of the gauges along the leg at the isotropic posture.

    Returns:
        A plan of 6·(len(postures)·cycles + closing) readings in time order.
    """
    visited = list(postures) * cycles + ([Posture.ISO] if closing else [])
    return visiting([machine.displacement_mm(posture) for posture in visited], gauge_at)


def visiting(displacements: Sequence[float], gauge_at: float = 0.5) -> Plan:
    """The same postures for the x-, y- and z-leg in turn, two gauges beside each other.

    Args:
        displacements: of the leg's own carriage, in order [mm].
        gauge_at: place of the gauges along the leg at the isotropic posture.

    Returns:
        A plan of 6·len(displacements) readings in time order.
    """
    readings = []
    minutes = 0.0
    for leg in range(3):
        for moved in displacements:
            for direction in other_axes(leg):
                readings.append(
                    PlannedReading(leg, direction, moved, Contact.FIXED, minutes, gauge_at)
                )
            minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(readings)


def single_posture(machine: Machine, cycles: int = 1) -> Plan:
    """Iso, Max, Min of the x-leg, then of the y-leg; at each, joint end and tool end along z.

    The height of both leg ends above the base, at the same posture (sec. 3.2).

    Returns:
        A plan of 12·cycles readings in time order; one gauge zero per leg.
    """
    readings = []
    minutes = 0.0
    for leg in (0, 1):
        for posture in POSTURES * cycles:
            moved = machine.displacement_mm(posture)
            for end in (Contact.JOINT, Contact.TOOL):
                readings.append(PlannedReading(leg, HEIGHT, moved, end, minutes))
                minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(readings)
