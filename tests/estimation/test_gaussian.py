"""Linear-Gaussian algebra that no other test sees alone: what is left, and a common size."""

import numpy as np
import pytest

from orthoglide_cal.estimation.gaussian import fit_size, unexplained


def test_what_free_unknowns_leave_has_nothing_of_them() -> None:
    rng = np.random.default_rng(5)
    columns, values = rng.normal(size=(7, 3)), rng.normal(size=(7, 2))
    left = unexplained(columns, values)
    np.testing.assert_allclose(columns.T @ left, 0.0, atol=1e-12)
    expected = np.linalg.lstsq(columns, values, rcond=None)[0]
    np.testing.assert_allclose(values - left, columns @ expected)


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
