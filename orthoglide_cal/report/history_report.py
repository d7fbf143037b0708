"""The history of one machine: drift of its offsets, and when it was last adjusted."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from orthoglide_cal.axes import AXES
from orthoglide_cal.outcome import Drift, History, Identity
from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import (
    Code,
    Document,
    Facts,
    Figure,
    Given,
    Line,
    Notice,
    Section,
    Table,
)
from orthoglide_cal.report.numbers import counted, plain, signed, with_uncertainty
from orthoglide_cal.report.sketch import interval_lines


def date(moment: float) -> str:
    """A moment as a day, UTC."""
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"


def history_report(history: History, identity: Identity) -> Document:
    """The document, for any of the renderers."""
    sections = [_drift(history), _sessions(history)]
    if history.left_out:
        rows: tuple[tuple[Line | None, ...], ...] = tuple(
            (Given(name), Given(reason)) for name, reason in history.left_out
        )
        table = Table(("file", "reason"), rows, words=(0, 1), caption="Files that were not used.")
        sections.append(Section("Left out", (table,)))
    adjusted = date(history.last_adjusted) if history.last_adjusted is not None else "never"
    return Document(
        kind="Calibration history",
        title=history.machine,
        number=identity.number,
        facts=Facts(
            (
                ("Number", Code(identity.number)),
                ("Sessions", str(len(history.entries))),
                (
                    "Last adjusted",
                    f"before the session of {adjusted}"
                    if adjusted != "never"
                    else "never, in these sessions",
                ),
                ("Software", identity.software),
            )
        ),
        notice=_notice(history),
        sheet=tuple(sections),
        sections=(),
    )


def _notice(history: History) -> Notice:
    drift = history.drift
    if drift is None:
        return Notice("info", "One session: nothing to compare yet")
    moved = [axis for axis, yes in zip(AXES, drift.moved, strict=True) if yes]
    days = counted(round(drift.days), "day")
    if not moved:
        return Notice(
            "good",
            f"No drift since {drift.since}",
            (f"Within {days} no offset changed by more than its uncertainty.",),
        )
    return Notice(
        "warn",
        f"Drift since {drift.since}: {', '.join(moved)}",
        tuple(
            f"{axis}: {with_uncertainty(change, expanded)} mm in {days}."
            for axis, change, expanded, yes in _changes(drift)
            if yes
        ),
    )


def _changes(drift: Drift) -> list[tuple[str, float, float, bool]]:
    return list(zip(AXES, drift.change_mm, drift.expanded_mm, drift.moved, strict=True))


def _drift(history: History) -> Section:
    entries = history.entries
    first = entries[0].moment
    total = np.stack([entry.total_mm for entry in entries])
    expanded = np.stack([entry.expanded_mm for entry in entries])
    panels = figures.drift_panels(
        [(entry.moment - first) / 86400.0 for entry in entries],
        [date(entry.moment) for entry in entries],
        total,
        expanded,
        [entry.adjusted for entry in entries],
    )
    finding = (
        f"Offsets of {history.machine} in {counted(len(entries), 'session')} from"
        f" {date(entries[0].moment)} to {date(entries[-1].moment)}."
    )
    sketch: tuple[str, ...] = ()
    for k, axis in enumerate(AXES):
        names = [f"{axis}  {date(entry.moment)}" for entry in entries]
        sketch += interval_lines(names, total[:, k].tolist(), expanded[:, k].tolist())
    return Section(
        "Drift of the offsets",
        (
            Figure(
                "Offset of each axis over time",
                finding,
                panels,
                sketch=sketch,
                key="Offset in the controller plus the offset found. Bars: expanded uncertainty."
                " Dashed: the controller was adjusted.",
            ),
        ),
    )


def _sessions(history: History) -> Section:
    rows: list[tuple[Line | None, ...]] = []
    for entry in history.entries:
        totals = (
            with_uncertainty(value, expanded)
            for value, expanded in zip(
                entry.total_mm.tolist(), entry.expanded_mm.tolist(), strict=True
            )
        )
        rows.append(
            (
                date(entry.moment) + ("" if entry.dated else " (file)"),
                *totals,
                plain(entry.rms_after_mm, 4),
                _adjustment(entry.active_mm.tolist()) if entry.adjusted else "",
            )
        )
    return Section(
        "Sessions",
        (
            Table(
                ("session", "x", "y", "z", "residual", "adjusted to"),
                tuple(rows),
                words=(0, 5),
                caption="In mm: offset in the controller plus the offset found, with U (95 %).",
            ),
        ),
    )


def _adjustment(active: list[float]) -> str:
    return " ".join(signed(value, 3) for value in active)
