"""What can be done next can be done, with each plunger on its bar, in the time of its steps."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orthoglide_cal.inference.result import NextMeasurement
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import (
    MARGIN,
    MINUTES_PER_SETUP,
    double_posture,
    single_posture,
    visiting,
)
from orthoglide_cal.model.plan import Plan
from orthoglide_cal.model.readings import Contact
from orthoglide_cal.planning.next_measurement import WAIT_MIN, options
from orthoglide_cal.planning.steps import Order, clock, design_of, steps_of
from orthoglide_cal.report.sentences import sentence
from tests import truth
from tests.cli.program import run, words
from tests.cli.test_plan import machine
from tests.inference.sessions import model_of
from tests.machines import LARGE, PROTOTYPE

MACHINE = model_of(truth.LARGE, truth.MICRON).machine
FIRST = double_posture(MACHINE, cycles=2)
ALL = [*options(FIRST, MACHINE)]
GOING_ON = [option for option in ALL if option.continues]
WITH_NEW_STANDS = [option for option in ALL if not option.continues]


@pytest.mark.parametrize("option", ALL, ids=lambda option: sentence(option.what))
def test_it_can_be_done(option: NextMeasurement) -> None:
    """Within the limits, after what was read, and it takes as long as its steps."""
    plan = option.plan
    low, high = MACHINE.joint_limits_mm
    assert plan.displacement.min() >= low
    assert plan.displacement.max() <= high
    whole = Plan.joined(FIRST, plan)
    assert np.all(np.diff(whole.order) > 0)
    assert np.all(np.diff(whole.hours) >= 0.0)
    assert sentence(option.what).endswith(".")
    minutes = clock(steps_of(option.plan, MACHINE, Order.PAPER, stands=2))[-1]
    if not option.continues:
        minutes += MINUTES_PER_SETUP  # the first, which those of a session do not count
    if "quarter of an hour" in sentence(option.what):
        minutes += WAIT_MIN
    assert option.minutes == pytest.approx(minutes)


def test_stands_that_stay_keep_their_zeros_and_others_get_new_ones() -> None:
    for option in GOING_ON:
        assert set(option.plan.part) == {0}
        assert set(option.plan.leg) == {2}
        assert set(option.plan.setup) <= set(FIRST.setup[FIRST.leg == 2])
    for option in WITH_NEW_STANDS:
        assert set(option.plan.part) == {1}
        assert option.plan.setup.min() == FIRST.setups
        stands = 2 * len(set(option.plan.leg))
        assert Plan.joined(FIRST, option.plan).setups == FIRST.setups + stands


def test_a_bar_that_was_turned_is_not_turned_again() -> None:
    turned = replace(FIRST, turned=np.ones_like(FIRST.turned))
    for option, usual in zip(options(turned, MACHINE), ALL, strict=True):
        assert option.minutes == usual.minutes
        assert option.plan.hours.tolist() == usual.plan.hours.tolist()


def test_each_teaches_something_else() -> None:
    """No two are the same readings, under any words."""
    seen = {
        tuple(np.concatenate([np.ravel(value) for value in vars(option.plan).values()]))
        for option in ALL
    }
    assert len(seen) == len(ALL)
    assert len({sentence(option.what) for option in ALL}) == len(ALL)


def test_a_step_is_entered_beside_what_was_entered_and_taken_back_behind_it() -> None:
    before = np.array([0.2, 0.0, -0.1])
    (stepped, *_) = (option for option in GOING_ON if "mm short" in sentence(option.what))
    both = Plan.joined(FIRST, stepped.plan)
    assert both.entered[both.in_time[-1]].any()
    entered = replace(FIRST, entered=np.tile(before, (len(FIRST), 1)))
    for first, stays in ((entered, before), (both, 0.0 * before)):
        for option in options(first, MACHINE):
            more = np.count_nonzero(option.plan.entered - stays, axis=1)
            assert np.all(more == ("mm short" in sentence(option.what)))


@pytest.mark.parametrize(("low", "way"), [(-100.0, "short"), (-13.2, "too far"), (-12.8, None)])
def test_a_step_stays_inside_the_limits(low: float, way: str | None) -> None:
    """Displaced by 100 mm, leg z takes carriages x and y down by √(L² − 100²) − L = −13.16 mm."""
    machine = PROTOTYPE.changed(leg_length_mm=386.5, joint_limits_mm=(low, 100.0))
    steps = [o for o in options(double_posture(machine), machine) if o.what.code == "read_short"]
    assert len(steps) == (0 if way is None else 2)
    for k, option in enumerate(steps):
        assert f"carriage {'xy'[k]} 0.3 mm {way}, as the screen shows" in sentence(option.what)
        wanted = 0.3 if way == "short" else -0.3
        assert {tuple(e) for e in option.plan.entered.tolist()} == {
            tuple(wanted * (axis == k) for axis in range(3))
        }
        others = np.sqrt(386.5**2 - option.plan.displacement**2) - 386.5 - wanted
        assert others.min() >= low


def test_after_other_places_of_the_gauges_theirs_is_named() -> None:
    displacements, gauge_at = design_of(MACHINE)
    for first in (visiting(displacements * 2, gauge_at), FIRST):
        for option in options(first, MACHINE):
            named = "with the gauges half-way" in sentence(option.what)
            half_way = set(option.plan.gauge_at) == {0.5}
            assert named == (first is not FIRST and not option.continues and half_way)


def test_without_stands_in_space_all_are_set_up() -> None:
    single = single_posture(MACHINE)
    assert not any(option.continues for option in options(single, MACHINE))
    unknown = [*options(None, MACHINE)]
    assert all(set(option.plan.contact) == {Contact.FIXED} for option in unknown)
    assert not any(option.continues for option in unknown)


SHORT = PROTOTYPE.changed(leg_length_mm=100.0, joint_limits_mm=(-90.0, 60.0))
NEAR = PROTOTYPE.changed(joint_limits_mm=(-130.0, 60.0))
LONG_WAY = PROTOTYPE.changed(joint_limits_mm=(-200.0, 0.0))


@given(length=st.floats(150.0, 900.0), low=st.floats(0.42, 0.8), high=st.floats(0.0, 0.8))
def test_advised_limits_are_safe(length: float, low: float, high: float) -> None:
    """Whole millimetres towards the isotropic posture, never farther out."""
    machine = PROTOTYPE.changed(
        leg_length_mm=length, joint_limits_mm=(-low * length, high * length)
    )
    warning = machine.bar_warning(double_posture(machine))
    limits = tuple(map(float, re.findall(r"\[(\S+), (\S+)\]", warning.remedy)[0]))
    safe = machine.changed(joint_limits_mm=limits)
    assert safe.bar_warning(double_posture(safe)) is None


@pytest.mark.parametrize("machine", [SHORT, NEAR, LONG_WAY, LARGE])
@pytest.mark.parametrize("at", [0.5, 0.9])
def test_options_never_leave_the_bar(machine: Machine, at: float) -> None:
    """Whatever was read, and wherever the gauges stand."""
    for first in (None, double_posture(machine, gauge_at=at)):
        found = [*options(first, machine)]
        assert found
        for option in found:
            plan = option.plan if first is None else Plan.joined(option.plan)
            touched = plan.gauge_at + plan.displacement / machine.leg_length_mm
            assert np.all(plan.contact == Contact.FIXED)
            assert np.all((touched >= -1e-9) & (touched <= 1.0 + 1e-9))
            if not option.continues:
                assert np.all((touched >= MARGIN - 1e-9) & (touched <= 1.0 - MARGIN + 1e-9))


def test_no_command_is_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    short = {"joint_limits_mm": [-90, 60], "leg_length_mm": 100.0, "workspace_mm": 50}
    path = machine(tmp_path, **short)
    shown = run("plan", "--machine", path)
    assert "\u2718 This cannot be measured in this way" in shown.stdout
    assert f"orthocal measure --machine {path} --design best" in shown.stdout
    assert "will be known within" not in shown.stdout
    for arguments in (
        ["plan", "--program", "posture.csv", "--machine", path],
        ["measure", "--gauge", "simulated", "--seed", "1", "--yes", "--machine", path],
    ):
        refused = run(*arguments)
        assert refused.exit_code == 3
        assert "The plunger leaves the bar" in refused.stderr
        assert "40 mm beyond the carriage joint" in refused.stderr
    assert "cannot be measured" not in run("plan", "--protocol", "single", "--machine", path).stdout
    assert list(tmp_path.iterdir()) == [Path(path)]
    near = machine(tmp_path, joint_limits_mm=[-130, 60], leg_length_mm=310.0, workspace_mm=50)
    assert "! 60 readings" in run("plan", "--machine", near).stdout
    written = run("plan", "--program", "posture.csv", "--machine", near)
    assert written.exit_code == 0
    assert "25 mm from it with carriage x at -130 mm" in words(written.stderr)
    assert "[-124, 60]" in words(written.stderr)
