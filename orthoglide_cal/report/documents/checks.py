"""Two checks: `validate` of a file, and `paper` of this program against the published tables."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from orthoglide_cal.errors import UnusableResultError, file_words
from orthoglide_cal.files import Check
from orthoglide_cal.model import Source
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.facts import data_words
from orthoglide_cal.words import counted, plain

if TYPE_CHECKING:
    from orthoglide_cal.paper.tables import Reproduction


def check_document(
    check: Check, source: Source | None = None, refused: UnusableResultError | None = None
) -> doc.Document:
    """A line for a sound file, every fault of another; lines that other programs can search.

    Args:
        check, source: what was found of the file, and what was measured.
        refused: why its data give no offsets although nothing is wrong with the file.
    """
    told = check.changed(refused=str(refused) if refused else None)
    listing = doc.Listing(tuple(_lines(check, source, refused)))
    page = doc.Page("Validation", sections=(doc.Section(None, (listing,)),))
    return doc.Document(partial(told.model_dump, mode="json"), lambda: page)


def _lines(
    check: Check, source: Source | None, refused: UnusableResultError | None
) -> Iterator[str]:
    """One line for the file; two for each fault: where and what, then the remedy."""
    path, kind = file_words(check.input.path), check.input.kind
    if kind == "machine":
        yield f"{path}: machine {check.machine!r}, fine"
    elif check.valid and kind is not None:
        word = "which give no offsets" if refused else "fine"
        data = data_words(source, kind, check.input.readings)
        yield f"{path}: {data}, {word} (for {check.machine})"
    else:
        yield f"{path}: {counted(len(check.problems), 'fault')}"
    for problem in check.problems:
        line = f"line {problem.line}" if problem.line is not None else ""
        column = f"column {problem.column}" if problem.column is not None else ""
        where = ", ".join(filter(None, (line, column)))
        value = f" ({problem.value!r})" if problem.value is not None else ""
        yield f"  {where}{': ' if where else ''}{problem.what}{value}"
        if problem.remedy:
            yield f"    → {problem.remedy}"
    if refused:
        yield f"  {refused.what}"
        yield f"    → {refused.remedy}"
    yield from (f"  note: {remark}" for remark in check.remarks)


def paper_document(found: Reproduction) -> doc.Document:
    """Two lines for each row, as printed and as computed, and the verdict.

    As data None stands where nothing was printed or nothing can be computed.
    """

    def data() -> dict[str, object]:
        rows = [
            {**vars(row), "reproduced": None if row.computed is None else row.reproduced}
            for row in found.rows
        ]
        own = {"table": found.table, "title": found.title, "columns": found.columns, "rows": rows}
        return {"schema_version": 1, **own, "reproduced": found.reproduced, "notes": found.notes}

    def page() -> doc.Page:
        rows = []
        for row in found.rows:
            computed = row.computed or (None,) * len(row.published)
            for name, what, values in (
                (row.name, "published", row.published),
                ("", "computed", computed),
            ):
                cells = ("—" if each is None else plain(each, found.digits) for each in values)
                rows.append((name, what, *cells))
        verdict = doc.Notice(doc.Tone.BAD, "NOT reproduced.")
        if found.reproduced:
            told = "Reproduced in every figure that can be computed."
            verdict = doc.Notice(doc.Tone.GOOD, told)
        grid = doc.Grid(("", "", *found.columns), tuple(rows), words=(0, 1))
        kind = "Accuracy" if found.table == "accuracy" else f"Table {found.table}"
        section = doc.Section(None, (grid, *map(doc.Paragraph, found.notes), verdict))
        return doc.Page(kind, found.title, sections=(section,))

    return doc.Document(data, page)
