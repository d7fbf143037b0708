"""May the parameters be entered, and what to do next: said in the same words on every page."""

from __future__ import annotations

from collections.abc import Iterator

from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import SETTLED, Case, check_words, measure_again
from orthoglide_cal.results import Recording, recording


def decision_notice(case: Case) -> doc.Notice:
    """The decision and what it rests on."""
    answer, many = case.answer, case.words.many
    release = answer.release
    if not answer.parameters:
        return doc.Notice(doc.Tone.BAD, "There is no result", release.reasons, case.about)
    if not release.usable:
        title = f"Do not enter these {many}"
        return doc.Notice(doc.Tone.BAD, title, release.reasons, case.about)
    title = SETTLED if release.settled else f"The {many} may be entered"
    if release.cautions:
        title = title if release.settled else f"{title}, with care"
        return doc.Notice(doc.Tone.WARN, title, release.cautions, case.about)
    return doc.Notice(doc.Tone.GOOD, title, (answer.judgement,), case.about)


def to_do(case: Case, *, brief: bool = False) -> doc.Section:
    """What to do next, step by step; `brief`: what one screen has room for."""
    return doc.Section("Next", (doc.Instructions(tuple(_steps(case, brief))),))


def _steps(case: Case, brief: bool) -> Iterator[doc.Instruction]:
    release, verdict = case.answer.release, case.answer.verdict
    causes = release.sound and verdict in (Verdict.NAMED, Verdict.AMBIGUOUS)
    if release.settled:
        yield doc.Instruction(
            "Enter nothing: each calibration gives other values, none better than these."
        )
        yield doc.Instruction("See which readings would show more", case.typed("plan"))
    elif release.usable:
        yield from _entering(case, brief)
    elif not (brief and causes):
        for each in release.remedies:
            yield doc.Instruction(each.sentence, case.remedied(each))
    else:
        yield from retaken(case)
    if brief and causes:
        yield doc.Instruction("See the cause and its remedy", case.typed("diagnose"))


def retaken(case: Case) -> Iterator[doc.Instruction]:
    """Readings to take again first: they were questioned and kept."""
    for each in case.answer.release.remedies:
        if each.verb == "measure":
            yield doc.Instruction(each.sentence, case.remedied(each))


def _entering(case: Case, brief: bool) -> Iterator[doc.Instruction]:
    words, check = case.words, case.answer.check
    export = case.typed("export", f"--format {case.controller_format}")
    if recording(case.given) is Recording.DONE:
        yield doc.Instruction(f"By the machine file the {words.many} are entered. {words.restart}")
    elif case.record is not None:
        yield doc.Instruction(f"{words.entering}, then", case.record)
    else:
        yield doc.Instruction(f"{words.entering}.", export if case.machine.keeps_itself else None)
    if not (brief or case.machine.keeps_itself):
        yield doc.Instruction("The same as lines of the controller's own file", export)
    if check is not None:
        yield doc.Instruction(check_words(check))
    if case.table is not None and not brief:
        yield doc.Instruction("Correct what offsets leave with a table of corrections", case.table)
    if not case.machine.probes:
        yield doc.Instruction(
            "Measure again", measure_again(case.given.conditions, case.machine_file)
        )
    if case.record is None or not brief:
        yield doc.Instruction(words.compare, case.verify)
