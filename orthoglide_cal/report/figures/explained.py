"""What the named cause explains of the residuals, and what is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.report.figures.canvas import Frame, line, mark, rectangle, svg, words
from orthoglide_cal.report.markup import Html, join
from orthoglide_cal.report.numbers import percent

WIDTH, HEIGHT = 300.0, 190.0


def residual_strips(
    names: Sequence[str],
    residuals_mm: Sequence[Floats],
    legs: Ints,
    noise_mm: float,
) -> tuple[Html, ...]:
    """Residuals in order of time, under one or two models, on one scale.

    Args:
        names: of the models.
        residuals_mm: in order of time, each of shape (n,).
        legs: 0, 1, 2: leg of each, shape (n,); sets the colour.
        noise_mm: standard deviation of one reading; the band is twice as high.
    """
    band = 2000.0 * noise_mm
    largest = 1.08 * max(band, *(1000.0 * float(np.abs(r).max()) for r in residuals_mm))
    return tuple(
        _strip(k, name, 1000.0 * residual, legs, band, largest)
        for k, (name, residual) in enumerate(zip(names, residuals_mm, strict=True))
    )


def _strip(
    number: int, name: str, microns: Floats, legs: Ints, band: float, largest: float
) -> Html:
    count = len(microns)
    frame = Frame.of(WIDTH, HEIGHT, (0.0, count + 1.0), (-largest, largest))
    across, up = frame.across, frame.up
    parts = [
        rectangle(across.start, up(band), across.end - across.start, up(-band) - up(band), "band"),
        frame.left_axis("µm"),
        words(WIDTH - 10, 16, name, "end", "strong"),
    ]
    for k in range(count):
        x, y = across(k + 1.0), up(float(microns[k]))
        colour = "xyz"[int(legs[k])]
        parts.append(line(x, up(0.0), x, y, f"stem c-{colour}"))
        parts.append(mark(x, y, int(legs[k]), f"mark c-{colour}", 2.4))
    for leg in sorted({int(v) for v in legs}):
        mine = np.flatnonzero(legs == leg) + 1
        middle = float(across((float(mine.min()) + float(mine.max())) / 2.0))
        parts.append(words(middle, up.start + 14, f"leg {'xyz'[leg]}", "middle"))
    parts.append(
        words(
            (across.start + across.end) / 2,
            up.start + 28,
            "readings in order of time",
            "middle",
            "muted",
        )
    )
    outside = int((np.abs(microns) > band).sum())
    finding = (
        f"Residuals {name}: r.m.s. {float(np.sqrt(np.mean(microns**2))):.1f} µm,"
        f" {outside} of {count} outside the noise band of ±{band:.0f} µm."
    )
    return svg(f"explained-{number}", WIDTH, HEIGHT, f"Residuals {name}", finding, *parts)


def share_bar(cause: str, by_cause: float, noise: float, unexplained: float) -> Html:
    """Parts of the residuals' sum of squares; the three shares sum to 1."""
    width = 340.0
    parts = []
    x = 0.0
    names = (
        (cause, by_cause, "part-cause"),
        ("noise", noise, "part-noise"),
        ("unexplained", unexplained, "part-open"),
    )
    for _, share, class_ in names:
        wide = width * share
        parts.append(rectangle(x, 4, wide, 26, class_))
        x += wide
    for k, (label, share, class_) in enumerate(names):
        y = 50.0 + 18.0 * k
        parts.append(rectangle(0, y - 10, 12, 12, class_))
        parts.append(words(18, y, f"{label}: {percent(share)}"))
    return svg(
        "explained-shares",
        width,
        92,
        "Explained and unexplained part of the residuals",
        f"{cause} explains {percent(by_cause)} of the residuals' sum of squares, noise"
        f" {percent(noise)}; {percent(unexplained)} stays unexplained.",
        join(parts),
    )
