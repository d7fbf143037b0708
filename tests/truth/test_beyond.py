"""Effects beyond the list are as their names say, and their distances are those of densities.

Of gauges, and in regions of a bed.
"""

from dataclasses import replace

import numpy as np
import pytest

from . import MICRON, PROTOTYPE, bed
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


@pytest.mark.parametrize("how", bed.HOWS)
@pytest.mark.parametrize("kind", ["half", "ring"])
def test_an_effect_is_what_it_says_in_its_region_and_nothing_elsewhere(how: str, kind: str) -> None:
    hidden = bed.draw_bed(3, how, kind)
    session, added = hidden.session, hidden.session.contact
    rows = hidden.where.rows(session.x, session.y)
    assert 0 < rows.sum() < len(rows)
    assert not added[~rows].any()
    values, minutes = added[rows], session.minutes[rows]
    assert values == pytest.approx(in_time(how, values, minutes, hidden.shape), abs=1e-9)
    assert np.abs(values).max() > (1.0 if how == "scatters" else 4.0) * session.machine.noise


def test_regions_have_the_answers_names_and_cover_the_bed() -> None:
    x, y = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 200))
    # Of the halves two hold each place.
    counts = {"everything": 1, "half": 2, "quarter": 1, "ring": 1}
    for kind, names in bed.KINDS.items():
        assert set(sum(bed.Region(name).rows(x, y).astype(int) for name in names)) == {counts[kind]}
    assert (bed.Region("edge").names, bed.Region().names) == ({"region": "edge"}, {})
    assert bed.Region("back left").kind == "quarter"


def test_a_step_of_one_pass_of_three_is_clear() -> None:
    far = bed.distinguish_bed(bed.draw_bed(3, "steps", "half"))
    assert far.clear
    assert all(how == "steps" for how, _ in far.same)
