"""Readings of several sittings: a turned bar, offsets entered in between, other gauge places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model import (
    Contact,
    GaugePlan,
    Model,
    differentiate,
    double_posture,
    simulate,
    simulate_with_jacobian,
)
from orthoglide_cal.model.orthoglide import PlannedReading, plan_of
from tests.machines import PROTOTYPE

PLAN = double_posture(PROTOTYPE, cycles=1)
OFFSETS = np.array([0.4, -0.3, 0.7])
STEP = np.array([0.5, 0.0, -0.2])
SKEW = np.array([1.0, -2.0, 0.5, 1.5, -1.0, 0.7]) * 1e-3
WRONG = (
    CAUSES["axis_gap"].at(np.array([0.3, -0.2, 0.1])),
    CAUSES["encoder_scale"].at(np.array([1e-3, -2e-3, 5e-4])),
)


def stepped_within(plan: GaugePlan) -> GaugePlan:
    """The closing readings of each leg are taken after a step was entered, stands untouched."""
    closing = np.array([np.flatnonzero(plan.setup == k)[-1] for k in range(plan.setups)])
    entered = np.zeros((len(plan), 3))
    entered[closing] = STEP
    return replace(plan, entered=entered)


def test_what_is_not_said_is_as_before() -> None:
    assert not any(values.any() for values in (PLAN.part, PLAN.turned, PLAN.entered))
    assert PLAN.entered.shape == PLAN.stood.shape == (len(PLAN), 3)
    assert (PLAN.parts, PLAN.state) == (1, ())
    with pytest.raises(ValueError, match="entered has shape"):
        replace(PLAN, entered=np.zeros((2, 3)))


@pytest.mark.parametrize("wrong", [(), WRONG])
def test_derivatives_are_those_of_the_readings(wrong: tuple) -> None:
    model, plan = Model(PROTOTYPE, wrong), stepped_within(PLAN)
    many = OFFSETS + np.random.default_rng(1).normal(scale=0.3, size=(4, 3))
    values, slope = simulate_with_jacobian(model, many, plan)
    assert values == pytest.approx(np.stack([simulate(model, one, plan) for one in many]))
    h = 1e-4
    for k in range(3):
        ahead, behind = (simulate(model, many + s * h * np.eye(3)[k], plan) for s in (1, -1))
        assert slope[..., k] == pytest.approx((ahead - behind) / (2 * h), abs=1e-7)
    effect = CAUSES["bar_skew"].at(SKEW)
    _, columns = differentiate(model, many[0], plan, [effect])
    full = Model(PROTOTYPE, (*wrong, effect))
    assert columns[:, :3] == pytest.approx(
        simulate_with_jacobian(full, many[0], plan)[1], abs=1e-10
    )


def test_readings_that_differ_in_it_are_no_repeats() -> None:
    plan = plan_of(
        [
            PlannedReading(
                0, 1, d, Contact.FIXED, part=part, turned=part == 1, entered=(step, 0.0, 0.0)
            )
            for part, step in ((0, 0.0), (1, 0.0), (2, 0.5))
            for d in (0.0, 60.0)
        ]
    )
    assert plan.setup.tolist() == [0, 0, 1, 1, 2, 2]
    assert plan.parts == 3
    assert len(set(plan.cells.tolist())) == len(plan.distinct[0]) == 6
    assert len(plan.moments[0]) == 4
    plain = replace(plan, turned=False, entered=0.0)
    assert len(set(plain.cells.tolist())) == len(plain.distinct[0]) == 2
