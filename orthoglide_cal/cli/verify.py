"""`orthocal verify`: what was promised, and what came true."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UsageError

if TYPE_CHECKING:
    from orthoglide_cal.report.document import Document


def verify(
    before: Annotated[
        str,
        typer.Argument(
            metavar="BEFORE", help=f"Measured before the correction. {common.MEASURED}."
        ),
    ],
    after: Annotated[
        str, typer.Argument(metavar="AFTER", help="Measured after it, with the same protocol.")
    ],
    applied: Annotated[
        common.Offsets | None,
        common.option(
            metavar="DX DY DZ",
            help="What was added to the controller's offsets between the two [mm]; without it"
            " what the sessions or the machine file record.",
        ),
    ] = None,
    limit: common.Limit = None,
    machine: common.MachineFile = None,
    data: common.Data = None,
    html: common.HtmlFile = None,
    markdown: common.MarkdownFile = None,
    json: common.AsJson = False,
    overwrite: common.Overwrite = False,
    no_colour: common.NoColour = False,
) -> None:
    """Compare what a correction promised with what came true."""
    from orthoglide_cal import verification
    from orthoglide_cal.model import View
    from orthoglide_cal.report.documents.remeasured import remeasured_document
    from orthoglide_cal.report.documents.verification import verification_document
    from orthoglide_cal.results import identify

    def judge(path: str) -> None:
        inputs = common.read_input(path, machine, data), common.read_input(after, machine, data)
        document: Document
        if View.BED in {each.measured.view for each in inputs}:
            _refuse(applied, limit)
            touched = verification.remeasure(*inputs)
            document = remeasured_document(touched, identify(touched.inputs))
        else:
            found = verification.verify(*inputs, applied, limit, partial(common.entered, machine))
            document = verification_document(found, identify(found.inputs, *found.options))
        common.deliver(document, as_json=json, html=html, markdown=markdown, overwrite=overwrite)

    common.for_each([before], judge, as_json=json)


def _refuse(applied: common.Offsets | None, limit: float | None) -> None:
    """Options that say nothing of touches. Raises UsageError."""
    if applied is not None:
        raise UsageError(
            "--applied is for joint offsets; a printer's own file says what it was given.",
            "Leave it out, and name a printer.cfg of each time.",
        )
    if limit is not None:
        raise UsageError("--limit is for differences of readings.", "Leave it out.")
