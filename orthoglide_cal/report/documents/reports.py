"""The numbered report of a calibration, with lines to sign on, and the answer of its verification.

The first sheet is what is pinned to the machine: may the parameters be entered, the parameters with
U, each difference as found and as left, what to do, under which conditions that holds. Of a result
that is refused it says what is wrong. Behind it stands what that rests on.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command, file_words
from orthoglide_cal.files.input import Input, InputFile
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.inference.result import Parameter, Verdict
from orthoglide_cal.inference.sessions import Behaviour
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import INVALIDATING, Case, input_words, position_words, sizes_words
from orthoglide_cal.report.documents.answer import (
    cause_sizes,
    decision_notice,
    evidence,
    parameters_section,
    promised_figure,
    steps_section,
    to_do,
)
from orthoglide_cal.report.sentences import RESPONSES, cause_title, cause_words, sentence
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results.answer import Answer, Identity, Validity
from orthoglide_cal.results.verification import Coefficient, Outcome, Verification
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    MM_PER_INCH,
    capitalized,
    difference_decimals,
    entered_decimals,
    listed,
    moment_words,
    plain,
    short,
    signed,
    two_figures,
    with_uncertainty,
)

# Fields of its reports that the owner of a machine fills in: who and which; how, with what.
_OWNER = ("organisation", "address", "place", "customer", "serial_number")
_MEANS = ("method", "traceability", "authorised_by", "gauge_due")
_MOST_NOTES = 40


def calibration_document(
    case: Case,
    identity: Identity,
    left: Verification | None = None,
    limit_mm: float | None = None,
    after: Case | None = None,
) -> doc.Document:
    """The calibration report; as data the answer, and what only a report says.

    `left` and `after`: comparison with the session measured after the adjustment, and its result;
    `limit_mm`: largest deviation allowed.
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
        judged, causes, rivals = left or answer, _causes(case), [*_rivals(case)]
        if len(causes) == 1 and len(rivals) > 1:  # two drawings have room on the first sheet
            causes.append(rivals.pop(0))
        parameters = parameters_section(case, promised_figure(case, limit_mm))
        pages, notice = [*map(_other, case.others)], _notice(case)
        sheet = [*[parameters] * released, *causes, steps_section(case, to_do(case))]
        if left is not None:
            notice = _verification_notice(left)
            # Beside each other: the sheet has no room for a section more.
            measured = _differences_left(left).blocks
            sheet = [_parameters_left(left), _after_verification(left, *measured)]
        elif not released:
            pages += [*rivals, parameters]
        sheet.append(doc.Section(None, _strip(machine, identity.software, judged)))
        both = [(after, ", as left"), (case, ", as found")] if after else [(case, "")]
        for one, when in both:
            sections = *evidence(one), _conditions(one)
            pages += [doc.Section(f"{part.title}{when}", *part.blocks) for part in sections]
        pages += [*_workspace(case, after, limit_mm), _origin(case, left)]
        for one, when in both:
            if one.answer.input.kind == DataKind.READINGS:  # differences stand among the residuals
                pages.append(doc.Section(f"Appendix: readings{when}", figures.readings_table(one)))
        if not answer.parameters:  # nothing to pin to the machine: one sheet of paper says it all
            sheet, pages = [*sheet, *pages], []
        roles = ["Measured by", *["Adjusted by"] * released]
        roles.append(f"Authorised by {machine.report.authorised_by or ''}".rstrip())
        number = ("Number", doc.code(identity.number))
        issued = ("Issued", moment_words(identity.issued))
        return doc.Page(
            kind="Practice report" if judged.simulated else "Calibration report",
            title=machine.name,
            number=identity.number,
            facts=doc.Facts((*_stated(machine, _OWNER), number, issued)),
            notice=notice,
            sheet=sheet,
            sections=pages,
            signatures=roles,
            scope="The results relate only to the machine and the instruments named here, as they"
            f" were when measured, and to the {machine.vocabulary.positions} and conditions stated."
            " The report is valid only with all its pages: reproduce it only in full.",
            simulated=judged.simulated,
        )

    return doc.Document(data, page)


# --- the first sheet --------------------------------------------------------------------------


def _notice(case: Case) -> doc.Notice:
    """The verdict, with doubts of the papers; of a refused result what is wrong."""
    release = case.answer.release
    notice = decision_notice(case, diagnosed=release.sound and not release.usable)
    known = [*release.reasons, *release.cautions]
    papers = (e for e in case.answer.validity.reservations if e.code not in INVALIDATING)
    doubts = (doc.doubtful(case.says(e)) for e in papers if e not in known)
    return replace(notice, lines=(*notice.lines, *doubts))


def _causes(case: Case) -> list[doc.Section]:
    """Each cause of the likeliest answer: where, how large with U, drawn, what to do about it."""
    sections = list[doc.Section]()
    answer, undecided = case.answer, case.answer.verdict is Verdict.AMBIGUOUS
    steps = () if answer.release.usable else answer.release.remedies  # else what to enter
    advised = " ".join(case.says(remedy.sentence) for remedy in steps)
    for cause in answer.causes if answer.verdict is Verdict.NAMED or undecided else ():
        title = f"{cause_title(case.machine, cause)} ({cause.id})"
        blocks: list[doc.Block] = [*cause_sizes(cause.id, cause.parameters, cause.where)]
        if moves := figures.shims(cause.id, cause.parameters):
            rows = [(rail, f"{plain(mm, 2)} mm", along) for rail, mm, along in moves]
            above = "U: 95 %. xy: how far rail x lies above rail y, along z; and so on."
            blocks += (doc.small(above), doc.Grid(("rail", "move by", "towards"), rows))
        if (remedy := case.says(cause.remedy)).rstrip(".") not in advised:
            blocks.append(f"{'If so: ' * undecided}{remedy}")
        title = f"Possible: {title}" if undecided else capitalized(title)
        drawn = figures.cause_figure(case, cause)
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
        if id in words and (sketch := figures.cause_sketch(case, id, sizes)):
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
    views.append(("expected", before.maps[1], before.after_mm, before.worst_after_mm))
    if after and after.maps:
        views[1] = "as left", after.maps[0], after.before_mm, after.worst_before_mm
    lead = [
        f"{when.capitalize()}: at most {two_figures(mm)} mm, at {position_words(worst, 0)}."
        for when, _, mm, worst in views
    ]
    causes = " and ".join(cause.id for cause in case.known)
    timed = " and ".join(cause.id for cause in case.known if cause.timed)
    if after:
        unsure = two_figures(after.after_mm - after.left_mm)
        lead.append(f"The uncertainty of the offsets left adds up to {unsure} mm.")
    elif causes:
        size = two_figures(before.left_mm)
        lead.append(f"{size} mm of that comes from {causes}, which offsets do not remove.")
    else:
        lead.append("All of that comes from uncertainty.")
    if timed and not after:
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
    # When it ended and the temperatures stand under the verdict.
    rows: list[tuple[str, doc.Blank]] = [
        ("Protocol", given.protocol and doc.given(given.protocol)),
        ("Started", _moment(given.started)),
    ]
    for name, text in given.environment.items():
        if "temperature" not in name:
            rows.append((name.replace("_", " "), doc.given(text)))
    if case.given.is_session:
        rows += [("Readings replaced", str(given.retaken)), ("Steps left out", str(given.skipped))]
    # Blanks are for those who write down how it was.
    rows = [row for row in rows if row[1] is not None or "date" in machine.noted]
    sizes = f"resolution {short(gauge.resolution_mm, 6)} mm, repeatability"
    sizes += f" {short(gauge.repeatability_mm, 6)} mm (one standard deviation), as stated"
    rows.append((noise.capitalize(), sizes))
    places = [f"{e.gauge_at:.3g}" for e in answer.residuals if e.gauge_at is not None]
    if places:
        stood = f"at {listed([*dict.fromkeys(places)])} of the leg (carriage joint 0, tool 1)"
        rows.append(("Gauges stood", stood))
    notes = given.notes[:_MOST_NOTES] if answer.parameters else ()
    rows_of_notes = [(str(line), doc.given(note)) for line, note in notes]
    grid = doc.Grid(("line", "note"), rows_of_notes, (0, 1), "Notes at readings.")
    return doc.Section(f"Conditions and {noise}s", doc.Facts(rows), grid)


def _origin(case: Case, left: Verification | None) -> doc.Section:
    model, machine = case.given.model, case.machine
    rows: list[tuple[str, doc.Blank]] = [*_stated(machine, _MEANS)]
    if machine.report.traceability is None:
        rows.append(("Traceability", None))
    rows += _inputs(left.inputs if left else [case.given])
    rows += [("Machine", doc.given(machine.name)), ("Geometry", machine.geometry_words)]
    if model.accepted:
        rows.append(("Accepted", ", ".join(effect.cause.id for effect in model.remaining())))
    return doc.Section("Traceability", doc.Facts(rows))


# --- verification -------------------------------------------------------------------------------


def verification_document(result: Verification) -> doc.Document:
    """The answer, all of it as a page."""

    notice = _verification_notice(result)
    begun = doc.Page("Verification", simulated=result.simulated, notice=notice)

    def screen() -> doc.Page:
        parameters = f"Left: {sizes_words(result.after.parameters)}."
        before, after = map(input_words, result.inputs)
        both = f"{before} before and after" if before == after else f"{before} and {after}"
        short_notice = replace(notice, aside=f"{result.machine}, {both}")
        # Their title says what the notice above does.
        figure = _left_figure(result)
        differences = [*figure.plain[1:]] if figure else []
        last = _after_verification(result, "More: the same with --details", brief=True)

        def made() -> doc.Page:
            sections = doc.Section(None, *differences), doc.Section(None, parameters), last
            return replace(begun, notice=short_notice, sections=sections)

        return fitting(made, differences)

    def page() -> doc.Page:
        responded = doc.Section("How the machine responded", *_response(result))
        origin = doc.Section("Traceability", doc.Facts([*_inputs(result.inputs)]))
        sections = _parameters_left(result), _differences_left(result), responded, origin
        last = _after_verification(result, brief=True)
        return replace(begun, title=result.machine, sections=(*sections, last))

    data = partial(result.model_dump, mode="json", context=_says(result))
    return doc.Document(data, page, screen)


def _says(result: Verification) -> Callable[[Reason], str]:
    return partial(sentence, machine=result.inputs[1].model.machine)


def _verification_notice(result: Verification) -> doc.Notice:
    says, outcome = _says(result), result.decision and result.decision.outcome
    sizes = result.rms_before_mm, result.rms_promised_mm, result.rms_after_mm
    before, promised, after = (_size(result, size) for size in sizes)
    if result.rms_expanded_mm is not None:
        promised = plain(1000.0 * result.rms_promised_mm, 0)
        promised += f" ± {_size(result, result.rms_expanded_mm)}"
    lines, done = [f"Predicted {promised}, measured {after} (r.m.s.; before {before})."], []
    for id, by in result.corrected.items():
        code = "cause_adjusted" if CAUSES[id].adjustable else "cause_corrected"
        moves = [(name, size, CAUSES[id].unit) for name, size in by.items()]
        done.append(says(Reason.of(code, id=id, by=moves)))
    lines += [" ".join(done)] * bool(done)
    if result.response and result.answer:
        lines.append(_answer(result, result.response, result.answer))
    if result.decision:
        largest = max(result.differences, key=lambda row: abs(row.after_mm))
        data = {"made": result.decision, "largest": largest, "after_mm": abs(largest.after_mm)}
        lines.append(says(Reason.of("limit_judged", **data)))
        if any(row.after_expanded_mm > result.decision.limit_mm for row in result.differences):
            lines[-1] += " " + says(Reason.of("limit_below_u"))
    lines += map(says, filter(None, [result.remains]))
    tone = doc.Tone.GOOD if result.kept else doc.Tone.BAD
    known = [*result.reservations]
    if result.other_change and result.other_change.found:
        known.insert(0, Reason.of("other_change", change=result.other_change))
    unsure = bool(known)
    if result.moved:
        title = "The machine has moved: nothing was entered, and the touches agree worse"
        lines.append("Look for a part that was hit or came loose; then calibrate and probe again.")
    elif not result.differences:
        better = result.rms_after_mm < result.rms_before_mm
        title = "The touches agree as predicted; no improvement beyond noise was predicted"
        if not result.kept:
            degree = "better than before, but" if better else "no better than before, and"
            title = f"The touches agree {degree} not as predicted ({after} instead of {promised})"
        elif result.improves:
            title = "The touches agree better than before, as predicted"
    elif not result.kept:
        title = "The correction did not work as predicted"
        if result.answer is Behaviour.AS_MODELLED:
            title = "The offsets act as entered, but the machine is not as predicted"
    elif outcome is Outcome.FAIL:
        tone, title = doc.Tone.BAD, "The correction worked, but a deviation is beyond the limit"
    else:
        title = "The correction worked as predicted"
        unsure = unsure or outcome is Outcome.UNDECIDED
    if unsure and tone is doc.Tone.GOOD:
        tone, title = doc.Tone.WARN, f"{title}, with a reservation"
    worthless = [e for e in known if getattr(e.data.get("reason"), "code", "") in INVALIDATING]
    if worthless and tone is not doc.Tone.BAD:
        title, lines = says(worthless[0]).rstrip("."), [f"{title}.", *lines]
        known.remove(worthless[0])
    return doc.Notice(tone, title, (*lines, *(doc.doubtful(says(doubt)) for doubt in known)))


def _size(result: Verification, size_mm: float) -> str:
    if result.differences:
        raw = result.before.kind == result.after.kind == DataKind.READINGS
        return f"{plain(size_mm, difference_decimals(raw))} mm"
    return f"{plain(1000.0 * size_mm, 0)} µm"


def _after_verification(result: Verification, *more: doc.Block, brief: bool = False) -> doc.Section:
    """Next steps after the adjustment was measured, or that there are none; `brief`: no report."""
    before, after, steps = result.before.path, result.after.path, list[doc.Line]()
    machine_file = result.inputs[0].machine_file
    outcome = result.decision and result.decision.outcome
    diagnosed = command("diagnose", after, machine=machine_file)
    if not result.kept:
        if result.answer is Behaviour.AS_MODELLED:
            steps.append(doc.step("Find what else changed, or what was wrong before", diagnosed))
        elif remedy := _remedy(result):
            steps.append(remedy)
        steps.append("Measure again, and compare again")
    elif outcome is Outcome.FAIL:
        text = "The offsets are right, but a deviation is beyond the limit: find its cause"
        steps.append(doc.step(text, diagnosed))
    else:
        if outcome is Outcome.UNDECIDED:
            again = command("measure", machine=machine_file, options="--cycles 10")
            text = "To decide by the limit, lower U: measure more cycles"
            steps.append(doc.step(text, again))
        if brief and result.differences:
            limit = result.decision and result.decision.limit_mm
            write = command("report", before, machine=machine_file, after=after, limit=limit)
            steps.append(doc.step("Write the report, and keep it with the machine", write))
    done = f"Nothing more to do{': keep this report with the machine' * (not brief)}."
    return doc.next_steps(steps, None if steps else done, *more)


def _answer(result: Verification, response: Coefficient, answer: Behaviour) -> str:
    apart, both = result.apart_mm or 0.0, result.apart_expanded_mm or 0.0
    differ = f", yet they differ by {plain(apart, 3)} mm, U of both {plain(both, 3)} mm"
    known = any(result.entered.values())
    acted_as = [signed(by, _decimals(result)) for by in (result.acted_as_mm or {}).values()]
    moves = [
        f"{axis.upper()} moved {signed(row.found_mm, 3)} of {signed(row.applied_mm, 3)} mm"
        for axis, row in result.axes.items()
        if row.otherwise
    ]
    return RESPONSES[answer]["answer"].format(
        size=f"moved by {_interval(response)} times what was {'entered' if known else 'corrected'}",
        differ="" if result.kept else differ,
        acted_as=" ".join(acted_as),
        moves="; ".join(moves),
    )


def _remedy(result: Verification) -> str:
    """Remedy of a response that is wrong; "" for none."""
    if result.response is None or result.answer is None:
        return ""
    texts, gain = RESPONSES[result.answer], result.response.value
    inches = any(abs(gain / factor - 1.0) < 0.1 for factor in (MM_PER_INCH, 1.0 / MM_PER_INCH))
    remedy = texts.get("in_inches" if inches else "remedy", texts.get("remedy", ""))
    wrong = ", ".join(axis.upper() for axis, row in result.axes.items() if row.otherwise)
    return remedy.format(wrong=wrong)


def _interval(coefficient: Coefficient) -> str:
    """ "1.03 [0.91, 1.14]"."""
    sizes = coefficient.value, *coefficient.ci95
    value, low, high = (signed(size, 2).removeprefix("+") for size in sizes)
    return f"{value} [{low}, {high}]"


def _decimals(result: Verification) -> int:
    """Decimals of joint offsets: those of what was applied, and of what is known of the rest."""
    left = (row.expanded for row in result.after.parameters)
    return entered_decimals(left, result.applied_mm.values())


def _parameters_left(result: Verification) -> doc.Section:
    """Each parameter as found, as entered, and what remains of it."""
    rows, entered = result.before.parameters, result.entered.values()
    unit, decimals = result.inputs[1].model.machine.common_unit, 4
    if result.differences:
        decimals = _decimals(result)
    active = signed if unit else plain  # lengths and angles of a printer have no sign
    now = [None if by is None else row.active + by for row, by in zip(rows, entered, strict=True)]
    columns: dict[str, list[doc.Blank]] = {
        "": [doc.strong(row.name) for row in rows],
        **({} if unit else {"unit": [row.unit for row in rows]}),
        "found ± U": [*map(_known, rows)],
        "before": [active(row.active, decimals) for row in rows],
        "entered": ["unknown" if by is None else signed(by, decimals) for by in entered],
        "now": ["unknown" if new is None else doc.strong(active(new, decimals)) for new in now],
        "left ± U": [*map(_known, result.after.parameters)],
    }
    caption = "Before, now: in the controller. Found, left: by the first and second measurement."
    note = "The files do not record what was entered. A saved printer.cfg does."
    unknown = now.count(None) == len(now)
    grid = doc.Grid.of(columns, caption=caption)
    return doc.Section(f"Parameters{unit}", grid, note if unknown else None)


def _known(row: Parameter) -> str | None:
    return None if row.found is None else with_uncertainty(row.found, row.expanded)


def _differences_left(result: Verification) -> doc.Section:
    """The rule by which a limit is judged, and the differences as left; nothing of heights."""
    made = result.decision
    rule = doc.small(f"Decision rule: {_says(result)(made.rule)}") if made else None
    return doc.Section("Predicted and measured", rule, _left_figure(result))


def _left_figure(result: Verification) -> doc.Figure | None:
    rows = [
        (row.name, row.measured_mm, row.expected_mm, row.after_expanded_mm, row.after_mm)
        for row in result.differences
    ]
    if not rows:
        return None
    sizes = (result.rms_before_mm, result.rms_promised_mm, result.rms_after_mm)
    limit = result.decision.limit_mm if result.decision else None
    outcomes = [row.outcome.capitalize() for row in result.differences if row.outcome]
    return figures.differences_figure(rows, sizes, result.kind == DataKind.SINGLE, limit, outcomes)


def _response(result: Verification) -> Iterator[doc.Block]:
    rows, decimals = result.axes.values(), _decimals(result)
    if result.response:
        yield (
            "Response (measured change / entered change), all axes together: ",
            doc.strong(_interval(result.response)),
            f". Expected: 1. (95 % interval, {result.response_dof} degrees of freedom.)",
        )
    columns = {
        "axis": [*result.axes],
        "applied": [signed(row.applied_mm, decimals) for row in rows],
        "found": [signed(row.found_mm, decimals) for row in rows],
        "95 % interval": [" … ".join(signed(end, decimals) for end in row.ci95_mm) for row in rows],
    }
    yield doc.Grid.of(columns, caption="Change of each joint, mm, fitted together.")
    if result.other_change and not result.other_change.found:
        yield _says(result)(Reason.of("no_other_change", change=result.other_change))


# --- what both have -------------------------------------------------------------------------------


def _strip(machine: Machine, software: str, of: Answer | Verification) -> doc.Block:
    """The conditions under which a result holds; of a verification before and after."""
    if isinstance(of, Verification):
        sides = (_circumstances(side, side.validity, machine) for side in (of.before, of.after))
        return doc.Grid(
            ("conditions", "before", "after"),
            [(name, value, later) for (name, value), (_, later) in zip(*sides, strict=True)],
            words=(0, 1, 2),
            caption=f"{software}; data with the first digits of SHA-256.",
        )
    rows = _circumstances(of.input, of.validity, machine)
    named = ((name.capitalize(), value) for name, value in rows)
    return doc.Facts((*named, ("Software", software)))


def _stated(machine: Machine, names: Sequence[str]) -> tuple[tuple[str, doc.Marked], ...]:
    """Facts that the owner wrote under these names into the machine's file."""
    texts = {name.replace("_", " ").capitalize(): getattr(machine.report, name) for name in names}
    return tuple((name, doc.given(text)) for name, text in texts.items() if text is not None)


def _circumstances(
    of: InputFile, validity: Validity, machine: Machine
) -> list[tuple[str, doc.Blank]]:
    """Rows for when a measurement was, what is noted at such a machine, and the data."""
    gauges: list[doc.Inline] = []
    for gauge in validity.gauges:
        gauges += ["; " if gauges else "", doc.given(gauge.id)]
        if gauge.certificate:
            gauges += [", certificate ", doc.given(gauge.certificate)]
        if gauge.expanded_mm is not None:
            gauges.append(f", U {short(gauge.expanded_mm, 6)} mm")
        due = f"due {gauge.due}" if gauge.due else "due date not given"
        gauges += [", ", doc.doubtful(f"overdue: {due}") if gauge.overdue else due]
    known = {"start": validity.temperature_start_c, "end": validity.temperature_end_c}
    temperatures = [f"{plain(c, 1)} °C at the {when}" for when, c in known.items() if c is not None]
    noun = "readings" if of.kind == DataKind.READINGS else "differences"
    rows: dict[str, doc.Blank] = {
        "measured": _moment(validity.measured),
        "gauges": tuple(gauges) or None,
        "temperature": ", ".join(temperatures) or None,
        "operator": validity.operator and doc.given(validity.operator),
        "data": (f"{of.readings} {noun}, ", doc.code(str(of.sha256)[:12])),
    }
    return [(name, rows[name]) for name in rows if name in ("measured", "data", *machine.noted)]


def _moment(written: str | None) -> doc.Marked | None:
    return None if written is None else doc.given(moment_words(datetime.fromisoformat(written)))


def _inputs(inputs: Sequence[Input]) -> Iterator[tuple[str, doc.Blank]]:
    """Origin of one measurement, or of before and after: file, number and kind, digest."""
    names = ("Before", "After") if len(inputs) > 1 else ("Input",)
    for name, given in zip(names, inputs, strict=True):
        source = given.measured.source
        yield name, doc.given(f"{file_words(source.path)} ({input_words(given)})")
        yield "SHA-256", doc.code(source.sha256)
