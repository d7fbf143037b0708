"""`orthocal export`: the offsets for the controller, unless they must not be used."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from orthoglide_cal.cli.common import MachineFile, NoColour, for_each, tell
from orthoglide_cal.errors import UsageError


class Format(StrEnum):
    """What is written."""

    TEXT = "text"
    LINUXCNC = "linuxcnc"
    CSV = "csv"
    JSON = "json"
    YAML = "yaml"
    TABLE = "table"


def export(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Readings, differences or a session; - is standard input.",
            show_default=False,
        ),
    ],
    format: Annotated[
        Format,
        typer.Option(
            help="table: joint corrections over the workspace, for causes that were accepted.",
        ),
    ] = Format.TEXT,
    target: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write there instead of standard output; an existing file is not touched.",
            show_default=False,
        ),
    ] = None,
    machine: MachineFile = None,
    method: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Estimator, as for solve.", show_default=False),
    ] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Export what must not be used; it is marked as forced."),
    ] = False,
    points: Annotated[
        int, typer.Option(metavar="N", help="Points of the table along each edge of the cube.")
    ] = 7,
    json: Annotated[
        bool, typer.Option("--json", help="Short for --format json, errors included.")
    ] = False,
    no_colour: NoColour = False,
) -> None:
    """Write the new offsets for the controller, if they may be used."""
    from orthoglide_cal import outcome
    from orthoglide_cal.data import read_machine, write_text
    from orthoglide_cal.outcome.export import export as release
    from orthoglide_cal.report import snippets

    if json and format not in (Format.TEXT, Format.JSON):
        raise UsageError(f"--json does not go with --format {format}.", "Choose one of them.")
    wanted = Format.JSON if json else format

    def judge(path: str) -> None:
        case = outcome.read_case(path, read_machine(machine) if machine else None)
        released = release(outcome.calibrate(case, method), force)
        match wanted:
            case Format.TEXT:
                text = snippets.plain_text(released)
            case Format.LINUXCNC:
                text = snippets.linuxcnc(released)
            case Format.CSV:
                text = snippets.offsets_csv(released)
            case Format.JSON:
                text = snippets.as_json(released)
            case Format.YAML:
                text = snippets.as_yaml(released)
            case Format.TABLE:
                table = outcome.compensation(case.machine, points)
                text = snippets.compensation_csv(table, released)
        if released.forced:
            tell(f"FORCED: {' '.join(released.forced)}")
        if target is None:
            print(text, end="")
        else:
            write_text(target, text)
            tell(f"Joint offsets {released.identity.number} written to {target}")

    for_each([file], judge, as_json=json)
