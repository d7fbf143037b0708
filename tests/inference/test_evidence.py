"""Evidence against dense covariances, also of data that share a local shape."""

import numpy as np
import pytest

from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid, Texture


@pytest.mark.parametrize(("known", "width"), [(9, 4), (4, 4), (4, 9), (4, 12)])
def test_densities_are_those_of_the_dense_covariance(known: int, width: int) -> None:
    """Evidence, and how patterns weigh and match, with every covariance written out.

    Fewer, as many and more columns than data, one twice another, sizes far apart. Along some axes
    the shared shape has variances of their own, in all other directions the same one.
    """
    rng = np.random.default_rng(8)
    columns, residual = rng.normal(size=(2, 9, width)), rng.normal(scale=0.02, size=9)
    columns[:, :, 1] = 2.0 * columns[:, :, 0]
    patterns = rng.normal(size=(9, 3))
    sizes = 10.0 ** rng.uniform(-3.0, 1.0, (2, width))
    shares = np.log([0.4, 0.6])
    axes = np.linalg.qr(rng.normal(size=(9, known)))[0]
    spectrum, rest = rng.uniform(0.0, 0.001, size=known), 2e-4
    shape = rest * np.eye(9) + axes * (spectrum - rest) @ axes.T
    grid = NoiseGrid.around(0.01, Texture(axes, spectrum, rest, assumed=False))
    density = Gaussian(columns, sizes, grid, shares)
    log, overlap = density.by_noise(residual), density.overlap(patterns, residual)
    power, match = density.against(overlap, residual)
    each = density.log_density(patterns)
    assert log.shape == (2, 2, grid.sigma.size)
    for b, s, g in np.ndindex(log.shape):
        scaled = columns[b] * sizes[s]
        own = grid.sigma[g] ** 2 * np.eye(9) + grid.scale_factor[g] ** 2 * shape
        inverse = np.linalg.inv(own + scaled @ scaled.T)
        log_det = -np.linalg.slogdet(inverse)[1]
        weight = shares[s] + grid.log_weight[g]
        wanted = weight - 0.5 * (residual @ inverse @ residual + log_det)
        power_of = np.diag(patterns.T @ inverse @ patterns)
        assert each[b, s, g] == pytest.approx(weight - 0.5 * (power_of + log_det), rel=1e-6)
        assert log[b, s, g] == pytest.approx(wanted, rel=1e-9)
        assert power[b, s, g] == pytest.approx(power_of, rel=1e-7)
        assert match[b, s, g] == pytest.approx(patterns.T @ inverse @ residual, rel=1e-7)
