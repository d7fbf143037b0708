"""A solution is the optimum (eq. 25), or says how far it is from it; and whether the model fits."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.special import chdtri

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import fit_offsets, fit_parameters, solve
from orthoglide_cal.estimation.accuracy import Scatter, unit_covariance
from orthoglide_cal.estimation.least_squares import OPTIMAL
from orthoglide_cal.model.measured import DataKind, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.paper.tables import experiment
from tests import truth
from tests.estimation.sessions import (
    BENT,
    SINGLE,
    SIX,
    TWELVE,
    differences,
    of_values,
    problem_of,
    readings,
)
from tests.inference.sessions import known
from tests.machines import NOMINAL, NOMINAL_LARGE, PROTOTYPE
from tests.sentences import sentences

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
    assert solution.converged
    assert 0.0 <= solution.remaining <= OPTIMAL
    assert solution.model is NOMINAL
    # From moved offsets the step that is left leads back to it, by as much as they were moved.
    for size, axis in product((2.0 * OPTIMAL, -0.1), np.eye(3)):
        moved = replace(solution, offsets_mm=solution.offsets_mm + size * solution.std_mm * axis)
        assert not moved.converged
        # By the stated noise: experiment 1 scatters by a hundred times as much.
        assert 0.5 * abs(size) <= moved.remaining


def test_other_data_or_another_machine_are_noticed() -> None:
    for method in ("readings", "six-linear"):
        solution = solve(DOUBLE_SESSION, NOMINAL, method)
        posed = solution.posed
        shifted = replace(posed, data=posed.data + 0.001 * np.arange(len(posed.data)))
        assert not replace(solution, posed=shifted).converged
        bent = replace(posed.problem, model=BENT)
        assert not replace(solution, posed=replace(posed, problem=bent)).converged
    # Offsets that no machine can have are no optimum.
    impossible = replace(solve(DOUBLE_SESSION, NOMINAL), offsets_mm=np.array([1e4, 0.0, 0.0]))
    assert np.isnan(impossible.remaining)
    assert not impossible.converged


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
    solution = solve(DOUBLE_SESSION, NOMINAL)
    sigma = NOMINAL.machine.instrument.noise_mm * np.sqrt(
        chdtri(solution.dof, chance) / solution.dof
    )
    solution = replace(solution, scatter=Scatter(float(sigma), solution.dof))
    assert (solution.judgement.code == "residuals_too_large") is suspicious
    assert words in sentences([solution.judgement])[0]


def test_a_slow_search_ends_where_it_makes_no_difference() -> None:
    """A misread reading of 220 mm and an encoder scale: a step of 7 nm is left after 100 others."""
    session = truth.make_session(31, truth.PROTOTYPE, truth.DIAL, ("encoder_scale",))
    measured, model = known(session)
    value = measured.value.copy()
    value[31] += 220.0
    solution = fit_parameters(replace(measured, value=value), model)
    assert fit_offsets(solution.posed.problem, solution.posed.data).iterations > 50
    assert solution.converged
    assert solution.remaining <= OPTIMAL


EXPERIMENT_1 = experiment(1).value


@pytest.mark.parametrize(("model", "kind"), [(NOMINAL, TWELVE), (NOMINAL_LARGE, SIX)])
def test_all_of_10_000_random_offsets_converge_from_zero(model: Model, kind: DataKind) -> None:
    """In all; also of those near ±20 mm; all of them can be reached, or `predict` would raise."""
    problem = problem_of(kind, model)
    offsets = np.random.default_rng(7).uniform(-20.0, 20.0, (5_000, 3))
    fit = fit_offsets(problem, problem.predict(offsets))
    assert np.all(fit.converged)
    assert np.abs(fit.offsets_mm - offsets).max() < 1e-9
    assert fit.iterations.max() < 10


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
    unit = unit_covariance(problem, problem.at_zero[1])
    assert remaining >= 1e-6 / (NOMINAL.machine.gauge.noise_mm * np.sqrt(unit[1, 1]))


def test_each_set_begins_at_its_own_start() -> None:
    problem, rng = problem_of(SIX, NOMINAL), np.random.default_rng(8)
    data = rng.normal(0.0, 0.5, (2000, 6))
    found = fit_offsets(problem, data).offsets_mm
    other = fit_offsets(problem, data, rng.uniform(-3.0, 3.0, (2000, 3)))
    assert np.abs(other.offsets_mm - found).max() < 1e-9
    # At the optimum there is nothing left to do.
    assert fit_offsets(problem, data, found).iterations.max() == 0


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
