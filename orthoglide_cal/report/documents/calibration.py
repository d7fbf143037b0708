"""The calibration report: one session, its result, and what to do.

Here stands what is pinned to the machine: may the offsets be entered, what to do, the offsets with
their uncertainty, as found and as left. The pages behind it are made in `evidence`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from orthoglide_cal.files import Conditions
from orthoglide_cal.model import AXES, DataKind
from orthoglide_cal.model.workspace import WorkspaceError
from orthoglide_cal.report import charts
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.canvas import interval_lines
from orthoglide_cal.report.controller import cautions, joints_data, remedy_words
from orthoglide_cal.report.documents import evidence
from orthoglide_cal.report.documents.budget import budget_section
from orthoglide_cal.report.documents.decision import decision_notice, to_do
from orthoglide_cal.report.documents.diagnosis import diagnosis_data
from orthoglide_cal.report.documents.parameters import (
    offsets_grid,
    offsets_title,
    open_blocks,
    parameters_of,
    result_of,
)
from orthoglide_cal.report.documents.solution import solution_data
from orthoglide_cal.report.documents.verification import (
    entered_and_left,
    verification_data,
    verification_notice,
    verification_outcome,
    verification_to_do,
)
from orthoglide_cal.report.facts import SCOPE, owner_facts
from orthoglide_cal.report.json import SCHEMA_VERSION, fields_of, input_data
from orthoglide_cal.results import Adjustment, Calibration
from orthoglide_cal.verification import Size
from orthoglide_cal.words import (
    coverage_words,
    difference_decimals,
    plain,
    signed,
    two_figures,
    with_uncertainty,
)

KIND = "Calibration report"


def calibration_document(
    calibration: Calibration, machine_file: Path | None = None
) -> doc.Document:
    """The document, for any of the renderers.

    Args:
        calibration: what to show.
        machine_file: as the user gave it, for the commands to run next.
    """
    return doc.Document(
        partial(calibration_data, calibration, machine_file),
        partial(_page, calibration, machine_file),
    )


def _page(calibration: Calibration, machine_file: Path | None) -> doc.Page:
    identity, given = calibration.identity, calibration.input.conditions
    verification = calibration.verification
    if verification is not None:
        sheet = [verification_to_do(verification, machine_file)]
    else:
        sheet = [to_do(calibration, machine_file)]
    pages = [verification_outcome(verification)] if verification else []
    if calibration.adjustment is not None:
        sheet += _answer(calibration, calibration.adjustment)
        if not calibration.adjustment.machine.absolute:
            # Parameters of several units have no scale in common.
            pages.append(_intervals(calibration, calibration.adjustment))
        pages.append(budget_section(calibration.adjustment.budget, calibration.adjustment.machine))
    pages += evidence.evidence(calibration, machine_file)
    background = [evidence.conditions(calibration), evidence.origin(calibration)]
    # Without a result there is nothing to pin to the machine, and one sheet of paper says it all.
    (pages if calibration.solution else sheet).extend(background)
    return doc.Page(
        kind=KIND,
        title=calibration.input.model.machine.name,
        number=identity.number,
        facts=doc.Facts(
            (
                *owner_facts(calibration.input.model.machine),
                ("Number", doc.Code(identity.number)),
                ("Measured", evidence.moment(given.finished or given.started)),
                ("Issued", f"{identity.issued:%Y-%m-%d %H:%M} UTC"),
            )
        ),
        notice=verification_notice(verification) if verification else decision_notice(calibration),
        sheet=tuple(sheet),
        sections=tuple(pages),
        signatures=("Measured by", "Adjusted by", "Checked by"),
        scope=calibration.input.model.machine.vocabulary.said(SCOPE),
    )


def calibration_data(calibration: Calibration, machine_file: Path | None = None) -> dict[str, Any]:
    """Everything that the page shows as numbers and words; lengths in mm."""
    identity, given = calibration.identity, calibration.input
    measured, release = given.measured, calibration.release
    found, diagnosis, left = calibration.adjustment, calibration.diagnosis, calibration.verification
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND.lower(),
        "number": identity.number,
        "issued": identity.issued.isoformat(timespec="seconds"),
        "software": identity.software,
        "input": input_data(measured.source, measured.kind, len(measured)),
        "machine": given.model.machine.name,
        "conditions": _conditions_data(given.conditions),
        "usable": release.usable,
        "reasons_against": list(release.reasons),
        "remedies": remedy_words(calibration, machine_file),
        "cautions": list(cautions(calibration)),
        "as_found": _size_data(calibration.as_found),
        "expected": _size_data(calibration.expected),
        "as_left": verification_data(left) if left else None,
        "answer": _answer_data(found) if found else None,
        "adjustment": _adjustment_data(found) if found else None,
        "workspace": _workspace_data(calibration.workspace),
        "solution": solution_data(calibration) if calibration.solution else None,
        "diagnosis": diagnosis_data(calibration) if diagnosis else None,
    }


def _adjustment_data(found: Adjustment) -> dict[str, Any]:
    if found.machine.absolute:
        return joints_data(found)
    return {
        joint.axis: fields_of(joint, "previous_mm", "change_mm", "new_mm") for joint in found.joints
    }


def _answer_data(found: Adjustment) -> dict[str, Any]:
    return {
        "model": list(found.causes),
        **parameters_of(found),
        **result_of(found, "offsets_mm", "std_mm", "expanded_mm"),
        "coverage_factor": found.budget.k,
        "confidence": found.confidence,
        "dof": _dof(found),
    }


# Beyond this Student's t is the normal distribution to two decimals.
NORMAL_DOF = 500.0


def _dof(found: Adjustment) -> int | None:
    """Effective degrees of freedom of k; None for the normal distribution."""
    return None if found.budget.dof >= NORMAL_DOF else round(found.budget.dof)


def _workspace_data(workspace: WorkspaceError | None) -> dict[str, Any] | None:
    if workspace is None:
        return None
    return {
        "cube_mm": [float(workspace.axis_mm[0]), float(workspace.axis_mm[-1])],
        **fields_of(workspace, "before_max_mm", "before_mean_mm", "after_max_mm", "after_mean_mm"),
    }


def _conditions_data(given: Conditions) -> dict[str, Any]:
    return {
        **fields_of(given, "protocol", "operator", "started", "finished", "temperature_c"),
        "environment": dict(given.environment),
        "gauges": [
            {"id": gauge.label, **fields_of(gauge, "certificate", "resolution_mm")}
            for gauge in given.gauges
        ],
        **fields_of(given, "retaken", "skipped"),
    }


def _size_data(size: Size | None) -> dict[str, Any] | None:
    if size is None:
        return None
    return {**fields_of(size, "rms_mm", "largest_mm"), "largest_difference": size.largest.name}


def _answer(calibration: Calibration, adjustment: Adjustment) -> list[doc.Section]:
    """The offsets, and what they mend."""
    left = calibration.verification
    if left is None:
        draw = _parameters if adjustment.machine.absolute else _offsets
        sections = [draw(calibration, adjustment)]
    else:
        sections = [entered_and_left(adjustment, left)]
    if calibration.as_found is not None:
        given = calibration.input
        raw, gauge = given.measured.kind is DataKind.READINGS, given.model.machine.gauge
        digits = difference_decimals(raw, gauge.resolution_mm)
        sizes = (calibration.as_found, calibration.expected, calibration.as_left)
        sections.append(_found_and_left(sizes, digits))
    return sections


def _parameters(calibration: Calibration, adjustment: Adjustment) -> doc.Section:
    """Parameters that the firmware states, and what the readings leave open."""
    usable = calibration.release.usable
    coverage = doc.Paragraph(_coverage(adjustment), small=True)
    return doc.Section(
        offsets_title(adjustment, usable),
        (
            offsets_grid(adjustment, calibration.enters),
            *open_blocks(calibration, adjustment),
            coverage,
        ),
    )


def _offsets(calibration: Calibration, adjustment: Adjustment) -> doc.Section:
    """The offsets with expanded uncertainty."""
    usable = calibration.release.usable
    digits, joints = adjustment.decimals, adjustment.joints
    values = zip(adjustment.offsets_mm.tolist(), joints, strict=True)
    columns: dict[str, Iterable[doc.Blank]] = {
        "axis": [doc.Strong(joint.axis) for joint in joints],
        "now": [signed(joint.previous_mm, digits) for joint in joints],
        "Δρ ± U": [with_uncertainty(value, joint.expanded_mm) for value, joint in values],
    }
    if usable:
        columns["enter"] = [doc.Strong(signed(joint.new_mm, digits)) for joint in joints]
    grid = doc.Grid(
        tuple(columns),
        tuple(zip(*columns.values(), strict=True)),
        caption="In mm. Now: active in the controller. True joint position = indicated + Δρ.",
        tiles=True,
    )
    coverage = doc.Paragraph(_coverage(adjustment), small=True)
    title = "Joint offsets" if usable else "Joint offsets as found"
    return doc.Section(title, (grid, coverage))


def _coverage(adjustment: Adjustment) -> str:
    """How U was made."""
    dof = _dof(adjustment)
    source = "normal distribution"
    if dof is not None:
        source = f"Student's t with {dof} effective degrees of freedom"
    causes = " and ".join(adjustment.causes)
    return (
        f"U = k·u is the expanded uncertainty with {coverage_words(adjustment.budget.k)}"
        f" ({source}), for a confidence of {100 * adjustment.confidence:.0f} %."
        + (f" Model: {adjustment.machine.vocabulary.many} and {causes}." if causes else "")
    )


def _found_and_left(sizes: Sequence[Size | None], digits: int) -> doc.Section:
    """Deviation from parallelism as found, as expected, and as left."""
    columns = [
        (plain(size.rms_mm, digits), signed(size.largest_mm, digits), size.largest.name)
        if size is not None
        else (None, None, None)
        for size in sizes
    ]
    grid = doc.Grid(
        ("", "as found", "promised" if sizes[-1] else "left after correction", "as left"),
        tuple(zip(("r.m.s.", "largest", "which"), *columns, strict=True)),
        caption="Deviation of the legs from parallel motion, mm"
        + ("." if sizes[-1] else "; as left is blank until it is measured again."),
    )
    return doc.Section("As found, as left", (grid,))


def _intervals(calibration: Calibration, adjustment: Adjustment) -> doc.Section:
    """The offsets with their intervals as a picture."""
    values, halves = adjustment.offsets_mm.tolist(), adjustment.expanded_mm.tolist()
    causes, alone = " and ".join(adjustment.causes), calibration.alone
    name = f"with {causes}" if causes else "offsets"
    bars = [charts.Bar(name, values, halves)]
    if causes and alone is not None:
        offsets, reach = alone.offsets_mm.tolist(), alone.expanded_mm.tolist()
        bars.append(charts.Bar("offsets alone", offsets, reach))
    least, most = two_figures(min(halves)), two_figures(max(halves))
    figure = doc.Figure(
        None,
        f"Expanded uncertainty: {least if least == most else f'{least} to {most}'} mm.",
        charts.intervals(bars),
        sketch=interval_lines(AXES, values, halves),
        columns=2,
        key=f"● {name}, □ offsets alone." if causes else None,
    )
    return doc.Section("Offsets with their 95 % intervals", (figure,))
