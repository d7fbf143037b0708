"""The history of one machine: drift of its offsets, and when it was last adjusted."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from orthoglide_cal.estimation.accuracy import entered_decimals
from orthoglide_cal.model import AXES
from orthoglide_cal.report import charts
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.canvas import interval_lines
from orthoglide_cal.report.json import SCHEMA_VERSION, axes_of, by_axis, fields_of
from orthoglide_cal.report.words import counted, plain, signed, two_figures, with_uncertainty
from orthoglide_cal.results import Drift, Entry, History, Identity

KIND = "Calibration history"


def history_document(history: History, identity: Identity) -> doc.Document:
    """The document, for any of the renderers."""
    return doc.Document(partial(history_data, history), partial(_page, history, identity))


def _page(history: History, identity: Identity) -> doc.Page:
    adjusted = history.last_adjusted
    sections = [_drift(history), _sessions(history)]
    if history.left_out:
        rows = tuple((doc.Given(name), doc.Given(reason)) for name, reason in history.left_out)
        caption = "Files that were not used."
        grid = doc.Grid(("file", "reason"), rows, words=(0, 1), caption=caption)
        sections.append(doc.Section("Left out", (grid,)))
    return doc.Page(
        kind=KIND,
        title=history.machine,
        number=identity.number,
        facts=doc.Facts(
            (
                ("Number", doc.Code(identity.number)),
                ("Sessions", str(len(history.entries))),
                (
                    "Last adjusted",
                    "never, in these sessions"
                    if adjusted is None
                    else f"before the session of {_day(adjusted)}",
                ),
                ("Software", identity.software),
            )
        ),
        notice=_notice(history),
        sheet=tuple(sections),
    )


def history_data(history: History) -> dict[str, Any]:
    """Every session, and the drift; lengths in mm."""
    adjusted = history.last_adjusted
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND.lower(),
        **fields_of(history, "machine", "folder"),
        "sessions": [_entry_data(entry) for entry in history.entries],
        "drifts": [
            {
                **fields_of(drift, "since", "days"),
                **axes_of(drift, "change_mm", "expanded_mm", "moved"),
            }
            for drift in history.drifts
        ],
        "last_adjusted_before": None if adjusted is None else _time(adjusted),
        "left_out": [{"file": name, "reason": reason} for name, reason in history.left_out],
    }


def _entry_data(entry: Entry) -> dict[str, Any]:
    session, solution = entry.session, entry.solution
    return {
        "path": str(session.path),
        "finished": _time(session.moment),
        "dated": session.dated,
        "operator": entry.operator,
        **axes_of(entry, "active_mm"),
        "found_mm": by_axis(solution.offsets_mm),
        **axes_of(entry, "total_mm"),
        **axes_of(solution, "expanded_mm"),
        **fields_of(solution, "rms_before_mm", "rms_after_mm"),
        "adjusted": entry.adjusted,
    }


def _time(moment: float) -> str:
    return datetime.fromtimestamp(moment, UTC).isoformat(timespec="seconds")


def _day(moment: float) -> str:
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"


def _notice(history: History) -> doc.Notice:
    if not history.drifts:
        return doc.Notice(doc.Tone.INFO, "One session: nothing to compare yet")
    lines = tuple(_sentence(drift) for drift in history.drifts)
    moved = [axis for k, axis in enumerate(AXES) if any(drift.moved[k] for drift in history.drifts)]
    if not moved:
        return doc.Notice(doc.Tone.GOOD, "No drift beyond the uncertainty", lines)
    axes = f"axis {moved[0]}" if len(moved) == 1 else f"axes {', '.join(moved)}"
    return doc.Notice(doc.Tone.WARN, f"The offsets drift: {axes}", lines)


def _sentence(drift: Drift) -> str:
    days = counted(round(drift.days), "day")
    changes = ", ".join(
        f"{axis} {with_uncertainty(change, expanded)}{' (drifts)' if yes else ''}"
        for axis, change, expanded, yes in zip(
            AXES, drift.change_mm, drift.expanded_mm, drift.moved, strict=True
        )
    )
    return f"Since {drift.since} ({days}), mm: {changes}."


def _drift(history: History) -> doc.Section:
    entries = history.entries
    moments = [entry.session.moment for entry in entries]
    days = [_day(moment) for moment in moments]
    total = np.stack([entry.total_mm for entry in entries])
    expanded = np.stack([entry.solution.expanded_mm for entry in entries])
    sketch: tuple[str, ...] = ()
    for k, axis in enumerate(AXES):
        names = [f"{axis}  {day}" for day in days]
        values, halves = total[:, k].tolist(), expanded[:, k].tolist()
        sketch += interval_lines(names, values, halves, zero=False)
    figure = doc.Figure(
        "Offset of each axis over time",
        f"Offsets of {history.machine} in {counted(len(entries), 'session')} from {days[0]} to"
        f" {days[-1]}.",
        charts.drift_panels(
            [(moment - moments[0]) / 86400.0 for moment in moments],
            days,
            total,
            expanded,
            [entry.adjusted for entry in entries],
        ),
        sketch=sketch,
        key="Offset in the controller plus the offset found. Bars: expanded uncertainty. Dashed:"
        " the controller was adjusted.",
    )
    return doc.Section("Drift of the offsets", (figure,))


def _sessions(history: History) -> doc.Section:
    rows: list[tuple[doc.Blank, ...]] = []
    for entry in history.entries:
        session, expanded = entry.session, entry.solution.expanded_mm.tolist()
        active, total = entry.active_mm.tolist(), entry.total_mm.tolist()
        digits = entered_decimals(expanded, active)
        changed = " ".join(signed(value, digits) for value in active) if entry.adjusted else ""
        rows.append(
            (
                _day(session.moment) + ("" if session.dated else " (file)"),
                *(signed(value, digits) for value in total),
                two_figures(max(expanded)),
                plain(entry.solution.rms_after_mm, 4),
                changed,
            )
        )
    grid = doc.Grid(
        ("session", *AXES, "U", "residual", "adjusted to"),
        tuple(rows),
        caption="In mm: offset in the controller plus the offset found; the largest expanded"
        " uncertainty (95 %); residual r.m.s.",
    )
    return doc.Section("Sessions", (grid,))
