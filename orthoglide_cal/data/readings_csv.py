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
    """The text of a readings file, without columns that would be empty.

    Reading it back gives exactly the same values, postures, order and set-ups, and the times to
    1e-6 minutes. Set-ups that the reader could not tell apart by leg, direction, position and
    gauge get labels of their own in the column `gauge`.
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
        "minutes": _minutes(readings),
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


def _minutes(readings: Readings) -> list[str]:
    """Rounded to a ten-thousandth of a second, so that 0.4 stays 0.4; empty if only assumed."""
    if not readings.timed:
        return []
    return [number_text(round(hours * 60.0, 6)) for hours in readings.plan.hours.tolist()]


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
