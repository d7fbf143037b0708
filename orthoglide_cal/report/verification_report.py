"""The verification report: promised against measured, and how the machine responded."""

from __future__ import annotations

from datetime import datetime

import numpy as np

from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import (
    Block,
    Code,
    Document,
    Facts,
    Figure,
    Given,
    Line,
    Notice,
    Paragraph,
    Section,
    Strong,
    Table,
)
from orthoglide_cal.report.numbers import chance, plain, signed, two_figures
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


def verification_report(
    verification: Verification, number: str, issued: datetime, software: str
) -> Document:
    """The document, for any of the renderers.

    Args:
        number, issued, software: identity of the report.
    """
    return Document(
        kind="Verification report",
        title=verification.machine,
        number=number,
        facts=Facts(
            (
                ("Number", Code(number)),
                ("Applied", f"{_triple(verification)} mm (x, y, z)"),
                ("Issued", f"{issued:%Y-%m-%d %H:%M} UTC"),
            )
        ),
        notice=notice(verification),
        sheet=(outcome_section(verification),),
        sections=(
            _response(verification),
            _remaining(verification),
            _origin(verification, software),
        ),
        signatures=("Measured by", "Checked by"),
    )


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


def _response(verification: Verification) -> Section:
    rows: list[tuple[Line | None, ...]] = [
        (
            axis.axis,
            signed(axis.applied_mm, 3),
            signed(axis.found_mm, 3),
            f"{signed(axis.low_mm, 3)} … {signed(axis.high_mm, 3)}",
            interval(axis.coefficient) if axis.coefficient else "",
        )
        for axis in verification.axes
    ]
    change = verification.change
    if change.found:
        other = (
            f"Something else changed: {1000 * change.rms_mm:.0f} µm per difference that no offset"
            f" explains, where noise gives {1000 * change.noise_mm:.0f} µm"
            f" ({chance(change.p_value)})."
            " Was the stand moved, a leg or rail adjusted, or another gauge used?"
        )
    else:
        other = (
            f"Nothing else changed: {1000 * change.rms_mm:.0f} µm per difference where noise gives"
            f" {1000 * change.noise_mm:.0f} µm ({chance(change.p_value)})."
        )
    return Section(
        "How the machine responded",
        (
            Paragraph(
                (
                    "Response coefficient, all axes together: ",
                    Strong(interval(verification.response)),
                    f". Theory: 1. (95 % interval, {verification.dof} degrees of freedom.)",
                )
            ),
            Table(
                ("axis", "applied", "found", "95 % interval", "coefficient"),
                tuple(rows),
                caption="Change of each joint, mm, fitted together.",
            ),
            Paragraph(other),
        ),
    )


def _remaining(verification: Verification) -> Section:
    rows = tuple(
        (axis.axis, signed(value, 3), f"± {two_figures(expanded)}")
        for axis, value, expanded in zip(
            verification.axes,
            verification.remaining_mm.tolist(),
            verification.remaining_expanded_mm.tolist(),
            strict=True,
        )
    )
    return Section(
        "Offsets that remain",
        (
            Table(
                ("axis", "Δρ", "U"),
                rows,
                caption="In mm; identified from the second session, beside what was applied.",
            ),
        ),
    )


def _origin(verification: Verification, software: str) -> Section:
    return Section(
        "Where this comes from",
        (
            Facts(
                (
                    ("Before", Given(verification.before.path)),
                    ("SHA-256", Code(verification.before.sha256)),
                    ("After", Given(verification.after.path)),
                    ("SHA-256", Code(verification.after.sha256)),
                    ("Machine", Given(verification.machine)),
                    ("Compared", f"{verification.count} independent changes"),
                    ("Software", software),
                )
            ),
        ),
    )


def _triple(verification: Verification) -> str:
    return " ".join(signed(v, 3) for v in verification.applied_mm.tolist())
