"""One row of readings: text to values, each cell checked by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from orthoglide_cal.axes import AXES, axis_index
from orthoglide_cal.data.faults import Faults
from orthoglide_cal.data.numbers import MM_PER_INCH, number_text, parse_count, parse_number
from orthoglide_cal.data.table import Row
from orthoglide_cal.errors import InputError
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact

VALUE_COLUMNS = ("reading_mm", "reading_in")
NEEDED_COLUMNS = ("leg", "posture", "direction")
TEXT_COLUMNS = ("gauge", "note")
OPTIONAL_COLUMNS = (
    "seq", "cycle", "minutes", "temperature_c", "gauge", "gauge_at", "end", "note",
)  # fmt: skip
READING_COLUMNS = (*NEEDED_COLUMNS, *VALUE_COLUMNS, *OPTIONAL_COLUMNS)

_ENDS = {"joint": Contact.JOINT, "tool": Contact.TOOL}
_LATEST = 1e6  # minutes; two years
_COLDEST, _HOTTEST = -100.0, 200.0  # °C


@dataclass(frozen=True)
class ReadingRow:
    """One gauge reading; None where the file does not say.

    Attributes:
        row: the cells that it came from.
        leg, direction: 0, 1, 2.
        posture: "iso", "max", "min" or the displacement as text.
        displacement: from the isotropic posture [mm].
        value: [mm].
        contact: what the gauge touches.
        gauge_at: fraction of the leg from the carriage joint.
        gauge: label; "" if none.
        seq, cycle, minutes: as given.
        temperature: [°C]; NaN if none.
        note: "" if none.
    """

    row: Row
    leg: int
    direction: int
    posture: str
    displacement: float
    value: float
    contact: Contact
    gauge_at: float
    gauge: str
    seq: int | None
    cycle: int | None
    minutes: float | None
    temperature: float
    note: str


class RowParser:
    """Turns rows into readings and notes every fault.

    Args:
        machine: for the joint limits.
        faults: where faults go.
        decimal_comma: accept decimal commas.
    """

    def __init__(self, machine: Machine, faults: Faults, *, decimal_comma: bool) -> None:
        self.machine = machine
        self.faults = faults
        self.decimal_comma = decimal_comma
        self.marks: set[str] = set()  # decimal marks seen

    def parse(self, row: Row) -> ReadingRow | None:
        """The reading in a row; None after noting what is wrong with it."""
        before = len(self.faults.problems)
        leg, direction = self._axis(row, "leg"), self._axis(row, "direction")
        if leg is not None and leg == direction:
            other = " or ".join(axis for axis in AXES if axis != AXES[leg])
            self._note(
                row, "direction", "A gauge along the leg's own axis says nothing of the leg.",
                f"Give the direction across the leg: {other}.",
            )  # fmt: skip
        posture, displacement = self._posture(row)
        value = self._value(row)
        contact = self._contact(row)
        gauge_at = self._bounded(row, "gauge_at", 0.0, 1.0)
        minutes = self._bounded(row, "minutes", 0.0, _LATEST)
        temperature = self._bounded(row, "temperature_c", _COLDEST, _HOTTEST)
        seq, cycle = self._count(row, "seq", 0), self._count(row, "cycle", 1)
        if len(self.faults.problems) > before or leg is None or direction is None:
            return None
        if contact is not Contact.FIXED:
            gauge_at = float(contact is Contact.TOOL)
        return ReadingRow(
            row=row,
            leg=leg,
            direction=direction,
            posture=posture,
            displacement=displacement,
            value=value,
            contact=contact,
            gauge_at=0.5 if gauge_at is None else gauge_at,
            gauge=row.cells.get("gauge", ""),
            seq=seq,
            cycle=cycle,
            minutes=minutes,
            temperature=math.nan if temperature is None else temperature,
            note=row.cells.get("note", ""),
        )

    def _note(self, row: Row, column: str, what: str, remedy: str) -> None:
        row.fault(self.faults, column, what, remedy)

    def _axis(self, row: Row, column: str) -> int | None:
        text = row.cells.get(column, "").lower()
        if text in AXES:
            return axis_index(text)
        what = "This is not an axis." if text else "The cell is empty."
        self._note(row, column, what, "Write x, y or z.")
        return None

    def _posture(self, row: Row) -> tuple[str, float]:
        text = row.cells.get("posture", "").lower()
        if text in ("iso", "max", "min"):
            return text, self.machine.displacement_mm(text)
        low, high = self.machine.joint_limits_mm
        remedy = f"Write iso, max, min or a displacement from {low:g} to {high:g} mm."
        if not text:
            self._note(row, "posture", "The cell is empty.", remedy)
            return "", 0.0
        try:
            displacement = self._number(text)
        except InputError:
            self._note(row, "posture", "This is not a posture.", remedy)
            return "", 0.0
        if not low <= displacement <= high:
            self._note(row, "posture", "The posture is outside the joint limits.", remedy)
        return number_text(displacement), displacement

    def _value(self, row: Row) -> float:
        given = [name for name in VALUE_COLUMNS if name in row.cells]
        if len(given) != 1:
            column = VALUE_COLUMNS[0] if not given else given[1]
            what = "The reading is missing." if not given else "The row has two readings."
            self._note(row, column, what, "Give the reading, or remove the row.")
            return math.nan
        value = self._cell(row, given[0])
        if value is None:
            return math.nan
        value *= MM_PER_INCH if given[0] == "reading_in" else 1.0
        if abs(value) > self.machine.leg_length_mm:
            self._note(
                row, given[0], "The reading is larger than the leg is long.",
                "Check the unit and the decimal mark; readings are in mm.",
            )  # fmt: skip
        return value

    def _contact(self, row: Row) -> Contact:
        text = row.cells.get("end", "").lower()
        if text and text not in _ENDS:
            self._note(row, "end", "This is not an end of the leg.", "Write joint or tool.")
        return _ENDS.get(text, Contact.FIXED)

    def _bounded(self, row: Row, column: str, low: float, high: float) -> float | None:
        value = self._cell(row, column)
        if value is not None and not low <= value <= high:
            self._note(
                row, column, f"The number is outside {low:g} … {high:g}.", "Check the number."
            )
        return value

    def _count(self, row: Row, column: str, least: int) -> int | None:
        if column not in row.cells:
            return None
        try:
            return parse_count(row.cells[column], least)
        except InputError as error:
            self._note(row, column, error.what, error.remedy)
            return None

    def _cell(self, row: Row, column: str) -> float | None:
        if column not in row.cells:
            return None
        try:
            return self._number(row.cells[column])
        except InputError as error:
            self._note(row, column, error.what, error.remedy)
            return None

    def _number(self, text: str) -> float:
        value = parse_number(text, decimal_comma=self.decimal_comma)
        for mark in ".,":
            if mark in text:
                self.marks.add(mark)
        return value
