"""Session files (`orthocal guide files`): read, checked and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Faults, unused
from orthoglide_cal.files.groups import (
    Group,
    count,
    not_negative,
    number,
    positive,
    text,
    version,
    word,
)
from orthoglide_cal.files.machine_file import differing, machine_in, machine_values
from orthoglide_cal.files.readings import (
    LATEST_MINUTES,
    READING_COLUMNS,
    Conditions,
    GaugeIdentity,
    axis,
    bar,
    conditions_in,
    end,
    entered,
    readings_from_rows,
)
from orthoglide_cal.files.table import Row
from orthoglide_cal.files.text import write_text
from orthoglide_cal.files.written_readings import SITTING_COLUMNS, file_columns
from orthoglide_cal.files.yaml_tree import Tree, yaml_text
from orthoglide_cal.model import Model, Readings

# Keys in the order of the file, with what stands for nothing.
_BLANK: dict[str, Any] = {
    "schema_version": 1, "machine": None, "protocol": "", "operator": None, "gauges": (),
    "started": None, "finished": None, "environment": None,
    "readings": (), "retaken": (), "skipped": (),
}  # fmt: skip
_COLUMNS = (*READING_COLUMNS, "timestamp")
_ENTRY = (
    "leg", "posture", "direction", "end", "cycle", "reading_mm", "seq", "minutes",
    "temperature_c", "gauge", *SITTING_COLUMNS, "note", "timestamp", "reason",
)  # fmt: skip


def session_from_tree(tree: Tree, model: Model | None) -> tuple[Readings, Model, Conditions]:
    """The readings of a parsed session, the machine to judge them by, and the circumstances.

    Args:
        tree: the session.
        model: None for the machine in the session itself. Which offsets were active in the
            controller is always the session's to say.

    Raises:
        InvalidFileError: everything that is wrong with it, each with line and path.
        InputError: no session.
    """
    _refuse_others(tree)
    file = Group(tree, (), tree.value)
    conditions = _recorded(file)
    recorded = machine_in(file.group("machine"))
    rows = _rows(file)
    clock = _clock(rows, conditions.started, tree.faults)
    judge = model or recorded
    if judge is None:
        raise tree.faults.error()
    if model and recorded and model.machine.offsets_mm != recorded.machine.offsets_mm:
        judge = model.holding(recorded.machine.offsets_mm)
    columns = dict.fromkeys(name for row in rows for name in row.lines if name not in _COLUMNS)
    remarks = [
        *(_difference(recorded, judge) if recorded else ()),
        *unused("Keys", (key for key in tree.value if key not in _BLANK), _BLANK),
        *unused("Columns", columns, READING_COLUMNS),
    ]
    # The readings pass the same checks as those of a CSV; faults around them are raised with
    # theirs.
    readings = readings_from_rows(
        rows, judge.machine, tree.file.source, tree.faults, number, clock=clock,
        remarks=remarks,
    )  # fmt: skip
    found = conditions_in(readings)
    own = {gauge.label for gauge in conditions.gauges}
    others = (gauge for gauge in found.gauges if gauge.label not in own)
    conditions = replace(
        conditions,
        temperature_c=found.temperature_c,
        gauges=(*conditions.gauges, *others),
        notes=found.notes,
    )
    return readings, judge, conditions


def session_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """A whole session as a JSON object; saved as a .json file it reads back as a session.

    Args:
        values: key → plain value as in the file (`machine` is `machine_values`); what is missing
            is blank. Blanks in readings, retaken and skipped are left out.
    """
    content = {**_BLANK, **values}
    for key in ("readings", "retaken", "skipped"):
        content[key] = [
            {name: entry[name] for name in _ENTRY if entry.get(name) not in (None, "")}
            for entry in content[key]
        ]
    return content


def session_text(values: Mapping[str, Any]) -> str:
    """The session file's text, of values as in `session_json`; one line for each reading."""
    return yaml_text(session_json(values))


def write_session(values: Mapping[str, Any], path: Path | str, *, overwrite: bool = False) -> None:
    """Write a session file of values as in `session_json`, as `write_text` does.

    Raises:
        UsageError: the file exists and `overwrite` is False.
        InputError: the file cannot be written.
    """
    write_text(Path(path), session_text(values), overwrite=overwrite)


def session_of_readings(
    readings: Readings, model: Model, environment: Mapping[str, str]
) -> dict[str, Any]:
    """Values of the session that holds these readings of this machine; the rest stays blank.

    Args:
        readings: in any order; written in the order of time.
        model: its machine is embedded in the session.
        environment: name → text.
    """
    columns, plan = file_columns(readings), readings.plan
    return {
        "machine": machine_values(model),
        "protocol": "double-posture" if plan.fixed else "single-posture",
        "environment": dict(environment),
        "readings": [
            {name: cells[index] for name, cells in columns.items()}
            for index in plan.in_time.tolist()
        ],
    }


def _refuse_others(tree: Tree) -> None:
    value = tree.value
    if isinstance(value, dict) and "readings" in value:
        return
    if isinstance(value, dict) and "leg_length_mm" in value:
        raise InputError(
            "This is a machine file; it holds no readings.",
            "Give it with --machine, and a file of readings as the input.",
            file=tree.file.path,
        )
    raise InputError(
        "This is neither a table of readings or differences nor a session.",
        "A CSV has a header with leg, posture, direction, reading_mm or difference, value_mm; a"
        " session has `readings:`.",
        file=tree.file.path,
        line=1,
    )


def _recorded(file: Group) -> Conditions:
    """What is written around the readings."""
    file.take("schema_version", version, 1)
    retaken, skipped = list(file.groups("retaken")), list(file.groups("skipped"))
    for entry in retaken:
        _check_place(entry)
        _check_reading(entry)
    for entry in skipped:
        _check_place(entry)
    return Conditions(
        protocol=file.take("protocol", text, None) or None,
        operator=file.take("operator", text, None) or None,
        started=file.take("started", _moment, None),
        finished=file.take("finished", _moment, None),
        environment=_environment(file),
        gauges=tuple(_gauge(entry) for entry in file.groups("gauges")),
        retaken=len(retaken),
        skipped=len(skipped),
    )


def _check_place(entry: Group) -> None:
    """Where a gauge stands, and why the step was repeated or left out."""
    for key in ("leg", "direction"):
        entry.take(key, lambda value: axis(text(value)))
    entry.take("posture", word)
    entry.take("end", lambda value: end(text(value)), None)
    entry.take("cycle", count, None)
    entry.take("part", count, None)
    entry.take("bar", lambda value: bar(text(value)), None)
    entry.take("entered", lambda value: entered(text(value), number), None)
    entry.take("gauge_at", number, None)
    entry.take("reason", text, "")


def _check_reading(entry: Group) -> None:
    """A reading that was replaced; nothing is computed from it."""
    in_inches = "reading_in" in entry.content and "reading_mm" not in entry.content
    entry.take("reading_in" if in_inches else "reading_mm", number)
    entry.take("minutes", not_negative, None)
    entry.take("timestamp", _moment, None)
    for key in ("seq", "temperature_c"):
        entry.take(key, number, None)
    for key in ("gauge", "note"):
        entry.take(key, text, None)


def _gauge(entry: Group) -> GaugeIdentity:
    size = "resolution" if "resolution" in entry.content else "resolution_mm"
    return GaugeIdentity(
        label=entry.take("id", word),
        certificate=entry.take("certificate", text, None) or None,
        resolution_mm=entry.take(size, positive, None),
    )


def _environment(file: Group) -> tuple[tuple[str, str], ...]:
    """A text instead of a group is one remark."""
    said = file.content.get("environment")
    if isinstance(said, str):
        return (("note", said),) if said else ()
    group = file.group("environment", required=False)
    named = ((name, group.take(name, text, None)) for name in group.names(word))
    return tuple((name, said) for name, said in named if said)


def _rows(file: Group) -> list[Row]:
    """The readings as rows of cells; entries that are no groups of values are faults."""
    rows = []
    for entry in file.groups("readings"):
        if not entry.sound:
            continue
        for key, value in entry.content.items():
            if isinstance(value, dict | list):
                entry.note("One value is wanted here.", "Write `name: value`.", key)
        if entry.sound:
            lines = {key: file.tree.place((*entry.path, key)).line for key in entry.content}
            stripped = {key: value.strip() for key, value in entry.content.items() if value}
            cells = {key: value for key, value in stripped.items() if value}
            line, at, _ = file.tree.place(entry.path)
            rows.append(Row(line, cells, lines, f"{at}."))
    return rows


def _clock(rows: Sequence[Row], started: str | None, faults: Faults) -> list[float] | None:
    """Minutes from the timestamps; None unless all readings have one and none has `minutes`."""
    moments = [_taken(row, faults) for row in rows]
    known = [moment for moment in moments if moment is not None]
    if not rows or len(known) < len(rows) or any("minutes" in row.cells for row in rows):
        return None
    try:
        first = datetime.fromisoformat(started) if started else min(known)
        minutes = [(moment - first).total_seconds() / 60.0 for moment in known]
    except TypeError:
        what = "Some times have a time zone and others have none."
        remedy = "Write all of them, and `started`, in the same way."
        rows[0].fault(faults, "timestamp", what, remedy)
        return None
    for row, value in zip(rows, minutes, strict=True):
        if not 0.0 <= value <= LATEST_MINUTES:
            what = "The time is before `started`, or years after it."
            row.fault(faults, "timestamp", what, "Correct the time, or `started`.")
    return minutes


def _moment(value: Any) -> str:
    """An ISO time."""
    try:
        datetime.fromisoformat(text(value))
    except ValueError as error:
        raise InputError("This is not a time.", "Write it as 2025-01-31T14:05:00.") from error
    return text(value)


def _taken(row: Row, faults: Faults) -> datetime | None:
    stamp = row.cells.get("timestamp")
    if stamp is None:
        return None
    try:
        return datetime.fromisoformat(_moment(stamp))
    except InputError as error:
        row.fault(faults, "timestamp", error.what, error.remedy)
        return None


def _difference(recorded: Model, given: Model) -> list[str]:
    names = differing(recorded, given)
    if not names:
        return []
    return [
        f"The session was measured on {recorded.machine.name!r}, which differs from the machine"
        f" given, {given.machine.name!r}, in: {', '.join(names)}. The machine given was used."
    ]
