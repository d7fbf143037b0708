"""`orthocal adjust`: correct a named cause with its screw, live."""

from functools import partial

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Text, Texts, argument, flag, option
from orthoglide_cal.cli.measure import guided
from orthoglide_cal.errors import UnusableResultError, UsageError, command


def adjust(
    session: str = argument("SESSION", "Session or readings that name the cause.", required=True),
    cause: Text = option(
        "ID", "The cause, or home_switch: offsets. Default: the first with a screw."
    ),
    resume: bool = flag("--resume", "Continue an adjustment at its next reading."),
    gauge: Texts = option(
        "SOURCE", "Where readings come from: typed, or FORMAT:PORT as for measure."
    ),
    machine: File = common.MACHINE,
    json: bool = common.JSON,
) -> int:
    """Correct a named cause with its screw or shim: which way, and how far, after each reading."""
    from orthoglide_cal.causes import HOME_SWITCH
    from orthoglide_cal.files.input import InputFile
    from orthoglide_cal.inference.diagnose import diagnose
    from orthoglide_cal.planning.adjustment import choose_adjustments
    from orthoglide_cal.report.documents.short import adjustment_document
    from orthoglide_cal.results.answer import MachineName
    from orthoglide_cal.session.adjusting import AdjustmentAnswer, open_adjustments

    if session == "-":
        raise UsageError("adjust needs a file; standard input is the keyboard.", "Name the file.")
    given = common.read_input(session, machine)
    known = given.model.machine
    if given.keeper and given.keeper.model.machine.entered_from(given.measured.source.sha256):
        fault = f"The offsets of {session} were entered: its readings are out of date."
        raise UnusableResultError(fault, "Measure again, then adjust by the new session.")
    diagnosis = diagnose(given.measured, given.model)
    if cause == HOME_SWITCH.id:
        if HOME_SWITCH.usual(known) is None:
            fault = "The printer's firmware holds the endstops as numbers: no switch is moved."
            raise UsageError(fault, f"See them: {command('solve', session, machine=machine)}")
        common.judged(given, diagnosed=diagnosis).require_usable()
    id, adjustments = choose_adjustments(diagnosis, cause, machine)
    if given.measured.source.simulated:
        common.tell("These readings were simulated: this is for practice. Loosen nothing.")
    begin = partial(open_adjustments, given, id, adjustments, tuple(gauge or ()), resume)
    with guided(begin, "adjust", json, machine, f"--cause {id}") as dialogue:
        answer = AdjustmentAnswer(
            input=InputFile.of(given),
            machine=MachineName(name=known.name, kind=known.kind),
            cause=id,
            adjustments=dialogue.adjusted,
        )
        common.deliver(adjustment_document(answer, given), as_json=json)
        return UnusableResultError.exit_code if answer.failed else 0
