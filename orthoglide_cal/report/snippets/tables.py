"""Offsets and compensation tables as CSV; text that a spreadsheet would calculate is defused."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

from orthoglide_cal.outcome import Compensation
from orthoglide_cal.outcome.export import Export
from orthoglide_cal.report.numbers import plain
from orthoglide_cal.report.shown import in_csv

_DECIMALS = 4  # of a compensation: tenths of a micrometre


def offsets_csv(export: Export) -> str:
    """One row per joint; what the export is stands in every row."""
    head = (
        "axis", "previous_mm", "change_mm", "new_mm", "expanded_uncertainty_mm",
        "coverage_factor", "confidence", "status", "reasons_against", "rehome", "machine",
        "number", "input", "input_sha256",
    )  # fmt: skip
    decimals = export.adjustment.decimals
    rows = (
        (
            joint.axis,
            plain(joint.previous_mm, decimals),
            plain(joint.change_mm, decimals),
            plain(joint.new_mm, decimals),
            plain(joint.expanded_mm, decimals + 1),
            plain(export.answer.k, 3),
            f"{export.answer.confidence:g}",
            export.status,
            in_csv(" ".join(export.forced)),
            "yes",
            in_csv(export.machine.name),
            export.identity.number,
            in_csv(export.source.path),
            export.source.sha256,
        )
        for joint in export.adjustment.joints
    )
    return _csv(head, rows)


def compensation_csv(table: Compensation, export: Export) -> str:
    """One row per grid point: where the tool is wanted, and what to add to the joint values."""
    head = (
        "x_mm", "y_mm", "z_mm", "add_to_joint_x_mm", "add_to_joint_y_mm", "add_to_joint_z_mm",
        "status", "causes", "not_compensated", "number",
    )  # fmt: skip
    stamp = (
        export.status,
        " ".join(table.causes),
        " ".join(table.left_out),
        export.identity.number,
    )
    rows = (
        (*(plain(v, _DECIMALS) for v in (*point, *correction)), *stamp)
        for point, correction in zip(
            table.points_mm.tolist(), table.corrections_mm.tolist(), strict=True
        )
    )
    return _csv(head, rows)


def _csv(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()
