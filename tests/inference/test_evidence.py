"""Evidence against dense covariances, also of data that share a local shape."""

import numpy as np
import pytest

from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid, Texture


@pytest.mark.parametrize("shape", [(9, 4), (6, 6), (5, 11)], ids=str)
def test_densities_are_those_of_the_dense_covariance(shape: tuple[int, int]) -> None:
    """Fewer, as many and more columns than data, one column twice another, sizes far apart."""
    rng, grid = np.random.default_rng(1), NoiseGrid.around(0.004)
    columns, sizes = rng.normal(size=shape), 10.0 ** rng.uniform(-3.0, 1.0, (1, shape[1]))
    columns[:, 1] = 2.0 * columns[:, 0]
    vectors, residual = rng.normal(0.0, 0.01, (shape[0], 3)), rng.normal(0.0, 0.02, shape[0])
    density = Gaussian(columns, sizes, grid)
    (power,), (match,) = density.against(density.overlap(vectors, residual), residual)
    (logs,) = density.log_density(vectors)
    for g, sigma in enumerate(grid.sigma):
        covariance = sigma**2 * np.eye(shape[0]) + (columns * sizes**2) @ columns.T
        inverse, log_det = np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]
        quadratic = np.einsum("kq,kl,lq->q", vectors, inverse, vectors)
        assert power[g] == pytest.approx(quadratic, rel=1e-6)
        assert match[g] == pytest.approx(vectors.T @ inverse @ residual, rel=1e-5)
        expected = grid.log_weight[g] - 0.5 * (quadratic + log_det)
        assert logs[g] == pytest.approx(expected, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("known", [9, 4])
def test_a_shared_shape_is_a_dense_covariance(known: int) -> None:
    """Evidence, and how patterns weigh and match, with every covariance written out.

    Along some axes it has variances of their own, in all other directions the same one.
    """
    rng = np.random.default_rng(8)
    columns, residual = rng.normal(size=(2, 9, 4)), rng.normal(scale=0.02, size=9)
    patterns = rng.normal(size=(9, 3))
    sizes = np.array([[1.0, 1.0, 0.1, 0.1], [1.0, 1.0, 0.8, 0.8]])
    shares = np.log([0.4, 0.6])
    axes = np.linalg.qr(rng.normal(size=(9, known)))[0]
    spectrum, rest = rng.uniform(0.0, 0.001, size=known), 2e-4
    shape = rest * np.eye(9) + axes * (spectrum - rest) @ axes.T
    grid = NoiseGrid.around(0.01, Texture(axes, spectrum, rest, assumed=False))
    density = Gaussian(columns, sizes, grid, shares)
    log, overlap = density.by_noise(residual), density.overlap(patterns, residual)
    power, match = density.against(overlap, residual)
    assert log.shape == (2, 2, grid.sigma.size)
    for b, s, g in np.ndindex(log.shape):
        scaled = columns[b] * sizes[s]
        own = grid.sigma[g] ** 2 * np.eye(9) + grid.scale_factor[g] ** 2 * shape
        inverse = np.linalg.inv(own + scaled @ scaled.T)
        log_det = -np.linalg.slogdet(inverse)[1]
        wanted = shares[s] + grid.log_weight[g] - 0.5 * (residual @ inverse @ residual + log_det)
        assert log[b, s, g] == pytest.approx(wanted, rel=1e-9)
        assert power[b, s, g] == pytest.approx(np.diag(patterns.T @ inverse @ patterns), rel=1e-7)
        assert match[b, s, g] == pytest.approx(patterns.T @ inverse @ residual, rel=1e-7)
