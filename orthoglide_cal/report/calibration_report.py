"""The calibration report: one session, its result, and what to do."""

from __future__ import annotations

from orthoglide_cal.outcome import Calibration
from orthoglide_cal.report import sections
from orthoglide_cal.report.blocks import Code, Document, Facts
from orthoglide_cal.report.sections.verified import notice, outcome_section, to_do


def calibration_report(calibration: Calibration) -> Document:
    """The document, for any of the renderers."""
    given = calibration.conditions
    identity = calibration.identity
    measured = given.finished or given.started
    verification = calibration.verification
    sheet = (
        to_do(verification) if verification else sections.to_do(calibration),
        sections.offsets(calibration),
        sections.found_and_left(calibration),
        sections.intervals(calibration),
    )
    evidence = (
        outcome_section(verification) if verification else None,
        sections.improvement(calibration),
        sections.wrong(calibration),
        sections.diagnosis(calibration),
        sections.workspace(calibration),
        sections.conditions(calibration),
        sections.origin(calibration),
    )
    return Document(
        kind="Calibration report",
        title=calibration.machine.name,
        number=identity.number,
        facts=Facts(
            (
                ("Number", Code(identity.number)),
                ("Measured", sections.moment(measured)),
                ("Issued", f"{identity.issued:%Y-%m-%d %H:%M} UTC"),
            )
        ),
        notice=notice(verification) if verification else sections.notice(calibration),
        sheet=tuple(part for part in sheet if part is not None),
        sections=tuple(part for part in evidence if part is not None),
        signatures=("Measured by", "Adjusted by", "Checked by"),
    )
