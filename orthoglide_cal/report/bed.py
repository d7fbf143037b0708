"""A map of a bed seen from above: what is left of each touch, in signs or in colours."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.model import Floats
from orthoglide_cal.report.canvas import line, rectangle, svg, tick_text, words
from orthoglide_cal.report.escape import Html, tag
from orthoglide_cal.report.slices import CLASSES, class_limits

CELLS = 17  # of the map in signs, along x and along y
SIZE, LEFT, TOP = 236.0, 30.0, 26.0  # of the map in colours, and its place in the picture
WIDTH, HEIGHT = 296.0, 344.0
BOX = SIZE / CLASSES


def signs(place: Floats, left: Floats, sigma: float) -> tuple[str, ...]:
    """Rows of signs, y upwards: `·` noise, `+ −` over 2σ, `▲ ▼` over 4σ, blank where none was.

    Args:
        place: of n touches, shape (n, 2) [mm].
        left: measured − predicted; touches of one cell are averaged, shape (n,) [mm].
        sigma: standard deviation of one touch [mm].
    """
    reach = float(np.abs(place).max(initial=1.0)) * (1.0 + 1e-9)
    cell = np.floor((place / reach + 1.0) / 2.0 * CELLS).astype(int)
    number = cell[:, 1] * CELLS + cell[:, 0]
    count = np.bincount(number, minlength=CELLS**2)
    total = np.bincount(number, weights=left, minlength=CELLS**2)
    rows = []
    for row in reversed(range(CELLS)):
        cells = range(row * CELLS, (row + 1) * CELLS)
        texts = [sign(total[k] / count[k], sigma) if count[k] else " " for k in cells]
        rows.append(" ".join(texts).rstrip())
    return tuple(f"  {text}" for text in rows if text)


def sign(left: float, sigma: float) -> str:
    """What is left of one reading, beside its standard deviation."""
    if abs(left) <= 2.0 * sigma:
        return "·"
    large = abs(left) > 4.0 * sigma
    return ("▲" if large else "+") if left > 0.0 else ("▼" if large else "−")


def limits_of(*left: Floats) -> Floats:
    """Limits between the colours that several maps share, in µm."""
    every = 1000.0 * np.concatenate(left)
    # From as far below zero as above it: the middle colour means that nothing is left.
    most = float(np.abs(every).max(initial=1.0))
    limits = class_limits(-most, most)
    return np.asarray(limits - (limits[0] + limits[-1]) / 2.0)


def colours(name: str, title: str, place: Floats, left: Floats, limits: Floats) -> Html:
    """The touches as coloured dots, and the scale below.

    Args:
        name: unique in the page.
        title: what the touches are compared with.
        place: shape (n, 2) [mm].
        left: measured − predicted, shape (n,) [mm].
        limits: as `limits_of` gives them [µm].
    """
    reach = float(np.abs(place).max(initial=1.0))
    middle, scale = SIZE / 2.0, 0.47 * SIZE / reach
    class_ = np.clip(np.searchsorted(limits, 1000.0 * left) - 1, 0, CLASSES - 1).tolist()
    size = max(min(0.42 * SIZE / len(place) ** 0.5, 9.0), 2.5)
    dots = [
        tag("circle", cx=LEFT + middle + scale * x, cy=TOP + middle - scale * y, r=size,
            class_=f"heat h{k}")
        for (x, y), k in zip(place.tolist(), class_, strict=True)
    ]  # fmt: skip
    bottom = TOP + SIZE
    step = float(limits[1] - limits[0])
    drawn = (
        words(LEFT, 14, title, class_="strong"),
        *dots,
        line(LEFT, bottom, LEFT + SIZE, bottom, "axis-line"),
        words(LEFT, bottom + 15, tick_text(-reach, 1.0)),
        words(LEFT + middle, bottom + 15, "x, mm", "middle", "muted"),
        words(LEFT + SIZE, bottom + 15, tick_text(reach, 1.0), "end"),
        *(rectangle(LEFT + k * BOX, bottom + 36, BOX, 12, f"heat h{k}") for k in range(CLASSES)),
        words(LEFT, bottom + 62, tick_text(float(limits[0]), step), "middle"),
        words(LEFT + middle, bottom + 62, "µm", "middle", "muted"),
        words(LEFT + SIZE, bottom + 62, tick_text(float(limits[-1]), step), "middle"),
    )
    low, high = (1000.0 * float(f(left)) for f in (np.min, np.max))
    finding = f"{title}: {low:.0f} to {high:.0f} µm left at {len(left)} touches."
    return svg(name, WIDTH, HEIGHT, title, finding, tag("g", *drawn, class_="before"))
