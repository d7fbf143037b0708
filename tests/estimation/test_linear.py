"""Eqs. (10), (11), (16), (17): matrices, printed coefficients and solutions."""

import math

import numpy as np
import pytest

from orthoglide_cal.errors import RankDeficientError
from orthoglide_cal.estimation import solve
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Posture
from tests.estimation.sessions import (
    BENT,
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

UNEQUAL = [0.31, 0.27, 0.55, -0.12, 0.08, 0.49]


def coefficients(machine: Machine) -> dict[str, float]:
    """b_i = sin α_i, c_i = (0.5 + sin α_i) tan α_i, a_i = tan α_i, with their own signs."""
    found = {}
    for index, displacement in ((1, machine.joint_limits_mm[1]), (2, machine.joint_limits_mm[0])):
        alpha = math.asin(displacement / machine.leg_length_mm)
        found[f"a{index}"] = math.tan(alpha)
        found[f"b{index}"] = math.sin(alpha)
        found[f"c{index}"] = (0.5 + math.sin(alpha)) * math.tan(alpha)
    found["b"] = found["b1"] - found["b2"]
    found["c"] = found["c1"] - found["c2"]
    return found


def expected_row(kind: DataKind, difference: Difference, machine: Machine) -> Floats:
    """A row of eq. (10), (16) or (17)."""
    k = coefficients(machine)
    (leg, direction), posture = difference
    row = np.zeros(3)
    if kind is SINGLE:
        row[direction] = 1.0
        tangents = {Posture.ISO: 0.0, Posture.MAX: k["a1"], Posture.MIN: k["a2"]}
        row[leg] = tangents[posture or Posture.ISO]
    else:
        suffix = {None: "", Posture.MAX: "1", Posture.MIN: "2"}[posture]
        row[direction], row[leg] = k[f"b{suffix}"], k[f"c{suffix}"]
    return row


@both_models
@pytest.mark.parametrize("kind", [SINGLE, SIX, TWELVE])
def test_the_models_derivative_is_the_papers_matrix(model: Model, kind: DataKind) -> None:
    expected = [expected_row(kind, each, model.machine) for each in DIFFERENCES[kind]]
    assert problem_of(kind, model).at_zero[1] == pytest.approx(np.array(expected), abs=1e-12)


@both_models
def test_single_sequential_is_eq_11(model: Model) -> None:
    k = coefficients(model.machine)
    z = (0.31 + 0.27) / 2.0
    squares = k["a1"] ** 2 + k["a2"] ** 2
    x = (k["a1"] * (0.55 - z) + k["a2"] * (-0.12 - z)) / squares
    y = (k["a1"] * (0.08 - z) + k["a2"] * (0.49 - z)) / squares
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
    with pytest.raises(RankDeficientError, match="dz_y- missing"):
        solve(data, NOMINAL, "single-sequential")
    # The linear method neglects terms of the order Δρ²/L.
    assert solve(data, NOMINAL, "single").offsets_mm == pytest.approx(OFFSETS, abs=0.05)
