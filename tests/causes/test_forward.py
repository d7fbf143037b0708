"""The forward model with each cause against the independent simulator, and its derivatives."""

import numpy as np
import pytest

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, Where
from orthoglide_cal.effects import Commanded
from orthoglide_cal.machine import Machine
from orthoglide_cal.simulation import STEP, simulate
from tests import truth
from tests.causes.condition import (
    MACHINES,
    SIZES,
    as_plan,
    effect_of,
    standard,
    state_of,
    with_stands_at_rest,
)
from tests.truth.effects import Effect, contact_shift, write_down

both_machines = pytest.mark.parametrize(
    ("machine", "hidden"), MACHINES.values(), ids=list(MACHINES)
)
OFFSETS = np.random.default_rng(7).uniform(-2.0, 2.0, (4, 3))


def zero_free(values: Floats, setup: np.ndarray) -> Floats:
    """Each set-up's readings minus their mean."""
    zeros = (setup[:, None] == np.arange(setup.max() + 1)).astype(float)
    return values - zeros @ (np.linalg.pinv(zeros) @ values)


@both_machines
@pytest.mark.parametrize("cause", [None, *SIZES])
def test_readings_are_those_of_the_truth(
    machine: Machine, hidden: truth.Machine, cause: str | None
) -> None:
    """To rounding, once both set the gauges up with the machine at rest (see the helper)."""
    plan = with_stands_at_rest(standard(hidden))
    effects = [] if cause is None else [effect_of(cause)]
    if cause == "backlash":
        # Where the carriages stand before their first motion also shifts the six stands.
        effects = [CAUSES["backlash"].at(np.array([*SIZES["backlash"][:3], 0.0, 0.0, 0.0]))]
    for offsets in OFFSETS:
        state = state_of(cause, offsets)
        if cause == "backlash":
            state[0, 18:21] = 0.0
        true = truth.signals(plan, hidden, state)[0]
        mine = simulate(machine, offsets, as_plan(plan), effects)
        error = zero_free(mine - true, plan.setup)
        assert np.abs(error).max() < 1e-9
        if cause is not None:
            without = simulate(machine, offsets, as_plan(plan))
            assert np.abs(zero_free(mine - without, plan.setup)).max() > 1e-5


@both_machines
@pytest.mark.parametrize("cause", ["backlash", "thermal_drift"])
def test_where_the_stands_differ_it_is_by_the_lean_of_the_leg(
    machine: Machine, hidden: truth.Machine, cause: str
) -> None:
    """A stand δ further along a leg that leans by dy/dx reads δ·dy/dx less: some 1e-4 mm here.

    δ is at most half the lost motion and the first position, or what has drifted by the time
    the last leg is reached; the legs lean by at most (offsets + drift)/L·tan α, under 1 %.
    """
    plan = standard(hidden)
    for offsets in OFFSETS:
        true = truth.signals(plan, hidden, state_of(cause, offsets))[0]
        mine = simulate(machine, offsets, as_plan(plan), [effect_of(cause)])
        assert np.abs(zero_free(mine - true, plan.setup)).max() < 0.06 * 0.01


@both_machines
def test_carriages_approach_from_where_the_truth_says(
    machine: Machine, hidden: truth.Machine
) -> None:
    plan = standard(hidden)
    approach = Commanded(machine, as_plan(plan)).approach
    assert np.array_equal(approach, plan.approach)
    assert set(np.unique(approach)) == {-1.0, 0.0, 1.0}


def test_approach_follows_time_not_the_order_of_the_rows() -> None:
    plan = as_plan(standard(truth.PROTOTYPE))
    mixed = np.random.default_rng(3).permutation(len(plan))
    machine = MACHINES["prototype"][0]
    shuffled = Commanded(machine, plan.subset(mixed)).approach
    assert np.array_equal(shuffled, Commanded(machine, plan).approach[mixed])


PLACES = {
    "gauge_drift": (Effect("gauge_drift", parameters=(0.17,), setup=4), Where((2, 0)), 0.17),
    "stand_shift": (Effect("stand_shift", parameters=(-0.13,), setup=1, row=9), Where((9,)), -0.13),
    "gauge_slip": (Effect("gauge_slip", parameters=(-2.0,), setup=2, row=27), Where((27, 0)), -2.0),
    "misread": (Effect("misread", parameters=(0.31,), setup=3, row=29), Where((29,)), 0.31),
    "sign_flip": (Effect("sign_flip", setup=5), Where((2, 1)), None),
    "swapped_gauges": (Effect("swapped_gauges", leg=1), Where((1,)), None),
}


@both_machines
@pytest.mark.parametrize("cause", PLACES)
def test_faults_of_the_measurement_are_those_of_the_truth(
    machine: Machine, hidden: truth.Machine, cause: str
) -> None:
    """At the same place and size, behind arbitrary zeros, and at no other reading."""
    plan = standard(hidden)
    effect, where, size = PLACES[cause]
    offsets = OFFSETS[0]
    rng = np.random.default_rng(5)
    zeros = rng.uniform(-3.0, 3.0, 6)[plan.setup]
    surface = truth.signals(plan, hidden, state_of(None, offsets))[0] + zeros
    true = write_down(plan, truth.DIAL, surface + contact_shift(plan, (effect,)), (effect,))
    acting = CAUSES[cause].at(np.zeros(0) if size is None else np.array([size]), where)
    mine = as_plan(plan)
    commanded = Commanded(machine, mine)
    readings = simulate(machine, offsets, mine) + zeros
    readings = acting.contact(readings, np.full(len(mine), 0.5), commanded)
    written = acting.record(readings, commanded)
    assert np.abs(written - true).max() < 1e-9
    assert np.abs(written - surface).max() > 0.05


def test_a_slip_may_last_to_the_end_of_its_set_up() -> None:
    machine, hidden = MACHINES["prototype"]
    plan = as_plan(standard(hidden))
    acting = CAUSES["gauge_slip"].at(np.array([2.0]), Where((27, 1)))
    added = acting.record(np.zeros(len(plan)), Commanded(machine, plan))
    expected = (plan.setup == plan.setup[27]) & (plan.order >= 27)
    assert added == pytest.approx(2.0 * expected)
    assert 1 < expected.sum() < 10


def test_a_turn_is_as_long_as_the_dial_says() -> None:
    from dataclasses import replace

    machine, hidden = MACHINES["prototype"]
    plan = as_plan(standard(hidden))
    inch = replace(machine, gauge=replace(machine.gauge, revolution_mm=2.54))
    acting = CAUSES["gauge_slip"].at(np.array([-1.0]), Where((3, 0)))
    added = acting.record(np.zeros(len(plan)), Commanded(inch, plan))
    assert added[3] == pytest.approx(-2.54)


@pytest.mark.parametrize("cause", SIZES)
def test_complex_steps_agree_with_finite_differences(cause: str) -> None:
    """∂readings/∂θ at a point where nothing is zero; the differences err by step² ~ 1e-8."""
    machine, hidden = MACHINES["prototype"]
    plan = as_plan(standard(hidden))
    kind = CAUSES[cause]
    offsets, theta = OFFSETS[1], effect_of(cause).theta
    other = [effect_of(id) for id in ("axis_gap", "encoder_scale") if id != cause]
    size = theta.size
    exact = (
        simulate(machine, offsets, plan, [*other, kind.at(theta + 1j * STEP * np.eye(size))]).imag.T
        / STEP
    )
    step = 1e-3 * kind.scale
    for k in range(size):
        moved = step * np.eye(size)[k]
        up = simulate(machine, offsets, plan, [*other, kind.at(theta + moved)])
        down = simulate(machine, offsets, plan, [*other, kind.at(theta - moved)])
        slope = (up - down) / (2.0 * step)
        assert np.abs(slope).max() > 1e-3
        assert exact[:, k] == pytest.approx(slope, abs=1e-6 * max(1.0, np.abs(slope).max()))


@pytest.mark.parametrize("cause", SIZES)
def test_many_sizes_at_once_are_as_one_by_one(cause: str) -> None:
    machine, hidden = MACHINES["large"]
    plan = as_plan(standard(hidden))
    kind, theta = CAUSES[cause], effect_of(cause).theta
    factors = np.array([0.3, 1.0, -1.7])
    together = simulate(machine, OFFSETS[:3], plan, [kind.at(factors[:, None] * theta)])
    for row, offsets, factor in zip(together, OFFSETS[:3], factors, strict=True):
        alone = simulate(machine, offsets, plan, [kind.at(factor * theta)])
        assert np.abs(row - alone).max() < 1e-12
