"""Readings to the contract's CSV."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from orthoglide_cal.axes import AXES
from orthoglide_cal.data.numbers import number_text
from orthoglide_cal.data.setups import number_setups
from orthoglide_cal.measured import Readings
from orthoglide_cal.plan import Contact

_ENDS = {Contact.JOINT: "joint", Contact.TOOL: "tool"}


def readings_csv(readings: Readings) -> str:
    """The text of a readings file; reading it back gives the same values and gauge set-ups.

    Columns that would be empty are left out. Set-ups that the reader could not tell apart by leg,
    direction, position and gauge get labels of their own in the column `gauge`.
    """
    plan, n = readings.plan, range(len(readings))
    columns: dict[str, list[str]] = {
        "seq": [str(order + 1) for order in np.argsort(plan.in_time).tolist()],
        "leg": [AXES[leg] for leg in plan.leg],
        "posture": list(readings.posture),
        "direction": [AXES[direction] for direction in plan.direction],
        "end": [_ENDS.get(Contact(contact), "") for contact in plan.contact],
        "reading_mm": [number_text(value) for value in readings.value.tolist()],
        "cycle": [str(cycle) for cycle in readings.cycle],
        "minutes": [minutes_text(h) for h in plan.hours.tolist()] if readings.timed else [],
        "temperature_c": [
            "" if math.isnan(value) else number_text(value)
            for value in readings.temperature.tolist()
        ],
        "gauge": _labels(readings),
        "gauge_at": _fractions(readings),
        "note": list(readings.note),
    }
    filled = {name: cells for name, cells in columns.items() if any(cells)}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(filled)
    writer.writerows([cells[i] for cells in filled.values()] for i in n)
    return text.getvalue()


def minutes_text(hours: float) -> str:
    """Minutes that the reader turns into exactly these hours, with few digits where they do."""
    minutes = hours * 60.0
    neighbours = (minutes, math.nextafter(minutes, 0.0), math.nextafter(minutes, math.inf))
    for candidate in (round(minutes, 3), round(minutes, 9), *neighbours):
        if candidate / 60.0 == hours:
            return number_text(candidate)
    return number_text(minutes)


def _fractions(readings: Readings) -> list[str]:
    plan = readings.plan
    fixed = plan.contact == Contact.FIXED
    if np.all(plan.gauge_at[fixed] == 0.5):
        return []
    cells = [number_text(value) for value in plan.gauge_at.tolist()]
    return [cell if known else "" for cell, known in zip(cells, fixed, strict=True)]


def _labels(readings: Readings) -> list[str]:
    plan = readings.plan
    fixed = plan.contact == Contact.FIXED
    places = [
        (leg, direction, at if here else None)
        for leg, direction, at, here in zip(
            plan.leg.tolist(), plan.direction.tolist(), plan.gauge_at.tolist(), fixed, strict=True
        )
    ]
    in_time = plan.in_time.tolist()
    understood = number_setups(places, readings.gauge, in_time, ordered=True)
    pairs = set(zip(understood.tolist(), plan.setup.tolist(), strict=True))
    if len(pairs) == len(set(understood.tolist())) == plan.setups:
        return list(readings.gauge)
    return [f"set-up {number + 1}" for number in plan.setup.tolist()]
