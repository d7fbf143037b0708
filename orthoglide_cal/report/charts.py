"""Measured values as pictures: readings, residuals, what causes explain, offsets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.model import AXES, Difference, Floats, Ints, Series
from orthoglide_cal.report.canvas import (
    Axes,
    Scale,
    around,
    line,
    mark,
    polyline,
    rectangle,
    ruler,
    svg,
    tick_text,
    words,
)
from orthoglide_cal.report.escape import Html, join, tag
from orthoglide_cal.results import Residuals
from orthoglide_cal.words import plain, signed, two_figures

WIDTH = 240.0
_NAME = WIDTH - 10, 16.0  # place of a panel's name, at its end
_WIDE, _TOP, _ROW = 360.0, 22.0, 26.0  # of a picture with a line for each difference


def reading_panels(found: Residuals) -> tuple[Html, ...]:
    """One panel for each leg and direction: the gauge over the leg's travel, and the model."""
    height = 188.0
    travel, measured, predicted = found.displacement_mm, found.measured_mm, found.predicted_mm
    up = around([*measured.tolist(), *predicted.tolist()], 0.02)
    low, high = float(travel.min()), float(travel.max())
    room = 0.07 * (high - low) or 1.0
    panels = []
    for one, chosen in _by_series(found.series).items():
        axes = Axes.of(WIDTH, height, (low - room, high + room), up)
        places = [(v, tick_text(v, 1.0)) for v in sorted({float(travel[k]) for k in chosen})]
        parts = [
            axes.left_axis("mm"),
            axes.bottom_axis(places, "travel of the leg, mm"),
            words(*_NAME, one.words, "end", "strong"),
        ]
        for strand in sorted({found.end[k] or "" for k in chosen}):
            mine = [k for k in chosen if (found.end[k] or "") == strand]
            model = sorted((float(travel[k]), float(predicted[k])) for k in mine)
            points = [(axes.across(a), axes.up(b)) for a, b in model]
            parts.append(polyline(points, "model"))
            if strand:
                parts.append(words(points[0][0], points[0][1] - 8, strand))
        for k in chosen:
            x, y = axes.across(float(travel[k])), axes.up(float(measured[k]))
            parts.append(mark(x, y, int(found.cycle[k]) - 1, "mark open"))
        worst = 1000.0 * float(np.abs(found.residual_mm[chosen]).max())
        finding = (
            f"Readings of {one.words} over its travel, and the prediction: they differ by at most"
            f" {worst:.0f} µm."
        )
        title = f"Measured and predicted, {one.words}"
        panels.append(_coloured("measured", one, height, title, finding, parts))
    return tuple(panels)


def residual_panels(found: Residuals, noise_mm: float) -> tuple[Html, ...]:
    """One panel for each leg and direction, all on one scale.

    Args:
        found: n readings.
        noise_mm: standard deviation of one reading; the band is twice as high.
    """
    height, microns, band = 176.0, 1000.0 * found.residual_mm, 2000.0 * noise_mm
    largest = max(float(np.abs(microns).max()), band) * 1.08
    named = [f"{a} {b}" if b else a for a, b in zip(found.label, found.end, strict=True)]
    panels = []
    for one, chosen in _by_series(found.series).items():
        ordered = sorted(chosen, key=lambda k: (found.displacement_mm[k], named[k]))
        postures = list(dict.fromkeys(named[k] for k in ordered))
        span = (-0.5, len(postures) - 0.5)
        axes = Axes.of(WIDTH, height, span, (-largest, largest), bottom=32.0)
        parts = [
            axes.band(band),
            axes.left_axis("µm"),
            *(
                words(axes.across(float(k)), axes.up.start + 12.0 * (n + 1) + 1.0, word, "middle")
                for k, text in enumerate(postures)
                for n, word in enumerate(text.split())
            ),
            words(*_NAME, one.words, "end", "strong"),
        ]
        for turn in sorted({int(found.cycle[k]) for k in chosen}):
            shift = 0.09 * (turn - 2.5)
            points = sorted(
                (axes.across(postures.index(named[k]) + shift), axes.up(float(microns[k])))
                for k in chosen
                if found.cycle[k] == turn
            )
            parts.append(polyline(points, "thread"))
            parts += [mark(x, y, turn - 1) for x, y in points]
        worst = max(chosen, key=lambda k: abs(microns[k]))
        finding = (
            f"Residuals of {one.words}: the largest is {signed(microns[worst], 0)} µm at posture"
            f" {named[worst]}, cycle {int(found.cycle[worst])}; the gauge's noise explains up to"
            f" about {band:.0f} µm."
        )
        panels.append(_coloured("residual", one, height, f"Residuals, {one.words}", finding, parts))
    return tuple(panels)


def _by_series(series: Sequence[Series]) -> dict[Series, list[int]]:
    """Legs in order: which entries are of each series."""
    return {one: [k for k, s in enumerate(series) if s == one] for one in sorted(set(series))}


def _coloured(
    kind: str, one: Series, height: float, title: str, finding: str, parts: Sequence[Html]
) -> Html:
    """A panel in the colour of its leg."""
    name = f"{kind}-{AXES[one.direction]}{AXES[one.leg]}"
    body = tag("g", join(parts), class_=f"c-{AXES[one.leg]}")
    return svg(name, WIDTH, height, title, finding, body)


def difference_rows(
    differences: Sequence[Difference], measured_mm: Floats, predicted_mm: Floats
) -> tuple[Html, ...]:
    """A line for each difference: measured (circle), predicted (square), and what is left.

    Args:
        differences: which, n of them.
        measured_mm, predicted_mm: of each, shape (n,).
    """
    limits = around([*measured_mm.tolist(), *predicted_mm.tolist()], 0.02)
    left = measured_mm - predicted_mm
    texts = [signed(value, 3) for value in left.tolist()]
    across, parts = _rows(differences, limits, "left, mm", texts, 58.0)
    for k, one in enumerate(differences):
        y, measured, predicted = _line(k), across(measured_mm[k]), across(predicted_mm[k])
        drawn = (
            line(measured, y, predicted, y, "gap"),
            mark(predicted, y, 2, "mark", 5.0),
            mark(measured, y, 0, "mark open", 5.5),
        )
        parts.append(tag("g", *drawn, class_=f"c-{AXES[one.series.leg]}"))
    worst = int(np.argmax(np.abs(left)))
    finding = (
        f"Of {len(differences)} differences {differences[worst].name} is missed most: measured"
        f" {signed(float(measured_mm[worst]), 3)} mm, predicted"
        f" {signed(float(predicted_mm[worst]), 3)} mm."
    )
    title, height = "Measured and predicted differences", _height(differences)
    return (svg("measured-predicted", _WIDE, height, title, finding, *parts),)


def corrected_rows(
    differences: Sequence[Difference],
    promised_mm: Floats,
    left_mm: Floats,
    expanded_mm: Floats,
    limit_mm: float | None,
) -> tuple[Html, ...]:
    """A line for each difference: left after correction with its U, promised, and the limit.

    Args:
        differences: which, n of them.
        promised_mm: what should be left of each, shape (n,).
        left_mm: what is left of it, shape (n,).
        expanded_mm: expanded uncertainty of that, shape (n,).
        limit_mm: largest size that is allowed; None if nobody said.
    """
    edges = [] if limit_mm is None else [-limit_mm, limit_mm]
    ends = [*(left_mm - expanded_mm).tolist(), *(left_mm + expanded_mm).tolist()]
    limits = around([*ends, *promised_mm.tolist(), *edges], 0.02)
    texts = [
        f"{signed(value, 3)} ± {plain(half, 3)}"
        for value, half in zip(left_mm.tolist(), expanded_mm.tolist(), strict=True)
    ]
    across, parts = _rows(differences, limits, "left after correction, mm", texts, 104.0)
    bottom = _height(differences) - 34.0
    parts += [line(across(edge), 16.0, across(edge), bottom, "due") for edge in edges]
    for k, one in enumerate(differences):
        low, high = (across(left_mm[k] + side * expanded_mm[k]) for side in (-1.0, 1.0))
        y = _line(k)
        drawn = (
            line(low, y, high, y, "whisker"),
            *(line(x, y - 5, x, y + 5, "whisker") for x in (low, high)),
            mark(across(promised_mm[k]), y, 2, "mark", 5.0),
            mark(across(left_mm[k]), y, 0, "mark open", 5.5),
        )
        parts.append(tag("g", *drawn, class_=f"c-{AXES[one.series.leg]}"))
    worst = int(np.argmax(np.abs(left_mm)))
    finding = (
        f"Of {len(differences)} differences {differences[worst].name} is left largest:"
        f" {texts[worst]} mm, promised {signed(float(promised_mm[worst]), 3)} mm"
        + (f"; the limit is {limit_mm:g} mm." if limit_mm is not None else ".")
    )
    title, height = "What is left after correction", _height(differences)
    return (svg("corrected", _WIDE, height, title, finding, *parts),)


def _rows(
    differences: Sequence[Difference],
    limits: tuple[float, float],
    heading: str,
    texts: Sequence[str],
    room: float,
) -> tuple[Scale, list[Html]]:
    """The scale of a picture with a line for each difference; names, numbers and grid of it."""
    across, bottom = Scale(*limits, 56.0, _WIDE - room), _height(differences) - 34.0
    parts = [
        ruler(across, 16.0, bottom, 5, "mm", (across.start + across.end) / 2),
        words(_WIDE - 4, 12, heading, "end", "muted"),
    ]
    for k, (one, text) in enumerate(zip(differences, texts, strict=True)):
        parts.append(words(6, _line(k) + 4, one.name, class_="strong"))
        parts.append(words(_WIDE - 4, _line(k) + 4, text, "end"))
    return across, parts


def _line(k: int) -> float:
    """Height of the k-th difference."""
    return _TOP + _ROW * (k + 0.5)


def _height(differences: Sequence[Difference]) -> float:
    return _TOP + _ROW * len(differences) + 34.0


def residual_strips(
    names: Sequence[str], residuals_mm: Sequence[Floats], legs: Ints | None, noise_mm: float
) -> tuple[Html, ...]:
    """Residuals in order of time, under one or two models, on one scale.

    Args:
        names: of the models.
        residuals_mm: in order of time, each of shape (n,).
        legs: 0, 1, 2: leg of each, shape (n,); sets the colour. None without legs.
        noise_mm: standard deviation of one reading; the band is twice as high.
    """
    width, height, count = 300.0, 190.0, len(residuals_mm[0])
    band = 2000.0 * noise_mm
    largest = 1.08 * max(band, *(1000.0 * float(np.abs(r).max()) for r in residuals_mm))
    axes = Axes.of(width, height, (0.0, count + 1.0), (-largest, largest))
    middles = []
    for leg in () if legs is None else sorted({int(v) for v in legs}):
        mine = np.flatnonzero(legs == leg) + 1
        if int(mine[-1] - mine[0]) < mine.size:  # one after the other; else names would overlap
            middles.append((float(mine.mean()), f"leg {AXES[leg]}"))
    strips = []
    for number, (name, residual) in enumerate(zip(names, residuals_mm, strict=True)):
        microns = 1000.0 * residual
        parts = [
            axes.band(band),
            axes.left_axis("µm"),
            words(width - 10, 16, name, "end", "strong"),
            axes.bottom_axis(middles, "readings in order of time"),
        ]
        for k, leg in enumerate([None] * count if legs is None else legs.tolist()):
            x, y = axes.across(k + 1.0), axes.up(float(microns[k]))
            colour = "" if leg is None else f" c-{AXES[leg]}"
            parts.append(line(x, axes.up(0.0), x, y, f"stem{colour}"))
            parts.append(mark(x, y, leg or 0, f"mark{colour}", 2.4))
        outside = int((np.abs(microns) > band).sum())
        finding = (
            f"Residuals {name}: r.m.s. {rms(microns):.1f} µm,"
            f" {outside} of {count} outside the noise band of ±{band:.0f} µm."
        )
        title = f"Residuals {name}"
        strips.append(svg(f"explained-{number}", width, height, title, finding, *parts))
    return tuple(strips)


def waterfall(left_mm: Mapping[str, float], noise_mm: float | None) -> tuple[Html, ...]:
    """What each step takes of the deviation, and what noise and the unknown are in the rest.

    Args:
        left_mm: step → r.m.s. that it leaves; the first one is as found.
        noise_mm: how much of the last one is the gauge's noise; None if nobody knows.
    """
    names, left = list(left_mm), list(left_mm.values())
    rows = [(names[0], 0.0, left[0], "part-found")]
    rows += [
        (name, after, before, "part-cause")
        for name, before, after in zip(names[1:], left[:-1], left[1:], strict=True)
    ]
    if noise_mm is not None:
        rows.append(("noise", 0.0, noise_mm, "part-noise"))
        if noise_mm < left[-1]:
            rows.append(("unexplained", noise_mm, left[-1], "part-open"))
    row, width = 40.0, _WIDE
    bottom, across = 10.0 + row * len(rows), Scale(0.0, max(left), 14.0, width - 14.0)
    parts = [ruler(across, 4.0, bottom, 4, "r.m.s., mm", width / 2)]
    for k, (name, low, high, class_) in enumerate(rows):
        y = 10.0 + row * k
        taken = "-" if class_ == "part-cause" and high > low else ""
        parts += [
            words(18, y + 10, name, class_="strong"),
            words(width - 14, y + 10, f"{taken}{two_figures(high - low)} mm", "end"),
            rectangle(across(low), y + 15, max(across(high) - across(low), 1.0), 15, class_),
        ]
    said = ", ".join(f"{name} {two_figures(value)}" for name, value in left_mm.items())
    finding = f"r.m.s. of the deviation, mm, as found and after each step: {said}."
    return (
        svg("waterfall", width, bottom + 34.0, "What takes the deviation away", finding, *parts),
    )


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
        f"{axis}, {bar.label}: {signed(bar.value_mm[k], 3)} ± {plain(bar.half_mm[k], 3)} mm"
        for k, axis in enumerate(AXES)
        for bar in bars
    )
    closer = "; ".join(
        f"{axis}: ±{half:.0f} µm" for axis, half in zip(AXES, nearer[0].half_mm, strict=True)
    )
    near_title = (
        f"distance from the offset {first.label}, µm"
        if len(bars) > 1
        else "closer: distance from the offset, µm"
    )
    return (
        _interval_panel("intervals", bars, "offset, mm", "Offsets", f"{said}."),
        _interval_panel("intervals-near", nearer, near_title, "Intervals, closer", f"{closer}."),
    )


def _interval_panel(
    name: str, bars: Sequence[Bar], axis_title: str, title: str, finding: str
) -> Html:
    width, left, top, row = 280.0, 34.0, 12.0, 16.0
    ends = [
        value + side * half
        for bar in bars
        for value, half in zip(bar.value_mm, bar.half_mm, strict=True)
        for side in (-1.0, 1.0)
    ]
    across = Scale(*around(ends, 0.01), left, width - 10.0)
    group = row * len(bars) + 12.0
    bottom = top + 3 * group
    parts = [ruler(across, top - 6, bottom, 4, axis_title, (left + width) / 2)]
    for k, axis in enumerate(AXES):
        base = top + k * group
        drawn = [words(8, base + group / 2 - 1, axis, class_="axis")]
        for n, bar in enumerate(bars):
            y = base + row * (n + 0.5)
            low, high = (across(bar.value_mm[k] + side * bar.half_mm[k]) for side in (-1.0, 1.0))
            drawn.append(line(low, y, high, y, "whisker"))
            drawn += [line(x, y - 5, x, y + 5, "whisker") for x in (low, high)]
            shape = "mark" if n == 0 else "mark open"
            drawn.append(mark(across(bar.value_mm[k]), y, 2 * n, shape, 4.4))
        parts.append(tag("g", *drawn, class_=f"c-{axis}"))
    return svg(name, width, bottom + 34.0, title, finding, *parts)
