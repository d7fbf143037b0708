"""Entries of a session's `readings` as rows, so that they pass the same checks as a CSV's."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from orthoglide_cal.data.faults import Faults
from orthoglide_cal.data.numbers import number_text
from orthoglide_cal.data.session_schema import SessionRecord
from orthoglide_cal.data.table import Row
from orthoglide_cal.data.yaml_tree import Tree


def rows_from_tree(tree: Tree) -> list[Row]:
    """Rows of a parsed session; entries that are no groups of values are faults."""
    rows = []
    entries = tree.value.get("readings")
    if entries is not None and not isinstance(entries, list):
        tree.faults.add(
            "A list is wanted here.", "Write `- {leg: x, …}` lines.",
            line=tree.line(("readings",)), column="readings",
        )  # fmt: skip
        return []
    for index, entry in enumerate(entries or ()):
        path = ("readings", index)
        line, prefix = tree.line(path), f"readings[{index}]."
        if not isinstance(entry, dict):
            tree.faults.add(
                "A group of keys is wanted here.", "Write `- {leg: x, …}`.",
                line=line, column=prefix[:-1], value=entry if isinstance(entry, str) else None,
            )  # fmt: skip
            continue
        cells = {key: value.strip() for key, value in entry.items() if isinstance(value, str)}
        cells = {key: value for key, value in cells.items() if value}
        row = Row(line, cells, {key: tree.line((*path, key)) for key in entry}, prefix)
        nested = [key for key, value in entry.items() if isinstance(value, dict | list)]
        for key in nested:
            row.fault(tree.faults, key, "One value is wanted here.", "Write `name: value`.")
        if not nested:
            rows.append(row)
    started = tree.value.get("started")
    return timed_by_timestamps(rows, started if isinstance(started, str) else None, tree.faults)


def rows_from_record(record: SessionRecord, faults: Faults) -> list[Row]:
    """Rows of a session in memory; the line is the number of the reading."""
    rows = []
    for index, reading in enumerate(record.readings):
        values: dict[str, Any] = reading.model_dump(exclude_none=True)
        cells = {
            key: number_text(value) if isinstance(value, float) else str(value)
            for key, value in values.items()
            if value != ""
        }
        rows.append(Row(index + 1, cells, prefix=f"readings[{index}]."))
    return timed_by_timestamps(rows, record.started, faults)


def timed_by_timestamps(rows: Sequence[Row], started: str | None, faults: Faults) -> list[Row]:
    """Where no reading has `minutes` but all have a `timestamp`, count the minutes from those."""
    moments = [_moment(row, faults) for row in rows]
    known = [moment for moment in moments if moment is not None]
    if not rows or len(known) < len(rows) or any("minutes" in row.cells for row in rows):
        return list(rows)
    try:
        first = datetime.fromisoformat(started) if started else min(known)
        minutes = [(moment - first).total_seconds() / 60.0 for moment in known]
    except (TypeError, ValueError):  # some with, some without a time zone; started: see schema
        rows[0].fault(
            faults, "timestamp", "Some times have a time zone and others have none.",
            "Write all of them, and `started`, in the same way.",
        )  # fmt: skip
        return list(rows)
    return [
        Row(row.line, {**row.cells, "minutes": number_text(value)}, row.lines, row.prefix)
        for row, value in zip(rows, minutes, strict=True)
    ]


def _moment(row: Row, faults: Faults) -> datetime | None:
    text = row.cells.get("timestamp")
    if text is None:
        return None
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        row.fault(faults, "timestamp", "This is not a time.", "Write it as 2025-01-31T14:05:00.")
        return None
