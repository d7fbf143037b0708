"""Reading and writing session files."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from orthoglide_cal.data.atomic import write_text
from orthoglide_cal.data.document import YAML_LIMIT, read_document
from orthoglide_cal.data.faults import Faults, listed, nearest
from orthoglide_cal.data.machine_file import yaml_text
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.data.reading_row import READING_COLUMNS
from orthoglide_cal.data.readings_table import readings_from_rows, unknown_columns
from orthoglide_cal.data.schema import check_tree
from orthoglide_cal.data.session_rows import rows_from_record, rows_from_tree
from orthoglide_cal.data.session_schema import SessionRecord
from orthoglide_cal.data.yaml_tree import Tree, load_tree
from orthoglide_cal.errors import InputError, InvalidFileError
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings, Source

# What makes two machines different for the readings; the rest only says what is plausible.
_GEOMETRY = (
    "leg_length_mm", "parallelogram_width_mm", "tool_offset_mm", "joint_limits_mm", "offsets_mm",
    "identified",
)  # fmt: skip
_OWN_COLUMNS = (*READING_COLUMNS, "timestamp")


def read_session(path: Path | str) -> SessionRecord:
    """The session in a file, with everything that was recorded.

    Raises:
        InvalidFileError: everything that is wrong with it, each with line and path.
        InputError: not readable, not YAML, or no session.
    """
    tree = load_tree(read_document(str(path), YAML_LIMIT))
    _refuse_others(tree)
    if tree.value["readings"]:
        readings_from_tree(tree, None)
    return check_tree(SessionRecord, tree)


def readings_from_tree(tree: Tree, machine: Machine | None) -> tuple[Readings, Machine]:
    """The readings of a parsed session, and the machine that they are to be judged by.

    Args:
        tree: the session.
        machine: None for the machine in the session itself.

    Raises:
        InvalidFileError, InputError: as `read_session`.
    """
    _refuse_others(tree)
    rows = rows_from_tree(tree)
    # The readings are checked row by row, with the semantics of a CSV; everything around them by
    # the schema. Faults of both are raised together.
    with suppress(InvalidFileError):
        check_tree(SessionRecord, replace(tree, value={**tree.value, "readings": []}))
    judge = machine or _machine_inside(tree)
    columns = {name: None for row in rows for name in row.lines if name not in _OWN_COLUMNS}
    readings = readings_from_rows(
        rows, judge, tree.document.source, tree.faults, decimal_comma=False,
        remarks=[*_unknown_keys(tree), *unknown_columns(list(columns))],
    )  # fmt: skip
    recorded = check_tree(SessionRecord, tree).machine.to_machine()
    remarks = (*_difference(recorded, judge), *readings.remarks)
    return replace(readings, remarks=remarks), judge


def _machine_inside(tree: Tree) -> Machine:
    """The embedded machine. Raises what has been found around it if it is faulty itself."""
    value = tree.value.get("machine")
    try:
        part = replace(tree, value=value, faults=Faults(tree.document.path))
        return check_tree(MachineModel, part).to_machine()
    except InvalidFileError as error:
        tree.faults.check(error)
        raise


def session_readings(record: SessionRecord, source: Source) -> Readings:
    """The readings of a session in memory, exactly as they would be read back from its file.

    Args:
        record: the session; at least one reading.
        source: what to call it.

    Raises:
        InvalidFileError: everything that is wrong, with the reading's number as its line.
    """
    faults = Faults(source.path)
    rows = rows_from_record(record, faults)
    return readings_from_rows(
        rows, record.machine.to_machine(), source, faults, decimal_comma=False
    )


def session_json(record: SessionRecord) -> dict[str, Any]:
    """The session as a JSON object; saved as a .json file it reads back as a session."""
    return _without_blanks(record.model_dump(mode="json"))


def session_text(record: SessionRecord) -> str:
    """The session file's text; one line for each reading."""
    return yaml_text(_without_blanks(record.model_dump()))


def _without_blanks(content: dict[str, Any]) -> dict[str, Any]:
    """A session whose readings name only what they have."""
    for key in ("readings", "retaken", "skipped"):
        content[key] = [
            {name: value for name, value in entry.items() if value not in (None, "")}
            for entry in content[key]
        ]
    return content


def write_session(record: SessionRecord, path: Path | str, *, overwrite: bool = False) -> None:
    """Write a session file: complete and on the disk, or not at all.

    Args:
        record: the session.
        path: the file.
        overwrite: replace an existing file, in one step.

    Raises:
        UsageError: the file exists and `overwrite` is False.
        InputError: the file cannot be written.
    """
    write_text(Path(path), session_text(record), overwrite=overwrite)


def _refuse_others(tree: Tree) -> None:
    value = tree.value
    if isinstance(value, dict) and "readings" in value:
        return
    if isinstance(value, dict) and "leg_length_mm" in value:
        raise InputError(
            "This is a machine file; it holds no readings.",
            "Give it with --machine, and a file of readings as the input.",
            file=tree.document.path,
        )
    raise InputError(
        "This is neither a table of readings or differences nor a session.",
        "A CSV has a header with leg, posture, direction, reading_mm or difference, value_mm; a"
        " session has `readings:`.",
        file=tree.document.path,
        line=1,
    )


def _unknown_keys(tree: Tree) -> list[str]:
    known = SessionRecord.model_fields
    unknown = [key for key in tree.value if key not in known]
    if not unknown:
        return []
    hints = "".join(nearest(key, known) for key in unknown[:10]).strip()
    return [f"Keys without a meaning here were not used: {listed(unknown)}. {hints}".strip()]


def _difference(recorded: Machine, given: Machine) -> list[str]:
    one = MachineModel.from_machine(recorded).model_dump()
    other = MachineModel.from_machine(given).model_dump()
    names = [name for name in _GEOMETRY if one[name] != other[name]]
    if not names:
        return []
    return [
        f"The session was measured on {recorded.name!r}, which differs from the machine given,"
        f" {given.name!r}, in: {', '.join(names)}. The machine given was used."
    ]
