"""Offsets with their intervals, and what is active in the controller."""

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
from orthoglide_cal.report.markup import Html, join, tag

WIDTH, ROW = 360.0, 20.0


@dataclass(frozen=True)
class Bar:
    """Three offsets with half the lengths of their intervals [mm], and what they are."""

    label: str
    value_mm: Sequence[float]
    half_mm: Sequence[float]


def intervals(bars: Sequence[Bar]) -> Html:
    """One row per axis and bar; marks differ from bar to bar.

    Args:
        bars: at least one, each with three values.
    """
    ends = [
        v + s * h
        for bar in bars
        for v, h in zip(bar.value_mm, bar.half_mm, strict=True)
        for s in (-1, 1)
    ]
    low, high = around(ends, 0.01)
    across = Scale(low, high, 40.0, WIDTH - 16.0)
    top = 16.0
    group = ROW * len(bars) + 10.0
    bottom = top + 3 * group
    values = ticks(low, high, 5)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    parts = [
        join(
            (
                line(
                    across(v), top - 8, across(v), bottom, "zero" if abs(v) < step / 1e6 else "grid"
                ),
                words(across(v), bottom + 14, tick_text(v, step), "middle"),
            )
        )
        for v in values
    ]
    parts.append(words((40.0 + WIDTH - 16.0) / 2, bottom + 28, "offset, mm", "middle", "muted"))
    sentences = []
    for k, axis in enumerate(AXES):
        base = top + k * group
        row = [words(8, base + (group - 10.0) / 2 + 5, axis, class_="axis")]
        for n, bar in enumerate(bars):
            y = base + ROW * (n + 0.5)
            value, half = bar.value_mm[k], bar.half_mm[k]
            left, right = across(value - half), across(value + half)
            row += [
                line(left, y, right, y, "whisker"),
                line(left, y - 5, left, y + 5, "whisker"),
                line(right, y - 5, right, y + 5, "whisker"),
                mark(across(value), y, 2 * n, "mark" if n == 0 else "mark open", 4.4),
            ]
            sentences.append(f"{axis}, {bar.label}: {value:+.3f} ± {half:.3f} mm")
        parts.append(tag("g", join(row), class_=f"c-{axis}"))
    return svg(
        "intervals",
        WIDTH,
        bottom + 34.0,
        "Offsets with their intervals",
        "; ".join(sentences) + ".",
        *parts,
    )
