"""The calibration report: one session, its result, and what to do.

The first sheet is what is pinned to the machine: may the parameters be entered, the parameters with
U, each difference as found and as left, what to do, under which conditions that holds. Of a result
that is refused it says what is wrong, and nothing to sign for an adjustment. Behind it stands what
that rests on.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import file_words
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.inference import Verdict
from orthoglide_cal.model.cause import Estimate
from orthoglide_cal.model.measured import NOZZLE, DataKind
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import (
    INVALIDATING,
    MEANS,
    Case,
    data_words,
    decision_notice,
    moment,
    position_words,
    reserved,
    signed_page,
    size_words,
    stated,
    to_do,
)
from orthoglide_cal.report.documents import pictures, solution, verification
from orthoglide_cal.report.documents.diagnosis import RESIDUALS, diagnosis_notice, diagnosis_section
from orthoglide_cal.results import Identity
from orthoglide_cal.results.verification import Verification
from orthoglide_cal.words import plain, short, two_figures

_MOST_NOTES = 40


def calibration_document(
    case: Case,
    identity: Identity,
    left: Verification | None = None,
    limit_mm: float | None = None,
    after: Case | None = None,
) -> doc.Document:
    """The document; as data the answer, and what only a report says.

    Args:
        case, identity: the result and its number.
        left, after: comparison with the session measured after the adjustment, and its result;
            None without one.
        limit_mm: largest deviation allowed; None where none is given.
    """
    given, answer = case.given.conditions, case.answer

    def data() -> dict[str, object]:
        return {
            "schema_version": answer.schema_version,
            "simulated": answer.simulated,
            "identity": identity.model_dump(mode="json"),
            "machine": machine_values(case.given.model),
            "conditions": {
                **vars(given),
                "environment": dict(given.environment),
                "gauges": [gauge.model_dump(mode="json") for gauge in answer.validity.gauges],
                "notes": [{"line": line, "note": note} for line, note in given.notes],
            },
            "limit_mm": limit_mm,
            "answer": case.data(),
            "after": left.model_dump(mode="json", context=case.says) if left else None,
            "as_left": after.data() if after else None,
            "others": [other.data() for other in case.others],
        }

    def page() -> doc.Page:
        machine = case.machine
        recorded = [(answer.input, answer.validity)]
        if left is not None:
            recorded = [(side, side.validity) for side in (left.before, left.after)]
        frame = signed_page("Calibration report", machine, identity, recorded)
        released = answer.release.usable or left is not None
        measured = [(after, ", as left"), (case, ", as found")] if after else [(case, "")]
        pages = [part for one, when in measured for part in _evidence(one, when)]
        pages += [*_workspace(case, left, limit_mm), _origin(case, identity, left)]
        for one, when in measured:
            if one.answer.input.kind == DataKind.READINGS:  # differences stand among the residuals
                pages.append(doc.Section(f"Appendix: readings{when}", pictures.readings_table(one)))
        drawn, named = _differences(case, left, limit_mm), [*_causes(case)]
        rivals = [*_rivals(case)]
        if len(named) == 1 and len(rivals) > 1:  # two drawings have room on the first sheet
            named.append(rivals.pop(0))
        sheet = [*_result(case, left, named, drawn), *frame.sheet, *map(_other, case.others)]
        if named and not released:
            pages.insert(1, _parameters(case, drawn))
            pages[:0] = rivals
        if not answer.parameters:  # nothing to pin to the machine: one sheet of paper says it all
            sheet, pages = [*sheet, *pages], []
        authorised = machine.report.authorised_by
        roles = ["Measured by", "Adjusted by"] if released else ["Measured by"]
        return replace(
            frame,
            notice=_notice(case, left),
            sheet=sheet,
            sections=pages,
            signatures=(*roles, f"Authorised by {authorised}" if authorised else "Authorised by"),
        )

    return doc.Document(data, page)


# --- the first sheet --------------------------------------------------------------------------


def _notice(case: Case, left: Verification | None) -> doc.Notice:
    """The verdict, with what to know before relying on it; of a refused result what is wrong."""
    if left is not None:
        return verification.verification_notice(left)
    answer, release = case.answer, case.answer.release
    wrong = release.sound and answer.parameters and not release.usable
    notice = diagnosis_notice(case) if wrong else decision_notice(case)
    known = [*release.reasons, *release.cautions]
    papers = (e for e in answer.validity.reservations if e.code not in INVALIDATING)
    return reserved(notice, [case.says(e) for e in papers if e not in known])


def _result(
    case: Case, left: Verification | None, named: Sequence[doc.Section], drawn: doc.Figure | None
) -> Sequence[doc.Section]:
    """What was found, and the next steps; of a refused result the causes come first."""
    if left is not None:
        steps = verification.verification_steps(left, case.machine_file)
        rule = verification.decision_rule(left)
        return verification.parameters_left(left), doc.next_steps(steps, rule, drawn)
    if case.answer.release.usable:
        moved = (case.says(r) for r in case.given.measured.remarks if r.code in NOZZLE)
        return _parameters(case, drawn), *named, doc.next_steps(to_do(case), *moved)
    next_steps = doc.next_steps(to_do(case))
    # Where the causes are drawn, the first sheet is full.
    if named or not case.answer.parameters:
        return *named, next_steps
    return next_steps, _parameters(case, drawn)


def _parameters(case: Case, drawn: doc.Figure | None) -> doc.Section:
    """The parameters with U next to the differences."""
    title, usable = solution.parameters_title(case), case.answer.release.usable
    if not usable:
        causes = f" with {' and '.join(case.answer.named)}" if case.answer.named else ""
        title = f"Not to be entered: {case.words.many}{causes}{solution.common_unit(case.machine)}"
    alone = solution.alone_block(case) if usable else ()
    return doc.Section(
        title, solution.parameters_grid(case), *solution.open_blocks(case), *alone, drawn
    )


def _causes(case: Case) -> Iterator[doc.Section]:
    """Each cause of the likeliest answer: where, how large with U, drawn, what to do about it."""
    answer, undecided = case.answer, case.answer.verdict is Verdict.AMBIGUOUS
    advised = " ".join(case.says(remedy.sentence) for remedy in answer.release.remedies)
    for cause in answer.causes if answer.verdict is Verdict.NAMED or undecided else ():
        title = f"{case.title_of(cause.id)} ({cause.id})"
        title = f"Possible: {title}" if undecided else f"{title[0].upper()}{title[1:]}"
        grid = _cause_grid(case, cause.id, cause.parameters, cause.where)
        new = cause.remedy.rstrip(".") not in advised
        remedy = f"{'If so: ' * undecided}{cause.remedy}" if new else None
        yield doc.Section(title, grid, remedy, pictures.cause_figure(case, cause))


def _cause_grid(case: Case, id: str, parameters: Sequence[Estimate], where: str = "") -> doc.Block:
    """Where a cause is, and how large with U."""
    gaps, seen = pictures.moves_rails(id), pictures.seen_parameters(parameters)
    sizes = [size for size in parameters if gaps or size in seen]
    if not sizes:
        return doc.strong(f"At {where}.")
    places = [figures.place_words(size.name) for size in sizes]
    if where and len(sizes) < 2:
        places = [where]
    columns: dict[str, Sequence[doc.Blank]] = {"": [*map(doc.strong, places)]}
    columns["size ± U (95 %)"] = [size_words(e.value, e.expanded, e.unit) for e in sizes]
    if gaps and (shims := case.answer.shims):
        columns["shim"] = [
            f"move rail {e.rail} by {plain(e.mm, 2)} mm towards {e.along}" for e in shims
        ]
    caption = "xy: how far rail x lies above rail y, along z; and so on. " * gaps
    if len(sizes) < len(parameters):
        undecided = case.answer.verdict is Verdict.AMBIGUOUS
        caption += "All others: smaller." if undecided else "All others: within U."
    return doc.Grid.of(columns, range(len(columns)), caption)


def _rivals(case: Case) -> Iterator[doc.Section]:
    """What the readings cannot distinguish from the likeliest answer; its likeliest rival drawn."""
    words = {id: CAUSES[id].words(case.machine) for id in case.answer.ambiguous_with}
    rivals = (state.sizes for state in case.answer.explanations if {*state.sizes} & {*words})
    for id, sizes in next(rivals, {}).items():
        if id in words and (sketch := pictures.cause_sketch(case, id, sizes)):
            cause, grid = words.pop(id), _cause_grid(case, id, sizes)
            text = f"How to check: {cause.instrument}. If so: {cause.advice}"
            yield doc.Section(f"Or: {cause.title} ({id})", grid, text, sketch)
    lines = (f"{one.title} ({id}). How to check: {one.instrument}." for id, one in words.items())
    yield doc.Section("Also possible", *(f"{line[0].upper()}{line[1:]}" for line in lines))


def _differences(
    case: Case, left: Verification | None, limit_mm: float | None
) -> doc.Figure | None:
    """Each difference on one axis: as found, as expected, as measured afterwards."""
    answer = case.answer
    if left is not None:
        return verification.left_figure(left)
    if not answer.deviations or answer.as_found is None or answer.expected is None:
        return None
    rows = [(e.name, e.measured_mm, e.expected_mm, e.expanded_mm, None) for e in answer.deviations]
    sizes = (answer.as_found.rms_mm, answer.expected.rms_mm)
    ends = answer.check is not None and answer.check.ends
    return pictures.differences_figure(rows, sizes, ends, limit_mm)


def _other(case: Case) -> doc.Section:
    """Other data of the same file: their verdict and residuals."""
    blocks: list[doc.Block] = [decision_notice(case)]
    if rms := case.answer.rms:
        before, after = (plain(size, 4) for size in (rms.before_mm, rms.after_mm))
        blocks.append(f"{before} mm r.m.s. as found, {after} if entered.")
    again = doc.Instruction("See its report.", case.typed("report"))
    title = f"Also judged: {data_words(case.source, case.answer.input.kind, 0)}"
    return doc.Section(title, *blocks, doc.Instructions([again]))


# --- the evidence -----------------------------------------------------------------------------


def _evidence(case: Case, when: str) -> Iterator[doc.Section]:
    """Residuals, diagnosis, uncertainty and conditions of one measurement, named by `when`."""
    answer, sections = case.answer, [_conditions(case)]
    if answer.parameters:
        left = doc.Section(RESIDUALS, *pictures.residual_blocks(case))
        budget = solution.budget_sections(case.machine, answer.budget, answer.total)
        sections = [diagnosis_section(case), left, *budget, *sections]
    for section in sections:
        yield doc.Section(f"{section.title}{when}", *section.blocks)


def _workspace(
    case: Case, left: Verification | None, limit_mm: float | None
) -> Iterator[doc.Section]:
    """Tool-position error in slices of the workspace, as found and afterwards."""
    before, after = case.answer.workspace, left.workspace if left else None
    if before is None or before.maps is None:
        return
    views = [("as found", before.maps[0], before.before_mm, before.worst_before_mm)]
    if after and after.maps:
        views.append(("as left", after.maps[0], after.before_mm, after.worst_before_mm))
    else:
        views.append(("expected", before.maps[1], before.after_mm, before.worst_after_mm))
    lead = [
        f"{when.capitalize()}: at most {two_figures(mm)} mm, at {position_words(worst, 0)}."
        for when, _, mm, worst in views
    ]
    if after is None:
        source = "All of that comes from uncertainty."
        if causes := " and ".join(cause.id for cause in case.known):
            source = f"{two_figures(before.left_mm)} mm of that comes from {causes},"
            source += " which offsets do not remove."
        lead.append(source)
        if timed := " and ".join(cause.id for cause in case.known if cause.timed):
            lead.append(f"Not included: the effect of {timed}, which depends on time or path.")
    low, high = (plain(edge, 0) for edge in before.cube_mm)
    key = f"○ worst point. Cube {low} to {high} mm along x, y and z, within the joint limits."
    key += "" if limit_mm is None else f" Dotted: {limit_mm:g} mm."
    maps = doc.Figure([*figures.workspace_maps(views, before.cube_mm, limit_mm)], key=key)
    yield doc.Section("Tool-position error over the workspace", " ".join(lead), maps)


# --- conditions and origin --------------------------------------------------------------------


def _conditions(case: Case) -> doc.Section:
    """How it was measured, and where the gauges stood; blank where not given."""
    given, machine, answer = case.given.conditions, case.machine, case.answer
    gauge, noise = machine.instrument, machine.vocabulary.noise
    rows: list[tuple[str, doc.Blank]] = [
        ("Protocol", given.protocol and doc.given(given.protocol)),
        ("Started", moment(given.started)),
        ("Finished", moment(given.finished)),
    ]
    for name, text in given.environment:
        if "temperature" not in name:  # they stand under the verdict
            rows.append((name.replace("_", " "), doc.given(text)))
    if case.given.is_session:
        rows += [("Readings replaced", str(given.retaken)), ("Steps left out", str(given.skipped))]
    # Blanks are for those who write down how it was.
    rows = [row for row in rows if row[1] is not None or machine.noted]
    sizes = f"resolution {short(gauge.resolution_mm, 6)} mm, repeatability"
    sizes += f" {short(gauge.repeatability_mm, 6)} mm (one standard deviation), as stated"
    rows.append((noise.capitalize(), sizes))
    places = {
        (AXES.index(row.leg), AXES.index(row.direction), round(row.gauge_at, 3))
        for row in answer.residuals
        if row.leg and row.direction and row.gauge_at is not None
    }
    drawn, notes = None, given.notes[:_MOST_NOTES] if answer.parameters else ()
    if places:
        sketch = figures.machine_sketch(machine.leg_mm, machine.limits_mm, sorted(places))
        key = "○ dial: its reading grows when the leg moves towards it."
        drawn = doc.Figure([sketch], 0, key, "Where the gauges stood")
    rows_of_notes = [(str(line), doc.given(note)) for line, note in notes]
    grid = doc.Grid(("line", "note"), rows_of_notes, (0, 1), "Notes at readings.")
    return doc.Section(f"Conditions and {noise}s", doc.Facts(rows), drawn, grid)


def _origin(case: Case, identity: Identity, left: Verification | None) -> doc.Section:
    """The input, the software, the numbers behind the uncertainty."""
    answer, model, machine = case.answer, case.given.model, case.machine
    rows: list[tuple[str, doc.Blank]] = [*stated(machine, MEANS)]
    if machine.report.traceability is None:
        rows.append(("Traceability", None))
    rows.append(("Software", identity.software))
    if left is not None:
        rows += verification.compared_inputs(left)
    else:
        rows += [
            ("Input", doc.given(file_words(answer.input.path))),
            ("SHA-256", doc.code(answer.input.sha256)),
            ("Data", data_words(case.source, answer.input.kind, answer.input.readings)),
        ]
    rows += [("Machine", doc.given(machine.name)), ("Geometry", machine.geometry_words)]
    if model.accepted:
        rows.append(("Accepted", ", ".join(effect.cause.id for effect in model.remaining())))
    if answer.method is not None and answer.noise is not None:
        rows += solution.fit_facts(case)
    new = (warning for warning in answer.warnings if warning not in answer.notes)
    notes = (doc.small(case.says(warning)) for warning in new)
    return doc.Section("Traceability", doc.Facts(rows), *notes)
