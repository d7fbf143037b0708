"""Pictures of how the offsets of a machine change with time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from orthoglide_cal.model import AXES, Floats, ReadOnly
from orthoglide_cal.report.canvas import Axes, line, mark, polygon, polyline, svg, words
from orthoglide_cal.report.escape import Html, tag
from orthoglide_cal.report.words import signed

WIDTH, HEIGHT = 260.0, 196.0


@dataclass(frozen=True, eq=False)
class DriftLine(ReadOnly):
    """A straight line through the offsets over time.

    Attributes:
        days: since the first session, ascending, shape (m,).
        value_mm: of each axis, shape (m, 3).
        expanded_mm: how far the line may be off, shape (m, 3).
        due_day: when the machine is due; None if that is not known, or beyond the line's end.
    """

    days: Floats
    value_mm: Floats
    expanded_mm: Floats
    due_day: float | None


def drift_panels(
    days: Sequence[float],
    dates: Sequence[str],
    total_mm: Floats,
    expanded_mm: Floats,
    adjusted: Sequence[bool],
    trend: DriftLine | None = None,
) -> tuple[Html, ...]:
    """One panel for each axis: its total offset over time, with the adjustments.

    Args:
        days: of each session since the first, ascending.
        dates: the same as texts.
        total_mm: active plus found offsets, shape (n, 3).
        expanded_mm: expanded uncertainties, shape (n, 3).
        adjusted: True where the controller's offsets had changed before the session.
        trend: the line through them; None if there is none.
    """
    last = days[-1] if trend is None else float(trend.days[-1])
    margin = 0.06 * (last - days[0]) or 1.0
    span = days[0] - margin, last + margin
    times = [date for date, changed in zip(dates, adjusted, strict=True) if changed]
    panels = []
    for number, axis in enumerate(AXES):
        total, expanded = total_mm[:, number], expanded_mm[:, number]
        ends = [*(total - expanded).tolist(), *(total + expanded).tolist()]
        if trend is not None:
            middle, reach = trend.value_mm[:, number], trend.expanded_mm[:, number]
            ends += [*(middle - reach).tolist(), *(middle + reach).tolist()]
        room = 0.12 * (max(ends) - min(ends)) or 0.01
        axes = Axes.of(WIDTH, HEIGHT, span, (min(ends) - room, max(ends) + room), left=52.0)
        across, up = axes.across, axes.up
        parts = [] if trend is None else _trend(axes, trend, number)
        parts += [axes.left_axis("mm"), words(WIDTH - 10, 16, f"axis {axis}", "end", "strong")]
        parts += [
            line(across(day) - 6, up.end, across(day) - 6, up.start, "event")
            for day, changed in zip(days, adjusted, strict=True)
            if changed
        ]
        for day, value, half in zip(days, total.tolist(), expanded.tolist(), strict=True):
            x = across(day)
            parts.append(line(x, up(value - half), x, up(value + half), "whisker"))
            parts.append(mark(x, up(value), number))
        parts.append(words(across(days[0]), up.start + 16, dates[0]))
        if len(dates) > 1:
            parts.append(words(across(days[-1]), up.start + 16, dates[-1], "end"))
        finding = (
            f"Offset of axis {axis}: {signed(float(total[0]), 3)} mm on {dates[0]},"
            f" {signed(float(total[-1]), 3)} mm on {dates[-1]}; "
            + (f"adjusted before {', '.join(times)}." if times else "never adjusted.")
        )
        title, body = f"Offset of axis {axis} over time", tag("g", *parts, class_=f"c-{axis}")
        panels.append(svg(f"history-{axis}", WIDTH, HEIGHT, title, finding, body))
    return tuple(panels)


def _trend(axes: Axes, trend: DriftLine, number: int) -> list[Html]:
    """The line of one axis in its band, and the day on which the machine is due."""
    across = [axes.across(day) for day in trend.days.tolist()]
    middle, reach = trend.value_mm[:, number], trend.expanded_mm[:, number]
    lowest, line_, highest = (
        [(x, axes.up(value)) for x, value in zip(across, values.tolist(), strict=True)]
        for values in (middle - reach, middle, middle + reach)
    )
    parts = [polygon([*lowest, *reversed(highest)], "trend"), polyline(line_, "model")]
    if trend.due_day is not None:
        x, top = axes.across(trend.due_day), axes.up.end
        parts += [line(x, top, x, axes.up.start, "due"), words(x - 4, top + 10, "due", "end")]
    return parts
