"""Figures of a page, with the same in characters: measured values, residuals, causes, the machine.

Every number that a picture writes, but those of its axes, is one that it was given.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, groupby, zip_longest
from typing import Self

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.result import FoundCause, FoundPattern
from orthoglide_cal.model.machine import Bed
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.model.model import Estimate
from orthoglide_cal.model.plan import Bools, Floats, Ints
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case, comparison_words, position_words, size_words
from orthoglide_cal.report.document import Html, tag
from orthoglide_cal.report.sentences import pattern_name, pattern_words
from orthoglide_cal.results.answer import Residual
from orthoglide_cal.words import number, plain, short, signed, two_figures

# --- parts of figures: lengths are CSS pixels at natural size, colours are classes of the page ---

_LETTER = 7.0  # width of a letter or digit


@dataclass(frozen=True)
class Scale:
    """Maps low … high to start … end, linearly."""

    low: float
    high: float
    start: float
    end: float

    @classmethod
    def around(cls, values: Sequence[float], start: float, end: float) -> Self:
        """A scale that holds the values with a little room."""
        low, high = min(values), max(values)
        room = 0.06 * (high - low) or 1.0
        return cls(low - room, high + room, start, end)

    def __call__(self, value: float) -> float:
        """Place of a value."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self) -> list[tuple[float, str, str]]:
        """Place, class and number of about four grid lines at round numbers."""
        step = round_up(0.999 * (self.high - self.low) / 4.0, 1.0, 2.0, 2.5, 5.0)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        kinds = ((k * step, "grid" if k else "zero") for k in range(first, last + 1))
        return [(self(value), kind, number(value)) for value, kind in kinds]


def round_up(size: float, *factors: float) -> float:
    """The smallest of these factors times a power of ten that is no smaller than a size."""
    power = 10.0 ** math.floor(math.log10(size))
    sizes = (factor * power for factor in (*factors, 10.0))
    return next(candidate for candidate in sizes if candidate >= size * (1.0 - 1e-9))


def svg(
    width: float,
    height: float,
    title: str,
    finding: str,
    parts: Iterable[Html | None],
    class_: str | None = None,
) -> Html:
    """A picture with its text alternative: what it is, and what one sees in it."""
    return tag(
        "svg",
        tag("title", title),
        tag("desc", finding),
        tag("g", *parts, class_=class_),
        viewBox=f"0 0 {width:g} {height:g}",
        role="img",
        xmlns="http://www.w3.org/2000/svg",
    )


def words(
    x: float, y: float, content: str, anchor: str = "start", class_: str | None = None
) -> Html:
    """A text; `y` is its base line."""
    return tag("text", content, x=x, y=y, text_anchor=anchor, class_=class_)


def line(start: Iterable[float], stop: Iterable[float], class_: str) -> Html:
    """A straight line between two points."""
    (x1, y1), (x2, y2) = start, stop
    return tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=class_)


def points(places: Iterable[Iterable[float]]) -> str:
    """The corners of a polygon or polyline."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def thread(places: Iterable[Iterable[float]]) -> Html:
    """A thin line through places."""
    return tag("polyline", points=points(places), class_="thread")


def arrow(start: Floats, stop: Floats) -> Html:
    """A line with a head at its end: something is to be moved that way."""
    along = (stop - start) / np.linalg.norm(stop - start)
    across = 4.0 * np.array([-along[1], along[0]])
    behind = stop - 8.0 * along
    head = points([stop, behind + across, behind - across])
    return tag("g", line(start, behind, "fault"), tag("polygon", points=head, class_="head"))


def rectangle(
    x: float, y: float, width: float, height: float, class_: str, colour: str | None = None
) -> Html:
    """A rectangle, filled as its class is, or with a colour of the style sheet."""
    fill = f"var(--{colour})" if colour else None
    return tag("rect", x=x, y=y, width=width, height=height, class_=class_, fill=fill)


def mark(x: float, y: float, shape: int, class_: str = "mark", size: float = 3.6) -> Html:
    """A mark: 0 circle, 1 triangle, 2 square, 3 diamond; then again."""
    corners = {
        1: ((0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)),
        2: ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
        3: ((0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)),
    }.get(shape % 4)
    if corners is None:
        return tag("circle", cx=x, cy=y, r=size, class_=class_)
    places = points((x + size * a, y + size * b) for a, b in corners)
    return tag("polygon", points=places, class_=class_)


def below(places: Sequence[float], texts: Sequence[str], y: float) -> Iterator[Html]:
    """Texts of an axis at ascending places, their middles: the last, then what has room."""
    free = math.inf  # where the one on the right begins
    for x, text in reversed([*zip(places, texts, strict=True)]):
        half = 0.5 * _LETTER * len(text)
        if x + half + 4.0 <= free:
            free = x - half
            yield words(x, y, text, "middle", "tick")


def upright(up: Scale, width: float, unit: str, title: str) -> Iterator[Html]:
    """The upright axis of a panel, with its unit, and the panel's title."""
    ticks = up.ticks()
    yield from (line((40.0, y), (width - 6.0, y), kind) for y, kind, _ in ticks)
    yield from (words(36.0, y + 3.5, text, "end", "tick") for y, _, text in ticks)
    yield words(2.0, 14.0, unit, class_="muted")
    yield words(width - 6.0, 14.0, title, "end", "strong")


# --- maps in colours ----------------------------------------------------------------------------

CLASSES = 7  # colours of a scale
_SIZE, _LEFT, _ABOVE = 168.0, 42.0, 22.0  # of a map, and its place in the picture
_BED, _BESIDE, _OVER = 232.0, 50.0, 40.0  # the same of a bed
_STANDS_OUT = 4.0  # robust standard deviations, beyond which one touch is ringed


def class_limits(largest: float, around_zero: bool = False) -> Floats:
    """Limits between colours in equal round steps, (CLASSES + 1,), up to the largest value.

    From zero, or from as far below zero as above it: the middle colour then means nothing.
    """
    steps, first = (CLASSES // 2, CLASSES / 2.0) if around_zero else (CLASSES, 0.0)
    step = round_up(max(largest / steps, 1e-9), 1.0, 2.0, 4.0, 6.0, 8.0)  # their halves are short
    return (np.arange(CLASSES + 1.0) - first) * step


def _classes(values: Floats, limits: Floats) -> Ints:
    return np.clip(np.searchsorted(limits, values, "right") - 1, 0, CLASSES - 1)


def _axes(left: float, above: float, size: float, ends_mm: tuple[float, float]) -> Iterator[Html]:
    """Numbers at the ends of both axes of a square, and their names."""
    low, high = (number(round(end)) for end in ends_mm)
    bottom = above + size
    yield words(left, bottom + 14, low, class_="tick")
    yield words(left + size / 2, bottom + 14, "x, mm", "middle", "muted")
    yield words(left + size, bottom + 14, high, "end", "tick")
    yield words(left - 5, bottom - 2, low, "end", "tick")
    yield words(left - 5, above + size / 2 + 4, "y, mm", "end", "muted")
    yield words(left - 5, above + 9, high, "end", "tick")


def _colours(left: float, above: float, limits: Floats, unit: str, kind: str) -> Iterator[Html]:
    """The scale of the colours, with the number of every limit that has room."""
    places = [left + 34.0 * k for k in range(CLASSES + 1)]
    for k in range(CLASSES):
        yield rectangle(places[k], above, 34.0, 12, "heat", f"{kind}{k}")
    yield from below(places, [*map(number, limits)], above + 26)
    yield words(places[-1] + 8, above + 10, unit, class_="muted")


def workspace_maps(
    views: Sequence[tuple[str, Floats, float, Sequence[float]]],
    ends: tuple[float, float],
    limit_mm: float | None = None,
) -> Iterator[Html]:
    """Error of the tool position in slices, the highest first; then the one scale of their colours.

    Args:
        views: when, errors (slices, y, x), the largest of the whole cube, and where that is [mm].
        ends: of the cube, along each axis [mm].
        limit_mm: drawn as a contour; None for none.
    """
    limits = class_limits(max(float(error.max()) for _, error, *_ in views))
    across = Scale(*ends, 0.0, _SIZE)
    for when, error, worst_mm, worst in views:
        finding = f"Tool-position error in a slice of the workspace, {when}. In the whole cube at"
        finding += f" most {two_figures(worst_mm)} mm, at {position_words(worst, 0)}."
        x_mm, y_mm, z_mm = worst
        for k, level in reversed([*enumerate(np.linspace(*ends, len(error)).tolist())]):
            title = f"{when}, z = {number(round(level))} mm"
            body = [*_cells(_classes(error[k], limits)), *_axes(_LEFT, _ABOVE, _SIZE, ends)]
            body += [] if limit_mm is None else _contour(error[k] > limit_mm)
            body.append(words(2.0, 14, title, class_="strong"))
            if abs(z_mm - level) < 1e-6:
                x, y = _LEFT + across(x_mm), _ABOVE + _SIZE - across(y_mm)
                body.append(tag("circle", cx=x, cy=y, r=5.0, class_="worst"))
            yield svg(216.0, _ABOVE + _SIZE + 20.0, title, finding, body)
    title, finding = "Colours of the maps", "From zero upwards, in mm."
    yield svg(276.0, 30.0, title, finding, _colours(6.0, 2.0, limits, "mm", "h"))


def _cells(number: Ints) -> Iterator[Html]:
    """Squares of one colour, (n, n), y upwards; neighbours in a row are one rectangle."""
    size = _SIZE / len(number)
    for row, classes in enumerate(number.tolist()):
        y, first = _ABOVE + _SIZE - (row + 1) * size, 0
        for colour, run in groupby(classes):
            many = len(list(run))
            yield rectangle(_LEFT + first * size, y, many * size, size, "heat", f"h{colour}")
            first += many


def _contour(beyond: Bools) -> Iterator[Html]:
    """Edges between the squares that are beyond a limit and those that are not, (n, n)."""
    size = _SIZE / len(beyond)
    for turned, squares in enumerate((beyond, beyond.T)):
        for row, k in np.argwhere(squares[:, 1:] != squares[:, :-1]).tolist():
            edge = (k + 1, row), (k + 1, row + 1)
            places = (place[::-1] if turned else place for place in edge)
            start, stop = ((_LEFT + x * size, _ABOVE + _SIZE - y * size) for x, y in places)
            yield line(start, stop, "due")


def bed_map(
    title: str,
    place_mm: Floats,
    left_mm: Floats,
    bed: Bed,
    largest_um: float | None = None,
    ringed: Bools | None = None,
) -> Html:
    """Residuals of the touches of a bed.

    Args:
        place_mm: of n touches, shape (n, 2).
        left_mm: measured − modelled, shape (n,).
        bed: its radius, and the directions of towers a, b and c.
        largest_um: the end of the scale of several maps; None: of this one.
        ringed: touches that are wrong, shape (n,); None: those that stand out.
    """
    reach = max(float(np.abs(place_mm).max(initial=1.0)), bed.radius_mm)
    scale, x0, y0 = 0.5 * _BED / reach, _BESIDE + _BED / 2.0, _OVER + _BED / 2.0
    size = max(min(0.42 * _BED / len(place_mm) ** 0.5, 10.0), 3.0)
    microns = 1000.0 * left_mm
    usual = 1.4826 * float(np.median(np.abs(microns - np.median(microns))))
    out = np.abs(microns) > max(_STANDS_OUT * usual, 1.0)
    most = largest_um or float(np.abs(microns[~out]).max(initial=1.0))
    limits = class_limits(most, around_zero=True)
    body = [
        tag("circle", cx=x0, cy=y0, r=scale * bed.radius_mm, class_="bed"),
        words(_BESIDE - 40, 14, title, class_="strong"),
        *_axes(x0 - scale * reach, _OVER, scale * 2.0 * reach, (-reach, reach)),
        *_colours(_BESIDE, _OVER + _BED + 24, limits, "µm", "d"),
    ]
    places = (np.array([x0, y0]) + scale * place_mm * [1.0, -1.0]).tolist()
    ringed = out if ringed is None else ringed
    for (x, y), k, rings in zip(places, _classes(microns, limits), ringed, strict=True):
        body.append(tag("circle", cx=x, cy=y, r=size, class_="heat", fill=f"var(--d{k})"))
        body += [tag("circle", cx=x, cy=y, r=size + 2.5, class_="ring")] if rings else []
    body.append(words(x0 + _BED / 2.0, _OVER + _BED - 4, "front", "end", "muted halo"))  # no touch
    for tower, angle in zip("abc", map(math.radians, bed.tower_angles_deg), strict=True):
        away = _BED / 2 + 12
        x, y = x0 + away * math.cos(angle), y0 - away * math.sin(angle)
        body.append(words(x, y + 5, tower, "middle", "axis halo"))
    largest = int(np.argmax(np.abs(microns)))
    finding = f"Residuals of the touches: at most {signed(float(microns[largest]), 1)} µm,"
    finding += f" at {position_words(place_mm[largest], 0)}; {int(ringed.sum())} ringed."
    return svg(324.0, _OVER + _BED + 58.0, title, finding, body)


# --- causes at the machine -----------------------------------------------------------------------

_NEAR, _FAR = 52.0, 80.0  # size of the largest gap, and length of half a rail in the picture
# Where the axes x, y, z point on the paper; and unit vectors there.
_ON_PAPER = np.array([[-0.84, 0.50], [0.84, 0.50], [0.0, -1.0]])
_TOWARDS = _ON_PAPER / np.linalg.norm(_ON_PAPER, axis=1, keepdims=True)


def shims(id: str, sizes: Iterable[Estimate]) -> list[tuple[str, float, str]]:
    """Rails to move, by how many mm and where to ("+z"); empty if no size is that of a gap."""
    screws = ((CAUSES[id].adjustment(size.name), size.value) for size in sizes)
    return [
        (AXES[screw.leg], abs(gap), f"{'-' if gap < 0.0 else '+'}{screw.along}")
        for screw, gap in screws
        if screw and screw.along
    ]


def rails_sketch(gaps_mm: Mapping[str, float], moves: Sequence[tuple[str, float, str]]) -> Html:
    """The three rails as they pass each other, gaps enlarged, with an arrow for each of `shims`.

    `gaps_mm`: "xy" → how far rail x lies above rail y, along z; and so on.
    """
    most = max(map(abs, gaps_mm.values())) or 1.0
    pairs = [[AXES.index(axis) for axis in name] for name in gaps_mm]
    through = np.zeros((3, 3))  # a point of each rail [px]
    for (first, second), gap in zip(pairs, gaps_mm.values(), strict=True):
        half = 0.5 * _NEAR * gap / most
        through[[first, second], 3 - first - second] += half, -half

    def on_paper(place: Floats) -> Floats:
        return np.asarray(np.array([164.0, 120.0]) + place @ _ON_PAPER)

    parts: list[Html] = []
    taken: list[Floats] = []  # places on the paper where something is drawn
    for rail, axis in enumerate(AXES):
        start, stop = (on_paper(through[rail] + far * np.eye(3)[rail]) for far in (-_FAR, _FAR))
        x, y = stop + 12.0 * _TOWARDS[rail]
        named = words(x, y + 4.0, axis, "middle", "axis")
        carriage = rectangle(start[0] - 7.0, start[1] - 7.0, 14.0, 14.0, "carriage")
        parts.append(tag("g", line(start, stop, "rail"), carriage, named, class_=f"c-{axis}"))
        taken += [*np.linspace(start, stop, 29)]
        for _, mm, along in (move for move in moves if move[0] == axis):
            way = _TOWARDS[AXES.index(along[1])] * (-1.0 if along[0] == "-" else 1.0)
            x, y = start + 46.0 * way
            parts.append(arrow(start + 9.0 * way, start + 34.0 * way))
            parts.append(words(x, y + 4, f"{plain(mm, 2)} mm", "middle", "halo"))
            taken += [*np.linspace((x - 24.0, y), (x + 24.0, y), 9)]
    middles: list[Floats] = []
    for first, second in pairs:
        # The common perpendicular: where each rail passes the other.
        ends = through[[first, second]].copy()
        ends[0, first], ends[1, second] = through[second, first], through[first, second]
        one, other = on_paper(ends)
        taken += [*np.linspace(one, other, 9)]
        middles.append((one + other) / 2.0)
        parts.append(line(one, other, "fault"))
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = np.stack((np.cos(turns), np.sin(turns)), axis=-1)
    around = np.concatenate([size * circle for size in (16.0, 24.0, 32.0)])
    for name, middle in zip(gaps_mm, middles, strict=True):
        # Where nothing else is near, and near the gap itself.
        free = np.linalg.norm((middle + around)[:, None] - np.array(taken), axis=-1).min(axis=1)
        x, y = place = middle + around[np.argmax(np.minimum(free, 13.0))]
        taken.append(place)
        parts.append(words(x, y + 4, name, "middle", "strong halo"))
    gaps = ", ".join(f"{name} {signed(gap, 3)}" for name, gap in gaps_mm.items())
    moved = ", ".join(f"rail {r} by {plain(mm, 2)} mm towards {along}" for r, mm, along in moves)
    finding = f"Three rails that should meet in one point. Gaps, mm: {gaps}. Move {moved}."
    return svg(328.0, 244.0, "The rails where they pass each other", finding, parts)


_PART = 40.0  # height of the picture of one parameter


def parameter_sketch(name: str, sizes: Sequence[Estimate]) -> Html:
    """Place of an axis, a bar or a carriage as it should be (dashed) and as it is, enlarged.

    Names of `sizes`: "y_x" (a bar of leg x, along y), "xy" (by how much the angle between two axes
    is less than 90°) or "x" (a carriage).
    """
    most = max(abs(size.value) for size in sizes) or 1.0
    parts, listed = [], []
    for k, size in enumerate(sizes):
        base = (k + 1) * _PART - 10.0
        place, text = size.name, size_words(size.value, size.expanded, size.unit)
        if place[1:2] == "_":
            place = f"leg {place[2]}, direction {place[0]}"
        listed.append(f"{place} {text}")
        named = words(2.0, base - 11.0, place, class_="strong"), words(2.0, base + 2.0, text)
        drawn = _parameter(size.name, size.value / most, base)
        parts.append(tag("g", *named, *drawn, class_=f"c-{size.name[-1]}"))
    finding = f"Dashed as it should be, solid as it is: {'; '.join(listed)}."
    return svg(328.0, _PART * len(sizes) + 6.0, name, finding, parts)


def _parameter(parameter: str, share: float, base: float) -> Iterator[Html]:
    """One of them, `share` of the largest size, above the height `base`."""
    left, right = 140.0, 284.0
    if "_" in parameter:  # a bar, from the carriage to the tool
        base -= 10.0
        yield line((left, base), (right, base), "ideal")
        yield line((left, base), (right, base - 16.0 * share), "bar")
        yield rectangle(left - 7.0, base - 7.0, 14.0, 14.0, "carriage")
        yield words(right + 24.0, base + 4.0, f"+{parameter[0]} ↑", "middle")
    elif len(parameter) > 1:  # the second of two axes
        corner, x, y = (200.0, base), 200.0 + 12.0 * share, base - 28.0
        yield line(corner, (right, base), "ink")
        yield line(corner, (200.0, y), "ideal")
        yield line(corner, (x, y), "bar")
        yield words(right + 14.0, base + 5.0, parameter[0], "middle", "axis")
        yield words(x + 14.0, y + 12.0, parameter[1], "middle", "axis")
    else:  # a carriage along its rail
        moved, above = np.array([34.0 * share, 0.0]), np.array([212.0, base - 17.0])
        yield line((left, base), (right, base), "rail")
        yield rectangle(203.0, base - 9.0, 18.0, 18.0, "ideal")
        yield rectangle(203.0 + moved[0], base - 9.0, 18.0, 18.0, "outline")
        yield arrow(above, above + moved)
        yield words(right + 14.0, base + 5.0, parameter, "middle", "axis")


# Below the signs of a bed.
_BED_LEGEND = (
    "  Seen from above, y upwards: + the probe triggered too high, − too low;",
    "  · noise, + − over 2σ, ▲ ▼ over 4σ.",
)
_MOST_SERIES = 6  # on a screen; of columns two more
_MOST_DRAWN, _MOST_GAUGES = 3, 2  # parameters of a cause, and gauges whose readings it spoils
_RINGED = "Ringed: beyond four robust standard deviations."
# Pattern → what it depends on if not on time: a column of the residuals.
_DEPENDS = {"repeats": "displacement_mm", "hysteresis": "moved_mm", "temperature": "temperature_c"}
# Such a column → its name on an axis.
_AXIS = {
    "minutes": "min",
    "displacement_mm": "carriage at, mm",
    "moved_mm": "plunger moved by, mm",
    "temperature_c": "°C",
}
_CELLS = 17  # of a bed in signs, along x and along y

# --- differences -------------------------------------------------------------------------------

_WIDE, _TOP, _ROW = 356.0, 24.0, 22.0  # of a picture with a line for each difference


def differences_figure(
    rows: Sequence[tuple[str, float, float, float, float | None]],
    rms_mm: Sequence[float],
    single: bool,
    limit_mm: float | None,
    outcomes: Sequence[str] = (),
) -> doc.Figure:
    """A row for each difference: as found ○ → expected ■ → as left ●, with U of the last.

    Args:
        rows: name, found, expected, U of the last, measured (None if nothing was yet) [mm].
        rms_mm: of all as found, expected and left.
        single: they are of the tool end against the joint end.
        limit_mm: largest deviation allowed; None where nobody said.
        outcomes: by the limit, of each that was measured afterwards; below the names.
    """
    names, first, expected, expanded, after = zip(*rows, strict=True)
    measured = after[0] is not None
    sizes = {"found": first, "expected": expected, **({"as left": after} if measured else {})}
    last = [*sizes.values()][-1]
    low, high = np.subtract(last, expanded), np.add(last, expanded)
    columns: dict[str, Sequence[str]] = {"": names}
    columns |= {when: [signed(mm, 3) for mm in values] for when, values in sizes.items()}
    columns["± U"] = [plain(mm, 3) for mm in expanded]
    columns |= {"limit": outcomes} if outcomes else {}
    # Columns of numbers, by their right edges.
    edges = [194.0, 252.0, _WIDE - 2.0] if measured else [_WIDE - 108.0, _WIDE - 2.0]
    left, row_px = (70.0, _ROW + 5.0) if outcomes else (42.0, _ROW)
    top, bottom = _TOP - 4.0, _TOP + row_px * len(rows)
    least = max(limit_mm or 0.0, 0.02)
    across = Scale.around([*first, *expected, *low, *high, -least, least], left, edges[0] - 46.0)
    kind, meaning = comparison_words(single)
    key = "○ as found → ■ expected" + (" → ● as left" if measured else " once entered")
    key, parts = f"{key}, with U (95 %). {meaning}", list[Html]()
    if limit_mm is not None:
        key += f" Dashed: the limit, ±{limit_mm:g} mm."
        start, stop = across(-limit_mm), across(limit_mm)
        parts.append(rectangle(start, top, stop - start, bottom - top, "allowed"))
    places, kinds, texts = zip(*across.ticks(), strict=True)
    parts += (line((x, top), (x, bottom), kind) for x, kind in zip(places, kinds, strict=True))
    parts += below(places, texts, bottom + 14)
    parts.append(words((across.start + across.end) / 2, bottom + 28, "mm", "middle", "muted"))
    *titles, title = sizes
    for x, when in zip(edges, (*titles, f"{title} ± U"), strict=True):
        parts.append(words(x, 12, when, "end", "muted"))
    listed = []
    for k, (name, *cells) in enumerate(zip(*columns.values(), strict=True)):
        y = _TOP + row_px * (k + 0.5)
        start, stop, *marks = (across(values[k]) for values in sizes.values())
        ends = across(low[k]), across(high[k])
        numbers, (u, *outcome) = cells[: len(sizes)], cells[len(sizes) :]
        numbers[-1] += f" ± {u}"
        listed.append(f"{name} {', '.join([*numbers, *outcome])}")
        parts += [
            words(2, y + (-2 if outcomes else 4), name, class_="strong"),
            *(words(2, y + 10, text) for text in outcome),
            *(words(x, y + 4, text, "end") for x, text in zip(edges, numbers, strict=True)),
            tag(
                "g",
                line((start, y), (stop, y), "thread"),
                line((ends[0], y), (ends[1], y), "whisker"),
                *(line((x, y - 5), (x, y + 5), "whisker") for x in ends),
                mark(start, y, 0, "mark open", 5.0),
                mark(stop, y, 2, "mark", 4.2),
                *(mark(x, y, 0, "mark", 4.6) for x in marks),
                class_=f"c-{name.partition('_')[2][:1]}",
            ),
        ]
    seen = f"{', '.join(sizes).capitalize()}, mm: {'; '.join(listed)}."
    picture = svg(_WIDE, bottom + 30.0, "Differences, before and after", seen, parts)
    rms = " → ".join(plain(size, 3) for size in rms_mm)
    whole = f"Differences, {kind}: {rms} mm r.m.s."
    return doc.Figure([picture], 0, key, whole, [whole, doc.Grid.of(columns)])


# --- residuals ---------------------------------------------------------------------------------


def brief_residuals(case: Case) -> list[doc.Block]:
    """Residuals in characters; nothing where a screen has no room."""
    if case.answer.input.kind != DataKind.READINGS:
        return [readings_table(case)]
    if _on_bed(case):
        return []
    title, grid = _by_leg(case)
    many = len(grid.rows) > _MOST_SERIES or len(grid.head) > _MOST_SERIES + 2
    return [] if many else [title, grid]


def residual_blocks(case: Case) -> Iterator[doc.Block]:
    """Measured − modelled without and with the causes, in figures and characters."""
    left, noise_mm = _left(case), case.machine.instrument.noise_mm
    for k, pattern in enumerate(case.answer.beyond):
        yield _pattern_figure(case, pattern, k)
    if _on_bed(case):
        maps, signs, bed = [], list[str](), case.machine.bed
        measured = _column(case.answer.residuals, "measured_mm")
        for title, touches, place_mm in _surfaces(case):
            # Without their mean: the first layer's height is set apart.
            mean_mm = measured[touches].mean()
            maps.append(bed_map(f"before{title}", place_mm, measured[touches] - mean_mm, bed))
            for model, values in left.items():
                few = model.replace(" and ", ", ", model.count(" and ") - 1)
                heading = f"after, {few}{title}"
                maps.append(bed_map(heading, place_mm, values[touches], bed))
                signs += [f"{heading}:", *_signs(place_mm, values[touches], noise_mm)]
        plain = doc.Listing((*signs, *_BED_LEGEND))
        yield doc.Figure(maps, 2, f"Each map has its own scale. {_RINGED}", plain=[plain])
        yield readings_table(case, distances=True)
    elif case.answer.input.kind == DataKind.READINGS:
        key = "Cycle 1 ●, 2 ▲, 3 ■, 4 ◆. Band: gauge's noise (95 %)."
        key = f"Open: {', filled: '.join(left)}. {key}" if len(left) > 1 else key
        panels = reading_panels(case.answer.residuals, left, noise_mm=noise_mm)
        yield doc.Figure(panels, key=key, plain=_by_leg(case))
    else:
        yield readings_table(case)


def reading_panels(
    rows: Sequence[Residual],
    left_mm: Mapping[str, Floats],
    *,
    noise_mm: float = 0.0,
    over: str = "",
    effect_mm: tuple[Floats, Floats] | None = None,
    shown: Collection[int] = (),
    ringed: Collection[int] = (),
) -> list[Html]:
    """One panel for each gauge, all on one scale: residuals by posture and cycle.

    Args:
        rows: n readings.
        left_mm: under one or two models: measured − modelled, shape (n,). The last is filled.
        noise_mm: standard deviation of one reading; the band is twice as high.
        over: a column of theirs instead of the postures; where it is None nothing is drawn.
        effect_mm: drawn as a line with its U as a band: both of shape (n,).
        shown: the readings whose gauges have a panel; () for all.
        ringed: readings that are wrong.
    """
    axis, at = _AXIS.get(over, ""), _column(rows, over) if over else np.zeros(len(rows))
    gauges: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        gauges.setdefault(_gauge(row), []).append(k)
    chosen = {gauge: ks for gauge, ks in sorted(gauges.items()) if not shown or {*shown} & {*ks}}
    panels = {gauge: [k for k in ks if np.isfinite(at[k])] for gauge, ks in chosen.items()}
    width, height = (216.0, 168.0) if rows[0].leg else (328.0, 132.0)
    places = [" ".join(filter(None, (row.posture, row.end))) for row in rows]
    band = 2000.0 * noise_mm
    microns = {model: 1000.0 * values for model, values in left_mm.items()}
    models = [*microns.values()]
    middle, reach = (1000.0 * values for values in effect_mm or np.zeros((2, len(rows))))
    low, high = middle - reach, middle + reach
    ends = np.stack((*models, low, high))[:, [*chain(*panels.values())]]
    up = Scale.around([*ends.ravel().tolist(), -band, band], height - 32.0, 26.0)
    pictures = []
    for gauge, numbers in panels.items():
        if not numbers:
            continue
        if over:
            numbers.sort(key=at.__getitem__)
            across = Scale.around(at[numbers].tolist(), 40.0, width - 6.0)
            x, ticks = {k: across(at[k]) for k in numbers}, across.ticks()
        else:
            numbers.sort(key=lambda k: (rows[k].displacement_mm or 0.0, places[k]))
            names = list(dict.fromkeys(places[k] for k in numbers))
            across = Scale(-0.5, len(names) - 0.5, 40.0, width - 6.0)
            x = {k: across(names.index(places[k]) + 0.09 * (rows[k].cycle - 2.5)) for k in numbers}
            ticks = [(across(n), "", name) for n, name in enumerate(names)]
        parts = [rectangle(40.0, up(band), width - 46.0, up(-band) - up(band), "band")]
        parts = [*parts * bool(band), *upright(up, width, "µm", gauge)]
        parts += [words(width - 6.0, height - 4.0, axis, "end", "muted")] * bool(axis)
        columns, _, texts = zip(*ticks, strict=True)
        # The words of a posture stand one below the other.
        for n, row_words in enumerate(zip_longest(*map(str.split, texts), fillvalue="")):
            parts += below(columns, row_words, up.start + 12.0 * (n + 1) + 1.0)
        runs: dict[object, list[int]] = {}
        for k in numbers:
            run = (rows[k].part, rows[k].gauge_at) if over else rows[k].cycle
            runs.setdefault(run, []).append(k)
        for ks in runs.values():
            if effect_mm is not None:
                edge = [(x[k], up(low[k])) for k in ks] + [(x[k], up(high[k])) for k in ks[::-1]]
                parts.append(tag("polygon", points=points(edge), class_="band"))
                parts.append(thread([(x[k], up(middle[k])) for k in ks]))
            elif not over:
                parts.append(thread([(x[k], up(models[-1][k])) for k in ks]))
        lists = []
        for model, values in microns.items():
            style = "mark" if values is models[-1] else "mark open"
            parts += (mark(x[k], up(values[k]), rows[k].cycle - 1, style) for k in numbers)
            listed = (f"{places[k]} {signed(values[k], 1)}" for k in numbers)
            lists.append(f"{model}: {', '.join(listed)}")
        circled = ((x[k], up(models[0][k])) for k in numbers if k in ringed)
        parts += (tag("circle", cx=cx, cy=cy, r=9.0, class_="fault") for cx, cy in circled)
        most = max(numbers, key=lambda k: abs(models[-1][k]))
        largest = " at ".join(filter(None, (signed(models[-1][most], 1), places[most])))
        seen = f"Residuals, µm; largest: {largest}. {'; '.join(lists)}."
        title = f"Residuals{f' over {axis}' * bool(axis)}, {gauge}"
        pictures.append(svg(width, height, title, seen, parts, f"c-{rows[numbers[0]].leg or 'x'}"))
    return pictures


def _gauge(row: Residual) -> str:
    if row.leg:
        return f"leg {row.leg}, direction {row.direction}"
    return "all differences" if row.x_mm is None else "all touches"


def _pattern_figure(case: Case, pattern: FoundPattern, number: int) -> doc.Figure:
    """The effect of the pattern with this number, over what it depends on."""
    rows = case.answer.residuals
    names = "pattern_mm", "pattern_expanded_mm"
    effect, reach = (_column(rows, name)[:, number] for name in names)
    wrong = [k for k, row in enumerate(rows) if row.wrong]
    key = f"Line: the {pattern_name(pattern)}, with U as a band (95 %). Points: readings without"
    key += " all other effects." + " Ringed: wrong, left out." * bool(wrong)
    left = {pattern_words(case.machine, pattern): [*_left(case).values()][-1] + effect}
    over = _DEPENDS.get(pattern.how if rows[0].leg else "", "minutes")
    drawn, shown = (effect, reach), np.flatnonzero(reach).tolist()
    panels = reading_panels(rows, left, over=over, effect_mm=drawn, shown=shown, ringed=wrong)
    return doc.Figure(panels, 3 if rows[0].leg else 2, key=key)  # as wide as they are


def _column(rows: Sequence[Residual], name: str) -> Floats:
    """A quantity of n readings, shape (n,), or (n, patterns); NaN where it is not known."""
    return np.array([getattr(row, name) for row in rows], np.float64)


def _on_bed(case: Case) -> bool:
    return any(row.x_mm is not None for row in case.answer.residuals)


def _left(case: Case) -> dict[str, Floats]:
    """Model → measured − modelled, shape (n,) [mm]: the parameters alone, and all that is found."""
    answer, rows = case.answer, case.answer.residuals
    known = (f"the {pattern_name(pattern)}" for pattern in answer.beyond)
    causes = " and ".join((*(cause.id for cause in answer.causes), *known))
    measured, alone = _column(rows, "measured_mm"), _column(rows, "modelled_mm")
    left = {f"{case.words.many} only": measured - alone}
    if causes:
        both = _column(rows, "with_causes_mm")
        left[f"with {causes}"] = measured - np.where(np.isnan(both), alone, both)
    return left


def readings_table(case: Case, *, distances: bool = False) -> doc.Grid:
    """Every reading or difference (only `distances` on a bed), and what the models leave of it."""
    chosen = [k for k, row in enumerate(case.answer.residuals) if row.distance or not distances]
    rows = [case.answer.residuals[k] for k in chosen]
    left = {model: values[chosen] for model, values in _left(case).items()}
    readings = case.answer.input.kind == DataKind.READINGS
    at, places = "difference", [row.posture or "" for row in rows]
    if _on_bed(case):
        at, touches = "at", ((row.x_mm or 0.0, row.y_mm or 0.0) for row in rows)
        where = map(position_words, touches, [1] * len(rows))
        places = ["distance" if e.distance else xy for e, xy in zip(rows, where, strict=True)]
    elif readings:
        keys = "leg", "direction", "posture", "end", "cycle"
        names = [key for key in keys if any(getattr(row, key) for row in rows)]
        at, places = ", ".join(names), [", ".join(str(getattr(e, n)) for n in names) for e in rows]
    # All with the digits of the longest one: 0.20 is more than 0.2.
    digits = max((len(short(e.measured_mm, 4).partition(".")[2]) for e in rows), default=0)
    columns = {at: places, "measured, mm": [signed(row.measured_mm, digits) for row in rows]}
    sizes = {model: [signed(mm, 4) for mm in values.tolist()] for model, values in left.items()}
    if not readings:
        single = case.answer.input.kind == DataKind.SINGLE
        caption = f"Last columns: residuals of each model. {comparison_words(single)[1]}"
        return doc.Grid.of({**columns, **sizes}, caption=caption)
    model = [*left][-1]  # a long list has room for one of them
    columns[f"left, {model}"] = sizes[model]
    return doc.Grid.of({"no.": [str(row.order) for row in rows], **columns}, (1,))


def _by_leg(case: Case) -> tuple[str, doc.Grid]:
    """Means of the repeats [µm], one row per series, one column per model and posture; a title."""
    rows, left = case.answer.residuals, _left(case)
    postures = list(dict.fromkeys(row.posture or "" for row in rows))
    several, parts = len({row.gauge_at for row in rows}) > 1, len({row.part for row in rows}) > 1
    cells: dict[str, dict[str, list[int]]] = {}
    for k, row in enumerate(rows):
        name = _gauge(row)
        name += f", {row.end} end" if row.end else f", at {row.gauge_at:g}" if several else ""
        name += f", part {row.part}" * parts
        cells.setdefault(name, {}).setdefault(row.posture or "", []).append(k)
    table = []
    for name, at in sorted(cells.items()):
        means = [
            [signed(1000.0 * float(values[at[p]].mean()), 1) if p in at else "" for p in postures]
            for values in left.values()
        ]
        table.append([name, *means[0], *(cell for others in means[1:] for cell in ("", *others))])
    head = ["", *postures, *["  ", *postures] * (len(left) - 1)]
    return f"Mean residuals, µm: {', and '.join(left)}.", doc.Grid(head, table)


def _surfaces(case: Case) -> Iterator[tuple[str, list[int], Floats]]:
    """Each touched height of a bed, in words where there are several: its touches, (n, 2) [mm]."""
    rows = case.answer.residuals
    heights = {k: row.surface_mm or 0.0 for k, row in enumerate(rows) if not row.distance}
    levels = sorted({*heights.values()})
    for level in levels:
        touches = [k for k, height in heights.items() if height == level]
        places = np.array([(rows[k].x_mm or 0.0, rows[k].y_mm or 0.0) for k in touches])
        yield f", at {level:g} mm" * (len(levels) > 1), touches, places


def _signs(place_mm: Floats, left_mm: Floats, sigma_mm: float) -> Iterator[str]:
    """Rows of signs, y upwards, of the means of what is left, (n,), of the touches, (n, 2)."""
    reach = np.abs(place_mm).max(initial=1.0)
    x_mm, y_mm = place_mm.T
    cells = partial(np.histogram2d, y_mm, x_mm, _CELLS, [(-reach, reach)] * 2)
    (count, *_), (total, *_) = cells(), cells(weights=left_mm)
    limits = sigma_mm * np.array([-4.0, -2.0, 2.0, 4.0])
    kinds = np.digitize(total / np.maximum(count, 1.0), limits)
    for row in np.where(count, np.array([*"▼−·+▲"])[kinds], " ")[::-1]:
        if text := " ".join(row).rstrip():
            yield f"  {text}"


# --- causes ------------------------------------------------------------------------------------


def cause_sketch(case: Case, id: str, sizes: Sequence[Estimate]) -> doc.Figure | None:
    """The machine with a cause of such sizes, drawn; None where no drawing shows it."""
    # Sizes beyond U, the largest first; all of them if none is.
    largest = sorted(sizes, key=lambda size: -abs(size.value))
    seen = [size for size in largest if abs(size.value) > size.expanded] or largest
    drawn = [size for size in seen if {*size.name} <= {*AXES, "_"}][:_MOST_DRAWN]
    if moves := shims(id, sizes):
        key = "The rails where they really are, the gaps enlarged. Arrows: move the mount there."
        panel = rails_sketch({size.name: size.value for size in sizes}, moves)
    elif drawn and not CAUSES[id].is_rate and not _on_bed(case):
        key = "Dashed: as it should be. Solid: as it is, enlarged."
        panel = parameter_sketch(id, drawn)
    else:
        return None
    return doc.Figure([panel], 0, key)


def cause_figure(case: Case, cause: FoundCause) -> doc.Figure | None:
    """A cause as a drawing: how the machine differs by it, or the readings that it spoils."""
    rows, left = case.answer.residuals, _left(case)
    (alone, *_), (*_, both) = left, left
    before, change = left[alone], np.abs(left[both] - left[alone])
    wrong = np.flatnonzero(change > 0.5 * change.max()).tolist()
    one = wrong if len(wrong) == 1 else []
    if _on_bed(case):
        if cause != case.answer.causes[0]:
            return None  # one map shows what all of them do
        sure = one and any(CAUSES[other.id].hides_reading for other in case.answer.causes)
        maps = []
        for title, at, places in _surfaces(case):
            ringed, title = np.isin(at, one) if sure else None, f"Residuals, {alone}{title}"
            maps.append(bed_map(title, places, before[at], case.machine.bed, ringed=ringed))
        return doc.Figure(maps, 0, "Ringed: wrong." if sure else _RINGED)
    if not cause.where and (sketch := cause_sketch(case, cause.id, cause.parameters)):
        return sketch
    timed = CAUSES[cause.id].timed and np.isfinite(_column(rows, "minutes")).all()
    over, noise_mm = "minutes" if timed else "", case.machine.instrument.noise_mm
    panels = reading_panels(rows, left, noise_mm=noise_mm, over=over, shown=wrong, ringed=one)
    key = f"Residuals. Open: {alone}. Filled: {both}." + " Ringed: wrong." * bool(one)
    return doc.Figure(panels[:_MOST_GAUGES], 0, key)
