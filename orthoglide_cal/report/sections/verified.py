"""The words of a verification: the answer, what to do, promised against measured."""

from __future__ import annotations

import shlex

import numpy as np

from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import (
    Block,
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
from orthoglide_cal.report.numbers import plain, signed
from orthoglide_cal.verification import RULE, Coefficient, Verification
from orthoglide_cal.verification.result import (
    AS_MODELLED,
    EXCHANGED,
    FAIL,
    NO_RESPONSE,
    OPPOSITE,
    OTHER_GAIN,
    PASS,
)

_MM_PER_INCH = 25.4


def notice(verification: Verification) -> Notice:
    """The answer in one box."""
    digits = 3 if verification.kind == "readings" else 2
    lines: list[Line] = [
        f"Promised {plain(verification.rms_promised_mm, digits)} mm, measured"
        f" {plain(verification.rms_after_mm, digits)} mm (r.m.s.; before"
        f" {plain(verification.rms_before_mm, digits)} mm).",
        answer_text(verification),
    ]
    decision = verification.decision
    if decision is not None:
        lines.append(
            f"{decision.outcome.capitalize()}: limit {decision.limit_mm:g} mm, largest deviation"
            f" {plain(decision.largest_mm, 3)} ± {plain(decision.expanded_mm, 3)} mm"
            f" (d{decision.largest})."
        )
    bad = verification.answer not in (AS_MODELLED,) or (decision and decision.outcome == FAIL)
    unsure = verification.change.found or (decision and decision.outcome != PASS)
    if bad:
        return Notice("bad", "The correction did not do what was promised", tuple(lines))
    if unsure:
        return Notice("warn", "The correction worked, with a reservation", tuple(lines))
    return Notice("good", "The correction did what was promised", tuple(lines))


def to_do(verification: Verification) -> Section:
    """What to do after the adjustment was measured."""
    decision = verification.decision
    if verification.answer != AS_MODELLED:
        items = [Step(answer_text(verification)), Step("Then measure again and compare again.")]
    elif decision is not None and decision.outcome == FAIL:
        items = [
            Step("The offsets are right, yet a deviation is beyond the limit: find its cause."),
            Step("Diagnose the last session.", f"orthocal diagnose {_path(verification)}"),
        ]
    else:
        items = [Step("Nothing more: keep this report with the machine.")]
    return Section("What to do next", (Steps(tuple(items)),))


def _path(verification: Verification) -> str:
    path = verification.after.path
    return path if path == "-" else shlex.quote(path)


def answer_text(verification: Verification) -> str:
    """How the machine responded, in one sentence."""
    response = verification.response
    size = f"response {interval(response)}"
    if verification.answer == AS_MODELLED:
        return f"The machine responded as the model says: {size}, theory 1."
    if verification.answer == OPPOSITE:
        return f"The correction acted with the opposite sign ({size}): enter the negative values."
    if verification.answer == EXCHANGED and verification.acted_as_mm is not None:
        acted = " ".join(signed(v, 3) for v in verification.acted_as_mm.tolist())
        return f"The correction acted as if {acted} had been entered (x, y, z): check the joints."
    if verification.answer == NO_RESPONSE:
        return (
            f"The machine did not respond ({size}): re-home, and check that the values are active."
        )
    if verification.answer == OTHER_GAIN:
        return f"The machine responded by another amount ({size}, theory 1): {_gain(response)}"
    return f"The correction is too small for these readings to show a response ({size})."


def _gain(response: Coefficient) -> str:
    for factor in (_MM_PER_INCH, 1.0 / _MM_PER_INCH):
        if abs(response.value / factor - 1.0) < 0.1:
            return "inches and millimetres were mixed up."
    return "check the gauge against a gauge block, its plunger for tilt, and the axis scale."


def interval(coefficient: Coefficient) -> str:
    """ "1.03 [0.91, 1.14]"."""
    return f"{coefficient.value:.2f} [{coefficient.low:.2f}, {coefficient.high:.2f}]"


def outcome_section(verification: Verification) -> Section:
    """Promised and measured, difference by difference."""
    digits = 3 if verification.kind == "readings" else 2
    rows: list[tuple[Line | None, ...]] = [
        (
            f"d{d.name}",
            signed(d.before_mm, digits),
            signed(d.promised_mm, digits),
            signed(d.after_mm, digits),
            signed(d.after_mm - d.promised_mm, digits),
        )
        for d in verification.deviations
    ]
    rows.append(
        (
            "r.m.s.",
            Strong(plain(verification.rms_before_mm, digits)),
            Strong(plain(verification.rms_promised_mm, digits)),
            Strong(plain(verification.rms_after_mm, digits)),
            "",
        )
    )
    blocks: list[Block] = [
        Table(
            ("difference", "before", "promised", "measured", "missed by"),
            tuple(rows),
            caption="Deviation from parallel motion, mm.",
            last_is_total=True,
        )
    ]
    decision = verification.decision
    if decision is not None:
        blocks.append(
            Paragraph(
                (
                    Strong(f"{decision.outcome.capitalize()}. "),
                    f"Limit {decision.limit_mm:g} mm; largest deviation"
                    f" {plain(decision.largest_mm, 3)} mm with U = {plain(decision.expanded_mm, 3)}"
                    f" mm (k = {verification.k:.2f}, 95 %).",
                )
            )
        )
        blocks.append(Paragraph(f"Decision rule: {RULE}", small=True))
    blocks.append(
        Figure(
            "",
            "How far each difference is from its promise.",
            figures.difference_rows(
                [d.name for d in verification.deviations],
                np.array([d.after_mm for d in verification.deviations]),
                np.array([d.promised_mm for d in verification.deviations]),
                "promised",
            ),
            columns=1,
            key="○ measured after the adjustment, ■ promised.",
        )
    )
    return Section("Promised and measured", tuple(blocks))
