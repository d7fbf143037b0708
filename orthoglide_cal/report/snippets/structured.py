"""Offsets as JSON and YAML, for programs."""

from __future__ import annotations

import json
from typing import Any

from orthoglide_cal.outcome import CheckPosture
from orthoglide_cal.outcome.export import Export
from orthoglide_cal.report.snippets.instructions import after_entering

SCHEMA_VERSION = 1


def as_values(export: Export) -> dict[str, Any]:
    """Plain values; lengths in mm."""
    return {
        "schema_version": SCHEMA_VERSION,
        "number": export.identity.number,
        "issued": export.identity.issued.isoformat(timespec="seconds"),
        "software": export.identity.software,
        "input": {"path": export.source.path, "sha256": export.source.sha256},
        "machine": export.machine.name,
        "status": export.status,
        "forced": bool(export.forced),
        "reasons_against": list(export.forced),
        "cautions": list(export.cautions),
        "joints": {
            joint.axis: {
                "previous_mm": joint.previous_mm,
                "change_mm": joint.change_mm,
                "new_mm": joint.new_mm,
                "expanded_uncertainty_mm": joint.expanded_mm,
            }
            for joint in export.adjustment.joints
        },
        "coverage_factor": export.answer.k,
        "confidence": export.answer.confidence,
        "rehome": True,
        "check": None if export.adjustment.check is None else _check(export.adjustment.check),
        "instructions": after_entering(export),
    }


def _check(check: CheckPosture) -> dict[str, Any]:
    return {
        "difference": check.difference,
        "leg": check.leg,
        "direction": check.direction,
        "first_tool_mm": list(check.first),
        "second_tool_mm": list(check.second),
        "first_joints_mm": list(check.first_joints),
        "second_joints_mm": list(check.second_joints),
        "before_mm": check.before_mm,
        "expected_mm": check.expected_mm,
        "tolerance_mm": check.tolerance_mm,
    }


def as_json(export: Export) -> str:
    """One JSON object on one line."""
    return json.dumps(as_values(export), allow_nan=False, ensure_ascii=True) + "\n"


def as_yaml(export: Export) -> str:
    """A YAML document; a forced one says so in its first line."""
    import yaml

    body: str = yaml.safe_dump(as_values(export), sort_keys=False, allow_unicode=False, width=1000)
    return ("# FORCED: this result must not be used.\n" if export.forced else "") + body
