"""Files of differences, as the paper prints them, to `Differences`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

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
from orthoglide_cal.schema import shortened

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


def check_header(table: Table, known: Collection[str]) -> None:
    """Raises InputError for a file that begins with its first values instead of a header."""
    named = [cell for cell in table.columns if _reads(difference_name, cell)]
    if not set(known).isdisjoint(table.columns) or not (
        named or all(_reads(table.number, cell) for cell in table.columns)
    ):
        return
    readings = "leg,posture,direction,reading_mm over readings."
    names = "difference,value_mm over differences, with a name such as dx_y in front of each"
    raise InputError(
        "The file begins with its values: the header line is missing.",
        "Write difference,value_mm over them." if named else f"Write {names}; or {readings}",
        file=table.file.path,
        line=table.header_line,
        value=shortened(", ".join(table.columns)),
    )


def _reads(rule: Callable[[str], object], cell: str) -> bool:
    """Whether a cell obeys a rule."""
    try:
        rule(cell)
    except InputError:
        return False
    return True


def _kind(rows: Rows[DifferenceRow]) -> DataKind:
    """The kind that most of the names belong to; the others are faults, and so are repeats."""
    # The single set shares four names with the twelve; its own two decide.
    known = {kind: {each.name for each in DIFFERENCES[kind]} for kind in DIFFERENCES}
    cells = [record.cells.get("difference", "") for record in rows.records]
    names = [difference_name(cell) if _reads(difference_name, cell) else None for cell in cells]
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
                f"The name belongs to another kind than the others, which are {kind}"
                f" ({DIFFERENCE_KINDS[kind]})."
            )
            remedy = f"Give one kind in one file. {KNOWN_DIFFERENCES}"
            rows.note(index, "difference", what, remedy)
        elif name in first:
            what = f"The difference stands in line {first[name]} already."
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
