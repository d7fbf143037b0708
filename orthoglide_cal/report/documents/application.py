"""The document of `orthocal apply`: what is in the controller from now on, and what comes next."""

from __future__ import annotations

from functools import partial

from orthoglide_cal.errors import command
from orthoglide_cal.model import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import measure_again
from orthoglide_cal.results import Application
from orthoglide_cal.words import signed


def application_document(found: Application, session: str) -> doc.Document:
    """The document, for any of the renderers; `session` as the user gave it."""
    return doc.Document(partial(_data, found), partial(_page, found, session))


def _data(found: Application) -> dict[str, object]:
    """What changes in the machine file; lengths in mm."""
    entry = found.entry
    return {
        "schema_version": 1,
        "machine_file": found.file.document.path,
        "machine": found.file.model.machine.name,
        "undone": found.undone,
        "date": entry.date,
        "before": dict(zip(AXES, found.before_mm, strict=True)),
        "after": dict(zip(AXES, found.after_mm, strict=True)),
        "data_sha256": entry.data_sha256,
    }


def _page(found: Application, session: str) -> doc.Page:
    machine = found.file.model.machine
    rows = tuple(
        (axis, signed(before, 4), signed(after - before, 4), doc.Strong(signed(after, 4)))
        for axis, before, after in zip(AXES, found.before_mm, found.after_mm, strict=True)
    )
    caption = "Joint offsets in the controller, mm (true position = indicated + offset)."
    grid = doc.Grid(("axis", "before", "change", "from now on"), rows, caption=caption)
    if found.undone:
        items: tuple[doc.Instruction, ...] = (
            doc.Instruction("The controller must hold the last column again; re-home."),
        )
    else:
        items = (
            doc.Instruction("The controller must hold the last column, and be homed since."),
            doc.Instruction("Measure again in the same way.", measure_again(found.conditions)),
            doc.Instruction("Compare with what was promised.", command("verify", session, "AFTER")),
        )
    title = "Taken back" if found.undone else "Entered in the controller"
    section = doc.Section(None, (grid, doc.Instructions(items)))
    return doc.Page(kind=title, title=machine.name, sections=(section,))
