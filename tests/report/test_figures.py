"""Pictures: what they draw is what they were given, and their words say it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from orthoglide_cal.model import Difference, Series
from orthoglide_cal.report import charts, views
from orthoglide_cal.report.canvas import (
    Scale,
    around,
    bar_lines,
    interval_lines,
    mark,
    tick_text,
    ticks,
)
from orthoglide_cal.report.slices import CLASSES, class_limits, legend, slices
from orthoglide_cal.results import Residuals


def marks(picture: str, kind: str = "circle") -> list[tuple[float, float]]:
    found = re.findall(rf'<{kind} cx="([-\d.]+)" cy="([-\d.]+)"', picture)
    return [(float(x), float(y)) for x, y in found]


def test_scale_and_ticks():
    scale = Scale(-2.0, 6.0, 10.0, 90.0)
    assert scale(-2.0) == 10.0
    assert scale(0.0) == 30.0
    assert Scale(1.0, 1.0, 0.0, 8.0)(1.0) == 4.0
    assert ticks(-0.32, 0.55, 4) == pytest.approx([-0.25, 0.0, 0.25, 0.5])
    assert [tick_text(v, 0.25) for v in (-0.25, 0.0, 0.5)] == ["−0.25", "0.00", "0.50"]
    assert [tick_text(v, 20.0) for v in (-20.0, 0.0)] == ["−20", "0"]
    low, high = around([0.3, -0.1])
    assert low < -0.1
    assert high > 0.3


def test_marks_differ_in_shape():
    drawn = [mark(0.0, 0.0, shape) for shape in range(5)]
    assert len(set(drawn)) == 5
    assert mark(0.0, 0.0, 5) == drawn[0]


def test_intervals_say_and_show_each_offset():
    bars = [
        charts.Bar("with axis_gap", (0.2, -0.3, 0.4), (0.01, 0.02, 0.03)),
        charts.Bar("offsets alone", (0.1, -0.1, 0.5), (0.1, 0.1, 0.1)),
    ]
    near, far = charts.intervals(bars)[1], charts.intervals(bars)[0]
    assert "x, with axis_gap: +0.200 ± 0.010 mm" in far
    assert "z, offsets alone: +0.500 ± 0.100 mm" in far
    # In the closer view the first bar's marks stand one above the other.
    assert len({x for x, _ in marks(near)}) == 1
    assert "x: ±10 µm; y: ±20 µm; z: ±30 µm" in near


def test_residual_panels_one_scale_and_named_worst():
    series = [Series(0, 1)] * 4 + [Series(0, 2)] * 4
    residual = np.array([1.0, -2.0, 3.0, -4.0, 10.0, 0.0, 0.0, 40.0]) * 1e-3
    found = Residuals(
        tuple(series), ("min", "iso", "max", "iso") * 2, (None,) * 8,
        np.array([-100.0, 0, 60, 0] * 2), np.array([1, 1, 1, 2] * 2), np.arange(1, 9),
        residual, np.zeros(8),
    )  # fmt: skip
    drawn = charts.residual_panels(found, 0.003)
    assert len(drawn) == 2
    assert "the largest is +40 µm at posture iso, cycle 2" in drawn[1]
    # Both panels have the same scale: the same residual stands at the same height.
    grid = [re.findall(r'<line x1="46" y1="([\d.]+)"', panel) for panel in drawn]
    assert grid[0] == grid[1]
    assert "min" in drawn[0]
    assert drawn[0].index(">min<") < drawn[0].index(">iso<") < drawn[0].index(">max<")


def test_difference_rows_show_what_is_left():
    measured, predicted = np.array([-0.43, 0.2]), np.array([-0.15, 0.25])
    which = (Difference(Series(1, 0)), Difference(Series(0, 2)))
    (drawn,) = charts.difference_rows(which, measured, predicted)
    assert "-0.280" in drawn
    assert "-0.050" in drawn
    assert "dx_y is missed most: measured -0.430 mm, predicted -0.150 mm" in drawn


def test_what_is_left_is_shown_with_its_uncertainty_and_the_limit():
    which = (Difference(Series(1, 0)), Difference(Series(0, 2)))
    given = np.array([0.0, -0.1]), np.array([0.1, -0.3]), np.array([0.02, 0.04])
    (drawn,) = charts.corrected_rows(which, *given, 0.2)
    assert "left after correction, mm" in drawn
    assert "+0.100 ± 0.020" in drawn
    assert "dz_x is left largest: -0.300 ± 0.040 mm, promised -0.100 mm; the limit is 0.2" in drawn
    limits = [float(x) for x in re.findall('<line x1="([0-9.]+)"[^>]*class="due"', drawn)]
    places = [x for x, _ in marks(drawn)]
    bars = re.findall('<line x1="([0-9.]+)" y1="[0-9.]+" x2="([0-9.]+)"[^>]*class="whisker"', drawn)
    reach = [tuple(map(float, pair)) for pair in bars if pair[0] != pair[1]]
    # Places on the scale: 0.4 mm lie between the limits, and the second mark beyond them.
    scale = (limits[1] - limits[0]) / 0.4
    middle = sum(limits) / 2.0
    assert middle + 0.1 * scale == pytest.approx(places[0], abs=0.2)
    assert places[1] < limits[0]
    assert (reach[1][1] - reach[1][0]) / scale == pytest.approx(0.08, abs=0.002)
    assert 'class="due"' not in charts.corrected_rows(which, *given, None)[0]


def test_waterfall_goes_down_to_the_noise():
    left = {"as found": 1.2, "offsets": 0.3, "axis_gap": 0.05}
    (drawn,) = charts.waterfall(left, 0.02)
    bars = re.findall(
        '<rect x="([0-9.]+)" y="[0-9.]+" width="([0-9.]+)" height="15" class="(part-[a-z]+)"', drawn
    )
    assert [class_ for *_, class_ in bars] == [
        "part-found", "part-cause", "part-cause", "part-noise", "part-open",
    ]  # fmt: skip
    start, wide = float(bars[0][0]), float(bars[0][1]) / 1.2
    spans = [((float(x) - start) / wide, float(w) / wide) for x, w, _ in bars]
    wanted = [(0.0, 1.2), (0.3, 0.9), (0.05, 0.25), (0.0, 0.02), (0.02, 0.03)]
    for found, want in zip(spans, wanted, strict=True):
        assert found == pytest.approx(want, abs=1e-3)
    for text in ("1.2 mm", "-0.90 mm", "-0.25 mm", "0.020 mm", "0.030 mm"):
        assert f">{text}<" in drawn
    assert "noise" not in charts.waterfall(left, None)[0]
    assert "unexplained" not in charts.waterfall(left, 0.05)[0]


def test_workspace_classes_hold_all_errors_in_round_steps():
    for lowest, largest in ((0.0, 0.0313), (1.7, 2.41), (0.0, 7.0), (0.00012, 0.00071), (2.0, 2.0)):
        limits = class_limits(lowest, largest)
        assert len(limits) == CLASSES + 1
        assert limits[0] <= lowest + 1e-12
        assert limits[-1] >= largest * (1 - 1e-9)
        steps = np.diff(limits)
        assert steps == pytest.approx(steps[0])
        mantissa = steps[0] / 10.0 ** np.floor(np.log10(steps[0]) + 1e-9)
        assert mantissa in (pytest.approx(1), pytest.approx(1.5), pytest.approx(2),
                            pytest.approx(2.5), pytest.approx(3), pytest.approx(4),
                            pytest.approx(5), pytest.approx(7.5))  # fmt: skip
        # No scale is so coarse that most of it stays unused.
        assert largest - lowest > 0.45 * (limits[-1] - limits[0]) or lowest == largest


def areas(panel: str) -> dict[str, float]:
    """Area of each colour that lies above a limit, by the shoelace formula; contours' length."""
    found = {}
    for drawn, class_ in re.findall('<path d="([^"]*)" class="heat (h[0-9])"', panel):
        total = 0.0
        for polygon in drawn.rstrip("z").split("z"):
            corners = np.array([pair.split() for pair in polygon[1:].split("L")], dtype=float)
            x, y = corners.T
            total += abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0
        found[class_] = total
    return found


def test_contours_stand_where_the_error_is():
    """A cone of errors: what lies above a limit is all but a disc of known size."""
    axis = np.linspace(-70.0, 70.0, 17)
    x, y = np.meshgrid(axis, axis)
    error = np.hypot(x, y)[None] / 100.0  # up to 0.99 mm
    (drawn,) = slices("before", axis, np.zeros(1), error, np.zeros((1, 17, 17, 3)))
    limits = class_limits(0.0, float(error.max()))
    whole, scale = 186.0**2, (186.0 / 140.0) ** 2
    found = areas(drawn)
    assert len(found) >= 4
    for class_, area in found.items():
        radius = 100.0 * limits[int(class_[1])]
        if radius < 70.0:
            assert area == pytest.approx(whole - np.pi * radius**2 * scale, rel=0.02)
    # The contour of the smallest limit is a circle about the middle.
    contour = re.search('<path d="([^"]*)" class="contour"', drawn)[1]
    ends = np.array(re.findall(r"([0-9.]+) ([0-9.]+)", contour), dtype=float)
    middle = np.array([46.0 + 93.0, 38.0 + 93.0])
    radii = np.linalg.norm(ends - middle, axis=1) * 140.0 / 186.0
    assert radii.min() == pytest.approx(100.0 * limits[1], rel=0.05)


def test_before_and_after_have_scales_and_arrows_of_their_own():
    axis, levels = np.linspace(-80.0, 60.0, 5), np.array([-80.0, 60.0])
    before, after = np.linspace(1.7, 2.4, 50).reshape(2, 5, 5), np.linspace(0, 0.03, 50)
    shift = np.zeros((2, 5, 5, 3))
    shift[..., 0], shift[1, 2, 2] = 1.0, (2.0, 1.0, 3.0)
    scales = {"before": (before, shift), "after": (after.reshape(2, 5, 5), 0.0 * shift)}
    shown = {when: slices(when, axis, levels, *given) for when, given in scales.items()}
    high = shown["before"][0]
    assert '<title id="workspace-before-1-t">Workspace before, z = 60 mm<' in high
    assert "y, mm" in high
    assert "2.1 to 2.4 mm" in high
    assert 'class="heat h5"' in shown["after"][0]  # not blank on the scale of "before"
    assert 'class="arrow"' not in "".join(shown["after"])
    # The longest arrow points towards +x and up, half as far up as to the right.
    drawn = re.findall(
        r'<line x1="([0-9.]+)" y1="([0-9.]+)" x2="([0-9.]+)" y2="([0-9.]+)" class="arrow"', high
    )
    x1, y1, x2, y2 = map(float, max(drawn, key=lambda each: float(each[2]) - float(each[0])))
    assert (x2 - x1) == pytest.approx(2.0 * (y1 - y2), abs=0.1)
    key = legend(scales)
    assert "before from 1.7 to 2.4 mm, after from 0.000 to 0.035 mm" in key
    assert "2.2 mm" in key  # the longest arrow, in the plane


def test_machine_names_every_gauge():
    drawn = views.machine(310.25, (-100.0, 60.0), [(0, 1, 0.5), (2, 0, 0.25)])
    assert "leg x in direction y at 50 % of the leg" in drawn
    assert "leg z in direction x at 25 % of the leg" in drawn
    assert drawn.count('class="dial"') == 2
    assert "+y" in drawn
    assert "fault" not in drawn
    marked = views.machine(310.25, (-100.0, 60.0), [(0, 1, 0.5), (2, 0, 0.25)], [(2, 0)])
    assert marked.count('class="fault"') == 1
    assert "leg z, direction x" in marked


def test_strips_count_what_lies_outside_the_noise():
    before, after = np.array([0.05, -0.05, 0.02]), np.array([0.001, 0.0, -0.002])
    strips = charts.residual_strips(("a", "b"), (before, after), np.array([0, 1, 2]), 0.003)
    assert "leg y" in strips[0]
    mixed = charts.residual_strips(("a",), (np.zeros(4),), np.array([0, 1, 0, 1]), 0.003)
    assert "leg x" not in mixed[0]
    assert "3 of 3 outside" in strips[0]
    assert "0 of 3 outside" in strips[1]


def test_sketches():
    lines = interval_lines(("x", "y"), (1.0, -0.5), (0.5, 0.0), 21)
    assert lines[0].index("●") > lines[0].index("│")
    assert "├" in lines[0]
    assert "├" not in lines[1]
    bars = bar_lines(("a", "b", "c"), (4.0, 2.0, 0.0), ("4", "2", "0"), 8)
    assert [line.count("█") for line in bars] == [8, 4, 0]
