"""Tool-position error over the workspace: slices of the cube, before and after, one scale."""

from __future__ import annotations

import math
from itertools import groupby

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.report.figures.canvas import rectangle, svg, tick_text, words
from orthoglide_cal.report.markup import Html, tag
from orthoglide_cal.report.numbers import two_figures

CLASSES = 7
# White letters are read better than black ones from this colour class on.
FIRST_DARK = 5
SIZE, LEFT, TOP = 186.0, 46.0, 34.0
WIDTH, HEIGHT = 240.0, 258.0


def class_limits(largest: float) -> Floats:
    """Upper limits of the colour classes, shape (CLASSES,) [mm]: equal steps up to a round end."""
    power = 10.0 ** math.floor(math.log10(max(largest, 1e-6) / CLASSES))
    steps = [factor * power for factor in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.5, 10.0, 20.0)]
    step = next(step for step in steps if step * CLASSES >= largest * (1.0 - 1e-9))
    return np.arange(1.0, CLASSES + 1.0) * step


def slices(
    axis_mm: Floats,
    levels_mm: Floats,
    before_mm: Floats,
    after_mm: Floats,
) -> tuple[Html, ...]:
    """Six pictures: each level before and after, the same colours for the same error.

    Args:
        axis_mm: grid along x and y, shape (n,).
        levels_mm: heights z, shape (m,).
        before_mm, after_mm: error at [level, y, x], shape (m, n, n).
    """
    limits = class_limits(float(max(before_mm.max(), after_mm.max())))
    return tuple(
        _slice(f"{when}-{k}", when, float(levels_mm[k]), axis_mm, values[k], limits)
        for when, values in (("before", before_mm), ("after", after_mm))
        for k in reversed(range(len(levels_mm)))
    )


def legend(largest: float) -> Html:
    """The colour classes and their limits."""
    limits = class_limits(largest)
    wide = 48.0
    parts = []
    for k, limit in enumerate(limits.tolist()):
        x = k * wide
        parts.append(rectangle(x, 2, wide, 14, f"heat h{k}"))
        parts.append(words(x + wide, 30, two_figures(limit), "end"))
    parts.append(words(0, 30, "0"))
    parts.append(words(wide * CLASSES + 6, 30, "mm"))
    return svg(
        "workspace-legend",
        wide * CLASSES + 30,
        36,
        "Colours of the workspace pictures",
        f"{CLASSES} steps from 0 to {two_figures(float(limits[-1]))} mm; darker is larger.",
        *parts,
    )


def _slice(
    name: str, when: str, level: float, axis: Floats, values: Floats, limits: Floats
) -> Html:
    n = len(axis)
    cell = SIZE / n
    classes = np.minimum(np.searchsorted(limits, values), CLASSES - 1)
    paths: dict[int, list[str]] = {}
    for row in range(n):
        y = TOP + (n - 1 - row) * cell
        for class_, run in groupby(range(n), key=classes[row].__getitem__):
            columns = list(run)
            x, wide = LEFT + columns[0] * cell, len(columns) * cell
            # A little larger than the cells, so that no seams shine through.
            strip = f"M{x:.1f} {y:.1f}h{wide + 0.4:.1f}v{cell + 0.4:.1f}h{-wide - 0.4:.1f}z"
            paths.setdefault(int(class_), []).append(strip)
    parts = [tag("path", d="".join(path), class_=f"heat h{k}") for k, path in paths.items()]
    for row in (0, n // 2, n - 1):
        for column in (0, n // 2, n - 1):
            x, y = LEFT + (column + 0.5) * cell, TOP + (n - 0.5 - row) * cell
            anchor = {0: "start", n - 1: "end"}.get(column, "middle")
            shift = {0: -cell / 2 + 3, n - 1: cell / 2 - 3}.get(column, 0.0)
            dark = classes[row, column] >= FIRST_DARK
            text = two_figures(float(values[row, column]))
            parts.append(words(x + shift, y + 4, text, anchor, "on-dark" if dark else "on-light"))
    low, high = tick_text(float(axis[0]), 1.0), tick_text(float(axis[-1]), 1.0)
    bottom = TOP + SIZE
    parts += [
        words(LEFT, 14, when.capitalize(), class_="strong"),
        words(LEFT + SIZE, 14, f"z = {tick_text(level, 1.0)} mm", "end"),
        words(LEFT, bottom + 14, low),
        words(LEFT + SIZE / 2, bottom + 14, "x, mm", "middle", "muted"),
        words(LEFT + SIZE, bottom + 14, high, "end"),
        words(LEFT - 7, bottom - 4, low, "end"),
        words(LEFT - 7, TOP + SIZE / 2 + 4, "y", "end", "muted"),
        words(LEFT - 7, TOP + 11, high, "end"),
    ]
    finding = (
        f"Tool-position error {when} the adjustment in the slice z = {level:.0f} mm:"
        f" {two_figures(float(values.min()))} to {two_figures(float(values.max()))} mm."
    )
    title = f"Workspace {when}, z = {level:.0f} mm"
    return svg(f"workspace-{name}", WIDTH, HEIGHT - 12, title, finding, *parts)
