"""Measured against predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.report.figures.canvas import (
    AXIS_CLASSES,
    Frame,
    Scale,
    around,
    line,
    mark,
    polyline,
    svg,
    tick_text,
    ticks,
    words,
)
from orthoglide_cal.report.markup import Html, join, tag

WIDTH, HEIGHT = 240.0, 188.0
ROW = 26.0


def reading_panels(
    series: Sequence[str],
    end: Sequence[str],
    displacement: Floats,
    cycle: Ints,
    measured_mm: Floats,
    predicted_mm: Floats,
) -> tuple[Html, ...]:
    """One panel for each leg and direction: the gauge over the leg's travel, and the model.

    Args:
        series: "y_x" and the like, one per reading.
        end: of the leg that was touched, "" for the double-posture protocol; one line each.
        displacement: of the leg's carriage, shape (n,) [mm].
        cycle: shape (n,).
        measured_mm, predicted_mm: relative to the isotropic posture, shape (n,).
    """
    names = sorted(set(series), key=lambda name: (name[2], name[0]))
    up = around([*measured_mm.tolist(), *predicted_mm.tolist()], 0.02)
    low, high = float(displacement.min()), float(displacement.max())
    room = 0.07 * (high - low) or 1.0
    panels = []
    for name in names:
        chosen = [k for k in range(len(series)) if series[k] == name]
        frame = Frame.of(WIDTH, HEIGHT, (low - room, high + room), up)
        places = sorted({float(displacement[k]) for k in chosen})
        parts = [
            frame.left_axis("mm"),
            frame.bottom_axis([(v, tick_text(v, 1.0)) for v in places], "travel of the leg, mm"),
            words(WIDTH - 10, 16, f"leg {name[2]}, direction {name[0]}", "end", "strong"),
        ]
        for strand in sorted({end[k] for k in chosen}):
            mine = [k for k in chosen if end[k] == strand]
            model = sorted((float(displacement[k]), float(predicted_mm[k])) for k in mine)
            line_points = [(frame.across(a), frame.up(b)) for a, b in model]
            parts.append(polyline(line_points, "model"))
            if strand:
                parts.append(words(line_points[0][0], line_points[0][1] - 8, strand))
        parts += [
            mark(
                frame.across(float(displacement[k])),
                frame.up(float(measured_mm[k])),
                int(cycle[k]) - 1,
                "mark open",
            )
            for k in chosen
        ]
        worst = float(np.abs(measured_mm - predicted_mm)[chosen].max())
        panels.append(
            svg(
                f"measured-{name.replace('_', '')}",
                WIDTH,
                HEIGHT,
                f"Measured and predicted, leg {name[2]}, direction {name[0]}",
                f"Readings of leg {name[2]} in direction {name[0]} over its travel, and the"
                f" prediction: they differ by at most {1000 * worst:.0f} µm.",
                tag("g", join(parts), class_=f"c-{AXIS_CLASSES['xyz'.index(name[2])]}"),
            )
        )
    return tuple(panels)


def difference_rows(
    names: Sequence[str],
    measured_mm: Floats,
    predicted_mm: Floats,
    model: str = "predicted",
) -> tuple[Html, ...]:
    """A line for each difference: measured (circle), predicted (square), and what is left.

    Args:
        model: what the prediction is called.
    """
    width, top = 360.0, 22.0
    height = top + ROW * len(names) + 34.0
    low, high = around([*measured_mm.tolist(), *predicted_mm.tolist()], 0.02)
    across = Scale(low, high, 56.0, width - 58.0)
    bottom = top + ROW * len(names)
    values = ticks(low, high, 6)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    parts = [
        join(
            (
                line(
                    across(v), top - 6, across(v), bottom, "zero" if abs(v) < step / 1e6 else "grid"
                ),
                words(across(v), bottom + 14, tick_text(v, step), "middle"),
            )
        )
        for v in values
    ]
    parts.append(words(width / 2, bottom + 28, "mm", "middle", "muted"))
    parts.append(words(width - 4, top - 8, "left, mm", "end", "muted"))
    for k, name in enumerate(names):
        y = top + ROW * (k + 0.5)
        first, second = across(float(measured_mm[k])), across(float(predicted_mm[k]))
        left = float(measured_mm[k] - predicted_mm[k])
        row = (
            words(6, y + 4, f"d{name}", class_="strong"),
            line(first, y, second, y, "gap"),
            mark(second, y, 2, "mark", 5.0),
            mark(first, y, 0, "mark open", 5.5),
            words(width - 4, y + 4, f"{left:+.3f}", "end"),
        )
        parts.append(tag("g", join(row), class_=f"c-{name[2]}"))
    worst = int(np.argmax(np.abs(measured_mm - predicted_mm)))
    finding = (
        f"Of {len(names)} differences d{names[worst]} is missed most: measured"
        f" {measured_mm[worst]:+.3f} mm, {model} {predicted_mm[worst]:+.3f} mm."
    )
    title = f"Measured and {model} differences"
    return (svg(f"measured-{model}", width, height, title, finding, *parts),)
