"""The verification report: predicted against measured, and how the machine responded.

The calibration report shows the same notice, advice and tables once the adjustment was measured.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command, file_words
from orthoglide_cal.inference.response import Behaviour
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import (
    INVALIDATING,
    common_unit,
    data_words,
    reserved,
    signed_page,
    sizes_words,
)
from orthoglide_cal.report.documents.pictures import differences_figure
from orthoglide_cal.report.sentences import RESPONSES, sentence
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results import Identity, Parameter
from orthoglide_cal.results.verification import Coefficient, ComparedInput, Outcome, Verification
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    MM_PER_INCH,
    chance,
    coverage_words,
    difference_decimals,
    entered_decimals,
    plain,
    signed,
    unit_words,
    with_uncertainty,
)


def verification_document(result: Verification, identity: Identity) -> doc.Document:
    """The document, for any of the renderers."""

    def data() -> dict[str, object]:
        issued = identity.issued.isoformat(timespec="seconds")
        values = result.model_dump(mode="json", context=_says(result))
        return {**values, "number": identity.number, "issued": issued}

    return doc.Document(data, partial(_page, result, identity), partial(_screen, result))


def _says(result: Verification) -> Callable[[Reason], str]:
    """Composes the sentence for a reason, in the words of the machine."""
    return partial(sentence, machine=result.inputs[1][1].machine)


def _screen(result: Verification) -> doc.Page:
    known = (parameter for parameter in result.second if parameter.found is not None)
    left = ((size.name, size.found or 0.0, size.expanded, size.unit) for size in known)
    parameters = f"Left: {sizes_words(left)}."
    before, after = (count for _, count in _measured(result))
    both = f"{before} before and after" if before == after else f"{before} and {after}"
    notice = replace(verification_notice(result), aside=f"{result.machine}, {both}")
    # Their title says what the notice above does.
    differences = left_figure(result).in_characters[1:] if result.differences else []
    steps = [*verification_steps(result, None, brief=True)]

    def page() -> doc.Page:
        last = doc.next_steps(steps, "More: the same with --details")
        sections = doc.Section(None, *differences), doc.Section(None, parameters), last
        kind, simulated = "Verification", result.simulated
        return doc.Page(kind, simulated=simulated, notice=notice, sections=sections)

    return fitting(page, differences)


def _page(result: Verification, identity: Identity) -> doc.Page:
    applied = [("Applied", f"{_triple(result.applied_mm, result)} mm (x, y, z)")]
    page = signed_page(
        "Verification report",
        result.inputs[1][1].machine,
        identity,
        [(side, side.validity) for side in (result.before, result.after)],
        *(applied if result.applied_mm else []),
    )
    compared = "independent changes" if result.differences else "touches afterwards"
    machine = ("Machine", doc.given(result.machine))
    origin = *compared_inputs(result), machine, ("Compared", f"{result.compared} {compared}")
    return replace(
        page,
        title=result.machine,
        notice=verification_notice(result),
        sheet=(parameters_left(result), _outcome(result), *page.sheet),
        sections=(
            *([_response(result, result.response)] if result.response else []),
            doc.Section("Traceability", doc.Facts(origin)),
        ),
        signatures=("Measured by", "Checked by"),
    )


def verification_notice(result: Verification) -> doc.Notice:
    """The answer in one box."""
    outcome = result.decision.outcome if result.decision else Outcome.PASS
    tone, title = doc.Tone.GOOD, "The correction worked as predicted"
    before, promised, after, _ = _sizes(result)
    size = f"Predicted {promised}, measured {after} (r.m.s.; before {before})."
    says = _says(result)
    remains = says(result.remains) if result.remains else ""
    lines = tuple(
        filter(None, (size, _corrected(result), _answer(result), _decision(result), remains))
    )
    if not result.differences:
        better = result.rms_after_mm < result.rms_before_mm
        came = "as predicted"
        if not result.kept:
            u = plain(1000.0 * (result.rms_expanded_mm or 0.0), 0)
            amount = f"{after[:-3]} instead of {promised[:-3]} ± {u} µm"
            came = f"{'but' if better else 'and'} not as predicted ({amount})"
        title = f"The touches agree {'better' if better else 'no better'} than before, {came}"
        if result.moved:
            title = "The machine has moved: nothing was entered, and the touches agree worse"
            advice = "Look for a part that was hit or came loose; then calibrate and probe again."
            lines = (*lines, advice)
        tone = doc.Tone.GOOD if result.kept else doc.Tone.BAD
    elif not result.kept:
        tone, title = doc.Tone.BAD, "The correction did not work as predicted"
        if result.answer is Behaviour.AS_MODELLED:
            title = "The offsets act as entered, but the machine is not as predicted"
    elif outcome is Outcome.FAIL:
        tone, title = doc.Tone.BAD, "The correction worked, but a deviation is beyond the limit"
    elif outcome is not Outcome.PASS or (result.other_change and result.other_change.found):
        tone, title = doc.Tone.WARN, "The correction worked, with a reservation"
    if result.reservations and tone is doc.Tone.GOOD:
        tone, title = doc.Tone.WARN, f"{title}, with a reservation"
    known = [*map(says, result.reservations)]
    for reservation, first in zip(result.reservations, known, strict=True):
        of = reservation.data.get("reason")
        if tone is not doc.Tone.BAD and isinstance(of, Reason) and of.code in INVALIDATING:
            title, lines = first.rstrip("."), (f"{title}.", *lines)
            known.remove(first)
            break
    return reserved(doc.Notice(tone, title, lines), known)


def _sizes(result: Verification) -> list[str]:
    """Before, predicted, after and reachable, with unit."""
    sizes = (
        result.rms_before_mm,
        result.rms_promised_mm,
        result.rms_after_mm,
        result.rms_reachable_mm,
    )
    if result.differences:
        digits = difference_decimals(result.kind == DataKind.READINGS)
        return ["" if size is None else f"{plain(size, digits)} mm" for size in sizes]
    return ["" if size is None else f"{plain(1000.0 * size, 0)} µm" for size in sizes]


def verification_steps(
    result: Verification, machine_file: Path | None, *, brief: bool = False
) -> Iterator[doc.Instruction]:
    """Next steps after the adjustment was measured.

    `brief` is for a screen, which says the answer above and is no report.
    """
    before, after = result.before.path, result.after.path
    if not result.kept:
        if any(reason.code == "order_as_given" for reason in result.reservations):
            typed = command("report", after, machine=machine_file, after=before)
            typed = command("verify", after, before) if brief else typed
            yield doc.Instruction(f"If {after} was measured first", typed)
        if remedy := _remedy(result):
            yield doc.Instruction(remedy)
        elif result.answer is Behaviour.AS_MODELLED:
            typed = command("diagnose", after, machine=machine_file)
            yield doc.Instruction("Find what else changed, or what was wrong before", typed)
        yield doc.Instruction("Measure again, and compare again")
    elif result.decision is not None and result.decision.outcome is Outcome.FAIL:
        yield doc.Instruction(
            "The offsets are right, but a deviation is beyond the limit: find its cause",
            command("diagnose", after, machine=machine_file),
        )
    else:
        undecided = result.decision is not None and result.decision.outcome is Outcome.UNDECIDED
        if undecided:
            again = command("measure", machine=machine_file, options="--cycles 10")
            yield doc.Instruction("To decide by the limit, lower U: measure more cycles", again)
        if brief and result.differences:
            limit = result.decision and result.decision.limit_mm
            write = command("report", before, machine=machine_file, after=after, limit=limit)
            yield doc.Instruction("Write the report, and keep it with the machine", write)
        elif not undecided:
            yield doc.Instruction("Nothing more: keep this report with the machine.")


def _corrected(result: Verification) -> str:
    """What is corrected since the first measurement, by a screw or the controller."""
    verbs = {True: "Adjusted:", False: "The controller now corrects"}
    causes = [
        f"{verbs[CAUSES[id].adjustable]} {id}"
        f" {', '.join(f'{name} {signed(by, 3)}' for name, by in values.items())}"
        f" {unit_words(CAUSES[id].unit)}."
        for id, values in result.corrected.items()
    ]
    return " ".join(causes)


def _answer(result: Verification) -> str:
    """How the machine responded, in one sentence; nothing where that was not looked at."""
    if result.response is None or result.answer is None:
        return ""
    apart, both = result.apart_mm or 0.0, result.apart_expanded_mm or 0.0
    differ = f", yet they differ by {plain(apart, 3)} mm, U of both {plain(both, 3)} mm"
    was = "entered" if any(result.entered) else "corrected"
    moves = [
        f"{axis.upper()} moved {signed(row.found_mm, 3)} of {signed(row.applied_mm, 3)} mm"
        for axis, row in result.axes.items()
        if row.otherwise
    ]
    return RESPONSES[result.answer]["answer"].format(
        size=f"moved by {_interval(result.response)} times what was {was}",
        differ="" if result.kept else differ,
        acted_as=_triple(result.acted_as_mm or {}, result),
        moves="; ".join(moves),
    )


def _remedy(result: Verification) -> str | None:
    """Remedy of a response that is wrong."""
    if result.answer is None:
        return None
    size, remedy = result.response.value if result.response else 1.0, "remedy"
    if any(abs(size / factor - 1.0) < 0.1 for factor in (MM_PER_INCH, 1.0 / MM_PER_INCH)):
        remedy = "in_inches"
    texts = RESPONSES[result.answer]
    wrong = ", ".join(axis.upper() for axis, row in result.axes.items() if row.otherwise)
    return texts.get(remedy, texts.get("remedy", "")).format(wrong=wrong)


def _interval(coefficient: Coefficient) -> str:
    """ "1.03 [0.91, 1.14]"."""
    sizes = coefficient.value, *coefficient.ci95
    value, low, high = (plain(size, 2).replace("-", "−") for size in sizes)
    return f"{value} [{low}, {high}]"


def _entered(result: Verification) -> int:
    """Decimals of joint offsets: those of what was applied, and of what is known of the rest."""
    return entered_decimals(result.remaining_expanded_mm.values(), result.applied_mm.values())


def _triple(values: Mapping[str, float], result: Verification) -> str:
    return " ".join(signed(value, _entered(result)) for value in values.values())


def _decision(result: Verification) -> str:
    """The decision about the limit in one sentence; none where no limit was given."""
    made = result.decision
    if made is None:
        return ""
    never = "" if made.passable else " Nothing can pass: U exceeds the limit. Take more cycles."
    return (
        f"{made.outcome.capitalize()}: limit {made.limit_mm:g} mm, largest deviation"
        f" {plain(made.largest_mm, 3)} ± {plain(made.expanded_mm, 3)} mm"
        f" ({made.largest_difference}; U with {coverage_words(made.coverage_factor)}, 95 %).{never}"
    )


def parameters_left(result: Verification) -> doc.Section:
    """Each parameter as found, as entered, and what remains of it."""
    decimals = _entered(result) if result.remaining_mm else 4
    found, entered = result.first, result.entered
    now = [None if by is None else p.active + by for p, by in zip(found, entered, strict=True)]
    unit = common_unit(result.inputs[1][1].machine)
    columns: dict[str, list[doc.Blank]] = {
        "": [doc.strong(p.name) for p in found],
        **({} if unit else {"unit": [p.unit for p in found]}),
        "found ± U": [_size(p) for p in found],
        "before": [plain(p.active, decimals) for p in found],
        "entered": ["unknown" if by is None else signed(by, decimals) for by in entered],
        "now": ["unknown" if new is None else doc.strong(plain(new, decimals)) for new in now],
        "left ± U": [_size(p) for p in result.second],
    }
    caption = "Before and now: active in the controller. Found: by the first measurement; left: by"
    caption += " the second."
    other = [name for name, row in result.parameters.items() if row["as_found"] is False]
    note = "What was found was entered."
    if now.count(None) == len(now):
        note = "The files do not record what was entered. A saved printer.cfg does."
    elif not any(entered):
        note = "Nothing was entered."
    elif other:
        note = f"What was entered differs from what was found here: {', '.join(other)}."
    return doc.Section(f"Parameters{unit}", doc.Grid.of(columns, caption=caption), note)


def _size(parameter: Parameter) -> str | None:
    known = parameter.found
    return None if known is None else with_uncertainty(known, parameter.expanded)


def _outcome(result: Verification) -> doc.Section:
    """Predicted and measured, difference by difference or in all."""
    if result.differences:
        return doc.Section("Predicted and measured", *rule_blocks(result), left_figure(result))
    grid = doc.Grid(
        ("r.m.s. of the heights", "as found", "predicted", "as left", "could be"),
        (("touches, without their mean", *_sizes(result)),),
        caption="Predicted: expected with the parameters found before. Could be: with those found"
        " afterwards.",
    )
    return doc.Section("Heights", grid)


def rule_blocks(result: Verification) -> tuple[doc.Block, ...]:
    """By which rule a limit is judged; nothing where none was given."""
    rule = result.decision
    return (doc.small(f"Decision rule: {_says(result)(rule.rule)}"),) if rule else ()


def left_figure(result: Verification) -> doc.Figure:
    """The differences as left."""
    every = result.differences
    rows = [(e.difference, e.before_mm, e.promised_mm, e.expanded_mm, e.after_mm) for e in every]
    sizes = (result.rms_before_mm, result.rms_promised_mm, result.rms_after_mm)
    limit = result.decision.limit_mm if result.decision else None
    outcomes = [row.outcome.capitalize() for row in every if row.outcome]
    return differences_figure(rows, sizes, result.kind == DataKind.SINGLE, limit, outcomes)


def _response(result: Verification, response: Coefficient) -> doc.Section:
    rows, decimals = result.axes.values(), _entered(result)
    intervals = [[signed(end, decimals) for end in row.ci95_mm] for row in rows]
    columns = {
        "axis": [*result.axes],
        "applied": [signed(row.applied_mm, decimals) for row in rows],
        "found": [signed(row.found_mm, decimals) for row in rows],
        "95 % interval": [" … ".join(ends) for ends in intervals],
        "coefficient": [_interval(row.coefficient) if row.coefficient else "" for row in rows],
    }
    grid = doc.Grid.of(columns, caption="Change of each joint, mm, fitted together.")
    lead = (
        "Response (measured change / entered change), all axes together: ",
        doc.strong(_interval(response)),
        f". Expected: 1. (95 % interval, {result.response_dof} degrees of freedom.)",
    )
    blocks: list[doc.Block] = [lead, *([grid] if rows else [])]
    if change := result.other_change:
        size = f"{1000 * change.rms_mm:.0f} µm per difference"
        noise = f"noise alone gives {1000 * change.noise_mm:.0f} µm ({chance(change.p_value)})."
        text = f"Nothing else changed: {size}; {noise}"
        if change.found:
            text = f"Something else changed that no offset explains: {size}; {noise}"
            text += " Was the stand moved, a leg or rail adjusted, or another gauge used?"
        blocks.append(text)
    return doc.Section("How the machine responded", *blocks)


def compared_inputs(result: Verification) -> Iterator[tuple[str, doc.Blank]]:
    """Where both sides come from: file and digest."""
    for name, (given, count) in zip(("Before", "After"), _measured(result), strict=True):
        yield name, doc.given(f"{file_words(given.path)} ({count})")
        yield "SHA-256", doc.code(given.sha256)


def _measured(result: Verification) -> Iterator[tuple[ComparedInput, str]]:
    """Both measurements, each with how much of what it holds."""
    for given, (source, _) in zip((result.before, result.after), result.inputs, strict=True):
        yield given, data_words(source, given.kind, given.readings)
