"""CSV text to records of named cells, and back.

The delimiter is the one that the header line uses (tab, then semicolon, then comma): guessing
from the content goes wrong on `1,234;5,678`.
"""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from itertools import pairwise

from orthoglide_cal.errors import visible
from orthoglide_cal.files.faults import Content, Place, Steps, unused
from orthoglide_cal.files.rows import CODED, Row
from orthoglide_cal.files.text import FileText
from orthoglide_cal.schema import Reason, parse_number
from orthoglide_cal.words import MM, listed, short

_COLUMNS = 100
_ROWS = 100_000  # read in a few seconds
_BLANKS = " \t\u00a0\u202f\ufeff"  # also those that spreadsheets and web pages leave
_FORMULA = tuple("=+-@\t\r\n")  # what a spreadsheet would calculate
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
        at, delimiter = _start(lines)
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

    def check_header(self, schema: type[Row]) -> list[Reason]:
        """A remark on the columns without a meaning, if there are any.

        Raises what is found so far if the header lacks one of the columns that rows of a schema
        need, or gives lengths twice.
        """
        before, present = len(self.problems), [name for name in self.columns if name]
        known, inches, last = schema.columns(), schema.inches, [*schema.needed][-1]
        others = [name for name in present if name not in known]
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
        return unused("Columns", others, known)

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


def _start(lines: Sequence[str]) -> tuple[int, str]:
    """Index of the line from which records are read, and the delimiter of the header."""
    for index, line in enumerate(lines):
        plain = line.strip(_BLANKS)
        if plain.lower().startswith("sep=") and len(plain) <= 5:
            return index + 1, line.strip(" ")[4:5] or "\t"
        if plain and not plain.startswith("#"):
            return index, next((mark for mark in "\t;," if mark in line), ",")
    return len(lines), ","


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
