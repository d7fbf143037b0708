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
    from orthoglide_cal.report import solve_json, solve_text

    def judge(path: str) -> None:
        measured, nominal = read_input(path, machine)
        solution = estimation.solve(measured, nominal, method)
        if json:
            print_json(solve_json.as_json(solution))
        else:
            output().print(solve_text.render(solution, nominal))

    for_each(files, judge, as_json=json)
