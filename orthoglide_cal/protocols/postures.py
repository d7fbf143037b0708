"""Builds the plan of a protocol: a list of steps in time order becomes arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.plan import Contact, Plan

# Pace assumed where nobody measured the time: readings, and moves of the stand [min].
MINUTES_PER_POSTURE = 0.4
MINUTES_PER_SETUP = 4.0


@dataclass(frozen=True)
class Step:
    """One reading to take: leg, direction (0, 1, 2), displacement [mm], contact, minutes."""

    leg: int
    direction: int
    displacement: float
    contact: Contact
    minutes: float


def other_axes(leg: int) -> tuple[int, int]:
    """The two directions in which the deviation of a leg can be read, in the paper's order."""
    first, second = (k for k in range(3) if k != leg)
    return first, second


def plan_of(steps: Sequence[Step], gauge_at: float = 0.5) -> Plan:
    """The plan of steps in time order; one set-up per (leg, direction)."""
    leg = np.array([s.leg for s in steps])
    direction = np.array([s.direction for s in steps])
    return Plan(
        leg=leg,
        direction=direction,
        displacement=np.array([s.displacement for s in steps]),
        contact=np.array([s.contact for s in steps]),
        gauge_at=np.full(len(steps), gauge_at),
        setup=np.unique(3 * leg + direction, return_inverse=True)[1],
        order=np.arange(len(steps)),
        hours=np.array([s.minutes for s in steps]) / 60.0,
    )
