"""Data in each of their forms, solved by each method.

All raw readings at once, also of several sittings: least squares with a zero per set-up. The
paper's differences: six of twelve, any order, some missing; and its linear methods, eqs. (10),
(11), (16), (17): matrices, printed coefficients and solutions.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation.solution import Method, PromisedDifference, pose, promise
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference, Measured, Readings
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import GaugePlan, Posture
from tests import truth
from tests.estimation.sessions import (
    BENT,
    NAMED,
    OFFSETS,
    SINGLE,
    SIX,
    SMALL,
    TWELVE,
    differences,
    merged,
    of_values,
    only,
    problem_of,
    readings,
)
from tests.inference.sessions import known
from tests.machines import NOMINAL, NOMINAL_LARGE, PROTOTYPE, both_models, extended, sure
from tests.readings import some


def explicit(session: Readings, model: Model) -> tuple[Floats, Floats]:
    """Offsets and covariance/σ² by Gauss–Newton on offsets and zeros together, the long way."""
    many = len(model.machine.parameter_names)
    offsets = np.zeros(many)
    weight = session.plan.precision[:, None]
    for _ in range(20):
        h, jacobian = differentiate(model, offsets, session.plan)
        design = weight * np.hstack((jacobian, session.plan.zeros))
        step = np.linalg.lstsq(design, weight[:, 0] * (session.value - h), rcond=None)[0]
        offsets = offsets + step[:many]
    return offsets, np.asarray(np.linalg.inv(design.T @ design)[:many, :many], dtype=np.float64)


@both_models
@pytest.mark.parametrize("protocol", ["double", "part", "single"])
def test_the_default_for_raw_readings_is_least_squares_with_zeros(
    model: Model, protocol: str
) -> None:
    """Joining the repeats of a cell gives what all of them give, of whatever number they are."""
    machine = model.machine
    plan = single_posture(machine, 3) if protocol == "single" else double_posture(machine)
    session = readings(model, plan)
    if protocol == "part":
        session = some(session, np.random.default_rng(5).choice(60, 35, replace=False))
    solution = solve(session, sure(model))
    offsets, covariance = explicit(session, model)
    assert solution.method is Method.READINGS
    assert solution.offsets_mm == pytest.approx(offsets, abs=1e-9)
    assert solution.budget.covariance_mm2 == pytest.approx(
        solution.noise.sigma_mm**2 * covariance, rel=1e-7
    )
    assert solution.dof == len(session) - session.plan.setups - 3


# Unequal repeats, some missing.
SOME = np.random.default_rng(4).choice(60, 35, replace=False)


def other_postures(plan: GaugePlan) -> GaugePlan:
    """The same readings where nobody else takes them."""
    return replace(plan, displacement=0.6 * plan.displacement + 3.0)


PLANS: dict[str, Callable[[Machine], GaugePlan]] = {
    "whole": double_posture,
    "gauges near a carriage": lambda machine: double_posture(machine, gauge_at=0.2),
    "gauges near the tool": lambda machine: double_posture(machine, gauge_at=0.9),
    "gauges at two places": lambda machine: merged(
        *(double_posture(machine, 1, gauge_at=f) for f in (0.3, 0.6))
    ),
    "more postures": lambda machine: merged(
        double_posture(machine), other_postures(double_posture(machine))
    ),
    "other postures": lambda machine: other_postures(double_posture(machine)),
    "any part": lambda machine: double_posture(machine).subset(SOME),
}


def promised(measured: Measured, model: Model) -> tuple[PromisedDifference, ...]:
    """Differences to expect once the offsets that were found are entered."""
    solution = solve(measured, model)
    return promise(measured, solution, solution.offsets_mm)


@pytest.mark.parametrize("model", [NOMINAL, NOMINAL_LARGE, BENT], ids=["nominal", "large", "bent"])
@pytest.mark.parametrize("name", PLANS)
def test_exact_readings_give_the_true_offsets(model: Model, name: str) -> None:
    """By all readings, and by the paper's differences of those at its postures."""
    session = readings(model, PLANS[name](model.machine), seed=None)
    if name == "other postures":
        assert promised(session, model) == ()
    papers = ["six", "twelve"] if name.startswith(("whole", "gauges near")) else []
    for method in ["readings", *papers]:
        solution = solve(session, model, method)
        assert solution.offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
        assert solution.rms_after_mm < 1e-9
        assert solution.predicted_mm == pytest.approx(session.value, abs=1e-9)
        assert solution.method == method
        if model is BENT and name == "whole":
            assert np.abs(solve(session, NOMINAL, method).offsets_mm - OFFSETS).max() > 0.05


DOUBLE, SINGLE_POSTURE = (
    readings(NOMINAL, protocol(PROTOTYPE)) for protocol in (double_posture, single_posture)
)


@pytest.mark.parametrize(
    ("data", "usable"),
    [
        (differences(SIX, NOMINAL), ("six-linear", "six")),
        (differences(TWELVE, NOMINAL), ("six-linear", "twelve-linear", "six", "twelve")),
        (differences(SINGLE, NOMINAL), ("single", "single-sequential")),
        (DOUBLE, ("six-linear", "twelve-linear", "six", "twelve", "readings")),
        (SINGLE_POSTURE, ("single", "single-sequential", "readings")),
    ],
    ids=["six", "twelve", "single", "readings", "single-posture readings"],
)
def test_which_methods_data_can_feed(data: Measured, usable: tuple[str, ...]) -> None:
    assert solve(data, NOMINAL).method is Method(data.kind)
    for name in usable:
        assert solve(data, NOMINAL, name).method == name
    for name in set(Method) - set(usable):
        with pytest.raises(UsageError, match=f"Method {name} cannot use") as caught:
            solve(data, NOMINAL, name)
        assert f"one of {', '.join(usable)}." in caught.value.remedy
    with pytest.raises(UsageError, match="no method 'best'"):
        solve(data, NOMINAL, "best")


def test_what_depends_on_time_and_motion_runs_on_through_the_parts() -> None:
    """Drift by the clock, lost motion by where each carriage came from, a step's way included."""
    hidden = ("thermal_drift", "backlash")
    first = truth.make_session(7, truth.PROTOTYPE, truth.MICRON, hidden, exact=True, pace=2.0)
    # Each leg in the order iso, min, max, and a step entered for the last leg.
    new = np.concatenate([20 * leg + np.array([0, 4, 2, 6, 10, 8, 18]) for leg in range(3)])
    plan = first.plan
    names = ("leg", "direction", "displacement", "gauge_at", "turned")
    both = truth.continue_session(
        first, 1, **{name: getattr(plan, name)[new] for name in names},
        order=np.arange(21), hours=plan.hours[-1] + 1.0 + np.arange(21) / 30.0,
        part=np.ones(21, dtype=int), entered=np.outer(np.arange(21) > 13, [0.0, 0.4, -0.6]),
    )  # fmt: skip
    measured, model = known(both)
    command = model.machine.command(measured.plan)
    assert command.approach.tolist() == both.plan.approach.tolist()
    drift, lost = (np.array(effect.parameters) for effect in both.effects)
    causes = (
        CAUSES["thermal_drift"].at(drift),
        CAUSES["backlash"].at(np.concatenate((lost[:3], -lost[3:]))),
    )
    solution = solve(measured, model.extended(causes))
    assert solution.lack_of_fit_p > 1e-3
    assert np.all(np.abs(solution.offsets_mm - first.offsets) < 4.0 * solution.budget.std_mm)
    assert solve(measured, model).lack_of_fit_p < 1e-12


@both_models
def test_six_differences_of_twelve_are_max_minus_min(model: Model) -> None:
    twelve = differences(TWELVE, model)
    value = dict(zip(twelve.which, twelve.value.tolist(), strict=True))
    problem, values = pose(twelve, model, SIX)
    assert problem.which == DIFFERENCES[SIX]
    assert values == pytest.approx(
        [value[NAMED[f"{each.name}+"]] - value[NAMED[f"{each.name}-"]] for each in problem.which],
        abs=1e-15,
    )
    assert values == pytest.approx(differences(SIX, model).value, abs=1e-12)
    # Their isotropic readings cancel: six independent differences (eq. 28).
    assert problem.covariance() == pytest.approx(2.0 * np.eye(6), abs=1e-15)
    assert solve(twelve, model, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_six_of_twelve_are_predicted_at_the_times_of_the_twelve() -> None:
    """A machine that drifts reads another max − min after three postures than after two."""
    drifting = extended(thermal_drift=(0.4, -0.7, 0.5))
    twelve = differences(TWELVE, drifting)
    assert solve(twelve, drifting, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_six_of_twelve_need_both_ends() -> None:
    names = [each.name for each in DIFFERENCES[TWELVE]]
    twelve = only(differences(TWELVE, NOMINAL), *(n for n in names if n not in ("dx_z-", "dy_x+")))
    problem, _ = pose(twelve, NOMINAL, SIX)
    assert [each.name for each in problem.which] == ["dx_y", "dy_z", "dz_x", "dz_y"]
    assert solve(twelve, NOMINAL, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    assert len(promised(twelve, NOMINAL)) == 4


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
    assert promised(shuffled, BENT) == promised(straight, BENT)
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
    problem, values = pose(data, NOMINAL, Method(method).uses)
    assert len(values) == (6 if "six" in method else 12)
    assert solution.rms_before_mm == pytest.approx(np.sqrt(np.mean(values**2)), rel=1e-12)
    offsets, slope = solution.offsets_mm, problem.at_zero[1]
    linear = "linear" in method
    left = values - (slope @ offsets if linear else problem.predict(offsets))
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


def test_sequential_needs_all_six_differences() -> None:
    data = only(differences(SINGLE, NOMINAL), *[each.name for each in DIFFERENCES[SINGLE][:-1]])
    with pytest.raises(UnusableResultError, match="dz_y- missing"):
        solve(data, NOMINAL, "single-sequential")
    # The linear method neglects terms of the order Δρ²/L.
    assert solve(data, NOMINAL, "single").offsets_mm == pytest.approx(OFFSETS, abs=0.05)
