"""The tool-position error over the workspace: coloured slices with contours and arrows.

Before and after the adjustment each have colours and a scale of their own, so that what is left is
as easy to see as what was found. Between the points of the grid the error is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from orthoglide_cal.model import Floats
from orthoglide_cal.report.canvas import line, polyline, rectangle, svg, tick_text, words
from orthoglide_cal.report.escape import Html, tag
from orthoglide_cal.words import two_figures

CLASSES = 7  # colours of a scale
SIZE, LEFT, TOP = 186.0, 46.0, 38.0  # of a slice, and its place in the picture
WIDTH, HEIGHT = 240.0, 262.0
# Longest arrow, and how many points of the grid lie between two arrows.
ARROW, STEP = 22.0, 4
BOX = 46.0  # of the legend

Corner = tuple[float, float, float]  # x, y in the picture, error
Place = tuple[float, float]


def slices(
    when: str, axis_mm: Floats, levels_mm: Floats, error_mm: Floats, shift_mm: Floats
) -> tuple[Html, ...]:
    """One picture for each level, the highest first.

    Args:
        when: "before" or "after".
        axis_mm: grid along x and y, shape (n,).
        levels_mm: heights z, shape (m,).
        error_mm: at [level, y, x], shape (m, n, n).
        shift_mm: true − commanded position, shape (m, n, n, 3).
    """
    limits, longest = _limits(error_mm).tolist(), longest_arrow(error_mm, shift_mm)
    ends = tick_text(float(axis_mm[0]), 1.0), tick_text(float(axis_mm[-1]), 1.0)
    panels = []
    for k in reversed(range(len(levels_mm))):
        grid, level = _Grid(error_mm[k]), float(levels_mm[k])
        parts = [*grid.coloured(limits)]
        if longest is not None:
            parts += grid.arrows(shift_mm[k], ARROW / longest)
        panels.append(_panel(f"{when}-{k}", when, level, ends, error_mm[k], parts))
    return tuple(panels)


def longest_arrow(error_mm: Floats, shift_mm: Floats) -> float | None:
    """Longest shift in the plane of the slices [mm]; None if it is nothing beside the error."""
    longest = float(np.linalg.norm(shift_mm[..., :2], axis=-1).max())
    return longest if longest > 0.05 * float(error_mm.max()) else None


def _panel(
    name: str, when: str, level: float, ends: tuple[str, str], error: Floats, parts: Sequence[Html]
) -> Html:
    lowest, highest = two_figures(float(error.min())), two_figures(float(error.max()))
    low, high = ends
    bottom, title = TOP + SIZE, f"Workspace {when}, z = {level:.0f} mm"
    drawn = (
        *parts,
        words(LEFT, 14, when.capitalize(), class_="strong"),
        words(LEFT + SIZE, 14, f"z = {tick_text(level, 1.0)} mm", "end"),
        words(LEFT + SIZE, 31, f"{lowest} to {highest} mm", "end"),
        words(LEFT, bottom + 14, low),
        words(LEFT + SIZE / 2, bottom + 14, "x, mm", "middle", "muted"),
        words(LEFT + SIZE, bottom + 14, high, "end"),
        words(LEFT - 7, bottom - 2, low, "end"),
        words(LEFT - 7, TOP + SIZE / 2 + 4, "y, mm", "end", "muted"),
        words(LEFT - 7, TOP + 9, high, "end"),
    )
    finding = (
        f"Tool-position error {when} the adjustment in the slice z = {level:.0f} mm:"
        f" {lowest} to {highest} mm."
    )
    body = tag("g", *drawn, class_=when)
    return svg(f"workspace-{name}", WIDTH, HEIGHT, title, finding, body)


def class_limits(lowest: float, largest: float) -> Floats:
    """Limits between colours from below the smallest error to above the largest, (CLASSES + 1,).

    Equal steps of a round length; they begin at a whole number of steps.
    """
    least = max((largest - lowest) / CLASSES, 1e-3 * largest, 1e-9)
    power = 10.0 ** math.floor(math.log10(least))
    for factor in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0, 15.0, 20.0):
        first = math.floor(lowest / (factor * power) + 1e-9)
        if (first + CLASSES) * factor * power >= largest * (1.0 - 1e-9):
            break
    return np.arange(first, first + CLASSES + 1.0) * factor * power


def legend(scales: Mapping[str, tuple[Floats, Floats]]) -> Html:
    """The colours of each scale with their limits, and how long its arrows are.

    Args:
        scales: when → error and shift, as `slices` takes them.
    """
    parts, findings, height = [], [], 0.0
    for when, (error, shift) in scales.items():
        limits, longest = _limits(error), longest_arrow(error, shift)
        row = [words(0, 12, f"{when.capitalize()}, mm", class_="strong")]
        row += [rectangle(k * BOX, 20, BOX, 14, f"heat h{k}") for k in range(CLASSES)]
        row += [words(k * BOX, 48, text) for k, text in enumerate(_texts(limits))]
        if longest is not None:
            row += _arrow((150.0, 8.0), (150.0 + ARROW, 8.0))
            row.append(words(158.0 + ARROW, 12, f"{two_figures(longest)} mm"))
        parts.append(tag("g", *row, class_=when, transform=f"translate(0 {height:g})"))
        findings.append(f"{when} from {_texts(limits)[0]} to {_texts(limits)[-1]} mm")
        height += 62.0
    finding = f"{CLASSES} equal steps of colour: {', '.join(findings)}."
    title = "Colours of the workspace pictures"
    return svg("workspace-legend", BOX * CLASSES + 36, height - 6, title, finding, *parts)


def _limits(error: Floats) -> Floats:
    return class_limits(float(error.min()), float(error.max()))


def _texts(limits: Floats) -> list[str]:
    """With as many decimals as their step needs."""
    step = float(limits[1] - limits[0])
    return [tick_text(limit, step) for limit in limits.tolist()]


class _Grid:
    """Values on a square grid, as places in the picture."""

    def __init__(self, values: Floats) -> None:
        self._across = np.linspace(LEFT, LEFT + SIZE, len(values)).tolist()
        self._up = np.linspace(TOP + SIZE, TOP, len(values)).tolist()
        self._values = values.tolist()

    def coloured(self, limits: Sequence[float]) -> Iterator[Html]:
        """Areas of one colour, each laid over the one below it, and their contours."""
        yield rectangle(LEFT, TOP, SIZE, SIZE, "heat h0")
        contours = []
        for class_, limit in enumerate(limits[1:-1], start=1):
            area, edge = self._above(limit)
            contours.append(edge)
            if area:
                yield tag("path", d=area, class_=f"heat h{class_}")
        if any(contours):
            yield tag("path", d="".join(contours), class_="contour")

    def _above(self, limit: float) -> tuple[str, str]:
        """Paths of the area in which the values are above a limit, and of its edge inside."""
        areas, edges = [], []
        for row in range(len(self._up) - 1):
            whole = 0  # cells in a row that lie above it altogether: one rectangle
            for column in range(len(self._across)):
                corners = self._cell(row, column)
                if corners and all(corner[2] >= limit for corner in corners):
                    whole += 1
                    continue
                if whole:
                    areas.append(self._block(row, column - whole, column))
                    whole = 0
                polygon, crossings = _clipped(corners, limit)
                areas.append(_closed(polygon))
                pairs = zip(crossings[::2], crossings[1::2], strict=True)
                edges += [f"M{_at(a)}L{_at(b)}" for a, b in pairs]
        return "".join(areas), "".join(edges)

    def _cell(self, row: int, column: int) -> tuple[Corner, ...]:
        """The corners of a cell in turn; none to the right of the last one."""
        if column + 1 == len(self._across):
            return ()
        return tuple(
            (self._across[c], self._up[r], self._values[r][c])
            for r, c in ((row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column))
        )

    def _block(self, row: int, first: int, end: int) -> str:
        left, right = self._across[first], self._across[end]
        low, high = self._up[row], self._up[row + 1]
        return _closed([(left, low), (right, low), (right, high), (left, high)])

    def arrows(self, shift: Floats, scale: float) -> Iterator[Html]:
        """Where the tool really goes, in the plane, (n, n, 3) → arrows."""
        for row in range(STEP // 2, len(self._up), STEP):
            for column in range(STEP // 2, len(self._across), STEP):
                dx, dy, _ = (scale * shift[row, column]).tolist()
                if math.hypot(dx, dy) > 2.0:
                    x, y = self._across[column], self._up[row]
                    yield from _arrow((x, y), (x + dx, y - dy))


def _clipped(corners: tuple[Corner, ...], limit: float) -> tuple[list[Place], list[Place]]:
    """The part of a cell above a limit, and where its boundary crosses the cell's sides."""
    polygon: list[Place] = []
    crossings: list[Place] = []
    for k, (x, y, value) in enumerate(corners):
        to_x, to_y, to = corners[(k + 1) % len(corners)]
        if value >= limit:
            polygon.append((x, y))
        if (value >= limit) != (to >= limit):
            part = (limit - value) / (to - value)
            crossings.append((x + part * (to_x - x), y + part * (to_y - y)))
            polygon.append(crossings[-1])
    return polygon, crossings


def _closed(polygon: list[Place]) -> str:
    return f"M{'L'.join(_at(place) for place in polygon)}z" if polygon else ""


def _at(place: Place) -> str:
    return f"{place[0]:.1f} {place[1]:.1f}"


def _arrow(start: Place, stop: Place) -> Iterator[Html]:
    """A line with a head, on a pale ground so that it is seen on every colour."""
    angle = math.atan2(stop[1] - start[1], stop[0] - start[0])
    head = [
        (stop[0] - 6.0 * math.cos(angle + side), stop[1] - 6.0 * math.sin(angle + side))
        for side in (0.5, -0.5)
    ]
    for class_ in ("halo", "arrow"):
        yield line(*start, *stop, class_)
        yield polyline([head[0], stop, head[1]], class_)
