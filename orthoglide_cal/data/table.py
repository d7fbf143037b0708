"""CSV text to rows of named cells; nothing is converted here.

The delimiter is the one that the header line uses (tab, then semicolon, then comma): guessing
from the content goes wrong on `1,234;5,678`.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from orthoglide_cal.data.document import Document
from orthoglide_cal.data.faults import Faults

_COLUMNS = 100
_ROWS = 100_000  # read in a few seconds
_BLANKS = " \t\u00a0\u202f\ufeff"  # also those that spreadsheets and web pages leave
_BLANK_CELL = _BLANKS + "\n\r\v\f"


@dataclass(frozen=True)
class Row:
    """One record of a file.

    Attributes:
        line: its first line, from 1.
        cells: column → text without blanks around it; empty cells are left out.
        lines: column → line, where a cell has its own.
        prefix: what precedes a column's name in messages, e.g. "readings[3].".
    """

    line: int
    cells: Mapping[str, str]
    lines: Mapping[str, int] = field(default_factory=dict)
    prefix: str = ""

    def fault(self, faults: Faults, column: str, what: str, remedy: str) -> None:
        """Note a fault of one cell."""
        faults.add(
            what,
            remedy,
            line=self.lines.get(column, self.line),
            column=self.prefix + column,
            value=self.cells.get(column),
        )


@dataclass(frozen=True)
class Table:
    """A CSV file.

    Attributes:
        columns: header names in lower case, in order; "" where there is none.
        header_line: from 1.
        rows: records that are not blank.
        decimal_comma: True if the delimiter leaves the comma free.
        document: where it came from.
        faults: wrong quotes and row lengths found so far.
    """

    columns: tuple[str, ...]
    header_line: int
    rows: tuple[Row, ...]
    decimal_comma: bool
    document: Document
    faults: Faults


def read_table(document: Document, coded: Sequence[str]) -> Table:
    """Split a document into header and rows.

    Blank lines are skipped, and so are lines that start with # and Excel's `sep=;` line.

    Args:
        document: the file.
        coded: columns that never hold free text. If another column comes first, a # after the
            header belongs to its text: skipping the line would lose a reading.
    """
    faults = Faults(document.path)
    lines = _Lines(document.text.split("\n"))
    delimiter = lines.find_header()
    records = _records(lines, delimiter, faults)
    header_line, header = next(records, (1, []))
    columns = _columns(header, header_line, faults)
    lines.comments = bool(columns) and columns[0] in coded
    rows: list[Row] = []
    for line, record in records:
        if len(rows) >= _ROWS:
            faults.add(f"There are more than {_ROWS} rows.", "Give a smaller file.", line=line)
            break
        cells = [_clean(cell) for cell in record]
        if len(cells) > len(columns) and any(cells[len(columns) :]):
            faults.add(
                f"The row has {len(cells)} cells, the header {len(columns)}.",
                "For decimal commas separate the columns with semicolons, in the header too."
                if delimiter == ","
                else f"Put a cell that holds {delimiter!r} in quotes.",
                line=line,
                value=lines.shown(line),
            )
        elif any(cells):
            pairs = zip(columns, cells, strict=False)
            rows.append(Row(line, {name: cell for name, cell in pairs if cell}))
    return Table(columns, header_line, tuple(rows), delimiter != ",", document, faults)


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
        text = self.lines[line - 1].strip()
        return text if len(text) <= 60 else text[:59] + "…"

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
            endless = "end of data" in str(error)
            faults.add(
                "A quotation mark is opened and never closed."
                if endless
                else f"The row cannot be split into cells: {error}.",
                'Close it, or write "" for a quotation mark inside quotes.',
                line=lines.first,
                value=lines.shown(lines.first),
            )
            return
        yield lines.first, record


def _columns(header: Sequence[str], line: int, faults: Faults) -> tuple[str, ...]:
    """Names of the columns; too many and repeated ones are faults."""
    names = [_clean(name).lower() for name in header[:_COLUMNS]]
    if len(header) > _COLUMNS:
        faults.add(
            f"The header has more than {_COLUMNS} columns.", "Check the delimiter.", line=line
        )
    for index, name in enumerate(names):
        if name and name in names[:index]:
            faults.add(
                "The header names this column twice.", "Rename or remove one.",
                line=line, column=name,
            )  # fmt: skip
    return tuple(names)
