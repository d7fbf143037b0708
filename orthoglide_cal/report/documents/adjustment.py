"""The document of `orthocal adjust`: what was adjusted, whether the check agrees, what is next."""

from functools import partial
from pathlib import Path

from orthoglide_cal.errors import command
from orthoglide_cal.files.input import Input
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import measure_again
from orthoglide_cal.session.adjusting import AdjustmentAnswer, Phase
from orthoglide_cal.words import decimals_for, plain, signed


def adjustment_document(
    answer: AdjustmentAnswer, given: Input, machine_file: Path | None
) -> doc.Document:
    """The document; `given` is what was adjusted, by the machine file as the user gave it."""
    head = ("parameter", "", "target", "reached", "check: expected", "measured")
    rows = []
    for one in answer.adjustments:
        plan, decimals = one.adjustment, decimals_for(one.adjustment.expanded_mm)
        tight = one.readings_mm.get(Phase.TIGHT)
        target, reached, expected, measured = (
            "—" if value is None else signed(value, decimals)
            for value in (one.target_mm, tight, plan.check_mm, one.check_mm)
        )
        target += f" ± {plain(plan.expanded_mm, decimals)}" * (one.target_mm is not None)
        expected += f" ± {plain(plan.check_expanded_mm, decimals)}"
        rows.append((plan.name, one.status, target, reached, expected, measured))
    caption = "Readings, mm; the check is the difference between two of them."
    notice = doc.Notice(doc.Tone.INFO, f"Adjusted: {answer.cause}")
    if answer.failed:
        notice = doc.Notice(doc.Tone.BAD, "A check failed: something did not move as intended")
    first = doc.Instruction("Calibrate anew, which the push needs, and probe in the same way.")
    if given.model.machine.vocabulary.measure:
        again = measure_again(given.conditions, machine_file)
        first = doc.Instruction("Measure again in the same way.", again)
    compare = command("verify", answer.input.path, "AFTER", machine=machine_file)
    section = doc.Section(None, doc.Grid(head, rows, words=(0, 1), caption=caption))
    sections = [section, doc.next_steps((first, doc.Instruction("Compare the two.", compare)))]
    page = doc.Page("Adjustment", answer.machine.name, notice=notice, sections=sections)
    return doc.Document(partial(answer.model_dump, mode="json"), lambda: page)
