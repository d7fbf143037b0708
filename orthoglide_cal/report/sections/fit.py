"""As found and as left, the expected improvement, and what the simulation gets wrong."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.outcome import Calibration, Findings
from orthoglide_cal.outcome.summary import Deviations
from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import Figure, Line, Paragraph, Section, Strong, Table
from orthoglide_cal.report.numbers import plain, signed, two_figures
from orthoglide_cal.report.sketch import bar_lines


def found_and_left(calibration: Calibration) -> Section | None:
    """Deviation from parallelism before and after the adjustment; None without a result."""
    findings = calibration.findings
    if findings is None or findings.found is None or findings.expected is None:
        return None
    verification = calibration.verification
    digits = _digits(findings)
    left: tuple[Line | None, Line | None, Line | None] = (None, None, None)
    if verification is not None:
        after = Deviations.of({d.name: d.after_mm for d in verification.deviations})
        if after is not None:
            left = _sizes(after, digits)
    columns = (_sizes(findings.found, digits), _sizes(findings.expected, digits), left)
    table = Table(
        ("", "as found", "expected", "as left"),
        tuple(
            (title, *(column[k] for column in columns))
            for k, title in enumerate(("r.m.s.", "largest", "which"))
        ),
        caption="Deviation of the legs from parallel motion, mm"
        + ("; as left is blank until it is measured again." if verification is None else "."),
    )
    return Section("As found, as left", (table,))


def _sizes(deviations: Deviations, digits: int) -> tuple[str, str, str]:
    largest = signed(deviations.largest_mm, digits)
    return plain(deviations.rms_mm, digits), largest, f"d{deviations.largest}"


def _digits(findings: Findings) -> int:
    """Averages of raw readings are known better than the gauge resolves; printed ones are not."""
    return 3 if findings.solution.kind == "readings" else 2


def improvement(calibration: Calibration) -> Section | None:
    """The paper's Table 4, one row per difference; None without a result."""
    findings = calibration.findings
    if findings is None or not findings.solution.table:
        return None
    digits = _digits(findings)
    rows: list[tuple[Line | None, ...]] = [
        (
            f"d{row.difference}",
            signed(row.measured_mm, digits),
            signed(row.modelled_mm, digits),
            signed(row.expected_mm, digits),
        )
        for row in findings.solution.table
    ]
    if findings.found is not None and findings.expected is not None:
        rows.append(
            (
                "r.m.s.",
                plain(findings.found.rms_mm, digits),
                "",
                plain(findings.expected.rms_mm, digits),
            )
        )
    single = len(findings.solution.table[0].difference) > 3
    what = (
        "tool end minus joint end; dz_x+ is along z on leg x at max"
        if single
        else "reading at max minus reading at min; dx_y is along x on leg y"
    )
    return Section(
        "Expected improvement",
        (
            Table(
                ("difference", "measured", "modelled", "expected"),
                tuple(rows),
                caption=f"In mm: {what}. Modelled: what the offsets explain; expected: what should"
                " remain.",
                last_is_total=True,
            ),
        ),
    )


def wrong(calibration: Calibration) -> Section | None:
    """What the simulation gets wrong: measured, predicted and residuals; None without a result."""
    findings = calibration.findings
    if findings is None:
        return None
    shown, noise = findings.traces, calibration.machine.gauge.noise_mm
    residual = shown.residual_mm
    worst = int(np.argmax(np.abs(residual)))
    where = (
        f"leg {'xyz'[shown.leg[worst]]}, direction {shown.series[worst][0]}, {shown.label[worst]}"
        f"{' (' + shown.end[worst] + ' end)' if shown.end[worst] else ''},"
        f" cycle {int(shown.cycle[worst])}"
        if shown.raw
        else f"d{shown.label[worst]}"
    )
    lead = Paragraph(
        (
            "Largest difference between measurement and prediction: ",
            Strong(f"{1000 * residual[worst]:+.0f} µm"),
            f" ({where}). One reading's noise is {1000 * noise:.0f} µm (standard deviation).",
        )
    )
    return Section("What the simulation gets wrong", (lead, *_pictures(findings, noise)))


def _pictures(findings: Findings, noise: float) -> tuple[Figure, ...]:
    shown = findings.traces
    residual = shown.residual_mm
    if not shown.raw:
        rows = figures.difference_rows(shown.label, shown.measured_mm, shown.predicted_mm)
        names = [f"d{name}" for name in shown.label]
        sizes = np.abs(residual).tolist()
        return (
            Figure(
                "Measured against predicted",
                f"r.m.s. of what is left: {two_figures(findings.solution.rms_after_mm)} mm.",
                rows,
                sketch=bar_lines(names, sizes, [f"{r:+.3f} mm left" for r in residual]),
                columns=1,
                key="○ measured, ■ predicted; the line between them is what the model misses.",
            ),
        )
    spread = shown.rms_by_series()
    worst = max(spread, key=lambda name: spread[name])
    return (
        Figure(
            "Measured against predicted",
            "What each gauge showed while the leg travelled, and what the model predicts.",
            figures.reading_panels(
                shown.series,
                shown.end,
                shown.displacement_mm,
                shown.cycle,
                shown.measured_mm,
                shown.predicted_mm,
            ),
            key="Line: predicted. Marks: measured; cycle 1 ○, 2 △, 3 □, 4 ◇.",
        ),
        Figure(
            "Residuals by leg, posture and cycle",
            f"Leg {worst[2]} in direction {worst[0]} fits worst: r.m.s."
            f" {1000 * spread[worst]:.1f} µm.",
            figures.residual_panels(
                shown.series,
                shown.label,
                shown.end,
                shown.displacement_mm,
                shown.cycle,
                residual,
                noise,
            ),
            sketch=bar_lines(
                [f"leg {name[2]}, direction {name[0]}" for name in spread],
                list(spread.values()),
                [f"{1000 * value:.1f} µm" for value in spread.values()],
                width=30,
            ),
            key="Marks: cycle 1 ●, 2 ▲, 3 ■, 4 ◆. Band: what the gauge's noise explains (95 %).",
        ),
    )
