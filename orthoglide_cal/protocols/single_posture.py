"""Single-posture protocol (sec. 3.2): the height of both leg ends above the base, same posture."""

from __future__ import annotations

from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols.postures import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    Step,
    plan_of,
)

HEIGHT = 2  # gauges can stand on the xy-surface only, so they measure along z


def single_posture(machine: Machine, cycles: int = 1) -> Plan:
    """Iso, Max, Min of the x-leg, then of the y-leg; at each, joint end and tool end along z.

    Returns:
        A plan of 12·cycles readings in time order; one gauge zero per leg.
    """
    steps = []
    minutes = 0.0
    for leg in (0, 1):
        for posture in ("iso", "max", "min") * cycles:
            displacement = machine.displacement_mm(posture)
            for end in (Contact.JOINT, Contact.TOOL):
                steps.append(Step(leg, HEIGHT, displacement, end, minutes))
                minutes += MINUTES_PER_POSTURE
        minutes += MINUTES_PER_SETUP
    return plan_of(steps)
