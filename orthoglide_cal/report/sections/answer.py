"""The answer first: may the offsets be entered, what to do, the offsets with uncertainty."""

from __future__ import annotations

import shlex

from orthoglide_cal.axes import AXES
from orthoglide_cal.outcome import Answer, Calibration, CheckPosture, Findings
from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import (
    Block,
    Code,
    Figure,
    Line,
    Notice,
    Paragraph,
    Section,
    Step,
    Steps,
    Strong,
    Table,
)
from orthoglide_cal.report.figures import Bar
from orthoglide_cal.report.numbers import plain, signed, two_figures, with_uncertainty
from orthoglide_cal.report.sketch import interval_lines


def notice(calibration: Calibration) -> Notice:
    """The decision in one box."""
    findings, decision = calibration.findings, calibration.release
    if findings is None:
        return Notice("bad", "There is no result", decision.reasons)
    if not decision.usable:
        return Notice("bad", "Do not enter these offsets", decision.reasons)
    if decision.cautions:
        return Notice("warn", "The offsets may be entered, with care", decision.cautions)
    return Notice("good", "The offsets may be entered", (findings.solution.judgement,))


def to_do(calibration: Calibration) -> Section:
    """What to do next, step by step."""
    findings, decision = calibration.findings, calibration.release
    if findings is None or not decision.usable:
        items = [Step(with_file(line, calibration)) for line in decision.remedies]
        if findings is not None:
            items.append(
                Step("An export that is forced all the same is marked as forced, in every format.")
            )
        return Section("What to do next", (Steps(tuple(items)),))
    adjustment = findings.adjustment
    values = ", ".join(
        f"{joint.axis} {signed(joint.new_mm, adjustment.decimals)}" for joint in adjustment.joints
    )
    applied = " ".join(plain(change, adjustment.decimals) for change in adjustment.applied_mm)
    path = _path(calibration)
    items = [
        Step(
            ("Enter the new joint offsets in the controller, in mm: ", Strong(values + ".")),
            f"orthocal export {path} --format linuxcnc",
        ),
        Step("Re-home all three axes."),
    ]
    if adjustment.check is not None:
        items.append(Step(check_text(adjustment.check)))
    items.append(
        Step(
            "Measure again in the same way, and compare with the promise.",
            f"orthocal verify {path} AFTER --applied {applied}",
        )
    )
    return Section("What to do next", (Steps(tuple(items)),))


def check_text(check: CheckPosture) -> Line:
    """The check posture as an instruction."""
    return (
        check_words(check) + " ",
        Strong(with_uncertainty(check.expected_mm, check.tolerance_mm) + " mm"),
        f" (before the adjustment: {signed(check.before_mm, 2)} mm).",
    )


def check_words(check: CheckPosture) -> str:
    """The same without the number that is expected."""
    if check.ends:
        return (
            f"Check: drive to {position(check.first)}. Read the height of leg {check.leg} along"
            f" {check.direction} at the joint end, then at the tool end. The second reading minus"
            " the first should be"
        )
    return (
        f"Check: put the gauge at the middle of leg {check.leg}, along {check.direction}. Read it"
        f" at {position(check.first)}, then at {position(check.second)}. The second reading minus"
        " the first should be"
    )


def position(tool: tuple[float, float, float]) -> str:
    """ "X60 Y0 Z0": a tool position as it is typed."""
    return " ".join(
        f"{axis.upper()}{plain(value, 3).rstrip('0').rstrip('.')}"
        for axis, value in zip(AXES, tool, strict=True)
    )


def offsets(calibration: Calibration) -> Section | None:
    """The offsets with expanded uncertainty; None without a result."""
    findings = calibration.findings
    if findings is None:
        return None
    answer, adjustment = findings.answer, findings.adjustment
    allowed = calibration.release.usable
    last = "enter" if allowed else "would be"
    rows = [
        (
            Strong(joint.axis),
            signed(joint.previous_mm, adjustment.decimals),
            with_uncertainty(value, joint.expanded_mm),
            Strong(signed(joint.new_mm, adjustment.decimals)),
        )
        for joint, value in zip(adjustment.joints, answer.offsets_mm.tolist(), strict=True)
    ]
    blocks: list[Block] = [
        Table(
            ("axis", "now", "Δρ ± U", last),
            tuple(rows),
            caption="In mm. Now: active in the controller. True joint position = indicated + Δρ.",
        ),
        Paragraph(coverage(answer), small=True),
    ]
    return Section("Joint offsets", tuple(blocks), beside=True)


def coverage(answer: Answer) -> str:
    """How U was made."""
    if answer.dof is None:
        source = "normal distribution"
    else:
        source = f"Student's t with {answer.dof} degrees of freedom"
    model = f" Model: offsets and {' and '.join(answer.model)}." if answer.model else ""
    return (
        f"U = k·u is the expanded uncertainty with k = {answer.k:.2f} ({source}), for a"
        f" confidence of {100 * answer.confidence:.0f} %.{model}"
    )


def intervals(calibration: Calibration) -> Section | None:
    """The offsets with their intervals as a picture; None without a result."""
    findings = calibration.findings
    if findings is None:
        return None
    return Section("Offsets with their 95 % intervals", (_interval_figure(findings),))


def _interval_figure(findings: Findings) -> Figure:
    answer, plain_ = findings.answer, findings.plain
    bars = [Bar(_model(answer), answer.offsets_mm.tolist(), answer.expanded_mm.tolist())]
    key = ""
    if answer.model:
        bars.append(Bar("offsets alone", plain_.offsets_mm.tolist(), plain_.expanded_mm.tolist()))
        key = f"● {_model(answer)}, □ offsets alone."
    values, halves = answer.offsets_mm.tolist(), answer.expanded_mm.tolist()
    return Figure(
        "",
        f"Expanded uncertainty: {_range(min(halves), max(halves))} mm.",
        figures.intervals(bars),
        sketch=interval_lines(AXES, values, halves),
        columns=2,
        key=key,
    )


def _range(low: float, high: float) -> str:
    low_text, high_text = two_figures(low), two_figures(high)
    return low_text if low_text == high_text else f"{low_text} to {high_text}"


def _model(answer: Answer) -> str:
    return f"with {' and '.join(answer.model)}" if answer.model else "offsets"


def _path(calibration: Calibration) -> str:
    path = calibration.measured.source.path
    return path if path == "-" else shlex.quote(path)


def with_file(line: str, calibration: Calibration) -> Line:
    """The sentence with the file's name, and its command set off."""
    sentence, found, command = line.partition("orthocal ")
    if not found:
        return line
    return sentence, Code((found + command).replace("FILE", _path(calibration)))
