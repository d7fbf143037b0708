"""The document of `orthocal verify` for a printer: its touches before and after."""

from __future__ import annotations

from functools import partial
from typing import Any

from orthoglide_cal.errors import file_words
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.facts import data_words
from orthoglide_cal.report.json import SCHEMA_VERSION, fields_of, input_data
from orthoglide_cal.results import Identity
from orthoglide_cal.verification import Remeasured
from orthoglide_cal.words import plain, signed, with_uncertainty

_DECIMALS = 4


def remeasured_document(found: Remeasured, identity: Identity) -> doc.Document:
    """The document, for any of the renderers."""
    return doc.Document(partial(_data, found, identity), partial(_page, found, identity))


def _data(found: Remeasured, identity: Identity) -> dict[str, Any]:
    """Everything as plain values; lengths in mm, each parameter in its unit."""
    before, after = (
        input_data(each.source, each.measured.kind, len(each.measured))
        for each in (found.before, found.after)
    )
    names = ("unit", "found", "expanded", "entered", "left", "left_expanded", "as_found")
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "verification",
        "number": identity.number,
        "issued": identity.issued.isoformat(timespec="seconds"),
        "before": before,
        "after": after,
        "machine": found.after.machine,
        **fields_of(found, "found_mm", "promised_mm", "left_mm", "reachable_mm", "kept"),
        "parameters": {each.name: fields_of(each, *names) for each in found.parameters},
    }


def _page(found: Remeasured, identity: Identity) -> doc.Page:
    sizes = (found.found_mm, found.promised_mm, found.left_mm, found.reachable_mm)
    was, promised, left, reachable = (f"{plain(1000.0 * size, 0)} µm" for size in sizes)
    better = found.left_mm < found.found_mm
    size = doc.Grid(
        ("r.m.s. of the heights", "as found", "promised", "as left", "could be"),
        (("touches, without their mean", was, promised, left, reachable),),
        caption="Promised: what the parameters found before would leave. Could be: what those found"
        " afterwards would.",
    )
    rows = tuple(
        (
            each.name,
            each.unit,
            with_uncertainty(each.found, each.expanded),
            "unknown" if each.entered is None else signed(each.entered, _DECIMALS),
            with_uncertainty(each.left, each.left_expanded),
        )
        for each in found.parameters
    )
    grid = doc.Grid(
        ("", "unit", "found ± U", "entered", "left ± U"),
        rows,
        caption="Found before, entered in the firmware between the two, left afterwards.",
    )
    notes = [doc.Paragraph(line) for line in _notes(found)]
    tone = doc.Tone.GOOD if found.kept else doc.Tone.WARN
    came = "as promised" if found.kept else f"{'but' if better else 'and'} not as promised"
    title = f"The touches agree {'better' if better else 'no better'} than before, {came}"
    files = [file_words(each.source.path) for each in (found.before, found.after)]
    counts = [
        data_words(each.source, each.measured.kind, len(each.measured))
        for each in (found.before, found.after)
    ]
    return doc.Page(
        kind="Verification",
        title=found.after.machine,
        number=identity.number,
        facts=doc.Facts(
            tuple(
                (when, doc.Given(f"{file} ({count})"))
                for when, file, count in zip(("Before", "After"), files, counts, strict=True)
            )
        ),
        notice=doc.Notice(tone, title, (f"r.m.s. {was} before, {promised} promised, {left} now.",)),
        sections=(
            doc.Section("Heights", (size,)),
            doc.Section("Parameters", (grid, *notes)),
        ),
    )


def _notes(found: Remeasured) -> list[str]:
    if all(each.entered is None for each in found.parameters):
        return ["The files do not say what was entered: a printer.cfg of each time would."]
    other = [each.name for each in found.parameters if not each.as_found]
    if not other:
        return ["Entered is what was found."]
    return [
        f"Entered was something else than found here: {', '.join(other)}. Endstops also move when a"
        " switch, the plate or the nozzle was changed."
    ]
