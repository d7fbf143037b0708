"""May the parameters be entered, and what to do next: said in the same words on every page."""

from __future__ import annotations

from collections.abc import Iterator

from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import SETTLED, Case, check_words, expected_words
from orthoglide_cal.results import Recording, recording
from orthoglide_cal.words import plain, signed


def decision_notice(case: Case) -> doc.Notice:
    """The decision in one box."""
    answer, many = case.answer, case.words.many
    release = answer.release
    if not answer.parameters:
        return doc.Notice(doc.Tone.BAD, "There is no result", release.reasons)
    if not release.usable:
        return doc.Notice(doc.Tone.BAD, f"Do not enter these {many}", release.reasons)
    title = SETTLED if release.settled else f"The {many} may be entered"
    if release.cautions:
        title = title if release.settled else f"{title}, with care"
        return doc.Notice(doc.Tone.WARN, title, release.cautions)
    return doc.Notice(doc.Tone.GOOD, title, (answer.judgement,))


def to_do(case: Case) -> doc.Section:
    """What to do next, step by step."""
    release = case.answer.release
    if not release.usable:
        items = [doc.Instruction(each.sentence, case.remedied(each)) for each in release.remedies]
    elif release.settled:
        items = [
            doc.Instruction(
                "Enter nothing: each calibration gives other digits, none better than those in"
                " force."
            ),
            doc.Instruction("To know them better, see which readings would:", case.typed("plan")),
        ]
    else:
        items = list(_entering(case))
    return doc.Section("What to do next", (doc.Instructions(tuple(items)),))


def _entering(case: Case) -> Iterator[doc.Instruction]:
    if recording(case.given) is Recording.DONE:
        known = "The machine file says that these are in the controller: "
        yield doc.Instruction((known, *_listed(case)))
    else:
        given = case.typed("export", f"--format {case.machine.controller_formats[0]}")
        yield doc.Instruction((case.words.enter, *_listed(case)), given)
    yield doc.Instruction(case.words.restart)
    if case.record is not None:
        known = "Record it: from then on every command knows what is in the controller."
        yield doc.Instruction(known, case.record)
    check = case.answer.check
    if check is not None:
        before = f" (before the adjustment: {signed(check.before_mm, 2)} mm)."
        yield doc.Instruction((f"{check_words(check)} ", doc.Strong(expected_words(check)), before))
    if case.table is not None:
        yield doc.Instruction("What offsets leave, a table of corrections takes out.", case.table)
    yield doc.Instruction(
        "Measure again in the same way, and compare with the promise.", case.verify
    )


def _listed(case: Case) -> Iterator[doc.Inline]:
    """The new values; those of several units stand in the table and in the export."""
    if not case.unit:
        return
    last = case.answer.parameters[-1]
    for each in case.answer.parameters:
        # Each axis with its value: a narrow page must not break between the two.
        yield doc.Strong(
            f"{each.name} {plain(each.new(case.answer.decimals), case.answer.decimals)}"
        )
        yield "." if each is last else ", "
