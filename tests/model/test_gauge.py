"""What a gauge can hardly have shown: dead gauges and wrong units are found, healthy data are not.

Readings come from the independent truth; chances are counted in draws of rounded noise.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.files.machine_file import machine_text
from orthoglide_cal.model.gauge import Gauge, chance_of_less_scatter
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Readings, Source
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.report.sentences import sentence
from tests import truth
from tests.cli.program import lines, run
from tests.inference.sessions import known, model_of, readings_of
from tests.machines import PROTOTYPE
from tests.sentences import sentences

DEAD, SCATTER, GRID, RANGE, UNIT = (
    "never differ", "differ by", "lie between", "beyond the gauge's range", "cannot show these",
)  # fmt: skip
both_gauges = pytest.mark.parametrize("gauge", [truth.DIAL, truth.MICRON], ids=lambda g: g.name)


def kinds(readings: Readings, gauge: Gauge) -> set[str]:
    every = (DEAD, SCATTER, GRID, RANGE, UNIT)
    doubts = sentences(gauge.doubts(readings))
    return {kind for kind in every for doubt in doubts if kind in doubt}


def drawn(gauge: truth.Gauge, seed: int = 3) -> tuple[Readings, Gauge]:
    readings, model = known(truth.make_session(seed, truth.PROTOTYPE, gauge))
    return readings, model.machine.gauge


def adjusted(gauge: truth.Gauge, rng: np.random.Generator, cycles: int) -> truth.Session:
    """A machine without any error, its dials set to zero at the start."""
    plan = truth.standard_plan(truth.PROTOTYPE, rng, cycles=cycles)
    made = truth.measure(truth.PROTOTYPE, gauge, plan, np.zeros(3), (), rng)
    noise = rng.normal(0.0, gauge.noise, plan.count)
    shown = np.round(np.round(noise / gauge.resolution) * gauge.resolution, 6)
    return replace(made, readings=shown)


@both_gauges
@pytest.mark.parametrize("count", [25, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("machine", [truth.PROTOTYPE, truth.LARGE], ids=lambda m: m.name)
def test_healthy_sessions_are_never_doubted(
    machine: truth.Machine, count: int, gauge: truth.Gauge
) -> None:
    """Half of 4 count are perfectly adjusted; none is questioned in vain."""
    stated = model_of(machine, gauge).machine.gauge
    rng = np.random.default_rng(11)
    plain = readings_of(truth.make_session(0, machine, gauge))
    for seed in range(2 * count):
        values = truth.make_session(seed, machine, gauge, offset_sd=(0.02, 1.0)[seed % 2]).readings
        assert stated.doubts(replace(plain, value=values)) == (), seed
    for cycles in (2, 3):
        plain = readings_of(adjusted(gauge, rng, cycles))
        for number in range(count):
            values = adjusted(gauge, rng, cycles).readings
            assert stated.doubts(replace(plain, value=values)) == (), (cycles, number)


# --- repeats ----------------------------------------------------------------------------------


@both_gauges
@pytest.mark.parametrize("size", [2, 4])
def test_the_chance_is_an_upper_bound(gauge: truth.Gauge, size: int) -> None:
    """Of 10,000 draws of six cells at the worst place; twice as good, at any between divisions."""
    own, rng = model_of(truth.PROTOTYPE, gauge).machine.gauge, np.random.default_rng(size)
    for place, better in ((0.0, 1.0), (None, 2.0)):
        where = rng.uniform(-0.5, 0.5, (10_000, 6, 1)) if place is None else place
        noise = rng.normal(0.0, gauge.noise / better / gauge.resolution, (10_000, 6, size))
        shown = np.rint(noise + where) * gauge.resolution
        squares = ((shown - shown.mean(axis=2, keepdims=True)) ** 2).sum(axis=2)
        chance = [chance_of_less_scatter(one, np.full(6, size), own) for one in squares]
        for share in (0.01, 0.03, 0.1, 0.3):
            true = float(np.mean(np.array(chance) <= share))
            assert true * (1.0 - 4.0 / np.sqrt(10_000 * true + 1.0)) < share


def test_a_fine_gauge_may_scatter_half_as_much_as_stated_no_less() -> None:
    """Of a thousand readings of each posture."""
    own = model_of(truth.PROTOTYPE, truth.MICRON).machine.gauge
    noise, size = np.random.default_rng(8).normal(0.0, own.repeatability_mm, (6, 1003)), 1003
    squares = ((noise - noise.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    for share, chance in ((1.0, 1.0), (0.5, 1.0), (0.25, 0.0)):
        found = chance_of_less_scatter(share**2 * squares, np.full(6, size), own)
        assert found == pytest.approx(chance, abs=1e-12)


def test_equal_readings_are_normal_behind_a_coarse_dial() -> None:
    readings, gauge = drawn(truth.DIAL)
    equal = replace(readings, value=np.full(len(readings), 0.12))
    assert kinds(equal, gauge) == {DEAD}
    assert kinds(equal, gauge.changed(repeatability_mm=0.001)) == set()


@both_gauges
def test_a_dead_display(gauge: truth.Gauge) -> None:
    """Not the same number everywhere: what each posture shows is repeated to the last digit."""
    readings, stated = drawn(gauge)
    first = {cell: i for i, cell in reversed(list(enumerate(readings.plan.cells.tolist())))}
    repeated = readings.value[[first[cell] for cell in readings.plan.cells.tolist()]]
    assert kinds(replace(readings, value=repeated), stated) == {DEAD}
    nearly = np.round(repeated + 0.1 * (readings.value - repeated), 3)
    fine = stated.changed(resolution_mm=0.001)
    assert kinds(replace(readings, value=nearly), fine) == {SCATTER}


# --- digits, travel, units --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gauge", "rows", "added", "words"),
    [
        (truth.MICRON, range(20, 40, 2), None, (DEAD, "Repeated readings of leg y, direction x")),
        (truth.DIAL, [7], 0.004, (GRID, "1 of 60", "line 9, ")),
        (truth.DIAL, [33], 10.5, (RANGE, "line 35:")),
    ],
    ids=["dead", "decimals", "travel"],
)
def test_what_a_gauge_can_hardly_have_shown_is_named(
    gauge: truth.Gauge, rows: Sequence[int], added: float | None, words: tuple[str, ...]
) -> None:
    """Far from zero alone is no doubt: a display can be preset."""
    readings, stated = drawn(gauge)
    value = readings.value + 50.0
    assert kinds(replace(readings, value=value), stated) == set()
    value[rows] = 0.123 if added is None else value[rows] + added
    (doubt,) = stated.doubts(replace(readings, value=value))
    assert all(part in sentence(doubt) for part in words)


@pytest.mark.parametrize(("decimals", "beside", "doubted"), [(6, 0.0, 0), (9, 0.015, 1)])
def test_readings_in_inches_need_not_be_on_the_divisions_of_the_mm_scale(
    decimals: int, beside: float, doubted: int
) -> None:
    """0.0005 in are 50 of their steps; 0.015 of a step beside them is no reading in inches."""
    readings, gauge = drawn(truth.DIAL)
    value = np.rint(readings.value / 0.0127) * 0.0127
    value[7] += beside * 0.000254
    assert len(gauge.doubts(replace(readings, value=np.round(value, decimals)))) == doubted


@both_gauges
@pytest.mark.parametrize(
    ("factor", "decimals", "words"),
    [
        (1.0 / 25.4, 4, "reading_in"), (25.4, 6, "reading_mm"),
        (1000.0, 3, "Divide them by 1000"), (1e-3, 6, "Multiply them by 1000"),
    ],
)  # fmt: skip
def test_a_wrong_unit_is_named(
    gauge: truth.Gauge, factor: float, decimals: int, words: str
) -> None:
    for seed in range(1, 3):
        readings, stated = drawn(gauge, seed)
        wrong = replace(readings, value=np.round(readings.value * factor, decimals))
        (doubt,) = stated.doubts(wrong)
        assert UNIT in sentence(doubt)
        assert words in sentence(doubt)
        assert not kinds(readings, stated)


@pytest.mark.parametrize("kind", [DataKind.SIX, DataKind.TWELVE])
def test_differences_of_means_are_allowed_their_decimals_but_not_those_of_inches(
    kind: DataKind,
) -> None:
    rng, gauge, which = np.random.default_rng(4), PROTOTYPE.gauge, DIFFERENCES[kind]

    def doubts(value: Floats) -> bool:
        return bool(gauge.doubts(Differences(kind, which, value, Source("made", ""))))

    shown = np.round(rng.normal(0.0, 0.8, (200, len(which), 7)), 2)
    for readings in shown:
        for high, low, digits in ((1, 1, 2), (3, 3, 3), (3, 4, 4), (3, 4, 9), (2, 3, 4)):
            means = readings[:, :high].mean(axis=1), readings[:, -low:].mean(axis=1)
            assert not doubts(np.round(means[0] - means[1], digits))
    assert sum(doubts(np.round(each / 25.4, 4)) for each in shown[:100, :, 0]) >= 95


def test_every_command_says_so(tmp_path: Path) -> None:
    """Of a gauge in inches, headed mm; 0.0005 in are not whole divisions of 0.01 mm."""
    session, path = truth.make_session(5, truth.PROTOTYPE, truth.DIAL), tmp_path / "inches.csv"
    header, *rows = truth.readings_csv(session).splitlines()
    inches = (np.rint(session.readings / 25.4 / 0.0005) * 0.0005).tolist()
    cells = (f"{row.rpartition(',')[0]},{one:.4f}" for row, one in zip(rows, inches, strict=True))
    text = "\n".join((header, *cells, ""))
    path.write_text(text, encoding="utf-8")
    (checked,) = lines(run("validate", str(path), "--json"))
    assert any("reading_in" in remark for remark in checked["remarks"])
    (solved,) = lines(run("solve", str(path), "--json"))
    assert "reading_in" in str(solved["release"])
    assert run("export", str(path)).exit_code == 4
    path.write_text(text.replace("reading_mm", "reading_in"), encoding="utf-8")
    assert run("export", str(path)).exit_code == 0
    (checked,) = lines(run("validate", str(path), "--json"))
    assert checked["remarks"] == []


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"repeatability_mm": 0.051}, "repeatability of 0.051 mm with divisions of 0.01 mm"),
        ({"repeatability_mm": 6.0}, "repeatability of 6 mm"),
        ({"resolution_mm": 0.5}, "division of 0.5 mm"),
        ({"range_mm": 0.1, "revolution_mm": None}, "range of 0.1 mm"),
        ({"range_mm": 1000.0}, "range of 1000 mm"),
        ({"revolution_mm": 100.0}, "turn of 100 mm within a range of 10 mm"),
    ],
)
def test_a_gauge_that_does_not_exist_is_questioned(
    wrong: dict[str, float], words: str, tmp_path: Path
) -> None:
    """When a file is checked, made or, before the first reading, used; but it can be written."""
    assert not PROTOTYPE.gauge.implausible()
    gauge = PROTOTYPE.gauge.changed(**wrong)
    (doubt, *_) = gauge.implausible().values()
    assert words in sentence(doubt)
    path = tmp_path / "machine.yaml"
    machine = PROTOTYPE.changed(gauge=gauge)
    path.write_text(machine_text(Model(machine)), encoding="utf-8")
    (checked,) = lines(run("validate", str(path), "--json"))
    assert checked["valid"] is True
    assert sentence(doubt) in checked["remarks"]
    if wrong == {"repeatability_mm": 6.0}:
        made = ("machine", "new", "--yes", "--repeatability", "6", "-o", str(tmp_path / "m.yaml"))
        assert words in run(*made).stderr
        session = ("measure", str(tmp_path / "s.yaml"), "--machine", str(path))
        assert words in run(*session).stdout
        assert "A workshop of 61 °C?" in run(*session, "--temperature", "61").stderr
