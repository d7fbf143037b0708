"""A solution is the optimum (eq. 25), or says how far it is from it; whether the model fits.

What it promises the gauges to read, once offsets are entered, is what the independent truth reads.
A common size, log odds, and a p value judged by losses are what no other test sees alone.
"""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.budget import Budget, Contribution, Scatter
from orthoglide_cal.estimation.gaussian import Mixture
from orthoglide_cal.estimation.solution import OPTIMAL, Solution, fit_offsets, promise
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.losses import is_likely, surprising
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, Posture
from orthoglide_cal.paper.tables import experiment
from tests import truth
from tests.estimation.sessions import (
    BENT,
    OFFSETS,
    SINGLE,
    SIX,
    TWELVE,
    differences,
    of_values,
    only,
    problem_of,
    readings,
)
from tests.machines import NOMINAL, NOMINAL_LARGE, PROTOTYPE, sure
from tests.planning.test_forecast import true_readings
from tests.readings import readings_of, some
from tests.sentences import sentences
from tests.truth.effects import Effect, state_with

DOUBLE_SESSION = readings(NOMINAL, double_posture(PROTOTYPE))
SINGLE_SESSION = readings(NOMINAL, single_posture(PROTOTYPE, 2))
SOLVED: list[tuple[Measured, str]] = [
    *((DOUBLE_SESSION, m) for m in ("six-linear", "twelve-linear", "six", "twelve", "readings")),
    *((SINGLE_SESSION, m) for m in ("single", "single-sequential", "readings")),
    *((experiment(1), m) for m in ("six-linear", "six")),
    *((differences(TWELVE, NOMINAL), m) for m in ("six-linear", "twelve-linear", "six", "twelve")),
    *((differences(SINGLE, NOMINAL), m) for m in ("single", "single-sequential")),
]


@pytest.mark.parametrize(
    ("data", "method"), SOLVED, ids=[f"{data.kind}-{method}" for data, method in SOLVED]
)
def test_it_is_an_optimum_by_the_problem_that_it_holds(data: Measured, method: str) -> None:
    solution = solve(data, NOMINAL, method)
    assert solution.model is NOMINAL
    assert solution.converged
    # From moved offsets a step is left that leads back, by as much as they were moved.
    for size, axis in product((2.0 * OPTIMAL, -0.1), np.eye(3)):
        away = solution.offsets_mm + size * solution.budget.std_mm * axis
        moved = replace(solution, offsets_mm=away)
        assert not moved.converged
        if not solution.method.linear:
            # By the stated noise: experiment 1 scatters by a hundred times as much.
            assert 0.5 * abs(size) <= moved.problem.remaining(moved.data, moved.offsets_mm)


def test_other_data_or_another_machine_are_noticed() -> None:
    for method in ("readings", "six-linear"):
        solution = solve(DOUBLE_SESSION, NOMINAL, method)
        shifted = solution.data + 0.001 * np.arange(len(solution.data))
        assert not replace(solution, data=shifted).converged
        assert not replace(solution, problem=replace(solution.problem, model=BENT)).converged
    # Offsets that no machine can have are no optimum.
    impossible = np.array([1e4, 0.0, 0.0])
    assert not replace(solve(DOUBLE_SESSION, NOMINAL), offsets_mm=impossible).converged


@pytest.mark.parametrize(
    ("chance", "suspicious", "words"),
    [
        (1e-5, True, "larger than the gauge's noise"),
        (0.01, False, "larger than usual"),
        (0.049, False, "p = 0.049"),
        (0.051, False, "agree with the gauge's noise"),
        (0.998, False, "(p > 0.99)"),
        (0.37, False, "p = 0.37"),
    ],
)
def test_the_judgement_goes_by_the_chance(chance: float, suspicious: bool, words: str) -> None:
    lack = diagnose(DOUBLE_SESSION, NOMINAL).lack_of_fit.changed(p_value=chance)
    assert (lack.judgement.code == "residuals_too_large") is suspicious
    assert words in sentences([lack.judgement])[0]


EXPERIMENT_1 = experiment(1).value


@pytest.mark.parametrize(("model", "kind"), [(NOMINAL, TWELVE), (NOMINAL_LARGE, SIX)])
def test_all_of_10_000_random_offsets_converge_from_zero(
    model: Model, kind: DataKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In nine steps, also of those near ±20 mm; all can be reached, or `predict` would raise."""
    monkeypatch.setattr("orthoglide_cal.estimation.solution.MAX_ITERATIONS", 9)
    problem = problem_of(kind, model)
    offsets = np.random.default_rng(7).uniform(-20.0, 20.0, (5_000, 3))
    fit = fit_offsets(problem, problem.predict(offsets))
    assert np.all(fit.converged)
    assert np.abs(fit.offsets_mm - offsets).max() < 1e-9


def test_steps_that_go_astray_are_damped() -> None:
    """At 40 mm of scatter plain Gauss–Newton steps lose 5 % of these sets, damped ones 0.2 %."""
    problem = problem_of(SIX, NOMINAL)
    # 5 mm that no offsets explain, a blunder in every reading: all converge.
    assert np.all(fit_offsets(problem, np.random.default_rng(1).normal(0, 5, (2000, 6))).converged)
    data = np.random.default_rng(2).normal(0.0, 40.0, (2000, 6))
    fit = fit_offsets(problem, data)
    assert np.mean(fit.converged) > 0.99
    # No step was taken that makes it worse than at zero offsets.
    assert np.all((fit.residuals_mm**2).sum(axis=-1) <= (data**2).sum(axis=-1))


def test_the_remaining_step_is_how_far_the_optimum_is() -> None:
    problem = problem_of(SIX, NOMINAL)
    fit = fit_offsets(problem, EXPERIMENT_1)
    assert problem.remaining(EXPERIMENT_1, fit.offsets_mm) < 1e-6
    away = np.array([0.0, 1e-6, 0.0])
    moved = problem.predict(fit.offsets_mm + away) - problem.predict(fit.offsets_mm)
    sigmas = np.linalg.norm(moved) / NOMINAL.machine.gauge.noise_mm
    remaining = problem.remaining(EXPERIMENT_1, fit.offsets_mm + away)
    assert remaining == pytest.approx(sigmas, rel=0.01)
    unit = problem.spread(np.linalg.pinv(problem.at_zero[1]))
    assert remaining >= 1e-6 / (NOMINAL.machine.gauge.noise_mm * np.sqrt(unit[1, 1]))


def test_each_set_begins_at_its_own_start(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, rng = problem_of(SIX, NOMINAL), np.random.default_rng(8)
    data = rng.normal(0.0, 0.5, (2000, 6))
    found = fit_offsets(problem, data).offsets_mm
    other = fit_offsets(problem, data, rng.uniform(-3.0, 3.0, (2000, 3)))
    assert np.abs(other.offsets_mm - found).max() < 1e-9
    # At the optimum there is nothing left to do.
    monkeypatch.setattr("orthoglide_cal.estimation.solution.MAX_ITERATIONS", 0)
    assert np.all(fit_offsets(problem, data, found).converged)


def test_data_out_of_all_reach_never_look_converged() -> None:
    """What converges is an optimum by its own recomputed check; the rest says that it is not."""
    problem = problem_of(SIX, NOMINAL)
    data = np.random.default_rng(2).normal(0.0, 100.0, (500, 6))
    fit = fit_offsets(problem, data)
    assert not np.all(fit.converged)
    again = problem.remaining(data, fit.offsets_mm)
    assert np.array_equal(again <= OPTIMAL, fit.converged)
    lost = data[np.flatnonzero(~fit.converged)[0]]
    with pytest.raises(UnusableResultError, match="No offsets fit these data") as caught:
        solve(of_values(SIX, lost), NOMINAL)
    assert caught.value.exit_code == 4


def test_log_odds_are_those_of_draws() -> None:
    """Mean and spread of 200,000 draws, met within five of their standard errors."""
    rng, count = np.random.default_rng(6), 200_000
    roots = rng.normal(size=(2, 2, 3, 3)) + 2.0 * np.eye(3)
    seen, judged = (
        Mixture(rng.normal(size=(2, 3, 1)), root @ root.swapaxes(-1, -2), np.zeros((2, 1)))
        for root in roots
    )
    mean, std = seen.log_odds(judged)
    for true, rival in ((0, 1), (1, 0)):
        drawn = rng.multivariate_normal(seen.means[true, :, 0], seen.covariance[true], count)
        logs = [
            stats.multivariate_normal(judged.means[k, :, 0], judged.covariance[k]).logpdf(drawn)
            for k in (true, rival)
        ]
        odds = logs[0] - logs[1]
        assert abs(odds.mean() - mean[true, rival]) < 5.0 * odds.std() / math.sqrt(count)
        assert std[true, rival] == pytest.approx(odds.std(), rel=0.02)


@pytest.mark.parametrize("odds", [0.01, 0.05, 0.2])
def test_to_state_nothing_costs_as_much_as_to_give_it_up(odds: float) -> None:
    """At the bound, with the most that a p value can say against its null hypothesis."""
    missed, needless = 75.0, 120.0
    p = surprising(odds, missed, needless)
    for share, given_up in ((0.99, True), (1.01, False)):
        against = float(odds / (-np.e * share * p * np.log(share * p)))
        assert is_likely(1.0 / (1.0 + against), missed, needless) is given_up


# Neither what was found nor near it, and different on every axis.
ENTERED = np.array([0.6, -1.1, 0.9])
NOISE = Scatter(0.006, 51.0)

GAPS = (Effect("axis_gap", "", tuple(BENT.accepted[0].theta.tolist())),)


def true_difference(kind: DataKind, difference: Difference, offsets: Floats) -> float:
    """One of the paper's differences on the bent machine, by the truth [mm]."""
    plan = (single_posture if kind is SINGLE else double_posture)(PROTOTYPE, 1)
    read, (series, posture) = true_readings(plan, PROTOTYPE, offsets, GAPS), difference

    def at(posture: Posture, contact: Contact = Contact.FIXED) -> float:
        there = plan.displacement == PROTOTYPE.displacement_mm(posture)
        return float(read[plan.of(series) & there & (plan.contact == contact)][0])

    if kind is SINGLE:
        return at(posture, Contact.TOOL) - at(posture, Contact.JOINT)
    first, second = (posture, Posture.ISO) if posture else (Posture.MAX, Posture.MIN)
    return at(first) - at(second)


FORMS = ["six", "twelve", "single", "double-posture readings", "single-posture readings"]
forms = pytest.mark.parametrize("form", FORMS)


def estimate(
    model: Model, offsets: Floats, variance: float = 1e-5, noise: Scatter = NOISE
) -> Solution:
    budget = Budget((Contribution.beyond("noise", variance * np.eye(3)),))
    solved = solve(of_values(DataKind.SIX, EXPERIMENT_1), NOMINAL)
    return replace(solved, model=model, offsets_mm=offsets, budget=budget, noise=noise)


def shown_as(form: str) -> DataKind:
    """The differences of the promise."""
    return SINGLE if "single" in form else SIX


def measured(form: str, offsets: Floats, noise: float = 0.0) -> Measured:
    """What was measured on the bent machine, with noise that no offsets explain."""
    rng = np.random.default_rng(8)
    if form in list(DataKind):
        kind = DataKind(form)
        values = np.array([true_difference(kind, each, offsets) for each in DIFFERENCES[kind]])
        return of_values(kind, values + noise * rng.standard_normal(len(values)))
    plan = (double_posture if "double" in form else single_posture)(PROTOTYPE, 2)
    zeros = np.linspace(-0.9, 0.8, plan.setups)[plan.setup]
    values = true_readings(plan, PROTOTYPE, offsets, GAPS) + zeros
    return readings_of(PROTOTYPE, plan, values + noise * rng.standard_normal(len(plan)))


@forms
def test_it_is_what_the_truth_reads_once_other_offsets_are_entered(form: str) -> None:
    """What is measured then is the truth's reading plus the misfit that was measured before."""
    data = measured(form, OFFSETS, noise=0.05)
    rows = promise(data, estimate(BENT, OFFSETS), ENTERED)
    assert [row.name for row in rows] == [each.name for each in DIFFERENCES[shown_as(form)]]
    misfits = []
    for which, row in zip(DIFFERENCES[shown_as(form)], rows, strict=True):
        before = true_difference(shown_as(form), which, OFFSETS)
        after = true_difference(shown_as(form), which, OFFSETS - ENTERED)
        assert row.modelled_mm == pytest.approx(before, abs=1e-9)
        assert row.expected_mm == pytest.approx(after + row.measured_mm - before, abs=1e-9)
        misfits.append(row.measured_mm - before)
    assert np.abs(misfits).max() > 0.03


def test_stands_put_up_anew_are_misplaced_anew() -> None:
    """Where they stood before and where they stand then are two independent errors."""
    stated = sure(NOMINAL).machine
    model = Model(stated.changed(gauge=stated.gauge.changed(placement_mm=2.0)))
    plan = truth.standard_plan(truth.PROTOTYPE, np.random.default_rng(1), cycles=1)
    column, posture = {}, np.array(plan.posture)
    for when, offsets in (("before", OFFSETS), ("after", OFFSETS - ENTERED)):
        state = state_with(offsets, ())[None]
        apart = [
            truth.signals(plan, truth.PROTOTYPE, state, misplaced=np.full(6, shift))[0]
            for shift in (2.0, 0.0)
        ]
        column[when] = apart[0] - apart[1]
    rows = promise(
        differences(SIX, model), estimate(model, OFFSETS, 1e-16, Scatter(1e-8, np.inf)), ENTERED
    )
    for which, row in zip(DIFFERENCES[SIX], rows, strict=True):
        mine = (plan.leg == which.series.leg) & (plan.direction == which.series.direction)
        high, low = (np.flatnonzero(mine & (posture == end))[0] for end in ("max", "min"))
        before, after = (column[when][high] - column[when][low] for when in ("before", "after"))
        assert abs(before * after) > 1e-8
        assert row.expanded_mm == pytest.approx(1.96 * np.hypot(before, after), rel=0.01)


def test_nothing_is_promised_where_nothing_was_measured() -> None:
    two = only(differences(SIX, NOMINAL), "dz_y", "dx_z")
    rows = promise(two, estimate(NOMINAL, OFFSETS), ENTERED)
    assert [row.name for row in rows] == ["dx_z", "dz_y"]
    session = readings(NOMINAL, double_posture(PROTOTYPE))
    part = some(session, session.plan.displacement != PROTOTYPE.joint_limits_mm[0])
    assert promise(part, estimate(NOMINAL, OFFSETS), OFFSETS) == ()
    rows = promise(session, estimate(NOMINAL, OFFSETS), OFFSETS)
    assert [row.name for row in rows] == ["dx_y", "dx_z", "dy_x", "dy_z", "dz_x", "dz_y"]
