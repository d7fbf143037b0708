"""The calibration report: one session, its result, and what to do.

The first sheet is what is pinned to the machine: may the parameters be entered, what to do, the
parameters with their uncertainty, as found and as left. Behind it stands what that rests on.
"""

from __future__ import annotations

from functools import partial

from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.errors import file_words
from orthoglide_cal.files import Conditions, machine_values
from orthoglide_cal.model import AXES, DataKind, Series
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.decision import decision_notice, to_do
from orthoglide_cal.report.documents.diagnosis import (
    cause_blocks,
    fit_blocks,
    headline,
    next_blocks,
    note_blocks,
    ranking_grid,
)
from orthoglide_cal.report.documents.parameters import (
    alone_block,
    budget_sections,
    open_blocks,
    parameters_grid,
    parameters_title,
)
from orthoglide_cal.report.documents.pictures import residual_blocks
from orthoglide_cal.report.documents.solution import left_after, method_words, noise_grid
from orthoglide_cal.report.documents.verification import (
    compared_inputs,
    parameters_left,
    verification_notice,
    verification_outcome,
    verification_to_do,
)
from orthoglide_cal.report.facts import (
    data_words,
    due_words,
    method_facts,
    moment,
    owner_facts,
    scope,
)
from orthoglide_cal.results import Answer, FoundCause, Identity, Workspace
from orthoglide_cal.results.verification import Verification
from orthoglide_cal.words import (
    difference_decimals,
    plain,
    short,
    signed,
    two_figures,
)

_MOST_NOTES = 40
# A parameter of a cause that many standard deviations from zero is marked on the sketch.
SEEN = 2.0


def calibration_document(
    case: Case, identity: Identity, left: Verification | None = None
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        case: the input and the answer.
        identity: number, time, software.
        left: of the session measured after the adjustment; None without one.
    """
    return doc.Document(
        partial(report_data, case, identity, left), partial(_page, case, identity, left)
    )


def report_data(case: Case, identity: Identity, left: Verification | None) -> dict[str, object]:
    """The answer, and what only a report says; lengths in mm."""
    given, answer = case.given.conditions, case.answer
    return {
        "schema_version": answer.schema_version,
        "identity": identity.model_dump(mode="json"),
        "machine": machine_values(case.given.model),
        "conditions": {
            **vars(given),
            "environment": dict(given.environment),
            "gauges": [gauge.model_dump(mode="json") for gauge in given.gauges],
            "notes": [{"line": line, "note": note} for line, note in given.notes],
        },
        "answer": answer.model_dump(mode="json"),
        "after": left.model_dump(mode="json") if left else None,
    }


def _page(case: Case, identity: Identity, left: Verification | None) -> doc.Page:
    conditions, machine = case.given.conditions, case.machine
    if left is not None:
        notice = verification_notice(left)
        sheet = [verification_to_do(left, case.machine_file)]
        pages = [verification_outcome(left)]
    else:
        notice = decision_notice(case)
        sheet, pages = [to_do(case)], []
    background = [_conditions(case), _origin(case, identity)]
    if case.answer.parameters:
        sheet += _parameters(case, left)
        pages += _evidence(case, left)
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
        scope=scope(machine),
    )


# --- the first sheet --------------------------------------------------------------------------


def _parameters(case: Case, left: Verification | None) -> list[doc.Section]:
    """The parameters with U, and the deviations as found and as left."""
    answer, machine = case.answer, case.machine
    if left is not None:
        measured = doc.Section("Measurements", (doc.Facts(compared_inputs(left)),))
        sections = [parameters_left(left), measured]
    else:
        blocks = (parameters_grid(case), *open_blocks(case), *alone_block(case))
        sections = [doc.Section(parameters_title(case), blocks)]
    if answer.as_found is None:
        return sections
    raw = answer.input.kind == DataKind.READINGS
    digits = difference_decimals(raw, machine.instrument.resolution_mm)
    columns: list[tuple[doc.Blank, ...]] = [
        (plain(size.rms_mm, digits), signed(size.largest_mm, digits), str(size.largest))
        for size in (answer.as_found, answer.expected)
        if size is not None
    ]
    after = left.as_left if left else None
    columns.append(
        (plain(after.rms_mm, digits), signed(after.largest_mm, digits), after.largest)
        if after
        else (None, None, None)
    )
    rest = "left after correction" if answer.release.usable else "would be left"
    grid = doc.Grid(
        ("", "as found", "promised" if left else rest, "as left"),
        tuple(zip(("r.m.s.", "largest", "which"), *columns, strict=True)),
        caption="Deviation of the legs from parallel motion, mm"
        + ("." if left else "; as left is blank until it is measured again."),
    )
    return [*sections, doc.Section("As found, as left", (grid,))]


# --- the evidence -----------------------------------------------------------------------------


def _evidence(case: Case, left: Verification | None) -> list[doc.Section]:
    """What the result rests on: budget, fit, residuals, diagnosis, error over the workspace."""
    answer = case.answer
    sections = list(budget_sections(case))
    table = left_after(case)
    if answer.deviations and left is None:
        table = doc.Section(table.title, (*table.blocks, _deviations(answer)))
    sections.append(table)
    if blocks := residual_blocks(answer, case.words.many):
        sections.append(doc.Section("Residuals (measured − model), µm", tuple(blocks)))
    if answer.verdict is not None:
        blocks = [doc.Paragraph(headline(case)), *fit_blocks(case), *cause_blocks(case)]
        if answer.verdict is not Verdict.CONSISTENT and answer.explanations:
            blocks.append(ranking_grid(case))
        blocks += [*next_blocks(answer), *note_blocks(case)]
        sections.append(doc.Section("Diagnosis", tuple(blocks)))
    if answer.workspace is not None:
        sections.append(_workspace(case, answer.workspace))
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


def _workspace(case: Case, found: Workspace) -> doc.Section:
    """Tool-position error in slices of the workspace, before and after."""
    before, after, before_mean, after_mean, left = map(
        two_figures,
        (found.before_mm, found.after_mm, found.before_mean_mm, found.after_mean_mm, found.left_mm),
    )
    causes = " and ".join(cause.id for cause in case.known)
    rest = ", which their uncertainty leaves."
    if causes:
        rest = f"; {left} mm of that comes from {causes}, which offsets do not remove."
    timed = "".join(
        f" What {cause.id} does depends on time or on the way there, and is not included."
        for cause in case.known
        if cause.timed
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


def _conditions(case: Case) -> doc.Section:
    """Under which conditions, with which gauges: blank where not given."""
    given, machine, answer = case.given.conditions, case.machine, case.answer
    stated, noise = machine.instrument, machine.vocabulary.noise
    measured = given.finished or given.started
    rows: list[tuple[str, doc.Blank]] = [
        *method_facts(machine, measured),
        ("Protocol", _given(given.protocol)),
        ("Operator", _given(given.operator)),
        ("Started", moment(given.started)),
        ("Finished", moment(given.finished)),
        ("Temperature", _temperature(given)),
    ]
    remarks = ((name, text) for name, text in given.environment if name != "temperature_c")
    rows += [(name.replace("_", " "), doc.Given(text)) for name, text in remarks]
    if case.given.is_session:
        rows += [("Readings replaced", str(given.retaken)), ("Steps left out", str(given.skipped))]
    blocks: list[doc.Block] = [doc.Facts(tuple(rows))]
    if not machine.vocabulary.probing:
        own = {gauge.id: gauge for gauge in machine.gauges}
        gauges: list[tuple[doc.Blank, ...]] = [
            (
                doc.Given(gauge.id),
                _given(gauge.certificate or (known.certificate if known else None)),
                due_words(gauge.due or (known.due if known else None), measured),
                None if gauge.resolution_mm is None else short(gauge.resolution_mm, 6),
            )
            for gauge in given.gauges
            for known in [own.get(gauge.id)]
        ]
        head, nothing = ("gauge", "certificate", "due", "resolution, mm"), ((None,) * 4,)
        caption = "Gauges that were used."
        blocks.append(doc.Grid(head, tuple(gauges) or nothing, words=(0, 1, 2), caption=caption))
    sizes = (
        f"The machine file states for its {noise}: resolution {short(stated.resolution_mm, 6)} mm,"
        f" repeatability {short(stated.repeatability_mm, 6)} mm (one standard deviation)."
    )
    blocks.append(doc.Paragraph(sizes, small=True))
    places = sorted({
        (AXES.index(row.leg), AXES.index(row.direction), round(row.gauge_at, 3))
        for row in answer.residuals
        if row.leg and row.direction and row.gauge_at is not None
    })  # fmt: skip
    if places:
        blocks.append(_sketch(case, places))
        sign = "A reading grows when the leg moves towards the dial."
        blocks.append(doc.Paragraph(sign, small=True))
    if given.notes and answer.parameters:
        notes = tuple((str(line), doc.Given(note)) for line, note in given.notes[:_MOST_NOTES])
        blocks.append(doc.Grid(("line", "note"), notes, words=(0, 1), caption="Notes at readings."))
    return doc.Section(f"Conditions and {noise}s", tuple(blocks))


def _sketch(case: Case, places: list[tuple[int, int, float]]) -> doc.Figure:
    """The machine with its gauges, and a ring around those whose readings a cause spoils."""
    machine = case.given.model.orthoglide
    series = {Series(leg, direction) for leg, direction, _ in places}
    faults: set[tuple[int, int]] = set()
    rails: set[int] = set()
    marked = []
    for cause in case.answer.causes:
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


def _origin(case: Case, identity: Identity) -> doc.Section:
    """The input, the software, the numbers behind the uncertainty."""
    answer, model, machine = case.answer, case.given.model, case.machine
    rows: list[tuple[str, doc.Blank]] = [
        ("Software", identity.software),
        ("Input", doc.Given(file_words(answer.input.path))),
        ("SHA-256", doc.Code(answer.input.sha256)),
        ("Data", data_words(case.source, answer.input.kind, answer.input.readings)),
        ("Machine", doc.Given(machine.name)),
        ("Geometry", machine.geometry_words),
    ]
    if model.accepted:
        accepted = ", ".join(effect.cause.id for effect in model.accepted)
        rows.append(("Accepted", accepted))
    blocks: list[doc.Block] = [doc.Facts(tuple(rows))]
    if answer.method is not None:
        method = method_words(case)
        blocks.append(doc.Paragraph(f"Method: {method}. Standard deviation of one reading, mm:"))
        blocks.append(noise_grid(case))
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
