"""A solution as the object that `orthocal solve --json` prints."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.axes import AXES
from orthoglide_cal.estimation import Solution

SCHEMA_VERSION = 1


def as_json(solution: Solution) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm, None where nothing is known."""
    std = solution.std_mm
    unsure = solution.suspicious or solution.lack_of_fit_p is None
    return {
        "schema_version": SCHEMA_VERSION,
        "input": {
            "path": solution.source.path,
            "sha256": solution.source.sha256,
            "kind": solution.kind,
            "readings": solution.count,
        },
        "machine": solution.machine,
        "method": solution.method,
        "offsets_mm": dict(zip(AXES, solution.offsets_mm.tolist(), strict=True)),
        "std_mm": dict(zip(AXES, std.tolist(), strict=True)),
        "ci95_mm": dict(zip(AXES, solution.interval_mm.tolist(), strict=True)),
        "correlation": solution.correlation.tolist(),
        "sigma_mm": solution.sigma_mm,
        "sigma_rho_mm": solution.sigma_rho_mm,
        "dof": solution.dof,
        "rms_before_mm": solution.rms_before_mm,
        "rms_after_mm": solution.rms_after_mm,
        "converged": solution.converged,
        "table": [
            {
                "difference": row.difference,
                "measured_mm": row.measured_mm,
                "modelled_mm": row.modelled_mm,
                "expected_mm": row.expected_mm,
            }
            for row in solution.table
        ],
        "warnings": [*solution.warnings, *([solution.judgement] if unsure else [])],
        "sigma_residuals_mm": solution.sigma_residuals_mm,
        "sigma_repeats_mm": solution.sigma_repeats_mm,
        "sigma_floor_mm": solution.sigma_floor_mm,
        "sigma_stated_mm": solution.sigma_stated_mm,
        "lack_of_fit_p": solution.lack_of_fit_p,
        "optimality_mm": solution.optimality,
        "iterations": solution.iterations,
    }
