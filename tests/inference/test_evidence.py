"""Evidence of data that share a local shape against dense covariances."""

import numpy as np
import pytest

from orthoglide_cal.inference.evidence import NoiseGrid, Texture


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
    assert grid.scale_factor is not None
    density = grid.density(columns, sizes, shares)
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
