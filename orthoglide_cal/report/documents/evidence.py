"""The pages behind a calibration's first one: how well it fits, what is wrong, where it is from.

Each function makes one section, or the picture in it.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis, NamedCause, Verdict
from orthoglide_cal.errors import file_words
from orthoglide_cal.estimation import Solution
from orthoglide_cal.files import Conditions
from orthoglide_cal.model import AXES, Differences, Machine, Measured, Model, Readings, View
from orthoglide_cal.model.workspace import WorkspaceError
from orthoglide_cal.report import charts, views
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.canvas import bar_lines
from orthoglide_cal.report.documents.diagnosis import (
    cause_blocks,
    fit_blocks,
    headline,
    note_blocks,
    ranking_grid,
)
from orthoglide_cal.report.documents.next_reading import next_blocks
from orthoglide_cal.report.documents.pictures import BED_LEGEND, bed_maps
from orthoglide_cal.report.documents.solution import left_after, noise_grid
from orthoglide_cal.report.facts import METHOD_WORDS, data_words, end_words, method_facts
from orthoglide_cal.report.slices import legend, slices
from orthoglide_cal.results import Calibration, Explained, Residuals
from orthoglide_cal.words import counted, percent, plain, short, signed, two_figures

_MOST_NOTES = 40
# A parameter that many standard deviations from zero is marked on the picture.
SEEN = 2.0


def evidence(calibration: Calibration, machine_file: Path | None) -> list[doc.Section]:
    """Whether the result holds: fit, residuals, diagnosis, error over the workspace.

    Args:
        calibration: what to show.
        machine_file: as the user gave it, for the commands to run next.
    """
    solution, adjustment = calibration.solution, calibration.adjustment
    residuals, workspace = calibration.residuals, calibration.workspace
    if solution is None or adjustment is None:
        return []
    sections = [_steps(calibration), left_after(solution, adjustment.promised, in_full=True)]
    measured = calibration.input.measured
    if residuals is not None:
        sections.append(_wrong(measured, solution, residuals))
    elif isinstance(measured, Readings):
        sections.append(_touched(measured, solution, calibration.diagnosis))
    if calibration.diagnosis is not None:
        sections.append(_diagnosis(calibration.diagnosis, calibration, machine_file))
    if workspace is not None:
        sections.append(_workspace(workspace, calibration.model))
    return sections


def _steps(calibration: Calibration) -> doc.Section:
    """What takes the deviation away, step by step."""
    left = calibration.left_mm
    texts = [f"{two_figures(size)} mm" for size in left.values()]
    figure = doc.Figure(
        None,
        f"r.m.s. of the data{calibration.input.measured.weighing}: {texts[0]} as found,"
        f" {texts[-1]} left.",
        charts.waterfall(left, calibration.noise_mm),
        sketch=bar_lines(list(left), list(left.values()), texts),
        columns=1,
    )
    return doc.Section("From as found to what is left", (figure,))


def _wrong(measured: Measured, solution: Solution, found: Residuals) -> doc.Section:
    """What the simulation gets wrong: measured, predicted and residuals."""
    worst = int(np.argmax(np.abs(found.residual_mm)))
    noise = solution.sigma_stated_mm
    if isinstance(measured, Differences):
        rms = solution.rms_after_mm
        where, pictures = found.label[worst], [_differences(measured, found, rms)]
    else:
        where = f"{found.series[worst].words}, {found.label[worst]}{end_words(found.end[worst])}"
        where += f", cycle {int(found.cycle[worst])}"
        pictures = [_measured(found), _residuals(found, noise)]
    lead = (
        "Largest difference between measurement and prediction: ",
        doc.Strong(f"{signed(1000 * found.residual_mm[worst], 0)} µm"),
        f" ({where}). One reading's noise is {1000 * noise:.0f} µm (standard deviation).",
    )
    return doc.Section("What the simulation gets wrong", (doc.Paragraph(lead), *pictures))


def _touched(measured: Readings, solution: Solution, found: Diagnosis | None) -> doc.Section:
    """What the simulation gets wrong of each touch, on a map of the bed."""
    left = {
        f"{solution.model.machine.vocabulary.many} only": measured.value - solution.predicted_mm
    }
    if found is not None and found.causes:
        names = " and ".join(cause.id for cause in found.causes)
        left[f"with {names}"] = measured.value - found.explained_mm
    blocks: list[doc.Block] = []
    drawn = bed_maps(measured, left, solution.sigma_stated_mm)
    for name, maps in zip(left, drawn, strict=True):
        blocks += [doc.Paragraph(doc.Strong(name.capitalize())), *maps]
    blocks.append(doc.Paragraph(BED_LEGEND, small=True))
    return doc.Section("What the simulation gets wrong, µm", tuple(blocks))


def _differences(measured: Differences, found: Residuals, rms: float) -> doc.Figure:
    names, residual = list(found.label), found.residual_mm.tolist()
    return doc.Figure(
        "Measured against predicted",
        f"r.m.s. of what is left: {two_figures(rms)} mm.",
        charts.difference_rows(measured.which, found.measured_mm, found.predicted_mm),
        sketch=bar_lines(
            names, [abs(left) for left in residual], [f"{signed(r, 3)} mm left" for r in residual]
        ),
        columns=1,
        key="○ measured, ■ predicted; the line between them is what the model misses.",
    )


def _measured(found: Residuals) -> doc.Figure:
    return doc.Figure(
        "Measured against predicted",
        "What each gauge showed while the leg travelled, and what the model predicts.",
        charts.reading_panels(found),
        key="Line: predicted. Marks: measured; cycle 1 ○, 2 △, 3 □, 4 ◇.",
    )


def _residuals(found: Residuals, noise: float) -> doc.Figure:
    spread = {series.words: 1000 * rms for series, rms in found.rms_by_series().items()}
    sizes = list(spread.values())
    worst = max(spread, key=lambda name: spread[name])
    return doc.Figure(
        "Residuals by leg, posture and cycle",
        f"{worst.capitalize()} fits worst: r.m.s. {plain(spread[worst], 1)} µm.",
        charts.residual_panels(found, noise),
        sketch=bar_lines(list(spread), sizes, [f"{plain(rms, 1)} µm" for rms in sizes], width=30),
        key="Marks: cycle 1 ●, 2 ▲, 3 ■, 4 ◆. Band: what the gauge's noise explains (95 %).",
    )


def _diagnosis(
    found: Diagnosis, calibration: Calibration, machine_file: Path | None
) -> doc.Section:
    """What is wrong beside the offsets, as `diagnose` says it; what the causes explain."""
    parts = calibration.explained
    causes = cause_blocks(found, machine_file)
    blocks = [doc.Paragraph(headline(found)), *fit_blocks(found), *causes]
    if found.verdict is not Verdict.CONSISTENT:
        blocks += [_explained(parts, found)] if parts else []
        blocks += [ranking_grid(found)] if found.ranking else []
    following = next_blocks(found, calibration.following)
    return doc.Section("Diagnosis", (*blocks, *following, *note_blocks(found)))


def _explained(parts: Explained, found: Diagnosis) -> doc.Figure:
    """How much of the residuals the causes explain."""
    cause = " and ".join(cause.id for cause in found.causes)
    left, before = percent(parts.unexplained), two_figures(parts.rms_before_mm)
    vocabulary = found.model.machine.vocabulary
    models, residuals = [f"{vocabulary.many} alone"], [parts.before_mm]
    finding = f"{left} of the residuals' sum of squares stays unexplained: r.m.s. {before} mm."
    if cause:
        models.append(f"with {cause}")
        residuals.append(parts.after_mm)
        finding = (
            f"{cause} explains {percent(parts.by_cause)} of the residuals' sum of squares; {left}"
            f" stays unexplained. r.m.s. {before} → {two_figures(parts.rms_after_mm)} mm."
        )
    shares = {
        cause or "listed causes": parts.by_cause,
        "noise": parts.noise,
        "unexplained": parts.unexplained,
    }
    sizes = list(shares.values())
    return doc.Figure(
        "Explained and unexplained",
        finding,
        charts.residual_strips(models, residuals, parts.leg, found.lack_of_fit.noise_mm),
        sketch=bar_lines(list(shares), sizes, [percent(share) for share in sizes], width=30),
        columns=2,
        key=f"{'' if parts.leg is None else 'Leg x ●, y ▲, z ■. '}"
        f"Band: what the {vocabulary.noise}'s noise explains (95 %).",
    )


def _workspace(found: WorkspaceError, model: Model) -> doc.Section:
    """Tool-position error in slices of the workspace, before and after."""
    causes = " and ".join(effect.cause.id for effect in model.accepted)
    sizes = {
        "before, largest": found.before_max_mm,
        "before, mean": found.before_mean_mm,
        "after, largest": found.after_max_mm,
        "after, mean": found.after_mean_mm,
    }
    before, before_mean, after, after_mean = texts = [two_figures(size) for size in sizes.values()]
    low, high = float(found.axis_mm[0]), float(found.axis_mm[-1])
    lead = doc.Paragraph(
        f"Before: up to {before} mm (mean {before_mean}). After the offsets are entered: at most"
        f" {after} mm (mean {after_mean})"
        + (
            f"; {two_figures(found.left_max_mm)} mm of that comes from {causes}, which offsets do"
            " not remove."
            if causes
            else ", which their uncertainty leaves."
        )
        + "".join(
            f" What {effect.cause.id} does depends on time or on the way there, and is not"
            " included."
            for effect in model.accepted
            if effect.cause.timed
        )
    )
    scales = {
        "before": (found.before_mm, found.before_shift_mm),
        "after": (found.after_mm, found.after_shift_mm),
    }
    figure = doc.Figure(
        "Distance between commanded and true tool position, mm",
        f"Up to {before} mm before and {after} mm after.",
        tuple(
            panel
            for when, values in scales.items()
            for panel in slices(when, found.axis_mm, found.levels_mm, *values)
        ),
        legend=legend(scales),
        sketch=bar_lines(
            list(sizes), list(sizes.values()), [f"{text} mm" for text in texts], width=36
        ),
        pairs=True,
        key="Arrows: where the tool really goes, seen along z."
        f" Cube from {plain(low, 0)} to {plain(high, 0)} mm along x, y and z: what the joint"
        f" limits allow (workspace by the machine file: {plain(found.nominal_edge_mm, 0)} mm).",
    )
    return doc.Section("Tool-position error over the workspace", (lead, figure))


def conditions(calibration: Calibration) -> doc.Section:
    """Under which conditions, with which gauges: blank where not given."""
    given, machine = calibration.input.conditions, calibration.input.model.machine
    stated, noise = machine.gauge, calibration.input.model.machine.vocabulary.noise
    legs = calibration.input.measured.view is View.LEGS
    rows: list[tuple[str, doc.Blank]] = [
        *method_facts(machine, given.finished or given.started),
        ("Protocol", _given(given.protocol)),
        ("Operator", _given(given.operator)),
        ("Started", moment(given.started)),
        ("Finished", moment(given.finished)),
        ("Temperature", _temperature(given)),
    ]
    remarks = ((name, text) for name, text in given.environment if name != "temperature_c")
    rows += [(name.replace("_", " "), doc.Given(text)) for name, text in remarks]
    if calibration.input.is_session:
        rows.append(("Readings replaced", str(given.retaken)))
        rows.append(("Steps left out", str(given.skipped)))
    gauges: list[tuple[doc.Blank, ...]] = []
    for gauge in given.gauges:
        step = None if gauge.resolution_mm is None else short(gauge.resolution_mm, 6)
        gauges.append((doc.Given(gauge.label), _given(gauge.certificate), step))
    head, caption = ("gauge", "certificate", "resolution, mm"), "Gauges that were used."
    nothing = ((None, None, None),)
    sizes = (
        f"The machine file states for its {noise}: resolution {short(stated.resolution_mm, 6)} mm,"
        f" repeatability {short(stated.repeatability_mm, 6)} mm (one standard deviation)."
    )
    blocks: list[doc.Block] = [doc.Facts(tuple(rows))]
    if legs:
        blocks.append(doc.Grid(head, tuple(gauges) or nothing, words=(0, 1), caption=caption))
    blocks.append(doc.Paragraph(sizes, small=True))
    if calibration.solution is None:
        return doc.Section(f"Conditions and {noise}s", tuple(blocks))
    if legs and isinstance(calibration.input.measured, Readings):
        blocks.append(_gauges(calibration.input.measured, machine, calibration.diagnosis))
        sign = "A reading grows when the leg moves towards the dial."
        blocks.append(doc.Paragraph(sign, small=True))
    if given.notes:
        notes = tuple((str(line), doc.Given(note)) for line, note in given.notes[:_MOST_NOTES])
        blocks.append(doc.Grid(("line", "note"), notes, words=(0, 1), caption="Notes at readings."))
    return doc.Section(f"Conditions and {noise}s", tuple(blocks))


def moment(written: str | None) -> doc.Given | None:
    """An ISO 8601 time with a blank for the "T", to the second, its zone set off."""
    if written is None:
        return None
    try:
        time = datetime.fromisoformat(written)
    except ValueError:
        return doc.Given(written)
    zone = f" {time:%z}" if time.tzinfo else ""
    return doc.Given(f"{time:%Y-%m-%d %H:%M:%S}{zone[:4]}{':' if zone else ''}{zone[4:6]}")


def _given(text: str | None) -> doc.Given | None:
    return None if text is None else doc.Given(text)


def _temperature(given: Conditions) -> doc.Blank:
    if given.temperature_c is not None:
        low, high = (plain(t, 1) for t in given.temperature_c)
        return f"{low} °C" if low == high else f"{low} to {high} °C"
    named = dict(given.environment).get("temperature_c")
    return None if named is None else doc.Given(f"{named} °C")


def _seen(cause: NamedCause) -> list[str]:
    """Names of the parameters that stand clear of their uncertainty; of axes or of series."""
    return [
        name
        for name, estimate in cause.parameters.items()
        if set(name) <= {*AXES, "_"} and abs(estimate.value) > SEEN * estimate.std
    ]


def _gauges(readings: Readings, machine: Machine, found: Diagnosis | None) -> doc.Figure:
    """The machine with its gauges, and a ring around those whose readings a cause spoils."""
    plan, causes = readings.plan, found.causes if found else ()
    faults = {
        plan.series[k]
        for cause in causes
        for k in cause.effect.cause.spoiled(cause.effect.place, plan).tolist()
    }
    marked = [f"{cause.id}: {cause.where}" for cause in causes if cause.where]
    rails: set[int] = set()
    for cause in causes:
        seen = _seen(cause)
        if cause.in_machine:
            rails |= {AXES.index(axis) for name in seen for axis in name}
        else:
            faults |= {series for series in plan.series if series.name in seen}
        marked += [f"{cause.id}: {', '.join(seen)}"] if seen and not cause.where else []
    at = [round(place, 3) for place in plan.gauge_at.tolist()]
    places = sorted(set(zip(plan.leg.tolist(), plan.direction.tolist(), at, strict=True)))
    return doc.Figure(
        "Where the gauges stood",
        f"{counted(len(places), 'place')} on three legs."
        + (f" Marked: {'; '.join(marked)}." if marked else ""),
        (views.machine(machine.leg_length_mm, machine.joint_limits_mm, places, faults, rails),),
        columns=1,
        key="● tool, ■ carriage, double line: leg, pale line: travel of the carriage, ○ dial with"
        " the direction in which its reading grows.",
    )


def origin(calibration: Calibration) -> doc.Section:
    """The input, the software, the numbers behind the uncertainty."""
    measured, model = calibration.input.measured, calibration.input.model
    identity, machine = calibration.identity, model.machine
    rows: list[tuple[str, doc.Blank]] = [
        ("Number", doc.Code(identity.number)),
        ("Issued", f"{identity.issued:%Y-%m-%d %H:%M:%S} UTC"),
        ("Software", identity.software),
        ("Input", doc.Given(file_words(measured.source.path))),
        ("SHA-256", doc.Code(measured.source.sha256)),
        ("Data", data_words(measured.source, measured.kind, len(measured))),
        ("Machine", doc.Given(machine.name)),
        ("Geometry", model.machine.geometry_words),
    ]
    if model.accepted:
        accepted = ", ".join(effect.cause.id for effect in model.accepted)
        rows.append(("Accepted", accepted))
    blocks: list[doc.Block] = [doc.Facts(tuple(rows))]
    solution = calibration.solution
    if solution is not None:
        method = f"{solution.method} ({METHOD_WORDS[solution.method]})"
        blocks.append(doc.Paragraph(f"Method: {method}. Standard deviation of one reading, mm:"))
        blocks.append(noise_grid(solution))
        blocks += [doc.Paragraph(warning, small=True) for warning in solution.warnings]
    return doc.Section("Where this comes from", tuple(blocks))
