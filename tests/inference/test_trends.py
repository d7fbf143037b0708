"""Trends over several dates against a library's densities; beliefs and decisions about them."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from orthoglide_cal.inference.belief import mixture, probabilities
from orthoglide_cal.inference.decision import state
from orthoglide_cal.inference.trends import SIZES, DatedValues, Part, Trend, TrendFit

FLAT = 1e3  # a prior of the parameters that says nothing


@pytest.fixture
def dated() -> DatedValues:
    """Four sessions of two parameters, with what the first three have in common."""
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(4, 2, 2)) + 2.0 * np.eye(2)
    common = [{"legs": rng.normal(size=(2, 1))} if k < 3 else {} for k in range(4)]
    values = rng.normal(size=(4, 2)) + np.array([5.0, -3.0])
    values[2:, 0] += 9.0
    times = np.array([0.0, 1.0, 3.0, 7.0])
    return DatedValues(values, roots @ roots.swapaxes(1, 2), common, times, [range(2)])


def library_density(data: DatedValues, parts: list[Part], scatter: np.ndarray) -> float:
    """ln p of all values, every unknown integrated out, by scipy."""
    count, width = data.values.shape
    blocks = [one + np.diag(scatter**2) for one in data.covariance]
    spread = np.zeros((count * width, count * width))
    for k, block in enumerate(blocks):
        spread[k * width : (k + 1) * width, k * width : (k + 1) * width] = block
    columns = [np.tile(FLAT * np.eye(width), (count, 1))]
    columns.append(np.concatenate([one.get("legs", np.zeros((width, 1))) for one in data.common]))
    for part in parts:
        course = (np.arange(count) > part.at).astype(float)
        if part.trend is Trend.DRIFTING:
            course = (data.times - data.times.mean()) / 7.0
        unit = np.diag(part.size * data.unit)[:, list(part.subset)]
        columns.append(np.kron(course[:, None], unit))
    spread += sum(column @ column.T for column in columns)
    return float(multivariate_normal.logpdf(data.values.ravel(), cov=spread))


def test_evidence_is_the_density_of_the_values(dated: DatedValues) -> None:
    """Against that of "unchanged": what all hypotheses share cancels."""
    hypotheses = [
        ([Part(Trend.CHANGED, 1, (0,), 4.0)], np.zeros(2)),
        ([Part(Trend.DRIFTING, 0, (0, 1), 2.0)], np.zeros(2)),
        ([], np.array([0.0, 3.0])),
        ([Part(Trend.CHANGED, 0, (1,), 1.0), Part(Trend.DRIFTING, 0, (0,), 8.0)], np.ones(2)),
    ]
    none = TrendFit(dated, [], np.zeros(2)).log_evidence
    still = library_density(dated, [], np.zeros(2))
    for parts, scatter in hypotheses:
        gain = TrendFit(dated, parts, scatter).log_evidence - none
        assert gain == pytest.approx(library_density(dated, parts, scatter) - still, abs=1e-3)


def test_one_more_step_is_the_mean_over_all_that_it_may_be(dated: DatedValues) -> None:
    fit = TrendFit(dated, [], np.zeros(2))
    every = [Part(Trend.CHANGED, *one) for one in product(range(3), dated.subsets, SIZES)]
    logs = [TrendFit(dated, [part], fit.scatter).log_evidence for part in every]
    log, best = fit.one_more(Trend.CHANGED)
    gain = np.logaddexp.reduce(logs) - np.log(len(every)) - fit.log_evidence
    assert log == pytest.approx(gain, abs=1e-6)
    assert best == every[int(np.argmax(logs))]
    assert (best.at, best.subset) == (1, (0,))


def test_a_mixture_has_the_moments_of_what_is_drawn_from_it() -> None:
    """200,000 draws: each moment within five of its standard deviations."""
    shares = probabilities({"few": np.log(1.0), "many": np.log(3.0)})
    assert [*shares] == ["many", "few"]
    assert [*shares.values()] == pytest.approx([0.75, 0.25])
    means = [np.array([1.0, -2.0]), np.array([3.0, 1.0])]
    spreads = [np.array([[2.0, 0.5], [0.5, 1.0]]), np.diag([0.3, 0.1])]
    mean, covariance = mixture([*shares.values()], means, spreads)
    rng = np.random.default_rng(11)
    first = rng.random(200_000) < shares["many"]
    drawn = [rng.multivariate_normal(*pair, 200_000) for pair in zip(means, spreads, strict=True)]
    draws = np.where(first[:, None], *drawn)
    assert draws.mean(axis=0) == pytest.approx(mean, abs=0.025)
    assert np.cov(draws.T) == pytest.approx(covariance, abs=0.05)


def test_a_statement_has_the_least_expected_loss() -> None:
    """Of nothing against something."""
    rng = np.random.default_rng(5)
    stated = set()
    for shares in rng.dirichlet([1.0, 0.5, 0.5, 0.2], 200).tolist():
        belief = dict(zip(("nothing", "a", "b", "c"), shares, strict=True))
        choice, _ = state(belief, "nothing", 150.0, 600.0)
        losses = {"nothing": 150.0 * (1.0 - belief["nothing"]), "else": 600.0 * belief["nothing"]}
        least = min(losses, key=losses.__getitem__)
        likeliest = max("abc", key=belief.__getitem__)
        assert choice == (likeliest if least == "else" else "nothing")
        stated.add(choice)
    assert stated == {*belief}
