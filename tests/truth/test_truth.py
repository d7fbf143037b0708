"""The truth must itself be true: its noise, its clock, its draws and its files.

Its geometry and its effects are compared with the program's, which stand on other legs, in
`tests/causes` and `tests/estimation`.
"""

import csv
import io
import re
from pathlib import Path

import numpy as np
import pytest

from . import (
    DIAL,
    MICRON,
    PROTOTYPE,
    Machine,
    make_session,
    measure,
    readings_csv,
    second_session,
    signals,
    standard_plan,
)
from .effects import state_with, swapped_rows, transposed
from .forward import PARTS
from .plan import Plan, frozen
from .session import Setting

OFFSETS = frozen([0.43, -0.71, 0.28])


def _plan(machine: Machine = PROTOTYPE, seed: int = 5) -> Plan:
    return standard_plan(machine, np.random.default_rng(seed))


def test_legs_places_and_scale_act_as_drawn() -> None:
    """Ten thousand times too large, so that noise and rounding do not matter."""
    rng = np.random.default_rng(6)
    plan = _plan()
    wild = Setting(frozen([1.1, -0.6, 0.4]), frozen(np.linspace(-20.0, 30.0, 6)), 0.02)
    session = measure(PROTOTYPE, MICRON, plan, OFFSETS, (), rng, setting=wild)
    state = state_with(OFFSETS, ())
    state[PARTS["leg_length"]] = wild.legs
    surface = signals(plan, PROTOTYPE, state[None], None, wild.misplaced)[0]
    expected = 1.02 * (surface + session.zeros[plan.setup])
    assert np.abs(session.readings - expected).max() < 6.0 * MICRON.sigma
    assert np.abs(session.readings - session.clean).max() > 0.1


def test_settings_have_the_stated_sizes() -> None:
    """400 sessions: standard deviations within 20 %, 5.6 of their own at least."""
    drawn = [make_session(seed, PROTOTYPE, DIAL).setting for seed in range(400)]
    for part, sd in (("legs", 0.01), ("misplaced", 1.0), ("scale", 0.001)):
        assert np.std([getattr(each, part) for each in drawn]) == pytest.approx(sd, rel=0.2)
    # The machine and the gauge stay; the stands are put there again.
    first = make_session(3, PROTOTYPE, DIAL)
    later = second_session(first, 3).setting
    assert np.array_equal(later.legs, first.setting.legs)
    assert later.scale == first.setting.scale
    assert not np.any(later.misplaced == first.setting.misplaced)
    exact = make_session(3, PROTOTYPE, DIAL, exact=True)
    assert not exact.setting.misplaced.any()
    assert not second_session(exact, 3).setting.misplaced.any()


def test_tired_eyes_exchange_neighbouring_digits() -> None:
    assert transposed(-3.147, 3, 1) == -3.417
    assert transposed(0.652, 3, 2) == 0.625
    assert transposed(1.27, 2, 2) == 1.72
    digits = [make_session(s, PROTOTYPE, MICRON, ("misread",)) for s in range(60)]
    sizes = np.abs([s.effects[0].parameters[0] for s in digits])
    assert 0.004 < sizes.min() < sizes.max() < 0.95
    written = [s.readings[s.effects[0].row] for s in digits]
    assert np.allclose(written, np.round(written, 3))


def test_next_day_keeps_the_machine_and_forgets_the_blunders() -> None:
    first = make_session(3, PROTOTYPE, MICRON, ("backlash", "gauge_slip"))
    later = second_session(first, 8)
    assert later.causes == ("backlash",)
    assert later.effects[0].parameters[:3] == first.effects[0].parameters[:3]
    assert later.effects[0].parameters[3:] != first.effects[0].parameters[3:]
    assert np.array_equal(later.offsets, first.offsets)
    assert not np.allclose(later.zeros, first.zeros)


def test_the_file_is_the_contracts_and_tells_nothing() -> None:
    session = make_session(1, PROTOTYPE, DIAL, ("swapped_gauges",))
    rows = list(csv.DictReader(io.StringIO(readings_csv(session))))
    assert [float(row["reading_mm"]) for row in rows] == session.readings.tolist()
    assert [int(row["seq"]) for row in rows] == list(range(1, 61))
    assert {row["leg"] + row["direction"] for row in rows} == {"xy", "xz", "yx", "yz", "zx", "zy"}
    assert all(len(row["reading_mm"].split(".")[1]) == 2 for row in rows)
    assert "swap" not in readings_csv(session)
    assert swapped_rows(session.plan, 1)[20:24].tolist() == [21, 20, 23, 22]


def test_the_truth_does_not_know_the_program() -> None:
    for path in Path(__file__).parent.glob("*.py"):
        names = re.findall(r"^\s*(?:from|import) (\S+)", path.read_text("utf-8"), re.MULTILINE)
        assert not [name for name in names if name.startswith(("orthoglide_cal", "tests"))], path
