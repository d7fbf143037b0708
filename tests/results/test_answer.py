"""The answer to an input: what it holds, from independent sums; release, check, budget, workspace.

Formats and pages are tested where they are made.
"""

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from itertools import starmap

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import t as student

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.budget import Scatter
from orthoglide_cal.estimation.solution import Solution, promise
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.result import Parameter, Verdict
from orthoglide_cal.model.machine import Entered
from orthoglide_cal.model.measured import Source
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import single_posture
from orthoglide_cal.model.readings import AXES, Series
from orthoglide_cal.model.workspace import workspace_error
from orthoglide_cal.report.case import Case
from orthoglide_cal.results import making
from orthoglide_cal.results.answer import Answer, identify
from orthoglide_cal.results.making import answer_to, release
from orthoglide_cal.words import signed
from tests import truth
from tests.inference.sessions import changed
from tests.inference.sessions import given as touched
from tests.machines import NOMINAL, PROTOTYPE, sure
from tests.printers import printer
from tests.results import cases
from tests.results.cases import GAPED
from tests.results.sessions import FINE, TRUE, given, session
from tests.sentences import sentences
from tests.truth.delta import V400, Layout, Truth, probe_bed
from tests.truth.plan import frozen


def diagnosis_of(case: Case) -> Diagnosis:
    return diagnose(case.given.measured, case.given.model)


def found(answer: Answer) -> np.ndarray:
    return np.array([each.found for each in answer.parameters])


def expanded(answer: Answer) -> np.ndarray:
    return np.array([each.expanded for each in answer.parameters])


def test_an_answer_is_printed_with_a_sentence_for_every_reason() -> None:
    for make in cases.CASES.values():
        case = make()
        data, release = case.data(), case.answer.release
        assert json.loads(json.dumps(data, allow_nan=False, ensure_ascii=False)) == data
        printed = data["release"]
        assert printed["codes"] == [each.code for each in (*release.reasons, *release.cautions)]
        assert printed["reasons"] == [*map(case.says, release.reasons)]
        assert set(printed["cautions"]) <= set(data["notes"])
        remedies = [remedy["sentence"] for remedy in printed["remedies"]]
        for said in (*printed["reasons"], *printed["cautions"], *remedies, *data["notes"]):
            assert said[0].isupper() or said[0].isdigit() or "_" in said.split()[0], said
            assert said[-1] in ".:?", said
        with pytest.raises(ValidationError, match="frozen"):
            case.answer.k = 2.0  # type: ignore[misc]


def test_expanded_uncertainty_uses_students_t() -> None:
    """Of 51 degrees of freedom where only the noise of the readings is uncertain."""
    model = sure(NOMINAL)
    nothing = dict.fromkeys(CAUSES, 0.0)
    model = replace(model, machine=model.machine.changed(tolerances=nothing))
    answer = answer_to(given(cases.healthy().given.measured, model))
    solution = solve(cases.healthy().given.measured, model)
    assert answer.dof == 51
    assert answer.k == pytest.approx(float(student.ppf(0.975, 51)), rel=1e-9)
    assert expanded(answer) == pytest.approx(answer.k * solution.budget.std_mm)
    assert found(answer) == pytest.approx(solution.offsets_mm)


def test_the_budget_holds_what_the_data_leave_open() -> None:
    """Each cause that may hide in healthy data, by its probability: how far it would move the
    offsets, and how much less sure it leaves them."""
    case = cases.healthy()
    answer, solution = case.answer, solve(case.given.measured, case.given.model)
    (_, alone), *others = diagnosis_of(case).left_open
    assert others
    lines = [each for each in answer.budget if each.possible]
    assert [each.source for each in lines] == [fit.effects[0].cause.id for _, fit in others]
    for each, (share, fit) in zip(lines, others, strict=True):
        apart = fit.offsets - solution.offsets_mm
        less_sure = fit.offsets_covariance - alone.offsets_covariance
        size2, directions = np.linalg.eigh(share * (less_sure + np.outer(apart, apart)))
        # A cause that leaves them a little surer takes nothing away.
        positive = (directions * np.maximum(size2, 0.0)) @ directions.T
        assert np.square(each.std) == pytest.approx(np.diag(positive), rel=1e-6, abs=1e-15)
        assert size2.max() > 0.0
    std = np.array([each.std for each in answer.parameters])
    assert np.sum([np.square(each.std) for each in answer.budget], axis=0) == pytest.approx(std**2)
    assert np.all(std > solution.budget.std_mm)


def test_new_values_add_to_what_is_active() -> None:
    active = (0.1, -0.25, 1.0005)
    machine = PROTOTYPE.changed(offsets_mm=active)
    answer = answer_to(given(session(TRUE, 3), replace(NOMINAL, machine=machine)))
    assert answer.decimals == 4
    for each, previous in zip(answer.parameters, active, strict=True):
        assert each.active == previous
        assert each.enter == pytest.approx(previous + each.found, abs=5.1e-5)
        assert each.enter == pytest.approx(previous + each.change(4), abs=1e-12)
        assert len(str(each.enter).partition(".")[2]) <= 4
    machine = PROTOTYPE.changed(offsets_mm=(0.12345, 0.0, 0.0))
    assert answer_to(given(session(TRUE, 3), replace(NOMINAL, machine=machine))).decimals == 5
    one = Parameter(name="x", unit="mm", active=0.1, found=0.2, std=0.1, expanded=0.2)
    assert one.new(3) == 0.3
    unknown = one.model_copy(update={"found": None})
    assert (unknown.new(3), unknown.change(3)) == (0.1, 0.0)


def test_the_check_is_where_the_offsets_show_most() -> None:
    """Expected difference after the adjustment, from an independent machine that was adjusted."""
    answer = cases.healthy().answer
    check = answer.check
    assert (check.what, check.leg, check.direction) == ("dz_x", "x", "z")
    assert check.first_mm == (-100.0, 0.0, 0.0)
    assert check.second_mm == (60.0, 0.0, 0.0)
    assert not check.ends
    inside, entered = 0, np.array([each.change(answer.decimals) for each in answer.parameters])
    for seed in range(200):
        once = session(TRUE - entered, 1000 + seed)
        mine = once.plan.of(Series(0, 2))
        low, high = (
            once.value[mine & (once.plan.displacement == end[0])][0]
            for end in (check.first_mm, check.second_mm)
        )
        inside += abs(high - low - check.expected_mm) <= check.expanded_mm
    # At least 95 %; with 99 % true, fewer than 190 of 200 happen once in 10,000 times.
    assert inside >= 190
    ends = answer_to(given(session(TRUE, 8, plan=single_posture(PROTOTYPE, cycles=3)))).check
    assert ends.ends
    assert ends.first_mm == ends.second_mm
    assert ends.what[-1] in "0+-"


def as_diagnosed(case: Case, diagnosis: Diagnosis) -> Solution:
    return making.as_judged(case.given, diagnosis.alone, diagnosis.alone, diagnosis)


def test_the_promise_takes_what_was_found_into_account() -> None:
    """With a gap the diagnosed offsets leave something: the check says what, as simulation does."""
    case = cases.named_in_machine()
    answer, measured, diagnosis = case.answer, case.given.measured, diagnosis_of(case)
    model, noise = as_diagnosed(case, diagnosis).model, diagnosis.left_open[0][1].sigma
    shown = {"offsets_mm": diagnosis.offsets_mm, "budget": diagnosis.budget}
    known = replace(diagnosis.alone, model=model, noise=Scatter(noise, np.inf), **shown)
    entered = np.array([each.change(answer.decimals) for each in answer.parameters])
    promised = [row.expanded_mm for row in promise(measured, known, entered)]
    assert [row.expanded_mm for row in answer.deviations] == pytest.approx(promised, rel=1e-9)
    check, plan = answer.check, measured.plan
    mine = plan.of(Series(AXES.index(check.leg), AXES.index(check.direction)))
    ends = [
        np.flatnonzero(mine & (plan.displacement == end[0]))[0]
        for end in (check.first_mm, check.second_mm)
    ]
    readings = simulate(GAPED, TRUE - found(answer), plan)
    assert check.expected_mm == pytest.approx(readings[ends[1]] - readings[ends[0]], abs=0.01)
    solution = solve(measured, case.given.model)
    promised = promise(measured, solution, solution.offsets_mm)
    plain = next(row for row in promised if row.name == check.what)
    assert abs(plain.expected_mm - check.expected_mm) > 0.02


def test_a_solution_that_did_not_converge_is_not_released() -> None:
    """Its own check is computed again from the problem; no flag is believed."""
    case = cases.healthy()
    solution, diagnosis = solve(case.given.measured, case.given.model), diagnosis_of(case)
    assert release(solution, diagnosis).usable
    moved = replace(solution, offsets_mm=solution.offsets_mm + 0.01 * solution.budget.std_mm)
    decision = release(moved, diagnosis)
    assert not decision.usable
    assert "did not converge" in sentences(decision.reasons)[0]
    assert decision.remedies[0].verb == "validate"


@pytest.mark.parametrize(("stated", "offset", "usable"), [
    (None, 4.9, True), (None, -5.1, False), (8.0, -5.1, True), (2.0, 2.1, False),
])  # fmt: skip
def test_offsets_beyond_homing_are_questioned(stated, offset, usable):
    """Whatever the diagnosis says: a wrong unit is as consistent as millimetres."""
    machine = PROTOTYPE.changed(homing_mm=stated)
    model = replace(NOMINAL, machine=machine)
    found = answer_to(given(session((0.1, offset, -0.2), 21, model), model))
    assert found.verdict is Verdict.CONSISTENT
    assert found.release.usable == found.release.sound == usable
    if not usable:
        (reason,) = sentences(found.release.reasons)
        assert f"y {signed(found.parameters[1].found, 3)} mm" in reason
        assert f"up to {model.machine.plausible[0]:g} mm" in reason
        assert "homing_mm" in sentences([found.release.remedies[0].sentence])[0]


def test_a_cause_that_moves_nothing_does_not_bar_the_offsets() -> None:
    """A misread iso reading of few hundredths: named, but within the uncertainty."""
    healthy = cases.healthy().given
    solution = solve(healthy.measured, healthy.model)
    diagnosis = diagnosis_of(cases.named_in_measurement())
    near = changed(diagnosis, offsets=(solution.offsets_mm + 0.001, diagnosis.covariance_mm2))
    decision = release(solution, near)
    assert decision.usable
    assert "With misread the offsets change by at most" in sentences(decision.cautions)[0]
    far = changed(diagnosis, offsets=(solution.offsets_mm + 0.1, diagnosis.covariance_mm2))
    assert not release(solution, far).usable


def test_cautions_judge_the_residuals_as_the_answer_does() -> None:
    """By the fit of the diagnosis: arms that distances free leave less than the parameters."""
    diagnosis = diagnosis_of(cases.healthy())
    judged = changed(diagnosis, lack_of_fit=diagnosis.lack_of_fit.changed(p_value=1e-9))
    assert release(judged.alone, judged).codes == ("residuals_too_large",)
    assert release(diagnosis.alone, diagnosis).codes == ()


def test_what_is_open_holds_only_offsets_that_it_falsifies() -> None:
    """Of 15 that are entered all but two are within their U, as 96 % of such tests would show."""
    entered = [("backlash", 21), ("backlash", 26)]
    entered += [("encoder_scale", seed) for seed in (16, 23, 25)]
    assert not undecided("thermal_drift", 14)[1].release.usable
    within = 0
    for made, answer in starmap(undecided, entered):
        assert answer.release.usable
        within += np.count_nonzero(np.abs(found(answer) - made.offsets) <= expanded(answer))
    assert within >= 13


def undecided(cause: str, seed: int) -> tuple[truth.Session, Answer]:
    made = truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, (cause,))
    answer = answer_to(touched(made))
    assert answer.verdict is Verdict.AMBIGUOUS
    return made, answer


def test_under_a_named_cause_the_parameters_are_those_with_it() -> None:
    """Nearer the truth than offsets alone; those stand beside them, and a method asks for them."""
    case = cases.named_in_machine()
    answer, solution = case.answer, solve(case.given.measured, case.given.model)
    assert answer.named == ("axis_gap",)
    assert found(answer) == pytest.approx(diagnosis_of(case).offsets_mm)
    assert np.all(np.abs(found(answer) - TRUE) < 2.0 * expanded(answer))
    alone = np.array([each.found for each in answer.alone.parameters])
    assert alone == pytest.approx(solution.offsets_mm)
    assert np.abs(alone - TRUE).max() > 0.05
    asked = answer_to(case.given, "readings")
    assert found(asked) == pytest.approx(solution.offsets_mm)
    assert (asked.alone, asked.named) == (None, ())
    assert asked.verdict is Verdict.NAMED
    assert not asked.release.usable
    # Of healthy data they are the solution's, and nothing stands beside them.
    single = cases.single()
    healthy = solve(single.given.measured, single.given.model)
    assert found(single.answer) == pytest.approx(healthy.offsets_mm, abs=1e-12)
    assert single.answer.alone is None


def test_where_several_are_open_the_parameters_are_their_mean() -> None:
    case = cases.ambiguous()
    open_ = diagnosis_of(case).left_open
    mean = sum(share * fit.offsets for share, fit in open_)
    assert found(case.answer) == pytest.approx(mean)
    within = sum(share * np.diag(fit.offsets_covariance) for share, fit in open_)
    apart = sum(share * (fit.offsets - mean) ** 2 for share, fit in open_)
    std = np.array([each.std for each in case.answer.parameters])
    assert np.all(std >= (1.0 - 1e-9) * np.sqrt(within + apart))
    assert case.answer.alone is None


def test_what_is_open_is_the_same_in_the_release_and_in_the_diagnosis() -> None:
    answer = cases.ambiguous().answer
    (undecided,) = (reason for reason in answer.release.reasons if reason.code == "undecided")
    asked = {state.ids for state in answer.explanations if state.parameters and state.ids}
    assert set(undecided.data["answers"]) == asked


def test_the_place_of_the_fault_stands_in_the_first_line_of_the_advice() -> None:
    answer = cases.named_in_measurement().answer
    (cause,) = answer.causes
    assert cause.where == "leg x, direction z, min, cycle 2 (reading 12)"
    (remedy,) = answer.release.remedies
    assert sentences([remedy.sentence])[0].startswith(f"Read again: {cause.where}. ")


def test_offsets_and_causes_keep_their_correlations() -> None:
    """The page's "at most" after the adjustment, from the covariance of the diagnosis."""
    case = cases.named_in_machine()
    answer, diagnosis = case.answer, diagnosis_of(case)
    covariance, model = diagnosis.covariance_mm2, as_diagnosed(case, diagnosis).model
    correlation = covariance / np.outer(diagnosis.std_mm, diagnosis.std_mm)
    assert np.array(answer.correlation) == pytest.approx(correlation, rel=1e-9)
    assert np.abs(correlation - np.eye(3)).max() > 0.05

    def at_most(spread: np.ndarray) -> float:
        return workspace_error(model, found(answer), spread, answer.k or 0.0).after_mm

    assert answer.workspace.after_mm == pytest.approx(at_most(covariance), rel=1e-9)
    assert at_most(np.diag(np.diag(covariance))) != pytest.approx(at_most(covariance), rel=1e-3)

    (effect,) = model.accepted
    assert np.array_equal(effect.covariance, diagnosis.effects[0].covariance)
    off = effect.covariance - np.diag(np.diag(effect.covariance))
    assert np.abs(off).max() > 0.01 * np.diag(effect.covariance).max()
    assert effect.data_sha256 == case.source.sha256
    for other in (cases.named_in_measurement(), cases.ambiguous()):
        assert as_diagnosed(other, diagnosis_of(other)).model.accepted == ()


def test_one_input_is_diagnosed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For details alone is computed what only they show."""
    given, made, work = cases.named_in_machine().given, list[object](), making.diagnose

    def counted(*values: object, **named: object) -> Diagnosis:
        made.append(values)
        return work(*values, **named)

    monkeypatch.setattr(making, "diagnose", counted)
    plain, full = answer_to(given), answer_to(given, details=True)
    assert len(made) == 2
    assert (plain.sensitivity, plain.workspace) == (None, None)
    assert list(full.sensitivity) == ["halved", "doubled"]
    unseen = {"sensitivity": None, "workspace": None}
    assert full.model_copy(update=unseen).model_dump() == plain.model_dump()


def test_every_reading_stands_beside_what_is_modelled() -> None:
    """In the file's order; what a named cause leaves is what is told, and noise."""
    for make in (cases.named_in_machine, cases.single, cases.ambiguous):
        case = make()
        rows = case.answer.residuals
        assert [row.measured_mm for row in rows] == case.given.measured.value.tolist()
        assert sorted(row.order for row in rows) == list(range(1, len(rows) + 1))
    assert {row.end for row in cases.single().answer.residuals} == {"joint", "tool"}
    assert cases.ambiguous().answer.residuals[0].posture == "dx_y"
    named = cases.named_in_machine().answer
    explained = [row.measured_mm - (row.with_causes_mm or 0.0) for row in named.residuals]
    assert np.sqrt(np.mean(np.square(explained))) == pytest.approx(named.rms.after_mm)
    # 60 readings, less 3 offsets and 6 zeros: what the gauge's noise leaves of itself.
    noise = np.sqrt(51.0 / 60.0) * FINE.machine.gauge.noise_mm
    assert named.rms.after_mm == pytest.approx(noise, rel=0.3)


def test_a_number_says_what_a_report_shows_and_not_when():
    moment = datetime(2026, 3, 4, 5, 6, 7, 123, UTC)
    renamed = Model(NOMINAL.machine.changed(name="Other"))
    entry = Entered(
        date="2026-03-03",
        before={"x": 0.0, "y": 0.0, "z": 0.0},
        after={"x": 0.1, "y": 0.2, "z": 0.3},
        data_sha256="a" * 64,
    )
    entered = replace(NOMINAL, machine=NOMINAL.machine.changed(history=(entry,)))

    def read(path, digest, model=NOMINAL):
        return given(replace(session(TRUE, 3), source=Source(path, digest)), model)

    same = read("a.csv", "a")
    made = [
        ([same], ()),
        ([read("a.csv", "b")], ()),
        ([read("a.csv", "a", renamed)], ()),
        ([same], ("six",)),
        ([same] * 2, ()),
        ([read("moved/a.csv", "a")], ()),
        ([read("a.csv", "a", entered)], ()),
    ]
    numbers = [identify(inputs, *options, issued=moment).number for inputs, options in made]
    assert len(set(numbers)) == len(made)
    assert all(re.fullmatch("OC-[0-9A-F]{6}-[0-9A-F]{6}", number) for number in numbers)
    later = [identify(inputs, *options).number for inputs, options in made]
    assert later == numbers


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
    model = Model(printer(V400).changed(tolerances={"leg_length": 0.0}))
    release = answer_to(replace(touched(session), model=model)).release
    assert release.usable is usable
    said = " ".join(sentences(release.reasons, model.machine))
    assert ("no printer is that far off" in said) is not usable
