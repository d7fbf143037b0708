"""The document of `orthocal solve`: offsets, how sure they are, and whether the model fits."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.errors import command, file_words
from orthoglide_cal.estimation import PromisedDifference, Solution
from orthoglide_cal.estimation.accuracy import entered_decimals, rms
from orthoglide_cal.model import AXES, DataKind, Floats, Machine
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.json import SCHEMA_VERSION, axes_of, by_axis, fields_of, input_data
from orthoglide_cal.report.words import (
    METHOD_WORDS,
    comparison_words,
    data_words,
    difference_decimals,
    plain,
    signed,
    two_figures,
)


def solution_document(solution: Solution, machine_file: Path | None = None) -> doc.Document:
    """The whole answer.

    Args:
        solution: what was found.
        machine_file: as the user gave it, for the command to run next.
    """
    return doc.Document(
        partial(solution_data, solution), partial(_solution_page, solution, machine_file)
    )


def _solution_page(solution: Solution, machine_file: Path | None) -> doc.Page:
    return doc.Page(
        kind="Solution",
        title=file_words(solution.source.path),
        facts=doc.Facts(
            (
                ("Data", data_words(solution.count, solution.kind)),
                ("Method", f"{solution.method} ({METHOD_WORDS[solution.method]})"),
                ("Machine", doc.Given(solution.machine)),
            )
        ),
        sections=(
            _offsets(solution),
            improvement(solution, solution.table),
            _noise(solution),
            _verdict(solution, machine_file),
        ),
    )


def solution_data(solution: Solution) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm, None where nothing is known."""
    unsure = solution.suspicious or solution.lack_of_fit_p is None
    return {
        "schema_version": SCHEMA_VERSION,
        "input": input_data(solution.source, solution.kind, solution.count),
        **fields_of(solution, "machine", "method"),
        **axes_of(solution, "offsets_mm", "std_mm"),
        "ci95_mm": by_axis(solution.interval_mm),
        **fields_of(solution, "correlation", "sigma_mm", "sigma_rho_mm", "dof"),
        **fields_of(solution, "rms_before_mm", "rms_after_mm", "converged"),
        "table": [
            {
                "difference": row.difference.name,
                **fields_of(row, "measured_mm", "modelled_mm", "expected_mm"),
            }
            for row in solution.table
        ],
        "warnings": [*solution.warnings, *([solution.judgement] if unsure else [])],
        **fields_of(solution, "sigma_residuals_mm", "sigma_repeats_mm", "sigma_floor_mm"),
        **fields_of(solution, "sigma_stated_mm", "lack_of_fit_p"),
        "optimality_mm": solution.remaining_mm,
        "iterations": solution.iterations,
    }


def offsets_grid(
    offsets_mm: Floats, std_mm: Floats, expanded_mm: Floats, machine: Machine
) -> doc.Grid:
    """The offsets, and what to type in: those that are active now plus Δρ.

    Args:
        offsets_mm, std_mm: Δρ with its standard deviations, shape (3,).
        expanded_mm: half the lengths of the 95 % intervals, shape (3,).
        machine: for the offsets active now.
    """
    digits = entered_decimals(expanded_mm.tolist(), machine.offsets_mm)
    rows: list[tuple[doc.Line, ...]] = []
    for k, axis in enumerate(AXES):
        found, half, active = float(offsets_mm[k]), float(expanded_mm[k]), machine.offsets_mm[k]
        values = [signed(v, digits) for v in (found, found - half, found + half, active)]
        change, low, high, now = values
        new = doc.Strong(signed(active + found, digits))
        rows.append((axis, change, two_figures(float(std_mm[k])), f"{low} … {high}", now, new))
    head = ("", "Δρ", "std. dev.", "95 % interval", "active now", "type in")
    return doc.Grid(head, tuple(rows))


def _offsets(solution: Solution) -> doc.Section:
    correlation = solution.correlation
    pairs = ", ".join(
        f"{AXES[i]}{AXES[j]} {signed(correlation[i, j], 2)}" for i, j in ((0, 1), (1, 2), (2, 0))
    )
    together = f"Correlations: {pairs}. Together: σ_ρ = {two_figures(solution.sigma_rho_mm)} mm."
    to_do = (
        "Type the last column into the controller as its joint offsets, home, and measure again."
        " It is the offset that is active now (machine file) plus Δρ."
    )
    machine = solution.model.machine
    grid = offsets_grid(solution.offsets_mm, solution.std_mm, solution.expanded_mm, machine)
    return doc.Section(
        "Joint offsets, mm (true position = indicated + Δρ)",
        (grid, doc.Paragraph(together), doc.Paragraph(to_do)),
    )


def improvement(
    solution: Solution, table: Sequence[PromisedDifference], in_full: bool = False
) -> doc.Section:
    """Table 4 of the paper: measured, and what should remain after the correction.

    Args:
        solution: of the offsets alone, for its residuals.
        table: the differences, with the promise of the offsets to enter.
        in_full: with what the model explains.
    """
    raw = solution.kind is DataKind.READINGS
    quality = doc.Paragraph(
        f"Residual r.m.s. of the {'readings' if raw else 'differences'}:"
        f" {plain(solution.rms_before_mm, 4)} before, {plain(solution.rms_after_mm, 4)} after"
        f"{'' if table is solution.table else ' (offsets alone)'}."
    )
    if not table:
        return doc.Section(None, (quality,))
    values = {
        "measured": [row.measured_mm for row in table],
        "expected after": [row.expected_mm for row in table],
    }
    if in_full:
        values["modelled"] = [row.modelled_mm for row in table]
    digits = difference_decimals(raw, solution.model.machine.gauge.resolution_mm)
    rows: list[tuple[str, ...]] = []
    for title, row in values.items():
        size = plain(rms(np.array(row)), digits)
        rows.append((title, *(signed(value, digits) for value in row), size))
    differences = [row.difference for row in table]
    what, meaning = comparison_words(differences)
    names = (f"d{each.name}" for each in differences)
    grid = doc.Grid(("", *names, "r.m.s."), tuple(rows), caption=meaning)
    return doc.Section(f"Expected improvement, mm (differences, {what})", (grid, quality))


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


def _noise(solution: Solution) -> doc.Section:
    spare = f"; {solution.dof} degrees of freedom" if solution.dof else ""
    title = f"Standard deviation of one reading, mm{spare}"
    return doc.Section(title, (noise_grid(solution),))


def _verdict(solution: Solution, machine_file: Path | None) -> doc.Section:
    blocks: list[doc.Block] = [doc.Paragraph(f"Note: {warning}") for warning in solution.warnings]
    sound = solution.dof and not solution.suspicious
    blocks.append(doc.Notice(doc.Tone.GOOD if sound else doc.Tone.WARN, solution.judgement))
    if solution.suspicious:
        next_one = command("diagnose", solution.source.path, machine=machine_file)
        blocks.append(doc.Paragraph(("Run next: ", doc.Command(next_one))))
    return doc.Section(None, tuple(blocks))
