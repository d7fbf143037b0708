"""`orthocal verify` and `orthocal history`: did a correction help; did the machine change?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, Number, Text, argument, option


def verify(
    before: Annotated[str, argument("BEFORE", f"Measured before the correction. {MEASURED}.")],
    after: Annotated[
        str, argument("AFTER", "Measured after the correction, with the same protocol.")
    ],
    applied: common.Applied = None,
    limit: common.Limit = None,
    machine: common.MachineFile = None,
    data: common.Data = None,
    html: common.HtmlFile = None,
    markdown: common.MarkdownFile = None,
    details: common.WithDetails = False,
    json: common.AsJson = False,
    overwrite: common.Overwrite = False,
) -> None:
    """Compare the predicted effect of a correction with the real one."""
    from orthoglide_cal.report.documents.verification import verification_document
    from orthoglide_cal.results import identify
    from orthoglide_cal.results.verification import verify as verified

    def judge(path: str) -> None:
        inputs = common.read_input(path, machine, data), common.read_input(after, machine, data)
        found = verified(*inputs, applied, limit)
        shown = verification_document(found, identify(found.inputs, *found.options))
        common.deliver(
            shown, as_json=json, html=html, markdown=markdown, details=details, overwrite=overwrite
        )

    common.for_each([before], judge, as_json=json)


def history(
    files: Annotated[
        list[str], argument("FILE", f"Sessions of one machine, or a folder. {MEASURED}.")
    ],
    limit: Annotated[
        Number, option("MM", "Largest permitted change. Shows when a drift reaches it.")
    ] = None,
    dates: Annotated[
        Text,
        option(
            "DATES",
            "Dates of the files, in their order: 2026-03-02,2026-04-07. Default: from the files.",
        ),
    ] = None,
    machine: common.MachineFile = None,
    data: common.Data = None,
    html: common.HtmlFile = None,
    markdown: common.MarkdownFile = None,
    details: common.WithDetails = False,
    json: common.AsJson = False,
    overwrite: common.Overwrite = False,
) -> None:
    """Show whether the machine changed between sessions."""
    from orthoglide_cal.files import printers_in, sessions_in
    from orthoglide_cal.report.documents.history import history_document
    from orthoglide_cal.results.history import compare

    def judge(_: str) -> None:
        paths: list[Path] = []
        for path in map(Path, files):
            within = [each.path for each in sessions_in(path)] if path.is_dir() else [path]
            paths += within + sorted(printers_in(path))
        inputs = [common.read_input(str(path), machine, data) for path in paths]
        found = compare(inputs, dates.split(",") if dates else (), limit)
        shown = history_document(found, machine)
        common.deliver(
            shown, as_json=json, html=html, markdown=markdown, details=details, overwrite=overwrite
        )

    common.for_each(files[:1], judge, as_json=json)
