"""`orthocal` alone: what lies in this folder, and what to type next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.errors import OrthocalError, command

if TYPE_CHECKING:
    from orthoglide_cal.files import FoundSession
    from orthoglide_cal.model import Machine, Model
    from orthoglide_cal.report import document as doc


def start() -> None:
    """Show the machine, the sessions and the next command; nothing is changed."""
    from orthoglide_cal.files import machine_in_folder, printers_in, sessions_in
    from orthoglide_cal.report import document as doc
    from orthoglide_cal.session import unfinished

    here = Path()
    model, sessions, waiting = None, sessions_in(here), unfinished(here)
    printers = printers_in(here)
    try:
        path = machine_in_folder(here)
        known = "none in this folder" if path is None else str(path)
        if path:
            model = common.read_machine_file(path).model
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
    steps = doc.Instructions(_next(model, sessions, waiting, printers))
    section = doc.Section("What to type next", (steps,))
    page = doc.Page("orthocal", title, facts=doc.Facts(tuple(facts)), sections=(section,))
    common.deliver(doc.Document(dict, lambda: page))
    common.tell("All commands: orthocal --help")


def _next(
    model: Model | None, sessions: list[FoundSession], waiting: list[Path], printers: list[Path]
) -> tuple[doc.Instruction, ...]:
    """What comes next in the round: machine, measure, solve, apply, measure again, verify."""
    from orthoglide_cal.files import read_input
    from orthoglide_cal.report.case import measure_again
    from orthoglide_cal.report.document import Instruction

    if waiting:
        name = str(waiting[0].with_suffix(".yaml"))
        return (Instruction("Go on measuring.", command("measure", name, options="--resume")),)
    if not sessions:
        if model.machine.probes if model else printers:
            printer = str(printers[-1]) if printers else "printer.cfg"
            mesh = command("diagnose", printer, options="--data mesh")
            return (
                Instruction("How to probe it, and what to bring.", "orthocal guide delta"),
                Instruction("See the parameters.", command("solve", printer)),
                Instruction("Ask whether the model is right.", mesh),
            )
        first = () if model else (Instruction("Say what machine it is.", "orthocal machine new"),)
        practice = command("measure", "practice.yaml", options="--gauge simulated")
        return (
            *first,
            Instruction("Measure.", command("measure")),
            Instruction("Or try it without a gauge.", practice),
        )
    last = str(sessions[-1].path)
    applied = _applied(model.machine if model else None, sessions)
    if applied == last:
        again = measure_again(read_input(last).conditions)
        return (Instruction("Its offsets are entered: measure again.", again),)
    if applied:
        return (
            Instruction("Compare with what was promised.", command("verify", applied, last)),
            Instruction("Print the sheet.", command("report", applied, options=f"--after {last}")),
        )
    record = Instruction("Record that they are in the controller.", command("apply", last))
    return (
        Instruction("See the offsets.", command("solve", last)),
        Instruction("Ask whether the model is right.", command("diagnose", last)),
        *([record] if model else []),
    )


def _applied(machine: Machine | None, sessions: list[FoundSession]) -> str | None:
    """The session of this folder whose offsets were entered last."""
    from orthoglide_cal.files.text import read_document

    entered = machine.history[-1].data_sha256 if machine and machine.history else None
    paths = [str(each.path) for each in reversed(sessions)] if entered else []
    return next((path for path in paths if read_document(path).sha256 == entered), None)
