"""The prediction of the next reading against independent calculations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.gaussian import Mixture
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import PlannedReading
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.session.readings import (
    OFFSET_MM,
    UNKNOWN_MM,
    ZERO_MM,
    forecast,
    plausible_misfit_mm,
)
from tests import truth
from tests.machines import NOMINAL, PROTOTYPE
from tests.truth.forward import PARTS

from .virtual import readings_of, steps_of

# Of the misfits that are tried, in plausible ones: each three times the one before.
SIZES = 3.0 ** np.arange(-3, 2)


def in_full(plan: GaugePlan, fresh: np.ndarray | None = None, model: Model = NOMINAL) -> Mixture:
    fresh = np.zeros(len(plan), dtype=int) if fresh is None else fresh
    return forecast(model, plan, fresh, model.machine.instrument.noise_mm)


def timed_plan(count: int = 60) -> GaugePlan:
    """The first steps of a session at an uneven pace."""
    steps = steps_of()[:count]
    hours = np.array([0.3 * k + 5.0 * s.setup for k, s in enumerate(steps)]) / 60.0
    return replace(PlannedReading.planned([s.cell for s in steps]), hours=hours)


def an_example() -> tuple[Mixture, np.ndarray]:
    return in_full(timed_plan(30)), np.array(readings_of(steps_of()[:30], 4))


def unknowns(plan: GaugePlan, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The formula of a reading, one unknown at a time: columns of unit variance (n, p), (n, c)."""
    known = fresh == 0
    columns, misfits = [], []
    for step in 1e-4 * np.eye(3):  # central differences instead of the exact derivative
        slope = (simulate(NOMINAL, step, plan) - simulate(NOMINAL, -step, plan)) / 2e-4
        columns.append(OFFSET_MM * slope * known)
    for setup in range(plan.setups):
        columns.append(ZERO_MM * (plan.setup == setup))
    keys = list(zip(plan.leg, plan.direction, plan.displacement, plan.contact, fresh, strict=True))
    for key in dict.fromkeys(keys):
        mine = np.array([other == key for other in keys])
        columns.append(UNKNOWN_MM * (mine & ~known))
        misfits.append(mine & known)
    rate = math.hypot(PROTOTYPE.tolerances["thermal_drift"], PROTOTYPE.tolerances["gauge_drift"])
    for leg in range(3):
        away = plan.order[(plan.leg == leg) & (plan.displacement != 0.0)].min()
        for direction in range(3):
            mine = (plan.leg == leg) & (plan.direction == direction)
            columns.append(rate * plan.hours * mine)
            columns.append(PROTOTYPE.tolerances["backlash"] * (mine & (plan.order < away)))
    return np.stack(columns, axis=1), np.stack(misfits, axis=1)


def test_the_covariance_is_that_of_the_formula() -> None:
    """Built up from its unknowns, with a comparison begun again half-way through leg y."""
    plan = timed_plan()
    fresh = np.where((np.arange(60) > 33) & (plan.leg == 1) & (plan.direction == 2), 34, 0)
    found = in_full(plan, fresh=fresh)
    columns, misfits = unknowns(plan, fresh)
    sigma2 = PROTOTYPE.gauge.noise_mm**2
    common = columns @ columns.T + sigma2 * np.eye(60)
    base = simulate(NOMINAL, np.zeros(3), plan)
    for factor, mean, spread in zip(SIZES, found.means, found.covariance, strict=True):
        size = factor * plausible_misfit_mm(PROTOTYPE)
        assert np.abs(spread - (common + size**2 * misfits @ misfits.T)).max() < 1e-6
        assert mean[:, 0] == pytest.approx(base, abs=1e-12)


@pytest.mark.parametrize("cause", [None, "axis_gap", "backlash", "thermal_drift"])
def test_known_causes_are_expected_where_and_when_they_act(cause: str | None) -> None:
    """The readings stand in any order, with their own zeros and times."""
    rng = np.random.default_rng(3)
    known = [CAUSES[cause]] if cause else []
    effects = [entry.at(np.linspace(-0.3, 0.4, entry.unknowns)) for entry in known]
    model, whole = NOMINAL.extended(effects), timed_plan()
    rows, order = rng.permutation(60)[:25], np.arange(25)
    setup, hours = rng.integers(0, 6, 25), np.sort(rng.uniform(0.0, 1.0, 25))
    plan = replace(whole.subset(rows), setup=setup, order=order, hours=hours)
    means = in_full(plan, model=model).means[0, :, 0]
    assert np.array_equal(means, simulate(model, np.zeros(3), plan))
    moved = np.abs(means - simulate(NOMINAL, np.zeros(3), plan)).max()
    assert (moved > 1e-3) == bool(cause)


def test_predictions_are_conditional_mixtures() -> None:
    """From the inverse of the whole covariance (precision matrix), and with scipy's densities."""
    model, values = an_example()
    past, new = np.array([0, 1, 2, 3, 4, 5, 6, 9, 12, 20, 22, 23]), 24
    found = model.given(values[past, None], past, np.array([new]))
    means, stds = found.means[:, 0, 0], found.std_by_explanation[:, 0, 0]
    likely = model.by_explanation(values[past, None], past)[:, 0]
    for size, spread in enumerate(model.covariance):
        rows = np.append(past, new)
        precision = np.linalg.inv(spread[np.ix_(rows, rows)])
        expected = -precision[-1, :-1] @ values[past] / precision[-1, -1]
        assert means[size] == pytest.approx(expected, abs=1e-5)
        assert stds[size] == pytest.approx(precision[-1, -1] ** -0.5, rel=1e-5)
        own = spread[np.ix_(past, past)]
        exact = stats.multivariate_normal(np.zeros(len(past)), own).logpdf(values[past])
        constant = -0.5 * len(past) * math.log(2.0 * math.pi)
        assert likely[size] + constant == pytest.approx(exact, abs=1e-5)
    mean = np.log(np.mean(np.exp(likely - likely.max()))) + likely.max()
    densities = model.log_weight + model.by_explanation(values[past, None], past)
    assert np.logaddexp.reduce(densities).item() == pytest.approx(mean)
    value, chances = found.mean + 0.04, np.exp(likely - likely.max())
    chances /= chances.sum()
    exact = np.sum(chances * 2.0 * stats.norm.sf(abs(value.item() - means) / stds))
    assert found.tail(value).item() == pytest.approx(exact)


@pytest.mark.parametrize("part", ["axis_gap", "axis_squareness", "bar_skew"])
def test_the_size_of_the_misfit_is_that_of_crooked_machines(part: str) -> None:
    """Root mean square of what 400 crooked machines do, of the posture furthest from iso.

    400 machines of three parameters or more: known to 2 %.
    """
    rng = np.random.default_rng(4)
    hidden = truth.standard_plan(truth.PROTOTYPE, rng, cycles=1)
    states, own, size = np.zeros((400, 30)), PARTS[part], truth.TOLERANCES[part]
    states[:, own] = rng.normal(0.0, size, (400, own.stop - own.start))
    heights = truth.signals(hidden, truth.PROTOTYPE, states)
    largest = np.sqrt(np.mean((heights - heights[:, hidden.stand]) ** 2, axis=0)).max()
    none = dict.fromkeys(("axis_gap", "axis_squareness", "bar_skew", "encoder_scale"), 1e-9)
    only = PROTOTYPE.changed(tolerances={**none, part: size})
    assert plausible_misfit_mm(only) == pytest.approx(float(largest), rel=0.06)


def test_a_machine_that_can_have_nothing_leaves_offsets_zeros_and_noise() -> None:
    sound = Model(PROTOTYPE.changed(tolerances=dict.fromkeys(CAUSES, 0.0)))
    plan, values = timed_plan(30), np.array(readings_of(steps_of()[:30], 4))
    found = in_full(plan, model=sound)
    assert np.all(found.covariance == found.covariance[0])
    prediction = found.given(values[:29, None], np.arange(29), np.array([29]))
    assert PROTOTYPE.gauge.noise_mm < prediction.std.item() < 2.0 * PROTOTYPE.gauge.noise_mm
    assert abs(prediction.mean.item() - values[29]) < 5.0 * prediction.std.item()
