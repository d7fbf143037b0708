"""Session files (`orthocal guide files`): the schema, read and written."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

from pydantic import InstanceOf, PlainSerializer, ValidationError

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files import machine_file
from orthoglide_cal.files.faults import Content, unused
from orthoglide_cal.files.readings import (
    Circumstances,
    Conditions,
    conditions_in,
    reading_rows,
    readings_in,
)
from orthoglide_cal.files.rows import ReadingRow, Rows
from orthoglide_cal.files.yaml_tree import yaml_text
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model
from orthoglide_cal.schema import Reason, Version

_ROWS = ("readings", "retaken", "skipped")


class Session(Circumstances):
    """A session as its file holds it; keys that are unknown are kept out of it, and reported."""

    schema_version: Version = 1
    machine: Annotated[InstanceOf[Model], PlainSerializer(machine_file.machine_values)]
    protocol: str | None = ""
    readings: tuple[ReadingRow, ...] = ()  # that count
    retaken: tuple[ReadingRow, ...] = ()  # that were replaced
    skipped: tuple[ReadingRow, ...] = ()  # steps that were left out


class _Frame(Circumstances):
    """Keys of a session besides its machine and rows."""

    schema_version: Version = 1


def session_from_tree(
    tree: Content, model: Model | None
) -> tuple[Readings, Model, Conditions, Model | None]:
    """The readings of a parsed session, the machine to judge them by, the circumstances, its own.

    Without a model they are judged by the machine in the session itself. Which offsets were active
    in the controller is always the session's to say. Raises InputError: everything that is
    wrong with it, each with line and path; or it is no session.
    """
    if not isinstance(tree.value, dict) or "readings" not in tree.value:
        if machine_file.is_machine_file(tree):
            what = "This is a machine file; it holds no readings."
            remedy = "Give it with --machine, and a file of readings as the input."
            raise InputError(what, remedy, file=tree.file)
        what = "This is neither a table of readings or differences nor a session."
        header = "leg, posture, direction, reading_mm or difference, value_mm"
        remedy = f"A CSV has a header with {header}; a session has `readings:`."
        raise InputError(what, remedy, file=tree.file, line=1)
    if model:
        try:
            model.machine.check_guided()
        except UsageError as error:
            none = f"a machine of kind {model.machine.kind} has none."
            what = f"The session was read with gauges; {none}"
            raise InputError(what, "Leave --machine out.", file=tree.file) from error
    recorded = machine_file.machine_in(tree, ("machine",))
    replaced = Rows(tree, ReadingRow, ("retaken",))
    skipped = Rows(tree, ReadingRow, ("skipped",), wanted=False)
    given = {key: tree.value.get(key) for key in _Frame.model_fields}
    frame = _Frame()
    try:
        frame = _Frame.model_validate({key: v for key, v in given.items() if v is not None})
    except ValidationError as error:
        tree.take(error, _Frame)
    judge = model or recorded
    if judge is None:
        raise tree.error()
    if model and recorded:
        held, asked = recorded.machine, model.machine
        if (held.active, held.corrected) != (asked.active, asked.corrected):
            judge = model.holding(held.active, held.corrected)
    keys = Session.model_fields
    remarks = unused("Keys", (key for key in tree.value if key not in keys), keys)
    if recorded and (names := machine_file.differing(recorded, judge)):
        machines = {"recorded": recorded.machine.name, "given": judge.machine.name}
        remarks.insert(0, Reason.of("other_machine", **machines, keys=names))
    # The readings pass the same checks as those of a CSV; faults around them are raised with
    # theirs.
    start = frame.started
    readings = readings_in(tree, judge.machine, ("readings",), started=start, remarks=remarks)
    conditions, labels = conditions_in(readings), {gauge.id for gauge in frame.gauges}
    others = (gauge for gauge in conditions.gauges if gauge.id not in labels)
    environment = {name: text for name, text in frame.environment.items() if text}
    origins = (environment.get(name, "") for name in ("readings_from", "source"))
    if any(origin.startswith("simulated") for origin in origins):
        readings = replace(readings, source=replace(readings.source, simulated=True))
    conditions = conditions.changed(
        **{key: getattr(frame, key) or None for key in ("protocol", "operator")},
        gauges=(*frame.gauges, *others),
        started=frame.started,
        finished=frame.finished,
        environment=environment,
        retaken=len(replaced.cells),
        skipped=len(skipped.cells),
    )
    return readings, judge, conditions, recorded


def session_json(session: Session) -> dict[str, object]:
    """A whole session as a JSON object; saved as a .json file it reads back as a session."""
    rows = {key: [row.cells() for row in getattr(session, key)] for key in _ROWS}
    content = session.model_dump(by_alias=True, exclude=set(_ROWS))
    for gauge in content["gauges"]:
        for name in ("due", "expanded_mm"):
            if not gauge[name]:
                del gauge[name]
    return {**dict.fromkeys(("schema_version", "machine")), **content, **rows}


def session_text(session: Session) -> str:
    """The session file's text; one line for each reading."""
    return yaml_text(session_json(session))


def session_of_readings(
    readings: Readings, model: Model, environment: Mapping[str, str]
) -> Session:
    """The session that holds these readings of this machine, in the order of time."""
    rows, plan = reading_rows(readings), readings.plan
    protocol = "double-posture" if plan.fixed else "single-posture"
    ordered = tuple(rows[index] for index in plan.in_time.tolist())
    return Session(machine=model, protocol=protocol, environment=environment, readings=ordered)
