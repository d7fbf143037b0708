"""Files of differences, as the paper prints them, to `Differences`."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from orthoglide_cal.data.faults import Faults, listed
from orthoglide_cal.data.numbers import MM_PER_INCH, parse_number
from orthoglide_cal.data.table import Row, Table
from orthoglide_cal.errors import InputError
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences
from orthoglide_cal.protocols import NAMES

DIFFERENCE_COLUMNS = ("difference", "value_mm", "value_in")

_WHAT = {
    "six": "max − min",
    "twelve": "relative to the isotropic posture",
    "single": "tool end − joint end",
}


def differences_from_table(table: Table, machine: Machine) -> Differences:
    """The differences of a CSV. Raises InvalidFileError with everything that is wrong."""
    faults = table.faults
    values = [name for name in DIFFERENCE_COLUMNS[1:] if name in table.columns]
    if len(values) != 1:
        faults.add(
            "Values are given both in mm and in inches." if values else "The column is missing.",
            "Give one column, value_mm or value_in.",
            line=table.header_line,
            column=DIFFERENCE_COLUMNS[2 if values else 1],
        )
        faults.check()
    if not table.rows:
        faults.add("There is no difference.", "Give one row for each, under the header.")
    names = [_name(row, faults) for row in table.rows]
    kind = _kind(table.rows, names, faults)
    column = values[0]
    numbers = [_value(row, column, table, machine) for row in table.rows]
    faults.check()
    return Differences(
        kind=kind,
        names=tuple(names),
        value=np.array(numbers, dtype=np.float64),
        source=table.document.source,
        remarks=tuple(_remarks(kind, names, table)),
    )


def _name(row: Row, faults: Faults) -> str:
    """The canonical name, without the leading d; "" after noting that it is none."""
    given = row.cells.get("difference", "")
    name = re.sub("^[dδ∆]", "", given.lower().replace("\u2212", "-").replace(" ", ""))
    if any(name in known for known in NAMES.values()):
        return name
    what = "This is not the name of a difference." if given else "The cell is empty."
    row.fault(faults, "difference", what, _known())
    return ""


def _known() -> str:
    listed = "; ".join(
        f"{kind} ({_WHAT[kind]}): {', '.join('d' + name for name in names)}"
        for kind, names in NAMES.items()
    )
    return f"Direction first, leg second. Known: {listed}."


def _kind(rows: Sequence[Row], names: Sequence[str], faults: Faults) -> str:
    """The kind that most of the names belong to; the others are faults, and so are repeats."""
    valid = [name for name in names if name]
    # The single set shares four names with the twelve; its own two decide.
    order = ("single", "twelve", "six") if {"z_x0", "z_y0"} & set(valid) else ("twelve", "six")
    kind = max(order, key=lambda each: sum(name in NAMES[each] for name in valid))
    first: dict[str, int] = {}
    for row, name in zip(rows, names, strict=True):
        if name and name not in NAMES[kind]:
            row.fault(
                faults, "difference",
                f"The name belongs to another kind than the others, which are {kind}"
                f" ({_WHAT[kind]}).",
                f"Give one kind in one file. {_known()}",
            )  # fmt: skip
        elif name in first:
            row.fault(
                faults, "difference", f"The difference stands in line {first[name]} already.",
                "Give each difference once; average repeats, or give the raw readings.",
            )  # fmt: skip
        first.setdefault(name, row.line)
    return kind


def _value(row: Row, column: str, table: Table, machine: Machine) -> float:
    text = row.cells.get(column, "")
    if not text:
        row.fault(table.faults, column, "The cell is empty.", "Give the value or remove the row.")
        return 0.0
    try:
        value = parse_number(text, decimal_comma=table.decimal_comma)
    except InputError as error:
        row.fault(table.faults, column, error.what, error.remedy)
        return 0.0
    value *= MM_PER_INCH if column == "value_in" else 1.0
    if abs(value) > machine.leg_length_mm:
        row.fault(
            table.faults, column, "The difference is larger than the leg is long.",
            "Check the unit and the decimal mark; values are in mm.",
        )  # fmt: skip
    return value


def _remarks(kind: str, names: Sequence[str], table: Table) -> list[str]:
    remarks = []
    unknown = [name for name in table.columns if name and name not in DIFFERENCE_COLUMNS]
    if unknown:
        remarks.append(f"Columns without a meaning here were not used: {listed(unknown)}.")
    missing = [f"d{name}" for name in NAMES[kind] if name not in names]
    if missing:
        remarks.append(f"Of the {kind} differences these are missing: {', '.join(missing)}.")
    if kind == "twelve" and set(names) <= set(NAMES["single"]):
        remarks.append(
            "These names were taken as max and min relative to the isotropic posture; a"
            " single-posture file also has dz_x0 or dz_y0."
        )
    return remarks
