"""Protocols: order of the readings, reductions to differences, contrasts, synthetic records."""

import numpy as np
import pytest

from orthoglide_cal.errors import UnreachableError
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact
from orthoglide_cal.protocols import (
    NAMES,
    SIX,
    cell_contrasts,
    double_posture,
    ideal_plan,
    reduction,
    single_posture,
    synthetic_session,
    without_zeros,
    written_down,
    zero_free,
)
from orthoglide_cal.simulation import simulate, simulate_with_jacobian
from tests.machines import LARGE, PROTOTYPE, both_machines

OFFSETS = np.array([0.4, -0.9, 0.6])


@both_machines
def test_the_double_posture_session_is_the_papers(machine: Machine) -> None:
    """Isotropic → max → min, three times and once more isotropic, leg after leg (sec. 4.1)."""
    plan = double_posture(machine)
    low, high = machine.joint_limits_mm
    assert len(plan) == 60
    assert plan.leg.tolist() == sorted(plan.leg.tolist())
    per_leg = plan.displacement[plan.leg == 1][::2].tolist()
    assert per_leg == [0.0, high, low] * 3 + [0.0]
    assert plan.direction[plan.leg == 1].tolist() == [0, 2] * 10
    assert plan.setups == 6
    assert np.all(np.diff(plan.hours) >= 0.0)


def test_the_single_posture_session_reads_both_ends_along_z() -> None:
    plan = single_posture(PROTOTYPE, cycles=2)
    assert len(plan) == 24
    assert set(plan.leg.tolist()) == {0, 1}
    assert set(plan.direction.tolist()) == {2}
    assert plan.contact.tolist() == [Contact.JOINT, Contact.TOOL] * 12
    assert plan.setups == 2


@pytest.mark.parametrize("kind", ["six", "twelve", "single"])
def test_a_reduction_subtracts_means_and_forgets_the_zeros(kind: str) -> None:
    plan = single_posture(PROTOTYPE, 3) if kind == "single" else double_posture(PROTOTYPE)
    matrix = reduction(kind, NAMES[kind], PROTOTYPE, plan)
    assert np.abs(matrix @ plan.zeros).max() < 1e-15
    assert np.abs(matrix).sum(axis=1) == pytest.approx(np.full(len(matrix), 2.0))


def test_a_difference_is_the_mean_at_max_minus_the_mean_at_min() -> None:
    plan = double_posture(PROTOTYPE)
    values = np.random.default_rng(5).normal(0.0, 1.0, len(plan))
    row = dict(zip(SIX, reduction("six", SIX, PROTOTYPE, plan) @ values, strict=True))
    mine = (plan.leg == 2) & (plan.direction == 1)
    high, low = values[mine & (plan.displacement == 60)], values[mine & (plan.displacement == -100)]
    assert row["y_z"] == pytest.approx(high.mean() - low.mean(), abs=1e-15)


def test_readings_of_different_set_ups_are_never_subtracted() -> None:
    """Max in one set-up, min in another: no difference; both in a third: that one alone."""
    plan = double_posture(PROTOTYPE, cycles=1, closing=False, postures=("max", "min"))
    parts = {name: getattr(plan, name) for name in type(plan).__annotations__}
    apart = type(plan)(**{**parts, "setup": np.arange(len(plan))})
    assert not reduction("six", SIX, PROTOTYPE, apart).any()


@pytest.mark.parametrize("plan", [double_posture(LARGE), single_posture(LARGE, 2)])
def test_contrasts_are_orthonormal_and_complete(plan: object) -> None:
    matrix = zero_free(plan)  # type: ignore[arg-type]
    assert matrix @ matrix.T == pytest.approx(np.eye(len(matrix)), abs=1e-12)
    assert np.abs(matrix @ plan.zeros).max() < 1e-12  # type: ignore[attr-defined]
    assert len(matrix) == len(plan) - plan.setups  # type: ignore[arg-type, attr-defined]


@both_machines
def test_contrasts_of_cells_are_least_squares_on_all_readings(machine: Machine) -> None:
    """Unequal repeats: same normal equations as the contrasts of all readings."""
    rng = np.random.default_rng(8)
    plan = double_posture(machine).subset(np.sort(rng.choice(60, 41, replace=False)))
    slope = simulate_with_jacobian(machine, OFFSETS, plan)[1]
    values = rng.normal(0.0, 1.0, len(plan))
    few, all_ = cell_contrasts(plan), zero_free(plan)
    assert len(few) < len(all_)
    assert few @ few.T == pytest.approx(np.eye(len(few)), abs=1e-12)
    for one, other in ((slope, slope), (slope, values)):
        mine, full = ((m @ one).T @ (m @ other) for m in (few, all_))
        assert mine == pytest.approx(full, abs=1e-10)


def test_removing_the_zeros_keeps_what_the_contrasts_see() -> None:
    plan = double_posture(LARGE, 2)
    values = np.random.default_rng(4).normal(0.0, 1.0, (5, len(plan)))
    rest = without_zeros(plan, values)
    assert (rest**2).sum(axis=1) == pytest.approx(
        ((values @ zero_free(plan).T) ** 2).sum(axis=1), rel=1e-12
    )
    assert np.abs(rest @ plan.zeros).max() < 1e-12


def test_written_down_readings_have_the_gauges_noise_zeros_and_steps() -> None:
    """Chance of failure about 1e-6 (five standard deviations of a variance)."""
    plan, rng = double_posture(PROTOTYPE), np.random.default_rng(3)
    signal = simulate(PROTOTYPE, OFFSETS, plan)
    values = written_down(signal, plan, PROTOTYPE.gauge, rng, 4000)
    steps = values / PROTOTYPE.gauge.resolution_mm
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    spread = (values - signal) @ zero_free(plan).T
    expected = PROTOTYPE.gauge.noise_mm
    assert spread.std() == pytest.approx(expected, rel=5.0 / np.sqrt(2.0 * spread.size) + 0.01)
    zeros = (values - signal)[:, 0]
    assert zeros.min() < -0.9
    assert zeros.max() > 0.9


def test_the_same_seed_gives_the_same_session() -> None:
    plan = ideal_plan("twelve", PROTOTYPE)
    one, two, other = (
        synthetic_session(PROTOTYPE, plan, OFFSETS, np.random.default_rng(seed))
        for seed in (4, 4, 5)
    )
    assert np.array_equal(one.value, two.value)
    assert not np.array_equal(one.value, other.value)
    assert one.posture[:4] == ("iso", "iso", "max", "max")
    assert set(one.cycle.tolist()) == {1}


def test_a_machine_that_cannot_take_the_postures_is_an_error() -> None:
    plan = ideal_plan("six", PROTOTYPE)
    with pytest.raises(UnreachableError):
        synthetic_session(PROTOTYPE, plan, np.full(3, 400.0), np.random.default_rng(1))
