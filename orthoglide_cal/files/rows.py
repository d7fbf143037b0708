"""One row of each kind of table, whatever file it stands in, and how its texts are checked.

A row comes as the texts of its cells; the same class writes it. Every cell is checked by itself
here; what only shows across rows, where the rows become arrays.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, ClassVar, Generic, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_serializer,
    field_validator,
)

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import FaultPlace, Faults, Steps
from orthoglide_cal.files.text import number_text
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.schema import Count, Moment, Schema, text_that, whole_number, yaml_number
from orthoglide_cal.words import MM_PER_INCH

LATEST_MINUTES = 1e6  # two years
TURNED = "turned"
_POSTURES = {posture.value for posture in Posture}
_AXIS = "Write x, y or z."
_POSTURE = "Write iso, max, min or a displacement in mm."


@dataclass(frozen=True)
class Record:
    """One record of a file, as text."""

    line: int  # its first, from 1
    cells: Mapping[str, str]  # column → text without blanks around it, of cells that are not empty
    lines: Mapping[str, int] = field(default_factory=dict)  # of columns whose cell has its own
    prefix: str = ""  # of a column's name in messages, e.g. "readings[3]."

    def place(self, path: Steps) -> FaultPlace:
        """Where the cell of a column stands, which `path` begins with."""
        column = str(path[0])
        inches = f"{column.removesuffix('_mm')}_in"
        if column not in self.cells and inches in self.cells:
            column = inches
        line = self.lines.get(column, self.line)
        return FaultPlace(line, self.prefix + column, self.cells.get(column))


@dataclass(frozen=True)
class Reading:
    """How the cells of one file are read."""

    number: Callable[[str], float] = yaml_number  # the one that a text writes; raises InputError
    # Column → the longest length [mm], what it is, and than what it must not be larger.
    longest: Mapping[str, tuple[float, str, str]] = field(default_factory=dict)
    travel: tuple[float, float] = (-math.inf, math.inf)  # of a carriage, lowest and highest [mm]
    wanted: bool = True  # whether each row must have its reading, which a skipped one has not


class _Inches(str):
    """The text of a number in inches, in the place of one in mm."""


def _number(value: object, info: ValidationInfo) -> float:
    if info.context is None or not isinstance(value, str):
        return yaml_number(value)
    return float(info.context.number(value))


def _length(value: object, info: ValidationInfo) -> float:
    size = _number(value, info) * (MM_PER_INCH if isinstance(value, _Inches) else 1.0)
    if info.context is not None and info.field_name in info.context.longest:
        longest, noun, than = info.context.longest[info.field_name]
        if abs(size) > longest:
            remedy = f"Check the unit and the decimal mark; {noun}s are in mm."
            raise InputError(f"The {noun} is larger than {than}.", remedy)
    return size


def _posture(text: str, info: ValidationInfo) -> str:
    """iso, max, min, or the displacement as the shortest text."""
    if text.lower() in _POSTURES:
        return text.lower()
    if info.context is None:
        return text
    low, high = info.context.travel
    remedy = _POSTURE
    if low > -math.inf:
        remedy = f"Write iso, max, min or a displacement from {low:g} to {high:g} mm."
    try:
        displacement: float = info.context.number(text)
    except InputError:
        raise InputError("This is not a posture.", remedy) from None
    if not low <= displacement <= high:
        raise InputError("The posture is outside the joint limits.", remedy)
    return number_text(displacement)


def _entered(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        return value
    offsets = tuple(_length(each, info) for each in value.split())
    if len(offsets) != len(AXES):
        what = f"Three numbers are needed, for x, y and z, not {len(offsets)}."
        raise InputError(what, "Write mm with blanks between them, such as 0.5 0 0.")
    return offsets


Cell = Annotated[float, BeforeValidator(_number)]
Length = Annotated[float, BeforeValidator(_length)]
Order = Annotated[int, whole_number(0)]
Name = Annotated[str, AfterValidator(str.lower)]  # in letters of any size
Axis = Annotated[Name, text_that(AXES.__contains__, "This is not an axis.", _AXIS)]
End = Annotated[
    Name,
    text_that(
        ("joint", "tool").__contains__, "This is not an end of the leg.", "Write joint or tool."
    ),
]
Bar = Annotated[
    Name,
    text_that(
        TURNED.__eq__,
        "This does not say how the bar was.",
        f"Write {TURNED} where it was turned half round; otherwise leave the cell empty.",
    ),
]
Minutes = Annotated[Cell, Field(ge=0.0, le=LATEST_MINUTES)]


class Row(Schema):
    """Base of all rows; what else stands in a record is kept by its file, and reported."""

    model_config = ConfigDict(extra="ignore")
    noun: ClassVar[str] = "reading"  # what a row is
    inches: ClassVar[str] = ""  # column that may give the reading in inches
    empty: ClassVar[Mapping[str, str]] = {}  # column that is needed → what to write where it is not

    def cells(self) -> dict[str, object]:
        """Column → what a file holds, in the order of files; blank ones are left out."""
        return {key: value for key, value in self.model_dump().items() if value not in (None, "")}


class ReadingRow(Row):
    """A gauge reading; None where nothing is said."""

    leg: Axis  # whose carriage is displaced
    # iso, max, min of that leg, or its displacement from the isotropic posture [mm].
    posture: Annotated[str, AfterValidator(_posture)]
    direction: Axis  # along which the gauge measures
    end: End | None = None  # of the leg, that is touched in the single-posture protocol
    cycle: Count | None = None  # repeat, from 1
    # None for a step that was left out.
    reading_mm: Length | None = Field(default=None, validate_default=True)
    seq: Order | None = None  # order in time
    minutes: Minutes | None = None  # since the session began
    temperature_c: Annotated[Cell, Field(ge=-100.0, le=200.0)] | None = None
    gauge: str | None = None  # its label
    # Where it stood along the leg, from the carriage joint (0) to the tool (1).
    gauge_at: Annotated[Cell, Field(ge=0.0, le=1.0)] | None = None
    part: Count | None = None  # of the measurement, from 1
    bar: Bar | None = None  # "turned" where the touched bar was turned half round
    # In the controller since the first reading, x, y, z [mm].
    entered: Annotated[tuple[float, float, float], BeforeValidator(_entered)] | None = None
    note: str | None = None
    timestamp: Moment | None = None
    reason: str | None = None  # why it was replaced or left out

    inches = "reading_in"
    empty: ClassVar[Mapping[str, str]] = {"leg": _AXIS, "direction": _AXIS, "posture": _POSTURE}

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
            raise InputError("The reading is missing.", "Give the reading, or remove the row.")
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

    empty: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("x_mm", "y_mm", "reading_mm"), "Give it, or remove the row."
    )


R = TypeVar("R", bound=Row)
Timed = TypeVar("Timed", ReadingRow, ProbeRow)


class Rows(Generic[R]):
    """Records of a file as rows; of one with a fault, which is noted, None stands in its place."""

    def __init__(
        self, records: Sequence[Record], schema: type[R], reading: Reading, faults: Faults
    ) -> None:
        self.records = records
        self.faults = faults
        self._noun = schema.noun
        missing = "The value is missing."
        words = {f"missing {name}": (missing, remedy) for name, remedy in schema.empty.items()}
        mm = schema.inches.replace("_in", "_mm")
        self.rows: list[R | None] = []
        for index, record in enumerate(records):
            cells = record.cells
            if schema.inches in cells and mm not in cells:
                cells = {**cells, mm: _Inches(cells[schema.inches])}
            try:
                self.rows.append(schema.model_validate(cells, context=reading))
            except ValidationError as error:
                faults.take(error, schema, record.place, words)
                self.rows.append(None)
            if schema.inches in record.cells and mm in record.cells:
                remedy = "Give the reading, or remove the row."
                self.note(index, schema.inches, "The row has two readings.", remedy)

    def note(self, index: int, column: str, what: str, remedy: str) -> None:
        """Note a fault in row `index`."""
        self.faults.add(what, remedy, *self.records[index].place((column,)))
        self.rows[index] = None

    @property
    def sound(self) -> list[tuple[int, R]]:
        """Those without a fault so far, with their places in the file."""
        return [(index, row) for index, row in enumerate(self.rows) if row is not None]

    def checked(self) -> list[R]:
        """All rows, at least one. Raises InvalidFileError if anything is wrong."""
        if not self.records and not self.faults:
            remedy = "Give one row for each, under the header."
            self.faults.add(f"There is no {self._noun}.", remedy)
        self.faults.check()
        return [row for row in self.rows if row is not None]

    def check_complete(self, columns: Sequence[str]) -> None:
        """Each of these columns is filled in every row or in none."""
        for column in columns:
            empty = [index for index, row in enumerate(self.records) if column not in row.cells]
            for index in empty if len(empty) < len(self.records) else ():
                what = "The cell is empty here but filled in other rows."
                self.note(index, column, what, "Fill it in every row or in none.")


def check_order(rows: Rows[Timed], minutes: Sequence[float] | None = None) -> None:
    """Each `seq` stands once, and time never runs backwards along it.

    The minutes of each row are from its `timestamp`; None where rows have `minutes`.
    """
    lines = [record.line for record in rows.records]
    first: dict[int, int] = {}
    for index, row in rows.sound:
        if row.seq is not None and first.setdefault(row.seq, index) != index:
            what = f"The same number is in line {lines[first[row.seq]]}."
            remedy = "Number the readings in the order in which they were taken."
            rows.note(index, "seq", what, remedy)
    in_time = sorted(rows.sound, key=lambda each: -1 if each[1].seq is None else each[1].seq)
    for (before, one), (after, other) in pairwise(in_time):
        earlier, later = one.minutes, other.minutes
        if minutes is not None:
            earlier, later = minutes[before], minutes[after]
        if earlier is not None and later is not None and later < earlier:
            what = f"Time runs backwards: line {lines[before]} was taken before this one."
            remedy = "Give minutes since the session began; correct seq or the order of the rows."
            rows.note(after, "minutes" if minutes is None else "timestamp", what, remedy)
