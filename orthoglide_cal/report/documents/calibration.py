"""The calibration report: one session, its result, and what to do.

The first sheet is what is pinned to the machine: may the parameters be entered, what to do, the
parameters with their uncertainty, as found and as left. Behind it stands what that rests on.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.errors import file_words
from orthoglide_cal.estimation import Method
from orthoglide_cal.files import Conditions, machine_values
from orthoglide_cal.model import AXES, DataKind, Series
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.documents.budget import budget_section
from orthoglide_cal.report.documents.decision import decision_notice, to_do
from orthoglide_cal.report.documents.diagnosis import (
    cause_blocks,
    fit_blocks,
    headline,
    note_blocks,
    ranking_grid,
)
from orthoglide_cal.report.documents.parameters import offsets_grid, offsets_title, open_blocks
from orthoglide_cal.report.documents.pictures import residual_blocks
from orthoglide_cal.report.documents.plan import next_blocks
from orthoglide_cal.report.documents.solution import left_after, noise_grid
from orthoglide_cal.report.documents.verification import (
    entered_and_left,
    verification_data,
    verification_notice,
    verification_outcome,
    verification_to_do,
)
from orthoglide_cal.report.facts import (
    METHOD_WORDS,
    SCOPE,
    data_words,
    method_facts,
    moment,
    owner_facts,
)
from orthoglide_cal.report.json import fields_of
from orthoglide_cal.results import Answer, Calibration
from orthoglide_cal.results.answer import FoundCause
from orthoglide_cal.words import (
    coverage_words,
    difference_decimals,
    plain,
    short,
    signed,
    two_figures,
    with_uncertainty,
)

_MOST_NOTES = 40
# A parameter of a cause that many standard deviations from zero is marked on the sketch.
SEEN = 2.0


def calibration_document(
    calibration: Calibration, machine_file: Path | None = None
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        calibration: the input, its identity, the answer, and the verification.
        machine_file: as the user gave it, for the commands to run next.
    """
    return doc.Document(
        partial(report_data, calibration, calibration.answer),
        partial(_page, calibration, calibration.answer, machine_file),
    )


def report_data(calibration: Calibration, answer: Answer) -> dict[str, Any]:
    """The answer, and what only a report says; lengths in mm."""
    given, left = calibration.input.conditions, calibration.verification
    issued = calibration.identity.issued.isoformat(timespec="seconds")
    return {
        "schema_version": answer.schema_version,
        "identity": {**fields_of(calibration.identity, "number", "software"), "issued": issued},
        "machine": machine_values(calibration.input.model),
        "conditions": {
            **fields_of(given, "protocol", "operator", "started", "finished", "temperature_c"),
            "environment": dict(given.environment),
            "gauges": [
                {"id": gauge.label, **fields_of(gauge, "certificate", "resolution_mm")}
                for gauge in given.gauges
            ],
            **fields_of(given, "retaken", "skipped"),
            "notes": [{"line": line, "note": note} for line, note in given.notes],
        },
        "answer": answer.model_dump(mode="json"),
        "after": verification_data(left) if left else None,
    }


def _page(calibration: Calibration, answer: Answer, machine_file: Path | None) -> doc.Page:
    identity, conditions = calibration.identity, calibration.input.conditions
    machine, verification = calibration.input.model.machine, calibration.verification
    if verification is not None:
        notice = verification_notice(verification)
        sheet = [verification_to_do(verification, machine_file)]
        pages = [verification_outcome(verification)]
    else:
        notice = decision_notice(calibration)
        sheet, pages = [to_do(calibration, machine_file)], []
    background = [_conditions(calibration, answer), _origin(calibration, answer)]
    if answer.parameters:
        sheet += _parameters(calibration, answer)
        pages += _evidence(calibration, answer, machine_file)
        pages += background
    else:
        # There is nothing to pin to the machine, and one sheet of paper says it all.
        sheet += background
    return doc.Page(
        kind="Calibration report",
        title=machine.name,
        number=identity.number,
        facts=doc.Facts(
            (
                *owner_facts(machine),
                ("Number", doc.Code(identity.number)),
                ("Measured", moment(conditions.finished or conditions.started)),
                ("Issued", f"{identity.issued:%Y-%m-%d %H:%M} UTC"),
            )
        ),
        notice=notice,
        sheet=tuple(sheet),
        sections=tuple(pages),
        signatures=("Measured by", "Adjusted by", "Checked by"),
        scope=machine.vocabulary.said(SCOPE),
    )


# --- the first sheet --------------------------------------------------------------------------


def _parameters(calibration: Calibration, answer: Answer) -> list[doc.Section]:
    """The parameters with U, and the deviations as found and as left."""
    found, left = calibration.adjustment, calibration.verification
    machine, usable = calibration.input.model.machine, answer.release.usable
    assert found is not None
    coverage = doc.Paragraph(_coverage(answer, machine.vocabulary.many), small=True)
    if left is not None:
        sections = [entered_and_left(found, left)]
    elif machine.absolute:
        blocks = (offsets_grid(found, calibration.enters), *open_blocks(calibration, found))
        sections = [doc.Section(offsets_title(found, usable), (*blocks, coverage))]
    else:
        title = "Joint offsets" if usable else "Joint offsets as found"
        sections = [doc.Section(title, (_tiles(answer), coverage))]
    if answer.as_found is None:
        return sections
    raw = answer.input.kind == DataKind.READINGS
    digits = difference_decimals(raw, machine.gauge.resolution_mm)
    columns: list[tuple[doc.Blank, ...]] = [
        (plain(size.rms_mm, digits), signed(size.largest_mm, digits), str(size.largest))
        for size in (answer.as_found, answer.expected)
        if size is not None
    ]
    after = left.as_left if left else None
    columns.append(
        (plain(after.rms_mm, digits), signed(after.largest_mm, digits), after.largest.name)
        if after
        else (None, None, None)
    )
    grid = doc.Grid(
        ("", "as found", "promised" if left else "left after correction", "as left"),
        tuple(zip(("r.m.s.", "largest", "which"), *columns, strict=True)),
        caption="Deviation of the legs from parallel motion, mm"
        + ("." if left else "; as left is blank until it is measured again."),
    )
    return [*sections, doc.Section("As found, as left", (grid,))]


def _tiles(answer: Answer) -> doc.Grid:
    """Joint offsets, to be read from afar."""
    digits, usable = answer.decimals, answer.release.usable
    rows: tuple[tuple[doc.Blank, ...], ...] = tuple(
        (
            doc.Strong(each.name),
            signed(each.active, digits),
            with_uncertainty(each.found or 0.0, each.expanded),
            *([doc.Strong(signed(each.new(digits), digits))] if usable else []),
        )
        for each in answer.parameters
    )
    return doc.Grid(
        ("axis", "now", "Δρ ± U", *(["enter"] if usable else [])),
        rows,
        caption="In mm. Now: active in the controller. True joint position = indicated + Δρ.",
        tiles=True,
    )


def _coverage(answer: Answer, many: str) -> str:
    """How U was made."""
    source = "normal distribution"
    if answer.dof is not None:
        source = f"Student's t with {answer.dof} effective degrees of freedom"
    causes = " and ".join(answer.named)
    return (
        f"U = k·u is the expanded uncertainty with {coverage_words(answer.k or 0.0)} ({source}),"
        f" for a confidence of {100 * answer.confidence:.0f} %."
        + (f" Model: {many} and {causes}." if causes else "")
    )


# --- the evidence -----------------------------------------------------------------------------


def _evidence(
    calibration: Calibration, answer: Answer, machine_file: Path | None
) -> list[doc.Section]:
    """What the result rests on: budget, fit, residuals, diagnosis, error over the workspace."""
    solution, found, diagnosis = calibration.solution, calibration.adjustment, calibration.diagnosis
    assert solution is not None
    assert found is not None
    sections = [budget_section(found.budget, found.machine)]
    table = left_after(solution, found.promised, usable=answer.release.usable)
    if answer.deviations and calibration.verification is None:
        table = doc.Section(table.title, (*table.blocks, _deviations(answer)))
    sections.append(table)
    if blocks := residual_blocks(answer, found.machine.vocabulary.many):
        sections.append(doc.Section("Residuals (measured − model), µm", tuple(blocks)))
    if diagnosis is not None:
        blocks = [doc.Paragraph(headline(diagnosis)), *fit_blocks(diagnosis)]
        blocks += cause_blocks(diagnosis, machine_file)
        if answer.verdict is not Verdict.CONSISTENT and answer.explanations:
            blocks.append(ranking_grid(diagnosis))
        blocks += [*next_blocks(diagnosis, calibration.following), *note_blocks(diagnosis)]
        sections.append(doc.Section("Diagnosis", tuple(blocks)))
    if answer.workspace is not None:
        sections.append(_workspace(calibration, answer))
    return sections


def _deviations(answer: Answer) -> doc.Figure:
    rows = answer.deviations
    panel = figures.deviation_rows(
        [row.name for row in rows],
        [row.measured_mm for row in rows],
        [row.expected_mm for row in rows],
        [row.expanded_mm for row in rows],
    )
    key = "○ as found, ■ expected after entering, with U (95 %)."
    return doc.Figure(None, "Each difference as found, and as expected.", (panel,), 1, key)


def _workspace(calibration: Calibration, answer: Answer) -> doc.Section:
    """Tool-position error in slices of the workspace, before and after."""
    found = answer.workspace
    assert found is not None
    before, after, before_mean, after_mean, left = map(
        two_figures,
        (found.before_mm, found.after_mm, found.before_mean_mm, found.after_mean_mm, found.left_mm),
    )
    effects = calibration.model.accepted
    causes = " and ".join(effect.cause.id for effect in effects)
    rest = ", which their uncertainty leaves."
    if causes:
        rest = f"; {left} mm of that comes from {causes}, which offsets do not remove."
    timed = "".join(
        f" What {effect.cause.id} does depends on time or on the way there, and is not included."
        for effect in effects
        if effect.cause.timed
    )
    lead = doc.Paragraph(
        f"Before: up to {before} mm (mean {before_mean}). After the offsets are entered: at most"
        f" {after} mm (mean {after_mean}){rest}{timed}"
    )
    low, high = (plain(edge, 0) for edge in found.cube_mm)
    figure = doc.Figure(
        "Distance between commanded and true tool position, mm",
        "",
        figures.workspace_maps(found.maps) if found.maps else (),
        key=f"Cube from {low} to {high} mm along x, y and z: what the joint limits allow"
        f" (workspace by the machine file: {plain(found.stated_edge_mm, 0)} mm).",
    )
    return doc.Section("Tool-position error over the workspace", (lead, figure))


# --- conditions and origin --------------------------------------------------------------------


def _conditions(calibration: Calibration, answer: Answer) -> doc.Section:
    """Under which conditions, with which gauges: blank where not given."""
    given, machine = calibration.input.conditions, calibration.input.model.machine
    stated, noise = machine.gauge, machine.vocabulary.noise
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
        rows += [("Readings replaced", str(given.retaken)), ("Steps left out", str(given.skipped))]
    blocks: list[doc.Block] = [doc.Facts(tuple(rows))]
    if not machine.vocabulary.probing:
        gauges: list[tuple[doc.Blank, ...]] = [
            (
                doc.Given(gauge.label),
                _given(gauge.certificate),
                None if gauge.resolution_mm is None else short(gauge.resolution_mm, 6),
            )
            for gauge in given.gauges
        ]
        head, nothing = ("gauge", "certificate", "resolution, mm"), ((None, None, None),)
        caption = "Gauges that were used."
        blocks.append(doc.Grid(head, tuple(gauges) or nothing, words=(0, 1), caption=caption))
    sizes = (
        f"The machine file states for its {noise}: resolution {short(stated.resolution_mm, 6)} mm,"
        f" repeatability {short(stated.repeatability_mm, 6)} mm (one standard deviation)."
    )
    blocks.append(doc.Paragraph(sizes, small=True))
    places = sorted({
        (*_series(row.leg, row.direction), round(row.gauge_at, 3))
        for row in answer.residuals
        if row.leg and row.direction and row.gauge_at is not None
    })  # fmt: skip
    if places:
        blocks.append(_sketch(calibration, answer, places))
        sign = "A reading grows when the leg moves towards the dial."
        blocks.append(doc.Paragraph(sign, small=True))
    if given.notes and answer.parameters:
        notes = tuple((str(line), doc.Given(note)) for line, note in given.notes[:_MOST_NOTES])
        blocks.append(doc.Grid(("line", "note"), notes, words=(0, 1), caption="Notes at readings."))
    return doc.Section(f"Conditions and {noise}s", tuple(blocks))


def _series(leg: str, direction: str) -> Series:
    return Series(AXES.index(leg), AXES.index(direction))


def _sketch(
    calibration: Calibration, answer: Answer, places: list[tuple[int, int, float]]
) -> doc.Figure:
    """The machine with its gauges, and a ring around those whose readings a cause spoils."""
    machine = calibration.input.model.orthoglide
    series = {Series(leg, direction) for leg, direction, _ in places}
    faults: set[tuple[int, int]] = set()
    rails: set[int] = set()
    marked = []
    for cause in answer.causes:
        seen = _seen(cause)
        if cause.in_machine:
            rails |= {AXES.index(axis) for name in seen for axis in name if axis in AXES}
        else:
            faults |= {one for one in series if one.name in seen or one.words in cause.where}
        if cause.where or seen:
            marked.append(f"{cause.id}: {cause.where or ', '.join(seen)}")
    return doc.Figure(
        "Where the gauges stood",
        f"Marked: {'; '.join(marked)}." if marked else "",
        (
            figures.machine_sketch(
                machine.leg_length_mm, machine.joint_limits_mm, places, faults, rails
            ),
        ),
        columns=1,
        key="● tool, ■ carriage, double line: leg, pale line: travel of the carriage, ○ dial with"
        " the direction in which its reading grows.",
    )


def _seen(cause: FoundCause) -> list[str]:
    """Names of the parameters that stand clear of their uncertainty; of axes or of series."""
    return [
        each.name
        for each in cause.parameters
        if set(each.name) <= {*AXES, "_"} and abs(each.value) > SEEN * each.std
    ]


def _origin(calibration: Calibration, answer: Answer) -> doc.Section:
    """The input, the software, the numbers behind the uncertainty."""
    measured, model = calibration.input.measured, calibration.input.model
    identity, machine = calibration.identity, model.machine
    rows: list[tuple[str, doc.Blank]] = [
        ("Number", doc.Code(identity.number)),
        ("Issued", f"{identity.issued:%Y-%m-%d %H:%M:%S} UTC"),
        ("Software", identity.software),
        ("Input", doc.Given(file_words(answer.input.path))),
        ("SHA-256", doc.Code(answer.input.sha256)),
        ("Data", data_words(measured.source, answer.input.kind, answer.input.readings)),
        ("Machine", doc.Given(machine.name)),
        ("Geometry", machine.geometry_words),
    ]
    if model.accepted:
        accepted = ", ".join(effect.cause.id for effect in model.accepted)
        rows.append(("Accepted", accepted))
    blocks: list[doc.Block] = [doc.Facts(tuple(rows))]
    if calibration.solution is not None and answer.method is not None:
        method = f"{answer.method} ({METHOD_WORDS[Method(answer.method)]})"
        blocks.append(doc.Paragraph(f"Method: {method}. Standard deviation of one reading, mm:"))
        blocks.append(noise_grid(calibration.solution))
        blocks += [doc.Paragraph(warning, small=True) for warning in answer.warnings]
    return doc.Section("Traceability", tuple(blocks))


def _given(text: str | None) -> doc.Given | None:
    return None if text is None else doc.Given(text)


def _temperature(given: Conditions) -> doc.Blank:
    if given.temperature_c is not None:
        low, high = (plain(t, 1) for t in given.temperature_c)
        return f"{low} °C" if low == high else f"{low} to {high} °C"
    named = dict(given.environment).get("temperature_c")
    return None if named is None else doc.Given(f"{named} °C")
