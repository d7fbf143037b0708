"""What follows from a result: answer, release, adjustment, history; against independent sums."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t as student

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.estimation import solve
from orthoglide_cal.kinematics import direct
from orthoglide_cal.outcome import history, identify, latest_session, read_case
from orthoglide_cal.outcome.adjustment import JointOffset, adjust
from orthoglide_cal.outcome.answer import choose_answer, plain_answer
from orthoglide_cal.outcome.pairing import verify_cases
from orthoglide_cal.outcome.release import release
from orthoglide_cal.outcome.rounding import decimals_for, rounded
from orthoglide_cal.outcome.summary import as_expected, as_found, explained
from orthoglide_cal.outcome.traces import traces
from orthoglide_cal.report.numbers import plain, signed, two_figures, with_uncertainty
from tests.report import cases
from tests.report.cases import FINE, MACHINE, TRUE
from tests.report.sessions import DRIFT, FIRST, HISTORY, recorded, session, write_history


def test_expanded_uncertainty_uses_students_t():
    solution = solve(session(TRUE, 1), MACHINE)
    answer = plain_answer(solution)
    assert answer.dof == 51
    assert answer.k == pytest.approx(float(student.ppf(0.975, 51)), rel=1e-9)
    assert answer.expanded_mm == pytest.approx(answer.k * solution.std_mm)


@pytest.mark.parametrize(
    ("uncertainty", "decimals"),
    [(0.0214, 3), (0.21, 2), (0.0996, 2), (0.00996, 3), (1.24, 1), (12.4, 0), (0.00031, 4), (0, 4)],
)
def test_two_significant_figures(uncertainty, decimals):
    assert decimals_for(uncertainty) == decimals


def test_numbers_as_people_read_them():
    assert with_uncertainty(-0.52745, 0.0158) == "-0.527 ± 0.016"
    assert with_uncertainty(0.5, 1.24) == "+0.5 ± 1.2"
    assert two_figures(0.0996) == "0.10"
    assert signed(-0.0004, 3) == "0.000"
    assert plain(-0.0, 2) == "0.00"
    assert str(rounded(-0.0001, 3)) == "0.0"


def test_adjustment_adds_to_what_is_active():
    machine = replace(MACHINE, offsets_mm=(0.1, -0.25, 1.0005))
    solution = solve(session(TRUE, 2, machine=machine), machine)
    adjustment = adjust(solution, plain_answer(solution), machine)
    assert adjustment.decimals == 4
    for joint, previous, found in zip(
        adjustment.joints, machine.offsets_mm, solution.offsets_mm, strict=True
    ):
        assert joint.new_mm == pytest.approx(previous + found, abs=5.1e-5)
        assert len(str(joint.new_mm).partition(".")[2]) <= 4
    assert JointOffset("x", 0.1, 0.2, 0.01).new_mm == 0.3


def test_check_posture_is_where_the_offsets_show_most():
    """Expected difference after the adjustment, from an independent machine that was adjusted."""
    machine, measured = MACHINE, session(TRUE, 3)
    solution = solve(measured, machine)
    check = adjust(solution, plain_answer(solution), machine).check
    assert check is not None
    assert (check.leg, check.direction) == ("x", "z")
    assert check.first == (-100.0, 0.0, 0.0)
    assert check.second == (60.0, 0.0, 0.0)
    for tool, joints in ((check.first, check.first_joints), (check.second, check.second_joints)):
        assert direct(np.array(joints), machine.leg_length_mm) == pytest.approx(tool, abs=1e-9)
    inside = 0
    for seed in range(200):
        once = session(TRUE - np.round(solution.offsets_mm, 3), 1000 + seed)
        plan = once.plan
        mine = (plan.leg == 0) & (plan.direction == 2)
        low, high = (once.value[mine & (plan.displacement == d)][0] for d in (-100.0, 60.0))
        inside += abs(high - low - check.expected_mm) <= check.tolerance_mm
    # At least 95 %; with 99 % true, fewer than 190 of 200 happen once in 10,000 times.
    assert inside >= 190


def test_release_follows_the_diagnosis():
    assert cases.healthy().release.usable
    for make in (
        cases.named_in_machine,
        cases.named_in_measurement,
        cases.ambiguous,
        cases.unexplained,
        cases.failed,
    ):
        decision = make().release
        assert not decision.usable
        assert decision.reasons
        assert decision.remedies
    assert cases.few().release.cautions


def test_a_cause_that_moves_nothing_does_not_bar_the_offsets():
    """A misread iso reading of few hundredths: named, but within the uncertainty."""
    measured = session(TRUE, 4)
    solution, diagnosis = solve(measured, MACHINE), cases.named_in_measurement().findings.diagnosis
    near = replace(diagnosis, offsets_mm=solution.offsets_mm + 0.001)
    decision = release(solution, near)
    assert decision.usable
    assert "misread was found" in decision.cautions[0]
    assert not release(solution, replace(near, offsets_mm=solution.offsets_mm + 0.1)).usable


def test_without_a_diagnosis_unexplained_residuals_bar_the_offsets():
    gap = CAUSES["axis_gap"].at(np.array([0.3, -0.2, 0.25]))
    solution = solve(session(TRUE, 5, machine=FINE, effects=(gap,)), FINE)
    assert not release(solution, None).usable
    assert release(solve(session(TRUE, 5, machine=FINE), FINE), None).usable


def test_diagnosed_offsets_are_nearer_the_truth():
    calibration = cases.named_in_machine()
    findings = calibration.findings
    assert findings.answer.model == ("axis_gap",)
    assert np.abs(findings.plain.offsets_mm - TRUE).max() > 0.05
    assert np.all(np.abs(findings.answer.offsets_mm - TRUE) < 2.0 * findings.answer.expanded_mm)
    assert choose_answer(findings.solution, None).model == ()


def test_summary_and_shares():
    calibration = cases.named_in_machine()
    solution, diagnosis = calibration.findings.solution, calibration.findings.diagnosis
    found, expected = as_found(solution), as_expected(solution)
    measured = [row.measured_mm for row in solution.table]
    assert found.rms_mm == pytest.approx(np.sqrt(np.mean(np.square(measured))))
    assert abs(found.largest_mm) == max(abs(value) for value in measured)
    assert expected.rms_mm < found.rms_mm
    shown = calibration.findings.traces
    parts = explained(diagnosis, shown.leg, shown.order)
    assert parts.by_cause + parts.noise + parts.unexplained == pytest.approx(1.0)
    assert parts.by_cause > 0.9
    assert parts.rms_after_mm < 0.2 * parts.rms_before_mm


def test_traces_leave_residuals_alone():
    measured = session(TRUE, 6)
    solution = solve(measured, MACHINE)
    shown = traces(measured, solution.readings_mm)
    assert shown.residual_mm == pytest.approx(measured.value - solution.readings_mm)
    iso = measured.plan.displacement == 0.0
    assert shown.predicted_mm[iso] == pytest.approx(0.0, abs=1e-12)
    assert sorted(shown.order) == list(range(1, 61))
    rms = shown.rms_by_series()
    assert list(rms) == ["y_x", "z_x", "x_y", "z_y", "x_z", "y_z"]
    mine = np.array([name == "z_y" for name in shown.series])
    assert rms["z_y"] == pytest.approx(np.sqrt(np.mean(shown.residual_mm[mine] ** 2)))


def test_numbers_are_unique_and_tell_the_time():
    moment = datetime(2026, 3, 4, 5, 6, 7, 123, UTC)
    numbers = {
        identify(digest, moment + timedelta(microseconds=k)).number
        for digest in ("a", "b")
        for k in range(50)
    }
    assert len(numbers) == 100
    assert all(number.startswith("OC-20260304-050607-") for number in numbers)


def test_history_of_a_machine(tmp_path: Path):
    write_history(tmp_path)
    found = history(tmp_path)
    assert [entry.adjusted for entry in found.entries] == [False, True, False, False]
    assert datetime.fromtimestamp(found.last_adjusted, UTC).isoformat() == HISTORY[1][0]
    assert [name for name, _ in found.left_out] == ["broken.yaml"]
    for k, entry in enumerate(found.entries):
        truth = np.array(FIRST) + k * np.array(DRIFT)
        assert np.all(np.abs(entry.total_mm - truth) < 2.0 * entry.expanded_mm)
    since_first, since_adjustment = found.drifts
    assert since_first.days == pytest.approx(291.0)
    assert since_adjustment.days == pytest.approx(262.0)
    assert since_first.moved == (True, False, False)
    first, last = found.entries[0], found.entries[-1]
    assert since_first.change_mm == pytest.approx(last.total_mm - first.total_mm)
    assert since_first.expanded_mm == pytest.approx(np.hypot(first.expanded_mm, last.expanded_mm))


def test_history_of_two_machines_asks_which(tmp_path: Path):
    write_history(tmp_path)
    other = replace(MACHINE, name="Other")
    record = recorded(session(TRUE, 7), other, finished="2026-05-05T10:00:00")
    (tmp_path / "other.yaml").write_text(_text(record))
    with pytest.raises(UsageError, match="2 machines"):
        history(tmp_path)
    chosen = history(tmp_path, "Other")
    assert len(chosen.entries) == 1
    assert chosen.drifts == ()
    assert len(chosen.left_out) == 5
    with pytest.raises(InputError, match="no usable session"):
        history(tmp_path, "Third")
    with pytest.raises(InputError, match="no such folder"):
        history(tmp_path / "nowhere")


def test_latest_session_by_content_and_time(tmp_path: Path):
    with pytest.raises(InputError, match="no session"):
        latest_session(tmp_path)
    write_history(tmp_path)
    assert latest_session(tmp_path).name == "session-3.yaml"
    undated = recorded(session(TRUE, 8), MACHINE)
    (tmp_path / "undated.yml").write_text(_text(undated))
    for year, latest in ((2020, "session-3.yaml"), (2030, "undated.yml")):
        moment = datetime(year, 1, 1, tzinfo=UTC).timestamp()
        os.utime(tmp_path / "undated.yml", (moment, moment))
        assert latest_session(tmp_path).name == latest


def test_conditions_are_never_invented(tmp_path: Path):
    path = tmp_path / "bare.yaml"
    path.write_text(_text(recorded(session(TRUE, 9), MACHINE)))
    given = read_case(str(path)).conditions
    assert (given.operator, given.started, given.finished, given.protocol) == (None,) * 4
    assert given.temperature_c is None
    assert given.gauges == ()


def test_applied_offsets_come_from_the_sessions(tmp_path: Path):
    write_history(tmp_path)
    before, after, later = (read_case(str(tmp_path / f"session-{k}.yaml")) for k in (0, 1, 2))
    assert verify_cases(before, after).applied_mm == pytest.approx(HISTORY[1][1])
    with pytest.raises(UsageError, match="do not say what was entered"):
        verify_cases(after, later)
    other = replace(before, machine=replace(MACHINE, leg_length_mm=300.0))
    with pytest.raises(UsageError, match="leg_length_mm differ"):
        verify_cases(other, after, (0.1, 0.1, 0.1))


def test_the_diagnosis_is_that_of_the_command():
    measured = session(TRUE, 3)
    found = diagnose(measured, MACHINE)
    assert cases.healthy().findings.diagnosis.verdict == found.verdict


def _text(record) -> str:
    from orthoglide_cal.data import session_text

    return session_text(record)
