"""The words that go with every export: what it is, and what to do once it is entered."""

from __future__ import annotations

from orthoglide_cal.outcome.export import Export
from orthoglide_cal.report.numbers import plain, signed, with_uncertainty
from orthoglide_cal.report.sections.answer import check_words

FORCED = "FORCED: this result must not be used."


def head(export: Export) -> list[str]:
    """Title, origin, and the warning of a forced export."""
    source = "standard input" if export.source.path == "-" else export.source.path
    lines = [
        f"Joint offsets for {export.machine.name}, {export.identity.number}",
        f"Issued {export.identity.issued:%Y-%m-%d %H:%M} UTC by {export.identity.software}",
        f"From {source}, SHA-256 {export.source.sha256}",
    ]
    if export.forced:
        lines += [FORCED, *export.forced]
    return lines + [f"Note: {line}" for line in export.cautions]


def says_and_is(export: Export) -> list[str]:
    """ "The controller says X, truly Y", for each axis at the isotropic posture."""
    decimals = export.adjustment.decimals
    says = export.machine.leg_length_mm
    return [
        f"{joint.axis}: the controller says {plain(says, decimals)} mm,"
        f" truly {plain(says + joint.change_mm, decimals)} mm"
        for joint in export.adjustment.joints
    ]


def after_entering(export: Export) -> list[str]:
    """Re-home, check posture, verification."""
    lines = ["After entering: re-home all three axes."]
    check = export.adjustment.check
    if check is not None:
        expected = with_uncertainty(check.expected_mm, check.tolerance_mm)
        lines.append(
            f"{check_words(check)} {expected} mm (before: {signed(check.before_mm, 2)} mm)."
        )
    applied = " ".join(
        plain(change, export.adjustment.decimals) for change in export.adjustment.applied_mm
    )
    lines.append(f"Then measure again and run: orthocal verify BEFORE AFTER --applied {applied}")
    return lines
