"""Eqs. (10), (11), (16), (17): matrices, printed coefficients and solutions."""

import math

import numpy as np
import pytest

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.errors import RankDeficientError
from orthoglide_cal.estimation import Problem, solve
from orthoglide_cal.estimation.linear import calibration_matrix
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences
from orthoglide_cal.protocols import NAMES, SINGLE, SIX, TWELVE, ideal_plan, reduction
from tests.estimation.sessions import NOWHERE, differences, some
from tests.machines import PROTOTYPE, both_machines

SMALL = 1e-3 * np.array([1.0, -2.0, 3.0])


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


def matrix_of(kind: str, machine: Machine) -> Floats:
    plan = ideal_plan(kind, machine)
    return calibration_matrix(Problem(machine, plan, reduction(kind, NAMES[kind], machine, plan)))


def expected_row(kind: str, name: str, machine: Machine) -> Floats:
    """A row of eq. (10), (16) or (17) from the difference's name, direction first, leg second."""
    k = coefficients(machine)
    direction, leg = AXES.index(name[0]), AXES.index(name[2])
    row = np.zeros(3)
    if kind == "single":
        row[direction] = 1.0
        row[leg] = {"0": 0.0, "+": k["a1"], "-": k["a2"]}[name[3]]
    else:
        suffix = {"": "", "+": "1", "-": "2"}[name[3:]]
        row[direction], row[leg] = k[f"b{suffix}"], k[f"c{suffix}"]
    return row


@both_machines
@pytest.mark.parametrize("kind", ["single", "six", "twelve"])
def test_the_models_derivative_is_the_papers_matrix(machine: Machine, kind: str) -> None:
    expected = np.stack([expected_row(kind, name, machine) for name in NAMES[kind]])
    assert matrix_of(kind, machine) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "printed", "half_digit"),
    [
        ("a1", 0.20, 0.005), ("a2", -0.34, 0.005),
        ("b1", 0.19, 0.005), ("b2", -0.32, 0.005), ("c1", 0.14, 0.005),
        ("c2", -0.060, 0.001),  # errata, after eq. (16): printed as +0.06
        ("b", 0.52, 0.005), ("c", 0.197, 0.001),  # printed 0.20
    ],
)  # fmt: skip
def test_coefficients_of_the_prototype(name: str, printed: float, half_digit: float) -> None:
    assert coefficients(PROTOTYPE)[name] == pytest.approx(printed, abs=half_digit)
    assert np.abs(matrix_of("twelve", PROTOTYPE)).max() == pytest.approx(0.3223, abs=1e-4)


@pytest.mark.parametrize("name", ["x_y", "z_x"])
def test_six_is_max_minus_min_of_twelve(name: str) -> None:
    twelve = dict(zip(TWELVE, matrix_of("twelve", PROTOTYPE), strict=True))
    six = dict(zip(SIX, matrix_of("six", PROTOTYPE), strict=True))
    assert six[name] == pytest.approx(twelve[f"{name}+"] - twelve[f"{name}-"], abs=1e-13)


@both_machines
@pytest.mark.parametrize(
    ("kind", "method"),
    [("six", "six-linear"), ("twelve", "twelve-linear"), ("single", "single")],
)
def test_linear_methods_are_the_pseudoinverse(machine: Machine, kind: str, method: str) -> None:
    rng = np.random.default_rng(9)
    data = Differences(kind, NAMES[kind], rng.normal(0.0, 0.3, len(NAMES[kind])), NOWHERE)
    design = np.stack([expected_row(kind, name, machine) for name in NAMES[kind]])
    expected = np.linalg.solve(design.T @ design, design.T @ data.value)
    solution = solve(data, machine, method)
    assert solution.offsets_mm == pytest.approx(expected, abs=1e-12)
    assert solution.method == method
    assert solution.iterations == 0


@both_machines
def test_single_sequential_is_eq_11(machine: Machine) -> None:
    value = np.array([0.31, 0.27, 0.55, -0.12, 0.08, 0.49])
    data = Differences("single", SINGLE, value, NOWHERE)
    k = coefficients(machine)
    z = (0.31 + 0.27) / 2.0
    squares = k["a1"] ** 2 + k["a2"] ** 2
    x = (k["a1"] * (0.55 - z) + k["a2"] * (-0.12 - z)) / squares
    y = (k["a1"] * (0.08 - z) + k["a2"] * (0.49 - z)) / squares
    solution = solve(data, machine, "single-sequential")
    assert solution.offsets_mm == pytest.approx([x, y, z], abs=1e-12)


def test_single_sequential_residuals_are_not_smaller_than_the_pseudoinverses() -> None:
    value = np.array([0.31, 0.27, 0.55, -0.12, 0.08, 0.49])
    data = Differences("single", SINGLE, value, NOWHERE)
    rms = {m: solve(data, PROTOTYPE, m).rms_after_mm for m in ("single", "single-sequential")}
    assert rms["single-sequential"] > rms["single"]


@both_machines
@pytest.mark.parametrize(
    ("kind", "method"),
    [
        ("six", "six-linear"), ("twelve", "twelve-linear"), ("single", "single"),
        ("single", "single-sequential"),
    ],
)  # fmt: skip
def test_linear_methods_find_small_offsets(machine: Machine, kind: str, method: str) -> None:
    """The neglected terms are of the order Δρ²/L, here 3e-8 mm; divided by b some 1e-7."""
    solution = solve(differences(kind, machine, SMALL), machine, method)
    assert solution.offsets_mm == pytest.approx(SMALL, abs=5e-7)


def test_sequential_needs_all_six_differences() -> None:
    data = some(differences("single", PROTOTYPE), *SINGLE[:-1])
    with pytest.raises(RankDeficientError, match="dz_y- missing"):
        solve(data, PROTOTYPE, "single-sequential")
    assert solve(data, PROTOTYPE, "single").converged


def test_a_missing_difference_leaves_the_others_usable() -> None:
    data = some(differences("six", PROTOTYPE, SMALL), *SIX[1:])
    assert solve(data, PROTOTYPE, "six-linear").offsets_mm == pytest.approx(SMALL, abs=5e-7)
