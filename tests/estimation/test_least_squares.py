"""Eq. (25): convergence, and how far what was found is from the optimum."""

import numpy as np
import pytest

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import fit_offsets, solve
from orthoglide_cal.estimation.accuracy import unit_covariance
from orthoglide_cal.estimation.least_squares import OPTIMAL
from orthoglide_cal.model.measured import DataKind
from orthoglide_cal.model.model import Model
from orthoglide_cal.paper.tables import experiment
from tests.estimation.sessions import SIX, TWELVE, of_values, problem_of
from tests.machines import NOMINAL, NOMINAL_LARGE

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
