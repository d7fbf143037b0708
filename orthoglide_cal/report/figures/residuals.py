"""Residuals by leg, direction, posture and cycle; the gauge's noise as a band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.report.figures.canvas import (
    AXIS_CLASSES,
    Frame,
    mark,
    polyline,
    rectangle,
    svg,
    words,
)
from orthoglide_cal.report.markup import Html, join, tag

WIDTH, HEIGHT = 240.0, 176.0


def residual_panels(
    series: Sequence[str],
    label: Sequence[str],
    end: Sequence[str],
    displacement: Floats,
    cycle: Ints,
    residual_mm: Floats,
    noise_mm: float,
) -> tuple[Html, ...]:
    """One panel for each leg and direction, all on one scale.

    Args:
        series: "y_x" and the like, one per reading.
        label: name of the posture.
        end: of the leg that was touched, "" for the double-posture protocol.
        displacement: of the leg's carriage, shape (n,) [mm]; orders the postures.
        cycle: shape (n,); its mark tells the cycle.
        residual_mm: measured − predicted, shape (n,).
        noise_mm: standard deviation of one reading; the band is twice as high.
    """
    microns = 1000.0 * residual_mm
    band = 2000.0 * noise_mm
    largest = max(float(np.abs(microns).max()), band) * 1.08
    names = sorted(set(series), key=lambda name: (name[2], name[0]))
    return tuple(
        _panel(
            name,
            [k for k in range(len(series)) if series[k] == name],
            [" ".join((a, b)).strip() for a, b in zip(label, end, strict=True)],
            displacement,
            cycle,
            microns,
            band,
            largest,
        )
        for name in names
    )


def _panel(
    name: str,
    chosen: list[int],
    label: Sequence[str],
    displacement: Floats,
    cycle: Ints,
    microns: Floats,
    band: float,
    largest: float,
) -> Html:
    postures = list(
        dict.fromkeys(label[k] for k in sorted(chosen, key=lambda k: (displacement[k], label[k])))
    )
    frame = Frame.of(WIDTH, HEIGHT, (-0.5, len(postures) - 0.5), (-largest, largest), bottom=32.0)
    parts = [
        rectangle(
            frame.across.start,
            frame.up(band),
            frame.across.end - frame.across.start,
            frame.up(-band) - frame.up(band),
            "band",
        ),
        frame.left_axis("µm"),
        *(
            words(frame.across(float(k)), frame.up.start + 12.0 * (n + 1) + 1.0, word, "middle")
            for k, text in enumerate(postures)
            for n, word in enumerate(text.split())
        ),
        words(WIDTH - 10, 16, f"leg {name[2]}, direction {name[0]}", "end", "strong"),
    ]
    for turn in sorted({int(cycle[k]) for k in chosen}):
        mine = [k for k in chosen if cycle[k] == turn]
        places = {k: postures.index(label[k]) + 0.09 * (turn - 2.5) for k in mine}
        points = [(frame.across(places[k]), frame.up(float(microns[k]))) for k in mine]
        points.sort()
        parts.append(polyline(points, "thread"))
        parts += [mark(x, y, turn - 1) for x, y in points]
    worst = max(chosen, key=lambda k: abs(microns[k]))
    finding = (
        f"Residuals of leg {name[2]} in direction {name[0]}: the largest is"
        f" {microns[worst]:+.0f} µm at posture {label[worst]}, cycle {int(cycle[worst])};"
        f" the gauge's noise explains up to about {band:.0f} µm."
    )
    colour = AXIS_CLASSES["xyz".index(name[2])]
    return svg(
        f"residual-{name.replace('_', '')}",
        WIDTH,
        HEIGHT,
        f"Residuals, leg {name[2]}, direction {name[0]}",
        finding,
        tag("g", join(parts), class_=f"c-{colour}"),
    )
