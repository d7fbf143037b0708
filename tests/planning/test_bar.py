"""The plunger stays on the bar: what is planned says so, and what cannot be is not measured."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import MARGIN, double_posture
from orthoglide_cal.model.plan import joined
from orthoglide_cal.model.readings import Contact
from orthoglide_cal.planning.next_measurement import options
from tests.cli.program import run, words
from tests.cli.test_plan import machine
from tests.machines import LARGE, PROTOTYPE

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
        found = options(first, machine)
        assert found
        for option in found:
            plan = option.plan if first is None else joined(option.plan)
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
