"""Release, adjustment, residuals, workspace and export of a calibration; against independent sums.

Formats and pages are tested where they are made.
"""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from datetime import UTC, datetime

import numpy as np
import pytest
from orthoglide_cal.results.adjustment import as_found
from orthoglide_cal.results.residuals import residuals
from scipy.stats import t as student

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import DOUBTFUL, Verdict
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import Known, promise, solve, stays
from orthoglide_cal.model import Entered, Model, Series, Source, Stage, simulate, single_posture
from orthoglide_cal.model.machine import JointOffsets
from orthoglide_cal.model.workspace import workspace_error
from orthoglide_cal.results import calibrate, calibration, export, identify, release
from tests.machines import NOMINAL, PROTOTYPE, sure
from tests.printers import plan_of_session, printer, readings_of_touches
from tests.results import cases
from tests.results.sessions import FINE, TRUE, given, session
from tests.truth.delta import V400, Layout, Truth, probe_bed
from tests.truth.plan import frozen

NOT_USABLE = (
    cases.named_in_machine,
    cases.named_in_measurement,
    cases.ambiguous,
    cases.unexplained,
    cases.failed,
)


def with_active(found, *active):
    """The calibration on a machine whose controller holds these offsets already."""
    machine = found.input.model.machine.changed(offsets_mm=active)
    return replace(
        found, input=replace(found.input, model=replace(found.input.model, machine=machine))
    )


def of_solution(measured, model=NOMINAL):
    return alone(solve(measured, model), model)


def alone(solution, model=NOMINAL):
    return as_found(
        solution, None, Known(model, solution.offsets_mm, solution.covariance_mm2), None
    )


def test_expanded_uncertainty_uses_students_t():
    """Of 51 degrees of freedom where only the noise of the readings is uncertain."""
    measured = cases.healthy().input.measured
    solution = solve(measured, sure(NOMINAL))
    adjustment = of_solution(measured, sure(NOMINAL))
    assert adjustment.causes == ()
    budget = adjustment.budget
    assert budget.dof == pytest.approx(51)
    assert budget.k == pytest.approx(float(student.ppf(0.975, 51)), rel=1e-9)
    assert adjustment.expanded_mm == pytest.approx(budget.k * solution.std_mm)
    assert budget.covariance_mm2 == pytest.approx(solution.covariance_mm2)


def test_the_budget_holds_what_the_data_leave_open():
    """Each cause that may hide in healthy data, by its probability: how far it would move the
    offsets, and how much less sure it leaves them."""
    found = cases.healthy()
    (_, alone), *others = found.diagnosis.left_open
    assert others
    assert alone.effects == ()
    budget = found.adjustment.budget
    known = len(found.solution.budget.contributions)
    assert budget.contributions[:known] == found.solution.budget.contributions
    open_ = [each for each in budget.contributions[known:] if each.source != "temperature"]
    assert [each.source for each in open_] == [fit.effects[0].cause.id for _, fit in others]
    for each, (share, fit) in zip(open_, others, strict=True):
        apart = fit.offsets - found.solution.offsets_mm
        less_sure = fit.joint_covariance() - alone.joint_covariance()
        expected = np.linalg.eigvalsh(share * (less_sure + np.outer(apart, apart)))
        # A cause that leaves them a little surer takes nothing away.
        assert np.linalg.eigvalsh(each.covariance_mm2) == pytest.approx(
            np.maximum(expected, 0.0), rel=1e-6, abs=1e-15
        )
        assert expected.max() > 0.0
    assert np.sum([each.covariance_mm2 for each in budget.contributions], axis=0) == pytest.approx(
        budget.covariance_mm2
    )
    assert np.all(found.adjustment.std_mm > found.solution.std_mm)


def test_adjustment_adds_to_what_is_active():
    active = (0.1, -0.25, 1.0005)
    found = with_active(cases.healthy(), *active)
    assert found.adjustment.decimals == 4
    for joint, previous, offset in zip(
        found.adjustment.joints, active, found.solution.offsets_mm, strict=True
    ):
        assert joint.previous_mm == previous
        assert joint.new_mm == pytest.approx(previous + offset, abs=5.1e-5)
        assert joint.new_mm == pytest.approx(previous + joint.change_mm, abs=1e-12)
        assert len(str(joint.new_mm).partition(".")[2]) <= 4
    assert with_active(cases.healthy(), 0.12345, 0.0, 0.0).adjustment.decimals == 5


def test_new_values_are_free_of_binary_rounding():
    wanted = replace(cases.healthy().solution, offsets_mm=np.array([0.2, 0.0, 0.0]))
    machine = PROTOTYPE.changed(offsets_mm=(0.1, 0.0, 0.0))
    made = alone(wanted, replace(NOMINAL, machine=machine))
    assert [joint.new_mm for joint in made.joints] == [0.3, 0.0, 0.0]


def test_check_posture_is_where_the_offsets_show_most():
    """Expected difference after the adjustment, from an independent machine that was adjusted."""
    adjustment = cases.healthy().adjustment
    check = adjustment.check
    assert check.difference.series == Series(leg=0, direction=2)
    assert check.first == (-100.0, 0.0, 0.0)
    assert check.second == (60.0, 0.0, 0.0)
    assert not check.ends
    for tool, joints in ((check.first, check.first_joints), (check.second, check.second_joints)):
        # Each leg reaches from its carriage on its axis to the tool.
        carriages = np.diag(joints)
        assert np.linalg.norm(np.array(tool) - carriages, axis=1) == pytest.approx(
            PROTOTYPE.leg_length_mm
        )
    inside = 0
    for seed in range(200):
        once = session(TRUE - np.array(adjustment.applied_mm), 1000 + seed)
        mine = once.plan.of(check.difference.series)
        low, high = (
            once.value[mine & (once.plan.displacement == end[0])][0]
            for end in (check.first, check.second)
        )
        inside += abs(high - low - check.expected_mm) <= check.tolerance_mm
    # At least 95 %; with 99 % true, fewer than 190 of 200 happen once in 10,000 times.
    assert inside >= 190


def test_check_at_the_ends_of_a_leg():
    check = of_solution(session(TRUE, 8, plan=single_posture(PROTOTYPE, cycles=3))).check
    assert check.ends
    assert check.first == check.second
    assert check.difference.name[-1] in "0+-"


def test_the_check_is_the_promise_of_the_model_with_what_was_found():
    """With a gap the diagnosed offsets leave something: the check says what, as simulation does."""
    found = cases.named_in_machine()
    check, offsets = found.adjustment.check, found.adjustment.offsets_mm
    assert offsets is found.diagnosis.offsets_mm or np.all(offsets == found.diagnosis.offsets_mm)
    known = Known(found.model, offsets, found.diagnosis.covariance_mm2)
    entered = np.array(found.adjustment.applied_mm)
    rows = promise(found.input.measured, known, entered, found.solution.noise)
    promised = {row.difference: row for row in rows}
    assert check.expected_mm == promised[check.difference].expected_mm
    gaped = FINE.extended([CAUSES["axis_gap"].at(cases.GAP)])
    plan = found.input.measured.plan
    mine = plan.of(check.difference.series)
    ends = [
        np.flatnonzero(mine & (plan.displacement == end[0]))[0]
        for end in (check.first, check.second)
    ]
    readings = simulate(gaped, TRUE - offsets, plan)
    assert check.expected_mm == pytest.approx(readings[ends[1]] - readings[ends[0]], abs=0.01)
    plain = next(row for row in found.solution.promised() if row.difference == check.difference)
    assert abs(plain.expected_mm - check.expected_mm) > 0.02


def test_release_follows_the_diagnosis():
    assert cases.healthy().release.usable
    for make in NOT_USABLE:
        decision = make().release
        assert not decision.usable
        assert decision.reasons
        assert decision.remedies
    assert cases.few().release.cautions


def test_a_solution_that_did_not_converge_is_not_released():
    """Its own check is computed again from the problem; no flag is believed."""
    found = cases.healthy()
    assert release(found.solution, found.diagnosis).usable
    moved = replace(found.solution, offsets_mm=found.solution.offsets_mm + 1e-6)
    for diagnosis in (found.diagnosis, None):
        decision = release(moved, diagnosis)
        assert not decision.usable
        assert "did not converge" in decision.reasons[0]
        assert decision.remedies[0].verb == "validate"


@pytest.mark.parametrize(("stated", "offset", "usable"), [
    (None, 4.9, True), (None, -5.1, False), (8.0, -5.1, True), (2.0, 2.1, False),
])  # fmt: skip
def test_offsets_beyond_homing_are_questioned(stated, offset, usable):
    """Whatever the diagnosis says: a wrong unit is as consistent as millimetres."""
    machine = PROTOTYPE.changed(homing_mm=stated)
    model = replace(NOMINAL, machine=machine)
    found = calibrate(given(session((0.1, offset, -0.2), 21, model), model))
    assert found.diagnosis.verdict is Verdict.CONSISTENT
    assert found.release.usable == found.release.sound == usable
    if not usable:
        (reason,) = found.release.reasons
        assert f"y {offset:+.1f} mm" in reason
        assert f"up to {model.machine.plausible[0]:g} mm" in reason
        assert "homing_mm" in found.release.remedies[0].sentence


def test_a_cause_that_moves_nothing_does_not_bar_the_offsets():
    """A misread iso reading of few hundredths: named, but within the uncertainty."""
    solution, diagnosis = cases.healthy().solution, cases.named_in_measurement().diagnosis
    near = replace(diagnosis, offsets_mm=solution.offsets_mm + 0.001)
    decision = release(solution, near)
    assert decision.usable
    assert "misread was found" in decision.cautions[0]
    assert not release(solution, replace(near, offsets_mm=solution.offsets_mm + 0.1)).usable


def test_without_a_diagnosis_unexplained_residuals_bar_the_offsets():
    gaped = FINE.extended([CAUSES["axis_gap"].at(cases.GAP)])
    assert not release(solve(session(TRUE, 5, gaped), FINE), None).usable
    assert release(solve(session(TRUE, 5, FINE), FINE), None).usable


def test_diagnosed_offsets_are_nearer_the_truth():
    found = cases.named_in_machine()
    assert found.adjustment.causes == ("axis_gap",)
    assert np.abs(found.solution.offsets_mm - TRUE).max() > 0.05
    assert np.all(np.abs(found.adjustment.offsets_mm - TRUE) < 2.0 * found.adjustment.expanded_mm)


def test_the_place_of_the_fault_stands_in_the_first_line_of_the_advice():
    found = cases.named_in_measurement()
    (cause,) = found.diagnosis.causes
    assert cause.where == "leg x, direction z, min, cycle 2 (reading 12)"
    (remedy,) = found.release.remedies
    assert remedy.sentence.startswith(f"Take this reading again: {cause.where}. ")


def test_all_commands_show_the_offsets_of_one_result():
    """Of healthy data the solution's, also where the diagnosis has its own a little beside them."""
    found = cases.single()
    assert found.diagnosis.verdict is Verdict.CONSISTENT
    assert found.adjustment is found.alone
    assert np.array_equal(found.adjustment.offsets_mm, found.solution.offsets_mm)
    wrong = cases.named_in_machine()
    assert np.array_equal(wrong.alone.offsets_mm, wrong.solution.offsets_mm)
    assert np.array_equal(wrong.adjustment.offsets_mm, wrong.diagnosis.offsets_mm)


def test_the_offsets_keep_their_correlations():
    """The page's "at most" after the adjustment, from the covariance of the diagnosis."""
    found = cases.named_in_machine()
    adjustment, covariance = found.adjustment, found.diagnosis.covariance_mm2
    assert adjustment.budget.covariance_mm2 == pytest.approx(covariance, rel=1e-9)
    correlation = covariance / np.outer(found.diagnosis.std_mm, found.diagnosis.std_mm)
    assert np.abs(correlation - np.eye(3)).max() > 0.05

    def at_most(spread):
        return workspace_error(
            found.model, adjustment.offsets_mm, spread, adjustment.budget.k
        ).after_max_mm

    assert found.workspace.after_max_mm == pytest.approx(at_most(covariance), rel=1e-9)
    assert at_most(np.diag(np.diag(covariance))) != pytest.approx(at_most(covariance), rel=1e-3)


def test_the_causes_keep_their_correlations():
    found = cases.named_in_machine()
    (effect,) = found.model.accepted
    fitted = found.diagnosis.causes[0].effect
    assert np.array_equal(effect.covariance, fitted.covariance)
    off = effect.covariance - np.diag(np.diag(effect.covariance))
    assert np.abs(off).max() > 0.01 * np.diag(effect.covariance).max()
    assert effect.data_sha256 == found.solution.source.sha256
    assert effect.date == cases.ISSUED.date().isoformat()
    assert cases.named_in_measurement().model.accepted == ()
    assert cases.ambiguous().model.accepted == ()
    lost = cases.named_in_machine().diagnosis.causes[0]
    assert lost.effect.cause.stage is Stage.GEOMETRY


def test_one_input_is_diagnosed_once(monkeypatch):
    made = []
    once = calibration.diagnose
    monkeypatch.setattr(
        calibration, "diagnose", lambda *a, **k: made.append(once(*a, **k)) or made[-1]
    )
    for found in (cases.healthy(), cases.named_in_machine()):
        calibrate(found.input, sensitivity=DOUBTFUL)
    assert [each.verdict for each in made] == [Verdict.CONSISTENT, Verdict.NAMED]
    assert [len(each.sensitivity) for each in made] == [0, 2]


def test_as_found_expected_and_left():
    found = cases.as_left()
    measured = [row.measured_mm for row in found.solution.promised()]
    assert found.as_found.rms_mm == pytest.approx(np.sqrt(np.mean(np.square(measured))))
    assert abs(found.as_found.largest_mm) == max(abs(value) for value in measured)
    assert found.as_found.largest.name == "dz_x"
    assert found.expected.rms_mm < 0.1 * found.as_found.rms_mm
    assert found.as_left.rms_mm == pytest.approx(found.expected.rms_mm, abs=0.02)
    assert cases.healthy().as_left is None
    assert cases.failed().as_found is None


def test_shares_of_the_residuals():
    parts = cases.named_in_machine().explained
    assert parts.by_cause + parts.noise + parts.unexplained == pytest.approx(1.0)
    assert parts.by_cause > 0.9
    assert parts.rms_after_mm < 0.2 * parts.rms_before_mm
    assert cases.unexplained().explained.unexplained > 0.5


def test_pictures_leave_residuals_alone():
    measured = session(TRUE, 6)
    solution = solve(measured, NOMINAL)
    shown = residuals(measured, solution.predicted_mm)
    assert shown.residual_mm == pytest.approx(measured.value - solution.predicted_mm)
    iso = measured.plan.displacement == 0.0
    assert shown.predicted_mm[iso] == pytest.approx(0.0, abs=1e-12)
    assert sorted(shown.order) == list(range(1, 61))
    rms = shown.rms_by_series()
    assert [series.name for series in rms] == ["y_x", "z_x", "x_y", "z_y", "x_z", "y_z"]
    mine = measured.plan.of(Series(1, 2))
    assert rms[Series(1, 2)] == pytest.approx(np.sqrt(np.mean(shown.residual_mm[mine] ** 2)))


def test_pictures_of_differences_and_of_leg_ends():
    shown = cases.ambiguous().residuals
    assert shown.label[0] == "dx_y"
    assert shown.leg.tolist() == [series.leg for series in shown.series]
    assert np.isnan(shown.displacement_mm).all()
    assert set(shown.end) == {None}
    ends = cases.single().residuals
    assert set(ends.end) == {"joint", "tool"}
    # The zero is the joint end at the isotropic posture, where the stand was set up.
    start = (ends.displacement_mm == 0.0) & np.array([end == "joint" for end in ends.end])
    assert ends.predicted_mm[start] == pytest.approx(0.0, abs=1e-12)


def test_no_result_has_nothing_to_show():
    found = cases.failed()
    empty = (found.solution, found.diagnosis, found.adjustment, found.residuals, found.workspace)
    assert empty == (None,) * 5


@pytest.mark.parametrize("make", [cases.healthy, cases.named_in_machine, cases.as_left])
def test_a_result_is_frozen_to_the_last_array(make):
    seen, waiting = set(), [make(), make().adjustment, make().residuals, make().explained]
    while waiting:
        value = waiting.pop()
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable
        elif isinstance(value, tuple):
            waiting += value
        elif is_dataclass(value) and id(value) not in seen:
            seen.add(id(value))
            waiting += [getattr(value, field.name) for field in fields(value)]
            with pytest.raises((FrozenInstanceError, AttributeError)):
                setattr(value, fields(value)[0].name, None)
    assert len(seen) > 20


def test_a_number_says_what_went_in_and_not_when():
    moment = datetime(2026, 3, 4, 5, 6, 7, 123, UTC)
    renamed = Model(NOMINAL.machine.changed(name="Other"))
    given = [
        ([(Source("a.csv", "a"), NOMINAL)], ()),
        ([(Source("a.csv", "b"), NOMINAL)], ()),
        ([(Source("a.csv", "a"), renamed)], ()),
        ([(Source("a.csv", "a"), NOMINAL)], ("six",)),
        ([(Source("a.csv", "a"), NOMINAL)] * 2, ()),
    ]
    numbers = [identify(inputs, *options, issued=moment).number for inputs, options in given]
    assert len(set(numbers)) == len(given)
    assert all(re.fullmatch("OC-[0-9A-F]{6}-[0-9A-F]{6}", number) for number in numbers)
    later = [identify(inputs, *options).number for inputs, options in given]
    assert later == numbers
    # Where the file lies does not matter.
    assert identify([(Source("moved/a.csv", "a"), NOMINAL)]).number == numbers[0]
    # What is entered later in the controller is no part of it.
    entry = Entered(
        date="2026-03-03",
        before=JointOffsets(0.0, 0.0, 0.0),
        after=JointOffsets(0.1, 0.2, 0.3),
        data_sha256="a" * 64,
    )
    entered = replace(NOMINAL, machine=NOMINAL.machine.changed(history=(entry,)))
    assert identify([(Source("a.csv", "a"), entered)]).number == numbers[0]


def test_what_is_shown_as_left_has_a_number_of_its_own():
    left = cases.as_left()
    assert left.verification is not None
    alone = calibrate(left.input, issued=cases.ISSUED)
    again = calibrate(left.input, "readings", verification=left.verification)
    assert again.identity.number == left.identity.number
    assert again.identity.issued != left.identity.issued
    assert alone.identity.number != left.identity.number


@pytest.mark.parametrize("make", NOT_USABLE[:4])
def test_what_must_not_be_used_is_refused_and_marked_if_forced(make):
    found = make()
    with pytest.raises(UnusableResultError, match="Export refused") as refused:
        export(found)
    assert refused.value.exit_code == 4
    assert "--force" in refused.value.remedy
    assert found.release.reasons[0] in str(refused.value)
    forced = export(found, force=True)
    assert forced.status == "FORCED"
    assert forced.forced == found.release.reasons
    assert export(cases.healthy()).status == "released"
    assert export(cases.healthy(), force=True).forced == ()


def test_nothing_can_be_forced_out_of_no_result():
    with pytest.raises(UnusableResultError, match="do not determine") as refused:
        export(cases.failed(), force=True)
    assert "--force" not in refused.value.remedy


def test_each_step_takes_its_part_of_the_deviation():
    """From the readings themselves: their spread about the mean of each set-up, and the truth's."""
    found = cases.named_in_machine()
    assert list(found.left_mm) == ["as found", "offsets", "axis_gap"]
    readings = found.input.measured
    off = readings.value - simulate(found.input.model, np.zeros(3), readings.plan)
    for setup in range(readings.plan.setups):
        off[readings.plan.setup == setup] -= off[readings.plan.setup == setup].mean()
    as_found, offsets, cause = found.left_mm.values()
    assert as_found == pytest.approx(np.sqrt(np.mean(off**2)))
    assert offsets == pytest.approx(found.solution.rms_after_mm)
    # 60 readings, less 3 offsets and 6 zeros: what the gauge's noise leaves of itself.
    noise = np.sqrt(51.0 / 60.0) * FINE.machine.gauge.noise_mm
    assert cause == pytest.approx(noise, rel=0.3)
    # As much as that is noise alone; of what nobody explains it is the smaller part.
    assert found.noise_mm == cause
    assert cases.unexplained().noise_mm == pytest.approx(noise, rel=1e-6)
    assert cases.unexplained().noise_mm < 0.1 * cases.unexplained().left_mm["offsets"]
    assert list(cases.healthy().left_mm) == ["as found", "offsets"]
    assert list(cases.unexplained().left_mm) == ["as found", "offsets"]
    assert cases.failed().left_mm == {}
    assert cases.few().noise_mm is None


def test_accepted_causes_act_in_everything_that_follows():
    """The promise, the workspace and the check of a machine whose gap was accepted."""
    gaped = FINE.extended([CAUSES["axis_gap"].at(cases.GAP)])
    found = calibrate(given(session(TRUE, 11, gaped), gaped), issued=cases.ISSUED)
    assert found.release.usable
    assert found.model.accepted == gaped.accepted
    # Offsets do not remove a gap, neither from the legs' motion nor from the tool's place.
    assert found.expected.rms_mm > 0.05
    assert found.workspace.left_max_mm > 0.05
    assert stays(found.adjustment.promised)
    assert not stays(cases.healthy().adjustment.promised)
    assert found.workspace.after_mean_mm > 0.05
    straight = calibrate(given(session(TRUE, 11, FINE), FINE), issued=cases.ISSUED)
    assert straight.workspace.after_max_mm < 0.05
    expected = {row.difference: row.expected_mm for row in found.adjustment.promised}
    assert found.adjustment.check.expected_mm == expected[found.adjustment.check.difference]


@pytest.mark.parametrize(
    ("off", "usable"),
    [
        (Truth(radius=3.5), True),
        (Truth(radius=6.0), False),
        (Truth(angles=frozen([0.0, 1.5, 0.0])), True),
        (Truth(angles=frozen([0.0, 3.0, 0.0])), False),
        (Truth(endstops=frozen([0.0, 6.0, 0.0])), False),
    ],
    ids=["radius", "radius, too far", "angle", "angle, too far", "endstop, too far"],
)
def test_a_printer_is_told_what_printers_can_be_off_by(off: Truth, usable: bool) -> None:
    """A radius by 5 mm, an angle by 2 degrees, an endstop by 5 mm: beyond, it is another one."""
    session = probe_bed(V400, off, (), Layout(41), np.random.default_rng(1))
    plan = plan_of_session(session, session.readings)
    model = Model(printer(V400).changed(tolerances={"leg_length": 0.0}))
    release = calibrate(given(readings_of_touches(plan, session.readings), model)).release
    assert release.usable is usable
    assert any("no printer is that far off" in reason for reason in release.reasons) is not usable
