"""A diagnosis as text for a terminal of 80 columns."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, NamedCause
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences, Measured, Readings

_COLOURS = {"consistent": "green", "named": "yellow", "ambiguous": "yellow", "unexplained": "red"}


def render(
    diagnosis: Diagnosis, measured: Measured, machine: Machine, held_out_file: bool = False
) -> RenderableType:
    """The whole answer.

    Args:
        diagnosis: what was found.
        measured: the data, for the picture.
        machine: for its offsets and gauge.
        held_out_file: True if the held-out errors are those of a later file.
    """
    path = "standard input" if diagnosis.source.path == "-" else diagnosis.source.path
    return Group(
        Text(path, style="bold"),
        Text(f"{diagnosis.count} {_kind(diagnosis.kind)}; {diagnosis.machine}"),
        Text(),
        Text(headline(diagnosis), style=f"bold {_COLOURS[diagnosis.verdict]}"),
        *(_cause(cause, held_out_file) for cause in diagnosis.causes),
        *_open_questions(diagnosis),
        Text(),
        *_picture(diagnosis, measured),
        *_fit(diagnosis),
        Text(),
        *_offsets(diagnosis, machine),
        *(Text(f"Note: {note}") for note in diagnosis.notes),
        *_sensitivity(diagnosis),
        Text(),
    )


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    titles = " and ".join(CAUSES[cause.id].title for cause in diagnosis.causes)
    if diagnosis.verdict == "consistent":
        return "Nothing shows beyond this gauge's noise: the model fits this machine."
    if diagnosis.verdict == "named":
        return f"{titles[0].upper()}{titles[1:]}."
    if diagnosis.verdict == "ambiguous":
        return f"These data cannot decide. Likeliest: {titles}."
    return "Something is wrong that no listed cause explains."


def _kind(kind: str) -> str:
    return "raw readings" if kind == "readings" else f"differences ({kind})"


def _cause(cause: NamedCause, held_out_file: bool) -> RenderableType:
    place = f", {cause.where}" if cause.where else ""
    lines = [Text(f"  {cause.id}{place}: probability {_percent(cause.probability)}")]
    if cause.parameters:
        values = ", ".join(
            f"{name} {found.value:+.3g} ± {found.std:.2g} {found.unit}"
            if found.std
            else f"{name} {found.value:+g}"
            for name, found in cause.parameters.items()
        )
        lines.append(Text(f"    {values}"))
    lines.append(
        Text(
            f"    residual r.m.s. {cause.rms_before_mm:.4f} mm without it,"
            f" {cause.rms_after_mm:.4f} mm with it"
        )
    )
    if cause.heldout_before_mm is not None and cause.heldout_after_mm is not None:
        where = "the later readings" if held_out_file else "readings left out of the fit"
        lines.append(
            Text(
                f"    error in predicting {where}: {cause.heldout_before_mm:.4f} mm without,"
                f" {cause.heldout_after_mm:.4f} mm with"
            )
        )
        if cause.heldout_after_mm >= cause.heldout_before_mm:
            lines.append(Text("    It does not predict better: not recommended as an extension."))
    lines.append(Text(f"    {cause.advice}"))
    if cause.recommended:
        lines.append(Text(f"    To make it part of the machine: --accept {cause.id}"))
    elif not CAUSES[cause.id].in_machine:
        lines.append(Text("    It lies in the measurement: nothing for the controller to correct."))
    return Group(*lines)


def _percent(probability: float) -> str:
    return "over 99.9 %" if probability > 0.999 else f"{100.0 * probability:.1f} %"


def _open_questions(diagnosis: Diagnosis) -> list[RenderableType]:
    if diagnosis.verdict != "ambiguous":
        return []
    lines: list[RenderableType] = [
        Text(f"  Explains the data as well: {', '.join(diagnosis.ambiguous_with)}")
    ]
    following = diagnosis.next_measurement
    if following is None:
        lines.append(Text("  No reading of this kind would tell them apart."))
    else:
        lines.append(Text(f"  Read next: {following.what}", style="bold"))
        lines.append(
            Text(
                f"    It tells {following.separates[0]} from {following.separates[1]} by"
                f" {following.separation_sigma:.1f} standard deviations."
            )
        )
    return lines


def _picture(diagnosis: Diagnosis, measured: Measured) -> list[RenderableType]:
    """Measured minus predicted, by leg, direction, posture and cycle."""
    before = diagnosis.measured_mm - diagnosis.nominal_mm
    after = diagnosis.measured_mm - diagnosis.explained_mm
    if isinstance(measured, Differences):
        return [_difference_table(measured, diagnosis, before, after)]
    rows: list[RenderableType] = [
        _residual_table("Measured minus predicted, µm: offsets only", measured, before, diagnosis)
    ]
    if diagnosis.causes:
        rows.append(_residual_table("With the cause", measured, after, diagnosis))
    rows.append(
        Text("  mean of the cycles, then a mark per cycle: · noise, + − over 2σ, ▲ ▼ over 4σ")
    )
    return rows


def _mark(residual: float, sigma: float) -> str:
    if abs(residual) <= 2.0 * sigma:
        return "·"
    large = abs(residual) > 4.0 * sigma
    return ("▲" if large else "+") if residual > 0.0 else ("▼" if large else "−")


def _residual_table(
    title: str, measured: Readings, residual: Floats, diagnosis: Diagnosis
) -> RenderableType:
    sigma = diagnosis.lack_of_fit.noise_mm
    plan = measured.plan
    postures = list(dict.fromkeys(measured.posture))
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="")
    table.add_column("  leg, direction")
    for posture in postures:
        table.add_column(posture, justify="left")
    series = plan.series()
    names = np.array(measured.posture)
    for number in np.unique(series):
        cells = []
        for posture in postures:
            own = np.flatnonzero((series == number) & (names == posture))
            own = own[np.argsort(plan.order[own])]
            marks = "".join(_mark(float(residual[i]), sigma) for i in own)
            mean = 1000.0 * float(residual[own].mean()) if own.size else 0.0
            cells.append(f"{mean:+7.1f} {marks}" if own.size else "")
        table.add_row(f"  leg {AXES[number // 3]}, {AXES[number % 3]}", *cells)
    return Group(Text(title, style="bold"), table)


def _difference_table(
    measured: Differences, diagnosis: Diagnosis, before: Floats, after: Floats
) -> RenderableType:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="")
    for column in ("  difference, mm", *measured.names):
        table.add_column(column, justify="left" if column.startswith(" ") else "right")
    rows = [
        ("  measured", diagnosis.measured_mm),
        ("  predicted, offsets only", diagnosis.nominal_mm),
        ("  measured − predicted", before),
    ]
    if diagnosis.causes:
        rows.append(("  … with the cause", after))
    for name, values in rows:
        table.add_row(name, *(f"{round(float(v), 3) + 0.0:+.3f}" for v in values))
    return table


def _fit(diagnosis: Diagnosis) -> list[RenderableType]:
    lack = diagnosis.lack_of_fit
    lines = [
        f"  Offsets only leave {lack.residual_mm:.4f} mm per reading; this gauge's noise is"
        f" {lack.noise_mm:.4f} mm",
        f"  (chance of that from noise alone: {_chance(lack.p_value)}).",
    ]
    if lack.repeats_mm is not None:
        against = (
            f"; against them the chance is {_chance(lack.repeats_p_value)}"
            if lack.repeats_p_value is not None
            else ""
        )
        lines.append(f"  Repeats scatter by {lack.repeats_mm:.4f} mm{against}. They share one")
        lines.append("  gauge set-up, so they understate the real scatter.")
    return [Text(line) for line in lines]


def _chance(p_value: float) -> str:
    return "under 1 in a million" if p_value < 1e-6 else f"{p_value:.2g}"


def _offsets(diagnosis: Diagnosis, machine: Machine) -> list[RenderableType]:
    what = {
        "consistent": "Joint offsets, mm",
        "named": "Joint offsets with the cause taken into account, mm",
        "ambiguous": "Joint offsets, the open choice included in the uncertainty, mm",
        "unexplained": "Joint offsets, the unexplained part included in the uncertainty, mm",
    }[diagnosis.verdict]
    lines = [Text(what, style="bold")]
    for axis, value, std, active in zip(
        AXES, diagnosis.offsets_mm, diagnosis.std_mm, machine.offsets_mm, strict=True
    ):
        lines.append(
            Text(
                f"  Δρ_{axis} {value:+.4f}, standard deviation {std:.4f}; controller:"
                f" {active:+.4f} becomes {active + value:+.4f}"
            )
        )
    return [*lines]


def _sensitivity(diagnosis: Diagnosis) -> list[RenderableType]:
    lines = []
    for change, (verdict, causes) in diagnosis.sensitivity.items():
        answer = f"{verdict}{f': {causes}' if causes else ''}"
        lines.append(Text(f"With all tolerances {change} the answer is {answer}."))
    return [*lines]
