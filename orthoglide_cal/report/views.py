"""Views of the machine: its legs and where the gauges stood; the error over its workspace."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import groupby

import numpy as np

from orthoglide_cal.model import AXES, Floats, Series
from orthoglide_cal.report.canvas import line, rectangle, svg, tick_text, words
from orthoglide_cal.report.escape import Html, tag
from orthoglide_cal.report.words import two_figures

WIDTH, HEIGHT = 360.0, 296.0
CENTRE = np.array([180.0, 186.0])
LEG = 128.0  # length of a leg in the picture
# Where the axes x, y, z point on the paper.
ON_PAPER = np.array([[-0.84, 0.50], [0.84, 0.50], [0.0, -1.0]])
# The slices of the workspace: colour classes, and places in the picture.
CLASSES = 7
# White letters are read better than black ones from this colour class on.
FIRST_DARK = 5
SIZE, LEFT, TOP = 186.0, 46.0, 34.0
CUBE_WIDTH, CUBE_HEIGHT = 240.0, 246.0


def machine(
    leg_length_mm: float,
    joint_limits_mm: tuple[float, float],
    gauges: Sequence[tuple[int, int, float]],
    faults: Collection[tuple[int, int]] = (),
    rails: Collection[int] = (),
) -> Html:
    """Isometric sketch at the isotropic posture.

    Args:
        leg_length_mm: L.
        joint_limits_mm: travel of the carriages from the isotropic posture.
        gauges: (leg, direction, place along the leg from carriage 0 to tool 1).
        faults: (leg, direction) whose readings a fault spoils: a ring around their gauges.
        rails: those in which a fault is: a line beside them.
    """
    scale = LEG / leg_length_mm
    parts: list[Html] = []
    for leg, axis in enumerate(AXES):
        low, high = ((leg_length_mm + limit) * scale / LEG for limit in joint_limits_mm)
        # Even displacements of the carriage leave the picture readable only up to here.
        end = min(high, 1.0 + 34.0 / LEG)
        across = np.array([-ON_PAPER[leg, 1], ON_PAPER[leg, 0]])
        side = 4.0 * across / np.linalg.norm(across)
        joint, tool = _at(leg, 1.0), _at(leg, 0.0)
        x, y = (joint - 7.0).tolist()
        at, below = _at(leg, end + 0.10).tolist()
        drawn = (
            _line(_at(leg, low), _at(leg, end), "rail"),
            _line(joint + side, tool + side, "bar"),
            _line(joint - side, tool - side, "bar"),
            tag("rect", x=x, y=y, width=14, height=14, rx=2, class_="carriage"),
            words(at, below + 4.0, axis, "middle", "axis"),
            *(
                [_line(_at(leg, low) + 2.5 * side, _at(leg, end) + 2.5 * side, "fault")]
                if leg in rails
                else ()
            ),
        )
        parts.append(tag("g", *drawn, class_=f"c-{axis}"))
    x, y = CENTRE.tolist()
    parts.append(tag("circle", cx=x, cy=y, r=8.0, class_="tool"))
    parts += [_gauge(*gauge, (gauge[0], gauge[1]) in faults) for gauge in gauges]
    placed = ", ".join(
        f"leg {AXES[leg]} in direction {AXES[direction]} at {100 * place:.0f} % of the leg"
        for leg, direction, place in gauges
    )
    finding = "Three legs run from the tool in the middle to carriages on the rails x, y and z."
    if gauges:
        finding += f" Gauges: {placed}."
    if faults:
        marked = "; ".join(Series(*fault).words for fault in sorted(faults))
        finding += f" Marked, because a fault spoils its readings: {marked}."
    if rails:
        marked = ", ".join(AXES[rail] for rail in sorted(rails))
        finding += f" Marked, because a fault is in it: axis {marked}."
    return svg("machine", WIDTH, HEIGHT, "The machine and its gauges", finding, *parts)


def _at(leg: int, fraction: float) -> Floats:
    return np.asarray(CENTRE + fraction * LEG * ON_PAPER[leg])


def _line(start: Floats, stop: Floats, class_: str) -> Html:
    (x1, y1), (x2, y2) = start.tolist(), stop.tolist()
    return line(x1, y1, x2, y2, class_)


def _gauge(leg: int, direction: int, place: float, faulty: bool) -> Html:
    """A dial on the side towards which its direction points: that way its reading grows."""
    touch = _at(leg, 1.0 - place)
    toward = ON_PAPER[direction] / np.linalg.norm(ON_PAPER[direction])
    dial = touch + 40.0 * toward
    x, y = dial.tolist()
    return tag(
        "g",
        _line(touch + 5.0 * toward, dial - 12.0 * toward, "plunger"),
        tag("circle", cx=x, cy=y, r=17.0, class_="fault") if faulty else None,
        tag("circle", cx=x, cy=y, r=12.0, class_="dial"),
        words(x, y + 4, f"+{AXES[direction]}", "middle", "small"),
        class_=f"c-{AXES[leg]}",
    )


def class_limits(largest: float) -> Floats:
    """Upper limits of the colour classes, shape (CLASSES,) [mm]: equal steps up to a round end."""
    power = 10.0 ** math.floor(math.log10(max(largest, 1e-6) / CLASSES))
    steps = [factor * power for factor in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.5, 10.0, 20.0)]
    step = next(step for step in steps if step * CLASSES >= largest * (1.0 - 1e-9))
    return np.arange(1.0, CLASSES + 1.0) * step


def slices(
    axis_mm: Floats, levels_mm: Floats, before_mm: Floats, after_mm: Floats
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
    limits, wide = class_limits(largest).tolist(), 48.0
    parts = [words(0, 30, "0"), words(wide * CLASSES + 6, 30, "mm")]
    for k, limit in enumerate(limits):
        parts.append(rectangle(k * wide, 2, wide, 14, f"heat h{k}"))
        parts.append(words((k + 1) * wide, 30, two_figures(limit), "end"))
    finding = f"{CLASSES} steps from 0 to {two_figures(limits[-1])} mm; darker is larger."
    title = "Colours of the workspace pictures"
    return svg("workspace-legend", wide * CLASSES + 30, 36, title, finding, *parts)


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
    return svg(f"workspace-{name}", CUBE_WIDTH, CUBE_HEIGHT, title, finding, *parts)
