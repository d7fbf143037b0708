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
from orthoglide_cal.report.numbers import counted, plain, signed, two_figures, with_uncertainty
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
    if not history.drifts:
        return Notice("info", "One session: nothing to compare yet")
    lines = tuple(_sentence(drift) for drift in history.drifts)
    moved = [axis for k, axis in enumerate(AXES) if any(drift.moved[k] for drift in history.drifts)]
    if not moved:
        return Notice("good", "No drift beyond the uncertainty", lines)
    axes = f"axis {moved[0]}" if len(moved) == 1 else f"axes {', '.join(moved)}"
    return Notice("warn", f"The offsets drift: {axes}", lines)


def _sentence(drift: Drift) -> str:
    days = counted(round(drift.days), "day")
    changes = ", ".join(
        f"{axis} {with_uncertainty(change, expanded)}{' (drifts)' if yes else ''}"
        for axis, change, expanded, yes in zip(
            AXES, drift.change_mm, drift.expanded_mm, drift.moved, strict=True
        )
    )
    return f"Since {drift.since} ({days}), mm: {changes}."


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
        values, halves = total[:, k].tolist(), expanded[:, k].tolist()
        sketch += interval_lines(names, values, halves, zero=False)
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
    rows: list[tuple[Line | None, ...]] = [
        (
            date(entry.moment) + ("" if entry.dated else " (file)"),
            *(signed(value, 3) for value in entry.total_mm.tolist()),
            two_figures(float(entry.expanded_mm.max())),
            plain(entry.rms_after_mm, 4),
            " ".join(signed(value, 3) for value in entry.active_mm.tolist())
            if entry.adjusted
            else "",
        )
        for entry in history.entries
    ]
    return Section(
        "Sessions",
        (
            Table(
                ("session", "x", "y", "z", "U", "residual", "adjusted to"),
                tuple(rows),
                words=(0,),
                caption="In mm: offset in the controller plus the offset found; the largest"
                " expanded uncertainty (95 %); residual r.m.s.",
            ),
        ),
    )
