"""Eqs. (10), (11), (16), (17): matrices, printed coefficients and solutions."""

import math

import numpy as np
import pytest

from orthoglide_cal.errors import UnusableResultError
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
