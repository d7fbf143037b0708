"""What no other test sees alone: a common size, log odds, and a p value judged by losses."""

import math

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.estimation.gaussian import Mixture, fit_size
from orthoglide_cal.estimation.losses import is_likely, surprising


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


def test_log_odds_are_those_of_draws() -> None:
    """Mean and spread of 200,000 draws, met within five of their standard errors."""
    rng, count = np.random.default_rng(6), 200_000
    roots = rng.normal(size=(2, 2, 3, 3)) + 2.0 * np.eye(3)
    seen, judged = (
        Mixture(rng.normal(size=(2, 3, 1)), root @ root.swapaxes(-1, -2), np.zeros((2, 1)))
        for root in roots
    )
    mean, std = seen.log_odds(judged)
    for true, rival in ((0, 1), (1, 0)):
        drawn = rng.multivariate_normal(seen.means[true, :, 0], seen.covariance[true], count)
        logs = [
            stats.multivariate_normal(judged.means[k, :, 0], judged.covariance[k]).logpdf(drawn)
            for k in (true, rival)
        ]
        odds = logs[0] - logs[1]
        assert abs(odds.mean() - mean[true, rival]) < 5.0 * odds.std() / math.sqrt(count)
        assert std[true, rival] == pytest.approx(odds.std(), rel=0.02)


@pytest.mark.parametrize("odds", [0.01, 0.05, 0.2])
def test_to_state_nothing_costs_as_much_as_to_give_it_up(odds: float) -> None:
    """At the bound, with the most that a p value can say against its null hypothesis."""
    missed, needless = 75.0, 120.0
    p = surprising(odds, missed, needless)
    for share, given_up in ((0.99, True), (1.01, False)):
        against = float(odds / (-np.e * share * p * np.log(share * p)))
        assert is_likely(1.0 / (1.0 + against), missed, needless) is given_up
