"""The forward model with each cause against the independent simulator, and its derivatives."""

from typing import Any

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model import Floats, Model, differentiate, simulate
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
from tests.truth import again

both_machines = pytest.mark.parametrize(("model", "hidden"), MACHINES.values(), ids=list(MACHINES))
OFFSETS = np.random.default_rng(7).uniform(-3.0, 3.0, (4, 3))
# The carriages of these stand where the offsets put them when a gauge is set up.
AT_REST = ("axis_gap", "axis_squareness", "leg_length", "encoder_scale", "bar_skew")


def zero_free(values: Floats, setup: np.ndarray) -> Floats:
    """Each set-up's readings minus their mean."""
    zeros = (setup[:, None] == np.arange(setup.max() + 1)).astype(float)
    return values - zeros @ (np.linalg.pinv(zeros) @ values)


@both_machines
def test_readings_of_a_healthy_machine_are_those_of_the_truth(
    model: Model, hidden: truth.Machine
) -> None:
    plan = standard(hidden)
    for offsets in np.random.default_rng(20).uniform(-3.0, 3.0, (20, 3)):
        true = truth.signals(plan, hidden, state_of(None, offsets))[0]
        error = zero_free(simulate(model, offsets, as_plan(plan)) - true, plan.setup)
        assert np.abs(error).max() < 1e-9


@both_machines
@pytest.mark.parametrize("cause", SIZES)
def test_readings_are_those_of_the_truth(model: Model, hidden: truth.Machine, cause: str) -> None:
    """To rounding; where a cause moves the carriages, once both set the gauges up at rest."""
    plan = standard(hidden)
    if cause not in AT_REST:
        plan = with_stands_at_rest(plan)
    effect = effect_of(cause)
    if cause == "backlash":
        # Where the carriages stand before their first motion also shifts the six stands.
        effect = CAUSES["backlash"].at(np.array([*SIZES["backlash"][:3], 0.0, 0.0, 0.0]))
    for offsets in OFFSETS:
        state = state_of(cause, offsets)
        if cause == "backlash":
            state[0, 18:21] = 0.0
        true = truth.signals(plan, hidden, state)[0]
        mine = simulate(model.extended([effect]), offsets, as_plan(plan))
        assert np.abs(zero_free(mine - true, plan.setup)).max() < 1e-9
        without = simulate(model, offsets, as_plan(plan))
        assert np.abs(zero_free(mine - without, plan.setup)).max() > 1e-3


@both_machines
@pytest.mark.parametrize("cause", ["backlash", "thermal_drift"])
def test_where_the_stands_differ_it_is_by_the_lean_of_the_leg(
    model: Model, hidden: truth.Machine, cause: str
) -> None:
    """A stand δ further along a leg that leans by dy/dx reads δ·dy/dx less: some 1e-4 mm here.

    δ is at most half the lost motion and the first position, or what has drifted by the time
    the last leg is reached; the legs lean by at most (offsets + drift)/L·tan α, about 1 %.
    """
    plan = standard(hidden)
    for offsets in OFFSETS:
        true = truth.signals(plan, hidden, state_of(cause, offsets))[0]
        mine = simulate(model.extended([effect_of(cause)]), offsets, as_plan(plan))
        without = simulate(model, offsets, as_plan(plan))
        assert np.abs(zero_free(mine - true, plan.setup)).max() < 0.06 * 0.01
        assert np.abs(zero_free(mine - without, plan.setup)).max() > 0.01


@both_machines
def test_carriages_approach_from_where_the_truth_says(model: Model, hidden: truth.Machine) -> None:
    plan = standard(hidden)
    approach = model.machine.command(as_plan(plan)).approach
    assert np.array_equal(approach, plan.approach)
    assert set(np.unique(approach)) == {-1.0, 0.0, 1.0}


@both_machines
def test_all_causes_at_once_are_those_of_the_truth(model: Model, hidden: truth.Machine) -> None:
    """Rails, legs, motion and bars together, in any order in which they were accepted."""
    plan = standard(hidden)
    state = state_of(None, OFFSETS[0])
    for cause in AT_REST:
        state += state_of(cause, np.zeros(3))
    true = truth.signals(plan, hidden, state)[0]
    for order in (AT_REST, AT_REST[::-1]):
        worse = model.extended(effect_of(cause) for cause in order)
        error = zero_free(simulate(worse, OFFSETS[0], as_plan(plan)) - true, plan.setup)
        assert np.abs(error).max() < 1e-9


STEP = (0.5, -0.3, 1.2)


@both_machines
@pytest.mark.parametrize(
    "changed",
    [
        {"turned": 1},
        {"entered": STEP},
        {"gauge_at": 0.2},
        {"part": 0, "entered": STEP},
        {"part": 0, "turned": 1, "entered": STEP, "gauge_at": 0.8},
    ],
    ids=str,
)
def test_so_are_readings_of_another_part(
    model: Model, hidden: truth.Machine, changed: dict[str, Any]
) -> None:
    """Rails, legs, motion and bars, after a bar was turned, offsets entered, or stands moved."""
    plan = again(truth.make_session(1, hidden, truth.MICRON), **changed).plan
    assert plan.count == 120
    worse = model.extended(effect_of(cause) for cause in AT_REST)
    for offsets in OFFSETS:
        state = state_of(None, offsets)
        for cause in AT_REST:
            state += state_of(cause, np.zeros(3))
        true = truth.signals(plan, hidden, state)[0]
        mine = simulate(worse, offsets, as_plan(plan))
        assert np.abs(zero_free(mine - true, plan.zero)).max() < 1e-9


@both_machines
@pytest.mark.parametrize("cause", SIZES)
def test_derivatives_by_the_parameters_are_those_of_the_readings(
    model: Model, hidden: truth.Machine, cause: str
) -> None:
    """∂readings/∂θ where nothing is zero, beside two other causes; differences err by 1e-8."""
    plan = as_plan(standard(hidden))
    kind, theta = CAUSES[cause], effect_of(cause).theta
    known = model.extended(effect_of(id) for id in ("axis_gap", "encoder_scale") if id != cause)
    slope = differentiate(known, OFFSETS[1], plan, [kind.at(theta)])[1]
    step = 1e-3 * kind.scale
    for k in range(theta.size):
        moved = step * np.eye(theta.size)[k]
        up, down = (
            simulate(known.extended([kind.at(theta + sign * moved)]), OFFSETS[1], plan)
            for sign in (1.0, -1.0)
        )
        difference = (up - down) / (2.0 * step)
        size = np.abs(difference).max()
        assert size > 1e-3
        assert slope[:, 3 + k] == pytest.approx(difference, abs=1e-6 * max(1.0, size))


@both_machines
@pytest.mark.parametrize("cause", SIZES)
def test_many_sizes_at_once_are_as_one_by_one(
    model: Model, hidden: truth.Machine, cause: str
) -> None:
    plan = as_plan(standard(hidden))
    kind, theta = CAUSES[cause], effect_of(cause).theta
    factors = np.array([0.3, 1.0, -1.7])
    many = model.extended([kind.at(factors[:, None] * theta)])
    # Of as many machines with other offsets, and of one.
    for given in (OFFSETS[:3], OFFSETS[0]):
        rows = zip(
            simulate(many, given, plan), np.broadcast_to(given, (3, 3)), factors, strict=True
        )
        for row, offsets, factor in rows:
            alone = simulate(model.extended([kind.at(factor * theta)]), offsets, plan)
            assert np.abs(row - alone).max() < 1e-12
