"""`orthocal report`: the result in the hands of the people who need it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orthoglide_cal.cli.common import AsJson, MachineFile, NoColour, for_each, print_json
from orthoglide_cal.cli.documents import HtmlFile, MarkdownFile, Overwrite, deliver
from orthoglide_cal.errors import UsageError


def report(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE]",
            help="Readings, differences or a session; without it the latest session in this"
            " folder; - is standard input.",
            show_default=False,
        ),
    ] = None,
    machine: MachineFile = None,
    method: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Estimator, as for solve.", show_default=False),
    ] = None,
    html: HtmlFile = None,
    markdown: MarkdownFile = None,
    json: AsJson = False,
    overwrite: Overwrite = False,
    after: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Measured after the adjustment: shown as left, compared with the promise.",
            show_default=False,
        ),
    ] = None,
    applied: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="DX DY DZ",
            help="What was added to the controller's offsets before --after [mm].",
            show_default=False,
        ),
    ] = None,
    limit: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Largest deviation allowed as left.", show_default=False),
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Instead: results of one machine over time, from the sessions in a folder.",
            show_default=False,
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Machine, if the folder holds several.", show_default=False
        ),
    ] = None,
    no_colour: NoColour = False,
) -> None:
    """Write the calibration report, or the history of a machine."""
    if after is None and (applied is not None or limit is not None):
        raise UsageError("--applied and --limit go with --after.", "Name the later readings.")
    if history is not None:
        if file is not None or after is not None:
            raise UsageError("--history takes a folder instead of a file.", "Give one of the two.")
        _history(history, name, html, markdown, json, overwrite)
        return

    def judge(path: str) -> int | None:
        from orthoglide_cal import outcome
        from orthoglide_cal.data import read_machine
        from orthoglide_cal.outcome.pairing import verify_cases

        judged_by = read_machine(machine) if machine else None
        case = outcome.read_case(path, judged_by)
        verification = (
            verify_cases(case, outcome.read_case(after, judged_by), applied, limit)
            if after is not None
            else None
        )
        found = outcome.calibrate(case, method, verification=verification)
        if json:
            from orthoglide_cal.report.calibration_json import as_json

            print_json(as_json(found))
        else:
            from orthoglide_cal.report.calibration_report import calibration_report

            deliver(calibration_report(found), html, markdown, overwrite)
        return 4 if found.findings is None else None

    for_each([file or _latest()], judge, as_json=json)


def _latest() -> str:
    from orthoglide_cal.outcome import latest_session

    return str(latest_session(Path()))


def _history(
    folder: Path,
    name: str | None,
    html: Path | None,
    markdown: Path | None,
    json: bool,
    overwrite: bool,
) -> None:
    from orthoglide_cal import outcome

    found = outcome.history(folder, name)
    if json:
        from orthoglide_cal.report.history_json import as_json

        print_json(as_json(found))
    else:
        from orthoglide_cal.report.history_report import history_report

        identity = outcome.identify(" ".join(entry.path for entry in found.entries))
        deliver(history_report(found, identity), html, markdown, overwrite)
