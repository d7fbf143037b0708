"""The history of a machine as an object for programs; lengths in mm."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from orthoglide_cal.axes import AXES
from orthoglide_cal.outcome import Drift, Entry, History

SCHEMA_VERSION = 1


def as_json(history: History) -> dict[str, Any]:
    """Every session, and the drift."""
    adjusted = history.last_adjusted
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "calibration history",
        "machine": history.machine,
        "folder": history.folder,
        "sessions": [_entry(entry) for entry in history.entries],
        "drifts": [_drift(drift) for drift in history.drifts],
        "last_adjusted_before": None if adjusted is None else _time(adjusted),
        "left_out": [{"file": name, "reason": reason} for name, reason in history.left_out],
    }


def _time(moment: float) -> str:
    return datetime.fromtimestamp(moment, UTC).isoformat(timespec="seconds")


def _entry(entry: Entry) -> dict[str, Any]:
    return {
        "path": entry.path,
        "finished": _time(entry.moment),
        "dated": entry.dated,
        "operator": entry.operator,
        "active_mm": dict(zip(AXES, entry.active_mm.tolist(), strict=True)),
        "found_mm": dict(zip(AXES, entry.found_mm.tolist(), strict=True)),
        "total_mm": dict(zip(AXES, entry.total_mm.tolist(), strict=True)),
        "expanded_mm": dict(zip(AXES, entry.expanded_mm.tolist(), strict=True)),
        "rms_before_mm": entry.rms_before_mm,
        "rms_after_mm": entry.rms_after_mm,
        "adjusted": entry.adjusted,
    }


def _drift(drift: Drift) -> dict[str, Any]:
    return {
        "since": drift.since,
        "days": drift.days,
        "change_mm": dict(zip(AXES, drift.change_mm, strict=True)),
        "expanded_mm": dict(zip(AXES, drift.expanded_mm, strict=True)),
        "moved": dict(zip(AXES, drift.moved, strict=True)),
    }
