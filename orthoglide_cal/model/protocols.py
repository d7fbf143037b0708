"""Two measuring protocols of the Orthoglide: which readings are taken, in which order.

And what the paper makes of them: a difference is the mean of some readings minus the mean of
others of the same gauge set-up, d = R·readings with a matrix R of shape (k, n); zeros vanish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from orthoglide_cal.model.measured import DataKind, Difference
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Bools, Floats, Plan
from orthoglide_cal.model.readings import Contact, GaugePlan, Posture, other_axes

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
    """The plan of readings in time order; one set-up for each of its `places`."""
    given = {
        name: np.array([getattr(reading, name) for reading in readings])
        for name in PlannedReading._fields
    }
    hours, entered = given.pop("minutes") / 60.0, given.pop("entered").reshape(-1, 3)
    order, at = np.arange(len(readings)), given["contact"] == Contact.TOOL
    given["gauge_at"] = np.where(given["contact"] == Contact.FIXED, given["gauge_at"], at)
    plan = GaugePlan(**given, order=order, hours=hours, entered=entered, setup=np.zeros_like(order))
    setup = np.unique(np.reshape(plan.places, (-1, 5)), axis=0, return_inverse=True)[1]
    return replace(plan, setup=setup.reshape(-1))


def double_posture(
    machine: Orthoglide,
    cycles: int = 3,
    closing: bool = True,
    postures: Sequence[Posture] = POSTURES,
    gauge_at: float = 0.5,
) -> GaugePlan:
    """Iso → Max → Min, repeated, for the x-, y- and z-leg in turn (sec. 3.3, 4.1).

    Two gauges stand at mid-leg, fixed in space; the leg moves under them. The plan has
    6·(len(postures)·cycles + closing) readings in time order.

    Args:
        machine: its joint limits are the Max and Min postures.
        cycles: repeats of the postures on each leg, at least 1.
        closing: take a last isotropic reading on each leg; it shows drift and knocks.
        postures: of one cycle.
        gauge_at: place of the gauges along the leg at the isotropic posture.
    """
    visited = list(postures) * cycles + ([Posture.ISO] if closing else [])
    return visiting([machine.displacement_mm(posture) for posture in visited], gauge_at)


def visiting(displacements: Sequence[float], gauge_at: float = 0.5) -> GaugePlan:
    """The same displacements [mm] of the x-, y- and z-leg in turn, two gauges next to each other.

    The plan has 6·len(displacements) readings in time order; `gauge_at` as of `double_posture`.
    """
    readings = []
    minutes = 0.0
    for leg in range(3):
        for moved in displacements:
            at = moved, Contact.FIXED, minutes, gauge_at
            readings += [PlannedReading(leg, direction, *at) for direction in other_axes(leg)]
            minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(readings)


def single_posture(machine: Orthoglide, cycles: int = 1, closing: bool = False) -> GaugePlan:
    """Iso, Max, Min of the x-leg, then of the y-leg; at each, joint end and tool end along z.

    The height of both leg ends above the base, at the same posture (sec. 3.2); arguments as of
    `double_posture`. The plan has 12·cycles readings in time order, 4 more if closed, and one
    gauge zero per leg.
    """
    readings, minutes = [], 0.0
    for leg in (0, 1):
        for posture in (*POSTURES * cycles, *[Posture.ISO] * closing):
            moved = machine.displacement_mm(posture)
            for end in (Contact.JOINT, Contact.TOOL):
                readings.append(PlannedReading(leg, HEIGHT, moved, end, minutes))
                minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(readings)


def _subtracted(
    kind: DataKind, difference: Difference, machine: Orthoglide, plan: GaugePlan
) -> list[Bools]:
    """Which readings a difference takes and which it subtracts, of the machine as it was found.

    Max − min; that posture − iso (eq. 24); tool end − joint end at one posture (eq. 10).
    """
    series, posture = difference
    if kind is DataKind.SINGLE:
        at = posture or Posture.ISO
        both = (at, Contact.TOOL), (at, Contact.JOINT)
    else:
        ends = (posture, Posture.ISO) if posture else (Posture.MAX, Posture.MIN)
        both = (ends[0], Contact.FIXED), (ends[1], Contact.FIXED)
    return [
        plan.of(series)
        & plan.as_found
        & (plan.contact == contact)
        & (np.abs(plan.displacement - machine.displacement_mm(at)) < 1e-9)
        for at, contact in both
    ]


def reduction(
    kind: DataKind, differences: Sequence[Difference], machine: Orthoglide, plan: Plan
) -> Floats:
    """R, shape (k, n), so that R·readings are these differences.

    Repeats are averaged within a gauge set-up, then over the set-ups that hold both cells.
    A row is all zero where the plan lacks one of the cells.
    """
    plan = GaugePlan.require(plan)
    matrix = np.zeros((len(differences), len(plan)))
    for row, difference in zip(matrix, differences, strict=True):
        minuend, subtrahend = _subtracted(kind, difference, machine, plan)
        both = np.intersect1d(plan.setup[minuend], plan.setup[subtrahend])
        for setup in both:
            for mask, sign in ((minuend, 1.0), (subtrahend, -1.0)):
                chosen = mask & (plan.setup == setup)
                row[chosen] = sign / (chosen.sum() * both.size)
    return matrix


def ideal_plan(kind: DataKind, machine: Orthoglide) -> GaugePlan:
    """One reading of each cell that the differences of this kind need."""
    if kind is DataKind.SINGLE:
        return single_posture(machine)
    ends = (Posture.MAX, Posture.MIN)
    postures = ends if kind is DataKind.SIX else (Posture.ISO, *ends)
    return double_posture(machine, cycles=1, closing=False, postures=postures)
