"""`orthocal apply`: what goes into the controller, written there if wanted, and recorded."""

from datetime import datetime
from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Text, Texts, argument, flag, option
from orthoglide_cal.cli.export import released
from orthoglide_cal.errors import InputError, UsageError, command


def apply(
    session: Text = argument(
        "SESSION", "Session or readings whose offsets are entered. Not needed for --undo."
    ),
    machine: File = option(
        "FILE", "Machine file to record it in. Default: the one in this folder."
    ),
    to: Text = option(
        "CONTROLLER",
        "Also write them to the controller: LinuxCNC's INI, Klipper's printer.cfg, or"
        " http://HOST[:PORT] of a Moonraker server.",
    ),
    data: common.Data = common.DATA,
    rule_out: Texts = common.RULE_OUT,
    yes: bool = flag("--yes", "Answer yes to every question."),
    undo: bool = flag(
        "--undo", "Take the last entry back. With --to also restore the controller's file."
    ),
    json: bool = common.JSON,
) -> None:
    """Record what was entered in the controller, or enter it (--to)."""
    from orthoglide_cal.files.controller_file import controller_file
    from orthoglide_cal.files.input import machine_of_controller, read_input
    from orthoglide_cal.files.linuxcnc import is_live, running
    from orthoglide_cal.files.machine_file import new_machine_file
    from orthoglide_cal.files.moonraker import restart, server
    from orthoglide_cal.files.text import check_writable
    from orthoglide_cal.report.documents.short import application_document
    from orthoglide_cal.report.sentences import sentence
    from orthoglide_cal.results import apply as application
    from orthoglide_cal.results import recording, take_back
    from orthoglide_cal.results.application import check_measured
    from orthoglide_cal.schema import Reason
    from orthoglide_cal.session.adjusting import check_not_adjusted

    if session is None and not undo:
        raise UsageError("It is not clear which offsets were entered.", "Name the session.")
    agrees = common.agreement(yes, "`apply` asks before it changes anything.")
    path, controller = session or "", controller_file(to) if to else None
    known = machine or (machine_of_controller(Path(), controller) if controller else None)
    file = common.own_machine_file(known) if known or undo or not to else None
    if undo and file:
        sha256 = read_input(path, file.model).measured.source.sha256 if path else None
        entry = take_back(file, sha256, controller)
    else:
        given = common.read_input(path, machine, data, rule_out)
        measured_on = given.model.machine
        if recording(given) == "elsewhere":
            if controller is None:
                options = f"--format {measured_on.controller_formats[0]}"
                shown = command("export", path, machine=machine, options=options)
                written = command("apply", path, machine=machine, options="--to printer.cfg")
                fault = "Its firmware keeps what it is given; nothing is recorded here."
                raise UsageError(fault, f"See what to give it: {shown}\nOr write it: {written}")
            file = file or new_machine_file(given.model, controller.target)  # it needs none
        file = file or common.own_machine_file(None)
        check_measured(given, None if to else file)
        check_not_adjusted(given)
        corrects = controller.corrects(measured_on) if controller else ()
        answer = released(common.judged(given, corrects=corrects)).answer
        entry = application(given, answer, file, datetime.now().astimezone(), controller)
    controller, target = entry.controller, entry.file.document.path
    otherwise = running(controller) if controller else None
    live = otherwise == "" and not entry.tables
    document = application_document(entry, live)
    if entry.changes:
        for written in (target, *([controller.target] if controller else [])):
            if not server(written):
                check_writable(Path(written).resolve())
        if not json:
            common.deliver(document)
        if otherwise:
            common.tell(otherwise)
        action = "Take them back" if undo else "Record them"
        question = f"Does the controller hold these values now? {action} in {target}"
        if controller:
            question = f"Write this to {controller.target}, and record it in {target}"
        if not agrees(question):
            common.tell("Nothing was changed.")
            return
        entry.write()
    if json:
        common.deliver(document, as_json=True)
    if not entry.changes:
        common.tell(f"{sentence(Reason.of('nothing_to_enter'))} Nothing was changed.")
        return
    common.tell(f"{'Taken back' if undo else 'Recorded'} in {target}.")
    if controller and live:
        question = "A LinuxCNC that holds the same offsets runs on this computer. Set them there,"
        if not agrees(f"{question} too, so that homing again is enough"):
            common.tell("Restart LinuxCNC, then home: it reads its INI only when it starts.")
        elif is_live(controller_file(controller.target), anew=True):
            common.tell("The running LinuxCNC has the offsets, too: homing again is enough.")
        else:
            problem = "The running LinuxCNC does not take the offsets; its INI holds them."
            raise InputError(problem, "Restart LinuxCNC, then home.")
    question = "The firmware reads its file when it starts. Restart it now"
    if controller and server(controller.target) and agrees(question):
        restart(controller.target)
        common.tell("The firmware restarts. Home (G28) and probe a new mesh.")
