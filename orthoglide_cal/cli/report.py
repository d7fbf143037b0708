"""`orthocal report`: the result in the hands of the people who need it."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UnusableResultError, UsageError


def report(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE]",
            help=f"{common.MEASURED}; without it the latest session in this folder; - is standard"
            " input.",
            show_default=False,
        ),
    ] = None,
    machine: common.MachineFile = None,
    data: common.Data = None,
    method: common.MethodName = None,
    html: common.HtmlFile = None,
    markdown: common.MarkdownFile = None,
    json: common.AsJson = False,
    overwrite: common.Overwrite = False,
    after: Annotated[
        str | None,
        common.option(
            metavar="FILE",
            help="Measured after the adjustment: shown as left, compared with the promise.",
        ),
    ] = None,
    applied: Annotated[
        common.Offsets | None,
        common.option(
            metavar="DX DY DZ",
            help="What was added to the controller's offsets before --after [mm]; without it what"
            " the sessions or the machine file record.",
        ),
    ] = None,
    limit: common.Limit = None,
    no_colour: common.NoColour = False,
) -> None:
    """Write the calibration report."""
    if after is None and applied is not None:
        raise UsageError("--applied goes with --after.", "Name the later readings.")
    if after is None and limit is not None:
        raise UsageError("--limit goes with --after.", "Name the later readings.")
    show = functools.partial(
        common.deliver, as_json=json, html=html, markdown=markdown, overwrite=overwrite
    )

    from orthoglide_cal.files import latest_session
    from orthoglide_cal.report.case import Case, about
    from orthoglide_cal.report.documents.calibration import calibration_document
    from orthoglide_cal.results import answer_to, identify
    from orthoglide_cal.results.verification import verify

    def judge(path: str) -> int:
        given, verification = common.read_input(path, machine, data), None
        if after is not None:
            later = common.read_input(after, machine, data)
            source = given.measured.source
            if given.model.machine.probes or later.model.machine.probes:
                raise UsageError(
                    "A report of a printer is of one file.",
                    f"Compare them: {about('verify', source, after, machine=machine)}",
                )
            known = functools.partial(common.entered, machine)
            verification = verify(given, later, applied, limit, known)
        found = answer_to(given, method, details=True)
        others, options = (verification.inputs, verification.options) if verification else ((), ())
        own = given.measured.source, given.model
        identity = identify([own, *others], found.method, *options)
        show(calibration_document(Case(given, found, machine), identity, verification))
        return 0 if found.release.usable else UnusableResultError.exit_code

    common.for_each([file or str(latest_session(Path()))], judge, as_json=json)
