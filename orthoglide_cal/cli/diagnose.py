"""`orthocal diagnose`: what the simulation gets wrong, by which cause, and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orthoglide_cal.cli.common import (
    AsJson,
    Files,
    MachineFile,
    NoColour,
    for_each,
    messages,
    output,
    print_json,
    read_input,
)
from orthoglide_cal.errors import UsageError


def diagnose(
    files: Files,
    machine: MachineFile = None,
    holdout: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Later readings that no fit may see.", show_default=False
        ),
    ] = None,
    applied: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="DX DY DZ",
            help="Offsets entered in the controller before the held-out readings [mm].",
        ),
    ] = (0.0, 0.0, 0.0),
    accept: Annotated[
        str | None,
        typer.Option(
            metavar="CAUSE",
            help="Make this cause part of the machine, in a new machine file.",
            show_default=False,
        ),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(
            "--output",
            metavar="FILE",
            help="The new machine file of --accept; never overwritten.",
            show_default=False,
        ),
    ] = None,
    json: AsJson = False,
    no_colour: NoColour = False,
) -> None:
    """Name what the model leaves out, how sure that is, and what it gains to know it."""
    import numpy as np

    from orthoglide_cal import diagnosis
    from orthoglide_cal.causes import machine_effects
    from orthoglide_cal.report.diagnose_json import as_json
    from orthoglide_cal.report.diagnose_text import render

    if applied != (0.0, 0.0, 0.0) and holdout is None:
        raise UsageError("--applied goes with --holdout.", "Name the later readings.")
    if accept is not None and len(files) != 1:
        raise UsageError("--accept goes with one file.", "Name the readings to identify it from.")
    if to is not None and accept is None:
        raise UsageError("--output goes with --accept.", "Name the cause to accept.")

    def judge(path: str) -> None:
        measured, judged_by = read_input(path, machine)
        later = read_input(holdout, machine)[0] if holdout else None
        found = diagnosis.diagnose(
            measured,
            judged_by,
            machine_effects(judged_by),
            holdout=later,
            applied=np.array(applied),
            sensitivity=not json,
        )
        if json:
            print_json(as_json(found))
        else:
            output().print(render(found, measured, judged_by, held_out_file=holdout is not None))
        if accept is not None:
            _accept(path, machine, accept, to)

    for_each(files, judge, as_json=json)


def _accept(path: str, machine: Path | None, accept: str, to: Path | None) -> None:
    from datetime import date

    from orthoglide_cal import data, diagnosis
    from orthoglide_cal.causes import machine_effects

    measured, known = read_input(path, machine)
    extended = diagnosis.extend(measured, known, machine_effects(known), accept, date.today())
    stem = machine.stem if machine else "machine"
    target = to or Path(f"{stem}-{accept}.yaml")
    data.write_machine(extended, target)
    messages().print(f"{accept} is now part of {target}; use it with --machine {target}.")
