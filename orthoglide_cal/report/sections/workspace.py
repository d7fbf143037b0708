"""Tool-position error over the workspace, before and after."""

from __future__ import annotations

from orthoglide_cal.outcome import Calibration
from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import Figure, Paragraph, Section
from orthoglide_cal.report.numbers import plain, two_figures
from orthoglide_cal.report.sketch import bar_lines


def workspace(calibration: Calibration) -> Section | None:
    """Slices of the cube; None without a result."""
    findings = calibration.findings
    if findings is None or findings.workspace is None:
        return None
    found = findings.workspace
    largest = max(found.before_max_mm, found.after_max_mm)
    low, high = float(found.axis_mm[0]), float(found.axis_mm[-1])
    after = two_figures(found.after_max_mm)
    return Section(
        "Tool-position error over the workspace",
        (
            Paragraph(
                f"Before: up to {two_figures(found.before_max_mm)} mm (mean"
                f" {two_figures(found.before_mean_mm)}). After the offsets are entered: at most"
                f" {after} mm (mean {two_figures(found.after_mean_mm)}), which their uncertainty"
                " leaves."
                + (
                    f" The model includes {' and '.join(findings.answer.model)}."
                    if findings.answer.model
                    else ""
                )
            ),
            Figure(
                "Distance between commanded and true tool position, mm",
                f"Up to {two_figures(found.before_max_mm)} mm before and {after} mm after.",
                figures.slices(found.axis_mm, found.levels_mm, found.before_mm, found.after_mm),
                legend=figures.legend(largest),
                sketch=bar_lines(
                    ("before, largest", "before, mean", "after, largest", "after, mean"),
                    (
                        found.before_max_mm,
                        found.before_mean_mm,
                        found.after_max_mm,
                        found.after_mean_mm,
                    ),
                    tuple(
                        f"{two_figures(v)} mm"
                        for v in (
                            found.before_max_mm,
                            found.before_mean_mm,
                            found.after_max_mm,
                            found.after_mean_mm,
                        )
                    ),
                    width=36,
                ),
                pairs=True,
                key=f"Cube from {plain(low, 0)} to {plain(high, 0)} mm along x, y and z: what the"
                f" joint limits allow (workspace by the machine file:"
                f" {plain(found.nominal_edge_mm, 0)} mm).",
            ),
        ),
    )
