"""Files of differences, as the paper prints them, to `Differences`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.rows import Length, Reading, Row, Rows
from orthoglide_cal.files.table import Table
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences
from orthoglide_cal.model.orthoglide import Orthoglide

DIFFERENCE_COLUMNS = ("difference", "value_mm", "value_in")
_KINDS = {
    DataKind.SIX: "max − min",
    DataKind.TWELVE: "relative to the isotropic posture",
    DataKind.SINGLE: "tool end − joint end",
}
_NAMED = {each.name for known in DIFFERENCES.values() for each in known}
_KNOWN = "Direction first, leg second. Known: {}.".format(
    "; ".join(
        f"{kind} ({_KINDS[kind]}): {', '.join(each.name for each in known)}"
        for kind, known in DIFFERENCES.items()
    )
)


def _canonical(text: str) -> str:
    """The canonical name; the leading d may be missing, or a delta."""
    name = "d" + re.sub("^[dδ∆]", "", text.lower().replace("\u2212", "-").replace(" ", ""))
    if name not in _NAMED:
        raise InputError("This is not the name of a difference.", _KNOWN)
    return name


class DifferenceRow(Row):
    """A difference as the paper prints it."""

    difference: Annotated[str, AfterValidator(_canonical)]
    value_mm: Length

    noun = "difference"
    inches = "value_in"
    empty: ClassVar[Mapping[str, str]] = {
        "difference": _KNOWN,
        "value_mm": "Give the value or remove the row.",
    }


def differences_from_table(table: Table, machine: Orthoglide) -> Differences:
    """The differences of a CSV. Raises InvalidFileError with everything that is wrong."""
    remarks = table.check_header(DIFFERENCE_COLUMNS[:2], DIFFERENCE_COLUMNS, DIFFERENCE_COLUMNS[2])
    longest = {"value_mm": (machine.leg_length_mm, "difference", "the leg is long")}
    checking = Rows(table.rows, DifferenceRow, Reading(table.number, longest), table.faults)
    kind = _kind(checking)
    rows = {row.difference: row.value_mm for row in checking.checked()}
    known = {each.name: each for each in DIFFERENCES[kind]}
    if missing := [name for name in known if name not in rows]:
        remarks.append(f"Of the {kind} differences these are missing: {', '.join(missing)}.")
    if kind is DataKind.TWELVE and rows.keys() <= {e.name for e in DIFFERENCES[DataKind.SINGLE]}:
        remarks.append(
            "These names were taken as max and min relative to the isotropic posture; a"
            " single-posture file also has dz_x0 or dz_y0."
        )
    which = tuple(known[name] for name in rows)
    value = np.array(list(rows.values()))
    return Differences(kind, which, value, table.file.source, remarks=tuple(remarks))


def _kind(rows: Rows[DifferenceRow]) -> DataKind:
    """The kind that most of the names belong to; the others are faults, and so are repeats."""
    # The single set shares four names with the twelve; its own two decide.
    known = {kind: {each.name for each in DIFFERENCES[kind]} for kind in DIFFERENCES}
    names: dict[int, str] = {}
    for index, record in enumerate(rows.records):
        with suppress(InputError):
            names[index] = _canonical(record.cells.get("difference", ""))
    order = [DataKind.TWELVE, DataKind.SIX]
    if {"dz_x0", "dz_y0"} & set(names.values()):
        order.insert(0, DataKind.SINGLE)
    kind = max(order, key=lambda each: sum(name in known[each] for name in names.values()))
    first: dict[str, int] = {}
    for index, name in names.items():
        if name not in known[kind]:
            others = f"{kind} ({_KINDS[kind]})"
            what = f"The name is of another kind than the others, which are {others}."
            rows.note(index, "difference", what, f"Give one kind in one file. {_KNOWN}")
        elif name in first:
            what = f"The difference is already in line {first[name]}."
            remedy = "Give each difference once; average repeats, or give the raw readings."
            rows.note(index, "difference", what, remedy)
        first.setdefault(name, rows.records[index].line)
    return kind
