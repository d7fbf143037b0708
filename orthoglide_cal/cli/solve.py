"""`orthocal solve`: from readings to joint offsets."""

from __future__ import annotations

from typing import Annotated

import typer

from orthoglide_cal.cli.common import (
    AsJson,
    Files,
    MachineFile,
    NoColour,
    for_each,
    output,
    print_json,
    read_input,
)


def solve(
    files: Files,
    machine: MachineFile = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="single, single-sequential, six-linear, twelve-linear, six, twelve or readings;"
            " without it the best one for the data.",
            show_default=False,
        ),
    ] = None,
    json: AsJson = False,
    no_colour: NoColour = False,
) -> None:
    """Find the joint offsets, how sure they are, and whether the model fits."""
    from orthoglide_cal import estimation
    from orthoglide_cal.causes import machine_effects

    def judge(path: str) -> None:
        measured, judged_by = read_input(path, machine)
        solution = estimation.solve(measured, judged_by, method, machine_effects(judged_by))
        if json:
            from orthoglide_cal.report.solve_json import as_json

            print_json(as_json(solution))
        else:
            from orthoglide_cal.report.solve_text import render

            output().print(render(solution, judged_by, machine))

    for_each(files, judge, as_json=json)
