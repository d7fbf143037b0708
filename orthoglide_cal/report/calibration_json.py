"""The calibration report as an object for programs; lengths in mm, None where nothing is known."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.axes import AXES
from orthoglide_cal.outcome import Adjustment, Answer, Calibration, Conditions, WorkspaceError
from orthoglide_cal.outcome.summary import Deviations
from orthoglide_cal.report import diagnose_json, solve_json
from orthoglide_cal.report.verification_json import as_json as verification_as_json

SCHEMA_VERSION = 1


def as_json(calibration: Calibration) -> dict[str, Any]:
    """Everything that the page shows as numbers and words."""
    findings, identity = calibration.findings, calibration.identity
    source, verification = calibration.measured.source, calibration.verification
    diagnosis = findings.diagnosis if findings else None
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "calibration report",
        "number": identity.number,
        "issued": identity.issued.isoformat(timespec="seconds"),
        "software": identity.software,
        "input": {
            "path": source.path,
            "sha256": source.sha256,
            "kind": calibration.measured.kind,
            "readings": len(calibration.measured),
        },
        "machine": calibration.machine.name,
        "conditions": _conditions(calibration.conditions),
        "usable": calibration.release.usable,
        "reasons_against": list(calibration.release.reasons),
        "remedies": list(calibration.release.remedies),
        "cautions": list(calibration.release.cautions),
        "as_found": _deviations(findings.found) if findings else None,
        "expected": _deviations(findings.expected) if findings else None,
        "as_left": verification_as_json(verification) if verification else None,
        "answer": _answer(findings.answer) if findings else None,
        "adjustment": _adjustment(findings.adjustment) if findings else None,
        "workspace": _workspace(findings.workspace) if findings and findings.workspace else None,
        "solution": solve_json.as_json(findings.solution) if findings else None,
        "diagnosis": diagnose_json.as_json(diagnosis) if diagnosis else None,
    }


def _conditions(given: Conditions) -> dict[str, Any]:
    return {
        "protocol": given.protocol,
        "operator": given.operator,
        "started": given.started,
        "finished": given.finished,
        "temperature_c": None if given.temperature_c is None else list(given.temperature_c),
        "environment": dict(given.environment),
        "gauges": [
            {
                "id": gauge.label,
                "certificate": gauge.certificate,
                "resolution_mm": gauge.resolution_mm,
            }
            for gauge in given.gauges
        ],
        "retaken": given.retaken,
        "skipped": given.skipped,
    }


def _deviations(found: Deviations | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "rms_mm": found.rms_mm,
        "largest_mm": found.largest_mm,
        "largest_difference": found.largest,
    }


def _answer(answer: Answer) -> dict[str, Any]:
    return {
        "model": list(answer.model),
        "offsets_mm": dict(zip(AXES, answer.offsets_mm.tolist(), strict=True)),
        "std_mm": dict(zip(AXES, answer.std_mm.tolist(), strict=True)),
        "expanded_mm": dict(zip(AXES, answer.expanded_mm.tolist(), strict=True)),
        "coverage_factor": answer.k,
        "confidence": answer.confidence,
        "dof": answer.dof,
    }


def _adjustment(adjustment: Adjustment) -> dict[str, Any]:
    return {
        joint.axis: {
            "previous_mm": joint.previous_mm,
            "change_mm": joint.change_mm,
            "new_mm": joint.new_mm,
        }
        for joint in adjustment.joints
    }


def _workspace(workspace: WorkspaceError) -> dict[str, Any]:
    return {
        "cube_mm": [float(workspace.axis_mm[0]), float(workspace.axis_mm[-1])],
        "before_max_mm": workspace.before_max_mm,
        "before_mean_mm": workspace.before_mean_mm,
        "after_max_mm": workspace.after_max_mm,
        "after_mean_mm": workspace.after_mean_mm,
    }
