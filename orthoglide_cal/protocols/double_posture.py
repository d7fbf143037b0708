"""Double-posture protocol (sec. 3.3): two gauges fixed at mid-leg, the leg moves under them."""

from __future__ import annotations

from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols.postures import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    Step,
    other_axes,
    plan_of,
)

POSTURES = ("iso", "max", "min")


def double_posture(
    machine: Machine,
    cycles: int = 3,
    closing: bool = True,
    postures: tuple[str, ...] = POSTURES,
    gauge_at: float = 0.5,
) -> Plan:
    """Iso → Max → Min, repeated, for the x-, y- and z-leg in turn (sec. 4.1).

    Args:
        machine: its joint limits are the Max and Min postures.
        cycles: repeats of the postures on each leg, at least 1.
        closing: take a last isotropic reading on each leg; it shows drift and knocks.
        postures: of one cycle.
        gauge_at: place of the gauges along the leg at the isotropic posture.

    Returns:
        A plan of 6·(len(postures)·cycles + closing) readings in time order.
    """
    visited = list(postures) * cycles + (["iso"] if closing else [])
    steps = []
    minutes = 0.0
    for leg in range(3):
        for posture in visited:
            displacement = machine.displacement_mm(posture)
            for direction in other_axes(leg):
                steps.append(Step(leg, direction, displacement, Contact.FIXED, minutes))
            minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(steps, gauge_at)
