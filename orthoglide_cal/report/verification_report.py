"""The verification report: promised against measured, and how the machine responded."""

from __future__ import annotations

from datetime import datetime

from orthoglide_cal.report.blocks import (
    Code,
    Document,
    Facts,
    Given,
    Line,
    Paragraph,
    Section,
    Strong,
    Table,
)
from orthoglide_cal.report.numbers import chance, signed, two_figures
from orthoglide_cal.report.sections.verified import interval, notice, outcome_section
from orthoglide_cal.verification import Verification


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
