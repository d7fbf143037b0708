"""Readings of gauges, touches of a bed, differences and sessions (`orthocal guide files`): text to
rows to columns of arrays, and back to rows.

A row comes as the texts of its cells, whatever file it stands in; the same class writes it. Every
cell is checked by itself there; what only shows across rows, where the rows become arrays.
"""

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from difflib import get_close_matches
from itertools import chain, pairwise
from types import MappingProxyType
from typing import Annotated, ClassVar, Generic, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    ConfigDict,
    Field,
    InstanceOf,
    PlainSerializer,
    ValidationError,
    ValidationInfo,
    field_serializer,
    field_validator,
)

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files import machine_file
from orthoglide_cal.files.text import FileText, csv_text, number_text
from orthoglide_cal.files.tree import WORDS, Content, Place, Steps, unused, yaml_text
from orthoglide_cal.model.linear_delta import touching
from orthoglide_cal.model.machine import Bed, Machine, OwnGauge
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Readings, Source
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import PlannedReading, planned_readings
from orthoglide_cal.model.plan import Floats, Ints, known_plan
from orthoglide_cal.model.readings import AXES, Contact, Posture, number_setups
from orthoglide_cal.schema import (
    Count,
    Moment,
    Positive,
    Reason,
    Schema,
    Version,
    parse_number,
    text_that,
    whole_number,
    yaml_number,
)
from orthoglide_cal.words import MM, MM_PER_INCH, listed, short

LATEST_MINUTES = 1e6  # two years
TURNED = "turned"
YES = "yes"
_POSTURES = {posture.value for posture in Posture}
_AXIS = "Write x, y or z."
_READING = "Give the reading, or remove the row."
_PLACE = "Give it, or remove the row."
_HEIGHT = "Write the height at which the probe triggers, or remove the row."
_POSTURE = "Write iso, max, min or a displacement in mm."


def _number(value: object, info: ValidationInfo) -> float:
    if info.context is None or not isinstance(value, str):
        return yaml_number(value)
    return float(info.context.content.parse(value))


def _length(value: object, info: ValidationInfo) -> float:
    size = _number(value, info)
    if info.context is None:
        return size
    size *= MM_PER_INCH if info.field_name == info.context.in_inches else 1.0
    longest = info.context.longest.get(info.field_name, math.inf)
    if abs(size) > longest:
        fault = f"The length is larger than this machine allows: {longest:g} mm."
        raise InputError(fault, "Check the unit and the decimal mark; lengths are in mm.")
    return size


def _posture(text: str, info: ValidationInfo) -> str:
    """iso, max, min, or the displacement as the shortest text."""
    if text.lower() in _POSTURES:
        return text.lower()
    if info.context is None:
        return text
    (low, high), remedy = info.context.travel, _POSTURE
    if low > -math.inf:
        remedy = f"Write iso, max, min or a displacement from {low:g} to {high:g} mm."
    try:
        displacement = _number(text, info)
    except InputError:
        raise InputError("This is not a posture.", remedy) from None
    if not low <= displacement <= high:
        raise InputError("The posture is outside the joint limits.", remedy)
    return number_text(displacement)


def _entered(value: str | Sequence[object], info: ValidationInfo) -> tuple[float, ...]:
    texts = value.split() if isinstance(value, str) else value
    # The keys of a group are no offsets.
    offsets = tuple(_length(text, info) for text in texts) if isinstance(texts, Sequence) else ()
    if len(offsets) != len(AXES):
        fault = f"Three numbers are needed, for x, y and z, not {len(offsets)}."
        raise InputError(fault, "Write mm with blanks between them, such as 0.5 0 0.")
    return offsets


def _mark(word: str, fault: str, where: str) -> AfterValidator:
    remedy = f"Write {word} where {where}; otherwise leave the cell empty."
    return text_that(word.__eq__, fault, remedy)


Cell = Annotated[float, BeforeValidator(_number)]
Length = Annotated[float, BeforeValidator(_length)]
Order = Annotated[int, whole_number(0)]
_LOWER = AfterValidator(str.lower)
Axis = Annotated[str, _LOWER, text_that(AXES.__contains__, "This is not an axis.", _AXIS)]
_END = text_that(
    ("joint", "tool").__contains__, "This is not an end of the leg.", "Write joint or tool."
)
_TURNED = _mark(TURNED, "This does not say how the bar was.", "it was turned half round")
_SIMULATED = _mark(YES, "This does not say whether it was simulated.", "a simulator made the row")
Mark = Annotated[str, _LOWER, _SIMULATED]
Minutes = Annotated[Cell, Field(ge=0.0, le=LATEST_MINUTES)]


class Row(Schema):
    """Base of all rows; what else stands in a record is kept by its file, and reported."""

    model_config = ConfigDict(extra="ignore")
    noun: ClassVar[str] = "reading"  # what a row is
    # Column that is needed → what to write where it is empty; the last one holds what was read.
    needed: ClassVar[Mapping[str, str]] = {}
    inches: ClassVar[str | None] = None  # column that may stand instead of the last one
    only_in_sessions: ClassVar[Sequence[str]] = ()

    @classmethod
    def columns(cls, of_table: bool = True) -> tuple[str, ...]:
        """The columns that a table may have, or a row of a session."""
        unread = cls.only_in_sessions if of_table else ()
        names = (name for name in cls.model_fields if name not in unread)
        return (*names, *([cls.inches] if cls.inches else []))

    def cells(self) -> dict[str, object]:
        """Column → what a file holds, in the order of files; blank ones are left out."""
        return {key: value for key, value in self.model_dump().items() if value not in (None, "")}


class ReadingRow(Row):
    """A gauge reading; None where nothing is said."""

    inches = "reading_in"
    leg: Axis  # whose carriage is displaced
    # iso, max, min of that leg, or its displacement from the isotropic posture [mm].
    posture: Annotated[str, AfterValidator(_posture)]
    direction: Axis  # along which the gauge measures
    end: Annotated[str, _LOWER, _END] | None = None  # of the leg, in the single-posture protocol
    cycle: Count | None = None  # repeat, from 1
    # None for a step that was left out.
    reading_mm: Length | None = Field(None, validation_alias=AliasChoices("reading_mm", inches))
    seq: Order | None = None  # order in time
    minutes: Minutes | None = None  # since the session began
    temperature_c: Annotated[Cell, Field(ge=-100.0, le=200.0)] | None = None
    gauge: str | None = None  # its label
    # Where it stood along the leg, from the carriage joint (0) to the tool (1).
    gauge_at: Annotated[Cell, Field(ge=0.0, le=1.0)] | None = None
    part: Count | None = None  # of the measurement, from 1
    bar: Annotated[str, _LOWER, _TURNED] | None = None  # whether the touched one was turned
    # In the controller since the first reading, x, y, z [mm].
    entered: Annotated[tuple[float, float, float], BeforeValidator(_entered)] | None = None
    note: str | None = None
    simulated: Mark | None = None  # "yes" where no machine was measured
    timestamp: Moment | None = None
    reason: str | None = None  # why it was replaced or left out

    needed: ClassVar[Mapping[str, str]] = {
        "leg": _AXIS, "posture": _POSTURE, "direction": _AXIS, "reading_mm": _READING
    }  # fmt: skip
    only_in_sessions = ("timestamp", "reason")

    @field_validator("direction")
    @classmethod
    def _across(cls, direction: str, info: ValidationInfo) -> str:
        if direction == info.data.get("leg"):
            other = " or ".join(name for name in AXES if name != direction)
            raise InputError(
                "A gauge along the leg's own axis does not measure the leg.",
                f"Give the direction across the leg: {other}; or correct the leg.",
            )
        return direction

    @field_serializer("entered")
    def _written(self, entered: tuple[float, ...] | None) -> str | None:
        return " ".join(map(number_text, entered)) if entered else None


class ProbeRow(Row):
    """A touch of a bed by the probe."""

    x_mm: Length  # commanded place
    y_mm: Length
    reading_mm: Length  # height at which the probe triggers
    z_mm: Length | None = None  # of the surface that it touches
    seq: Order | None = None
    cycle: Count | None = None
    minutes: Minutes | None = None
    note: str | None = None
    simulated: Mark | None = None

    needed: ClassVar[Mapping[str, str]] = {"x_mm": _PLACE, "y_mm": _PLACE, "reading_mm": _HEIGHT}


KIND_WORDS = {
    DataKind.SIX: "max − min",
    DataKind.TWELVE: "relative to the isotropic posture",
    DataKind.SINGLE: "tool end − joint end",
}
_BY_NAME = {kind: {one.name: one for one in known} for kind, known in DIFFERENCES.items()}
DIFFERENCE_NAMES = "Direction first, leg second. Known: {}.".format(
    "; ".join(f"{kind} ({KIND_WORDS[kind]}): {', '.join(_BY_NAME[kind])}" for kind in _BY_NAME)
)


def _difference_name(text: str) -> str:
    """The canonical name; the leading d may be missing, or a delta."""
    name = "d" + re.sub("^[dδ∆]", "", text.lower().replace("\u2212", "-").replace(" ", ""))
    if not any(name in known for known in _BY_NAME.values()):
        raise InputError("This is not the name of a difference.", DIFFERENCE_NAMES)
    return name


class DifferenceRow(Row):
    """A difference as the paper prints it."""

    difference: Annotated[str, AfterValidator(_difference_name)]
    value_mm: Length
    simulated: Mark | None = None

    noun = "difference"
    needed: ClassVar[Mapping[str, str]] = {
        "difference": DIFFERENCE_NAMES,
        "value_mm": "Give the value or remove the row.",
    }


# --- tables and lists of rows ------------------------------------------------------------------

# Columns that never hold free text.
CODED = {*ReadingRow.columns(), *ProbeRow.columns(), *DifferenceRow.columns()} - {"gauge", "note"}
_COLUMNS = 100
_ROWS = 100_000  # read in a few seconds
_COMMENTS = ("#", "sep=")  # Excel's line says nothing that the header does not
_BLANKS = " \t\u00a0\u202f\ufeff\n\r\v\f"  # also those that spreadsheets and web pages leave


class Table(Content):
    """A CSV file; its value is the list of its rows that are not blank.

    Each is column → text of cells that are not empty. The header says what separates cells:
    guessing goes wrong on `1,234;5,678`. Lines that start with # or, as in Excel, with sep= are
    skipped; after the header only if the first column holds no free text, which may start so.
    """

    of_table = True

    def __init__(self, document: FileText) -> None:
        super().__init__(document)
        self.columns: list[str] = []  # names in lower case, in order; "" where there is none
        self.header_line, self.delimiter = 1, ""
        self.rows: list[dict[str, str]] = []
        self.value = self.rows
        comments, lines = True, enumerate(document.text.split("\n"), start=1)
        for line, text in lines:
            plain = text.strip(_BLANKS)
            if not plain or (comments and plain.startswith(_COMMENTS)):
                continue
            if not self.columns:
                self.delimiter = next((mark for mark in "\t;," if mark in plain), ",")
            rest = (f"{more}\n" for _, more in chain([(line, text)], lines))  # quotes may span them
            reader = csv.reader(rest, delimiter=self.delimiter, strict=True, skipinitialspace=True)
            try:
                cells = [cell.strip(_BLANKS) for cell in next(reader)]
            except csv.Error as error:
                fault = f"The row cannot be split into cells: {error}."
                if "end of data" in str(error):
                    fault = "A quotation mark is opened and never closed."
                remedy = 'Close it, or write "" for a quotation mark inside quotes.'
                self.add(fault, remedy, line=line, value=text.strip())
                break
            if not self.columns:
                self._head(cells, line)
                comments = self.columns[0] in CODED
            elif len(self.rows) >= _ROWS:
                self.add(f"There are more than {_ROWS} rows.", "Give a smaller file.", line=line)
                break
            elif any(cells[len(self.columns) :]):
                fault = f"The row has {len(cells)} cells, the header {len(self.columns)}."
                remedy = f"Put a cell that holds {self.delimiter!r} in quotes."
                if self.delimiter == ",":
                    remedy = "For decimal commas separate columns with semicolons"
                    remedy += ", in the header too."
                self.add(fault, remedy, line=line, value=text.strip())
            elif any(cells):
                self.lines[len(self.rows),] = line
                pairs = zip(self.columns, cells, strict=False)
                self.rows.append({name: cell for name, cell in pairs if cell})

    def _head(self, cells: Sequence[str], line: int) -> None:
        """Take the columns' names; too many and repeated ones are faults."""
        self.columns = [name.lower() for name in cells[:_COLUMNS]]
        self.header_line = line
        if len(cells) > _COLUMNS:
            fault = f"The header has more than {_COLUMNS} columns."
            self.add(fault, "Check the delimiter.", line=line)
        again = (name for k, name in enumerate(self.columns) if name in self.columns[:k])
        for name in filter(None, again):
            self.add("The header names this column twice.", "Rename or remove one.", line, name)

    def parse(self, text: str) -> float:
        """The number that a cell writes; another delimiter leaves the comma free for decimals."""
        return parse_number(text, decimal_comma=self.delimiter != ",")

    def place(self, path: Steps) -> Place:
        """Place of a row, or of a cell of it."""
        cells = self.rows[int(path[0])]
        column = str(path[1]) if len(path) > 1 else ""
        return self.lines[path[:1]], column or None, cells.get(column)

    def check_header(self, schema: type[Row]) -> None:
        """Raise all faults so far if the header lacks a column that rows of a schema need."""
        present = [name for name in self.columns if name]
        others = [name for name in present if name not in schema.columns()]
        missing = [name for name in schema.needed if name not in present]
        if schema.inches in present:
            missing = [name for name in missing if name != [*schema.needed][-1]]
        for name in missing:
            close = get_close_matches(name, others, n=1)
            remedy = f"Add it; the header has: {listed(present)}."
            if close:
                unit = MM.get(close[0].rpartition("_")[2])
                factor = f"multiply the numbers by {short(unit, 6)} and " if unit else ""
                remedy = f"{factor}rename the column {close[0]!r}.".capitalize()
            self.add("The column is missing.", remedy, line=self.header_line, column=name)
        if missing:
            raise self.error()
        self._check_split_numbers()

    def _check_split_numbers(self) -> None:
        """Refuse `0,123` that a comma-separated row has split into the reading 0 and a text 123.

        A column next to the readings that never holds free text has not got the 123.
        """
        pairs = (pair for pair in pairwise(self.columns) if pair[0] in ("reading_mm", "reading_in"))
        value, after = next(pairs, ("", ""))
        if self.delimiter != "," or not (self.rows and value) or after in CODED:
            return
        cells, fractions = ([row.get(name, "") for row in self.rows] for name in (value, after))
        whole = all(re.fullmatch("[-+\u2212]?[0-9]+", cell) for cell in cells)
        if whole and all(map(str.isdigit, fractions)) and max(map(len, fractions)) > 1:
            fault = f"Every reading is a whole number with digits in the next column, {after!r}:"
            fault += " decimal commas?"
            remedy = "Write decimal points, or separate the columns with semicolons."
            self.add(fault, remedy, self.lines[0,], value, f"{cells[0]},{fractions[0]}")


R = TypeVar("R", bound=Row)
Timed = TypeVar("Timed", ReadingRow, ProbeRow)


class Rows(Generic[R]):
    """A list in a file, at a path, as rows; None for one with a fault, which is noted.

    Args:
        longest: column → the longest length that it may have [mm].
        travel: of a carriage, lowest and highest [mm].
    """

    def __init__(
        self,
        content: Content,
        schema: type[R],
        path: Steps = (),
        *,
        longest: Mapping[str, float] = MappingProxyType({}),
        travel: tuple[float, float] = (-math.inf, math.inf),
    ) -> None:
        self.content, self.path, self.noun = content, path, schema.noun
        self.longest, self.travel = longest, travel
        self.in_inches: str | None = None  # the column that the row being read gives in inches
        self.cells: list[dict[str, str]] = []  # column → text, of cells that are not empty
        self.rows: list[R | None] = []
        known = schema.columns(content.of_table)
        missing = "The value is missing."
        words = {f"missing {name}": (missing, remedy) for name, remedy in schema.needed.items()}
        if isinstance(content, Table):
            content.check_header(schema)
        entries = content.at(path)
        if not isinstance(entries, list):
            if entries is not None:
                content.note(path, *WORDS["list_type"])
            entries = []
        self.lines = [content.lines[*path, index] for index in range(len(entries))]
        for index, entry in enumerate(entries):
            texts = entry.items() if isinstance(entry, dict) else ()
            plain = {name: text.strip() if isinstance(text, str) else text for name, text in texts}
            cells = {name: text for name, text in plain.items() if text not in (None, "")}
            self.cells.append(cells)
            self.rows.append(None)
            self.in_inches = [*schema.needed][-1] if schema.inches in cells else None
            given = {name: text for name, text in cells.items() if name in known}
            try:
                self.rows[index] = schema.model_validate(
                    given if isinstance(entry, dict) else entry, context=self
                )
            except ValidationError as error:
                content.take(error, schema, (*path, index), words)
            if schema.inches and self.in_inches in cells:
                remedy = f"Keep one of {self.in_inches} and {schema.inches}."
                self.note(index, schema.inches, "The row has two readings.", remedy)
        columns = dict.fromkeys(name for cells in self.cells for name in cells)
        names = content.columns if isinstance(content, Table) else columns
        self.remarks = unused("Columns", (name for name in names if name not in known), known)

    @property
    def source(self) -> Source:
        """Source of them: the file, simulated if any of them is."""
        simulated = any("simulated" in cells for cells in self.cells)
        return replace(self.content.document.source, simulated=simulated)

    def note(self, index: int, column: str, fault: str, remedy: str) -> None:
        self.content.note((*self.path, index, column), fault, remedy)
        self.rows[index] = None

    @property
    def sound(self) -> list[tuple[int, R]]:
        """Readings without a fault so far, with their places in the file."""
        return [(index, row) for index, row in enumerate(self.rows) if row is not None]

    def checked(self) -> list[R]:
        """All rows, at least one. Raises InputError if anything is wrong."""
        if not self.cells and not self.content.problems:
            remedy = "Give one row for each, under the header."
            self.content.add(f"There is no {self.noun}.", remedy)
        self.content.check()
        return [row for row in self.rows if row is not None]

    def check_complete(self, columns: Sequence[str]) -> None:
        """Each of these columns is filled in every row or in none."""
        for column in columns:
            empty = [k for k, cells in enumerate(self.cells) if cells and column not in cells]
            for index in empty if any(column in cells for cells in self.cells) else ():
                fault = "The cell is empty here but filled in other rows."
                self.note(index, column, fault, "Fill it in every row or in none.")


def _times_of(rows: Sequence[Timed]) -> tuple[Ints, Floats, bool]:
    """Indices from first to last; minutes; and whether they are times: no one time for all."""
    in_time = np.argsort([row.seq or 0 for row in rows], kind="stable")
    minutes = np.array([row.minutes or 0.0 for row in rows])
    timed = rows[0].minutes is not None and (len(rows) == 1 or len(np.unique(minutes)) > 1)
    return in_time, minutes, timed


def _check_order(rows: Rows[Timed]) -> None:
    """Each `seq` stands once, and time never runs backwards along it."""
    in_time = sorted(rows.sound, key=lambda item: item[1].seq or 0)
    for (before, one), (after, other) in pairwise(in_time):
        line = rows.lines[before]
        if other.seq is not None and other.seq == one.seq:
            remedy = "Number the readings in the order in which they were taken."
            rows.note(after, "seq", f"The same number is in line {line}.", remedy)
        elif (other.minutes or 0.0) < (one.minutes or 0.0):
            fault = f"Time runs backwards: line {line} was taken before this one."
            remedy = "Give minutes since the session began; correct seq or the order of the rows."
            column = "minutes" if "minutes" in rows.cells[after] else "timestamp"
            rows.note(after, column, fault, remedy)


# --- readings ----------------------------------------------------------------------------------

_MINUTES_PER_READING = 0.4  # assumed where no times are given: 60 readings in 24 minutes


def readings_in(
    content: Content,
    machine: Machine,
    path: Steps = (),
    started: str | None = None,
    remarks: Sequence[Reason] = (),
) -> Readings:
    """Readings of a file, checked by the limits of a machine.

    `path` is that of their list; `started` (ISO 8601) counts where there are no `minutes`.
    Raises InputError: everything that is wrong with the file.
    """
    longest = dict.fromkeys(("reading_mm", "entered"), machine.leg_mm)
    rows = Rows(content, ReadingRow, path, longest=longest, travel=machine.limits_mm)
    _check_read(rows)
    rows.check_complete(("seq", "cycle", "minutes", "end"))
    _time(rows, started)
    _check_order(rows)
    _check_parts(rows)
    readings = readings_of(rows.checked(), machine, rows.source, rows.lines)
    remarks, travel = [*remarks, *rows.remarks], machine.instrument.most_mm
    beyond = np.flatnonzero(np.abs(readings.value) > travel).tolist()
    if beyond:
        counts = {"count": len(beyond), "readings": len(readings)}
        first = {"line": rows.lines[beyond[0]], "value_mm": float(readings.value[beyond[0]])}
        remarks.append(Reason.of("beyond_range", **counts, range_mm=travel, **first))
    if not readings.timed:
        remarks.append(Reason.of("untimed", minutes=_MINUTES_PER_READING))
    return replace(readings, remarks=tuple(remarks))


def readings_of(
    rows: Sequence[ReadingRow], machine: Machine, source: Source, lines: Sequence[int]
) -> Readings:
    """Checked rows in the order of their file, and their lines, as arrays."""
    first = rows[0]  # what is numbered or timed in one row is so in all
    in_time, minutes, timed = _times_of(rows)
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
    plan = PlannedReading.planned(planned, order=order, hours=hours, setup=setup)
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


def reading_rows(readings: Readings) -> list[ReadingRow]:
    """The readings as a file holds them, in their order; times are rounded to 1e-6 minutes.

    Set-ups that a reader could not distinguish by part, leg, direction, position and gauge get
    labels of their own.
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
    """Place of the gauge of a planned reading, of one or `several` parts, if not as usual."""
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
    """The text of a readings file, without columns that would be empty."""
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
        fault = "Some times have a time zone and others have none."
        remedy = "Write all of them, and `started`, in the same way."
        rows.note(min(taken), "timestamp", fault, remedy)
        return
    for index, row in rows.sound:
        rows.rows[index] = row.changed(minutes=minutes[index])
        if not 0.0 <= minutes[index] <= LATEST_MINUTES:
            fault = "The time is before `started`, or years after it."
            rows.note(index, "timestamp", fault, "Correct the time, or `started`.")


def _check_read(rows: Rows[ReadingRow]) -> None:
    """Each row has its reading, which only a skipped one lacks."""
    for index, cells in enumerate(rows.cells):
        if cells and cells.keys().isdisjoint(("reading_mm", ReadingRow.inches)):
            rows.note(index, "reading_mm", "The reading is missing.", _READING)


def _check_parts(rows: Rows[ReadingRow]) -> None:
    """Parts are numbered in order of time, without a gap."""
    last = 1
    for index, row in sorted(rows.sound, key=lambda item: item[1].seq or 0):
        part = row.part or 1
        if not last <= part <= last + 1:
            fault = f"Part {part} does not follow part {last}."
            remedy = "Number the parts 1, 2 and so on, in the order in which they were measured."
            rows.note(index, "part", fault, remedy)
        last = max(last, part)


# --- touches of a bed by a probe ----------------------------------------------------------------

# A place farther out than so many radii of the bed is not on it.
BEYOND = 1.2


def _touches(table: Table, bed: Bed) -> Readings:
    away, high = 2.0 * bed.radius_mm, bed.highest_mm
    longest = {"x_mm": away, "y_mm": away, "reading_mm": high, "z_mm": high}
    checking = Rows(table, ProbeRow, longest=longest)
    checking.check_complete(("seq", "minutes"))
    _check_order(checking)
    for index, row in checking.sound:
        apart = math.hypot(row.x_mm, row.y_mm)
        if apart > BEYOND * bed.radius_mm:
            fault = f"The place is {apart:.0f} mm from the middle of the bed."
            remedy = f"Check it, or bed_radius_mm ({bed.radius_mm:g}) in the machine file."
            checking.note(index, "x_mm", fault, remedy)
    rows, remarks = checking.checked(), [*checking.remarks]
    in_time, minutes, timed = _times_of(rows)
    if not timed and rows[0].minutes is not None:
        remarks.append(Reason.of("equal_minutes"))
    place = np.array([(row.x_mm, row.y_mm, row.reading_mm) for row in rows])
    surface = np.array([row.z_mm or 0.0 for row in rows])
    return Readings(
        touching(place, surface, np.argsort(in_time), minutes if timed else None),
        place[:, 2] - surface,
        np.array(checking.lines),
        timed,
        checking.source,
        cycle=np.array([row.cycle or 1 for row in rows]),
        note=tuple(row.note or "" for row in rows),
        remarks=tuple(remarks),
    )


def probe_points_csv(readings: Readings) -> str:
    """Touches as a CSV that can be read again."""
    plan, mark = readings.plan, ("simulated",) * readings.source.simulated
    surface = [plan.entry(index)["surface_mm"] for index in range(len(plan))]
    columns = (plan.order + 1, 60.0 * plan.hours, *plan.spots.T[:2], surface, readings.value)
    rows = (
        (f"{seq:g}", f"{minutes:.2f}", f"{x:g}", f"{y:g}", f"{z:g}", f"{value + z:.6f}")
        for seq, minutes, x, y, z, value in np.column_stack(columns).tolist()
    )
    head = ("seq", "minutes", "x_mm", "y_mm", "z_mm", "reading_mm", *mark)
    return csv_text(head, ((*row, *(YES for _ in mark)) for row in rows))


# --- differences of readings, as the paper prints them --------------------------------------------


def _differences(table: Table, machine: Machine) -> Differences:
    longest = {"value_mm": machine.leg_mm}
    rows = Rows(table, DifferenceRow, longest=longest, travel=machine.limits_mm)
    names = {index: row.difference for index, row in rows.sound}
    # Most names decide: the single set shares four with the twelve, which come first.
    order = (DataKind.TWELVE, DataKind.SIX, DataKind.SINGLE)
    kind = max(order, key=lambda kind: sum(name in _BY_NAME[kind] for name in names.values()))
    known, first = _BY_NAME[kind], dict[str, int]()
    for index, name in names.items():
        if name not in known:
            others = f"{kind} ({KIND_WORDS[kind]})"
            fault = f"The name is of another kind than the others, which are {others}."
            rows.note(index, "difference", fault, f"Give one kind in one file. {DIFFERENCE_NAMES}")
        elif name in first:
            fault = f"The difference is already in line {first[name]}."
            remedy = "Give each difference once; average repeats, or give the raw readings."
            rows.note(index, "difference", fault, remedy)
        first.setdefault(name, rows.lines[index])
    values, remarks = {row.difference: row.value_mm for row in rows.checked()}, [*rows.remarks]
    if missing := [name for name in known if name not in values]:
        remarks.append(Reason.of("missing_differences", kind=kind, names=missing))
    which, value = tuple(known[name] for name in values), np.array(list(values.values()))
    return Differences(kind, which, value, rows.source, remarks=tuple(remarks))


def measured_in(document: FileText, machine: Machine) -> Readings | Differences:
    """Readings, touches or differences, by the header of a CSV; InputError with all its faults."""
    table = Table(document)
    columns = set(table.columns)
    probed = columns & {"x_mm", "y_mm"} and not columns & {"leg", "difference"}
    try:
        if probed:
            return _touches(table, machine.bed)
        read = _differences if "difference" in columns else readings_in
        return read(table, machine)
    except UsageError as error:
        fault = f"These are {'touches of a bed' if probed else 'readings of gauges'}. {error.what}"
        line = table.header_line
        raise InputError(fault, error.remedy, file=document.path, line=line) from error


# --- sessions -----------------------------------------------------------------------------------

# Note of a reading that was questioned and kept, with its step.
QUESTIONED = "kept although questioned (r {}): {}"
_QUESTIONED = re.compile(r"kept although questioned \(r ([0-9]+)\): ([^;:]+)")


def implausible_temperatures(known_c: Iterable[float | None]) -> list[Reason]:
    """A remark on the first temperature that no workshop has [°C]; none if all are plausible."""
    beyond = (c for c in known_c if c is not None and not -40.0 <= c <= 60.0)
    return [Reason.of("implausible_temperature", celsius=celsius) for celsius in beyond][:1]


class GaugeIdentity(OwnGauge):
    """A gauge as a session has it; None where not given."""

    model_config = ConfigDict(extra="ignore", populate_by_name=True)

    certificate: str | None = None
    resolution_mm: Positive | None = Field(None, alias="resolution")


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
    """Circumstances as recorded; labels in the readings are gauges, too."""

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
                with suppress(InputError, KeyError):
                    return parse_number(self.environment[name])
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


def conditions_in(
    readings: Readings | Differences, frame: Circumstances = Circumstances(), **counts: int
) -> Conditions:
    """Conditions that the readings state, in a frame, with `counts` of what does not count."""
    if not isinstance(readings, Readings):
        return Conditions()
    known = [t for t in readings.temperature[readings.plan.in_time].tolist() if t == t]
    stated = {"", *(gauge.id for gauge in frame.gauges)}
    labels = (label for label in dict.fromkeys(readings.gauge) if label not in stated)
    notes = zip(readings.line.tolist(), readings.note, strict=True)
    return Conditions(
        **dict(frame)
        | {
            "environment": {name: text for name, text in frame.environment.items() if text},
            "temperature_c": tuple(known),
            "gauges": (*frame.gauges, *(GaugeIdentity(id=label) for label in labels)),
            "notes": tuple((line, note) for line, note in notes if note),
        }
        | counts
    )


_Written = Annotated[
    tuple[ReadingRow, ...], PlainSerializer(lambda rows: [row.cells() for row in rows])
]


class Session(Circumstances):
    """A session as its file holds it."""

    machine: Annotated[InstanceOf[Model], PlainSerializer(machine_file.machine_values)]
    readings: _Written = ()  # that count
    retaken: _Written = ()  # that were replaced
    skipped: _Written = ()  # steps that were left out


def session_from_tree(
    tree: Content, model: Model | None
) -> tuple[Readings, Model, Conditions, Model | None]:
    """The readings of a parsed session, the machine to judge them by, the conditions, its own.

    Without a model its own judges; which offsets were active in the controller the session says.
    Raises InputError: everything that is wrong with it, or it is no session.
    """
    if not isinstance(tree.value, dict) or "readings" not in tree.value:
        if machine_file.is_machine_file(tree):
            fault = "This is a machine file; it holds no readings."
            remedy = "Give it with --machine, and a file of readings as the input."
            raise InputError(fault, remedy, file=tree.file)
        fault = "This is neither a table of readings or differences nor a session."
        header = "leg, posture, direction, reading_mm or difference, value_mm"
        remedy = f"A CSV has a header with {header}; a session has `readings:`."
        raise InputError(fault, remedy, file=tree.file, line=1)
    try:
        if model:
            model.machine.check_guided()
    except UsageError as error:
        fault = f"The session was read with gauges. {error.what}"
        raise InputError(fault, "Leave --machine out.", file=tree.file) from error
    recorded = machine_file.machine_in(tree, ("machine",))
    replaced = Rows(tree, ReadingRow, ("retaken",))
    _check_read(replaced)
    skipped = Rows(tree, ReadingRow, ("skipped",))
    stated = ((key, tree.value.get(key)) for key in Circumstances.model_fields)
    frame = Circumstances()
    try:
        frame = Circumstances.model_validate({key: value for key, value in stated if value})
    except ValidationError as error:
        tree.take(error, Circumstances)
    judge = model or recorded
    if judge is None:
        raise tree.error()
    held, asked = (recorded or judge).machine, judge.machine
    if (held.active, held.corrected) != (asked.active, asked.corrected):
        judge = judge.holding(held.active, held.corrected)
    keys = Session.model_fields
    remarks = unused("Keys", (key for key in tree.value if key not in keys), keys)
    if recorded and (names := machine_file.differing(recorded, judge)):
        machines = {"recorded": recorded.machine.name, "given": judge.machine.name}
        remarks.insert(0, Reason.of("other_machine", **machines, keys=names))
    # Faults around the readings are raised with theirs.
    readings = readings_in(tree, judge.machine, ("readings",), frame.started, remarks)
    origins = (frame.environment.get(name) or "" for name in ("readings_from", "source"))
    if any(origin.startswith("simulated") for origin in origins):
        readings = replace(readings, source=replace(readings.source, simulated=True))
    counts = {"retaken": len(replaced.cells), "skipped": len(skipped.cells)}
    return readings, judge, conditions_in(readings, frame, **counts), recorded


def session_json(session: Session) -> dict[str, object]:
    """A whole session as a JSON object; saved as a .json file it reads back as a session."""
    content = session.model_dump(by_alias=True)
    for gauge in content["gauges"]:
        for name in ("due", "expanded_mm"):
            if not gauge[name]:
                del gauge[name]
    return {**dict.fromkeys(("schema_version", "machine")), **content}


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
