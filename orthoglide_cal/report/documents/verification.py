"""The verification report: predicted against measured, and how the machine responded.

The calibration report shows the same notice, advice and tables once the adjustment was measured.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from orthoglide_cal.errors import command, file_words
from orthoglide_cal.inference.response import Behaviour
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import data_words, reserved, signed_page
from orthoglide_cal.report.documents.pictures import differences_figure
from orthoglide_cal.report.documents.solution import common_unit, deviations_grid, sizes, sizes_grid
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.results import Identity
from orthoglide_cal.results.verification import (
    Coefficient,
    ComparedInput,
    Outcome,
    Verification,
)
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    MM_PER_INCH,
    chance,
    coverage_words,
    difference_decimals,
    entered_decimals,
    plain,
    signed,
    with_uncertainty,
)

_MOST_DIFFERENCES = 6  # that a screen has room for


def verification_document(found: Verification, identity: Identity) -> doc.Document:
    """The document, for any of the renderers."""

    def data() -> dict[str, object]:
        issued = identity.issued.isoformat(timespec="seconds")
        values = found.model_dump(mode="json", context=_says(found))
        return {**values, "number": identity.number, "issued": issued}

    return doc.Document(data, partial(_page, found, identity), partial(_screen, found))


def _says(found: Verification) -> Callable[[Reason], str]:
    """Composes the sentence for a reason, in the words of the machine."""
    return partial(sentence, machine=found.inputs[1][1].machine)


def _screen(found: Verification) -> doc.Page:
    parameters = found.parameters.items()
    left = [(name, each.left, each.left_expanded, each.unit) for name, each in parameters]
    unit = common_unit(found.inputs[1][1].machine)
    grid = sizes_grid([(f"left{unit}", sizes(left, not unit))], 3 if unit else 2)
    before, after = (count for _, count in _measured(found))
    both = f"{before} before and after" if before == after else f"{before} and {after}"
    return doc.Page(
        kind="Verification",
        notice=replace(verification_notice(found), aside=f"{found.machine}, {both}"),
        sections=(
            doc.Section(None, *([_differences(found)] if found.differences else [])),
            doc.Section(None, grid),
            doc.next_steps(
                verification_steps(found, None, brief=True), "More: the same with --details"
            ),
        ),
    )


def _page(found: Verification, identity: Identity) -> doc.Page:
    applied = [("Applied", f"{_triple(found.applied_mm, found)} mm (x, y, z)")]
    page = signed_page(
        "Verification report",
        found.inputs[1][1].machine,
        identity,
        [(each, each.validity) for each in (found.before, found.after)],
        *(applied if found.applied_mm else []),
    )
    compared = "independent changes" if found.differences else "touches afterwards"
    machine = ("Machine", doc.given(found.machine))
    origin = *compared_inputs(found), machine, ("Compared", f"{found.compared} {compared}")
    return replace(
        page,
        title=found.machine,
        notice=verification_notice(found),
        sheet=(*page.sheet, _outcome(found), parameters_left(found)),
        sections=(
            *([_response(found, found.response)] if found.response else []),
            doc.Section("Traceability", doc.Facts(origin)),
        ),
        signatures=("Measured by", "Checked by"),
    )


def verification_notice(found: Verification) -> doc.Notice:
    """The answer in one box."""
    outcome = found.decision.outcome if found.decision else Outcome.PASS
    tone, title = doc.Tone.GOOD, "The correction worked as predicted"
    before, promised, after, _ = _sizes(found)
    size = f"Predicted {promised}, measured {after} (r.m.s.; before {before})."
    says = _says(found)
    remains = says(found.remains) if found.remains else ""
    lines = tuple(filter(None, (size, _answer(found), _decision(found), remains)))
    if not found.differences:
        better = found.rms_after_mm < found.rms_before_mm
        came = "as predicted" if found.kept else f"{'but' if better else 'and'} not as predicted"
        title = f"The touches agree {'better' if better else 'no better'} than before, {came}"
        if found.moved:
            title = "The machine has moved: nothing was entered, and the touches agree worse"
            told = "Look for what was changed, hit or came loose; then calibrate and probe again."
            lines = (*lines, told)
        tone = doc.Tone.GOOD if found.kept else doc.Tone.WARN
    elif not found.kept:
        tone, title = doc.Tone.BAD, "The correction did not work as predicted"
    elif outcome is Outcome.FAIL:
        tone, title = doc.Tone.BAD, "The correction worked, but a deviation is beyond the limit"
    elif outcome is not Outcome.PASS or (found.other_change and found.other_change.found):
        tone, title = doc.Tone.WARN, "The correction worked, with a reservation"
    if found.reservations and tone is doc.Tone.GOOD:
        tone, title = doc.Tone.WARN, f"{title}, with a reservation"
    return reserved(doc.Notice(tone, title, lines), [*map(says, found.reservations)])


def _digits(found: Verification) -> int:
    return difference_decimals(found.kind == DataKind.READINGS)


def _sizes(found: Verification) -> list[str]:
    """Before, predicted, after and reachable, with unit."""
    sizes = (found.rms_before_mm, found.rms_promised_mm, found.rms_after_mm, found.rms_reachable_mm)
    if found.differences:
        return ["" if size is None else f"{plain(size, _digits(found))} mm" for size in sizes]
    return ["" if size is None else f"{plain(1000.0 * size, 0)} µm" for size in sizes]


def verification_steps(
    found: Verification, machine_file: Path | None, *, brief: bool = False
) -> Iterator[doc.Instruction]:
    """What to do after the adjustment was measured.

    `brief` is for a screen, which says the answer above and is no report.
    """
    if not found.kept:
        if remedy := _remedy(found):
            yield doc.Instruction(remedy)
        yield doc.Instruction("Measure again, and compare again")
    elif found.decision is not None and found.decision.outcome is Outcome.FAIL:
        yield doc.Instruction(
            "The offsets are right, but a deviation is beyond the limit: find its cause",
            command("diagnose", found.after.path, machine=machine_file),
        )
    elif brief and found.differences:
        options = f"--after {command('', found.after.path).split(maxsplit=1)[1]}"
        write = command("report", found.before.path, machine=machine_file, options=options)
        yield doc.Instruction("Write the report, and keep it with the machine", write)
    else:
        yield doc.Instruction("Nothing more: keep this report with the machine.")


def _answer(found: Verification) -> str:
    """How the machine responded, in one sentence; nothing where that was not looked at."""
    if found.response is None or found.answer is None:
        return ""
    size = f"response {_interval(found.response)}"
    acted_as = _triple(found.acted_as_mm or {}, found)
    moves = [
        f"{axis.upper()} moved {signed(row.found_mm, 3)} of {signed(row.applied_mm, 3)} mm"
        for axis, row in found.axes.items()
        if row.otherwise
    ]
    return {
        Behaviour.AS_MODELLED: f"The machine responded as the model says: {size}, expected 1.",
        Behaviour.OPPOSITE: f"The correction acted with the opposite sign ({size}).",
        Behaviour.EXCHANGED: f"The correction acted as if {acted_as} had been entered (x, y, z).",
        Behaviour.NO_RESPONSE: f"The machine did not respond ({size}).",
        Behaviour.OTHER_GAIN: f"The size of the response is wrong ({size}, expected 1).",
        Behaviour.PARTLY: f"{'; '.join(moves)}.",
        Behaviour.UNDETERMINED: "The correction is too small for these readings to show a response"
        f" ({size}).",
    }[found.answer]


def _remedy(found: Verification) -> str | None:
    """What to do about a response that is wrong."""
    gain = "Check the gauge against a gauge block, its plunger for tilt, and the axis scale"
    inches, size = (MM_PER_INCH, 1.0 / MM_PER_INCH), found.response.value if found.response else 1.0
    if any(abs(size / factor - 1.0) < 0.1 for factor in inches):
        gain = "Enter the offsets in the controller's unit: inches and millimetres were mixed up"
    wrong = ", ".join(axis.upper() for axis, row in found.axes.items() if row.otherwise)
    remedies = {
        Behaviour.OPPOSITE: "Enter the negative values",
        Behaviour.EXCHANGED: "Check the joints",
        Behaviour.NO_RESPONSE: "Re-home, and check that the values are active",
        Behaviour.OTHER_GAIN: gain,
        Behaviour.PARTLY: f"Check {wrong} in the controller, and re-home",
    }
    return remedies.get(found.answer) if found.answer else None


def _interval(coefficient: Coefficient) -> str:
    """ "1.03 [0.91, 1.14]"."""
    sizes = coefficient.value, *coefficient.ci95
    value, low, high = (plain(size, 2).replace("-", "−") for size in sizes)
    return f"{value} [{low}, {high}]"


def _entered(found: Verification) -> int:
    """Decimals of joint offsets: those of what was applied, and of what is known of the rest."""
    return entered_decimals(found.remaining_expanded_mm.values(), found.applied_mm.values())


def _triple(values: Mapping[str, float], found: Verification) -> str:
    return " ".join(signed(value, _entered(found)) for value in values.values())


def _decision(found: Verification) -> str:
    """The decision about the limit in one sentence; none where no limit was given."""
    made = found.decision
    if made is None:
        return ""
    return (
        f"{made.outcome.capitalize()}: limit {made.limit_mm:g} mm, largest deviation"
        f" {plain(made.largest_mm, 3)} ± {plain(made.expanded_mm, 3)} mm"
        f" ({made.largest_difference}; U with {coverage_words(made.coverage_factor)}, 95 %)."
    )


def parameters_left(found: Verification) -> doc.Section:
    """What was found, what was entered, and what remains of each parameter."""
    decimals = _entered(found) if found.remaining_mm else 4
    every = found.parameters.values()
    now = [None if e.entered is None else e.before + e.entered for e in every]
    columns: dict[str, list[doc.Blank]] = {
        "": [doc.strong(name) for name in found.parameters],
        "unit": [e.unit for e in every],
        "found ± U": [with_uncertainty(e.found, e.expanded) for e in every],
        "before": [plain(e.before, decimals) for e in every],
        "entered": ["unknown" if e.entered is None else signed(e.entered, decimals) for e in every],
        "now": ["unknown" if new is None else doc.strong(plain(new, decimals)) for new in now],
        "left ± U": [with_uncertainty(e.left, e.left_expanded) for e in every],
    }
    caption = "Before, now: active in the controller. Found by the first measurement, left by the"
    caption += " second."
    other = [name for name, each in found.parameters.items() if each.as_found is False]
    note = "What was found was entered."
    if now.count(None) == len(now):
        note = "The files do not say what was entered: a printer.cfg of each time would."
    elif other:
        note = f"What was entered differs from what was found here: {', '.join(other)}."
    return doc.Section("Parameters", doc.Grid.of(columns, caption=caption), note)


def _outcome(found: Verification) -> doc.Section:
    """Predicted and measured, difference by difference or in all."""
    if found.differences:
        figure = replace(left_figure(found), columns=1, sketch=())
        blocks = _differences(found, full=True), figure, *rule_blocks(found)
        return doc.Section("Predicted and measured", *blocks)
    grid = doc.Grid(
        ("r.m.s. of the heights", "as found", "predicted", "as left", "could be"),
        (("touches, without their mean", *_sizes(found)),),
        caption="Predicted: what the parameters found before would leave. Could be: what those"
        " found afterwards would.",
    )
    return doc.Section("Heights", grid)


def rule_blocks(found: Verification) -> tuple[doc.Block, ...]:
    """By which rule a limit is judged; nothing where none was given."""
    rule = found.decision
    return (doc.small(f"Decision rule: {rule.rule}"),) if rule else ()


def _differences(found: Verification, *, full: bool = False) -> doc.Grid:
    """Deviations as measured and as predicted; on a screen only r.m.s. where they are many."""
    every = found.differences
    rows = every if full or len(every) <= _MOST_DIFFERENCES else ()
    sizes = {
        "before": [*(each.before_mm for each in rows), found.rms_before_mm],
        "predicted": [*(each.promised_mm for each in rows), found.rms_promised_mm],
        "± U": [each.promised_expanded_mm for each in rows],
        "measured": [*(each.after_mm for each in rows), found.rms_after_mm],
    }
    return deviations_grid([each.difference for each in rows], _digits(found), sizes)


def left_figure(found: Verification) -> doc.Figure:
    """What is left of each difference."""
    every = found.differences
    rows = [(e.difference, e.before_mm, e.promised_mm, e.expanded_mm, e.after_mm) for e in every]
    sizes = (found.rms_before_mm, found.rms_promised_mm, found.rms_after_mm)
    limit = found.decision.limit_mm if found.decision else None
    return differences_figure(rows, sizes, found.kind == DataKind.SINGLE, limit)


def _response(found: Verification, response: Coefficient) -> doc.Section:
    rows, decimals = found.axes.values(), _entered(found)
    intervals = [[signed(end, decimals) for end in row.ci95_mm] for row in rows]
    columns = {
        "axis": [*found.axes],
        "applied": [signed(row.applied_mm, decimals) for row in rows],
        "found": [signed(row.found_mm, decimals) for row in rows],
        "95 % interval": [" … ".join(ends) for ends in intervals],
        "coefficient": [_interval(row.coefficient) if row.coefficient else "" for row in rows],
    }
    grid = doc.Grid.of(columns, caption="Change of each joint, mm, fitted together.")
    lead = (
        "Response coefficient, all axes together: ",
        doc.strong(_interval(response)),
        f". Expected: 1. (95 % interval, {found.response_dof} degrees of freedom.)",
    )
    blocks: list[doc.Block] = [lead, grid]
    if change := found.other_change:
        noise = f"where noise gives {1000 * change.noise_mm:.0f} µm ({chance(change.p_value)})."
        size = f"else changed: {1000 * change.rms_mm:.0f} µm per difference"
        text = f"Nothing {size}, {noise}"
        if change.found:
            text = f"Something {size} that no offset explains, {noise}"
            text += " Was the stand moved, a leg or rail adjusted, or another gauge used?"
        blocks.append(text)
    return doc.Section("How the machine responded", *blocks)


def compared_inputs(found: Verification) -> Iterator[tuple[str, doc.Blank]]:
    """Where both sides come from: file and digest."""
    for name, (given, count) in zip(("Before", "After"), _measured(found), strict=True):
        yield name, doc.given(f"{file_words(given.path)} ({count})")
        yield "SHA-256", doc.code(given.sha256)


def _measured(found: Verification) -> Iterator[tuple[ComparedInput, str]]:
    """Both measurements, each with how much of what it holds."""
    for given, (source, _) in zip((found.before, found.after), found.inputs, strict=True):
        yield given, data_words(source, given.kind, given.readings)
