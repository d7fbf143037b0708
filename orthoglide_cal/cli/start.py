"""`orthocal` alone: what lies in this folder, and what to type next."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.errors import InputError, OrthocalError, command

if TYPE_CHECKING:
    from orthoglide_cal.files.machine_file import StoredMachine
    from orthoglide_cal.model.machine import Machine
    from orthoglide_cal.report import document as doc


def start() -> None:
    """Show the machine, the sessions and the next command; nothing is changed."""
    from orthoglide_cal.files.input import printers_in, sessions_in
    from orthoglide_cal.model.linear_delta import LinearDelta
    from orthoglide_cal.model.orthoglide import Orthoglide
    from orthoglide_cal.report import document as doc
    from orthoglide_cal.results.application import unwritten
    from orthoglide_cal.session.dialogue import is_practice, unfinished

    here, file, machine, known, faulty = Path(), None, None, "none in this folder", ""
    try:
        if file := common.chosen_machine(None):
            machine = file.model.machine
            known = f"{file.document.path}: {machine.name}, {machine.geometry_words}"
    except OrthocalError as error:
        faulty = error.file if isinstance(error, InputError) and error.file else ""
        known = f"{faulty} cannot be used" if faulty else str(error)
    to = unwritten(file) if file else None
    sessions, printers = sessions_in(here, tables=True), printers_in(here)
    waiting, measured = unfinished(here), [*sessions]
    while measured and _simulated(measured[-1]):
        measured.pop()
    # Practice is the round only where it is meant to be, or where there is nothing else.
    practising = machine.practice if machine else not measured
    simulated = practising and len(measured) < len(sessions)
    sessions = sessions if practising else measured
    practices = [path for path in waiting if is_practice(path)]
    begun = [path for path in waiting if practising or path not in practices]
    others = f", and {len(sessions) - 1} before it" if len(sessions) > 1 else ""
    facts = {
        "Machine file": known,
        "Unfinished": ", ".join(f"{p.name}{' (practice)' * (p in practices)}" for p in waiting),
        "Printer": ", ".join(map(str, printers)),
        "Last measured": f"{sessions[-1]}{others}" if sessions else "",
    }
    kind = machine or (LinearDelta if printers and not sessions else Orthoglide)
    try:
        state, steps = list[doc.Block](), [doc.step("See its faults", command("validate", faulty))]
        if not faulty:
            state, steps = _next(file, kind, to, sessions, begun, printers)
    except OrthocalError as error:
        state, steps = [], [doc.step(str(error), command("validate", str(sessions[-1])))]
    for path in waiting:
        name = str(path.with_suffix(".yaml"))
        if path not in begun[:1]:  # the first to be continued is there
            continued = "Continue the practice" if path in practices else "Continue measuring"
            steps.append(doc.step(continued, command("measure", name, options="--resume")))
        steps.append(doc.step("Or give it up", command("measure", name, options="--discard")))
    if sum(path.suffix != ".csv" for path in sessions) > 1 and not (waiting or to):
        steps.append(doc.step("Check whether the machine has changed", "orthocal history ."))
    page = doc.Page(
        "orthocal",
        f"calibration of {kind.vocabulary.subject}",
        simulated=simulated,
        facts=doc.Facts([(name, doc.given(value)) for name, value in facts.items() if value]),
        sections=[doc.Section(None, *state), doc.next_steps(steps)],
    )
    common.deliver(doc.Document(dict, lambda: page))
    common.tell("All commands: orthocal --help")


def _next(
    file: "StoredMachine | None",
    kind: "Machine | type[Machine]",
    to: str | None,
    sessions: list[Path],
    waiting: list[Path],
    printers: list[Path],
) -> "tuple[list[doc.Block], list[doc.Line]]":
    """State, and steps that come next: machine, measure, enter, measure again, verify, report.

    `kind`: the machine, or what the files suggest. `to`: where a recorded change was not written.
    """
    from orthoglide_cal.files.input import read_input
    from orthoglide_cal.files.text import read_document
    from orthoglide_cal.report.case import measure_again
    from orthoglide_cal.report.document import step
    from orthoglide_cal.report.documents.answer import decision_notice, to_do

    paths, machine = [*map(str, sessions)], file.model.machine if file else None
    last = paths[-1] if paths else ""
    entry = machine.history[-1] if machine and machine.history else None
    # The session whose offsets were entered last.
    entered = (p for p in reversed(paths) if entry and read_document(p).sha256 == entry.data_sha256)
    applied = next(entered, None)
    if to and file:
        write = step("Write it", command("apply", applied or "SESSION", to=to))
        undo = step("Or take it back", command("apply", options="--undo", to=to))
        changed = f"{file.document.path} records a change of {to}, which was not written."
        return [changed], [write, undo]
    if waiting:
        name = str(waiting[0].with_suffix(".yaml"))
        return [], [step("Continue measuring", command("measure", name, options="--resume"))]
    if not sessions:
        begin = []
        if not (machine or printers):
            begin.append(step("Describe the machine", "orthocal machine new"))
        practising = machine and machine.practice
        for text, verb, usual in kind.practice_steps if practising else kind.first_steps:
            path = str(printers[-1]) if usual and printers else usual
            begin.append(step(text, command(verb, *filter(None, [path]))))
        return [], begin
    if entry and applied and (applied == last or read_input(last).precedes(entry)):
        again = measure_again(read_input(last))
        return [], [step("Its offsets are entered: measure again", again)]
    if applied and _reported(applied, last):
        return ["Nothing more to do: measured, entered, measured again and reported."], []
    if applied:
        compare = step("Compare with the prediction", command("verify", applied, last))
        write = command("report", applied, options="--html report.html", after=last)
        return [], [compare, step("Write the report", write)]
    case = common.judged(common.read_input(last))
    see = step("See the numbers", case.typed("solve"))
    return [decision_notice(case)], [see, *to_do(case, brief=True)]


def _simulated(path: Path) -> bool:
    with suppress(OrthocalError):
        return common.read_input(str(path)).measured.source.simulated
    return False


def _reported(*sessions: str) -> bool:
    """True if a page in this folder holds the digests of these sessions."""
    from orthoglide_cal.files.text import read_document
    from orthoglide_cal.report.document import MARK

    # So many characters of a digest are surely printed together.
    digests = [read_document(path).sha256[:8] for path in sessions]
    pages = (path.read_text("utf-8", "replace") for path in sorted(Path().glob("*.[hm][td]*")))
    return any(page.endswith(MARK) and all(digest in page for digest in digests) for page in pages)
