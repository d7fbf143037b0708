"""The gap between model and readings by leg, direction, posture and repeat, as plain text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Ints
from orthoglide_cal.diagnosis import Diagnosis
from orthoglide_cal.measured import Differences, Readings
from orthoglide_cal.plan import Contact
from orthoglide_cal.report.lines import WIDTH, columns
from orthoglide_cal.report.shown import visible

LEGEND = "  mean of the repeats, then one sign for each: · noise, + − over 2σ, ▲ ▼ over 4σ"
_ENDS = {Contact.FIXED: "", Contact.JOINT: ", joint end", Contact.TOOL: ", tool end"}


def difference_lines(measured: Differences, diagnosis: Diagnosis) -> list[str]:
    """One row per difference: measured, predicted, left without and with the causes [mm]."""
    values = [
        diagnosis.measured_mm,
        diagnosis.nominal_mm,
        diagnosis.measured_mm - diagnosis.nominal_mm,
    ]
    head = ["", "measured", "predicted by offsets", "left"]
    if diagnosis.causes:
        head.append("left with the cause" + "s" * (len(diagnosis.causes) > 1))
        values.append(diagnosis.measured_mm - diagnosis.explained_mm)
    rows = [
        [name, *(f"{round(float(value[k]), 3) + 0.0:+.3f}" for value in values)]
        for k, name in enumerate(measured.names)
    ]
    return columns([head, *rows])


def residual_lines(measured: Readings, residual: Floats, sigma: float) -> list[str]:
    """One row per series, one column per posture; as many tables as the width asks for.

    Args:
        measured: n readings.
        residual: measured − predicted, shape (n,) [mm].
        sigma: standard deviation of one reading [mm].
    """
    series = list(_series(measured))
    postures = list(dict.fromkeys(measured.posture))
    table = [
        [visible(posture), *(_cell(measured, s, posture, residual, sigma) for s in series)]
        for posture in postures
    ]
    names = ["leg, direction", *(s.name for s in series)]
    room = WIDTH - 2 - max(map(len, names))
    lines = []
    for chosen in _packed([max(map(len, column)) for column in table], room):
        rows = list(zip(names, *(table[k] for k in chosen), strict=True))
        lines += columns(rows, left=range(len(chosen) + 1))
    return lines


@dataclass(frozen=True)
class _Series:
    """Readings of one leg, direction, leg end and gauge place: one row of the picture."""

    name: str
    rows: Ints


def _series(measured: Readings) -> Iterator[_Series]:
    plan = measured.plan
    several = np.unique(plan.gauge_at).size > 1
    keys = np.stack((plan.leg, plan.direction, plan.contact, plan.gauge_at), axis=1)
    for key in np.unique(keys, axis=0):
        leg, direction, contact = (int(k) for k in key[:3])
        name = f"leg {AXES[leg]}, {AXES[direction]}{_ENDS[Contact(contact)]}"
        if several and contact == Contact.FIXED:
            name += f", at {key[3]:g}"
        yield _Series(name, np.flatnonzero(np.all(keys == key, axis=1)))


def _packed(widths: Sequence[int], room: int) -> Iterator[list[int]]:
    """Columns in order, as many to a table as fit side by side behind two blanks each."""
    chosen: list[int] = []
    used = 0
    for k, width in enumerate(widths):
        if chosen and used + width + 2 > room:
            yield chosen
            chosen, used = [], 0
        chosen.append(k)
        used += width + 2
    yield chosen


# More signs than this would not fit beside a name: the largest deviations of each stand for all.
_SIGNS = 30


def _cell(measured: Readings, series: _Series, posture: str, residual: Floats, sigma: float) -> str:
    """The mean over the repeats [µm] and a sign for each, in order of time."""
    own = np.array([i for i in series.rows if measured.posture[i] == posture], dtype=np.intp)
    if not own.size:
        return ""
    own = own[np.argsort(measured.plan.order[own], kind="stable")]
    parts = np.array_split(residual[own], min(own.size, _SIGNS))
    signs = "".join(_sign(float(part[np.argmax(np.abs(part))]), sigma) for part in parts)
    return f"{1000.0 * float(residual[own].mean()):+7.1f} {signs}"


def _sign(residual: float, sigma: float) -> str:
    if abs(residual) <= 2.0 * sigma:
        return "·"
    large = abs(residual) > 4.0 * sigma
    return ("▲" if large else "+") if residual > 0.0 else ("▼" if large else "−")
