"""Rows of readings to columns of arrays.

A row holds the cells of one reading as text, from a CSV or a session. Every cell is checked by
itself, then what only shows across rows; everything that is wrong is found at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import pairwise

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Faults, unused
from orthoglide_cal.files.table import Cells, Row, Table
from orthoglide_cal.files.text import number_text
from orthoglide_cal.model import (
    AXES,
    Bools,
    Contact,
    Floats,
    GaugePlan,
    Ints,
    Machine,
    Posture,
    Readings,
    Source,
    number_setups,
    places_of,
)
from orthoglide_cal.schema import parse_count, parse_number
from orthoglide_cal.words import listed

NEEDED_COLUMNS = ("leg", "posture", "direction")
VALUE_COLUMNS = ("reading_mm", "reading_in")
TEXT_COLUMNS = ("gauge", "note")
READING_COLUMNS = (
    *NEEDED_COLUMNS, *VALUE_COLUMNS, "seq", "cycle", "minutes", "temperature_c", "gauge_at", "end",
    "part", "bar", "entered", *TEXT_COLUMNS,
)  # fmt: skip
CODED_COLUMNS = tuple(name for name in READING_COLUMNS if name not in TEXT_COLUMNS)

MINUTES_PER_READING = 0.4  # assumed where no times are given: 60 readings in 24 minutes
LATEST_MINUTES = 1e6  # two years

TURNED = "turned"
ENDS = {"joint": Contact.JOINT, "tool": Contact.TOOL}
_ALL_OR_NONE = ("seq", "cycle", "minutes", "end")
_COLDEST, _HOTTEST = -100.0, 200.0  # °C
_AXIS = "Write x, y or z."


@dataclass(frozen=True)
class GaugeIdentity:
    """A gauge as given; None where not given."""

    label: str
    certificate: str | None = None
    resolution_mm: float | None = None


@dataclass(frozen=True)
class Conditions:
    """Circumstances as recorded; None or empty where not given, never invented.

    Attributes:
        protocol, operator, started, finished: as in the session file.
        temperature_c: lowest and highest reading of the thermometer.
        environment: further remarks, name → text.
        gauges: those of the session, or the labels in the readings.
        retaken: number of readings that were replaced.
        skipped: number of steps left out.
        notes: (line of the file, remark).
    """

    protocol: str | None = None
    operator: str | None = None
    started: str | None = None
    finished: str | None = None
    temperature_c: tuple[float, float] | None = None
    environment: tuple[tuple[str, str], ...] = ()
    gauges: tuple[GaugeIdentity, ...] = ()
    retaken: int = 0
    skipped: int = 0
    notes: tuple[tuple[int, str], ...] = ()

    @property
    def mean_temperature_c(self) -> float | None:
        """Of the thermometer, else what the environment's `temperature_c` says; None if neither."""
        if self.temperature_c is not None:
            return sum(self.temperature_c) / 2.0
        try:
            return parse_number(dict(self.environment)["temperature_c"])
        except (KeyError, InputError):
            return None


def axis(text: str) -> int:
    """0, 1, 2 for x, y, z. Raises InputError without a place."""
    if text.lower() not in AXES:
        raise InputError("This is not an axis.", _AXIS)
    return AXES.index(text.lower())


def end(text: str) -> Contact:
    """What the gauge touches. Raises InputError without a place."""
    if text.lower() not in ENDS:
        raise InputError("This is not an end of the leg.", "Write joint or tool.")
    return ENDS[text.lower()]


def bar(text: str) -> bool:
    """Whether the touched bar was turned half round. Raises InputError without a place."""
    if text.lower() != TURNED:
        remedy = f"Write {TURNED} where it was turned half round, else leave the cell empty."
        raise InputError("This does not say how the bar was.", remedy)
    return True


def entered(text: str, number: Callable[[str], float]) -> tuple[float, ...]:
    """What was entered of x, y, z [mm], as `number` reads each. Raises InputError without place."""
    values = tuple(number(each) for each in text.split())
    if len(values) != len(AXES):
        raise InputError(
            f"Three numbers are wanted, of x, y and z; here are {len(values)}.",
            "Write mm with blanks between them, such as 0.5 0 0.",
        )
    return values


def readings_from_table(table: Table, machine: Machine) -> Readings:
    """The readings of a CSV. Raises InvalidFileError with everything that is wrong."""
    _check_header(table)
    table.check_split_numbers(VALUE_COLUMNS, CODED_COLUMNS)
    unknown = (name for name in table.columns if name not in READING_COLUMNS)
    return readings_from_rows(
        table.rows, machine, table.document.source, table.faults, table.number,
        remarks=unused("Columns", unknown, READING_COLUMNS),
    )  # fmt: skip


def readings_from_rows(
    rows: Sequence[Row],
    machine: Machine,
    source: Source,
    faults: Faults,
    number: Callable[[str], float],
    *,
    clock: Sequence[float] | None = None,
    remarks: Sequence[str] = (),
) -> Readings:
    """Convert and check rows.

    Args:
        rows: in the order of the file.
        machine: for postures and limits.
        source: of the rows.
        faults: those found earlier; these are added.
        number: what a cell's text is; raises InputError.
        clock: minutes of each row from its `timestamp`; None where the rows have `minutes`.
        remarks: those of the reader so far.

    Raises:
        InvalidFileError: everything that is wrong with the rows.
    """
    if not rows and not faults:
        faults.add("There is no reading.", "Give one row for each reading, under the header.")
    cells = Cells(rows, faults, number)
    leg, direction = _axes(cells)
    posture, displacement = _postures(cells, machine)
    value = _values(cells, machine)
    contact = np.array(cells.read("end", end, Contact.FIXED), dtype=np.intp)
    gauge_at = cells.numbers("gauge_at", 0.0, 1.0)
    minutes = cells.numbers("minutes", 0.0, LATEST_MINUTES) if clock is None else np.array(clock)
    temperature = cells.numbers("temperature_c", _COLDEST, _HOTTEST)
    seq = cells.read("seq", lambda text: parse_count(text, 0), -1)
    cycle = cells.read("cycle", lambda text: parse_count(text, 1), 0)
    part = np.array(cells.read("part", lambda text: parse_count(text, 1), 1)) - 1
    turned = np.array(cells.read("bar", bar, False))
    offsets = _entered(cells, machine)
    cells.check_complete(_ALL_OR_NONE)
    check_order(cells, seq, minutes, "minutes" if clock is None else "timestamp")
    _check_parts(cells, seq, part)
    _check_bars(cells, part, leg, direction, turned)
    faults.check()

    filled = rows[0].cells  # what is numbered or timed in one row is so in all
    timed = clock is not None or "minutes" in filled
    in_time = np.argsort(seq, kind="stable")
    order = np.argsort(in_time)
    touched = np.where(np.isnan(gauge_at), 0.5, gauge_at)
    gauge_at = np.where(contact == Contact.FIXED, touched, contact == Contact.TOOL)
    gauge = tuple(row.cells.get("gauge", "") for row in rows)
    places = places_of(leg, direction, contact, gauge_at, part, turned)
    plan = GaugePlan(
        leg=leg,
        direction=direction,
        displacement=displacement,
        contact=contact,
        gauge_at=gauge_at,
        setup=number_setups(places, gauge, in_time.tolist(), ordered=timed or "seq" in filled),
        order=order,
        hours=np.where(timed, minutes, order * MINUTES_PER_READING) / 60.0,
        part=part,
        turned=turned,
        entered=offsets,
    )
    readings = Readings(
        plan=plan,
        value=value,
        cycle=np.array(cycle) if "cycle" in filled else _cycles(plan),
        posture=posture,
        temperature=temperature,
        gauge=gauge,
        note=tuple(row.cells.get("note", "") for row in rows),
        line=np.array([row.line for row in rows]),
        timed=timed,
        source=source,
    )
    return replace(readings, remarks=(*remarks, *_remarks(readings, cells, machine)))


def conditions_in(readings: Readings) -> Conditions:
    """What the readings alone say of the circumstances."""
    known = [t for t in readings.temperature.tolist() if t == t]
    labels = dict.fromkeys(label for label in readings.gauge if label)
    notes = zip(readings.line.tolist(), readings.note, strict=True)
    return Conditions(
        temperature_c=(min(known), max(known)) if known else None,
        gauges=tuple(GaugeIdentity(label) for label in labels),
        notes=tuple((line, note) for line, note in notes if note),
    )


def _check_header(table: Table) -> None:
    """Raise what is found so far if the header lacks a column."""
    present = [name for name in table.columns if name]
    wanted = [name for name in NEEDED_COLUMNS if name not in present]
    values = [name for name in VALUE_COLUMNS if name in present]
    if not values:
        wanted.append(VALUE_COLUMNS[0])
    others = [name for name in present if name not in READING_COLUMNS]
    for name in wanted:
        close = get_close_matches(name, others, n=1)
        add = f"Add it; the header has: {listed(present)}."
        remedy = table.other_unit(name) or (f"Rename the column {close[0]!r}." if close else add)
        table.faults.add("The column is missing.", remedy, line=table.header_line, column=name)
    if len(values) == 2:
        table.faults.add(
            "Readings are given both in mm and in inches.",
            "Keep one of the columns reading_mm and reading_in.",
            line=table.header_line,
            column=VALUE_COLUMNS[1],
        )
    if wanted or len(values) == 2:
        table.faults.check()


def _axes(cells: Cells) -> tuple[Ints, Ints]:
    """Leg and direction; −1 where there is none."""
    leg, direction = (
        np.array(cells.read(column, axis, -1, wanted=_AXIS), dtype=np.intp)
        for column in ("leg", "direction")
    )
    for index in np.flatnonzero((leg == direction) & (leg >= 0)).tolist():
        other = " or ".join(name for name in AXES if name != AXES[leg[index]])
        what = "A gauge along the leg's own axis says nothing of the leg."
        remedy = f"Give the direction across the leg: {other}; or correct the leg."
        cells.note(index, "direction", what, remedy)
    return leg, direction


def _postures(cells: Cells, machine: Machine) -> tuple[tuple[str, ...], Floats]:
    """Names (a displacement as text) and displacements [mm]."""
    low, high = machine.joint_limits_mm
    named = {posture.value: machine.displacement_mm(posture) for posture in Posture}
    remedy = f"Write iso, max, min or a displacement from {low:g} to {high:g} mm."

    def posture(text: str) -> tuple[str, float]:
        name = text.lower()
        if name in named:
            return name, named[name]
        try:
            displacement = cells.number(text)
        except InputError:
            raise InputError("This is not a posture.", remedy) from None
        if not low <= displacement <= high:
            raise InputError("The posture is outside the joint limits.", remedy)
        return number_text(displacement), displacement

    read = cells.read("posture", posture, ("", 0.0), wanted=remedy)
    return tuple(name for name, _ in read), np.array([d for _, d in read], dtype=np.float64)


def _values(cells: Cells, machine: Machine) -> Floats:
    """Readings [mm], shape (n,)."""
    for index, row in enumerate(cells.rows):
        given = [name for name in VALUE_COLUMNS if name in row.cells]
        if len(given) != 1:
            column = given[1] if given else VALUE_COLUMNS[0]
            what = "The row has two readings." if given else "The reading is missing."
            cells.note(index, column, what, "Give the reading, or remove the row.")

    mm, inches = (
        cells.lengths(column, machine.leg_length_mm, "reading") for column in VALUE_COLUMNS
    )
    return np.where(np.isnan(mm), inches, mm)


def _entered(cells: Cells, machine: Machine) -> Floats:
    """What was entered in the controller, shape (n, 3) [mm]."""

    def offsets(text: str) -> tuple[float, ...]:
        values = entered(text, cells.number)
        if max(map(abs, values)) > machine.leg_length_mm:
            raise InputError("An offset is larger than the leg is long.", "Offsets are in mm.")
        return values

    blank = (0.0,) * len(AXES)
    return np.reshape(cells.read("entered", offsets, blank), (-1, len(AXES)))


def check_order(cells: Cells, seq: Sequence[int], minutes: Floats, clock: str) -> None:
    """Each `seq` stands once, and time never runs backwards along it."""
    lines, sound = [row.line for row in cells.rows], np.flatnonzero(cells.sound).tolist()
    first: dict[int, int] = {}
    for index in sound:
        earlier = first.setdefault(seq[index], index)
        if seq[index] >= 0 and earlier != index:
            what = f"The same number stands in line {lines[earlier]}."
            remedy = "Number the readings in the order in which they were taken."
            cells.note(index, "seq", what, remedy)
    for before, after in pairwise(sorted(sound, key=lambda index: seq[index])):
        if minutes[after] < minutes[before]:
            cells.note(
                after, clock,
                f"Time runs backwards: line {lines[before]} was taken before this one.",
                "Give minutes since the session began; correct seq or the order of the rows.",
            )  # fmt: skip


def _check_parts(cells: Cells, seq: Sequence[int], part: Ints) -> None:
    """Parts are numbered in order of time, without a gap."""
    sound = sorted(np.flatnonzero(cells.sound).tolist(), key=lambda index: seq[index])
    last = 0
    for index in sound:
        if not last <= part[index] <= last + 1:
            what = f"Part {part[index] + 1} does not follow part {last + 1}."
            remedy = "Number the parts 1, 2 and so on, in the order in which they were measured."
            cells.note(index, "part", what, remedy)
        last = max(last, int(part[index]))


def _check_bars(cells: Cells, part: Ints, leg: Ints, direction: Ints, turned: Bools) -> None:
    """A bar is turned for both gauges that touch it."""
    kinds, which = np.unique(np.stack((part, leg)), axis=1, return_inverse=True)
    for kind in range(kinds.shape[1]):
        mine = np.array(cells.sound) & (which.reshape(-1) == kind)
        with_it = set(direction[mine & turned].tolist())
        others = mine & ~np.isin(direction, list(with_it))
        if with_it and others.any():
            names = " and ".join(AXES[axis] for axis in sorted(with_it))
            first = int(np.flatnonzero(others)[0])
            cells.note(
                first, "bar",
                f"The bar of leg {AXES[leg[first]]} is turned for direction {names} alone; it is"
                " one bar.",
                "Write turned in all rows of that leg that were read so, or give these a part of"
                " their own.",
            )  # fmt: skip


def _cycles(plan: GaugePlan) -> Ints:
    """Repeats counted in time within each part, leg, direction, posture and end, shape (n,)."""
    alike = list(zip(plan.part, plan.cells, strict=True))
    seen: Counter[object] = Counter()
    cycles = np.empty(len(alike), dtype=np.intp)
    for index in plan.in_time:
        seen[alike[index]] += 1
        cycles[index] = seen[alike[index]]
    return cycles


def _remarks(readings: Readings, cells: Cells, machine: Machine) -> list[str]:
    """What the user should know although nothing is wrong."""
    remarks, plan, travel = [], readings.plan, machine.gauge.range_mm
    beyond = np.flatnonzero(np.abs(readings.value) > travel)
    if beyond.size:
        first = beyond[0]
        remarks.append(
            f"{beyond.size} of {len(readings)} readings are beyond the gauge's range of"
            f" {travel:g} mm (first: line {readings.line[first]}, {readings.value[first]:g} mm):"
            " check the unit, and the gauge in the machine file."
        )
    if len(cells.marks) > 1:
        remarks.append("Decimal points and decimal commas are mixed; both were accepted.")
    if not readings.timed:
        remarks.append(
            f"Times were not given; {MINUTES_PER_READING:g} minutes per reading were assumed."
        )
    ends = np.flatnonzero(plan.contact != Contact.FIXED).tolist()
    if any("gauge_at" in cells.rows[index].cells for index in ends):
        remarks.append("gauge_at was not used: `end` says where the gauge stood.")
    if readings.timed or "cycle" in cells.rows[0].cells:
        remarks += _repeated_rows(cells.rows)
    places = places_of(
        plan.leg, plan.direction, plan.contact, plan.gauge_at, plan.part, plan.turned
    )
    anew = plan.setups - len(set(zip(places, readings.gauge, strict=True)))
    if anew:
        remarks.append(
            f"Labelled gauges came back to a place {anew} times after use elsewhere; each return"
            " has its own unknown zero."
        )
    return remarks


def _repeated_rows(rows: Sequence[Row]) -> list[str]:
    """Rows that are equal word for word, where cycle or minutes should tell repeats apart."""
    remarks = []
    first: dict[frozenset[tuple[str, str]], int] = {}
    for row in rows:
        content = frozenset(item for item in row.cells.items() if item[0] != "seq")
        if content in first:
            remarks.append(
                f"Line {row.line} repeats line {first[content]} word for word; both were used."
            )
        first.setdefault(content, row.line)
    return remarks
