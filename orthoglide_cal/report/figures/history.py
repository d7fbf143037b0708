"""Total offsets of one machine over time, with their uncertainty and the adjustments."""

from __future__ import annotations

from collections.abc import Sequence

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.report.figures.canvas import Frame, line, mark, polyline, svg, words
from orthoglide_cal.report.markup import Html, join, tag

WIDTH, HEIGHT = 260.0, 196.0


def drift_panels(
    days: Sequence[float],
    dates: Sequence[str],
    total_mm: Floats,
    expanded_mm: Floats,
    adjusted: Sequence[bool],
) -> tuple[Html, ...]:
    """One panel for each axis.

    Args:
        days: of each session since the first, ascending.
        dates: the same as texts.
        total_mm: active plus found offsets, shape (n, 3).
        expanded_mm: expanded uncertainties, shape (n, 3).
        adjusted: True where the controller's offsets had changed before the session.
    """
    return tuple(
        _panel(axis, k, days, dates, total_mm[:, k], expanded_mm[:, k], adjusted)
        for k, axis in enumerate(AXES)
    )


def _panel(
    axis: str,
    number: int,
    days: Sequence[float],
    dates: Sequence[str],
    total: Floats,
    expanded: Floats,
    adjusted: Sequence[bool],
) -> Html:
    low, high = float((total - expanded).min()), float((total + expanded).max())
    room = 0.12 * (high - low) or 0.01
    span = days[-1] - days[0]
    margin = 0.06 * span or 1.0
    frame = Frame.of(
        WIDTH, HEIGHT, (days[0] - margin, days[-1] + margin), (low - room, high + room), left=52.0
    )
    across, up = frame.across, frame.up
    parts = [frame.left_axis("mm"), words(WIDTH - 10, 16, f"axis {axis}", "end", "strong")]
    parts += [
        line(across(day) - 6, up.end, across(day) - 6, up.start, "event")
        for day, changed in zip(days, adjusted, strict=True)
        if changed
    ]
    places = [(across(day), up(float(value))) for day, value in zip(days, total, strict=True)]
    parts.append(polyline(places, "model"))
    for (x, y), half in zip(places, expanded.tolist(), strict=True):
        reach = abs(up(half) - up(0.0))
        parts.append(line(x, y - reach, x, y + reach, "whisker"))
        parts.append(mark(x, y, number))
    parts.append(words(across.start, up.start + 16, dates[0]))
    if len(dates) > 1:
        parts.append(words(across.end, up.start + 16, dates[-1], "end"))
    times = [date for date, changed in zip(dates, adjusted, strict=True) if changed]
    finding = (
        f"Offset of axis {axis}: {total[0]:+.3f} mm on {dates[0]}, {total[-1]:+.3f} mm on"
        f" {dates[-1]}; " + (f"adjusted before {', '.join(times)}." if times else "never adjusted.")
    )
    body = tag("g", join(parts), class_=f"c-{axis}")
    return svg(f"history-{axis}", WIDTH, HEIGHT, f"Offset of axis {axis} over time", finding, body)
