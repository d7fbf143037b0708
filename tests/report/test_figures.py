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
from orthoglide_cal.report.views import CLASSES, class_limits
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


def test_workspace_classes_hold_the_largest_error():
    for largest in (0.0313, 0.1, 2.4, 7.0, 0.00071):
        limits = class_limits(largest)
        assert len(limits) == CLASSES
        assert limits[-1] >= largest * (1 - 1e-9)
        assert limits[-1] <= largest * 2.1


def test_workspace_before_and_after_share_one_scale():
    axis = np.linspace(-80.0, 60.0, 5)
    before = np.full((3, 5, 5), 2.0)
    before[2, 0, 4] = 2.4
    after = np.full((3, 5, 5), 0.03)
    drawn = views.slices(axis, axis[[0, 2, 4]], before, after)
    assert [re.search("<title[^>]*>([^<]*)", panel)[1] for panel in drawn][::3] == [
        "Workspace before, z = 60 mm",
        "Workspace after, z = 60 mm",
    ]
    assert "2.0 to 2.4 mm" in drawn[0]
    assert 'class="heat h0"' in drawn[3]
    assert 'class="heat h0"' not in drawn[0]
    # The cell with the larger error (x highest, y lowest) is in a class of its own, at the bottom
    # right of the picture.
    last = re.search(r'd="M([\d.]+) ([\d.]+)h[^"]*" class="heat h5"', drawn[0])
    assert last is not None
    assert float(last[1]) > 150.0
    assert float(last[2]) > 150.0


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


def test_explained_shares_and_strips():
    drawn = charts.share_bar({"axis_gap": 0.9, "noise": 0.08, "unexplained": 0.02})
    assert "axis_gap explains 90 %" in drawn
    assert "2 % stays unexplained" in drawn
    before, after = np.array([0.05, -0.05, 0.02]), np.array([0.001, 0.0, -0.002])
    strips = charts.residual_strips(("a", "b"), (before, after), np.array([0, 1, 2]), 0.003)
    assert "3 of 3 outside" in strips[0]
    assert "0 of 3 outside" in strips[1]


def test_drift_says_first_last_and_adjustments():
    total = np.array([[0.1, 0.2, 0.3], [0.15, 0.2, 0.1]])
    drawn = charts.drift_panels(
        (0.0, 30.0), ("2026-01-01", "2026-01-31"), total, total * 0 + 0.01, (False, True)
    )
    assert "+0.100 mm on 2026-01-01, +0.150 mm on 2026-01-31" in drawn[0]
    assert "adjusted before 2026-01-31" in drawn[2]
    assert drawn[0].count('class="event"') == 1


def test_sketches():
    lines = interval_lines(("x", "y"), (1.0, -0.5), (0.5, 0.0), 21)
    assert lines[0].index("●") > lines[0].index("│")
    assert "├" in lines[0]
    assert "├" not in lines[1]
    bars = bar_lines(("a", "b", "c"), (4.0, 2.0, 0.0), ("4", "2", "0"), 8)
    assert [line.count("█") for line in bars] == [8, 4, 0]
