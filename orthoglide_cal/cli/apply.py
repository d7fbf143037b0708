"""`orthocal apply`: what was entered in the controller, recorded in the machine file."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Text, argument, flag, option
from orthoglide_cal.cli.export import released
from orthoglide_cal.errors import UsageError, command

if TYPE_CHECKING:
    from orthoglide_cal.files import StoredMachine
    from orthoglide_cal.results import Application


def apply(
    session: Annotated[
        Text,
        argument(
            "SESSION", "The session, or table, whose offsets were entered; --undo needs none."
        ),
    ] = None,
    machine: Annotated[
        File,
        option(
            "FILE", "Machine file to record it in; without it the one in this folder.", "--machine"
        ),
    ] = None,
    yes: Annotated[bool, flag("--yes", "Do not ask.")] = False,
    undo: Annotated[
        bool, flag("--undo", "Take the last entry back: offsets and history as before it.")
    ] = False,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Record in the machine file that the offsets of a session are in the controller now."""
    from orthoglide_cal.files import read_input, read_machine_file, write_text
    from orthoglide_cal.report.documents.application import application_document
    from orthoglide_cal.results import take_back

    if session is None and not undo:
        raise UsageError("Nothing says which offsets were entered.", "Name the session.")
    if yes and undo:
        raise UsageError("--yes and --undo do not go together.", "Give one of them.")
    ask = not (yes or undo)
    if ask and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise UsageError("`apply` asks before it records anything.", "In a script, give --yes.")

    def judge(path: str) -> None:
        target = common.own_machine_file(machine)
        file = common.read_machine_file(target)
        if undo:
            source = read_input(path, file.model).measured.source if path else None
            found = take_back(file, source.sha256 if source else None)
        else:
            found = _entered(path, machine, file)
        document = application_document(found, path)
        if not json:
            common.deliver(document)
        if ask and not typer.confirm(
            f"Are these values in the controller now? Record them in {target}", err=True
        ):
            common.tell("Nothing was recorded.")
            return
        if read_machine_file(target).document.sha256 != file.document.sha256:
            raise UsageError(f"{target} was changed meanwhile.", "Give the command again.")
        write_text(target.resolve(), found.text, overwrite=True)
        if json:
            common.deliver(document, as_json=True)
        common.tell(f"{'Taken back' if undo else 'Recorded'} in {target}.")

    common.for_each([session or ""], judge, as_json=json)


def _entered(path: str, machine: Path | None, file: StoredMachine) -> Application:
    """The offsets of a session, if they may be used. Raises UsageError, UnusableResultError."""
    from orthoglide_cal.files import read_input
    from orthoglide_cal.results import apply as application

    known = file.model.machine
    if known.keeps_itself:
        options = f"--format {known.controller_formats[0]}"
        shown = command("export", path, machine=machine, options=options)
        raise UsageError(known.keeps_itself, f"See what to give it: {shown}")
    own = read_input(path)
    case = released(path, machine).case
    measured_on = own.model if own.is_session else None
    return application(case.given, case.answer, file, datetime.now().astimezone(), measured_on)
