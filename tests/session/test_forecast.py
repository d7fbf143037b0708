"""The prediction of the next reading against independent calculations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.data import default_machine
from orthoglide_cal.estimation.forecast import Forecast, forecast, misfit_mm
from orthoglide_cal.kinematics import Geometry
from orthoglide_cal.session.steps import plan_of
from orthoglide_cal.simulation import simulate

from .virtual import readings_of, steps_of

MACHINE = default_machine()


def an_example() -> tuple[Forecast, np.ndarray]:
    steps = steps_of()[:30]
    plan = plan_of(steps, [0.3 * k + 5.0 * s.setup for k, s in enumerate(steps)])
    return forecast(MACHINE, plan), np.array(readings_of(steps, 4))


def covariance(model: Forecast, size: int) -> np.ndarray:
    return (
        model.design @ model.design.T
        + model.misfits[size] ** 2 * model.cells @ model.cells.T
        + model.sigma_mm**2 * np.eye(len(model.design))
    )


def test_predictions_are_conditional_normal_distributions() -> None:
    """From the inverse of the whole covariance (precision matrix) instead of a solve."""
    model, values = an_example()
    past, new = np.array([0, 1, 2, 3, 4, 5, 6, 9, 12, 20, 22, 23]), 24
    found = model.predict(values[past], past, new)
    for size in range(len(model.misfits)):
        rows = np.append(past, new)
        precision = np.linalg.inv(covariance(model, size)[np.ix_(rows, rows)])
        expected = -precision[-1, :-1] @ values[past] / precision[-1, -1]
        assert found.means[size] == pytest.approx(expected, abs=1e-5)
        assert found.stds[size] == pytest.approx(precision[-1, -1] ** -0.5, rel=1e-5)


def test_likelihoods_are_those_of_scipy() -> None:
    model, values = an_example()
    rows = np.arange(2, 25)
    found = model.log_likelihoods(values[rows], rows)
    for size in range(len(model.misfits)):
        matrix = covariance(model, size)[np.ix_(rows, rows)]
        exact = stats.multivariate_normal(np.zeros(len(rows)), matrix).logpdf(values[rows])
        constant = -0.5 * len(rows) * math.log(2.0 * math.pi)
        assert found[size] + constant == pytest.approx(exact, abs=1e-5)
    mean = np.log(np.mean(np.exp(found - found.max()))) + found.max()
    assert model.log_likelihood(values[rows], rows) == pytest.approx(mean)


def test_batches_are_the_same_as_one_by_one() -> None:
    model, values = an_example()
    past, new = np.arange(12), 13
    many = np.stack((values, values[::-1], 2.0 * values))
    together = model.predict(many[:, past], past, new)
    for index, one in enumerate(many):
        alone = model.predict(one[past], past, new)
        assert together.mean[index] == pytest.approx(float(alone.mean))
        assert together.std[index] == pytest.approx(float(alone.std))
        assert together.tail(np.full(3, 0.3))[index] == pytest.approx(float(alone.tail(0.3)))


def test_the_tail_is_that_of_a_mixture() -> None:
    model, values = an_example()
    past = np.arange(24)
    found = model.predict(values[past], past, 25)
    value = float(found.mean) + 0.04
    exact = sum(
        chance * 2.0 * stats.norm.sf(abs(value - mean) / std)
        for chance, mean, std in zip(found.chances, found.means, found.stds, strict=True)
    )
    assert found.tail(value) == pytest.approx(exact)
    assert found.chances.sum() == pytest.approx(1.0)


def test_readings_teach_how_large_the_misfit_is() -> None:
    """Ideal readings make the small sizes likely, readings with random cells the large ones."""
    steps = steps_of()
    plan = plan_of(steps)
    model = forecast(MACHINE, plan)
    rng = np.random.default_rng(2)
    ideal = simulate(MACHINE, np.array([0.4, -0.7, 0.2]), plan)
    noisy = ideal + rng.normal(0.0, MACHINE.gauge.noise_mm, 60)
    cells = {step.cell: rng.normal(0.0, 0.3) for step in steps}
    skewed = noisy + np.array([cells[step.cell] for step in steps])
    rows = np.arange(60)
    assert np.argmax(model.log_likelihoods(noisy, rows)) <= 1
    assert np.argmax(model.log_likelihoods(skewed, rows)) >= 3


@pytest.mark.parametrize("part", ["axis_gap", "axis_squareness"])
def test_the_size_of_the_misfit_is_that_of_crooked_machines(part: str) -> None:
    """Root mean square of what 400 crooked machines do to max and min against iso."""
    rng = np.random.default_rng(4)
    tolerance = {"axis_gap": 0.3, "axis_squareness": 1.0}[part]
    draws = rng.normal(0.0, tolerance, (400, 3))
    points, lean = np.zeros((400, 3, 3)), np.broadcast_to(np.eye(3), (400, 3, 3)).copy()
    for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        if part == "axis_gap":
            other = 3 - i - j
            points[:, i, other] += draws[:, k] / 2.0
            points[:, j, other] -= draws[:, k] / 2.0
        else:
            lean[:, i, j] += 1e-3 * draws[:, k] / 2.0
            lean[:, j, i] += 1e-3 * draws[:, k] / 2.0
    lean /= np.linalg.norm(lean, axis=-1, keepdims=True)
    geometry = Geometry(points, lean, np.full((400, 3), MACHINE.leg_length_mm))
    steps = steps_of(cycles=1)
    heights = simulate(MACHINE, np.zeros((400, 3)), plan_of(steps), geometry=geometry)
    iso = {step.series: step.number - 1 for step in reversed(steps) if step.posture == "iso"}
    moved = [step for step in steps if step.posture != "iso"]
    change = np.stack([heights[:, s.number - 1] - heights[:, iso[s.series]] for s in moved], axis=1)
    none = dict.fromkeys(("axis_gap", "axis_squareness", "bar_skew", "encoder_scale"), 1e-09)
    only = replace(MACHINE, tolerances={**none, part: tolerance})
    assert 0.5 < float(np.sqrt(np.mean(change**2))) / misfit_mm(only) < 1.5
