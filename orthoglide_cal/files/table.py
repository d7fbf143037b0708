"""CSV text to records of named cells, and back.

The delimiter is the one that the header line uses (tab, then semicolon, then comma): guessing
from the content goes wrong on `1,234;5,678`.
"""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise

from orthoglide_cal.errors import visible
from orthoglide_cal.files.faults import Faults, unused
from orthoglide_cal.files.rows import Record
from orthoglide_cal.files.text import FileText
from orthoglide_cal.schema import parse_number, shortened
from orthoglide_cal.words import MM, listed, short

_COLUMNS = 100
_ROWS = 100_000  # read in a few seconds
_BLANKS = " \t\u00a0\u202f\ufeff"  # also those that spreadsheets and web pages leave
_FORMULA = tuple("=+-@\t\r\n")  # what a spreadsheet would calculate
_BLANK_CELL = _BLANKS + "\n\r\v\f"


@dataclass(frozen=True)
class Table:
    """A CSV file."""

    columns: tuple[str, ...]  # header names in lower case, in order; "" where there is none
    header_line: int
    rows: tuple[Record, ...]  # that are not blank
    decimal_comma: bool  # the delimiter leaves the comma free
    file: FileText
    faults: Faults  # wrong quotes and row lengths found so far

    def number(self, text: str) -> float:
        """The number that a cell writes. Raises InputError without a place."""
        return parse_number(text, decimal_comma=self.decimal_comma)

    def check_header(
        self, columns: Sequence[str], known: Sequence[str], inches: str = ""
    ) -> list[str]:
        """A remark on the columns without a meaning (all `known` have one), if there are any.

        Raises what is found so far if the header lacks one of the columns that are needed
        (`inches` may stand instead of the last of them) or gives lengths twice.
        """
        before, present = len(self.faults.problems), [name for name in self.columns if name]
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
        if len(self.faults.problems) > before:
            raise self.faults.error()
        return unused("Columns", others, known)

    def check_split_numbers(self, coded: Sequence[str]) -> None:
        """Refuse `0,123` that a comma-separated row has split into the reading 0 and a text 123.

        A column next to the readings that never holds free text (`coded`) has not got the 123.
        """
        if self.decimal_comma or not self.rows:
            return
        readings = ("reading_mm", "reading_in")
        pairs = (pair for pair in pairwise(self.columns) if pair[0] in readings)
        value, beside = next(pairs, ("", ""))
        if not value or beside in coded:
            return
        fractions = [row.cells.get(beside, "") for row in self.rows]
        cells = [row.cells.get(value, "") for row in self.rows]
        whole = all(re.fullmatch("[-+\u2212]?[0-9]+", cell) for cell in cells)
        if whole and all(map(str.isdigit, fractions)) and max(map(len, fractions)) > 1:
            what = f"Every reading is a whole number with digits in the next column, {beside!r}:"
            what += " decimal commas?"
            remedy = "Write decimal points, or separate the columns with semicolons."
            said = f"{cells[0]},{fractions[0]}"
            self.faults.add(what, remedy, self.rows[0].line, value, said)


def read_table(file: FileText, coded: Sequence[str]) -> Table:
    """Split a file into header and rows.

    Blank lines are skipped, and so are lines that start with # and Excel's `sep=;` line.

    If the first column is not one of those that never hold free text (`coded`), a # after the
    header belongs to its text: skipping the line would lose a reading.
    """
    faults = Faults(file.path)
    lines = file.text.split("\n")
    at, delimiter = _start(lines)
    columns: tuple[str, ...] | None = None
    header_line = 1
    comments = True
    rows: list[Record] = []
    while at < len(lines):
        plain = lines[at].lstrip(_BLANKS)
        line = at + 1
        if not plain.strip() or (comments and plain.startswith("#")):
            at += 1
            continue
        rest = (f"{lines[index]}\n" for index in range(at, len(lines)))
        reader = csv.reader(rest, delimiter=delimiter, strict=True, skipinitialspace=True)
        shown = shortened(lines[at].strip(), 60)
        try:
            cells = [cell.strip(_BLANK_CELL) for cell in next(reader)]
        except csv.Error as error:
            what = f"The row cannot be split into cells: {error}."
            if "end of data" in str(error):
                what = "A quotation mark is opened and never closed."
            remedy = 'Close it, or write "" for a quotation mark inside quotes.'
            faults.add(what, remedy, line=line, value=shown)
            break
        at += reader.line_num  # quotes may span lines
        if columns is None:
            columns = _columns(cells, line, faults)
            header_line = line
            comments = columns[0] in coded
        elif len(rows) >= _ROWS:
            faults.add(f"There are more than {_ROWS} rows.", "Give a smaller file.", line=line)
            break
        elif any(cells[len(columns) :]):
            what = f"The row has {len(cells)} cells, the header {len(columns)}."
            remedy = f"Put a cell that holds {delimiter!r} in quotes."
            if delimiter == ",":
                remedy = "For decimal commas separate the columns with semicolons"
                remedy += ", in the header too."
            faults.add(what, remedy, line=line, value=shown)
        elif any(cells):
            pairs = zip(columns, cells, strict=False)
            rows.append(Record(line, {name: cell for name, cell in pairs if cell}))
    return Table(columns or (), header_line, tuple(rows), delimiter != ",", file, faults)


def _start(lines: Sequence[str]) -> tuple[int, str]:
    """Index of the line from which records are read, and the delimiter of the header."""
    for index, line in enumerate(lines):
        plain = line.strip(_BLANKS)
        if plain.lower().startswith("sep=") and len(plain) <= 5:
            return index + 1, line.strip(" ")[4:5] or "\t"
        if plain and not plain.startswith("#"):
            return index, next((mark for mark in "\t;," if mark in line), ",")
    return len(lines), ","


def _columns(header: Sequence[str], line: int, faults: Faults) -> tuple[str, ...]:
    """Names of the columns; too many and repeated ones are faults."""
    names = [name.lower() for name in header[:_COLUMNS]]
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


def in_csv(text: str) -> str:
    """The text for a cell of a CSV; a formula gets a "'" in front.

    Numbers are not passed through this function, so that "-0.53" stays a number.
    """
    dangerous = text.startswith(_FORMULA) or text.lstrip().startswith(("=", "+", "-", "@"))
    return ("'" if dangerous else "") + visible(text)
