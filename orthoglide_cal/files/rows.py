"""Tables: CSV text to records of named cells, and the rows of each kind of table or session.

The delimiter is the one that the header line uses (tab, then semicolon, then comma): guessing
from the content goes wrong on `1,234;5,678`. A row comes as the texts of its cells, whatever file
it stands in; the same class writes it. Every cell is checked by itself here; what only shows
across rows, where the rows become arrays.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, ClassVar, Generic, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_serializer,
    field_validator,
)

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import WORDS, Content, Place, Steps, unused
from orthoglide_cal.files.text import FileText, number_text
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Source
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.schema import (
    Count,
    Moment,
    Schema,
    parse_number,
    whole_number,
    yaml_number,
)
from orthoglide_cal.words import MM, MM_PER_INCH, listed, short

LATEST_MINUTES = 1e6  # two years
TURNED = "turned"
YES = "yes"
_POSTURES = {posture.value for posture in Posture}
_MISSING = "The value is missing."
_AXIS = "Write x, y or z."
_READING = "Give the reading, or remove the row."
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
        what = f"The length is larger than this machine allows: {longest:g} mm."
        raise InputError(what, "Check the unit and the decimal mark; lengths are in mm.")
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


def _entered(value: object, info: ValidationInfo) -> object:
    remedy = "Write mm with blanks between them, such as 0.5 0 0."
    if not isinstance(value, str):
        if info.context is not None:
            raise InputError("This must be one value.", remedy)
        return value
    offsets = tuple(_length(text, info) for text in value.split())
    if len(offsets) != len(AXES):
        what = f"Three numbers are needed, for x, y and z, not {len(offsets)}."
        raise InputError(what, remedy)
    return offsets


Cell = Annotated[float, BeforeValidator(_number)]
Length = Annotated[float, BeforeValidator(_length)]
Order = Annotated[int, whole_number(0)]
# Field → what may stand there, in letters of any size; the fault of anything else, the remedy.
_CHOICES: Mapping[str | None, tuple[Sequence[str], str, str]] = {
    "leg": (AXES, "This is not an axis.", _AXIS),
    "direction": (AXES, "This is not an axis.", _AXIS),
    "end": (("joint", "tool"), "This is not an end of the leg.", "Write joint or tool."),
    "bar": (
        (TURNED,),
        "This does not say how the bar was.",
        f"Write {TURNED} where it was turned half round; otherwise leave the cell empty.",
    ),
    "simulated": (
        (YES,),
        "This does not say whether it was simulated.",
        f"Write {YES} where a simulator made the row; otherwise leave the cell empty.",
    ),
}


def _choice(text: str, info: ValidationInfo) -> str:
    known, what, remedy = _CHOICES[info.field_name]
    if text.lower() not in known:
        raise InputError(what, remedy)
    return text.lower()


Choice = Annotated[str, AfterValidator(_choice)]
Minutes = Annotated[Cell, Field(ge=0.0, le=LATEST_MINUTES)]


class Row(Schema):
    """Base of all rows; what else stands in a record is kept by its file, and reported."""

    model_config = ConfigDict(extra="ignore")
    noun: ClassVar[str] = "reading"  # what a row is
    # Column that is needed → what to write where it is empty; the last one holds what was read.
    needed: ClassVar[Mapping[str, str]] = {}
    inches: ClassVar[str] = ""  # column that may stand instead of the last one
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

    leg: Choice  # whose carriage is displaced
    # iso, max, min of that leg, or its displacement from the isotropic posture [mm].
    posture: Annotated[str, AfterValidator(_posture)]
    direction: Choice  # along which the gauge measures
    end: Choice | None = None  # of the leg, that is touched in the single-posture protocol
    cycle: Count | None = None  # repeat, from 1
    # None for a step that was left out.
    reading_mm: Length | None = Field(
        default=None,
        validate_default=True,
        validation_alias=AliasChoices("reading_mm", "reading_in"),
    )
    seq: Order | None = None  # order in time
    minutes: Minutes | None = None  # since the session began
    temperature_c: Annotated[Cell, Field(ge=-100.0, le=200.0)] | None = None
    gauge: str | None = None  # its label
    # Where it stood along the leg, from the carriage joint (0) to the tool (1).
    gauge_at: Annotated[Cell, Field(ge=0.0, le=1.0)] | None = None
    part: Count | None = None  # of the measurement, from 1
    bar: Choice | None = None  # "turned" where the touched bar was turned half round
    # In the controller since the first reading, x, y, z [mm].
    entered: Annotated[tuple[float, float, float], BeforeValidator(_entered)] | None = None
    note: str | None = None
    simulated: Choice | None = None  # "yes" where no machine was measured
    timestamp: Moment | None = None
    reason: str | None = None  # why it was replaced or left out

    inches = "reading_in"
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

    @field_validator("reading_mm")
    @classmethod
    def _given(cls, reading: float | None, info: ValidationInfo) -> float | None:
        if reading is None and info.context is not None and info.context.wanted:
            raise InputError("The reading is missing.", _READING)
        return reading

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
    simulated: Choice | None = None

    needed: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("x_mm", "y_mm", "reading_mm"), "Give it, or remove the row."
    )


KIND_WORDS = {
    DataKind.SIX: "max − min",
    DataKind.TWELVE: "relative to the isotropic posture",
    DataKind.SINGLE: "tool end − joint end",
}
_NAMED = {difference.name for known in DIFFERENCES.values() for difference in known}
DIFFERENCE_NAMES = "Direction first, leg second. Known: {}.".format(
    "; ".join(
        f"{kind} ({KIND_WORDS[kind]}): {', '.join(difference.name for difference in known)}"
        for kind, known in DIFFERENCES.items()
    )
)


def _difference_name(text: str) -> str:
    """The canonical name; the leading d may be missing, or a delta."""
    name = "d" + re.sub("^[dδ∆]", "", text.lower().replace("\u2212", "-").replace(" ", ""))
    if name not in _NAMED:
        raise InputError("This is not the name of a difference.", DIFFERENCE_NAMES)
    return name


class DifferenceRow(Row):
    """A difference as the paper prints it."""

    difference: Annotated[str, AfterValidator(_difference_name)]
    value_mm: Length = Field(validation_alias=AliasChoices("value_mm", "value_in"))
    simulated: Choice | None = None

    noun = "difference"
    inches = "value_in"
    needed: ClassVar[Mapping[str, str]] = {
        "difference": DIFFERENCE_NAMES,
        "value_mm": "Give the value or remove the row.",
    }


# Columns that never hold free text.
CODED = {
    column
    for schema in (ReadingRow, ProbeRow, DifferenceRow)
    for column in schema.columns()
    if column not in ("gauge", "note")
}
_COLUMNS = 100
_ROWS = 100_000  # read in a few seconds
_BLANKS = " \t\u00a0\u202f\ufeff"  # also those that spreadsheets and web pages leave
_BLANK_CELL = _BLANKS + "\n\r\v\f"


class Table(Content):
    """A CSV file; its value is the list of its rows that are not blank.

    Each is column → text without blanks around it, of cells that are not empty. Blank lines are
    skipped, and so are lines that start with # and Excel's `sep=;` line. If the first column may
    hold free text, a # after the header belongs to its text: skipping the line would lose a
    reading.
    """

    of_table = True

    def __init__(self, document: FileText) -> None:
        super().__init__(document)
        self.columns: list[str] = []  # names in lower case, in order; "" where there is none
        self.header_line = 1
        self.rows: list[dict[str, str]] = []
        self.value = self.rows
        lines = document.text.split("\n")
        at, delimiter = 0, ","
        # From the first line that says anything on; one of Excel says what separates the cells.
        for at, text in enumerate(lines):
            plain = text.strip(_BLANKS)
            if plain.lower().startswith("sep=") and len(plain) <= 5:
                at, delimiter = at + 1, text.strip(" ")[4:5] or "\t"
                break
            if plain and not plain.startswith("#"):
                delimiter = next((mark for mark in "\t;," if mark in text), ",")
                break
        self.decimal_comma = delimiter != ","  # the delimiter leaves the comma free
        comments = True
        while at < len(lines):
            shown, line = lines[at].strip(), at + 1
            plain = lines[at].lstrip(_BLANKS)
            if not plain.strip() or (comments and plain.startswith("#")):
                at += 1
                continue
            rest = (f"{lines[index]}\n" for index in range(at, len(lines)))
            reader = csv.reader(rest, delimiter=delimiter, strict=True, skipinitialspace=True)
            try:
                cells = [cell.strip(_BLANK_CELL) for cell in next(reader)]
            except csv.Error as error:
                what = f"The row cannot be split into cells: {error}."
                if "end of data" in str(error):
                    what = "A quotation mark is opened and never closed."
                remedy = 'Close it, or write "" for a quotation mark inside quotes.'
                self.add(what, remedy, line=line, value=shown)
                break
            at += reader.line_num  # quotes may span lines
            if not self.columns:
                self._head(cells, line)
                comments = self.columns[0] in CODED
            elif len(self.rows) >= _ROWS:
                self.add(f"There are more than {_ROWS} rows.", "Give a smaller file.", line=line)
                break
            elif any(cells[len(self.columns) :]):
                what = f"The row has {len(cells)} cells, the header {len(self.columns)}."
                remedy = f"Put a cell that holds {delimiter!r} in quotes."
                if delimiter == ",":
                    remedy = "For decimal commas separate the columns with semicolons"
                    remedy += ", in the header too."
                self.add(what, remedy, line=line, value=shown)
            elif any(cells):
                self.lines[len(self.rows),] = line
                pairs = zip(self.columns, cells, strict=False)
                self.rows.append({name: cell for name, cell in pairs if cell})

    def _head(self, cells: Sequence[str], line: int) -> None:
        """Take the columns' names; too many and repeated ones are faults."""
        self.columns = [name.lower() for name in cells[:_COLUMNS]]
        self.header_line = line
        if len(cells) > _COLUMNS:
            what = f"The header has more than {_COLUMNS} columns."
            self.add(what, "Check the delimiter.", line=line)
        for index, name in enumerate(self.columns):
            if name and name in self.columns[:index]:
                what = "The header names this column twice."
                self.add(what, "Rename or remove one.", line=line, column=name)

    def parse(self, text: str) -> float:
        return parse_number(text, decimal_comma=self.decimal_comma)

    def place(self, path: Steps) -> Place:
        """Where a row stands, or a cell of it."""
        cells = self.rows[int(path[0])]
        column = str(path[1]) if len(path) > 1 else ""
        return self.lines[path[:1]], column or None, cells.get(column)

    def check_header(self, schema: type[Row]) -> None:
        """Raise what is found so far if the header lacks one of the columns that rows of a schema
        need, or gives lengths twice."""
        before, present = len(self.problems), [name for name in self.columns if name]
        inches, last = schema.inches, [*schema.needed][-1]
        others = [name for name in present if name not in schema.columns()]
        for name in schema.needed:
            if name in present or (name == last and inches in present):
                continue
            close = get_close_matches(name, others, n=1)
            remedy = f"Add it; the header has: {listed(present)}."
            if close:
                unit = MM.get(close[0].rpartition("_")[2])
                factor = f"multiply the numbers by {short(unit, 6)} and " if unit else ""
                remedy = f"{factor}rename the column {close[0]!r}.".capitalize()
            self.add("The column is missing.", remedy, line=self.header_line, column=name)
        if {last, inches} <= set(present):
            what = "Lengths are given both in mm and in inches."
            remedy = f"Keep one of the columns {last} and {inches}."
            self.add(what, remedy, line=self.header_line, column=inches)
        if len(self.problems) > before:
            raise self.error()
        self._check_split_numbers()

    def _check_split_numbers(self) -> None:
        """Refuse `0,123` that a comma-separated row has split into the reading 0 and a text 123.

        A column next to the readings that never holds free text has not got the 123.
        """
        pairs = (pair for pair in pairwise(self.columns) if pair[0] in ("reading_mm", "reading_in"))
        value, beside = next(pairs, ("", ""))
        if self.decimal_comma or not (self.rows and value) or beside in CODED:
            return
        cells, fractions = ([row.get(name, "") for row in self.rows] for name in (value, beside))
        whole = all(re.fullmatch("[-+\u2212]?[0-9]+", cell) for cell in cells)
        if whole and all(map(str.isdigit, fractions)) and max(map(len, fractions)) > 1:
            what = f"Every reading is a whole number with digits in the next column, {beside!r}:"
            what += " decimal commas?"
            remedy = "Write decimal points, or separate the columns with semicolons."
            self.add(what, remedy, self.lines[0,], value, f"{cells[0]},{fractions[0]}")


R = TypeVar("R", bound=Row)
Timed = TypeVar("Timed", ReadingRow, ProbeRow)


class Rows(Generic[R]):
    """A list in a file as rows; of one with a fault, which is noted, None stands in its place.

    Args:
        content: of the file.
        path: of the list.
        longest: column → the longest length that it may have [mm].
        travel: of a carriage, lowest and highest [mm].
        wanted: whether each row must have its reading, which a skipped one has not.
    """

    def __init__(
        self,
        content: Content,
        schema: type[R],
        path: Steps = (),
        *,
        longest: Mapping[str, float] = MappingProxyType({}),
        travel: tuple[float, float] = (-math.inf, math.inf),
        wanted: bool = True,
    ) -> None:
        self.content, self.path, self.noun = content, path, schema.noun
        self.longest, self.travel, self.wanted = longest, travel, wanted
        self.in_inches = ""  # the column that the row being read gives in inches
        self.cells: list[dict[str, str]] = []  # column → text, of cells that are not empty
        self.rows: list[R | None] = []
        known = schema.columns(content.of_table)
        words = {f"missing {name}": (_MISSING, remedy) for name, remedy in schema.needed.items()}
        if isinstance(content, Table):
            content.check_header(schema)
        entries = content.at(path)
        if entries is not None and not isinstance(entries, list):
            content.note(path, *WORDS["list_type"])
        for index, entry in enumerate(entries if isinstance(entries, list) else ()):
            texts = entry.items() if isinstance(entry, dict) else ()
            plain = {name: text.strip() if isinstance(text, str) else text for name, text in texts}
            cells = {name: text for name, text in plain.items() if text not in (None, "")}
            self.cells.append(cells)
            self.rows.append(None)
            inches = schema.inches and schema.inches in cells  # a column may have no name
            self.in_inches = [*schema.needed][-1] if inches else ""
            given = {name: text for name, text in cells.items() if name in known}
            try:
                self.rows[index] = schema.model_validate(
                    given if isinstance(entry, dict) else entry, context=self
                )
            except ValidationError as error:
                content.take(error, schema, (*path, index), words)
            if self.in_inches and self.in_inches in cells:
                self.note(index, schema.inches, "The row has two readings.", _READING)
            for name, text in cells.items():
                if name not in known and not isinstance(text, str):
                    self.note(index, name, *WORDS["string_type"])
        # On the columns without a meaning, if there are any; a table's may be empty.
        columns = dict.fromkeys(name for cells in self.cells for name in cells)
        names = content.columns if isinstance(content, Table) else columns
        self.remarks = unused("Columns", (name for name in names if name not in known), known)

    def line(self, index: int) -> int:
        """The line at which a row begins."""
        return self.content.lines[*self.path, index]

    @property
    def source(self) -> Source:
        """Where they come from: the file, simulated if any of them is."""
        simulated = any("simulated" in cells for cells in self.cells)
        return replace(self.content.document.source, simulated=simulated)

    def note(self, index: int, column: str, what: str, remedy: str) -> None:
        """Note a fault in row `index`."""
        self.content.note((*self.path, index, column), what, remedy)
        self.rows[index] = None

    @property
    def sound(self) -> list[tuple[int, R]]:
        """Those without a fault so far, with their places in the file."""
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
            filled = [column in cells for cells in self.cells]
            for index, cells in enumerate(self.cells if any(filled) else ()):
                if cells and not filled[index]:
                    what = "The cell is empty here but filled in other rows."
                    self.note(index, column, what, "Fill it in every row or in none.")


def times_of(rows: Sequence[Timed]) -> tuple[Ints, Floats, bool]:
    """Indices from first to last; minutes; and whether they are times: no one time for all."""
    in_time = np.argsort([-1 if row.seq is None else row.seq for row in rows], kind="stable")
    minutes = np.array([row.minutes or 0.0 for row in rows])
    timed = rows[0].minutes is not None and (len(rows) == 1 or len(np.unique(minutes)) > 1)
    return in_time, minutes, timed


def check_order(rows: Rows[Timed]) -> None:
    """Each `seq` stands once, and time never runs backwards along it."""
    first: dict[int, int] = {}
    for index, row in rows.sound:
        if row.seq is not None and first.setdefault(row.seq, index) != index:
            what = f"The same number is in line {rows.line(first[row.seq])}."
            remedy = "Number the readings in the order in which they were taken."
            rows.note(index, "seq", what, remedy)
    in_time = sorted(rows.sound, key=lambda item: -1 if item[1].seq is None else item[1].seq)
    for (before, one), (after, other) in pairwise(in_time):
        if one.minutes is not None and other.minutes is not None and other.minutes < one.minutes:
            what = f"Time runs backwards: line {rows.line(before)} was taken before this one."
            remedy = "Give minutes since the session began; correct seq or the order of the rows."
            column = "minutes" if "minutes" in rows.cells[after] else "timestamp"
            rows.note(after, column, what, remedy)
