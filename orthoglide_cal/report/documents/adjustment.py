"""The document of `orthocal adjust`: what was adjusted, whether the check agrees, what is next."""

from functools import partial

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.report import document as doc
from orthoglide_cal.session.adjusting import AdjustmentAnswer
from orthoglide_cal.words import decimals_for, plain, signed

_STATUS = {
    "adjusted": "adjusted",
    "failed": "check failed",
    "left": "left as it is",
    "unfinished": "not finished",
}


def adjustment_document(answer: AdjustmentAnswer, verify: str) -> doc.Document:
    """The document; `verify` is the command that compares two sessions."""
    return doc.Document(partial(answer.model_dump, mode="json"), lambda: _page(answer, verify))


def _page(answer: AdjustmentAnswer, verify: str) -> doc.Page:
    head = ("parameter", "", "before", "target", "± U", "reached", "check", "expected", "± U")
    rows = []
    for each in answer.adjustments:
        plan = each.adjustment
        readings = each.before_mm, each.target_mm, each.reading_mm, each.check_mm, plan.check_mm
        decimals = decimals_for(plan.expanded_mm)
        before, target, reached, check, expected = (
            "—" if value is None else signed(value, decimals) for value in readings
        )
        within, apart = plain(plan.expanded_mm, decimals), plain(plan.check_expanded_mm, decimals)
        status = _STATUS[each.status]
        rows.append(
            (plan.parameter, status, before, target, within, reached, check, expected, apart)
        )
    caption = (
        "Readings of the gauge, mm. The check is the difference between the two postures, with the"
        " drives on."
    )
    tone, title = doc.Tone.GOOD, f"Adjusted: {answer.cause}, {CAUSES[answer.cause].title}"
    if answer.failed:
        tone, title = doc.Tone.BAD, "The check does not agree: the part moved in another way"
    steps = (
        doc.Instruction("Measure again in the same way.", "orthocal measure"),
        doc.Instruction("Compare with what was predicted.", verify),
    )
    section = doc.Section(None, doc.Grid(head, rows, words=(0, 1), caption=caption))
    return doc.Page(
        "Adjustment",
        answer.machine.name,
        notice=doc.Notice(tone, title),
        sections=[section, doc.next_steps(steps)],
    )
