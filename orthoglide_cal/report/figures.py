"""The figures: what is left of differences and readings, errors over the workspace, the machine,
and which causes can be distinguished.

Drawing functions take plain values and return pictures; every number that a picture writes, but
those of its axes, is one that it was given.
"""

from __future__ import annotations

import math
import string
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.model import AXES, Floats, Ints, Series
from orthoglide_cal.model.workspace import WorkspaceError
from orthoglide_cal.report.escape import Html, tag
from orthoglide_cal.words import plain, signed

# --- parts of figures: lengths are CSS pixels at natural size, colours are classes of the page ---

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


def _path(points: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def rectangle(x: float, y: float, width: float, height: float, class_: str) -> Html:
    """A filled rectangle."""
    return tag("rect", x=x, y=y, width=max(width, 0.0), height=max(height, 0.0), class_=class_)


def mark(x: float, y: float, shape: int, class_: str = "mark", size: float = 3.6) -> Html:
    """A mark: 0 circle, 1 triangle, 2 square, 3 diamond; then again."""
    corners = {
        1: ((0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)),
        2: ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
        3: ((0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)),
    }.get(shape % 4)
    if corners is None:
        return tag("circle", cx=x, cy=y, r=size, class_=class_)
    return tag(
        "polygon", points=_path([(x + size * a, y + size * b) for a, b in corners]), class_=class_
    )


def _marked(scale: Scale, count: int) -> Iterator[tuple[float, str, str]]:
    """Place, class and number of each grid line of a scale."""
    values = ticks(scale.low, scale.high, count)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    for value in values:
        class_ = "zero" if abs(value) < step * 1e-6 else "grid"
        yield scale(value), class_, tick_text(value, step)


# --- differences ------------------------------------------------------------------------------

_WIDE, _TOP, _ROW, _UNDER = 360.0, 22.0, 26.0, 34.0  # of a picture with a line for each difference


def deviation_rows(
    names: Sequence[str],
    found_mm: Sequence[float],
    expected_mm: Sequence[float],
    expanded_mm: Sequence[float],
    left_mm: Sequence[float] | None = None,
    limit_mm: float | None = None,
) -> Html:
    """A line for each difference: as found ○, expected ■, measured afterwards ●, with its U.

    Args:
        names: such as "dx_y": along x on leg y.
        found_mm: as measured before.
        expected_mm: after what was found is entered.
        expanded_mm: U of what is measured then.
        left_mm: what was measured then; None if nothing was yet.
        limit_mm: largest size that is allowed; None if nobody said.
    """
    last = expected_mm if left_mm is None else left_mm
    edges = [] if limit_mm is None else [-limit_mm, limit_mm]
    pairs = list(zip(last, expanded_mm, strict=True))
    ends = [value + side * half for value, half in pairs for side in (-1.0, 1.0)]
    limits = around([*ends, *found_mm, *expected_mm, *edges], 0.02)
    across, bottom = Scale(*limits, 56.0, _WIDE - 104.0), _TOP + _ROW * len(names)
    heading = "expected ± U, mm" if left_mm is None else "left ± U, mm"
    parts = [
        *(line(x, 16.0, x, bottom, kind) for x, kind, _ in _marked(across, 5)),
        *(words(x, bottom + 14, text, "middle", "tick") for x, _, text in _marked(across, 5)),
        words((across.start + across.end) / 2, bottom + 29, "mm", "middle", "muted"),
        words(_WIDE - 4, 12, heading, "end", "muted"),
        *(line(across(edge), 16.0, across(edge), bottom, "due") for edge in edges),
    ]
    for k, (name, value, half) in enumerate(zip(names, last, expanded_mm, strict=True)):
        y = _TOP + _ROW * (k + 0.5)
        low, high = across(value - half), across(value + half)
        parts += [
            words(6, y + 4, name, class_="strong"),
            words(_WIDE - 4, y + 4, f"{signed(value, 3)} ± {plain(half, 3)}", "end"),
            tag(
                "g",
                line(low, y, high, y, "whisker"),
                *(line(x, y - 5, x, y + 5, "whisker") for x in (low, high)),
                mark(across(found_mm[k]), y, 0, "mark open", 5.5),
                mark(across(expected_mm[k]), y, 2, "mark", 4.5),
                None if left_mm is None else mark(across(left_mm[k]), y, 0, "mark", 5.5),
                class_=f"c-{name.partition('_')[2][:1]}",
            ),
        ]
    worst = max(range(len(names)), key=lambda k: abs(last[k]))
    finding = f"Of the differences {names[worst]} is left largest: {signed(last[worst], 3)} mm."
    title = "Differences, before and after"
    return svg("deviations", _WIDE, bottom + _UNDER, title, finding, *parts)


# --- residuals --------------------------------------------------------------------------------


def residual_panels(
    series: Sequence[Series],
    posture: Sequence[str],
    displacement_mm: Sequence[float],
    cycle: Sequence[int],
    left_mm: Mapping[str, Floats],
    noise_mm: float,
) -> tuple[Html, ...]:
    """One panel for each leg and direction, all on one scale: residuals by posture and cycle.

    Args:
        series: leg and direction of n readings.
        posture, displacement_mm: where the leg stood.
        cycle: repeat, from 1.
        left_mm: under one or two models: measured − modelled, shape (n,). The last is filled.
        noise_mm: standard deviation of one reading; the band is twice as high.
    """
    width, height, band = 240.0, 176.0, 2000.0 * noise_mm
    microns = [1000.0 * values for values in left_mm.values()]
    largest = max(band, *(float(np.abs(values).max()) for values in microns)) * 1.08
    up = Scale(-largest, largest, height - 32.0, 26.0)
    panels = []
    for one in sorted(set(series)):
        chosen = sorted(
            (k for k, each in enumerate(series) if each == one),
            key=lambda k: (displacement_mm[k], posture[k]),
        )
        postures = list(dict.fromkeys(posture[k] for k in chosen))
        across = Scale(-0.5, len(postures) - 0.5, 46.0, width - 10.0)
        parts = [
            rectangle(46.0, up(band), width - 56.0, up(-band) - up(band), "band"),
            *(line(46.0, y, width - 10.0, y, kind) for y, kind, _ in _marked(up, 4)),
            *(words(41.0, y + 3.5, text, "end", "tick") for y, _, text in _marked(up, 4)),
            words(2.0, up.end - 8.0, "µm", class_="muted"),
            *(
                words(across(float(k)), up.start + 12.0 * (n + 1) + 1.0, word, "middle")
                for k, text in enumerate(postures)
                for n, word in enumerate(text.split())
            ),
            words(width - 10, 16.0, one.words, "end", "strong"),
        ]
        for number, values in enumerate(microns, start=1):
            for turn in sorted({cycle[k] for k in chosen}):
                shift = 0.09 * (turn - 2.5)
                points = [
                    (across(postures.index(posture[k]) + shift), up(float(values[k])))
                    for k in chosen
                    if cycle[k] == turn
                ]
                last = number == len(microns)
                parts += [tag("polyline", points=_path(points), class_="thread")] if last else []
                parts += [mark(x, y, turn - 1, "mark" if last else "mark open") for x, y in points]
        worst = max(chosen, key=lambda k: abs(microns[-1][k]))
        finding = (
            f"Residuals of {one.words}: the largest is at posture {posture[worst]}, cycle"
            f" {cycle[worst]}."
        )
        body = tag("g", *parts, class_=f"c-{AXES[one.leg]}")
        name = f"residual-{AXES[one.direction]}{AXES[one.leg]}"
        panels.append(svg(name, width, height, f"Residuals, {one.words}", finding, body))
    return tuple(panels)


# --- maps in colours ----------------------------------------------------------------------------

CLASSES = 7  # colours of a scale
_SIZE, _LEFT, _ABOVE = 200.0, 40.0, 26.0  # of a map, and its place in the picture
_STRIP = 48.0  # of the legend below it


def class_limits(lowest: float, largest: float) -> Floats:
    """Limits between colours from below the smallest value to above the largest, (CLASSES + 1,).

    Equal steps of a round length; they begin at a whole number of steps.
    """
    least = max((largest - lowest) / CLASSES, 1e-3 * largest, 1e-9)
    power = 10.0 ** math.floor(math.log10(least))
    for factor in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0, 15.0, 20.0):
        first = math.floor(lowest / (factor * power) + 1e-9)
        if (first + CLASSES) * factor * power >= largest * (1.0 - 1e-9):
            break
    return np.arange(first, first + CLASSES + 1.0) * factor * power


def _classes(values: Floats, limits: Floats) -> Ints:
    """Number of each value's colour."""
    return np.clip(np.searchsorted(limits, values, "right") - 1, 0, CLASSES - 1)


def _map(
    name: str,
    title: str,
    finding: str,
    ends_mm: tuple[float, float],
    limits: Floats,
    unit: str,
    drawn: Iterator[Html],
) -> Html:
    """A square seen from above, with its axes, and the scale of colours below."""
    bottom, middle, box = _ABOVE + _SIZE, _LEFT + _SIZE / 2.0, _SIZE / CLASSES
    low, high = (tick_text(end, 1.0) for end in ends_mm)
    step = float(limits[1] - limits[0])
    body = tag(
        "g",
        *drawn,
        words(_LEFT, 14, title, class_="strong"),
        words(_LEFT, bottom + 14, low, class_="tick"),
        words(middle, bottom + 14, "x, mm", "middle", "muted"),
        words(_LEFT + _SIZE, bottom + 14, high, "end", "tick"),
        words(_LEFT - 7, bottom - 2, low, "end", "tick"),
        words(_LEFT - 7, _ABOVE + _SIZE / 2 + 4, "y, mm", "end", "muted"),
        words(_LEFT - 7, _ABOVE + 9, high, "end", "tick"),
        *(rectangle(_LEFT + k * box, bottom + 24, box, 12, f"heat h{k}") for k in range(CLASSES)),
        words(_LEFT, bottom + _STRIP, tick_text(float(limits[0]), step), "middle", "tick"),
        words(middle, bottom + _STRIP, unit, "middle", "muted"),
        words(_LEFT + _SIZE, bottom + _STRIP, tick_text(float(limits[-1]), step), "end", "tick"),
        class_="map",
    )
    return svg(name, _LEFT + _SIZE + 10.0, bottom + _STRIP + 8.0, title, finding, body)


def workspace_maps(found: WorkspaceError) -> tuple[Html, ...]:
    """Error of the tool position in slices, the highest first: three before, three after.

    All have one scale of colours, which begins at zero.
    """
    limits = class_limits(0.0, max(float(found.before_mm.max()), float(found.after_mm.max())))
    ends = float(found.axis_mm[0]), float(found.axis_mm[-1])
    panels = []
    for when, error in (("before", found.before_mm), ("after", found.after_mm)):
        for k in reversed(range(len(found.levels_mm))):
            title = f"{when.capitalize()}, z = {tick_text(float(found.levels_mm[k]), 1.0)} mm"
            finding = f"Tool-position error {when} the parameters are entered, in a slice."
            cells = _cells(_classes(error[k], limits))
            panels.append(_map(f"workspace-{when}-{k}", title, finding, ends, limits, "mm", cells))
    return tuple(panels)


def _cells(number: Ints) -> Iterator[Html]:
    """Squares of one colour, (n, n), y upwards; neighbours in a row are one rectangle."""
    count = len(number)
    size = _SIZE / count
    for row, classes in enumerate(number.tolist()):
        y, first = _ABOVE + _SIZE - (row + 1) * size, 0
        for k in range(1, count + 1):
            if k == count or classes[k] != classes[first]:
                colour = f"heat h{classes[first]}"
                yield rectangle(_LEFT + first * size, y, (k - first) * size, size, colour)
                first = k


def bed_maps(title: str, place_mm: Floats, left_mm: Mapping[str, Floats]) -> tuple[Html, ...]:
    """What is left of each touch of a bed, one map for each model, all with the same colours.

    Args:
        title: of all of them.
        place_mm: of n touches, shape (n, 2).
        left_mm: model → measured − modelled, shape (n,).
    """
    most = max(1.0, *(1000.0 * float(np.abs(left).max()) for left in left_mm.values()))
    limits = class_limits(-most, most)
    # From as far below zero as above it: the middle colour means that nothing is left.
    limits = np.asarray(limits - (limits[0] + limits[-1]) / 2.0)
    reach = float(np.abs(place_mm).max(initial=1.0))
    size = max(min(0.42 * _SIZE / len(place_mm) ** 0.5, 9.0), 2.5)
    across = (_LEFT + _SIZE / 2.0 + 0.47 * _SIZE / reach * place_mm[:, 0]).tolist()
    up = (_ABOVE + _SIZE / 2.0 - 0.47 * _SIZE / reach * place_mm[:, 1]).tolist()
    panels = []
    for number, (model, left) in enumerate(left_mm.items()):
        colours = _classes(1000.0 * left, limits).tolist()
        dots = (
            tag("circle", cx=x, cy=y, r=size, class_=f"heat h{k}")
            for x, y, k in zip(across, up, colours, strict=True)
        )
        name = f"bed-{number}-{title.replace(' ', '-')}".rstrip("-")
        heading = ", ".join(filter(None, (model, title)))
        finding = f"What is left of each touch, {heading}."
        panels.append(_map(name, heading, finding, (-reach, reach), limits, "µm", dots))
    return tuple(panels)


# --- the machine --------------------------------------------------------------------------------

_CENTRE = np.array([180.0, 186.0])
_LEG = 128.0  # length of a leg in the picture
# Where the axes x, y, z point on the paper.
_ON_PAPER = np.array([[-0.84, 0.50], [0.84, 0.50], [0.0, -1.0]])


def machine_sketch(
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
    parts: list[Html] = []
    for leg, axis in enumerate(AXES):
        low, high = ((leg_length_mm + limit) / leg_length_mm for limit in joint_limits_mm)
        # Even displacements of the carriage leave the picture readable only up to here.
        end = min(high, 1.0 + 34.0 / _LEG)
        across = np.array([-_ON_PAPER[leg, 1], _ON_PAPER[leg, 0]])
        side = 4.0 * across / np.linalg.norm(across)
        joint, tool = _at(leg, 1.0), _at(leg, 0.0)
        x, y = (joint - 7.0).tolist()
        at, below = _at(leg, end + 0.10).tolist()
        beside = 2.5 * side
        drawn = (
            _straight(_at(leg, low), _at(leg, end), "rail"),
            _straight(joint + side, tool + side, "bar"),
            _straight(joint - side, tool - side, "bar"),
            tag("rect", x=x, y=y, width=14, height=14, rx=2, class_="carriage"),
            words(at, below + 4.0, axis, "middle", "axis"),
            _straight(_at(leg, low) + beside, _at(leg, end) + beside, "fault")
            if leg in rails
            else None,
        )
        parts.append(tag("g", *drawn, class_=f"c-{axis}"))
    x, y = _CENTRE.tolist()
    parts.append(tag("circle", cx=x, cy=y, r=8.0, class_="tool"))
    parts += [_gauge(*gauge, (gauge[0], gauge[1]) in faults) for gauge in gauges]
    finding = "Three legs run from the tool in the middle to carriages on the rails x, y and z."
    for what, marked in (
        ("readings of", [Series(*fault).words for fault in sorted(faults)]),
        ("axis", [AXES[rail] for rail in sorted(rails)]),
    ):
        finding += f" Marked, because of a fault: {what} {'; '.join(marked)}." if marked else ""
    return svg("machine", 360.0, 296.0, "The machine and its gauges", finding, *parts)


def _at(leg: int, fraction: float) -> Floats:
    return np.asarray(_CENTRE + fraction * _LEG * _ON_PAPER[leg])


def _straight(start: Floats, stop: Floats, class_: str) -> Html:
    (x1, y1), (x2, y2) = start.tolist(), stop.tolist()
    return line(x1, y1, x2, y2, class_)


def _gauge(leg: int, direction: int, place: float, faulty: bool) -> Html:
    """A dial on the side towards which its direction points: that way its reading grows."""
    touch = _at(leg, 1.0 - place)
    toward = _ON_PAPER[direction] / np.linalg.norm(_ON_PAPER[direction])
    dial = touch + 40.0 * toward
    x, y = dial.tolist()
    return tag(
        "g",
        _straight(touch + 5.0 * toward, dial - 12.0 * toward, "plunger"),
        tag("circle", cx=x, cy=y, r=17.0, class_="fault") if faulty else None,
        tag("circle", cx=x, cy=y, r=12.0, class_="dial"),
        words(x, y + 4, f"+{AXES[direction]}", "middle", "small"),
        class_=f"c-{AXES[leg]}",
    )


# --- causes that can be distinguished -----------------------------------------------------------

# Below so many σ two causes: cannot, can hardly, can mostly be distinguished; above: surely.
_SHADES = ((1.0, "█"), (2.0, "▓"), (4.0, "▒"), (math.inf, " "))
_MOST = 99  # σ beyond which the number says nothing more
_NOTHING = "–"
SEPARATION_LEGEND = (
    "Distinct? █ below 1 σ: no; ▓ below 2: hardly; ▒ below 4: mostly; else yes",
    f"{_NOTHING}: from nothing wrong at all; {_MOST}: or more",
)


def separation_lines(names: Sequence[str], sigma: Floats, trace: Floats) -> tuple[str, ...]:
    """How far each cause stands from the others: the lower half of a table, in characters.

    Each cell has a shade, the darker the less can the two be distinguished, and its number.

    Args:
        names: of c causes, at most 26.
        sigma: between each pair, shape (c, c).
        trace: of each from nothing wrong, shape (c,).

    >>> import numpy as np
    >>> print("\\n".join(separation_lines(["a", "bc"], np.array([[0, 3.2], [3.2, 0]]), np.ones(2))))
            –   A
    A a   ▓ 1
    B bc  ▓ 1 ▒ 3
    Distinct? █ below 1 σ: no; ▓ below 2: hardly; ▒ below 4: mostly; else yes
    –: from nothing wrong at all; 99: or more
    """

    def cell(value: float) -> str:
        shade = next(shade for limit, shade in _SHADES if value < limit)
        number = "<1" if value < 1.0 else str(min(int(value), _MOST))
        return f"{shade}{number:>2} "

    room = max(map(len, names), default=0)
    letters = string.ascii_uppercase[: len(names)]
    head = "".join(f"  {letter} " for letter in (_NOTHING, *letters[:-1]))
    lines = [f"{'':{room + 4}}{head}".rstrip()]
    for k, (letter, name) in enumerate(zip(letters, names, strict=True)):
        cells = "".join(map(cell, [float(trace[k]), *sigma[k, :k].tolist()]))
        lines.append(f"{letter} {name:<{room}}  {cells}".rstrip())
    return (*lines, *SEPARATION_LEGEND)
