"""The history of one machine: drift of its offsets, and when it was last adjusted."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from orthoglide_cal.estimation.accuracy import entered_decimals
from orthoglide_cal.model import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.canvas import interval_lines
from orthoglide_cal.report.drift import DriftLine, drift_panels
from orthoglide_cal.report.json import SCHEMA_VERSION, axes_of, by_axis, fields_of
from orthoglide_cal.report.words import (
    SCOPE,
    counted,
    owner_facts,
    plain,
    signed,
    two_figures,
    with_uncertainty,
)
from orthoglide_cal.results import Entry, History, Identity, Trend
from orthoglide_cal.results.trend import DAY, FARTHEST_DAYS

KIND = "Calibration history"
# How far the trend is drawn beyond the last session, as a part of the time between first and last.
AHEAD = 0.25


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
                *owner_facts(history.entries[-1].solution.model.machine),
                ("Number", doc.Code(identity.number)),
                ("Sessions", str(len(history.entries))),
                (
                    "Last adjusted",
                    "never, in these sessions"
                    if adjusted is None
                    else f"before the session of {_day(adjusted)}",
                ),
                *_due(history),
                ("Software", identity.software),
            )
        ),
        notice=_notice(history),
        sheet=tuple(sections),
        scope=SCOPE,
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
        "trend": _trend_data(history.trend),
        "limit_mm": history.limit_mm,
        "due": None if history.due is None else _time(history.due),
        "last_adjusted_before": None if adjusted is None else _time(adjusted),
        "left_out": [{"file": name, "reason": reason} for name, reason in history.left_out],
    }


def _trend_data(found: Trend | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "mm_per_month": by_axis(found.rate_mm),
        "expanded_mm_per_month": by_axis(found.expanded_mm),
        **axes_of(found, "drifts"),
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


def _due(history: History) -> tuple[tuple[str, str], ...]:
    """When the machine is to be measured again, where a limit says what is too much."""
    if history.limit_mm is None or history.trend is None:
        return ()
    limit = f"of {history.limit_mm:g} mm in a difference"
    if history.due is None:
        return (("Due", f"not within {FARTHEST_DAYS // 365} years, for a limit {limit}"),)
    return (("Due", f"by {_day(history.due)}: from then on the limit {limit} may be exceeded"),)


def _notice(history: History) -> doc.Notice:
    if not history.drifts:
        return doc.Notice(doc.Tone.INFO, "One session: nothing to compare yet")
    found = [drift.moved for drift in history.drifts]
    if history.trend is not None:
        found.append(history.trend.drifts)
    moved = [axis for axis, seen in zip(AXES, zip(*found, strict=True), strict=True) if any(seen)]
    if not moved:
        return doc.Notice(doc.Tone.GOOD, "No drift beyond the uncertainty")
    axes = f"axis {moved[0]}" if len(moved) == 1 else f"axes {', '.join(moved)}"
    return doc.Notice(doc.Tone.WARN, f"The offsets drift: {axes}")


def _changes(history: History) -> doc.Grid:
    """How far each offset went, and how fast; bold where that is more than its uncertainty."""
    rows = []
    for drift in history.drifts:
        name = f"since {drift.since} ({counted(round(drift.days), 'day')})"
        rows.append((name, drift.moved, drift.change_mm, drift.expanded_mm))
    found = history.trend
    if found is not None:
        rates = tuple(found.rate_mm.tolist()), tuple(found.expanded_mm.tolist())
        rows.append(("in a month", found.drifts, *rates))
    return doc.Grid(
        ("", *AXES),
        tuple(
            (name, *map(_change, moved, changes, expanded))
            for name, moved, changes, expanded in rows
        ),
        caption="Change of the offsets, mm; bold: more than its expanded uncertainty (95 %), which"
        " counts what is new in each session: the readings and the places of the gauges.",
    )


def _change(moved: bool, change: float, expanded: float) -> doc.Inline:
    text = with_uncertainty(change, expanded)
    return doc.Strong(text) if moved else text


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
        drift_panels(
            [(moment - moments[0]) / DAY for moment in moments],
            days,
            total,
            expanded,
            [entry.adjusted for entry in entries],
            _line(history, moments),
        ),
        sketch=sketch,
        key="Offset in the controller plus the offset found. Bars: expanded uncertainty. Dashed:"
        " the controller was adjusted."
        + (" Line and band: the trend, and how far it may be off." if history.trend else ""),
    )
    changes = (_changes(history),) if history.drifts else ()
    return doc.Section("Drift of the offsets", (*changes, figure))


def _line(history: History, moments: Sequence[float]) -> DriftLine | None:
    """The trend, drawn a little beyond the last session or until the machine is due."""
    found, due = history.trend, history.due
    if found is None:
        return None
    ahead = moments[-1] + AHEAD * (moments[-1] - moments[0])
    last = ahead if due is None else min(max(due, ahead), 2.0 * ahead - moments[0])
    times = np.linspace(moments[0], last, 25)
    value, covariance = found.at(times)
    expanded = found.k * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    reached = None if due is None or due > last else (due - moments[0]) / DAY
    return DriftLine((times - moments[0]) / DAY, value, expanded, reached)


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
