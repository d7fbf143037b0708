"""Data that do not determine the offsets: which ones, and whether those named complete them."""

import re

import numpy as np
import pytest

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import solve
from orthoglide_cal.model.measured import Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.readings import AXES, GaugePlan, Series
from tests.estimation.sessions import OFFSETS, SINGLE, SIX, differences, only, readings
from tests.machines import NOMINAL, both_models
from tests.readings import some

DOUBLE_WORDS = re.compile(r"leg ([xyz]), direction ([xyz]), at max and min in one gauge set-up")
SINGLE_WORDS = re.compile(
    r"leg ([xyz]), direction ([xyz]), at (iso|max|min), joint end and tool end"
)


def refused(data: Measured, model: Model) -> UnusableResultError:
    with pytest.raises(UnusableResultError) as caught:
        solve(data, model)
    assert caught.value.exit_code == 4
    assert not re.search(r"\d\.\d", str(caught.value))
    return caught.value


def named(error: UnusableResultError) -> tuple[str, ...]:
    return tuple(axis for axis in AXES if f"Δρ_{axis}" in error.what)


def of(plan: GaugePlan, leg: str, direction: str) -> np.ndarray:
    return plan.of(Series(AXES.index(leg), AXES.index(direction)))


@both_models
@pytest.mark.parametrize(
    ("names", "undetermined"),
    [
        (("dx_y", "dy_x"), ("z",)),
        (("dy_z", "dz_y"), ("x",)),
        (("dx_z", "dz_x"), ("y",)),
        (("dx_y",), ("x", "y", "z")),
        (("dx_y", "dx_z"), ("x", "y", "z")),
    ],
)
def test_six_differences(
    model: Model, names: tuple[str, ...], undetermined: tuple[str, ...]
) -> None:
    full = differences(SIX, model)
    error = refused(only(full, *names), model)
    assert named(error) == undetermined
    added = [f"d{direction}_{leg}" for leg, direction in DOUBLE_WORDS.findall(error.remedy)]
    assert added
    completed = only(full, *names, *added)
    assert solve(completed, model).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    # No more than are needed: with one of them less it is refused again.
    for left_out in added:
        refused(only(full, *names, *(name for name in added if name != left_out)), model)


@pytest.mark.parametrize(
    ("names", "undetermined"),
    [
        (("dz_x0", "dz_y0"), ("x", "y")),
        (("dz_x0", "dz_x+", "dz_x-"), ("y",)),
        (("dz_x+", "dz_y-"), ("x", "y", "z")),
    ],
)
def test_single_posture_differences(names: tuple[str, ...], undetermined: tuple[str, ...]) -> None:
    full = differences(SINGLE, NOMINAL)
    error = refused(only(full, *names), NOMINAL)
    assert named(error) == undetermined
    sign = {"iso": "0", "max": "+", "min": "-"}
    added = [f"d{d}_{leg}{sign[posture]}" for leg, d, posture in SINGLE_WORDS.findall(error.remedy)]
    completed = solve(only(full, *dict.fromkeys((*names, *added))), NOMINAL)
    # The linear method neglects terms of the order Δρ²/L.
    assert completed.offsets_mm == pytest.approx(OFFSETS, abs=0.1)


@both_models
def test_raw_readings_and_the_readings_that_complete_them(model: Model) -> None:
    full = readings(model, double_posture(model.machine), seed=None)
    plan = full.plan
    rng = np.random.default_rng(3)
    refusals = 0
    for _ in range(60):
        kept = np.zeros(len(full), dtype=bool)
        kept[rng.choice(60, 6, replace=False)] = True
        try:
            solve(some(full, kept), model)
        except UnusableResultError as error:
            refusals += 1
            places = DOUBLE_WORDS.findall(error.remedy)
            assert 1 <= len(places) <= 3
            for leg, direction in places:
                ends = np.isin(plan.displacement, model.machine.joint_limits_mm)
                kept |= of(plan, leg, direction) & ends
            completed = solve(some(full, kept), model)
            assert completed.offsets_mm == pytest.approx(OFFSETS, abs=1e-8)
    assert refusals > 30
