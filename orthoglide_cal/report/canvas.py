"""The parts that pictures are made of: scales, axes, marks.

A picture's lengths are CSS pixels at its natural size; the page scales it to its place. Colours are
classes of the page.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from orthoglide_cal.report.escape import Html, join, tag

MINUS = "\N{MINUS SIGN}"


@dataclass(frozen=True)
class Scale:
    """Maps low … high to start … end, linearly."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """Place of a value; the middle if the scale has no length."""
        if self.high == self.low:
            return (self.start + self.end) / 2.0
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)


def ticks(low: float, high: float, count: int = 4) -> list[float]:
    """About `count` round numbers from low to high."""
    if not high > low:
        return [low]
    rough = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= rough * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def tick_text(value: float, step: float) -> str:
    """A tick's number with as many decimals as its step needs."""
    decimals = max(0, -math.floor(math.log10(step) + 1e-9)) if step > 0 else 2
    if step > 0 and abs(round(step, decimals) - step) > step * 1e-6:
        decimals += 1
    written = f"{abs(value):.{decimals}f}"
    return MINUS + written if value < 0 and float(written) else written


def around(values: Sequence[float], least: float = 0.0) -> tuple[float, float]:
    """Limits that hold the values and zero with a little room; at least ±`least`."""
    known = [v for v in values if math.isfinite(v)]
    low, high = min([*known, -least, 0.0]), max([*known, least, 0.0])
    room = 0.06 * (high - low) or 1.0
    return low - (room if low < 0 else 0.0), high + (room if high > 0 else 0.0)


def svg(name: str, width: float, height: float, title: str, finding: str, *parts: Html) -> Html:
    """A picture with its text alternative.

    Args:
        name: unique in the page; letters, digits and "-".
        width, height: natural size.
        title: what it is.
        finding: what one sees in it.
    """
    return tag(
        "svg",
        tag("title", title, id=f"{name}-t"),
        tag("desc", finding, id=f"{name}-d"),
        *parts,
        viewBox=f"0 0 {width:g} {height:g}",
        role="img",
        aria_labelledby=f"{name}-t {name}-d",
        xmlns="http://www.w3.org/2000/svg",
    )


def words(
    x: float, y: float, content: str, anchor: str = "start", class_: str | None = None
) -> Html:
    """A text; `y` is its base line."""
    return tag("text", content, x=x, y=y, text_anchor=anchor, class_=class_)


def line(x1: float, y1: float, x2: float, y2: float, class_: str = "ink") -> Html:
    """A straight line."""
    return tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=class_)


def polyline(points: Sequence[tuple[float, float]], class_: str) -> Html:
    """An open line through points."""
    return tag("polyline", points=_path(points), class_=class_)


def polygon(points: Sequence[tuple[float, float]], class_: str) -> Html:
    """A filled shape with straight sides."""
    return tag("polygon", points=_path(points), class_=class_)


def _path(points: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def rectangle(x: float, y: float, width: float, height: float, class_: str) -> Html:
    """A filled rectangle."""
    return tag("rect", x=x, y=y, width=max(width, 0.0), height=max(height, 0.0), class_=class_)


def mark(x: float, y: float, shape: int, class_: str = "mark", size: float = 3.6) -> Html:
    """A mark: 0 circle, 1 triangle, 2 square, 3 diamond, 4 cross; then again."""
    s = size
    if shape % 5 == 0:
        return tag("circle", cx=x, cy=y, r=s, class_=class_)
    if shape % 5 == 4:
        path = f"M{x - s:.1f} {y - s:.1f}l{2 * s:.1f} {2 * s:.1f}m0 {-2 * s:.1f}l{-2 * s:.1f} "
        return tag("path", d=f"{path}{2 * s:.1f}", class_=class_)
    corners = {
        1: ((0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)),
        2: ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
        3: ((0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)),
    }[shape % 5]
    return polygon([(x + s * dx, y + s * dy) for dx, dy in corners], class_)


@dataclass(frozen=True)
class Axes:
    """The axes of a plot: scales and the lines, ticks and numbers around them."""

    across: Scale
    up: Scale

    @classmethod
    def of(
        cls,
        width: float,
        height: float,
        across: tuple[float, float],
        up: tuple[float, float],
        *,
        left: float = 46.0,
        bottom: float = 34.0,
    ) -> Axes:
        """Axes with margins inside a picture of this size."""
        return cls(Scale(*across, left, width - 10.0), Scale(*up, height - bottom, 26.0))

    def left_axis(self, title: str) -> Html:
        """Grid lines with numbers, and the axis' title above them."""
        left, right = self.across.start, self.across.end
        rows = [
            join((line(left, y, right, y, class_), words(left - 5, y + 3.5, text, "end", "tick")))
            for y, class_, text in _marked(self.up, 4)
        ]
        return join((*rows, words(2, self.up.end - 8, title, class_="muted")))

    def band(self, half: float) -> Html:
        """A strip of ± `half` about zero."""
        low, high = self.up(-half), self.up(half)
        width = self.across.end - self.across.start
        return rectangle(self.across.start, high, width, low - high, "band")


def ruler(across: Scale, top: float, bottom: float, count: int, title: str, middle: float) -> Html:
    """Vertical grid lines from top to bottom with numbers below them, and a title at `middle`."""
    parts = [
        join((line(x, top, x, bottom, class_), words(x, bottom + 14, text, "middle", "tick")))
        for x, class_, text in _marked(across, count)
    ]
    return join((*parts, words(middle, bottom + 29, title, "middle", "muted")))


def _marked(scale: Scale, count: int) -> Iterator[tuple[float, str, str]]:
    """Place, class and number of each grid line of a scale."""
    values = ticks(scale.low, scale.high, count)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    for value in values:
        class_ = "zero" if abs(value) < step * 1e-6 else "grid"
        yield scale(value), class_, tick_text(value, step)
