"""`orthocal apply`: what goes into the controller, written there if wanted, and recorded."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Text, Texts, argument, flag, option
from orthoglide_cal.errors import UsageError


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
    from orthoglide_cal.files.moonraker import restart
    from orthoglide_cal.files.printer_file import PrinterFile
    from orthoglide_cal.report.documents.short import application_document
    from orthoglide_cal.report.sentences import sentence
    from orthoglide_cal.results.application import apply as application
    from orthoglide_cal.results.application import file_to_record_in, take_back
    from orthoglide_cal.schema import Reason
    from orthoglide_cal.session.adjusting import check_not_adjusted

    if session is None and not undo:
        raise UsageError("It is not clear which offsets were entered.", "Name the session.")
    agrees = common.agreement(yes, "`apply` asks before it changes anything.")
    controller = controller_file(to) if to else None
    # A printer's own settings are no place to record anything.
    read = common.known_machine(machine) if str(machine) != "-" else None
    known = None if isinstance(read, PrinterFile) else machine
    known = known or (machine_of_controller(Path(), controller) if controller else None)
    if undo:
        file = common.own_machine_file(known)
        sha256 = read_input(session, file.model).measured.source.sha256 if session else None
        entry = take_back(file, sha256, controller)
    else:
        keeper = common.own_machine_file(known) if known else None
        given = common.read_input(session or "", machine, data, rule_out)
        keeper = keeper if known or to else given.keeper
        file = file_to_record_in(given, keeper, controller) or common.own_machine_file(None)
        if machine and machine != known:  # it is judged later by what is recorded
            given = replace(given, machine_file=Path(file.document.path))
        check_not_adjusted(given)
        corrects = controller.corrects(given.model.machine) if controller else ()
        case = common.judged(given, corrects=corrects)
        case.require_usable()
        entry = application(given, case.answer, file, datetime.now().astimezone(), controller)
    document, target = application_document(entry), entry.file.document.path
    if entry.changes:
        entry.check_writable()
        if not json:
            common.deliver(document)
        if entry.running:
            common.tell(entry.running)
        action = "Take them back" if undo else "Record them"
        question = f"Does the controller hold these values now? {action} in {target}?"
        if entry.controller:
            question = f"Write this to {entry.controller.target}, and record it in {target}?"
        if not agrees(question):
            common.tell("Nothing was changed.")
            return
        entry.write()
    if json:
        common.deliver(document, as_json=True)
    if not entry.changes:
        common.tell(f"{sentence(Reason.of('nothing_to_enter'))} Nothing was changed.")
        return
    controlled = f" and {entry.controller.target}" if entry.controller else ""
    common.tell(f"{'Taken back' if undo else 'Recorded'} in {target}{controlled}.")
    question = "A LinuxCNC that holds the same offsets runs on this computer. Set them there,"
    if entry.live and agrees(f"{question} too, so that homing again is enough?"):
        entry.set_live()
        common.tell("The running LinuxCNC has the offsets, too: homing again is enough.")
    elif entry.live:
        common.tell("Restart LinuxCNC, then home: it reads its INI only when it starts.")
    question = "The firmware reads its file when it starts. Restart it now?"
    if entry.address and agrees(question):
        restart(entry.address)
        common.tell("The firmware restarts. Home (G28) and probe a new mesh.")
