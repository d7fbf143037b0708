"""The calibration report: one session, its result, and what to do.

The first sheet is what is pinned to the machine: may the parameters be entered, the parameters with
U, each difference as found and as left, what to do, under which conditions that holds. Of a result
that is refused it says what is wrong, and nothing to sign for an adjustment. Behind it stands what
that rests on.
"""

from collections.abc import Iterator
from dataclasses import replace

from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.inference import Verdict
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import (
    INVALIDATING,
    MEANS,
    Case,
    input_words,
    moment,
    origin,
    position_words,
    reserved,
    signed_page,
    stated,
)
from orthoglide_cal.report.documents import pictures, verification
from orthoglide_cal.report.documents.answer import (
    cause_sizes,
    decision_notice,
    evidence,
    open_blocks,
    parameters_grid,
    parameters_title,
    promised_figure,
    steps_section,
    to_do,
)
from orthoglide_cal.report.sentences import cause_words
from orthoglide_cal.results.answer import Identity
from orthoglide_cal.results.verification import Verification
from orthoglide_cal.words import capitalized, plain, short, two_figures

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
                **{name: value for name, value in given if name != "schema_version"},
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
        machine, released = case.machine, answer.release.usable or left is not None
        recorded = [(answer.input, answer.validity)]
        if left is not None:
            recorded = [(side, side.validity) for side in (left.before, left.after)]
        simulated = left.simulated if left else answer.simulated
        frame = signed_page("Calibration report", machine, identity, recorded, simulated)
        causes, rivals = _causes(case), [*_rivals(case)]
        if len(causes) == 1 and len(rivals) > 1:  # two drawings have room on the first sheet
            causes.append(rivals.pop(0))
        parameters, pages = _parameters(case, limit_mm), [*map(_other, case.others)]
        if left is not None:
            notice = verification.verification_notice(left)
            # Beside each other: the sheet has no room for a section more.
            measured = verification.differences_left(left).blocks
            steps = doc.next_steps(verification.verification_steps(left), *measured)
            sheet = [verification.parameters_left(left), steps]
        elif released:
            notice, sheet = _notice(case), [parameters, *causes, steps_section(case, to_do(case))]
        else:
            notice, sheet = _notice(case), [*causes, steps_section(case, to_do(case))]
            pages += [*rivals, parameters]
        sheet += frame.sheet
        both = [(after, ", as left"), (case, ", as found")] if after else [(case, "")]
        for one, when in both:
            sections = *evidence(one), _conditions(one)
            pages += [doc.Section(f"{part.title}{when}", *part.blocks) for part in sections]
        pages += [*_workspace(case, after, limit_mm), _origin(case, left)]
        for one, when in both:
            if one.answer.input.kind == DataKind.READINGS:  # differences stand among the residuals
                pages.append(doc.Section(f"Appendix: readings{when}", pictures.readings_table(one)))
        if not answer.parameters:  # nothing to pin to the machine: one sheet of paper says it all
            sheet, pages = [*sheet, *pages], []
        authorised = machine.report.authorised_by
        roles = ["Measured by", "Adjusted by"] if released else ["Measured by"]
        return replace(
            frame,
            notice=notice,
            sheet=sheet,
            sections=pages,
            signatures=(*roles, f"Authorised by {authorised}" if authorised else "Authorised by"),
        )

    return doc.Document(data, page)


# --- the first sheet --------------------------------------------------------------------------


def _notice(case: Case) -> doc.Notice:
    """The verdict, with what to know before relying on it; of a refused result what is wrong."""
    release = case.answer.release
    notice = decision_notice(case, diagnosed=release.sound and not release.usable)
    known = [*release.reasons, *release.cautions]
    papers = (e for e in case.answer.validity.reservations if e.code not in INVALIDATING)
    return reserved(notice, [case.says(e) for e in papers if e not in known])


def _parameters(case: Case, limit_mm: float | None) -> doc.Section:
    """The parameters with U, and each difference as found and as expected on one axis."""
    blocks = (parameters_grid(case), *open_blocks(case), promised_figure(case, limit_mm))
    return doc.Section(parameters_title(case), *blocks)


def _causes(case: Case) -> list[doc.Section]:
    """Each cause of the likeliest answer: where, how large with U, drawn, what to do about it."""
    sections = list[doc.Section]()
    answer, undecided = case.answer, case.answer.verdict is Verdict.AMBIGUOUS
    advised = " ".join(case.says(remedy.sentence) for remedy in answer.release.remedies)
    for cause in answer.causes if answer.verdict is Verdict.NAMED or undecided else ():
        title = f"{case.title_of(cause.id)} ({cause.id})"
        blocks: list[doc.Block] = [*cause_sizes(cause.id, cause.parameters, cause.where)]
        if pictures.moves_rails(cause.id) and answer.shims:
            rows = [(e.rail, f"{plain(e.mm, 2)} mm", e.along) for e in answer.shims]
            above = "U: 95 %. xy: how far rail x lies above rail y, along z; and so on."
            blocks += (doc.small(above), doc.Grid(("rail", "move by", "towards"), rows))
        if (remedy := case.says(cause.remedy)).rstrip(".") not in advised:
            blocks.append(f"{'If so: ' * undecided}{remedy}")
        title = f"Possible: {title}" if undecided else capitalized(title)
        drawn = pictures.cause_figure(case, cause)
        if sections and not drawn:  # beside the map that shows what all of them do
            sections[-1].blocks += (doc.strong(title), *blocks)
        else:
            sections.append(doc.Section(title, *blocks, drawn))
    return sections


def _rivals(case: Case) -> Iterator[doc.Section]:
    """Causes not distinguished from the likeliest answer; its likeliest rival is drawn."""
    words = {id: cause_words(id, case.machine) for id in case.answer.ambiguous_with}
    rivals = (state.sizes for state in case.answer.explanations if {*state.sizes} & {*words})
    for id, sizes in next(rivals, {}).items():
        if id in words and (sketch := pictures.cause_sketch(case, id, sizes)):
            cause = words.pop(id)
            text = f"How to check: {cause['check']}. If so: {cause['advice']}"
            yield doc.Section(f"Or: {cause['title']} ({id})", *cause_sizes(id, sizes), text, sketch)
    lines = (f"{e['title']} ({id}). How to check: {e['check']}." for id, e in words.items())
    yield doc.Section("Also possible", *map(capitalized, lines))


def _other(case: Case) -> doc.Section:
    """Other data of the same file: their verdict and residuals."""
    blocks: list[doc.Block] = [decision_notice(case)]
    if rms := case.answer.rms:
        before, after = (plain(size, 4) for size in (rms.before_mm, rms.after_mm))
        blocks.append(f"{before} mm r.m.s. as found, {after} if entered.")
    again = doc.step("See its report.", case.typed("report"))
    title = f"Also judged: {input_words(case.given)}"
    return doc.Section(title, *blocks, doc.Instructions([again]))


# --- the evidence -----------------------------------------------------------------------------


def _workspace(case: Case, later: Case | None, limit_mm: float | None) -> Iterator[doc.Section]:
    """Tool-position error in slices of the workspace, as found and afterwards."""
    before, after = case.answer.workspace, later.answer.workspace if later else None
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
    """Conditions of the measurement, and places of the gauges; blank where not given."""
    given, machine, answer = case.given.conditions, case.machine, case.answer
    gauge, noise = machine.instrument, machine.vocabulary.noise
    rows: list[tuple[str, doc.Blank]] = [
        ("Protocol", given.protocol and doc.given(given.protocol)),
        ("Started", moment(given.started)),
        ("Finished", moment(given.finished)),
    ]
    for name, text in given.environment.items():
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


def _origin(case: Case, left: Verification | None) -> doc.Section:
    """The inputs, and the machine that they are judged by."""
    model, machine = case.given.model, case.machine
    rows: list[tuple[str, doc.Blank]] = [*stated(machine, MEANS)]
    if machine.report.traceability is None:
        rows.append(("Traceability", None))
    rows += origin(left.inputs if left else [case.given])
    rows += [("Machine", doc.given(machine.name)), ("Geometry", machine.geometry_words)]
    if model.accepted:
        rows.append(("Accepted", ", ".join(effect.cause.id for effect in model.remaining())))
    return doc.Section("Traceability", doc.Facts(rows))
