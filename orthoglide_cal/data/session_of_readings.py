"""Readings in memory as a session; what was not recorded stays blank."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orthoglide_cal.axes import AXES
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.data.session_schema import SessionRecord
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings
from orthoglide_cal.plan import Contact

_ENDS = {Contact.JOINT: "joint", Contact.TOOL: "tool"}


def session_of_readings(
    readings: Readings, machine: Machine, environment: Mapping[str, str]
) -> SessionRecord:
    """The session that holds these readings of this machine.

    Args:
        readings: in any order; written in the order of time.
        machine: embedded in the session.
        environment: name → text.
    """
    plan = readings.plan
    single = bool((plan.contact != Contact.FIXED).any())
    return SessionRecord.model_validate(
        {
            "machine": MachineModel.from_machine(machine).model_dump(),
            "protocol": "single-posture" if single else "double-posture",
            "environment": dict(environment),
            "readings": [
                _entry(readings, i, seq) for seq, i in enumerate(plan.in_time.tolist(), start=1)
            ],
        }
    )


def _entry(readings: Readings, i: int, seq: int) -> dict[str, Any]:
    plan = readings.plan
    contact = Contact(plan.contact[i])
    at, temperature = float(plan.gauge_at[i]), float(readings.temperature[i])
    return {
        "leg": AXES[plan.leg[i]],
        "posture": readings.posture[i],
        "direction": AXES[plan.direction[i]],
        "end": _ENDS.get(contact),
        "cycle": int(readings.cycle[i]),
        "reading_mm": float(readings.value[i]),
        "seq": seq,
        "minutes": round(float(plan.hours[i]) * 60.0, 6) if readings.timed else None,
        "temperature_c": None if math.isnan(temperature) else temperature,
        "gauge": readings.gauge[i],
        "gauge_at": at if contact is Contact.FIXED and at != 0.5 else None,
        "note": readings.note[i],
    }
