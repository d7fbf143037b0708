"""A solution as text for a terminal of 80 columns."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from orthoglide_cal.axes import AXES
from orthoglide_cal.estimation import Solution
from orthoglide_cal.machine import Machine

_KINDS = {
    "readings": "raw readings",
    "six": "differences, max − min",
    "twelve": "differences relative to iso",
    "single": "differences, tool end − joint end",
}
_METHODS = {
    "readings": "all readings at once",
    "six": "eq. 25, six equations",
    "twelve": "eq. 25, twelve equations",
    "six-linear": "eq. 17",
    "twelve-linear": "eq. 16",
    "single": "eq. 10",
    "single-sequential": "eq. 11",
}


def render(
    solution: Solution, machine: Machine, machine_file: Path | None = None
) -> RenderableType:
    """The whole answer.

    Args:
        solution: what was found.
        machine: for the offsets already active and the gauge.
        machine_file: as the user gave it, for the command to run next.
    """
    path = "standard input" if solution.source.path == "-" else solution.source.path
    return Group(
        Text(path, style="bold"),
        Text(
            f"{solution.count} {_KINDS[solution.kind]}; method {solution.method}"
            f" ({_METHODS[solution.method]}); {machine.name}"
        ),
        Text(),
        *_offsets(solution, machine),
        Text(),
        *_improvement(solution, machine),
        Text(),
        *_noise(solution),
        Text(),
        *(Text(f"Note: {warning}") for warning in solution.warnings),
        *_verdict(solution, machine_file),
        Text(),
    )


def _table(*columns: str) -> Table:
    """A borderless table: the first column to the left, numbers to the right."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right", no_wrap=True)
    return table


def _decimals(std: float) -> int:
    """Decimals that show the standard deviation with two digits: three or four."""
    return min(max(1 - math.floor(math.log10(std)), 3), 4) if std > 0.0 else 4


def _offsets(solution: Solution, machine: Machine) -> list[RenderableType]:
    digits = _decimals(float(solution.std_mm.min()))

    def show(value: float) -> str:
        # + 0.0 turns a negative zero into zero.
        return f"{round(value, digits) + 0.0:+.{digits}f}"

    table = _table("", "Δρ", "std. dev.", "95 % interval", "active now", "type in")
    for k, axis in enumerate(AXES):
        low, high = solution.interval_mm[k]
        active, found = machine.offsets_mm[k], float(solution.offsets_mm[k])
        table.add_row(
            f"  {axis}",
            show(found),
            f"{solution.std_mm[k]:.{digits}f}",
            f"{show(low)} … {show(high)}",
            show(active),
            Text(show(active + found), style="bold"),
        )
    correlation = solution.correlation
    pairs = ", ".join(
        f"{AXES[i]}{AXES[j]} {correlation[i, j]:+.2f}" for i, j in ((0, 1), (1, 2), (2, 0))
    )
    return [
        Text("Joint offsets, mm (true position = indicated + Δρ)", style="bold"),
        table,
        Text(f"  Correlations: {pairs}. Together: σ_ρ = {solution.sigma_rho_mm:.{digits}f} mm."),
        Text("Type the last column into the controller as its joint offsets, home, and measure"),
        Text("again. It is the offset that is active now (machine file) plus Δρ."),
    ]


def _improvement(solution: Solution, machine: Machine) -> list[RenderableType]:
    """Table 4 of the paper: measured, and what should remain after the correction."""
    quality = Text(
        f"  Residual r.m.s. of the {_what(solution)}: {solution.rms_before_mm:.4f} before,"
        f" {solution.rms_after_mm:.4f} after."
    )
    if not solution.table:
        return [quality]
    fine = 1 if solution.kind == "readings" else 0
    digits = max(2, math.ceil(-math.log10(machine.gauge.resolution_mm))) + fine
    table = _table("", *(row.difference for row in solution.table), "r.m.s.")
    for name, values in (
        ("  measured", [row.measured_mm for row in solution.table]),
        ("  expected improvement", [row.expected_mm for row in solution.table]),
    ):
        rms = math.sqrt(sum(value**2 for value in values) / len(values))
        cells = (f"{round(value, digits) + 0.0:+.{digits}f}" for value in values)
        table.add_row(name, *cells, f"{rms:.{digits}f}")
    single = len(solution.table[0].difference) > 3
    what = "tool end − joint end" if single else "max − min"
    return [Text(f"Expected improvement, mm (differences, {what})", style="bold"), table, quality]


def _what(solution: Solution) -> str:
    return "readings" if solution.kind == "readings" else "differences"


def _noise(solution: Solution) -> list[RenderableType]:
    def show(value: float | None) -> str:
        return "unknown" if value is None else f"{value:.4f}"

    table = _table("", "repeats", "residuals", "stated", "floor q/√12", "used")
    table.add_row(
        "  σ",
        show(solution.sigma_repeats_mm),
        show(solution.sigma_residuals_mm),
        show(solution.sigma_stated_mm),
        show(solution.sigma_floor_mm),
        show(solution.sigma_mm),
    )
    spare = f"; {solution.dof} degrees of freedom" if solution.dof else ""
    return [Text(f"Standard deviation of one reading, mm{spare}", style="bold"), table]


def _verdict(solution: Solution, machine_file: Path | None) -> list[RenderableType]:
    if not solution.suspicious:
        return [Text(solution.judgement, style="green" if solution.dof else "yellow")]
    machine = f" --machine {shlex.quote(str(machine_file))}" if machine_file else ""
    path = solution.source.path
    command = f"orthocal diagnose {path if path == '-' else shlex.quote(path)}{machine}"
    return [
        Text(solution.judgement, style="yellow"),
        Text(f"Run next: {command}", style="bold"),
    ]
