"""CSV text to records of named cells, and back.

The delimiter is the one that the header line uses (tab, then semicolon, then comma): guessing
from the content goes wrong on `1,234;5,678`.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise

from orthoglide_cal.files.faults import Faults, unused
from orthoglide_cal.files.rows import Record
from orthoglide_cal.files.text import FileText
from orthoglide_cal.schema import parse_number, shortened
from orthoglide_cal.words import MM, listed, short

_COLUMNS = 100
_ROWS = 100_000  # read in a few seconds
_BLANKS = " \t\u00a0\u202f\ufeff"  # also those that spreadsheets and web pages leave
_BLANK_CELL = _BLANKS + "\n\r\v\f"


@dataclass(frozen=True)
class Table:
    """A CSV file.

    Attributes:
        columns: header names in lower case, in order; "" where there is none.
        header_line: from 1.
        rows: records that are not blank.
        decimal_comma: True if the delimiter leaves the comma free.
        file: where it came from.
        faults: wrong quotes and row lengths found so far.
    """

    columns: tuple[str, ...]
    header_line: int
    rows: tuple[Record, ...]
    decimal_comma: bool
    file: FileText
    faults: Faults

    def number(self, text: str) -> float:
        """The number that a cell writes. Raises InputError without a place."""
        return parse_number(text, decimal_comma=self.decimal_comma)

    def check_header(
        self, columns: Sequence[str], known: Sequence[str], inches: str = ""
    ) -> list[str]:
        """Raise what is found so far if the header lacks a column or gives lengths twice.

        Args:
            columns: that are needed.
            known: all that have a meaning.
            inches: that may stand instead of the last one needed.

        Returns:
            A remark on the columns without a meaning, if there are any.
        """
        before, present = self.faults.count, [name for name in self.columns if name]
        others = [name for name in present if name not in known]
        for name in columns:
            if name in present or (name == columns[-1] and inches in present):
                continue
            close = get_close_matches(name, others, n=1)
            remedy = f"Add it; the header has: {listed(present)}."
            if close:
                unit = MM.get(close[0].rpartition("_")[2])
                factor = f"multiply the numbers by {short(unit, 6)} and " if unit else ""
                remedy = f"{factor}rename the column {close[0]!r}.".capitalize()
            what = "The column is missing."
            self.faults.add(what, remedy, line=self.header_line, column=name)
        if {columns[-1], inches} <= set(present):
            what = "Lengths are given both in mm and in inches."
            remedy = f"Keep one of the columns {columns[-1]} and {inches}."
            self.faults.add(what, remedy, line=self.header_line, column=inches)
        if self.faults.count > before:
            raise self.faults.error()
        return unused("Columns", others, known)

    def check_split_numbers(self, columns: Sequence[str], coded: Sequence[str]) -> None:
        """Refuse `0,123` that a comma-separated row has split into the reading 0 and a text 123.

        Args:
            columns: those that hold readings.
            coded: those that never hold free text.
        """
        if self.decimal_comma or not self.rows:
            return
        pairs = (pair for pair in pairwise(self.columns) if pair[0] in columns)
        value, beside = next(pairs, ("", ""))
        if not value or beside in coded:
            return
        fractions = [row.cells.get(beside, "") for row in self.rows]
        cells = [row.cells.get(value, "") for row in self.rows]
        whole = all(re.fullmatch("[-+\u2212]?[0-9]+", cell) for cell in cells)
        if whole and all(map(str.isdigit, fractions)) and max(map(len, fractions)) > 1:
            self.faults.add(
                f"Every reading is a whole number with digits in the next column, {beside!r}:"
                " decimal commas?",
                "Write decimal points, or separate the columns with semicolons.",
                line=self.rows[0].line,
                column=value,
                value=f"{cells[0]},{fractions[0]}",
            )


def read_table(file: FileText, coded: Sequence[str]) -> Table:
    """Split a file into header and rows.

    Blank lines are skipped, and so are lines that start with # and Excel's `sep=;` line.

    Args:
        file: as read.
        coded: columns that never hold free text. If another column comes first, a # after the
            header belongs to its text: skipping the line would lose a reading.
    """
    faults = Faults(file.path)
    lines = _Lines(file.text.split("\n"))
    delimiter = lines.find_header()
    records = _records(lines, delimiter, faults)
    header_line, header = next(records, (1, []))
    columns = _columns(header, header_line, faults)
    lines.comments = bool(columns) and columns[0] in coded
    rows: list[Record] = []
    for line, record in records:
        if len(rows) >= _ROWS:
            faults.add(f"There are more than {_ROWS} rows.", "Give a smaller file.", line=line)
            break
        cells = [_clean(cell) for cell in record]
        if len(cells) > len(columns) and any(cells[len(columns) :]):
            what = f"The row has {len(cells)} cells, the header {len(columns)}."
            remedy = f"Put a cell that holds {delimiter!r} in quotes."
            if delimiter == ",":
                remedy = (
                    "For decimal commas separate the columns with semicolons, in the header too."
                )
            faults.add(what, remedy, line=line, value=lines.shown(line))
        elif any(cells):
            pairs = zip(columns, cells, strict=False)
            rows.append(Record(line, {name: cell for name, cell in pairs if cell}))
    return Table(columns, header_line, tuple(rows), delimiter != ",", file, faults)


def _clean(cell: str) -> str:
    return cell.strip(_BLANK_CELL)


class _Lines:
    """Feeds lines to the csv reader and remembers where the current record started."""

    def __init__(self, lines: Sequence[str]) -> None:
        self.lines = lines
        self.next = 0
        self.first = 0
        self.within = False  # inside a record, whose quotes may span lines
        self.comments = True  # lines that start with # are comments

    def find_header(self) -> str:
        """Go to the header line; returns the delimiter that it uses."""
        for index, line in enumerate(self.lines):
            plain = line.strip(_BLANKS)
            if not plain or plain.startswith("#"):
                continue
            if plain.lower().startswith("sep=") and len(plain) <= 5:
                self.next = index + 1
                return line.strip(" ")[4:5] or "\t"
            self.next = index
            return next((mark for mark in "\t;," if mark in line), ",")
        self.next = len(self.lines)
        return ","

    def shown(self, line: int) -> str:
        """Line `line` (from 1), shortened to what fits a message."""
        return shortened(self.lines[line - 1].strip(), 60)

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        if not self.within:
            while self.next < len(self.lines) and self._skipped(self.lines[self.next]):
                self.next += 1
            self.first = self.next + 1
            self.within = True
        if self.next >= len(self.lines):
            raise StopIteration
        self.next += 1
        return self.lines[self.next - 1] + "\n"

    def _skipped(self, line: str) -> bool:
        plain = line.lstrip(_BLANKS)
        return not plain.strip() or (self.comments and plain.startswith("#"))


def _records(lines: _Lines, delimiter: str, faults: Faults) -> Iterator[tuple[int, list[str]]]:
    """Line number and raw cells of each record; stops at broken quotes with a fault."""
    reader = csv.reader(lines, delimiter=delimiter, strict=True, skipinitialspace=True)
    while True:
        lines.within = False
        try:
            record = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            what = f"The row cannot be split into cells: {error}."
            if "end of data" in str(error):
                what = "A quotation mark is opened and never closed."
            remedy = 'Close it, or write "" for a quotation mark inside quotes.'
            faults.add(what, remedy, line=lines.first, value=lines.shown(lines.first))
            return
        yield lines.first, record


def _columns(header: Sequence[str], line: int, faults: Faults) -> tuple[str, ...]:
    """Names of the columns; too many and repeated ones are faults."""
    names = [_clean(name).lower() for name in header[:_COLUMNS]]
    if len(header) > _COLUMNS:
        what = f"The header has more than {_COLUMNS} columns."
        faults.add(what, "Check the delimiter.", line=line)
    for index, name in enumerate(names):
        if name and name in names[:index]:
            what = "The header names this column twice."
            faults.add(what, "Rename or remove one.", line=line, column=name)
    return tuple(names)


def csv_text(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """A header line and one line for each row; None is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()
