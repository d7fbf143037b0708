"""Offsets with their intervals: where they lie, and a closer look around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from orthoglide_cal.axes import AXES
from orthoglide_cal.report.figures.canvas import (
    Scale,
    around,
    line,
    mark,
    svg,
    tick_text,
    ticks,
    words,
)
from orthoglide_cal.report.markup import Html, tag

WIDTH, ROW, LEFT = 280.0, 16.0, 34.0


@dataclass(frozen=True)
class Bar:
    """Three offsets with half the lengths of their intervals [mm], and what they are."""

    label: str
    value_mm: Sequence[float]
    half_mm: Sequence[float]


def intervals(bars: Sequence[Bar]) -> tuple[Html, ...]:
    """Two pictures: all offsets on one scale, and their distance from the first bar's.

    Args:
        bars: at least one, each with three values; their marks differ.
    """
    first = bars[0]
    nearer = [
        Bar(
            bar.label,
            [1000.0 * (v - at) for v, at in zip(bar.value_mm, first.value_mm, strict=True)],
            [1000.0 * half for half in bar.half_mm],
        )
        for bar in bars
    ]
    said = "; ".join(
        f"{axis}, {bar.label}: {bar.value_mm[k]:+.3f} ± {bar.half_mm[k]:.3f} mm"
        for k, axis in enumerate(AXES)
        for bar in bars
    )
    closer = "; ".join(
        f"{axis}: ±{first.half_mm[k] * 1000.0:.0f} µm" for k, axis in enumerate(AXES)
    )
    return (
        _panel("intervals", bars, "offset, mm", "Offsets", said + "."),
        _panel(
            "intervals-near",
            nearer,
            f"distance from the offset {first.label}, µm"
            if len(bars) > 1
            else "closer: distance from the offset, µm",
            "Intervals, closer",
            closer + ".",
        ),
    )


def _panel(name: str, bars: Sequence[Bar], axis_title: str, title: str, finding: str) -> Html:
    ends = [
        value + side * half
        for bar in bars
        for value, half in zip(bar.value_mm, bar.half_mm, strict=True)
        for side in (-1.0, 1.0)
    ]
    across = Scale(*around(ends, 0.01), LEFT, WIDTH - 10.0)
    top = 12.0
    group = ROW * len(bars) + 12.0
    bottom = top + 3 * group
    values = ticks(across.low, across.high, 4)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    parts: list[Html] = []
    for value in values:
        x = across(value)
        parts.append(line(x, top - 6, x, bottom, "zero" if abs(value) < step / 1e6 else "grid"))
        parts.append(words(x, bottom + 14, tick_text(value, step), "middle"))
    parts.append(words((LEFT + WIDTH) / 2, bottom + 29, axis_title, "middle", "muted"))
    for k, axis in enumerate(AXES):
        base = top + k * group
        row = [words(8, base + group / 2 - 1, axis, class_="axis")]
        for n, bar in enumerate(bars):
            y = base + ROW * (n + 0.5)
            row += _whisker(
                across(bar.value_mm[k] - bar.half_mm[k]),
                across(bar.value_mm[k] + bar.half_mm[k]),
                y,
            )
            shape = "mark" if n == 0 else "mark open"
            row.append(mark(across(bar.value_mm[k]), y, 2 * n, shape, 4.4))
        parts.append(tag("g", *row, class_=f"c-{axis}"))
    return svg(name, WIDTH, bottom + 34.0, title, finding, *parts)


def _whisker(left: float, right: float, y: float) -> list[Html]:
    return [
        line(left, y, right, y, "whisker"),
        line(left, y - 5, left, y + 5, "whisker"),
        line(right, y - 5, right, y + 5, "whisker"),
    ]
