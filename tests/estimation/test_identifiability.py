"""Data that do not determine the offsets: which ones, and whether the named readings mend it."""

import re

import numpy as np
import pytest

from orthoglide_cal.errors import RankDeficientError
from orthoglide_cal.estimation import solve
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences, Readings
from orthoglide_cal.plan import Contact
from orthoglide_cal.protocols import NAMES, double_posture, single_posture
from tests.estimation.sessions import OFFSETS, differences, readings, some
from tests.machines import LARGE, PROTOTYPE, both_machines

DOUBLE = re.compile(r"leg ([xyz]), direction ([xyz]), at max and min in one gauge set-up")
SINGLE = re.compile(r"leg ([xyz]), direction ([xyz]), at (iso|max|min), joint end and tool end")
POSTURES = {"iso": 0.0}


def refused(data: Readings | Differences, machine: Machine) -> RankDeficientError:
    with pytest.raises(RankDeficientError) as caught:
        solve(data, machine)
    assert caught.value.exit_code == 4
    for axis in caught.value.undetermined:
        assert f"Δρ_{axis}" in caught.value.what
    return caught.value


@both_machines
@pytest.mark.parametrize(
    ("names", "undetermined"),
    [
        (("x_y", "y_x"), ("z",)),
        (("y_z", "z_y"), ("x",)),
        (("x_z", "z_x"), ("y",)),
        (("x_y",), ("x", "y", "z")),
        (("x_y", "x_z"), ("x", "y", "z")),
    ],
)
def test_six_differences(
    machine: Machine, names: tuple[str, ...], undetermined: tuple[str, ...]
) -> None:
    full = differences("six", machine)
    error = refused(some(full, *names), machine)
    assert error.undetermined == undetermined
    added = [f"{direction}_{leg}" for leg, direction in DOUBLE.findall(error.remedy)]
    assert added
    mended = some(full, *dict.fromkeys((*names, *added)))
    assert solve(mended, machine).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


@pytest.mark.parametrize(
    ("names", "undetermined"),
    [
        (("z_x0", "z_y0"), ("x", "y")),
        (("z_x0", "z_x+", "z_x-"), ("y",)),
        (("z_x+", "z_y-"), ("x", "y", "z")),
    ],
)
def test_single_posture_differences(names: tuple[str, ...], undetermined: tuple[str, ...]) -> None:
    full = differences("single", PROTOTYPE)
    error = refused(some(full, *names), PROTOTYPE)
    assert error.undetermined == undetermined
    sign = {"iso": "0", "max": "+", "min": "-"}
    added = [f"{d}_{leg}{sign[posture]}" for leg, d, posture in SINGLE.findall(error.remedy)]
    mended = solve(some(full, *dict.fromkeys((*names, *added))), PROTOTYPE)
    # The linear method neglects terms of the order Δρ²/L.
    assert mended.offsets_mm == pytest.approx(OFFSETS, abs=0.1)


@both_machines
def test_raw_readings_and_the_readings_that_mend_them(machine: Machine) -> None:
    full = readings(machine, double_posture(machine), seed=None)
    plan = full.plan
    low, high = machine.joint_limits_mm
    rng = np.random.default_rng(3)
    refusals = 0
    for _ in range(60):
        kept = np.zeros(len(full), dtype=bool)
        kept[rng.choice(60, 6, replace=False)] = True
        try:
            solve(full.subset(kept), machine)
        except RankDeficientError as error:
            refusals += 1
            places = DOUBLE.findall(error.remedy)
            assert 1 <= len(places) <= 3
            for leg, direction in places:
                series = (plan.leg == "xyz".index(leg)) & (plan.direction == "xyz".index(direction))
                kept |= series & np.isin(plan.displacement, (low, high))
            assert solve(full.subset(kept), machine).offsets_mm == pytest.approx(OFFSETS, abs=1e-8)
    assert refusals > 30


def test_raw_single_posture_readings() -> None:
    full = readings(LARGE, single_posture(LARGE, 2), seed=None)
    plan = full.plan
    kept = plan.displacement == 0.0
    error = refused(full.subset(kept), LARGE)
    assert error.undetermined == ("x", "y")
    postures = {"iso": 0.0, "max": LARGE.joint_limits_mm[1], "min": LARGE.joint_limits_mm[0]}
    for leg, direction, posture in SINGLE.findall(error.remedy):
        series = (plan.leg == "xyz".index(leg)) & (plan.direction == "xyz".index(direction))
        kept |= series & (plan.displacement == postures[posture])
    assert solve(full.subset(kept), LARGE).offsets_mm == pytest.approx(OFFSETS, abs=1e-8)


def test_one_reading_of_each_cell_is_no_difference() -> None:
    """Every gauge zero takes one reading away."""
    full = readings(PROTOTYPE, double_posture(PROTOTYPE))
    firsts = np.unique(full.plan.setup, return_index=True)[1]
    error = refused(full.subset(firsts), PROTOTYPE)
    assert error.undetermined == ("x", "y", "z")


def test_joint_ends_alone_say_nothing() -> None:
    full = readings(PROTOTYPE, single_posture(PROTOTYPE))
    error = refused(full.subset(full.plan.contact == Contact.JOINT), PROTOTYPE)
    assert "joint end and tool end" in error.remedy


def test_no_number_survives_a_refusal() -> None:
    error = refused(some(differences("six", PROTOTYPE), NAMES["six"][0]), PROTOTYPE)
    assert not re.search(r"\d\.\d", str(error))
