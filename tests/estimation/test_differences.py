"""The paper's differences as data: six of twelve, any order, some missing; its linear methods.

Eqs. (10), (11), (16), (17): matrices, printed coefficients and solutions.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import Method, pose, solve
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Posture
from tests.estimation.sessions import (
    BENT,
    NAMED,
    OFFSETS,
    SINGLE,
    SIX,
    SMALL,
    TWELVE,
    differences,
    of_values,
    only,
    problem_of,
    readings,
)
from tests.machines import NOMINAL, NOMINAL_LARGE, both_models, extended


@both_models
def test_six_differences_of_twelve_are_max_minus_min(model: Model) -> None:
    twelve = differences(TWELVE, model)
    value = dict(zip(twelve.which, twelve.value.tolist(), strict=True))
    posed = pose(twelve, model, SIX)
    assert posed.which == DIFFERENCES[SIX]
    assert posed.data == pytest.approx(
        [value[NAMED[f"{each.name}+"]] - value[NAMED[f"{each.name}-"]] for each in posed.which],
        abs=1e-15,
    )
    assert posed.data == pytest.approx(differences(SIX, model).value, abs=1e-12)
    # Their isotropic readings cancel: six independent differences (eq. 28).
    assert posed.problem.covariance() == pytest.approx(2.0 * np.eye(6), abs=1e-15)
    assert solve(twelve, model, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_six_of_twelve_are_predicted_at_the_times_of_the_twelve() -> None:
    """A machine that drifts reads another max − min after three postures than after two."""
    drifting = extended(thermal_drift=(0.4, -0.7, 0.5))
    twelve = differences(TWELVE, drifting)
    assert solve(twelve, drifting, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_six_of_twelve_need_both_ends() -> None:
    names = [each.name for each in DIFFERENCES[TWELVE]]
    twelve = only(differences(TWELVE, NOMINAL), *(n for n in names if n not in ("dx_z-", "dy_x+")))
    posed = pose(twelve, NOMINAL, SIX)
    assert [each.name for each in posed.which] == ["dx_y", "dy_z", "dz_x", "dz_y"]
    assert solve(twelve, NOMINAL, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    assert len(solve(twelve, NOMINAL).promised()) == 4


@pytest.mark.parametrize("kind", [SIX, TWELVE, SINGLE])
def test_the_order_in_the_file_does_not_matter(kind: DataKind) -> None:
    straight = differences(kind, BENT)
    noise = np.random.default_rng(4).normal(0.0, 0.05, len(straight))
    straight = replace(straight, value=straight.value + noise)
    names = [each.name for each in straight.which]
    np.random.default_rng(6).shuffle(names)
    shuffled = only(straight, *names)
    one, two = solve(straight, BENT), solve(shuffled, BENT)
    assert two.offsets_mm == pytest.approx(one.offsets_mm, abs=1e-12)
    assert two.promised() == one.promised()
    # What is predicted for the file stands in the order of the file.
    expected = dict(zip(straight.which, one.predicted_mm, strict=True))
    assert two.predicted_mm == pytest.approx([expected[e] for e in shuffled.which], abs=1e-12)


@pytest.mark.parametrize("method", ["six-linear", "six", "twelve-linear", "twelve"])
def test_rms_are_of_what_the_method_uses_and_predicted_what_the_file_holds(method: str) -> None:
    data = differences(TWELVE, NOMINAL)
    data = replace(data, value=data.value + np.random.default_rng(3).normal(0.0, 0.05, 12))
    solution = solve(data, NOMINAL, method)
    predicted = problem_of(TWELVE, NOMINAL).predict(solution.offsets_mm)
    assert solution.predicted_mm == pytest.approx(predicted, abs=1e-12)
    posed = pose(data, NOMINAL, Method(method).uses)
    assert len(posed.data) == (6 if "six" in method else 12)
    assert solution.rms_before_mm == pytest.approx(np.sqrt(np.mean(posed.data**2)), rel=1e-12)
    offsets, slope = solution.offsets_mm, posed.problem.at_zero[1]
    linear = "linear" in method
    left = posed.data - (slope @ offsets if linear else posed.problem.predict(offsets))
    assert solution.rms_after_mm == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)


UNEQUAL = [0.31, 0.27, 0.55, -0.12, 0.08, 0.49]


def coefficients(machine: Machine) -> dict[Posture | None, Floats]:
    """a = tan α, b = sin α, c = (0.5 + sin α) tan α of each posture; None is max less min."""
    found: dict[Posture | None, Floats] = {}
    for posture in Posture:
        alpha = math.asin(machine.displacement_mm(posture) / machine.leg_length_mm)
        b, a = math.sin(alpha), math.tan(alpha)
        found[posture] = np.array([a, b, (0.5 + b) * a])
    found[None] = found[Posture.MAX] - found[Posture.MIN]
    return found


def expected_row(kind: DataKind, difference: Difference, machine: Machine) -> Floats:
    """A row of eq. (10), (16) or (17)."""
    (leg, direction), posture = difference
    a, b, c = coefficients(machine)[posture]
    row = np.zeros(3)
    row[direction], row[leg] = (1.0, a) if kind is SINGLE else (b, c)
    return row


@both_models
@pytest.mark.parametrize("kind", [SINGLE, SIX, TWELVE])
def test_the_models_derivative_is_the_papers_matrix(model: Model, kind: DataKind) -> None:
    expected = [expected_row(kind, each, model.machine) for each in DIFFERENCES[kind]]
    assert problem_of(kind, model).at_zero[1] == pytest.approx(np.array(expected), abs=1e-12)


@both_models
def test_single_sequential_is_eq_11(model: Model) -> None:
    (a1, *_), (a2, *_) = (coefficients(model.machine)[end] for end in (Posture.MAX, Posture.MIN))
    z = (0.31 + 0.27) / 2.0
    squares = a1**2 + a2**2
    x = (a1 * (0.55 - z) + a2 * (-0.12 - z)) / squares
    y = (a1 * (0.08 - z) + a2 * (0.49 - z)) / squares
    solution = solve(of_values(SINGLE, UNEQUAL), model, "single-sequential")
    assert solution.offsets_mm == pytest.approx([x, y, z], abs=1e-12)


@pytest.mark.parametrize("method", ["six-linear", "twelve-linear", "single", "single-sequential"])
@pytest.mark.parametrize(
    "model",
    [NOMINAL, NOMINAL_LARGE, BENT, extended(axis_squareness=(2.0, -1.0, 3.0))],
    ids=["nominal", "large", "gap", "squareness"],
)
def test_linear_methods_find_small_offsets_beside_known_causes(method: str, model: Model) -> None:
    """Also eq. (11), where the causes couple the isotropic differences with the other offsets.

    The neglected terms are of the order Δρ²/L, here 3e-8 mm; divided by b some 1e-7.
    """
    protocol = single_posture if method.startswith("single") else double_posture
    plan = protocol(model.machine)
    solution = solve(readings(model, plan, SMALL, seed=None), model, method)
    assert solution.offsets_mm == pytest.approx(SMALL, abs=5e-7)
    assert solution.converged


def test_sequential_needs_all_six_differences() -> None:
    data = only(differences(SINGLE, NOMINAL), *[each.name for each in DIFFERENCES[SINGLE][:-1]])
    with pytest.raises(UnusableResultError, match="dz_y- missing"):
        solve(data, NOMINAL, "single-sequential")
    # The linear method neglects terms of the order Δρ²/L.
    assert solve(data, NOMINAL, "single").offsets_mm == pytest.approx(OFFSETS, abs=0.05)
