"""`orthocal verify`: what was promised, and what came true."""

from __future__ import annotations

from typing import Annotated

import typer

from orthoglide_cal.cli.common import AsJson, MachineFile, NoColour, for_each, print_json
from orthoglide_cal.cli.documents import HtmlFile, MarkdownFile, Overwrite, deliver


def verify(
    before: Annotated[
        str,
        typer.Argument(metavar="BEFORE", help="Measured before the offsets were entered."),
    ],
    after: Annotated[
        str,
        typer.Argument(metavar="AFTER", help="Measured after it, with the same protocol."),
    ],
    applied: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="DX DY DZ",
            help="What was added to the controller's offsets between the two [mm]; without it"
            " the difference that two sessions record.",
            show_default=False,
        ),
    ] = None,
    limit: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Largest deviation allowed in any difference: pass, fail or undecided.",
            show_default=False,
        ),
    ] = None,
    machine: MachineFile = None,
    html: HtmlFile = None,
    markdown: MarkdownFile = None,
    json: AsJson = False,
    overwrite: Overwrite = False,
    no_colour: NoColour = False,
) -> None:
    """Compare what a correction promised with what came true."""

    def judge(path: str) -> None:
        from orthoglide_cal.data import read_machine
        from orthoglide_cal.outcome import identify, read_case
        from orthoglide_cal.outcome.pairing import verify_cases

        judged_by = read_machine(machine) if machine else None
        first, second = read_case(path, judged_by), read_case(after, judged_by)
        found = verify_cases(first, second, applied, limit)
        if json:
            from orthoglide_cal.report.verification_json import as_json

            print_json(as_json(found))
            return
        from orthoglide_cal.report.verification_report import verification_report

        identity = identify(found.before.sha256 + found.after.sha256)
        document = verification_report(found, identity.number, identity.issued, identity.software)
        deliver(document, html, markdown, overwrite)

    for_each([before], judge, as_json=json)
