"""What only shows across rows: gaps, order, and what the user should know."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from itertools import pairwise

from orthoglide_cal.data.faults import Faults
from orthoglide_cal.data.reading_row import (
    READING_COLUMNS,
    TEXT_COLUMNS,
    VALUE_COLUMNS,
    ReadingRow,
)
from orthoglide_cal.data.table import Row, Table
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact

MINUTES_PER_READING = 0.4  # assumed where no times are given: 60 readings in 24 minutes

_ALL_OR_NONE = ("seq", "cycle", "minutes", "end")


def check_split_numbers(table: Table) -> None:
    """Refuse `0,123` that a comma-separated row has split into the reading 0 and a text 123."""
    if table.decimal_comma or not table.rows:
        return
    value, beside = next(
        (pair for pair in pairwise(table.columns) if pair[0] in VALUE_COLUMNS), ("", "")
    )
    if not value or (beside in READING_COLUMNS and beside not in TEXT_COLUMNS):
        return
    fractions = [row.cells.get(beside, "") for row in table.rows]
    whole = all(re.fullmatch("[-+\u2212]?[0-9]+", row.cells.get(value, "")) for row in table.rows)
    if whole and all(map(str.isdigit, fractions)) and max(map(len, fractions)) > 1:
        table.faults.add(
            f"Every reading is a whole number with digits in the column {beside!r} beside it:"
            " decimal commas?",
            "Write decimal points, or separate the columns with semicolons.",
            line=table.rows[0].line,
            column=value,
            value=f"{table.rows[0].cells[value]},{fractions[0]}",
        )


def check_completeness(rows: Sequence[Row], faults: Faults) -> None:
    """Some columns are filled in every row or in none."""
    for column in _ALL_OR_NONE:
        if not any(column in row.cells for row in rows):
            continue
        for row in rows:
            if column not in row.cells:
                row.fault(
                    faults, column, "The cell is empty here but filled in other rows.",
                    "Fill it in every row or in none.",
                )  # fmt: skip


def check_order(readings: Sequence[ReadingRow], faults: Faults) -> None:
    """Each `seq` stands once, and time never runs backwards along it."""
    seen: dict[int, Row] = {}
    for reading in readings:
        if reading.seq is None:
            continue
        if reading.seq in seen:
            reading.row.fault(
                faults, "seq", f"The same number stands in line {seen[reading.seq].line}.",
                "Number the readings in the order in which they were taken.",
            )  # fmt: skip
        seen.setdefault(reading.seq, reading.row)
    in_time = sorted(readings, key=lambda reading: reading.seq or 0)
    for before, after in pairwise(in_time):
        if (after.minutes or 0.0) < (before.minutes or 0.0):
            after.row.fault(
                faults, "minutes",
                f"Time runs backwards: line {before.row.line} was taken before this one.",
                "Give minutes since the session began; correct seq or the order of the rows.",
            )  # fmt: skip


def remarks_on(
    readings: Sequence[ReadingRow], machine: Machine, marks: Collection[str]
) -> list[str]:
    """What the user should know although nothing is wrong.

    Args:
        readings: all of them, without faults.
        machine: for the gauge.
        marks: decimal marks that the file uses.
    """
    remarks = []
    beyond = [r for r in readings if abs(r.value) > machine.gauge.range_mm]
    if beyond:
        remarks.append(
            f"{len(beyond)} of {len(readings)} readings are beyond the gauge's range of"
            f" {machine.gauge.range_mm:g} mm (first: line {beyond[0].row.line},"
            f" {beyond[0].value:g} mm): check the unit, and the gauge in the machine file."
        )
    if len(marks) > 1:
        remarks.append("Decimal points and decimal commas are mixed; both were accepted.")
    if readings[0].minutes is None:
        remarks.append(
            f"Times were not given; {MINUTES_PER_READING:g} minutes per reading were assumed."
        )
    if any(r.contact is not Contact.FIXED and "gauge_at" in r.row.cells for r in readings):
        remarks.append("gauge_at was not used: `end` says where the gauge stood.")
    return remarks + _repeated_rows(readings)


def _repeated_rows(readings: Sequence[ReadingRow]) -> list[str]:
    """Rows that are equal word for word, where cycle or minutes should tell repeats apart."""
    if readings[0].cycle is None and readings[0].minutes is None:
        return []
    remarks = []
    first: dict[frozenset[tuple[str, str]], int] = {}
    for reading in readings:
        content = frozenset(item for item in reading.row.cells.items() if item[0] != "seq")
        if content in first:
            remarks.append(
                f"Line {reading.row.line} repeats line {first[content]} word for word; both were"
                " used."
            )
        first.setdefault(content, reading.row.line)
    return remarks
