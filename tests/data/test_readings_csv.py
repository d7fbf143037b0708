"""Readings written as CSV come back exactly."""

import dataclasses

import numpy as np
import pytest

from orthoglide_cal.data import read_measured, readings_csv
from orthoglide_cal.measured import Readings, Source
from orthoglide_cal.protocols import double_posture, single_posture

from .helpers import MACHINE

NAMES = {0.0: "iso", 60.0: "max", -100.0: "min"}


def made(plan, **changes) -> Readings:
    n = len(plan)
    rng = np.random.default_rng(7)
    content = {
        "plan": plan,
        "value": rng.normal(0.0, 1.0, n),
        "cycle": 1 + np.arange(n) // 6,
        "posture": tuple(NAMES.get(d, repr(d)) for d in plan.displacement.tolist()),
        "temperature": np.full(n, np.nan),
        "gauge": ("",) * n,
        "note": ("",) * n,
        "line": np.arange(n) + 2,
        "timed": True,
        "source": Source("made", ""),
    }
    return Readings(**{**content, **changes})


def again(tmp_path, readings: Readings) -> Readings:
    path = tmp_path / "r.csv"
    path.write_text(readings_csv(readings))
    return read_measured(str(path), MACHINE)


def assert_same(one: Readings, other: Readings) -> None:
    for field in dataclasses.fields(one.plan):
        if field.name == "hours":
            np.testing.assert_allclose(one.plan.hours, other.plan.hours, rtol=0, atol=1e-8)
        elif field.name != "gauge_at":
            a, b = getattr(one.plan, field.name), getattr(other.plan, field.name)
            np.testing.assert_array_equal(a, b, field.name)
    fixed = one.plan.contact == 0
    np.testing.assert_array_equal(one.plan.gauge_at[fixed], other.plan.gauge_at[fixed])
    for name in ("value", "cycle", "temperature"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    for name in ("posture", "note", "timed"):
        assert getattr(one, name) == getattr(other, name)


@pytest.mark.parametrize(
    "plan",
    [double_posture(MACHINE), double_posture(MACHINE, cycles=1, gauge_at=0.3),
     single_posture(MACHINE, cycles=2)],
)  # fmt: skip
def test_protocols_come_back_exactly(tmp_path, plan):
    readings = made(plan)
    read = again(tmp_path, readings)
    assert_same(readings, read)
    assert read.gauge == readings.gauge
    assert read.remarks == ()


def test_every_column(tmp_path):
    plan = double_posture(MACHINE, cycles=1)
    n = len(plan)
    readings = made(
        plan,
        temperature=np.where(np.arange(n) % 2, np.nan, 20 + np.arange(n) / 7),
        gauge=tuple("AB"[k % 2] for k in range(n)),
        note=('#1, "x";\ty', "two\nlines", *[""] * (n - 2)),
    )
    read = again(tmp_path, readings)
    assert_same(readings, read)
    assert read.gauge == readings.gauge


def test_order_in_time_other_than_the_order_of_rows(tmp_path):
    plan = double_posture(MACHINE, cycles=1)
    shuffled = np.random.default_rng(3).permutation(len(plan))
    readings = made(plan).subset(shuffled)
    read = again(tmp_path, dataclasses.replace(readings, line=np.arange(len(plan)) + 2))
    np.testing.assert_array_equal(read.plan.order, readings.plan.order)
    np.testing.assert_allclose(read.plan.hours, readings.plan.hours, rtol=0, atol=1e-8)
    pairs = set(zip(read.plan.setup.tolist(), readings.plan.setup.tolist(), strict=True))
    assert len(pairs) == read.plan.setups == readings.plan.setups


def test_setups_that_only_the_plan_tells_apart(tmp_path):
    plan = double_posture(MACHINE, cycles=2)
    moved = plan.setup + np.where(plan.order < 5, 0, plan.setups)
    moved = np.unique(moved, return_inverse=True)[1]
    read = again(tmp_path, made(dataclasses.replace(plan, setup=moved)))
    pairs = set(zip(read.plan.setup.tolist(), moved.tolist(), strict=True))
    assert len(pairs) == read.plan.setups == moved.max() + 1


def test_assumed_times_are_not_written(tmp_path):
    plan = double_posture(MACHINE, cycles=1)
    read = again(tmp_path, made(plan, timed=False))
    assert not read.timed
    assert "minutes" not in readings_csv(made(plan, timed=False))


def test_columns_without_content_are_left_out():
    text = readings_csv(made(double_posture(MACHINE, cycles=1)))
    assert text.split("\n")[0] == "seq,leg,posture,direction,reading_mm,cycle,minutes"


def test_minutes_are_short():
    text = readings_csv(made(double_posture(MACHINE, cycles=1)))
    minutes = [line.split(",")[6] for line in text.splitlines()[1:]]
    assert minutes[::2] == ["0", "0.4", "0.8", "1.2", "5.6", "6", "6.4", "6.8", "11.2", "11.6",
                            "12", "12.4"]  # fmt: skip
