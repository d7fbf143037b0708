"""The verification report: predicted against measured, and how the machine responded.

The calibration report shows the same notice, advice and tables once the adjustment was measured.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command
from orthoglide_cal.inference import Parameter
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import (
    INVALIDATING,
    input_words,
    origin,
    reserved,
    signed_page,
    sizes_words,
)
from orthoglide_cal.report.documents.pictures import differences_figure
from orthoglide_cal.report.sentences import RESPONSES, sentence
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results.answer import Identity
from orthoglide_cal.results.verification import Behaviour, Coefficient, Outcome, Verification
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    MM_PER_INCH,
    difference_decimals,
    entered_decimals,
    plain,
    signed,
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
    return partial(sentence, machine=result.inputs[1].model.machine)


def _screen(result: Verification) -> doc.Page:
    left = (
        (row.name, row.found, row.expanded, row.unit)
        for row in result.after.parameters
        if row.found is not None
    )
    parameters = f"Left: {sizes_words(left)}."
    before, after = map(input_words, result.inputs)
    both = f"{before} before and after" if before == after else f"{before} and {after}"
    notice = replace(verification_notice(result), aside=f"{result.machine}, {both}")
    # Their title says what the notice above does.
    figure = _left_figure(result)
    differences = [*figure.plain[1:]] if figure else []
    steps = verification_steps(result, brief=True)
    last = doc.next_steps(steps, "More: the same with --details")

    def page() -> doc.Page:
        sections = doc.Section(None, *differences), doc.Section(None, parameters), last
        simulated = result.simulated
        return doc.Page("Verification", simulated=simulated, notice=notice, sections=sections)

    return fitting(page, differences)


def _page(result: Verification, identity: Identity) -> doc.Page:
    recorded = [(side, side.validity) for side in (result.before, result.after)]
    machine = result.inputs[1].model.machine
    page = signed_page("Verification report", machine, identity, recorded, result.simulated)
    return replace(
        page,
        title=result.machine,
        notice=verification_notice(result),
        sheet=(parameters_left(result), differences_left(result), *page.sheet),
        sections=(
            doc.Section("How the machine responded", *_response(result)),
            doc.Section("Traceability", doc.Facts([*origin(result.inputs)])),
        ),
        signatures=("Measured by", "Checked by"),
    )


def verification_notice(result: Verification) -> doc.Notice:
    """The answer in one box."""
    says, outcome = _says(result), result.decision and result.decision.outcome
    sizes = result.rms_before_mm, result.rms_promised_mm, result.rms_after_mm
    before, promised, after = (_size(result, size) for size in sizes)
    lines = [f"Predicted {promised}, measured {after} (r.m.s.; before {before})."]
    if result.rms_reachable_mm is not None:
        size = _size(result, result.rms_reachable_mm)
        lines.append(f"With the parameters found afterwards it would be {size}.")
    done = []
    for id, by in result.corrected.items():
        code = "cause_adjusted" if CAUSES[id].adjustable else "cause_corrected"
        done.append(says(Reason.of(code, id=id, by=by, unit=CAUSES[id].unit)))
    if done:
        lines.append(" ".join(done))
    if result.response and result.answer:
        lines.append(_answer(result, result.response, result.answer))
    if result.decision:
        rows, limit_mm = result.differences, result.decision.limit_mm
        largest = max(rows, key=lambda row: abs(row.after_mm))
        data = {"made": result.decision, "largest": largest, "after_mm": abs(largest.after_mm)}
        lines.append(says(Reason.of("limit_judged", **data)))
        if any(row.after_expanded_mm > limit_mm for row in rows):
            lines[-1] = " ".join((lines[-1], says(Reason.of("limit_below_u"))))
    if result.remains:
        lines.append(says(result.remains))
    tone = doc.Tone.GOOD if result.kept else doc.Tone.BAD
    unsure = bool(result.reservations)
    if result.moved:
        title = "The machine has moved: nothing was entered, and the touches agree worse"
        lines.append("Look for a part that was hit or came loose; then calibrate and probe again.")
    elif not result.differences:
        better, came = result.rms_after_mm < result.rms_before_mm, "as predicted"
        if not result.kept:
            u = plain(1000.0 * (result.rms_expanded_mm or 0.0), 0)
            came = f"{'but' if better else 'and'} not as predicted"
            came += f" ({after} instead of {promised.removesuffix(' µm')} ± {u} µm)"
        title = f"The touches agree {'better' if better else 'no better'} than before, {came}"
    elif not result.kept:
        title = "The correction did not work as predicted"
        if result.answer is Behaviour.AS_MODELLED:
            title = "The offsets act as entered, but the machine is not as predicted"
    elif outcome is Outcome.FAIL:
        tone, title = doc.Tone.BAD, "The correction worked, but a deviation is beyond the limit"
    else:
        title = "The correction worked as predicted"
        changed = result.other_change is not None and result.other_change.found
        unsure = unsure or changed or outcome is Outcome.UNDECIDED
    if unsure and tone is doc.Tone.GOOD:
        tone, title = doc.Tone.WARN, f"{title}, with a reservation"
    known = [*result.reservations]
    for reservation in result.reservations:
        of = reservation.data.get("reason")
        if tone is not doc.Tone.BAD and isinstance(of, Reason) and of.code in INVALIDATING:
            title, lines = says(reservation).rstrip("."), [f"{title}.", *lines]
            known.remove(reservation)
            break
    return reserved(doc.Notice(tone, title, tuple(lines)), [*map(says, known)])


def _size(result: Verification, size_mm: float) -> str:
    """An r.m.s. with its unit."""
    if result.differences:
        raw = result.before.kind == result.after.kind == DataKind.READINGS
        return f"{plain(size_mm, difference_decimals(raw))} mm"
    return f"{plain(1000.0 * size_mm, 0)} µm"


def verification_steps(result: Verification, *, brief: bool = False) -> Iterator[doc.Line]:
    """Next steps after the adjustment was measured.

    `brief` is for a screen, which says the answer above and is no report.
    """
    before, after = result.before.path, result.after.path
    machine_file = result.inputs[0].machine_file
    outcome = result.decision and result.decision.outcome
    if not result.kept:
        if any(reason.code == "order_as_given" for reason in result.reservations):
            typed = command("verify", after, before, machine=machine_file)
            if not brief:
                typed = command("report", after, machine=machine_file, after=before)
            yield doc.step(f"If {after} was measured first", typed)
        if result.answer is Behaviour.AS_MODELLED:
            typed = command("diagnose", after, machine=machine_file)
            yield doc.step("Find what else changed, or what was wrong before", typed)
        elif remedy := _remedy(result):
            yield remedy
        yield "Measure again, and compare again"
    elif outcome is Outcome.FAIL:
        yield doc.step(
            "The offsets are right, but a deviation is beyond the limit: find its cause",
            command("diagnose", after, machine=machine_file),
        )
    else:
        if outcome is Outcome.UNDECIDED:
            again = command("measure", machine=machine_file, options="--cycles 10")
            yield doc.step("To decide by the limit, lower U: measure more cycles", again)
        if brief and result.differences:
            limit = result.decision and result.decision.limit_mm
            write = command("report", before, machine=machine_file, after=after, limit=limit)
            yield doc.step("Write the report, and keep it with the machine", write)
        elif outcome is not Outcome.UNDECIDED:
            yield "Nothing more: keep this report with the machine."


def _answer(result: Verification, response: Coefficient, answer: Behaviour) -> str:
    """Response of the machine, in one sentence."""
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


def parameters_left(result: Verification) -> doc.Section:
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
    caption = "Before and now: active in the controller. Found: by the first measurement; left: by"
    caption += " the second."
    note = "What was found was entered."
    if now.count(None) == len(now):
        note = "The files do not record what was entered. A saved printer.cfg does."
    elif not any(entered):
        note = "Nothing was entered."
    elif other := result.entered_otherwise:
        note = f"What was entered differs from what was found here: {', '.join(other)}."
    return doc.Section(f"Parameters{unit}", doc.Grid.of(columns, caption=caption), note)


def _known(row: Parameter) -> str | None:
    return None if row.found is None else with_uncertainty(row.found, row.expanded)


def differences_left(result: Verification) -> doc.Section:
    """The differences as left, and the rule by which a limit is judged; nothing of heights."""
    made = result.decision
    rule = doc.small(f"Decision rule: {_says(result)(made.rule)}") if made else None
    return doc.Section("Predicted and measured", rule, _left_figure(result))


def _left_figure(result: Verification) -> doc.Figure | None:
    """The differences as left; None of heights."""
    every = result.differences
    if not every:
        return None
    rows = [
        (row.name, row.measured_mm, row.expected_mm, row.after_expanded_mm, row.after_mm)
        for row in every
    ]
    sizes = (result.rms_before_mm, result.rms_promised_mm, result.rms_after_mm)
    limit = result.decision.limit_mm if result.decision else None
    outcomes = [row.outcome.capitalize() for row in every if row.outcome]
    return differences_figure(rows, sizes, result.kind == DataKind.SINGLE, limit, outcomes)


def _response(result: Verification) -> Iterator[doc.Block]:
    """All axes together, each, and what else changed; nothing of heights."""
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
    if change := result.other_change:
        code = "other_change" if change.found else "no_other_change"
        yield _says(result)(Reason.of(code, change=change))
