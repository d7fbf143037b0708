"""Linear-Gaussian algebra against scipy's densities and against the joint normal of everything."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from orthoglide_cal.estimation.gaussian import (
    condition,
    fit_size,
    log_density,
    predict,
    unexplained,
)
from orthoglide_cal.model.plan import Floats

RNG = np.random.default_rng(5)
COLUMNS, SIZES, SIGMA = RNG.standard_normal((7, 3)), np.array([0.4, 2.0, 30.0]), 0.3


def covariances(*shape: int, k: int = 7) -> Floats:
    root = RNG.standard_normal((*shape, k, k))
    return np.asarray(root @ root.swapaxes(-1, -2) + 0.1 * np.eye(k))


def test_densities_are_those_of_scipy_but_for_the_constant() -> None:
    covariance, residuals = covariances(2, 3), RNG.standard_normal((7, 5))
    found = log_density(covariance, residuals) - 3.5 * np.log(2.0 * np.pi)
    for at in np.ndindex(2, 3):
        expected = multivariate_normal(np.zeros(7), covariance[at]).logpdf(residuals.T)
        np.testing.assert_allclose(found[at], expected, rtol=1e-10)


def test_conditioning_and_predicting_agree_on_the_unknowns() -> None:
    """Their mean and covariance given the data: of the one by precisions, of the other by S."""
    data, prior = RNG.standard_normal(7), np.diag(SIZES**2)
    mean, covariance = condition(COLUMNS, data, SIZES, SIGMA)
    shared = COLUMNS @ prior
    given = shared @ COLUMNS.T + SIGMA**2 * np.eye(7)
    several = np.stack([3.0 * given, given])
    means, covariances = predict(several, data[:, None], shared, prior)
    np.testing.assert_allclose(means[1, :, 0], mean)
    np.testing.assert_allclose(covariances[1], covariance, atol=1e-12)


def test_what_free_unknowns_leave_has_nothing_of_them() -> None:
    values = RNG.standard_normal((7, 2))
    left = unexplained(COLUMNS, values)
    np.testing.assert_allclose(COLUMNS.T @ left, 0.0, atol=1e-12)
    expected = np.linalg.lstsq(COLUMNS, values, rcond=None)[0]
    np.testing.assert_allclose(values - left, COLUMNS @ expected)


def test_a_size_that_few_data_tell_counts_what_they_leave_open() -> None:
    """Round by round as in a fit of all unknowns: their posterior variance is part of the size."""
    rng = np.random.default_rng(8)
    columns, sigma, chosen = rng.normal(size=(9, 7)), 0.8, np.arange(3, 7)
    sizes = np.array([np.inf, 2.0, 0.5, 1.0, 1.0, 1.0, 1.0])
    data = columns @ np.array([3.0, -1.0, 0.2, 2.5, -1.8, 0.4, 3.1]) + sigma * rng.normal(size=9)
    size, before = 1.0, 0.0
    while abs(size / before - 1.0 if before else 1.0) >= 0.02:
        precision = columns.T @ columns / sigma**2
        precision += np.diag(1.0 / np.where(np.arange(7) < 3, sizes, size) ** 2)
        mean = np.linalg.solve(precision, columns.T @ data / sigma**2)
        left = np.diag(np.linalg.inv(precision))
        before, size = size, float(np.sqrt(np.mean((mean**2 + left)[chosen])))
    assert fit_size(columns, data, sizes, sigma, chosen) == pytest.approx(size, rel=1e-9)
