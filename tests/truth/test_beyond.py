"""Effects beyond the list are as their names say, and their distances are those of densities."""

from dataclasses import replace

import numpy as np
import pytest

from . import MICRON, PROTOTYPE
from .beyond import HOWS, Beyond, Gaussian, Where, distinguish, draw_beyond
from .forward import Disturbance
from .plan import Floats


def _added(hidden: Beyond) -> Floats:
    """What the effect adds to the record, shape (N,), [mm]."""
    return np.asarray(hidden.session.clean - hidden.twin.clean)


def in_time(how: str, values: Floats, minutes: Floats, shape: float) -> Floats:
    """The course of the effect that these values are of; of scatter, of which no two are alike."""
    if how == "settles":
        return np.asarray(values[0] * np.exp(-(minutes - minutes[0]) / shape))
    if how == "steps":
        return np.where(minutes < shape, 0.0, values[-1])
    if how == "drifts":
        turn = 2.0 * np.pi * minutes / shape
        waves = np.column_stack((np.sin(turn), np.cos(turn)))
        return waves @ np.linalg.lstsq(waves, values, rcond=None)[0]
    assert np.unique(values).size == values.size
    return values


@pytest.mark.parametrize("how", HOWS)
def test_an_effect_is_what_it_says_in_its_place_and_nothing_elsewhere(how: str) -> None:
    hidden = draw_beyond(1, PROTOTYPE, MICRON, how, "leg")
    added, plan = _added(hidden), hidden.session.plan
    assert not added[plan.leg != hidden.where.leg].any()
    posture = np.array(plan.posture)
    for gauge in np.unique(plan.setup[plan.leg == hidden.where.leg]):
        rows = np.flatnonzero(plan.setup == gauge)
        values, minutes = added[rows], plan.minutes[rows]
        assert np.abs(values).max() > 2.0 * MICRON.sigma
        assert how != "steps" or not values[0]
        if how == "repeats":
            expected = [values[posture[rows] == name][0] for name in posture[rows]]
        elif how == "hysteresis":
            moved = np.diff(hidden.twin.clean[rows])
            expected = [0.0, *np.where(moved > 0.0, -1.0, 1.0) * np.abs(values[1])]
        elif how == "temperature":
            change = hidden.session.warm - hidden.session.warm[0]
            expected = change[rows] * (values[-1] / change[rows][-1])
        else:
            expected = in_time(how, values, minutes, hidden.shape)
        assert values == pytest.approx(expected, abs=1e-9)


def test_costs_are_those_of_normal_densities() -> None:
    """Differences of expected log densities, with zeros and offsets of 10 m instead of free."""
    rng = np.random.default_rng(5)
    free, noise, first, second = (rng.normal(size=(20, count)) for count in (3, 2, 1, 4))
    record = rng.normal(scale=5.0, size=20)
    near = Gaussian(free, noise, first)
    pair = near.costs(record, np.stack((second, 0.0 * second)))
    wide = 1e8 * free @ free.T + np.eye(20) + noise @ noise.T
    direct = []
    for added in (np.hstack((first, second)), first):
        covariance = wide + added @ added.T
        expected = wide - 1e8 * free @ free.T + np.outer(record, record)
        cost = np.trace(np.linalg.solve(covariance, expected))
        direct.append(cost + np.linalg.slogdet(covariance)[1])
    assert pair[0] - pair[1] == pytest.approx(direct[0] - direct[1], abs=1e-4)
    alone = near.with_columns(second).costs(record, np.zeros((1, 20, 0)))
    assert alone[0] == pytest.approx(pair[0], rel=1e-9)


def test_a_clear_effect_stands_out_and_a_hundredth_of_it_does_not() -> None:
    step = draw_beyond(10, PROTOTYPE, MICRON, "steps", "leg")
    far = distinguish(step)
    # One stand at a time is in use.
    assert far.same == {("steps", step.where), ("steps", Where())}
    assert far.clear
    small = Disturbance.of(step.session.plan, contact=0.01 * _added(step))
    clean = step.twin.clean + small.contact
    faint = replace(step, session=replace(step.session, disturbance=small, clean=clean))
    assert not distinguish(faint).clear
