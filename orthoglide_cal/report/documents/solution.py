"""The document of `orthocal solve`: may the offsets be entered, how sure they are, what is left."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.errors import file_words
from orthoglide_cal.estimation import PromisedDifference, Solution
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.model import DataKind
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.budget import budget_section
from orthoglide_cal.report.documents.decision import decision_notice, to_do
from orthoglide_cal.report.documents.parameters import (
    JOINTS,
    by_joint,
    offsets_grid,
    offsets_title,
    open_blocks,
    parameters_of,
    release_of,
    result_of,
)
from orthoglide_cal.report.facts import METHOD_WORDS, comparison_words, data_words
from orthoglide_cal.report.json import SCHEMA_VERSION, fields_of, input_data
from orthoglide_cal.results import Calibration
from orthoglide_cal.words import counted, difference_decimals, plain, signed, two_figures


def solution_document(calibration: Calibration, machine_file: Path | None = None) -> doc.Document:
    """The whole answer.

    Args:
        calibration: a result with a solution.
        machine_file: as the user gave it, for the commands to run next.
    """
    return doc.Document(
        partial(solution_data, calibration), partial(_solution_page, calibration, machine_file)
    )


def _solution_page(calibration: Calibration, machine_file: Path | None) -> doc.Page:
    solution, found = calibration.found
    return doc.Page(
        kind="Solution",
        title=file_words(solution.source.path),
        facts=doc.Facts(
            (
                ("Data", data_words(solution.source, solution.kind, solution.count)),
                ("Method", f"{solution.method} ({METHOD_WORDS[solution.method]})"),
                ("Machine", doc.Given(solution.machine)),
            )
        ),
        notice=decision_notice(calibration),
        sheet=(to_do(calibration, machine_file),),
        sections=(
            _offsets(calibration),
            left_after(solution, found.promised, usable=calibration.release.usable),
            budget_section(found.budget, found.machine),
            _noise(calibration),
        ),
    )


def solution_data(calibration: Calibration) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm, None where nothing is known."""
    solution, found = calibration.found
    unsure = solution.suspicious or solution.lack_of_fit_p is None
    return {
        "schema_version": SCHEMA_VERSION,
        "input": input_data(solution.source, solution.kind, solution.count),
        **fields_of(solution, "machine", "method"),
        **parameters_of(found),
        **result_of(found),
        "k": found.budget.k,
        "budget": [
            {
                "source": each.source,
                "type": each.evaluation,
                "std_mm": by_joint(found, each.std_mm),
                **fields_of(each, "size", "unit", "assumed"),
                "sensitivity": by_joint(found, each.std_mm / each.size) if each.size else None,
            }
            for each in found.budget.contributions
        ],
        **release_of(calibration),
        **fields_of(solution, "correlation", "sigma_mm", "sigma_rho_mm", "dof"),
        **fields_of(solution, "rms_before_mm", "rms_after_mm", "converged"),
        "table": [
            {
                "difference": row.difference.name,
                **fields_of(row, "measured_mm", "modelled_mm", "expected_mm", "expanded_mm"),
            }
            for row in found.promised
        ],
        "warnings": [*solution.warnings, *([solution.judgement] if unsure else [])],
        **fields_of(solution, "sigma_residuals_mm", "sigma_repeats_mm", "sigma_floor_mm"),
        **fields_of(solution, "sigma_stated_mm", "lack_of_fit_p"),
        "iterations": solution.iterations,
    }


def _offsets(calibration: Calibration) -> doc.Section:
    solution, found = calibration.found
    usable, diagnosis = calibration.release.usable, calibration.diagnosis
    names, correlation = found.machine.parameter_names[:JOINTS], solution.correlation
    pairs = ", ".join(
        f"{names[i]}{names[j]} {signed(correlation[i, j], 2)}" for i, j in ((0, 1), (1, 2), (2, 0))
    )
    together = f"Correlations: {pairs}. Together: σ_ρ = {two_figures(solution.sigma_rho_mm)} mm."
    named = diagnosis is not None and diagnosis.verdict is Verdict.NAMED and not usable
    beside = calibration.adjustment if named else None
    blocks = (*open_blocks(calibration, found), doc.Paragraph(together))
    return doc.Section(
        offsets_title(found, usable), (offsets_grid(found, calibration.enters, beside), *blocks)
    )


def left_after(
    solution: Solution,
    table: Sequence[PromisedDifference],
    in_full: bool = False,
    usable: bool = True,
) -> doc.Section:
    """Table 4 of the paper: measured, and what is left after the correction.

    Args:
        solution: of the offsets alone, for its residuals.
        table: the differences, with the promise of the offsets to enter.
        in_full: with what the model explains.
        usable: False where the offsets are not to be entered: what would be left is no promise.
    """
    raw = solution.kind is DataKind.READINGS
    what = f"{'readings' if raw else 'differences'}{solution.measured.weighing}"
    quality = doc.Paragraph(
        f"Residual r.m.s. of the {what}: {plain(solution.rms_before_mm, 4)} before,"
        f" {plain(solution.rms_after_mm, 4)} with the {solution.model.machine.vocabulary.many}."
    )
    if not table:
        return doc.Section(None, (quality,))
    values = {
        "measured": [row.measured_mm for row in table],
        "left after" if usable else "would be left": [row.expected_mm for row in table],
    }
    if in_full:
        values["modelled"] = [row.modelled_mm for row in table]
    digits = difference_decimals(raw, solution.model.machine.gauge.resolution_mm)
    rows: list[tuple[str, ...]] = []
    for title, row in values.items():
        size = plain(rms(np.array(row)), digits)
        rows.append((title, *(signed(value, digits) for value in row), size))
    reach = (f"± {plain(row.expanded_mm, digits)}" for row in table)
    rows.insert(2, ("", *reach, ""))
    differences = [row.difference for row in table]
    what, meaning = comparison_words(bool(differences[0].posture))
    names = (each.name for each in differences)
    grid = doc.Grid(("", *names, "r.m.s."), tuple(rows), caption=meaning)
    title = "Left after correction" if usable else "Left if these offsets were entered"
    return doc.Section(f"{title}, mm (differences, {what})", (grid, quality))


def noise_grid(solution: Solution) -> doc.Grid:
    """The standard deviation of one reading from each source, side by side [mm]."""
    sigmas = (
        solution.sigma_repeats_mm,
        solution.sigma_residuals_mm,
        solution.sigma_stated_mm,
        solution.sigma_floor_mm,
        solution.sigma_mm,
    )
    cells = ("unknown" if sigma is None else plain(sigma, 4) for sigma in sigmas)
    return doc.Grid(("", "repeats", "residuals", "stated", "floor q/√12", "used"), (("σ", *cells),))


def _noise(calibration: Calibration) -> doc.Section:
    solution = calibration.found[0]
    spare = f"; {counted(solution.dof, 'degree')} of freedom" if solution.dof else ""
    title = f"Standard deviation of one reading, mm{spare}"
    notes = [doc.Paragraph(f"Note: {warning}") for warning in solution.warnings]
    if not calibration.release.usable:
        # Otherwise it stands at the top.
        notes.append(doc.Paragraph(solution.judgement))
    return doc.Section(title, (noise_grid(solution), *notes))
