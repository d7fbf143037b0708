"""What a solution says of itself: that it is the optimum, and whether the model fits."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.special import chdtri

from orthoglide_cal.estimation import fit_offsets, fit_parameters, solve
from orthoglide_cal.estimation.accuracy import Scatter
from orthoglide_cal.estimation.least_squares import OPTIMAL
from orthoglide_cal.model.measured import Measured
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.paper.tables import experiment
from tests import truth
from tests.estimation.sessions import BENT, SINGLE, TWELVE, differences, readings
from tests.inference.sessions import known
from tests.machines import NOMINAL, PROTOTYPE
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
