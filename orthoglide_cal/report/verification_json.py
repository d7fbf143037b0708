"""A verification as an object for programs; lengths in mm."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.axes import AXES
from orthoglide_cal.verification import RULE, AxisResponse, Coefficient, Verification

SCHEMA_VERSION = 1


def as_json(verification: Verification) -> dict[str, Any]:
    """Everything that `verify` shows."""
    change, decision = verification.change, verification.decision
    acted = verification.acted_as_mm
    return {
        "schema_version": SCHEMA_VERSION,
        "before": {"path": verification.before.path, "sha256": verification.before.sha256},
        "after": {"path": verification.after.path, "sha256": verification.after.sha256},
        "machine": verification.machine,
        "kind": verification.kind,
        "compared": verification.count,
        "applied_mm": _by_axis(verification.applied_mm.tolist()),
        "rms_before_mm": verification.rms_before_mm,
        "rms_promised_mm": verification.rms_promised_mm,
        "rms_after_mm": verification.rms_after_mm,
        "differences": [
            {
                "difference": d.name,
                "before_mm": d.before_mm,
                "promised_mm": d.promised_mm,
                "after_mm": d.after_mm,
                "expanded_mm": d.expanded_mm,
            }
            for d in verification.deviations
        ],
        "response": _coefficient(verification.response),
        "response_dof": verification.dof,
        "axes": {axis.axis: _axis(axis) for axis in verification.axes},
        "answer": verification.answer,
        "acted_as_mm": None if acted is None else _by_axis(acted.tolist()),
        "other_change": {
            "rms_mm": change.rms_mm,
            "noise_mm": change.noise_mm,
            "dof": change.dof,
            "p_value": change.p_value,
            "found": change.found,
        },
        "remaining_mm": _by_axis(verification.remaining_mm.tolist()),
        "remaining_expanded_mm": _by_axis(verification.remaining_expanded_mm.tolist()),
        "decision": None
        if decision is None
        else {
            "outcome": decision.outcome,
            "limit_mm": decision.limit_mm,
            "largest_mm": decision.largest_mm,
            "largest_difference": decision.largest,
            "expanded_mm": decision.expanded_mm,
            "coverage_factor": verification.k,
            "rule": RULE,
        },
    }


def _by_axis(values: list[float]) -> dict[str, float]:
    return dict(zip(AXES, values, strict=True))


def _coefficient(found: Coefficient) -> dict[str, Any]:
    return {
        "value": found.value,
        "std": found.std,
        "ci95": [found.low, found.high],
        "agrees": found.agrees,
    }


def _axis(axis: AxisResponse) -> dict[str, Any]:
    return {
        "applied_mm": axis.applied_mm,
        "found_mm": axis.found_mm,
        "ci95_mm": [axis.low_mm, axis.high_mm],
        "coefficient": None if axis.coefficient is None else _coefficient(axis.coefficient),
    }
