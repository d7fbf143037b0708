"""Files of differences, as the paper prints them, to `Differences`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.rows import (
    DIFFERENCE_KINDS,
    KNOWN_DIFFERENCES,
    DifferenceRow,
    Reading,
    Rows,
    difference_name,
)
from orthoglide_cal.files.table import Table
from orthoglide_cal.model import DIFFERENCES, DataKind, Differences, Machine
from orthoglide_cal.model.orthoglide import Orthoglide

DIFFERENCE_COLUMNS = ("difference", "value_mm", "value_in")


def differences_from_table(table: Table, machine: Machine) -> Differences:
    """The differences of a CSV. Raises InvalidFileError with everything that is wrong."""
    remarks = table.check_header(DIFFERENCE_COLUMNS[:2], DIFFERENCE_COLUMNS, DIFFERENCE_COLUMNS[2])
    longest = {
        "value_mm": (Orthoglide.require(machine).leg_length_mm, "difference", "the leg is long")
    }
    checking = Rows(table.rows, DifferenceRow, Reading(table.number, longest), table.faults)
    kind = _kind(checking)
    rows = checking.checked()
    known = {each.name: each for each in DIFFERENCES[kind]}
    return Differences(
        kind=kind,
        which=tuple(known[row.difference] for row in rows),
        value=np.array([row.value_mm for row in rows]),
        source=table.file.source,
        remarks=(*remarks, *_remarks(kind, {row.difference for row in rows})),
    )


def _name(cell: str) -> str | None:
    """The name of a difference; None if it is not one."""
    try:
        return difference_name(cell)
    except InputError:
        return None


def _kind(rows: Rows[DifferenceRow]) -> DataKind:
    """The kind that most of the names belong to; the others are faults, and so are repeats."""
    # The single set shares four names with the twelve; its own two decide.
    known = {kind: {each.name for each in DIFFERENCES[kind]} for kind in DIFFERENCES}
    cells = [record.cells.get("difference", "") for record in rows.records]
    names = [_name(cell) for cell in cells]
    order = [DataKind.TWELVE, DataKind.SIX]
    if {"dz_x0", "dz_y0"} & set(names):
        order.insert(0, DataKind.SINGLE)
    kind = max(order, key=lambda each: sum(name in known[each] for name in names))
    first: dict[str, int] = {}
    for index, name in enumerate(names):
        if name is None:
            continue
        if name not in known[kind]:
            what = (
                f"The name is of another kind than the others, which are {kind}"
                f" ({DIFFERENCE_KINDS[kind]})."
            )
            remedy = f"Give one kind in one file. {KNOWN_DIFFERENCES}"
            rows.note(index, "difference", what, remedy)
        elif name in first:
            what = f"The difference is already in line {first[name]} already."
            remedy = "Give each difference once; average repeats, or give the raw readings."
            rows.note(index, "difference", what, remedy)
        first.setdefault(name, rows.records[index].line)
    return kind


def _remarks(kind: DataKind, names: set[str]) -> Iterator[str]:
    missing = [each.name for each in DIFFERENCES[kind] if each.name not in names]
    if missing:
        yield f"Of the {kind} differences these are missing: {', '.join(missing)}."
    if kind is DataKind.TWELVE and names <= {e.name for e in DIFFERENCES[DataKind.SINGLE]}:
        yield (
            "These names were taken as max and min relative to the isotropic posture; a"
            " single-posture file also has dz_x0 or dz_y0."
        )
