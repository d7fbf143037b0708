"""May the offsets be entered, and what to do next: said in the same words on every page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from orthoglide_cal.report import document as doc
from orthoglide_cal.report.controller import (
    SETTLED,
    cautions,
    check_words,
    expected,
    follow_up,
    record_command,
    remedy_command,
    table_command,
    verify_command,
)
from orthoglide_cal.results import Adjustment, Calibration, Recording, recording
from orthoglide_cal.words import signed


def decision_notice(calibration: Calibration) -> doc.Notice:
    """The decision in one box."""
    solution, decision = calibration.solution, calibration.release
    many = calibration.input.model.machine.vocabulary.many
    if solution is None:
        return doc.Notice(doc.Tone.BAD, "There is no result", decision.reasons)
    if not decision.usable:
        return doc.Notice(doc.Tone.BAD, f"Do not enter these {many}", decision.reasons)
    told = cautions(calibration)
    title = SETTLED if calibration.settled else f"The {many} may be entered"
    if told:
        title = title if calibration.settled else f"{title}, with care"
        return doc.Notice(doc.Tone.WARN, title, told)
    return doc.Notice(doc.Tone.GOOD, title, (solution.judgement,))


def to_do(calibration: Calibration, machine_file: Path | None) -> doc.Section:
    """What to do next, step by step."""
    adjustment, decision = calibration.adjustment, calibration.release
    if adjustment is None or not decision.usable:
        items = [
            doc.Instruction(remedy.sentence, remedy_command(remedy, calibration, machine_file))
            for remedy in decision.remedies
        ]
    elif calibration.settled:
        items = list(_settled(calibration, machine_file))
    else:
        items = list(_entering(calibration, adjustment, machine_file))
    return doc.Section("What to do next", (doc.Instructions(tuple(items)),))


def _settled(calibration: Calibration, machine_file: Path | None) -> Iterator[doc.Instruction]:
    yield doc.Instruction(
        "Enter nothing: each calibration gives other digits, none better than those in force."
    )
    plan = follow_up("plan", calibration, machine_file)
    yield doc.Instruction("To know them better, see which readings would:", plan)


def _entering(
    calibration: Calibration, adjustment: Adjustment, machine_file: Path | None
) -> list[doc.Instruction]:
    vocabulary = adjustment.machine.vocabulary
    given = follow_up(
        "export", calibration, machine_file, f"--format {adjustment.machine.controller_formats[0]}"
    )
    items = [
        doc.Instruction(
            ("The machine file says that these are in the controller: ", *_listed(adjustment))
        )
        if recording(calibration.input) is Recording.DONE
        else doc.Instruction((vocabulary.enter, *_listed(adjustment)), given),
        doc.Instruction(vocabulary.restart),
    ]
    record = record_command(calibration, machine_file)
    if record is not None:
        known = "Record it: from then on every command knows what is in the controller."
        items.append(doc.Instruction(known, record))
    check = adjustment.check
    if check is not None:
        before = f" (before the adjustment: {signed(check.before_mm, 2)} mm)."
        items.append(
            doc.Instruction((f"{check_words(check)} ", doc.Strong(expected(check)), before))
        )
    table = table_command(calibration, machine_file)
    if table is not None:
        items.append(
            doc.Instruction("What offsets leave, a table of corrections takes out.", table)
        )
    items.append(
        doc.Instruction(
            "Measure again in the same way, and compare with the promise.",
            verify_command(calibration, adjustment, machine_file),
        )
    )
    return items


def _listed(adjustment: Adjustment) -> Iterator[doc.Inline]:
    """The new values; of many parameters they stand in the table and in the export."""
    if adjustment.machine.absolute:
        return
    for number, joint in enumerate(adjustment.joints):
        # Each axis with its value: a narrow page must not break between the two.
        yield doc.Strong(f"{joint.axis} {signed(joint.new_mm, adjustment.decimals)}")
        yield "." if number == len(adjustment.joints) - 1 else ", "
