"""Readings and sessions (`orthocal guide files`): rows to columns of arrays, and back to rows; and
files of differences."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import Annotated

import numpy as np
from pydantic import AliasChoices, ConfigDict, Field, InstanceOf, PlainSerializer, ValidationError

from orthoglide_cal.errors import InputError
from orthoglide_cal.files import machine_file
from orthoglide_cal.files.faults import Content, Steps, unused
from orthoglide_cal.files.rows import (
    DIFFERENCE_NAMES,
    KIND_WORDS,
    LATEST_MINUTES,
    TURNED,
    YES,
    DifferenceRow,
    ReadingRow,
    Rows,
    Table,
    check_order,
    times_of,
)
from orthoglide_cal.files.text import csv_text, number_text
from orthoglide_cal.files.yaml_tree import yaml_text
from orthoglide_cal.model.machine import Machine, OwnGauge
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Readings, Source
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import PlannedReading, plan_of, planned_readings
from orthoglide_cal.model.plan import known_plan
from orthoglide_cal.model.readings import AXES, Contact, Posture, number_setups
from orthoglide_cal.schema import Moment, Positive, Reason, Schema, Version, parse_number

# The note of a reading that was questioned and kept, with its step.
QUESTIONED = "kept although questioned (r {}): {}"
_QUESTIONED = re.compile(r"kept although questioned \(r ([0-9]+)\): ([^;:]+)")
_MINUTES_PER_READING = 0.4  # assumed where no times are given: 60 readings in 24 minutes


def implausible_temperatures(known_c: Iterable[float | None]) -> list[Reason]:
    """A remark on the first temperature that no workshop has [°C]; none if all are plausible."""
    beyond = (c for c in known_c if c is not None and not -40.0 <= c <= 60.0)
    return [Reason.of("implausible_temperature", celsius=celsius) for celsius in beyond][:1]


class GaugeIdentity(OwnGauge):
    """A gauge as a session has it; None where not given."""

    model_config = ConfigDict(extra="ignore", populate_by_name=True)

    certificate: str | None = None
    resolution_mm: Positive | None = Field(
        default=None,
        validation_alias=AliasChoices("resolution_mm", "resolution"),
        serialization_alias="resolution",
    )


class Circumstances(Schema):
    """Frame of the readings of a session; None or empty where not given, never invented."""

    schema_version: Version = 1
    protocol: str | None = None  # as `measure` was told
    operator: str | None = None
    gauges: tuple[GaugeIdentity, ...] = ()  # that were used
    started: Moment | None = None  # ISO 8601
    finished: Moment | None = None
    environment: Mapping[str, str | None] = {}  # name → what is said of it


class Conditions(Circumstances):
    """Circumstances as recorded; the gauges are those of the session, or labels in the readings."""

    environment: Mapping[str, str] = {}
    temperature_c: tuple[float, ...] = ()  # of the thermometer, in the order of time
    retaken: int = 0  # number of readings that were replaced
    skipped: int = 0  # number of steps that were left out
    notes: tuple[tuple[int, str], ...] = ()  # (line of the file, remark)

    @property
    def questioned(self) -> tuple[tuple[str, str], ...]:
        """Step and question of each reading of a session that was questioned and kept."""
        matches = (_QUESTIONED.match(note) for _, note in self.notes)
        return tuple((match[1], match[2]) for match in matches if match)

    @property
    def temperature_ends_c(self) -> tuple[float | None, float | None]:
        """At the start and the end, as the environment states them, else of the thermometer."""

        def stated(end: int, *names: str) -> float | None:
            for name in names:
                with suppress(InputError):
                    return parse_number(self.environment.get(name, ""))
            return self.temperature_c[end] if self.temperature_c else None

        return stated(0, "temperature_start_c", "temperature_c"), stated(-1, "temperature_end_c")

    @property
    def temperatures_c(self) -> tuple[float, ...]:
        """Every temperature that is known; empty if none is."""
        return (*self.temperature_c, *(end for end in self.temperature_ends_c if end is not None))

    @property
    def mean_temperature_c(self) -> float | None:
        """Middle of the thermometer's range, else mean of what is stated; None if neither."""
        known = self.temperature_c or self.temperatures_c
        return (min(known) + max(known)) / 2.0 if known else None


def readings_in(
    content: Content,
    machine: Machine,
    path: Steps = (),
    *,
    started: str | None = None,
    remarks: Sequence[Reason] = (),
) -> Readings:
    """Convert and check the readings of a file, by the limits of a machine.

    `path` is that of their list, `started` (ISO 8601) counts where there are no `minutes`; remarks
    are added to those given. Raises InputError: everything that is wrong with the file.
    """
    longest = dict.fromkeys(("reading_mm", "entered"), machine.leg_mm)
    rows = Rows(content, ReadingRow, path, longest=longest, travel=machine.limits_mm)
    rows.check_complete(("seq", "cycle", "minutes", "end"))
    _time(rows, started)
    check_order(rows)
    _check_parts(rows)
    checked = rows.checked()
    lines = [rows.line(index) for index in range(len(checked))]
    readings = readings_of(checked, machine, rows.source, lines)
    found = _remarks(readings, rows.cells, machine)
    return replace(readings, remarks=(*remarks, *rows.remarks, *found))


def readings_of(
    rows: Sequence[ReadingRow], machine: Machine, source: Source, lines: Sequence[int]
) -> Readings:
    """Checked rows in the order of their file, and their lines, as arrays.

    The machine gives the postures.
    """
    first = rows[0]  # what is numbered or timed in one row is so in all
    in_time, minutes, timed = times_of(rows)
    order = np.argsort(in_time)
    named = {posture.value: machine.displacement_mm(posture) for posture in Posture}
    gauge = tuple(row.gauge or "" for row in rows)
    planned = [
        PlannedReading(
            leg=AXES.index(row.leg),
            direction=AXES.index(row.direction),
            displacement=named[row.posture] if row.posture in named else float(row.posture),
            contact=Contact[(row.end or "fixed").upper()],
            gauge_at=0.5 if row.gauge_at is None else row.gauge_at,
            part=(row.part or 1) - 1,
            turned=row.bar is not None,
            entered=row.entered or (0.0, 0.0, 0.0),
        )
        for row in rows
    ]
    hours = np.where(timed, minutes, order * _MINUTES_PER_READING) / 60.0
    ordered, places = timed or first.seq is not None, [reading.place for reading in planned]
    setup = number_setups(places, gauge, in_time.tolist(), ordered=ordered)
    plan = plan_of(planned, order=order, hours=hours, setup=setup)
    cycle = [row.cycle or 1 for row in rows] if first.cycle is not None else plan.cycles
    warm = [math.nan if row.temperature_c is None else row.temperature_c for row in rows]
    return Readings(
        plan=known_plan(plan),
        value=np.array([row.reading_mm for row in rows], dtype=np.float64),
        cycle=np.array(cycle),
        posture=tuple(row.posture for row in rows),
        temperature=np.array(warm),
        gauge=gauge,
        note=tuple(row.note or "" for row in rows),
        timestamp=tuple(row.timestamp or "" for row in rows),
        line=np.array(lines),
        timed=timed,
        source=source,
    )


def conditions_in(readings: Readings) -> Conditions:
    """Conditions that the readings alone state."""
    known = [t for t in readings.temperature[readings.plan.in_time].tolist() if t == t]
    labels = dict.fromkeys(label for label in readings.gauge if label)
    notes = zip(readings.line.tolist(), readings.note, strict=True)
    return Conditions(
        temperature_c=tuple(known),
        gauges=tuple(GaugeIdentity(id=label) for label in labels),
        notes=tuple((line, note) for line, note in notes if note),
    )


def reading_rows(readings: Readings) -> list[ReadingRow]:
    """The readings as a file holds them, in their order.

    Reading them back gives exactly the same values, postures, order and set-ups, and the times to
    1e-6 minutes. Set-ups that the reader could not distinguish by part, leg, direction, position
    and gauge get labels of their own.
    """
    plan, gauges = readings.plan, readings.gauge
    seq, minutes = (np.argsort(plan.in_time) + 1).tolist(), (plan.hours * 60.0).tolist()
    cells = planned_readings(plan)
    places = [cell.place for cell in cells]
    understood = number_setups(places, gauges, plan.in_time.tolist(), ordered=True)
    pairs = set(zip(understood.tolist(), plan.shared.tolist(), strict=True))
    if not len(pairs) == len(set(understood.tolist())) == plan.setups:
        gauges = tuple(f"set-up {number + 1}" for number in plan.shared.tolist())
    return [
        row_at(cells[k], readings.posture[k], several=plan.parts > 1).changed(
            cycle=int(readings.cycle[k]),
            reading_mm=float(readings.value[k]),
            seq=seq[k],
            minutes=round(minutes[k], 6) if readings.timed else None,
            temperature_c=None if math.isnan(t) else t,
            gauge=gauges[k],
            note=readings.note[k],
            simulated=YES if readings.source.simulated else None,
            timestamp=readings.timestamp[k],
        )
        for k, t in enumerate(readings.temperature.tolist())
    ]


def row_at(cell: PlannedReading, posture: str, *, several: bool) -> ReadingRow:
    """Where the gauge of a planned reading, of one or `several` parts, stands if not as usual."""
    fixed = cell.contact is Contact.FIXED
    return ReadingRow(
        leg=AXES[cell.leg],
        posture=posture,
        direction=AXES[cell.direction],
        end=cell.contact.end,
        gauge_at=cell.gauge_at if fixed and cell.gauge_at != 0.5 else None,
        part=cell.part + 1 if several else None,
        bar=TURNED if cell.turned else None,
        entered=cell.entered if any(cell.entered) else None,
    )


def readings_csv(readings: Readings) -> str:
    """The text of a readings file, without columns that would be empty; see `reading_rows`."""
    rows = [row.cells() for row in reading_rows(readings)]
    columns = [name for name in ReadingRow.columns() if any(name in row for row in rows)]
    cells = ([row.get(name) for name in columns] for row in rows)
    texts = ([number_text(c) if isinstance(c, float) else c for c in row] for row in cells)
    return csv_text(columns, texts)


def _time(rows: Rows[ReadingRow], started: str | None) -> None:
    """Give the rows the minutes of their timestamps, if all have one and none has `minutes`."""
    taken = {k: datetime.fromisoformat(row.timestamp) for k, row in rows.sound if row.timestamp}
    if not taken or len(taken) < len(rows.sound) or any("minutes" in cells for cells in rows.cells):
        return
    try:
        first = datetime.fromisoformat(started) if started else min(taken.values())
        minutes = {k: (moment - first).total_seconds() / 60.0 for k, moment in taken.items()}
    except TypeError:
        what = "Some times have a time zone and others have none."
        remedy = "Write all of them, and `started`, in the same way."
        rows.note(min(taken), "timestamp", what, remedy)
        return
    for index, row in rows.sound:
        rows.rows[index] = row.changed(minutes=minutes[index])
        if not 0.0 <= minutes[index] <= LATEST_MINUTES:
            what = "The time is before `started`, or years after it."
            rows.note(index, "timestamp", what, "Correct the time, or `started`.")


def _check_parts(rows: Rows[ReadingRow]) -> None:
    """Parts are numbered in order of time, without a gap."""
    last = 1
    for index, row in sorted(rows.sound, key=lambda item: item[1].seq or 0):
        part = row.part or 1
        if not last <= part <= last + 1:
            what = f"Part {part} does not follow part {last}."
            remedy = "Number the parts 1, 2 and so on, in the order in which they were measured."
            rows.note(index, "part", what, remedy)
        last = max(last, part)


def _remarks(
    readings: Readings, rows: Sequence[Mapping[str, str]], machine: Machine
) -> Iterator[Reason]:
    """Remarks on readings in which nothing is wrong."""
    travel = machine.instrument.most_mm
    beyond = np.flatnonzero(np.abs(readings.value) > travel)
    if beyond.size:
        line, value = int(readings.line[beyond[0]]), float(readings.value[beyond[0]])
        counts = {"count": beyond.size, "readings": len(readings)}
        yield Reason.of("beyond_range", **counts, range_mm=travel, line=line, value_mm=value)
    if not readings.timed:
        yield Reason.of("untimed", minutes=_MINUTES_PER_READING)
    if readings.timed or "cycle" in rows[0]:
        # Cycle or minutes should tell repeats apart.
        first: dict[frozenset[tuple[str, str]], int] = {}
        again = []
        for line, cells in zip(readings.line.tolist(), rows, strict=True):
            content = frozenset(item for item in cells.items() if item[0] != "seq")
            if first.setdefault(content, line) != line:
                again.append({"line": line, "first": first[content]})
        if again:
            yield Reason.of("repeated_line", **again[0], count=len(again))


# --- differences of readings, as the paper prints them --------------------------------------------


def differences_from_table(table: Table, machine: Machine) -> Differences:
    """The differences of a CSV. Raises InputError with everything that is wrong."""
    rows = Rows(table, DifferenceRow, longest={"value_mm": machine.leg_mm})
    remarks = [*rows.remarks]
    kind = _kind(rows)
    values = {row.difference: row.value_mm for row in rows.checked()}
    known = {difference.name: difference for difference in DIFFERENCES[kind]}
    if missing := [name for name in known if name not in values]:
        remarks.append(Reason.of("missing_differences", kind=kind, names=missing))
    if kind is DataKind.TWELVE and values.keys() <= {e.name for e in DIFFERENCES[DataKind.SINGLE]}:
        remarks.append(Reason.of("taken_as_twelve"))
    which = tuple(known[name] for name in values)
    value = np.array(list(values.values()))
    return Differences(kind, which, value, rows.source, remarks=tuple(remarks))


def _kind(rows: Rows[DifferenceRow]) -> DataKind:
    """The kind that most of the names belong to; the others are faults, and so are repeats."""
    # The single set shares four names with the twelve; its own two decide.
    known = {kind: {difference.name for difference in DIFFERENCES[kind]} for kind in DIFFERENCES}
    names = {index: row.difference for index, row in rows.sound}
    order = [DataKind.TWELVE, DataKind.SIX]
    if {"dz_x0", "dz_y0"} & set(names.values()):
        order.insert(0, DataKind.SINGLE)
    kind = max(order, key=lambda kind: sum(name in known[kind] for name in names.values()))
    first: dict[str, int] = {}
    for index, name in names.items():
        if name not in known[kind]:
            others = f"{kind} ({KIND_WORDS[kind]})"
            what = f"The name is of another kind than the others, which are {others}."
            rows.note(index, "difference", what, f"Give one kind in one file. {DIFFERENCE_NAMES}")
        elif name in first:
            what = f"The difference is already in line {first[name]}."
            remedy = "Give each difference once; average repeats, or give the raw readings."
            rows.note(index, "difference", what, remedy)
        first.setdefault(name, rows.line(index))
    return kind


# --- sessions -----------------------------------------------------------------------------------

_ROWS = ("readings", "retaken", "skipped")


class Session(Circumstances):
    """A session as its file holds it; keys that are unknown are kept out of it, and reported."""

    machine: Annotated[InstanceOf[Model], PlainSerializer(machine_file.machine_values)]
    protocol: str | None = ""
    readings: tuple[ReadingRow, ...] = ()  # that count
    retaken: tuple[ReadingRow, ...] = ()  # that were replaced
    skipped: tuple[ReadingRow, ...] = ()  # steps that were left out


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
    if model and not model.machine.vocabulary.measure:
        none = f"a machine of kind {model.machine.kind} has none."
        what = f"The session was read with gauges; {none}"
        raise InputError(what, "Leave --machine out.", file=tree.file)
    recorded = machine_file.machine_in(tree, ("machine",))
    replaced = Rows(tree, ReadingRow, ("retaken",))
    skipped = Rows(tree, ReadingRow, ("skipped",), wanted=False)
    stated = ((key, tree.value.get(key)) for key in Circumstances.model_fields)
    frame = Circumstances()
    try:
        frame = Circumstances.model_validate({key: value for key, value in stated if value})
    except ValidationError as error:
        tree.take(error, Circumstances)
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
    counts = {"retaken": len(replaced.cells), "skipped": len(skipped.cells)}
    gauges = *frame.gauges, *others
    given = dict(frame) | counts | {"gauges": gauges, "environment": environment}
    conditions = conditions.changed(**given)
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
