"""`orthocal diagnose`: what the simulation gets wrong, by which cause, and what to do."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Annotated

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Offsets, Text, option
from orthoglide_cal.errors import OrthocalError, UsageError


def diagnose(
    files: common.Files,
    machine: common.MachineFile = None,
    data: common.Data = None,
    holdout: Annotated[Text, option("FILE", "Later readings that no fit may see.")] = None,
    applied: Annotated[
        Offsets | None,
        option("DX DY DZ", "Offsets entered in the controller before the held-out readings [mm]."),
    ] = None,
    accept: Annotated[
        Text, option("CAUSE", "Make this cause part of the machine, in a new machine file.")
    ] = None,
    to: Annotated[
        File, option("FILE", "The new machine file of --accept; never overwritten.", "--output")
    ] = None,
    details: common.WithDetails = False,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Name what the model leaves out, how sure that is, and what it gains to know it."""
    import numpy as np

    from orthoglide_cal import diagnosis
    from orthoglide_cal import files as written
    from orthoglide_cal.causes import CAUSES
    from orthoglide_cal.report.case import Case
    from orthoglide_cal.report.documents.diagnosis import diagnosis_document
    from orthoglide_cal.results import answer_to

    if applied is not None and holdout is None:
        raise UsageError("--applied goes with --holdout.", "Name the later readings.")
    if [*files, holdout].count("-") > 1 or (holdout == "-" and len(files) > 1):
        raise UsageError("Standard input can be read only once.", "Name a file instead.")
    if accept is not None and len(files) != 1:
        raise UsageError("--accept goes with one file.", "Name the readings to identify it from.")
    if to is not None and accept is None:
        raise UsageError("--output goes with --accept.", "Name the cause to accept.")
    if accept is not None and accept not in CAUSES:
        raise UsageError(f"There is no cause {accept!r}.", f"Choose one of {', '.join(CAUSES)}.")
    full = details or json

    def judge(path: str) -> int:
        given = common.read_input(path, machine, data)
        later = written.read_input(holdout, given.model, stored=data) if holdout else None
        diagnosed = diagnosis.diagnose(
            given.measured,
            given.model,
            holdout=later.measured if later else None,
            applied=np.array(applied or (0.0, 0.0, 0.0)),
            then=later.model if later else None,
            sensitivity=full,
        )
        found = answer_to(given, diagnosed=diagnosed, holdout=holdout, details=full, promised=full)
        common.deliver(diagnosis_document(Case(given, found, machine)), as_json=json)
        if accept is None:
            return 0
        stem = machine.stem if machine else "machine"
        target = to or Path(f"{stem}-{accept}.yaml")
        try:
            diagnosed.require_recommended(accept)
            extended = diagnosis.extend(given.measured, given.model, accept, date.today())
            written.write_text(target, written.machine_text(extended))
        except OrthocalError as error:
            # The diagnosis stands; only the extension is refused.
            common.tell_error(error, path)
            return error.exit_code
        go_on = Case(given, found, target).typed("report")
        common.tell(f"{accept} is now part of {target}. Go on with:\n  {go_on}")
        return 0

    common.for_each(files, judge, as_json=json)
