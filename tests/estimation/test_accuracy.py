"""Covariance (26)–(33), the three sigmas, and intervals that cover what they say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.axes import Floats
from orthoglide_cal.errors import RankDeficientError, UsageError
from orthoglide_cal.estimation import Problem, solve, solve_many
from orthoglide_cal.estimation.accuracy import (
    chance_of_residual,
    half_width,
    scatter_of_repeats,
    scatter_of_residuals,
    sigma_rho,
    unit_covariance,
)
from orthoglide_cal.estimation.linear import calibration_matrix
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import (
    NAMES,
    SIX,
    TWELVE,
    double_posture,
    ideal_plan,
    reduction,
    single_posture,
    written_down,
)
from orthoglide_cal.simulation import simulate
from tests.estimation.sessions import NOWHERE, OFFSETS, differences, readings
from tests.machines import LARGE, PROTOTYPE, both_machines


def problem_of(kind: str, machine: Machine) -> Problem:
    plan = ideal_plan(kind, machine)
    return Problem(machine, plan, reduction(kind, NAMES[kind], machine, plan))


def test_six_differences_are_independent() -> None:
    """Eq. (28): 2 I."""
    assert problem_of("six", PROTOTYPE).covariance() == pytest.approx(2.0 * np.eye(6), abs=1e-15)


def test_twelve_differences_share_their_isotropic_reading() -> None:
    """Eq. (31) with the errata of eq. (30): 2 on the diagonal, 1 between + and − of one name."""
    covariance = problem_of("twelve", PROTOTYPE).covariance()
    for i, one in enumerate(TWELVE):
        for j, other in enumerate(TWELVE):
            expected = 2.0 if one == other else 1.0 if one[:3] == other[:3] else 0.0
            assert covariance[i, j] == pytest.approx(expected, abs=1e-15)


@both_machines
def test_covariance_of_the_six_equation_method_is_eq_29(machine: Machine) -> None:
    problem = problem_of("six", machine)
    slope = calibration_matrix(problem)
    expected = 2.0 * np.linalg.inv(slope.T @ slope)
    assert unit_covariance(problem, slope) == pytest.approx(expected, rel=1e-10)
    assert sigma_rho(expected) == pytest.approx(np.sqrt(np.mean(np.diag(expected))), rel=1e-14)


@both_machines
def test_covariance_of_the_twelve_equation_method_is_eq_32(machine: Machine) -> None:
    problem = problem_of("twelve", machine)
    slope = calibration_matrix(problem)
    inner = np.linalg.inv(slope.T @ slope)
    expected = inner @ slope.T @ problem.covariance() @ slope @ inner
    assert unit_covariance(problem, slope) == pytest.approx(expected, rel=1e-10)


def test_covariances_come_in_batches() -> None:
    problem = problem_of("six", PROTOTYPE)
    slope = problem.model_with_jacobian(np.random.default_rng(1).normal(0, 2, (4, 5, 3)))[1]
    together = unit_covariance(problem, slope)
    assert together.shape == (4, 5, 3, 3)
    assert together[3, 2] == pytest.approx(unit_covariance(problem, slope[3, 2]), rel=1e-12)


@pytest.mark.parametrize("kind", ["six", "twelve", "single"])
def test_sigma_from_the_residuals_of_differences(kind: str) -> None:
    """Unbiased within 5 standard errors over 4000 sets: chance of failure below 1e-6."""
    problem = problem_of(kind, PROTOTYPE)
    slope = calibration_matrix(problem)
    projector = np.eye(len(slope)) - slope @ np.linalg.pinv(slope)
    noise = np.random.default_rng(5).standard_normal((4000, len(problem.plan)))
    found = [
        scatter_of_residuals(problem, slope, projector @ row) for row in noise @ problem.matrix.T
    ]
    variances = np.array([s.sigma_mm**2 for s in found if s is not None])
    assert len(variances) == 4000
    assert variances.mean() == pytest.approx(1.0, abs=5.0 * variances.std() / np.sqrt(4000))
    assert found[0] is not None
    # Satterthwaite: the variance of the estimate is 2/dof.
    assert variances.var() == pytest.approx(2.0 / found[0].dof, rel=0.15)
    if kind == "six":
        assert found[0].dof == pytest.approx(3.0, abs=1e-9)


def test_no_spare_difference_means_no_sigma() -> None:
    data = differences("six", PROTOTYPE)
    three = Differences("six", SIX[:3], data.value[:3], NOWHERE)
    solution = solve(three, PROTOTYPE)
    assert solution.sigma_residuals_mm is None
    assert solution.dof == 0
    assert solution.sigma_mm == PROTOTYPE.gauge.noise_mm
    assert solution.lack_of_fit_p is None
    assert "no spare readings" in solution.judgement
    width = (solution.interval_mm[:, 1] - solution.interval_mm[:, 0]) / solution.std_mm
    assert width == pytest.approx(np.full(3, 2.0 * stats.norm.ppf(0.975)), rel=1e-6)


def test_sigma_from_repeats_is_the_pooled_scatter() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE))
    plan = session.plan
    sums, dof = 0.0, 0
    for setup in range(6):
        for displacement in (0.0, 60.0, -100.0):
            cell = session.value[(plan.setup == setup) & (plan.displacement == displacement)]
            sums += float(((cell - cell.mean()) ** 2).sum())
            dof += len(cell) - 1
    found = scatter_of_repeats(plan, session.value)
    assert found is not None
    assert found.dof == dof == 42
    assert found.sigma_mm == pytest.approx(np.sqrt(sums / dof), rel=1e-12)
    assert solve(session, PROTOTYPE).sigma_repeats_mm == pytest.approx(found.sigma_mm, rel=1e-12)


def test_without_repeats_there_is_no_sigma_of_repeats() -> None:
    plan = double_posture(PROTOTYPE, cycles=1, closing=False)
    assert scatter_of_repeats(plan, np.zeros(len(plan))) is None


def test_the_gauges_resolution_is_the_floor() -> None:
    """A gauge of 0.01 mm that always shows the same number has not measured to a nanometre."""
    session = readings(PROTOTYPE, double_posture(PROTOTYPE), np.zeros(3), seed=None)
    solution = solve(session, PROTOTYPE)
    assert solution.sigma_residuals_mm is not None
    assert solution.sigma_residuals_mm < 1e-9
    assert solution.sigma_floor_mm == pytest.approx(0.01 / np.sqrt(12.0), rel=1e-14)
    assert solution.sigma_mm == solution.sigma_floor_mm
    assert any("resolution" in warning for warning in solution.warnings)


@pytest.mark.parametrize("dof", [1, 3, 6.4, 51, 1e6])
def test_half_width_is_students_t(dof: float) -> None:
    assert half_width(dof) == pytest.approx(stats.t.ppf(0.975, dof), rel=1e-9)
    assert half_width(np.inf) == pytest.approx(stats.norm.ppf(0.975), rel=1e-6)


def test_chance_of_residual_is_chi_squared() -> None:
    assert chance_of_residual(0.0041, 51.0, 0.0067) == pytest.approx(
        stats.chi2.sf(0.0041 / 0.0067**2, 51), rel=1e-12
    )


def test_correlations_and_sigma_rho() -> None:
    solution = solve(readings(LARGE, double_posture(LARGE)), LARGE)
    matrix = solution.correlation
    assert np.diag(matrix).tolist() == [1.0, 1.0, 1.0]
    x, y = solution.std_mm[:2]
    assert matrix[0, 1] == pytest.approx(solution.covariance_mm2[0, 1] / (x * y), rel=1e-12)
    assert solution.sigma_rho_mm == pytest.approx(np.sqrt(np.mean(solution.std_mm**2)), rel=1e-12)


PLANS = [
    pytest.param(double_posture(PROTOTYPE), "readings", id="all readings"),
    pytest.param(double_posture(PROTOTYPE), "six", id="six"),
    pytest.param(double_posture(PROTOTYPE), "twelve", id="twelve"),
    pytest.param(double_posture(PROTOTYPE, cycles=1), "readings", id="one cycle"),
    pytest.param(single_posture(PROTOTYPE, 3), "readings", id="single-posture"),
]


def covered(intervals: Floats, offsets: Floats) -> Floats:
    """Share of intervals that hold the truth, per joint."""
    inside = (intervals[..., 0] <= offsets) & (offsets <= intervals[..., 1])
    return np.asarray(inside.mean(axis=0))


@pytest.mark.parametrize(("plan", "method"), PLANS)
def test_95_percent_intervals_cover_95_percent(plan: Plan, method: str) -> None:
    """10,000 healthy sessions with noise and rounding; ±1 % is 4.6 standard errors of one joint:
    chance of a false failure below 1e-4 for each of the fifteen."""
    rng = np.random.default_rng(3)
    values = written_down(simulate(PROTOTYPE, OFFSETS, plan), plan, PROTOTYPE.gauge, rng, 10_000)
    batch = solve_many(PROTOTYPE, plan, values, method)
    assert np.all(batch.converged)
    share = covered(batch.interval_mm, OFFSETS)
    assert share == pytest.approx(np.full(3, 0.95), abs=0.01)
    # The stated standard deviations are the real ones, too (standard error 0.7 %).
    real = batch.offsets_mm.std(axis=0)
    stated = np.sqrt((batch.std_mm**2).mean(axis=0))
    assert stated == pytest.approx(real, rel=0.035)


@pytest.mark.parametrize("method", ["readings", "six", "twelve"])
def test_a_batch_gives_what_single_solves_give(method: str) -> None:
    plan = double_posture(LARGE)
    rng = np.random.default_rng(6)
    values = written_down(simulate(LARGE, OFFSETS, plan), plan, LARGE.gauge, rng, 4)
    batch = solve_many(LARGE, plan, values, method)
    session = readings(LARGE, plan)
    for k in range(4):
        alone = solve(replace(session, value=values[k]), LARGE, method)
        assert batch.offsets_mm[k] == pytest.approx(alone.offsets_mm, abs=1e-9)
        assert batch.std_mm[k] == pytest.approx(alone.std_mm, rel=1e-7)
        assert batch.interval_mm[k] == pytest.approx(alone.interval_mm, abs=1e-8)
        assert batch.sigma_mm[k] == pytest.approx(alone.sigma_mm, rel=1e-9)


def test_batches_refuse_what_they_cannot_do() -> None:
    plan = double_posture(PROTOTYPE)
    with pytest.raises(UsageError, match="does not solve batches"):
        solve_many(PROTOTYPE, plan, np.zeros((2, 60)), "single")
    few = ideal_plan("six", PROTOTYPE).subset(np.arange(6))
    with pytest.raises(UsageError, match="none to spare"):
        solve_many(PROTOTYPE, few, np.zeros((2, 6)))
    flat = plan.subset(plan.displacement == 0.0)
    with pytest.raises(RankDeficientError):
        solve_many(PROTOTYPE, flat, np.zeros((2, len(flat))))
