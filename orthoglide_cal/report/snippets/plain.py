"""Offsets as plain text for any controller: "the controller says X, truly Y"."""

from __future__ import annotations

from orthoglide_cal.outcome.export import Export
from orthoglide_cal.report.numbers import signed, two_figures
from orthoglide_cal.report.shown import visible
from orthoglide_cal.report.snippets.instructions import after_entering, head, says_and_is


def plain_text(export: Export) -> str:
    """A page of text."""
    decimals = export.adjustment.decimals
    rows = [("axis", "previous", "change", "U", "enter")] + [
        (
            joint.axis,
            signed(joint.previous_mm, decimals),
            signed(joint.change_mm, decimals),
            two_figures(joint.expanded_mm),
            signed(joint.new_mm, decimals),
        )
        for joint in export.adjustment.joints
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    table = [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    ]
    lines = [
        *(visible(line) for line in head(export)),
        "",
        "Joint offsets, mm (true joint position = indicated + offset; U: expanded uncertainty,"
        f" k = {export.answer.k:.2f}, {100 * export.answer.confidence:.0f} %)",
        *table,
        "",
        "At the isotropic posture, as the controller is set now:",
        *says_and_is(export),
        "",
        *(visible(line) for line in after_entering(export)),
    ]
    return "\n".join(lines) + "\n"
