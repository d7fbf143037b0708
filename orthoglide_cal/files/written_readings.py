"""Readings as a file holds them: the cells of each row, and the text of a CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from orthoglide_cal.files.readings import ENDS, TURNED
from orthoglide_cal.files.table import csv_text
from orthoglide_cal.files.text import number_text
from orthoglide_cal.model import AXES, Contact, GaugePlan, Readings, number_setups, places_of

# What is told of a reading only where it is not as in the usual session.
SITTING_COLUMNS = ("gauge_at", "part", "bar", "entered")


def readings_csv(readings: Readings) -> str:
    """The text of a readings file, without columns that would be empty.

    Reading it back gives exactly the same values, postures, order and set-ups, and the times to
    1e-6 minutes. Set-ups that the reader could not tell apart by part, leg, direction, position and
    gauge get labels of their own in the column `gauge`.
    """
    columns = {
        name: [number_text(cell) if isinstance(cell, float) else cell for cell in cells]
        for name, cells in file_columns(readings).items()
        if any(cell is not None for cell in cells)
    }
    return csv_text(columns, zip(*columns.values(), strict=True))


def file_columns(readings: Readings) -> dict[str, list[Any]]:
    """Column → cell of each reading, as a file holds them; None where it would be empty."""
    plan, n = readings.plan, len(readings)
    sittings = [sitting_cells(plan, index) for index in range(n)]
    ends = {contact: name for name, contact in ENDS.items()}
    minutes = [round(hours * 60.0, 6) for hours in plan.hours.tolist()]
    return {
        "seq": [order + 1 for order in np.argsort(plan.in_time).tolist()],
        "leg": [AXES[leg] for leg in plan.leg],
        "posture": list(readings.posture),
        "direction": [AXES[direction] for direction in plan.direction],
        "end": [ends.get(Contact(contact)) for contact in plan.contact],
        "reading_mm": readings.value.tolist(),
        "cycle": readings.cycle.tolist(),
        "minutes": minutes if readings.timed else [None] * n,
        "temperature_c": [None if math.isnan(t) else t for t in readings.temperature.tolist()],
        "gauge": [label or None for label in _labels(readings)],
        **{name: [cells[name] for cells in sittings] for name in SITTING_COLUMNS},
        "note": [note or None for note in readings.note],
    }


def sitting_cells(plan: GaugePlan, index: int) -> dict[str, Any]:
    """Column of `SITTING_COLUMNS` → what a file holds of one reading; None where it is as usual."""
    at, offsets = float(plan.gauge_at[index]), plan.entered[index].tolist()
    unusual = plan.contact[index] == Contact.FIXED and at != 0.5
    cells = (
        at if unusual else None,
        int(plan.part[index]) + 1 if plan.parts > 1 else None,
        TURNED if plan.turned[index] else None,
        " ".join(map(number_text, offsets)) if any(offsets) else None,
    )
    return dict(zip(SITTING_COLUMNS, cells, strict=True))


def _labels(readings: Readings) -> Sequence[str]:
    """Labels from which the reader recovers the set-ups: the gauges' own if they suffice."""
    plan = readings.plan
    places = places_of(
        plan.leg, plan.direction, plan.contact, plan.gauge_at, plan.part, plan.turned
    )
    understood = number_setups(places, readings.gauge, plan.in_time.tolist(), ordered=True)
    pairs = set(zip(understood.tolist(), plan.setup.tolist(), strict=True))
    if len(pairs) == len(set(understood.tolist())) == plan.setups:
        return readings.gauge
    return [f"set-up {number + 1}" for number in plan.setup.tolist()]
