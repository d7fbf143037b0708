"""Two measuring protocols of the Orthoglide: which readings are taken, in which order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.readings import Contact, GaugePlan, Posture, other_axes, places_of

# Pace assumed where nobody measured the time: readings, and moves of the stand [min].
MINUTES_PER_POSTURE = 0.4
MINUTES_PER_SETUP = 4.0
POSTURES = (Posture.ISO, Posture.MAX, Posture.MIN)
HEIGHT = 2  # single-posture gauges can stand on the xy-surface only, so they measure along z


class PlannedReading(NamedTuple):
    """One reading to take, as in `GaugePlan`; the place of a gauge at an end is that end."""

    leg: int
    direction: int
    displacement: float  # mm
    contact: Contact
    minutes: float = 0.0
    gauge_at: float = 0.5
    part: int = 0
    turned: bool = False
    entered: tuple[float, float, float] = (0.0, 0.0, 0.0)  # mm


def plan_of(readings: Sequence[PlannedReading]) -> GaugePlan:
    """The plan of readings in time order; one set-up for each of `places_of`."""
    leg = np.array([r.leg for r in readings], dtype=np.intp)
    direction = np.array([r.direction for r in readings], dtype=np.intp)
    contact = np.array([r.contact for r in readings], dtype=np.intp)
    part = np.array([r.part for r in readings], dtype=np.intp)
    gauge_at = np.array([r.gauge_at for r in readings], dtype=np.float64)
    turned = np.array([r.turned for r in readings], dtype=np.bool_)
    places = places_of(leg, direction, contact, gauge_at, part, turned)
    return GaugePlan(
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
    machine: Orthoglide,
    cycles: int = 3,
    closing: bool = True,
    postures: Sequence[Posture] = POSTURES,
    gauge_at: float = 0.5,
) -> GaugePlan:
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


def visiting(displacements: Sequence[float], gauge_at: float = 0.5) -> GaugePlan:
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


def single_posture(machine: Orthoglide, cycles: int = 1, closing: bool = False) -> GaugePlan:
    """Iso, Max, Min of the x-leg, then of the y-leg; at each, joint end and tool end along z.

    The height of both leg ends above the base, at the same posture (sec. 3.2); arguments as of
    `double_posture`.

    Returns:
        A plan of 12·cycles readings in time order, 4 more if closed; one gauge zero per leg.
    """
    readings = []
    minutes = 0.0
    for leg in (0, 1):
        for posture in (*POSTURES * cycles, *[Posture.ISO] * closing):
            moved = machine.displacement_mm(posture)
            for end in (Contact.JOINT, Contact.TOOL):
                readings.append(PlannedReading(leg, HEIGHT, moved, end, minutes))
                minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(readings)
