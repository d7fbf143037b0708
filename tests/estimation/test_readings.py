"""All raw readings at once: generalised least squares with one unknown zero per set-up."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, Cause, machine_effects
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import RankDeficientError, UsageError
from orthoglide_cal.estimation import METHODS, solve, solve_many, usable_methods
from orthoglide_cal.machine import Estimate, IdentifiedCause, Machine
from orthoglide_cal.measured import Readings
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import double_posture, ideal_plan, single_posture
from orthoglide_cal.simulation import simulate, simulate_with_jacobian
from tests.estimation.sessions import OFFSETS, differences, readings
from tests.machines import LARGE, PROTOTYPE, both_machines


def merged(*plans: Plan) -> Plan:
    """Plans one after the other, each with set-ups of its own."""
    parts = {
        item.name: np.concatenate([getattr(plan, item.name) for plan in plans])
        for item in fields(Plan)
    }
    counts = np.cumsum([0, *(plan.setups for plan in plans)])
    parts["setup"] = np.concatenate([p.setup + n for p, n in zip(plans, counts, strict=False)])
    parts["order"] = np.arange(len(parts["leg"]))
    return Plan(**parts)


def moved(plan: Plan, displacements: Floats) -> Plan:
    """The plan with other postures."""
    parts = {item.name: getattr(plan, item.name) for item in fields(Plan)}
    return Plan(**{**parts, "displacement": displacements})


def explicit(
    session: Readings, machine: Machine, effects: Sequence[Effect] = ()
) -> tuple[Floats, Floats]:
    """Offsets and covariance/σ² by Gauss–Newton on offsets and zeros together, the long way."""
    offsets = np.zeros(3)
    for _ in range(20):
        h, slope = simulate_with_jacobian(machine, offsets, session.plan, effects)
        design = np.hstack((slope, session.plan.zeros))
        step = np.linalg.lstsq(design, session.value - h, rcond=None)[0]
        offsets = offsets + step[:3]
    return offsets, np.linalg.inv(design.T @ design)[:3, :3]


@both_machines
@pytest.mark.parametrize("protocol", ["double", "single"])
def test_the_default_for_raw_readings_is_least_squares_with_zeros(
    machine: Machine, protocol: str
) -> None:
    plan = double_posture(machine) if protocol == "double" else single_posture(machine, 3)
    session = readings(machine, plan)
    solution = solve(session, machine)
    offsets, covariance = explicit(session, machine)
    assert solution.method == "readings"
    assert solution.offsets_mm == pytest.approx(offsets, abs=1e-9)
    assert solution.covariance_mm2 == pytest.approx(solution.sigma_mm**2 * covariance, rel=1e-7)
    assert solution.dof == len(plan) - plan.setups - 3


@both_machines
@pytest.mark.parametrize("method", ["readings", "six", "twelve"])
def test_exact_readings_give_the_true_offsets(machine: Machine, method: str) -> None:
    session = readings(machine, double_posture(machine), seed=None)
    assert solve(session, machine, method).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


@pytest.mark.parametrize("method", ["six-linear", "twelve-linear"])
def test_linear_methods_take_raw_readings_too(method: str) -> None:
    small = 1e-3 * OFFSETS
    session = readings(PROTOTYPE, double_posture(PROTOTYPE), small, seed=None)
    assert solve(session, PROTOTYPE, method).offsets_mm == pytest.approx(small, abs=5e-7)


def test_all_readings_are_surer_than_the_papers_methods() -> None:
    """1.942 < 1.984 < 2.066, seen in the scatter of 20,000 sessions (standard error 0.4 %: the
    pairs differ by 5 and 10 of the standard errors of their correlated difference)."""
    plan = ideal_plan("twelve", PROTOTYPE)
    rng = np.random.default_rng(8)
    signal = simulate(PROTOTYPE, OFFSETS, plan)
    values = signal + 0.01 * rng.standard_normal((20_000, len(plan)))
    spread = {
        method: solve_many(PROTOTYPE, plan, values, method).offsets_mm.std(axis=0).mean() / 0.01
        for method in ("readings", "six", "twelve")
    }
    assert spread["readings"] == pytest.approx(1.942, rel=0.02)
    assert spread["six"] == pytest.approx(1.984, rel=0.02)
    assert spread["twelve"] == pytest.approx(2.066, rel=0.02)
    assert spread["readings"] < spread["six"] < spread["twelve"]


@both_machines
def test_extra_postures_are_just_more_readings(machine: Machine) -> None:
    low, high = machine.joint_limits_mm
    plan = double_posture(machine, cycles=2)
    swap = {0.0: 0.1 * high, high: 0.6 * high, low: 0.35 * low}
    other = moved(plan, np.array([swap[float(d)] for d in plan.displacement]))
    both = merged(plan, other)
    more = solve(readings(machine, both, seed=None), machine)
    assert more.offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    only = solve(readings(machine, other, seed=None), machine)
    assert only.offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    assert only.table == ()


@pytest.mark.parametrize("gauge_at", [0.2, 0.66, 0.9])
def test_other_gauge_positions(gauge_at: float) -> None:
    plan = double_posture(LARGE, gauge_at=gauge_at)
    session = readings(LARGE, plan, seed=None)
    assert solve(session, LARGE).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    assert solve(session, LARGE, "six").offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_gauges_at_different_places_on_one_leg() -> None:
    both = merged(*(double_posture(PROTOTYPE, 1, gauge_at=f) for f in (0.3, 0.6)))
    session = readings(PROTOTYPE, both, seed=None)
    assert solve(session, PROTOTYPE).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_unequal_repeats_and_missing_readings() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE), seed=None)
    rng = np.random.default_rng(4)
    for _ in range(20):
        part = session.subset(rng.choice(60, 35, replace=False))
        assert solve(part, PROTOTYPE).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_a_whole_leg_may_be_missing() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE), seed=None)
    part = session.subset(session.plan.leg != 2)
    assert solve(part, PROTOTYPE).offsets_mm == pytest.approx(OFFSETS, abs=1e-9)


def test_gauge_zeros_do_not_matter() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE))
    zeros = np.random.default_rng(1).uniform(-5.0, 5.0, session.plan.setups)
    shifted = replace(session, value=session.value + zeros[session.plan.setup])
    one, two = solve(session, PROTOTYPE), solve(shifted, PROTOTYPE)
    assert one.offsets_mm == pytest.approx(two.offsets_mm, abs=1e-9)
    assert one.rms_before_mm == pytest.approx(two.rms_before_mm, abs=1e-9)


def test_predicted_readings_carry_their_fitted_zeros() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE))
    solution = solve(session, PROTOTYPE)
    assert solution.readings_mm is not None
    residual = session.value - solution.readings_mm
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(solution.rms_after_mm, rel=1e-12)
    assert np.abs(session.plan.zeros.T @ residual).max() < 1e-12


def accepted(values: tuple[float, ...]) -> Machine:
    """The prototype with axes known to miss each other."""
    gaps = {
        name: Estimate(value, 0.01, "mm")
        for name, value in zip(CAUSES["axis_gap"].names, values, strict=True)
    }
    cause = IdentifiedCause("axis_gap", "", gaps, "2026-01-01", "0" * 64)
    return replace(PROTOTYPE, identified=(cause,))


LASTING = [cause for cause in CAUSES.values() if cause.lasting]


@pytest.mark.parametrize("cause", LASTING, ids=lambda cause: cause.id)
def test_with_a_known_cause_it_is_least_squares_with_zeros(cause: Cause) -> None:
    """Readings of one kind may be joined only where the cause cannot tell them apart."""
    sizes = cause.prior_std(PROTOTYPE) * np.linspace(1.0, 2.0, len(cause.prior_std(PROTOTYPE)))
    effects = [cause.at(sizes)]
    assert effects[0].repeats != cause.timed
    session = readings(PROTOTYPE, double_posture(PROTOTYPE), seed=4, effects=effects)
    offsets, _ = explicit(session, PROTOTYPE, effects)
    solution = solve(session, PROTOTYPE, None, effects)
    assert solution.offsets_mm == pytest.approx(offsets, abs=1e-9)
    assert np.abs(solve(session, PROTOTYPE).offsets_mm - offsets).max() > 1e-4


@pytest.mark.parametrize("method", ["readings", "six", "twelve"])
def test_known_causes_are_part_of_the_model(method: str) -> None:
    machine = accepted((0.3, -0.4, 0.25))
    effects = machine_effects(machine)
    session = readings(machine, double_posture(machine), seed=None, effects=effects)
    known = solve(session, machine, method, effects)
    assert known.offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
    assert known.rms_after_mm < 1e-9
    assert np.abs(solve(session, machine, method).offsets_mm - OFFSETS).max() > 0.05


def test_linear_methods_allow_for_known_causes() -> None:
    machine = accepted((0.3, -0.4, 0.25))
    effects = machine_effects(machine)
    small = 1e-3 * OFFSETS
    session = readings(machine, double_posture(machine), small, seed=None, effects=effects)
    found = solve(session, machine, "six-linear", effects).offsets_mm
    assert found == pytest.approx(small, abs=1e-5)


@pytest.mark.parametrize(
    ("kind", "usable"),
    [
        ("six", ("six-linear", "six")),
        ("twelve", ("six-linear", "twelve-linear", "six", "twelve")),
        ("single", ("single", "single-sequential")),
    ],
)
def test_which_methods_differences_can_feed(kind: str, usable: tuple[str, ...]) -> None:
    data = differences(kind, PROTOTYPE)
    assert usable_methods(data) == usable
    for name in usable:
        assert solve(data, PROTOTYPE, name).method == name
    for name in set(METHODS) - set(usable):
        with pytest.raises(UsageError, match=f"Method {name} cannot use") as caught:
            solve(data, PROTOTYPE, name)
        assert usable[0] in caught.value.remedy


def test_which_methods_raw_readings_can_feed() -> None:
    double = readings(PROTOTYPE, double_posture(PROTOTYPE))
    single = readings(PROTOTYPE, single_posture(PROTOTYPE))
    assert usable_methods(double) == ("six-linear", "twelve-linear", "six", "twelve", "readings")
    assert usable_methods(single) == ("single", "single-sequential", "readings")
    with pytest.raises(UsageError, match="no method 'best'"):
        solve(double, PROTOTYPE, "best")


def test_six_and_twelve_of_the_same_readings_differ_only_by_noise() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE))
    found = [solve(session, PROTOTYPE, m).offsets_mm for m in ("readings", "six", "twelve")]
    for other in found[1:]:
        assert 0.0 < np.abs(other - found[0]).max() < 0.03


def test_raw_readings_without_the_rank_for_their_method() -> None:
    session = readings(PROTOTYPE, double_posture(PROTOTYPE))
    only_x = session.subset((session.plan.leg == 0) & (session.plan.direction == 1))
    for method in ("readings", "six", "twelve-linear"):
        with pytest.raises(RankDeficientError):
            solve(only_x, PROTOTYPE, method)
