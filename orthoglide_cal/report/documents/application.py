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
    entry, (before, after) = found.entry, found.offsets_mm
    return {
        "schema_version": 1,
        "machine_file": found.file.document.path,
        "machine": found.file.model.machine.name,
        "undone": found.undone,
        "date": entry.date,
        "before": dict(zip(AXES, before, strict=False)),
        "after": dict(zip(AXES, after, strict=False)),
        "data_sha256": entry.data_sha256,
        "written": entry.written.model_dump() if entry.written else None,
    }


def _page(found: Application, session: str) -> doc.Page:
    machine = found.file.model.machine
    if found.controller is not None and found.entry.written is not None:
        head, written = ("line", "what", "now", "from now on"), found.entry.written
        rows = tuple(
            (str(each.line), each.key, each.after, doc.Strong(each.before))
            if found.undone
            else (str(each.line), each.key, each.before, doc.Strong(each.after))
            for each in written.values
        )
        notes = (f"Lines of {written.target}; all others stay.", *found.controller.remarks)
        caption, said = " ".join(notes), machine.vocabulary.restart
        if found.controller.adds:
            said = f"Restart LinuxCNC: it reads its INI only then. {said}"
    else:
        head = ("axis", "before", "change", "from now on")
        rows = tuple(
            (axis, signed(before, 4), signed(after - before, 4), doc.Strong(signed(after, 4)))
            for axis, before, after in zip(AXES, *found.offsets_mm, strict=False)
        )
        caption = "Joint offsets in the controller, mm (true position = indicated + offset)."
        said = "The controller must hold the last column, and be homed since."
    if found.undone:
        steps = [doc.Instruction("The controller must hold the last column again; re-home.")]
    else:
        steps = [
            doc.Instruction(said),
            doc.Instruction("Probe it again in the same way.")
            if machine.keeps_itself
            else doc.Instruction("Measure again in the same way.", measure_again(found.conditions)),
            doc.Instruction("Compare with the prediction.", command("verify", session, "AFTER")),
        ]
    title = "To be taken back" if found.undone else "To be recorded"
    grid = doc.Grid(head, rows, caption=caption)
    section = doc.Section(None, grid, doc.Instructions(steps))
    return doc.Page(kind=title, title=machine.name, sections=[section])
