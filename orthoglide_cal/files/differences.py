"""Files of differences, as the paper prints them, to `Differences`."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import unused
from orthoglide_cal.files.table import Cells, Table
from orthoglide_cal.model import DIFFERENCES, DataKind, Differences, Machine
from orthoglide_cal.schema import shortened

DIFFERENCE_COLUMNS = ("difference", "value_mm", "value_in")

_WHAT = {
    DataKind.SIX: "max − min",
    DataKind.TWELVE: "relative to the isotropic posture",
    DataKind.SINGLE: "tool end − joint end",
}
_NAMED = {each.name for known in DIFFERENCES.values() for each in known}


def differences_from_table(table: Table, machine: Machine) -> Differences:
    """The differences of a CSV. Raises InvalidFileError with everything that is wrong."""
    faults = table.faults
    values = [name for name in DIFFERENCE_COLUMNS[1:] if name in table.columns]
    if len(values) != 1:
        faults.add(
            "Values are given both in mm and in inches." if values else "The column is missing.",
            table.other_unit("value_mm") or "Give one column, value_mm or value_in.",
            line=table.header_line,
            column=DIFFERENCE_COLUMNS[2 if values else 1],
        )
        faults.check()
    if not table.rows:
        faults.add("There is no difference.", "Give one row for each, under the header.")
    cells = Cells(table.rows, faults, table.number)
    names = cells.read("difference", _name, None, wanted=_known())
    kind = _kind(cells, names)
    wanted = "Give the value or remove the row."
    value = cells.lengths(values[0], machine.leg_length_mm, "difference", wanted)
    faults.check()
    return Differences(
        kind=kind,
        which=tuple(each for name in names for each in DIFFERENCES[kind] if each.name == name),
        value=value,
        source=table.document.source,
        remarks=tuple(_remarks(kind, names, table)),
    )


def check_header(table: Table, known: Collection[str]) -> None:
    """Raises InputError for a file that begins with its first values instead of a header."""
    named = [cell for cell in table.columns if _reads(_name, cell)]
    if not set(known).isdisjoint(table.columns) or not (
        named or all(_reads(table.number, cell) for cell in table.columns)
    ):
        return
    readings = "leg,posture,direction,reading_mm over readings."
    names = "difference,value_mm over differences, with a name such as dx_y in front of each"
    raise InputError(
        "The file begins with its values: the header line is missing.",
        "Write difference,value_mm over them." if named else f"Write {names}; or {readings}",
        file=table.document.path,
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


def _name(text: str) -> str | None:
    """The canonical name; the leading d may be missing, or a delta."""
    name = "d" + re.sub("^[dδ∆]", "", text.lower().replace("\u2212", "-").replace(" ", ""))
    if name not in _NAMED:
        raise InputError("This is not the name of a difference.", _known())
    return name


def _known() -> str:
    listed = "; ".join(
        f"{kind} ({_WHAT[kind]}): {', '.join(each.name for each in known)}"
        for kind, known in DIFFERENCES.items()
    )
    return f"Direction first, leg second. Known: {listed}."


def _kind(cells: Cells, names: Sequence[str | None]) -> DataKind:
    """The kind that most of the names belong to; the others are faults, and so are repeats."""
    # The single set shares four names with the twelve; its own two decide.
    known = {kind: {each.name for each in DIFFERENCES[kind]} for kind in DIFFERENCES}
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
                f" ({_WHAT[kind]})."
            )
            cells.note(index, "difference", what, f"Give one kind in one file. {_known()}")
        elif name in first:
            what = f"The difference stands in line {first[name]} already."
            remedy = "Give each difference once; average repeats, or give the raw readings."
            cells.note(index, "difference", what, remedy)
        first.setdefault(name, cells.rows[index].line)
    return kind


def _remarks(kind: DataKind, names: Sequence[str | None], table: Table) -> list[str]:
    unknown = (name for name in table.columns if name not in DIFFERENCE_COLUMNS)
    remarks = unused("Columns", unknown, DIFFERENCE_COLUMNS)
    missing = [each.name for each in DIFFERENCES[kind] if each.name not in names]
    if missing:
        remarks.append(f"Of the {kind} differences these are missing: {', '.join(missing)}.")
    if kind is DataKind.TWELVE and set(names) <= {e.name for e in DIFFERENCES[DataKind.SINGLE]}:
        remarks.append(
            "These names were taken as max and min relative to the isotropic posture; a"
            " single-posture file also has dz_x0 or dz_y0."
        )
    return remarks
