"""Eq. (25): optimality, convergence, and agreement with another solver."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.errors import NotConvergedError
from orthoglide_cal.estimation import Problem, fit_offsets, solve
from orthoglide_cal.estimation.problem import OPTIMAL_MM, normal_step
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences
from orthoglide_cal.protocols import NAMES, SIX, double_posture, ideal_plan, reduction, zero_free
from orthoglide_cal.simulation import simulate, simulate_with_jacobian
from tests.estimation.sessions import NOWHERE
from tests.machines import PROTOTYPE, both_machines
from tests.simulation import table2


def problem_of(kind: str, machine: Machine) -> Problem:
    if kind == "readings":
        plan = double_posture(machine)
        return Problem(machine, plan, zero_free(plan))
    plan = ideal_plan(kind, machine)
    return Problem(machine, plan, reduction(kind, NAMES[kind], machine, plan))


def noisy(problem: Problem, offsets: Floats, sigma: float, seed: int) -> Floats:
    signal, _ = simulate_with_jacobian(problem.machine, offsets, problem.plan, strict=False)
    noise = sigma * np.random.default_rng(seed).standard_normal(signal.shape)
    return np.asarray((signal + noise) @ problem.matrix.T)


@both_machines
@pytest.mark.parametrize("kind", ["six", "twelve", "readings"])
def test_exact_data_give_the_true_offsets(machine: Machine, kind: str) -> None:
    problem = problem_of(kind, machine)
    offsets = np.random.default_rng(3).uniform(-8.0, 8.0, (50, 3))
    fit = fit_offsets(problem, noisy(problem, offsets, 0.0, 1))
    assert np.all(fit.converged)
    assert np.abs(fit.offsets_mm - offsets).max() < OPTIMAL_MM


@both_machines
@pytest.mark.parametrize("kind", ["six", "twelve"])
def test_all_of_100_000_random_offsets_converge_from_zero(machine: Machine, kind: str) -> None:
    problem = problem_of(kind, machine)
    offsets = np.random.default_rng(7).uniform(-20.0, 20.0, (100_000, 3))
    reachable = np.isfinite(noisy(problem, offsets, 0.0, 0)).all(axis=1)
    assert reachable.all()
    fit = fit_offsets(problem, noisy(problem, offsets, 0.0, 0))
    assert np.all(fit.converged)
    assert np.abs(fit.offsets_mm - offsets).max() < OPTIMAL_MM
    assert fit.iterations.max() < 10


@both_machines
def test_coarse_data_still_reach_an_optimum(machine: Machine) -> None:
    """Differences that no offsets explain: 5 mm of scatter, a blunder in every reading."""
    problem = problem_of("six", machine)
    fit = fit_offsets(problem, np.random.default_rng(1).normal(0.0, 5.0, (2000, 6)))
    assert np.all(fit.converged)


def by_scipy(problem: Problem, data: Floats) -> Floats:
    """The same least squares by scipy, from zero."""
    return np.asarray(
        least_squares(
            lambda x: problem.model(x) - data,
            np.zeros(3),
            jac=lambda x: problem.model_with_jacobian(x)[1],
            method="lm",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        ).x
    )


@both_machines
@pytest.mark.parametrize("kind", ["six", "twelve", "readings"])
def test_agrees_with_another_solver(machine: Machine, kind: str) -> None:
    """At 2 µm of noise; the other solver compares sums of squares, so its own error grows with
    the residuals: rounding of F hides a step of about |r|·1e-7."""
    problem = problem_of(kind, machine)
    offsets = np.random.default_rng(11).uniform(-5.0, 5.0, (12, 3))
    data = noisy(problem, offsets, 0.002, 2)
    fit = fit_offsets(problem, data)
    for row, found in zip(data, fit.offsets_mm, strict=True):
        assert np.abs(by_scipy(problem, row) - found).max() < 1e-9


@both_machines
@pytest.mark.parametrize("kind", ["six", "twelve", "readings"])
def test_agrees_with_another_solver_on_large_residuals(machine: Machine, kind: str) -> None:
    """At 0.3 mm of noise, with the other solver's answer refined as a root of ∂F/∂Δρ."""
    problem = problem_of(kind, machine)
    offsets = np.random.default_rng(12).uniform(-5.0, 5.0, (6, 3))
    data = noisy(problem, offsets, 0.3, 3)

    def gradient(x: Floats, row: Floats) -> Floats:
        model, slope = problem.model_with_jacobian(x)
        return np.asarray(slope.T @ (model - row))

    for row, found in zip(data, fit_offsets(problem, data).offsets_mm, strict=True):
        near = by_scipy(problem, row)
        other = least_squares(gradient, near, args=(row,), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.abs(near - found).max() < 1e-5
        assert np.abs(other.x - found).max() < 1e-9


def six_by_table_2(machine: Machine, offsets: Floats) -> Floats:
    low, high = machine.joint_limits_mm
    pairs = [(AXES.index(name[2]), AXES.index(name[0])) for name in SIX]
    return np.array(
        [
            table2.gauge_reading(machine, offsets, leg, direction, high)
            - table2.gauge_reading(machine, offsets, leg, direction, low)
            for leg, direction in pairs
        ]
    )


@both_machines
def test_the_optimum_is_one_by_an_independent_derivative(machine: Machine) -> None:
    """∂F/∂Δρ = 0 with F of eq. (25) from Table 2 written anew, by central differences."""
    data = np.array([0.52, 1.48, 2.37, -0.25, -0.57, -0.04])
    found = solve(Differences("six", SIX, data, NOWHERE), machine).offsets_mm

    def half_sum_of_squares(offsets: Floats) -> float:
        return 0.5 * float(((six_by_table_2(machine, offsets) - data) ** 2).sum())

    step = 1e-3
    gradient = [
        (half_sum_of_squares(found + move) - half_sum_of_squares(found - move)) / (2.0 * step)
        for move in step * np.eye(3)
    ]
    # F curves by about 0.5 per mm²: a gradient of 1e-8 is an offset of 2e-8 mm.
    assert np.abs(gradient).max() < 1e-8
    for move in 0.01 * np.random.default_rng(2).normal(size=(20, 3)):
        assert half_sum_of_squares(found + move) > half_sum_of_squares(found)


def test_a_solution_rechecks_its_optimality_from_the_data() -> None:
    problem = problem_of("six", PROTOTYPE)
    data = np.array([0.52, 1.48, 2.37, -0.25, -0.57, -0.04])
    fit = fit_offsets(problem, data)
    assert problem.remaining_step(data, fit.offsets_mm) < OPTIMAL_MM
    wrong = fit.offsets_mm + np.array([0.0, 1e-6, 0.0])
    assert problem.remaining_step(data, wrong) == pytest.approx(1e-6, rel=0.01)


def test_a_batch_may_have_any_shape() -> None:
    problem = problem_of("six", PROTOTYPE)
    offsets = np.random.default_rng(5).uniform(-2.0, 2.0, (2, 3, 3))
    fit = fit_offsets(problem, noisy(problem, offsets, 0.01, 4))
    assert fit.offsets_mm.shape == (2, 3, 3)
    assert fit.residuals_mm.shape == (2, 3, 6)
    assert fit.converged.shape == fit.iterations.shape == (2, 3)
    alone = fit_offsets(problem, noisy(problem, offsets, 0.01, 4)[1, 2])
    assert fit.offsets_mm[1, 2] == pytest.approx(alone.offsets_mm, abs=1e-10)
    assert fit_offsets(problem, np.zeros((0, 6))).offsets_mm.shape == (0, 3)


def test_blocks_in_parallel_give_the_same_answers() -> None:
    problem = problem_of("six", PROTOTYPE)
    data = np.random.default_rng(8).normal(0.0, 0.5, (9000, 6))
    together = fit_offsets(problem, data).offsets_mm
    apart = np.concatenate([fit_offsets(problem, part).offsets_mm for part in np.split(data, 9)])
    assert np.abs(together - apart).max() < 1e-9


def test_a_start_elsewhere_leads_to_the_same_optimum() -> None:
    problem = problem_of("readings", PROTOTYPE)
    data = noisy(problem, np.array([1.0, -2.0, 0.5]), 0.01, 6)
    here = fit_offsets(problem, data).offsets_mm
    there = fit_offsets(problem, data, np.array([15.0, -18.0, 12.0])).offsets_mm
    assert np.abs(here - there).max() < 1e-9


def test_data_out_of_all_reach_never_look_converged() -> None:
    """What converges is an optimum by its own recomputed check; the rest says that it is not."""
    problem = problem_of("six", PROTOTYPE)
    data = np.random.default_rng(2).normal(0.0, 100.0, (500, 6))
    fit = fit_offsets(problem, data)
    assert not np.all(fit.converged)
    again = problem.remaining_step(data, fit.offsets_mm)
    assert np.array_equal(again <= OPTIMAL_MM, fit.converged)


def test_not_converged_is_an_error_not_a_number() -> None:
    problem = problem_of("six", PROTOTYPE)
    data = np.random.default_rng(2).normal(0.0, 100.0, (500, 6))
    row = data[np.flatnonzero(~fit_offsets(problem, data).converged)[0]]
    with pytest.raises(NotConvergedError, match="No offsets fit these data") as caught:
        solve(Differences("six", SIX, row, NOWHERE), PROTOTYPE)
    assert caught.value.exit_code == 4


def test_step_by_cofactors_solves_the_damped_normal_equations() -> None:
    rng = np.random.default_rng(3)
    slope, residual = rng.normal(size=(4, 7, 3)), rng.normal(size=(4, 7))
    damping = np.array([0.0, 0.1, 2.0, 30.0])
    step = normal_step(slope, residual, damping)
    for j, r, d, s in zip(slope, residual, damping, step, strict=True):
        normal = j.T @ j
        expected = np.linalg.solve(normal + d * np.diag(np.diag(normal)), j.T @ r)
        assert s == pytest.approx(expected, rel=1e-11)


def test_repeated_readings_are_predicted_once_and_counted_each() -> None:
    problem = problem_of("readings", PROTOTYPE)
    offsets = np.array([0.7, -0.2, 1.9])
    full = problem.matrix @ simulate(PROTOTYPE, offsets, problem.plan)
    slope = problem.matrix @ simulate_with_jacobian(PROTOTYPE, offsets, problem.plan)[1]
    model, folded_slope = problem.model_with_jacobian(offsets)
    assert model == pytest.approx(full, abs=1e-12)
    assert folded_slope == pytest.approx(slope, abs=1e-12)
    assert math.isclose(np.linalg.norm(problem.model(offsets)), np.linalg.norm(full))
