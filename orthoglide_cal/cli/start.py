"""`orthocal` alone: what lies in this folder, and what to type next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.errors import OrthocalError, command

# So many characters of a digest are surely printed together.
_DIGEST = 8

if TYPE_CHECKING:
    from orthoglide_cal.files import FoundSession
    from orthoglide_cal.model import Machine, Model
    from orthoglide_cal.report import document as doc


def start() -> None:
    """Show the machine, the sessions and the next command; nothing is changed."""
    from orthoglide_cal.files import machine_in_folder, printers_in, sessions_in
    from orthoglide_cal.report import document as doc
    from orthoglide_cal.results import unwritten
    from orthoglide_cal.session import unfinished

    here, to = Path(), None
    model, sessions, waiting = None, sessions_in(here), unfinished(here)
    printers = printers_in(here)
    try:
        path = machine_in_folder(here)
        known = "none in this folder" if path is None else str(path)
        if path:
            file = common.read_machine_file(path)
            model, to = file.model, unwritten(file)
            known += f": {model.machine.name}, {model.machine.geometry_words}"
    except OrthocalError as error:
        known = str(error)
    facts: list[tuple[str, doc.Blank]] = [("Machine file", doc.Given(known))]
    facts += [("Unfinished", doc.Given(path.name)) for path in waiting]
    if printers:
        facts.append(("Printer", doc.Given(", ".join(map(str, printers)))))
    if sessions:
        others = f", and {len(sessions) - 1} before it" if len(sessions) > 1 else ""
        facts.append(("Last session", doc.Given(f"{sessions[-1].path}{others}")))
    title = "calibration of an Orthoglide with a dial indicator"
    if printers and not sessions:
        title = "calibration of a linear delta by its own probe"
    section = _next(model, sessions, waiting, printers)
    if model and to:
        said = f"{path} records a change of {to}, which was not written."
        of = _applied(model.machine, sessions) or "SESSION"
        steps = (
            doc.Instruction("Write it", command("apply", of, options=f"--to {to}")),
            doc.Instruction("Or take it back", command("apply", options=f"--undo --to {to}")),
        )
        section = doc.Section("Next", (doc.Paragraph(said), doc.Instructions(steps)))
    page = doc.Page("orthocal", title, facts=doc.Facts(tuple(facts)), sections=(section,))
    common.deliver(doc.Document(dict, lambda: page))
    common.tell("All commands: orthocal --help")


def _next(
    model: Model | None, sessions: list[FoundSession], waiting: list[Path], printers: list[Path]
) -> doc.Section:
    """What comes next in the round: machine, measure, enter, measure again, verify, report."""
    from orthoglide_cal.report.document import Instruction, Instructions, Section

    steps: tuple[Instruction, ...]
    if waiting:
        name = str(waiting[0].with_suffix(".yaml"))
        steps = (Instruction("Continue measuring", command("measure", name, options="--resume")),)
    elif sessions:
        return _after(model.machine if model else None, sessions)
    elif model.machine.probes if model else printers:
        printer = str(printers[-1]) if printers else "printer.cfg"
        mesh = command("diagnose", printer, options="--data mesh")
        steps = (
            Instruction("How to probe it, and what to bring", "orthocal guide delta"),
            Instruction("See the parameters", command("solve", printer)),
            Instruction("Check the model", mesh),
        )
    else:
        practice = command("measure", "practice.yaml", options="--gauge simulated")
        steps = (
            *(() if model else (Instruction("Say what machine it is", "orthocal machine new"),)),
            Instruction("Measure", command("measure")),
            Instruction("Or try it without a gauge", practice),
        )
    return Section("Next", (Instructions(steps),))


def _after(machine: Machine | None, sessions: list[FoundSession]) -> doc.Section:
    """What the last session asks for: its own steps, or those after the offsets were entered."""
    from orthoglide_cal.files import read_input
    from orthoglide_cal.report.case import Case, decision_notice, measure_again, to_do
    from orthoglide_cal.report.document import Instruction, Instructions, Paragraph, Section
    from orthoglide_cal.results import answer_to

    last, applied = str(sessions[-1].path), _applied(machine, sessions)
    stays = [Instruction("Check whether the machine has changed", "orthocal history .")]
    stays = stays if len(sessions) > 1 else []
    try:
        if applied == last:
            again = measure_again(read_input(last).conditions)
            steps = [Instruction("Its offsets are entered: measure again", again)]
        elif applied:
            if _reported(applied, last):
                told = "Nothing more to do: measured, entered, measured again and reported."
                return Section(None, (Paragraph(told), Instructions(tuple(stays))))
            write = command("report", applied, options=f"--after {last} --html report.html")
            steps = [
                Instruction("Compare with the prediction", command("verify", applied, last)),
                Instruction("Write the report", write),
            ]
        else:
            given = common.read_input(last)
            case = Case(given, answer_to(given))
            more = Instruction("See the numbers", case.typed("solve"))
            steps = [more, *to_do(case, brief=True), *stays]
            return Section("Next", (decision_notice(case), Instructions(tuple(steps))))
    except OrthocalError as error:
        steps = [Instruction(str(error), command("validate", last))]
    return Section("Next", (Instructions((*steps, *stays)),))


def _applied(machine: Machine | None, sessions: list[FoundSession]) -> str | None:
    """The session of this folder whose offsets were entered last."""
    from orthoglide_cal.files.text import read_document

    entered = machine.history[-1].data_sha256 if machine and machine.history else None
    paths = [str(each.path) for each in reversed(sessions)] if entered else []
    return next((path for path in paths if read_document(path).sha256 == entered), None)


def _reported(*sessions: str) -> bool:
    """Whether a page in this folder is about these sessions: it holds their digests."""
    from orthoglide_cal.files.text import read_document
    from orthoglide_cal.report.document import MARK

    digests = [read_document(path).sha256[:_DIGEST] for path in sessions]
    pages = (path.read_text("utf-8", "replace") for path in sorted(Path().glob("*.[hm][td]*")))
    return any(page.endswith(MARK) and all(digest in page for digest in digests) for page in pages)
