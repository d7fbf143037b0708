"""`orthocal report`: the result in the hands of the people who need it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, Text, argument, option
from orthoglide_cal.errors import UnusableResultError, UsageError


def report(
    file: Annotated[
        Text,
        argument(
            "FILE",
            f"{MEASURED}; without it the latest session in this folder; - is standard input.",
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
        Text,
        option("FILE", "Measured after the adjustment: shown as left, compared with the promise."),
    ] = None,
    applied: common.Applied = None,
    limit: common.Limit = None,
    no_colour: common.NoColour = False,
) -> None:
    """Write the calibration report."""
    from orthoglide_cal.files import latest_session
    from orthoglide_cal.report.case import Case, about
    from orthoglide_cal.report.documents.calibration import calibration_document
    from orthoglide_cal.results import answer_to, identify
    from orthoglide_cal.results.verification import verify

    for name, value in (("--applied", applied), ("--limit", limit)):
        if after is None and value is not None:
            raise UsageError(f"{name} goes with --after.", "Name the later readings.")

    def judge(path: str) -> int:
        given, verification = common.read_input(path, machine, data), None
        if after is not None:
            later = common.read_input(after, machine, data)
            if given.model.machine.probes or later.model.machine.probes:
                compare = about("verify", given.measured.source, after, machine=machine)
                raise UsageError(
                    "A report of a printer is of one file.", f"Compare them: {compare}"
                )
            verification = verify(given, later, applied, limit)
        found = answer_to(given, method, details=True)
        others, options = (verification.inputs, verification.options) if verification else ((), ())
        own = given.measured.source, given.model
        identity = identify([own, *others], found.method, *options)
        document = calibration_document(Case(given, found, machine), identity, verification)
        common.deliver(document, as_json=json, html=html, markdown=markdown, overwrite=overwrite)
        return 0 if found.release.usable else UnusableResultError.exit_code

    common.for_each([file or str(latest_session(Path()))], judge, as_json=json)
