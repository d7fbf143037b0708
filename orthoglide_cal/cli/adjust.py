"""`orthocal adjust`: correct what a diagnosis names with its screw, live."""

from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import Text, Texts, argument, flag, option
from orthoglide_cal.cli.measure import saved_when_interrupted, show_on
from orthoglide_cal.errors import UnusableResultError, UsageError, command
from orthoglide_cal.words import Unit


def adjust(
    session: Annotated[str, argument("SESSION", "Session or readings that name the cause.")],
    cause: Annotated[
        Text, option("ID", "The cause to correct. Default: the first that a screw corrects.")
    ] = None,
    resume: Annotated[
        bool, flag("--resume", "Continue an adjustment at its next reading.")
    ] = False,
    gauge: Annotated[
        Texts,
        option("SOURCE", "Where readings come from: typed, or FORMAT:PORT as of measure."),
    ] = None,
    unit: Annotated[
        Unit, option(None, "Unit of readings typed without a unit. Default: mm.")
    ] = Unit.MM,
    machine: common.MachineFile = None,
    json: common.AsJson = False,
) -> None:
    """Correct a named cause with its screw or shim: how far, and which way, after each reading."""
    from orthoglide_cal.inference import diagnose
    from orthoglide_cal.planning.adjustment import choose_adjustments
    from orthoglide_cal.report.documents.adjustment import adjustment_document
    from orthoglide_cal.session.adjusting import open_adjustments
    from orthoglide_cal.session.asking import Asker
    from orthoglide_cal.session.keyboard import Keyboard
    from orthoglide_cal.session.opening import Request

    if session == "-":
        raise UsageError("adjust needs a file; standard input is the keyboard.", "Name the file.")
    given = common.read_input(session, machine)
    diagnosis = diagnose(given.measured, given.model)
    id, adjustments = choose_adjustments(diagnosis, cause)
    sha256 = given.measured.source.sha256
    if given.keeper and given.keeper.model.machine.entered_from(sha256):
        what = f"The offsets of {session} were entered since: the machine is another one now."
        raise UnusableResultError(what, "Measure again, then adjust by the new session.")
    aside = common.console(stderr=True)
    show = show_on(aside if json else common.console(), aside)
    options = f"--cause {id}"
    with ExitStack() as left, saved_when_interrupted("adjust", options) as running:
        with closing(Keyboard()) as keyboard:
            request = Request(resume=resume, source=tuple(gauge or ()), unit=unit)
            asker = Asker(keyboard, show)
            dialogue = open_adjustments(Path(session), diagnosis, id, adjustments, request, asker)
            left.callback(dialogue.close)
            running.append(dialogue)
            dialogue.greet()
            dialogue.run()
        answer = dialogue.answer(given)
        document = adjustment_document(answer, command("verify", session, "AFTER"))
        common.deliver(document, as_json=json)
        if answer.failed:
            raise typer.Exit(UnusableResultError.exit_code)
