"""The verification report: promised against measured, and how the machine responded.

The calibration report shows the same notice, advice and table once the adjustment was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from orthoglide_cal.errors import command, file_words
from orthoglide_cal.estimation import Solution
from orthoglide_cal.files import Conditions
from orthoglide_cal.model import AXES, DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import figures
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.facts import moment, owner_facts, scope
from orthoglide_cal.report.json import SCHEMA_VERSION, axes_of, by_axis, fields_of
from orthoglide_cal.results import Identity, remainder
from orthoglide_cal.verification import (
    RULE,
    AxisResponse,
    Behaviour,
    Coefficient,
    Outcome,
    Verification,
)
from orthoglide_cal.words import (
    MM_PER_INCH,
    chance,
    coverage_words,
    difference_decimals,
    entered_decimals,
    plain,
    signed,
    two_figures,
    with_uncertainty,
)


def verification_document(verification: Verification, identity: Identity) -> doc.Document:
    """The document, for any of the renderers."""
    return doc.Document(
        partial(verification_data, verification), partial(_page, verification, identity)
    )


def _page(verification: Verification, identity: Identity) -> doc.Page:
    applied = _triple(verification.applied_mm.tolist(), verification)
    return doc.Page(
        kind="Verification report",
        title=verification.before.machine,
        number=identity.number,
        facts=doc.Facts(
            (
                *owner_facts(verification.after.model.machine),
                ("Number", doc.Code(identity.number)),
                ("Applied", f"{applied} mm (x, y, z)"),
                ("Issued", f"{identity.issued:%Y-%m-%d %H:%M} UTC"),
            )
        ),
        notice=verification_notice(verification),
        sheet=(verification_outcome(verification),),
        sections=(
            _response(verification),
            _remaining(verification),
            _origin(verification, identity),
        ),
        signatures=("Measured by", "Checked by"),
        scope=scope(verification.before.model.machine),
    )


def verification_data(verification: Verification) -> dict[str, Any]:
    """Everything that `verify` shows; lengths in mm."""
    decision, response = verification.decision, verification.response
    before, after, acted = verification.before, verification.after, response.acted_as_mm
    return {
        "schema_version": SCHEMA_VERSION,
        "before": _source_data(before, verification.conditions[0]),
        "after": _source_data(after, verification.conditions[1]),
        "machine": before.machine,
        "kind": verification.comparison.kind,
        "compared": len(verification.comparison),
        **axes_of(verification, "applied_mm"),
        "rms_before_mm": verification.as_found.rms_mm,
        "rms_promised_mm": verification.promised.rms_mm,
        "rms_after_mm": verification.as_left.rms_mm,
        "differences": [
            {
                "difference": d.difference.name,
                **fields_of(d, "before_mm", "promised_mm", "after_mm", "expanded_mm"),
                "promised_expanded_mm": d.promise.expanded_mm,
            }
            for d in verification.deviations
        ],
        "response": _coefficient_data(response.coefficient),
        "response_dof": response.dof,
        "axes": {axis.axis: _axis_data(axis) for axis in response.axes},
        "answer": response.behaviour,
        "acted_as_mm": None if acted is None else by_axis(acted),
        "other_change": fields_of(response.change, "rms_mm", "noise_mm", "dof", "p_value", "found"),
        "remaining_mm": by_axis(after.offsets_mm),
        "remaining_expanded_mm": by_axis(after.expanded_mm),
        "decision": None
        if decision is None
        else {
            **fields_of(decision, "outcome", "limit_mm"),
            "largest_mm": abs(decision.largest.after_mm),
            "largest_difference": decision.largest.difference.name,
            "expanded_mm": decision.largest.expanded_mm,
            "coverage_factor": verification.k,
            "rule": RULE,
        },
    }


def _source_data(solution: Solution, given: Conditions) -> dict[str, Any]:
    return {
        **fields_of(solution.source, "path", "sha256"),
        **fields_of(given, "started", "finished", "operator"),
    }


def _coefficient_data(found: Coefficient) -> dict[str, Any]:
    return {
        **fields_of(found, "value", "std"),
        "ci95": [found.low, found.high],
        "agrees": found.agrees,
    }


def _axis_data(axis: AxisResponse) -> dict[str, Any]:
    return {
        **fields_of(axis, "applied_mm", "found_mm"),
        "ci95_mm": [axis.low_mm, axis.high_mm],
        "coefficient": None if axis.coefficient is None else _coefficient_data(axis.coefficient),
    }


def verification_notice(verification: Verification) -> doc.Notice:
    """The answer in one box."""
    before, promised, after = _rms(verification)
    left = remainder([d.promise for d in verification.deviations], verification.before.model)
    lines = (
        f"Promised {promised} mm, measured {after} mm (r.m.s.; before {before} mm).",
        _answer(verification),
        *_decision(verification),
        *([left] if left else []),
    )
    outcome = verification.decision.outcome if verification.decision else Outcome.PASS
    response = verification.response
    if response.behaviour is not Behaviour.AS_MODELLED:
        return doc.Notice(doc.Tone.BAD, "The correction did not do what was promised", lines)
    if outcome is Outcome.FAIL:
        title = "The correction worked, yet a deviation is beyond the limit"
        return doc.Notice(doc.Tone.BAD, title, lines)
    if response.change.found or outcome is not Outcome.PASS:
        return doc.Notice(doc.Tone.WARN, "The correction worked, with a reservation", lines)
    return doc.Notice(doc.Tone.GOOD, "The correction did what was promised", lines)


def _digits(verification: Verification) -> int:
    return difference_decimals(verification.comparison.kind is DataKind.READINGS)


def _rms(verification: Verification) -> list[str]:
    """Before, promised and after [mm]."""
    sizes = (verification.as_found, verification.promised, verification.as_left)
    return [plain(size.rms_mm, _digits(verification)) for size in sizes]


def verification_to_do(verification: Verification, machine_file: Path | None) -> doc.Section:
    """What to do after the adjustment was measured; with the machine file as the user gave it."""
    to_do = doc.Instruction
    if verification.response.behaviour is not Behaviour.AS_MODELLED:
        items = [to_do(_answer(verification)), to_do("Then measure again and compare again.")]
    elif verification.decision is not None and verification.decision.outcome is Outcome.FAIL:
        diagnose = command("diagnose", verification.after.source.path, machine=machine_file)
        items = [
            to_do("The offsets are right, yet a deviation is beyond the limit: find its cause."),
            to_do("Diagnose the last session.", diagnose),
        ]
    else:
        items = [to_do("Nothing more: keep this report with the machine.")]
    return doc.Section("What to do next", (doc.Instructions(tuple(items)),))


def _answer(verification: Verification) -> str:
    """How the machine responded, in one sentence."""
    response = verification.response
    acted, size = response.acted_as_mm, f"response {_interval(response.coefficient)}"
    entered = "" if acted is None else _triple(acted.tolist(), verification)
    return {
        Behaviour.AS_MODELLED: f"The machine responded as the model says: {size}, theory 1.",
        Behaviour.OPPOSITE: f"The correction acted with the opposite sign ({size}): enter the"
        " negative values.",
        Behaviour.EXCHANGED: f"The correction acted as if {entered} had been entered (x, y, z):"
        " check the joints.",
        Behaviour.NO_RESPONSE: f"The machine did not respond ({size}): re-home, and check that the"
        " values are active.",
        Behaviour.OTHER_GAIN: f"The machine responded by another amount ({size}, theory 1):"
        f" {_gain(response.coefficient)}",
        Behaviour.PARTLY: f"Not every axis did what was entered: {_others(response.axes)}. Check"
        " what the controller holds there, and re-home.",
        Behaviour.UNDETERMINED: "The correction is too small for these readings to show a response"
        f" ({size}).",
    }[response.behaviour]


def _others(axes: Sequence[AxisResponse]) -> str:
    """The axes that did something else, each with what."""
    return "; ".join(
        f"{row.axis} changed by {signed(row.found_mm, 3)} mm where {signed(row.applied_mm, 3)} mm"
        " was applied"
        for row in axes
        if row.otherwise
    )


def _gain(response: Coefficient) -> str:
    for factor in (MM_PER_INCH, 1.0 / MM_PER_INCH):
        if abs(response.value / factor - 1.0) < 0.1:
            return "inches and millimetres were mixed up."
    return "check the gauge against a gauge block, its plunger for tilt, and the axis scale."


def _interval(coefficient: Coefficient) -> str:
    """ "1.03 [0.91, 1.14]"."""
    return f"{coefficient.value:.2f} [{coefficient.low:.2f}, {coefficient.high:.2f}]"


def _entered(verification: Verification) -> int:
    """Decimals of joint offsets: those of what was applied, and of what is known of the rest."""
    reach = verification.after.expanded_mm.tolist()
    return entered_decimals(reach, verification.applied_mm.tolist())


def _triple(values: Sequence[float], verification: Verification) -> str:
    return " ".join(signed(value, _entered(verification)) for value in values)


def _decision(verification: Verification) -> tuple[str, ...]:
    """The decision about the limit in one sentence; none where no limit was given."""
    decision = verification.decision
    if decision is None:
        return ()
    worst = decision.largest
    name = worst.difference.name
    largest, reach = plain(abs(worst.after_mm), 3), plain(worst.expanded_mm, 3)
    return (
        f"{decision.outcome.capitalize()}: limit {decision.limit_mm:g} mm, largest deviation"
        f" {largest} ± {reach} mm ({name}; U with {coverage_words(verification.k)}, 95 %).",
    )


def entered_and_left(case: Case, verification: Verification) -> doc.Section:
    """What the controller held, what was entered, and what remains; where both sides come from."""
    decimals = max(case.answer.decimals, _entered(verification))
    after, applied = verification.after, verification.applied_mm.tolist()
    rows = tuple(
        (
            doc.Strong(axis),
            signed(before, decimals),
            signed(change, decimals),
            doc.Strong(signed(before + change, decimals)),
            with_uncertainty(remains, expanded),
        )
        for axis, before, change, remains, expanded in zip(
            AXES,
            [each.active for each in case.answer.parameters],
            applied,
            after.offsets_mm.tolist(),
            after.expanded_mm.tolist(),
            strict=True,
        )
    )
    grid = doc.Grid(
        ("axis", "before", "entered", "now", "remains ± U"),
        rows,
        caption="In mm. Before, now: active in the controller; entered: the change between them;"
        " remains: found by the session after it.",
    )
    return doc.Section("Joint offsets", (grid, doc.Facts(verified_sessions(verification))))


def verification_outcome(verification: Verification) -> doc.Section:
    """Promised and measured, difference by difference."""
    digits, deviations = _digits(verification), verification.deviations
    rows: list[tuple[doc.Blank, ...]] = []
    for d in deviations:
        values = (d.before_mm, d.promised_mm, d.after_mm, d.after_mm - d.promised_mm)
        before, promised, after, missed = (signed(value, digits) for value in values)
        reach = f"± {plain(d.promise.expanded_mm, digits)}"
        rows.append((d.difference.name, before, promised, reach, after, missed))
    sizes = [doc.Strong(size) for size in _rms(verification)]
    rows.append(("r.m.s.", *sizes[:2], "", sizes[2], ""))
    grid = doc.Grid(
        ("difference", "before", "promised", "U", "measured", "missed by"),
        tuple(rows),
        caption="Deviation from parallel motion, mm.",
        last_is_total=True,
    )
    limit = verification.decision.limit_mm if verification.decision else None
    figure = doc.Figure(
        None,
        "What is left of each difference, and what was promised.",
        (
            figures.deviation_rows(
                [d.difference.name for d in deviations],
                [d.before_mm for d in deviations],
                [d.promised_mm for d in deviations],
                [d.expanded_mm for d in deviations],
                [d.after_mm for d in deviations],
                limit,
            ),
        ),
        columns=1,
        key="○ as found, ■ promised, ● left after correction with U (95 %)"
        + ("." if limit is None else "; dotted: the limit."),
    )
    decided = [doc.Paragraph(doc.Strong(sentence)) for sentence in _decision(verification)]
    rule = [doc.Paragraph(f"Decision rule: {RULE}", small=True)] if decided else []
    return doc.Section("Promised and measured", (grid, *decided, *rule, figure))


def _response(verification: Verification) -> doc.Section:
    response = verification.response
    rows = []
    for axis in response.axes:
        values = (axis.applied_mm, axis.found_mm, axis.low_mm, axis.high_mm)
        applied, found, low, high = (signed(v, _entered(verification)) for v in values)
        coefficient = _interval(axis.coefficient) if axis.coefficient else ""
        rows.append((axis.axis, applied, found, f"{low} … {high}", coefficient))
    change = response.change
    size, noise = f"{1000 * change.rms_mm:.0f} µm", f"{1000 * change.noise_mm:.0f} µm"
    other = (
        f"Something else changed: {size} per difference that no offset explains, where noise gives"
        f" {noise} ({chance(change.p_value)}). Was the stand moved, a leg or rail adjusted, or"
        " another gauge used?"
        if change.found
        else f"Nothing else changed: {size} per difference where noise gives {noise}"
        f" ({chance(change.p_value)})."
    )
    lead = (
        "Response coefficient, all axes together: ",
        doc.Strong(_interval(response.coefficient)),
        f". Theory: 1. (95 % interval, {response.dof} degrees of freedom.)",
    )
    grid = doc.Grid(
        ("axis", "applied", "found", "95 % interval", "coefficient"),
        tuple(rows),
        caption="Change of each joint, mm, fitted together.",
    )
    blocks = (doc.Paragraph(lead), grid, doc.Paragraph(other))
    return doc.Section("How the machine responded", blocks)


def _remaining(verification: Verification) -> doc.Section:
    after = verification.after
    rows = tuple(
        (axis, signed(value, _entered(verification)), f"± {two_figures(half)}")
        for axis, value, half in zip(
            AXES, after.offsets_mm.tolist(), after.expanded_mm.tolist(), strict=True
        )
    )
    caption = "In mm; identified from the second session, beside what was applied."
    grid = doc.Grid(("axis", "Δρ", "U"), rows, caption=caption)
    return doc.Section("Offsets that remain", (grid,))


def verified_sessions(verification: Verification) -> tuple[tuple[str, doc.Blank], ...]:
    """Where both sides come from: file, digest, time, operator; blank where not given."""
    rows: list[tuple[str, doc.Blank]] = []
    solutions = (verification.before, verification.after)
    for name, solution, given in zip(
        ("Before", "After"), solutions, verification.conditions, strict=True
    ):
        rows += [
            (name, doc.Given(file_words(solution.source.path))),
            ("SHA-256", doc.Code(solution.source.sha256)),
            ("Measured", moment(given.finished or given.started)),
            ("Operator", None if given.operator is None else doc.Given(given.operator)),
        ]
    return tuple(rows)


def _origin(verification: Verification, identity: Identity) -> doc.Section:
    facts = doc.Facts(
        (
            *verified_sessions(verification),
            ("Machine", doc.Given(verification.before.machine)),
            ("Compared", f"{len(verification.comparison)} independent changes"),
            ("Software", identity.software),
        )
    )
    return doc.Section("Where this comes from", (facts,))
