"""`orthocal diagnose`: what the simulation gets wrong, by which cause, and what to do."""

from __future__ import annotations

import math
from datetime import date
from pathlib import Path
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
    tell,
    tell_error,
)
from orthoglide_cal.errors import OrthocalError, UsageError


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

    from orthoglide_cal import data, diagnosis
    from orthoglide_cal.causes import machine_effects

    _check_options(files, holdout, applied, accept, to)

    def judge(path: str) -> int:
        measured, judged_by = read_input(path, machine)
        effects = machine_effects(judged_by)
        later = data.read_measured(holdout, judged_by) if holdout else None
        found = diagnosis.diagnose(
            measured,
            judged_by,
            effects,
            holdout=later,
            applied=np.array(applied),
            sensitivity=not json,
        )
        if json:
            from orthoglide_cal.report.diagnose_json import as_json

            print_json(as_json(found))
        else:
            from orthoglide_cal.report.diagnose_text import render

            shown = render(found, measured, judged_by, machine, held_out_file=later is not None)
            output().print(shown)
        if accept is None:
            return 0
        stem = machine.stem if machine else "machine"
        target = to or Path(f"{stem}-{accept}.yaml")
        try:
            extended = diagnosis.extend(measured, judged_by, effects, accept, date.today())
            data.write_machine(extended, target)
        except OrthocalError as error:
            # The diagnosis stands; only the extension is refused.
            tell_error(error, path)
            return error.exit_code
        tell(f"{accept} is now part of {target}; use it with --machine {target}.")
        return 0

    for_each(files, judge, as_json=json)


def _check_options(
    files: list[str],
    holdout: str | None,
    applied: tuple[float, float, float],
    accept: str | None,
    to: Path | None,
) -> None:
    """Refuse options that do not go together. Raises UsageError."""
    from orthoglide_cal.causes import CAUSES

    if not all(map(math.isfinite, applied)):
        raise UsageError("--applied takes three lengths.", "Give millimetres.")
    if applied != (0.0, 0.0, 0.0) and holdout is None:
        raise UsageError("--applied goes with --holdout.", "Name the later readings.")
    if [*files, holdout].count("-") > 1 or (holdout == "-" and len(files) > 1):
        raise UsageError("Standard input can be read only once.", "Name a file instead.")
    if accept is not None and len(files) != 1:
        raise UsageError("--accept goes with one file.", "Name the readings to identify it from.")
    if to is not None and accept is None:
        raise UsageError("--output goes with --accept.", "Name the cause to accept.")
    if accept is not None and accept not in CAUSES:
        raise UsageError(f"There is no cause {accept!r}.", f"Choose one of {', '.join(CAUSES)}.")
