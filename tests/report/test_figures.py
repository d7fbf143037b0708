"""Figures: what they draw is what they were given, and their words say it."""

import doctest
import re
from datetime import datetime
from functools import partial

import numpy as np
import pytest

from orthoglide_cal import errors, schema, words
from orthoglide_cal.model.machine import Bed
from orthoglide_cal.model.model import Estimate
from orthoglide_cal.report import case, figures
from orthoglide_cal.results.answer import Residual

BED = Bed(100.0, (210.0, 330.0, 90.0), 10.0)


def marks(picture: str) -> list[tuple[float, float]]:
    found = re.findall(r'<circle cx="([-\d.]+)" cy="([-\d.]+)"', picture)
    return [(float(x), float(y)) for x, y in found]


def test_residual_panels_have_one_scale_and_hold_every_value():
    left = np.array([1.0, -2.0, 3.0, -4.0, 10.0, 0.0, 0.0, 40.0]) * 1e-3
    where = ("min", -100.0, 1), ("iso", 0.0, 1), ("max", 60.0, 1), ("iso", 0.0, 2)
    rows = [
        Residual(leg="x", direction=direction, posture=posture, displacement_mm=moved, cycle=cycle,
                 order=1, measured_mm=0.0, modelled_mm=0.0)
        for direction in "yz" for posture, moved, cycle in where
    ]  # fmt: skip
    panels = partial(figures.reading_panels, rows, noise_mm=0.003)
    drawn = panels({"offsets only": left})
    assert len(drawn) == 2
    assert "offsets only: min +10.0, iso 0.0, iso +40.0, max 0.0." in drawn[1]
    # Both panels have the same scale: the same residual stands at the same height.
    grid = [re.findall(r'<line x1="40" y1="([\d.]+)"', panel) for panel in drawn]
    assert grid[0] == grid[1]
    found = re.findall(r'<text x="([\d.]+)"[^>]*"tick">(\w+)<', drawn[0])
    ticks = {text: float(x) for x, text in found}
    assert ticks["min"] < ticks["iso"] < ticks["max"]
    both = panels({"a": left, "b": 0.5 * left})
    assert (drawn[0].count('class="mark open"'), both[0].count('class="mark open"')) == (0, 4)
    # What is wrong is circled, and only that panel is shown.
    (ringed,) = panels({"a": left, "b": 0.5 * left}, shown=[7], ringed=[7])
    ((x, y),) = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="9" class="fault"', ringed)
    assert (float(x), float(y)) in marks(ringed.replace(' r="9"', ""))
    assert "direction z" in ringed
    # Over time a reading stands where its time is; one whose time is not known is left out.
    when = [row.changed(minutes=m) for row, m in zip(rows, (*range(7), None), strict=True)]
    timed = figures.reading_panels(when, {"a": left}, over="minutes", shown=[7])[0]
    places = [x for x, _ in marks(timed)]
    assert np.diff(sorted(places)) == pytest.approx([places[1] - places[0]] * 2, abs=0.02)
    # Differences share one panel, each at its name.
    named = [row.changed(leg=None, direction=None) for row in rows]
    (shared,) = figures.reading_panels(named, {"a": left, "b": 0.5 * left})
    assert shared.count("all differences") == 2


def test_a_pattern_is_a_line_with_its_uncertainty_where_it_acts():
    rows = [
        Residual(leg="y", direction=direction, order=k + 1, measured_mm=0.0, modelled_mm=0.0,
                 cycle=1, minutes=(None, 3.0, 2.0, 1.0, 1.0)[k])
        for k, direction in enumerate("xxxxz")
    ]  # fmt: skip
    values = 0.01 * np.arange(5.0) + 0.001
    effect, reach = 0.01 * np.arange(5.0), np.array([0.002] * 4 + [0.0])
    (drawn,) = figures.reading_panels(
        rows, {"It drifts": values}, over="minutes", effect_mm=(effect, reach),
        shown=[0, 1, 2, 3], ringed=[2],
    )  # fmt: skip
    assert "direction x" in drawn
    line, band = (
        [tuple(map(float, pair.split(","))) for pair in re.findall(pattern, drawn)[0].split()]
        for pattern in (r'<polyline points="([^"]*)', r'<polygon points="([^"]*)" class="band"')
    )
    # From left to right by what it depends on; readings are 1 µm above it, U is ± 2 µm.
    assert [x for x, _ in line] == sorted(x for x, _ in line)
    points = sorted(marks(re.sub(r'<circle[^>]*"fault"', "", drawn)))
    for (x, y), (at, middle), low, high in zip(points, line, band[:3], band[:2:-1], strict=True):
        assert x == pytest.approx(at, abs=0.06)
        assert (low[1] - y) / (middle - y) == pytest.approx(3.0, abs=0.3)
        assert (y - high[1]) / (middle - y) == pytest.approx(1.0, abs=0.3)
    ((x, _),) = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="9" class="fault"', drawn)
    assert float(x) == pytest.approx(line[1][0], abs=0.06)


def test_what_is_left_is_shown_with_its_uncertainty_and_the_limit():
    rows = [("dx_y", 0.5, 0.0, 0.02, 0.1), ("dz_x", 0.4, -0.1, 0.04, -0.3)]
    figure = partial(figures.differences_figure, rms_mm=(0.45, 0.07, 0.22), single=False)
    (drawn,) = figure(rows, limit_mm=0.2).panels
    assert "as left ± U" in drawn
    assert "+0.100 ± 0.020" in drawn
    ((start, width),) = re.findall(
        '<rect x="([0-9.]+)" y="[0-9.]+" width="([0-9.]+)"[^>]*class="allowed"', drawn
    )
    limits = [float(start), float(start) + float(width)]
    places = [x for x, _ in marks(drawn)]  # as found, left; of each difference
    bars = re.findall('<line x1="([0-9.]+)" y1="[0-9.]+" x2="([0-9.]+)"[^>]*class="whisker"', drawn)
    reach = [tuple(map(float, pair)) for pair in bars if pair[0] != pair[1]]
    # Places on the scale: 0.4 mm lie between the limits.
    scale, middle = (limits[1] - limits[0]) / 0.4, sum(limits) / 2.0
    wanted = [middle + scale * value for value in (0.5, 0.1, 0.4, -0.3)]
    assert places == pytest.approx(wanted, abs=0.2)
    assert (reach[1][1] - reach[1][0]) / scale == pytest.approx(0.08, abs=0.002)
    (alone,) = figure([(*row[:4], None) for row in rows], limit_mm=None).panels
    assert 'class="allowed"' not in alone
    assert "−0.100 ± 0.040" in alone
    (judged,) = figure(rows, limit_mm=0.2, outcomes=["Pass", "Fail"]).panels
    assert [judged.count(f">{word}<") for word in ("Pass", "Fail", "−0.100")] == [1, 1, 1]
    assert "dz_x +0.400, −0.100, −0.300 ± 0.040, Fail" in judged


def heat(panel: str) -> dict[str, float]:
    """Area of each colour in a map."""
    found: dict[str, float] = {}
    cells = re.findall(
        r'<rect [^>]*width="([\d.]+)" height="([\d.]+)" class="heat" fill="var\(--(h\d)\)"', panel
    )
    for width, height, colour in cells:
        found[colour] = found.get(colour, 0.0) + float(width) * float(height)
    return found


def test_the_workspace_has_the_colours_of_its_errors_on_one_scale():
    """A cone of errors: what lies above a limit is all but a disc of known size."""
    axis = np.linspace(-70.0, 70.0, 101)
    x, y = np.meshgrid(axis, axis)
    error = np.hypot(x, y)[None] / 100.0  # up to 0.99 mm

    def view(when: str, error: np.ndarray, worst: float = -70.0) -> tuple:
        return when, error, error.max(), (70.0, -70.0, worst)

    ends, found = (-70.0, 70.0), view("as found", error)
    views = [found, view("expected", error / 10.0)]
    before, after, legend = figures.workspace_maps(views, ends)
    assert ">0<" in legend
    assert marks(before) == [(210.0, 190.0)]  # the lower right corner
    limits = figures.class_limits(float(error.max()))
    areas, whole = heat(before), sum(heat(before).values())
    above = 0.0
    for k in reversed(range(1, figures.CLASSES)):
        above += areas.get(f"h{k}", 0.0)
        radius = 100.0 * limits[k]
        if radius < 70.0:
            share = np.pi * radius**2 / 140.0**2
            assert above / whole == pytest.approx(1.0 - share, abs=0.02)
    assert set(heat(after)) == {"h0"}
    assert "as found, z = −70 mm" in before
    assert "expected, z = −70 mm" in after
    # What was measured afterwards takes the place of what was expected; the limit is a circle.
    later = view("as left", error / 2.0, 3.0)
    _, measured, _ = figures.workspace_maps([found, later], ends, 0.35)
    assert "as left, z = −70 mm" in measured
    assert "at most 0.49 mm" in measured
    assert marks(measured) == []  # its worst point lies in no slice
    edges = re.findall('<line x1="([0-9.]+)" y1="([0-9.]+)"[^>]*class="due"', measured)
    away = [np.hypot(float(x) - 126.0, float(y) - 106.0) for x, y in edges]
    # 0.7 mm of the cone, of whose half there is 70 mm on 84 pixels.
    assert away == pytest.approx(len(away) * [84.0], abs=2.0)


def test_a_map_of_a_bed_has_y_upwards_and_a_middle_colour_for_nothing():
    place, left = np.array([[0.0, 100.0], [50.0, 0.0], [-50.0, 0.0]]), np.array([0.0, 0.04, -0.04])
    panel = figures.bed_map("radius only", place, left, BED)
    _, (x0, y0), (x1, y1), (x2, _) = marks(panel)  # the first is the bed
    assert y0 < y1  # of the picture, which counts downwards
    assert x2 < x0 < x1
    colours = re.findall(r'<circle [^>]*class="heat" fill="var\(--d(\d)\)"', panel)
    assert list(map(int, colours)) == pytest.approx([3, 6, 0], abs=1)
    towers = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"[^>]*class="axis halo">([abc])<', panel)
    (xa, ya, _), (xb, yb, _), (xc, yc, _) = ((float(x), float(y), t) for x, y, t in towers)
    assert xa < xc < xb
    assert yc < ya == yb
    assert ">front<" in panel
    # One touch far from all others is ringed, and does not take the colours from them.
    many = np.tile(place, (4, 1)) + np.arange(12)[:, None]
    noise = 0.01 * np.cos(np.arange(12.0))
    noise[7] = 0.5
    ringed = figures.bed_map("radius only", many, noise, BED)
    assert ringed.count('class="ring"') == 1
    assert "1 ringed" in ringed
    assert len(set(re.findall(r'fill="var\(--d(\d)\)"></circle>', ringed))) > 4
    signs = [*figures._signs(place, left, 0.009)]
    assert signs[0].strip() == "·"
    assert signs[-1].split() == ["▼", "▲"]
    row = np.stack((np.linspace(-100.0, 100.0, 5), np.zeros(5)), axis=-1)
    (signs,) = figures._signs(row, np.array([0.01, 0.03, -0.03, 0.05, -0.05]), 0.01)
    assert signs.split() == list("·+−▲▼")


def test_rails_pass_each_other_as_they_do_in_space():
    """Drawn from the gaps alone: each common perpendicular is as long as its gap."""
    gaps = {"xy": 0.3, "yz": -0.2, "zx": 0.1}
    drawn = figures.rails_sketch(gaps, [("y", 0.3, "+z")])
    found = re.findall(
        '<line x1="([-0-9.]+)" y1="([-0-9.]+)" x2="([-0-9.]+)" y2="([-0-9.]+)" class="fault"', drawn
    )
    gap_lines = [map(float, each) for each in found[-3:]]
    lengths = [float(np.hypot(c - a, d - b)) for a, b, c, d in gap_lines]
    on_paper = [1.0, np.hypot(0.84, 0.5), np.hypot(0.84, 0.5)]  # of 1 px along z, x and y
    wanted = [abs(gap) * scale for gap, scale in zip(gaps.values(), on_paper, strict=True)]
    assert np.array(lengths) / lengths[0] == pytest.approx(np.array(wanted) / wanted[0], rel=1e-3)
    # Rail x lies above rail y: on the paper upwards.
    assert float(found[-3][1]) < float(found[-3][3])
    assert float(found[0][1]) > float(found[0][3])  # the arrow at the mount of rail y: towards +z
    assert ">0.30 mm<" in drawn


def test_what_is_found_of_a_machine_is_drawn_to_its_sign():
    """Bar, angle and carriage: the largest is off by most, a negative one the other way."""
    line = r'<line x1="([\d.]+)" y1="([\d.]+)" x2="([\d.]+)" y2="([\d.]+)" class="{}"'

    def lines(sizes: list[Estimate], style: str) -> list[list[float]]:
        drawn = figures.parameter_sketch("cause", sizes)
        return [list(map(float, found)) for found in re.findall(line.format(style), drawn)]

    size = partial(Estimate, unit="mrad", std=0.1)
    carriage = [size(name="x", value=-0.08, unit="mm", std=0.01)]
    bars = [size(name="y_x", value=2.0), size(name="z_y", value=-1.0)]
    (_, y1, _, y2), (_, z1, _, z2) = lines(bars, "bar")
    assert y1 - y2 == pytest.approx(-2.0 * (z1 - z2))  # upwards along +, half as much downwards
    assert y1 > y2
    ((x1, _, x2, _),) = lines([size(name="xy", value=3.0)], "bar")
    assert x2 > x1  # less than a right angle
    ((start, _, end, _),) = lines(carriage, "fault")
    assert end < start
    assert "x −0.080 ± 0.020 mm" in figures.parameter_sketch("cause", carriage)


@pytest.mark.parametrize("module", [errors, case, schema, words])
def test_the_examples_in_docstrings_are_true(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def test_numbers_and_words():
    assert words.entered_decimals((0.21, 0.44), (0.0, 0.0)) == 3
    assert words.entered_decimals((0.21,), (0.12345,)) == 5
    assert [words.plain(value, 2) for value in (-0.001, 0.256)] == ["0.00", "0.26"]
    assert [words.short(value, 3) for value in (60.0, -12.5)] == ["60", "-12.5"]
    assert [words.signed(value, 2) for value in (-0.296, 0.001)] == ["−0.30", "0.00"]
    assert [*map(words.two_figures, (0.02144, 1.96, 0.0))] == ["0.021", "2.0", "0"]
    assert words.together(["axis_gap", "backlash"]) == "axis_gap with backlash"
    assert words.together([]) == "a sound machine"
    moment = datetime.fromisoformat("2026-03-02T08:15:10.250+01:00")
    assert words.moment_words(moment) == "2026-03-02 08:15 +01:00"
