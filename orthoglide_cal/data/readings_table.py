"""Rows of readings to `Readings`: what only shows across rows is checked here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from difflib import get_close_matches

import numpy as np

from orthoglide_cal.data.faults import Faults, listed, nearest
from orthoglide_cal.data.reading_row import (
    NEEDED_COLUMNS,
    READING_COLUMNS,
    VALUE_COLUMNS,
    ReadingRow,
    RowParser,
)
from orthoglide_cal.data.readings_checks import (
    MINUTES_PER_READING,
    check_completeness,
    check_order,
    check_split_numbers,
    remarks_on,
)
from orthoglide_cal.data.setups import number_setups
from orthoglide_cal.data.table import Row, Table
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings, Source
from orthoglide_cal.plan import Contact, Plan


def readings_from_table(table: Table, machine: Machine) -> Readings:
    """The readings of a CSV. Raises InvalidFileError with everything that is wrong."""
    if not _has_columns(table):
        table.faults.check()
    check_split_numbers(table)
    unknown = [name for name in table.columns if name not in READING_COLUMNS]
    return readings_from_rows(
        table.rows, machine, table.document.source, table.faults,
        decimal_comma=table.decimal_comma, remarks=unknown_columns(unknown),
    )  # fmt: skip


def unknown_columns(names: Sequence[str]) -> list[str]:
    """A remark that names the columns without a meaning here, if there are any."""
    named = [name for name in names if name]
    if not named:
        return []
    hints = "".join(nearest(name, READING_COLUMNS) for name in named[:10]).strip()
    return [f"Columns without a meaning here were not used: {listed(named)}. {hints}".strip()]


def readings_from_rows(
    rows: Sequence[Row],
    machine: Machine,
    source: Source,
    faults: Faults,
    *,
    decimal_comma: bool,
    remarks: Sequence[str] = (),
) -> Readings:
    """Convert and check rows.

    Args:
        rows: in the order of the file.
        machine: for postures and limits.
        source: of the rows.
        faults: those found earlier; these are added.
        decimal_comma: accept decimal commas.
        remarks: those of the reader so far.

    Raises:
        InvalidFileError: everything that is wrong with the rows.
    """
    if not rows and not faults:
        faults.add("There is no reading.", "Give one row for each reading, under the header.")
    parser = RowParser(machine, faults, decimal_comma=decimal_comma)
    parsed = [reading for row in rows if (reading := parser.parse(row))]
    check_completeness(rows, faults)
    check_order(parsed, faults)
    faults.check()
    said = [*remarks, *remarks_on(parsed, machine, parser.marks)]
    return _readings(parsed, source, said)


def _has_columns(table: Table) -> bool:
    """Whether the header has what is needed, after noting what it lacks."""
    present = [name for name in table.columns if name]
    wanted = [name for name in NEEDED_COLUMNS if name not in present]
    values = [name for name in VALUE_COLUMNS if name in present]
    if not values:
        wanted.append(VALUE_COLUMNS[0])
    for name in wanted:
        others = [column for column in present if column not in READING_COLUMNS]
        close = get_close_matches(name, others, n=1)
        table.faults.add(
            "The column is missing.",
            f"Rename the column {close[0]!r}."
            if close
            else f"Add it; the header has: {listed(present)}.",
            line=table.header_line,
            column=name,
        )
    if len(values) == 2:
        table.faults.add(
            "Readings are given both in mm and in inches.",
            "Keep one of the columns reading_mm and reading_in.",
            line=table.header_line,
            column=VALUE_COLUMNS[1],
        )
    return not wanted and len(values) == 1


def _readings(parsed: Sequence[ReadingRow], source: Source, remarks: list[str]) -> Readings:
    n = len(parsed)
    numbered = "seq" in parsed[0].row.cells
    timed = parsed[0].minutes is not None
    seq = np.array([r.seq for r in parsed] if numbered else np.arange(n))
    in_time = np.argsort(seq, kind="stable")
    order = np.empty(n, dtype=np.intp)
    order[in_time] = np.arange(n)
    minutes = [r.minutes for r in parsed] if timed else order * MINUTES_PER_READING
    # Both ends of one leg share a zero, so the end is no part of a single-posture gauge's place.
    places = [
        (r.leg, r.direction, r.gauge_at if r.contact is Contact.FIXED else None) for r in parsed
    ]
    gauges = [r.gauge for r in parsed]
    setup = number_setups(places, gauges, in_time.tolist(), ordered=numbered or timed)
    anew = int(setup.max()) + 1 - len(set(zip(places, gauges, strict=True)))
    if anew:
        remarks.append(
            f"Labelled gauges came back to a place {anew} times after use elsewhere; each return"
            " has its own unknown zero."
        )
    plan = Plan(
        leg=np.array([r.leg for r in parsed], dtype=np.intp),
        direction=np.array([r.direction for r in parsed], dtype=np.intp),
        displacement=np.array([r.displacement for r in parsed], dtype=np.float64),
        contact=np.array([r.contact for r in parsed], dtype=np.intp),
        gauge_at=np.array([r.gauge_at for r in parsed], dtype=np.float64),
        setup=setup,
        order=order,
        hours=np.array(minutes, dtype=np.float64) / 60.0,
    )
    return Readings(
        plan=plan,
        value=np.array([r.value for r in parsed]),
        cycle=np.array(_cycles(parsed, in_time.tolist())),
        posture=tuple(r.posture for r in parsed),
        temperature=np.array([r.temperature for r in parsed]),
        gauge=tuple(gauges),
        note=tuple(r.note for r in parsed),
        line=np.array([r.row.line for r in parsed]),
        timed=timed,
        source=source,
        remarks=tuple(remarks),
    )


def _cycles(parsed: Sequence[ReadingRow], in_time: Sequence[int]) -> list[int]:
    """As given, or counted in time within each leg, direction, posture and end."""
    counted: Counter[tuple[object, ...]] = Counter()
    cycles = [0] * len(parsed)
    for index in in_time:
        r = parsed[index]
        key = (r.leg, r.direction, r.displacement, r.contact)
        counted[key] += 1
        cycles[index] = counted[key] if r.cycle is None else r.cycle
    return cycles
