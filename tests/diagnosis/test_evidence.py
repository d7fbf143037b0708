"""Evidence: closed forms against dense covariances and quadrature."""

import numpy as np
import pytest

from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid
from orthoglide_cal.model.plan import Floats

GRID = NoiseGrid.around(0.004)


def dense(columns: Floats, sigma: float, residuals: Floats) -> Floats:
    """ln N(r; 0, σ² I + B Bᵀ) without −k/2 ln 2π, of residuals (k,) or (k, p)."""
    covariance = sigma**2 * np.eye(len(residuals)) + columns @ columns.T
    square = (residuals * np.linalg.solve(covariance, residuals)).sum(axis=0)
    return np.asarray(-0.5 * (square + np.linalg.slogdet(covariance)[1]))


@pytest.mark.parametrize("shape", [(9, 4), (6, 6), (5, 11)], ids=str)
def test_densities_are_those_of_the_dense_covariance(shape: tuple[int, int]) -> None:
    """Fewer, as many and more columns than data, one column twice another, sizes far apart."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=shape) * 10.0 ** rng.uniform(-3.0, 1.0, shape[1])
    columns[:, 1] = 2.0 * columns[:, 0]
    vectors, residual = rng.normal(0.0, 0.01, (shape[0], 3)), rng.normal(0.0, 0.02, shape[0])
    density = Gaussian(columns, GRID)
    for g, sigma in enumerate(GRID.sigma):
        inverse = np.linalg.inv(sigma**2 * np.eye(shape[0]) + columns @ columns.T)
        quadratic = np.einsum("kq,kl,lq->q", vectors, inverse, vectors)
        product = vectors.T @ inverse @ residual
        power, match = density.against(vectors, residual)
        assert power[g] == pytest.approx(quadratic, rel=1e-6)
        assert match[g] == pytest.approx(product, rel=1e-5)
        logs = GRID.log_weight[g] + dense(columns, float(sigma), vectors)
        assert density.log_density(vectors)[g] == pytest.approx(logs, rel=1e-6, abs=1e-5)
        assert density.by_noise(vectors[:, 1])[g] == pytest.approx(logs[1], rel=1e-6, abs=1e-5)


def test_the_noise_is_weighed_around_what_is_stated() -> None:
    grid = NoiseGrid.around(0.0067)
    assert np.exp(grid.log_weight).sum() == pytest.approx(1.0)
    assert grid.sigma.min() < 0.6 * 0.0067
    assert grid.sigma.max() > 1.5 * 0.0067
    mean = np.exp(grid.log_weight) @ grid.sigma
    assert mean == pytest.approx(0.0067, rel=0.05)
    assert grid.stated == pytest.approx(0.0067)


def test_a_shared_shape_is_a_dense_covariance() -> None:
    """Evidence, and how patterns weigh and match, with every covariance written out."""
    rng = np.random.default_rng(8)
    columns, residual = rng.normal(size=(2, 9, 4)), rng.normal(scale=0.02, size=9)
    patterns = rng.normal(size=(9, 3))
    sizes = np.array([[1.0, 1.0, 0.1, 0.1], [1.0, 1.0, 0.8, 0.8]])
    shares = np.log([0.4, 0.6])
    grid = NoiseGrid.around(0.01, rng.uniform(0.0, 0.001, size=9))
    assert grid.spectrum is not None
    assert grid.scale_factor is not None
    density = grid.density(columns, sizes, shares)
    log, (power, match) = density.by_noise(residual), density.against(patterns, residual)
    assert log.shape == (2, 2, grid.sigma.size)
    for b, s, g in np.ndindex(log.shape):
        scaled = columns[b] * sizes[s]
        own = grid.sigma[g] ** 2 + grid.scale_factor[g] ** 2 * grid.spectrum
        inverse = np.linalg.inv(np.diag(own) + scaled @ scaled.T)
        log_det = -np.linalg.slogdet(inverse)[1]
        wanted = shares[s] + grid.log_weight[g] - 0.5 * (residual @ inverse @ residual + log_det)
        assert log[b, s, g] == pytest.approx(wanted, rel=1e-9)
        assert power[b, s, g] == pytest.approx(np.diag(patterns.T @ inverse @ patterns), rel=1e-7)
        assert match[b, s, g] == pytest.approx(patterns.T @ inverse @ residual, rel=1e-7)
