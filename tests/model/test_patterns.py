"""Matrices that are not written out, against the same ones written out."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.inference.evidence import Places
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import (
    Contrasts,
    Patterns,
    zero_free,
)
from tests.machines import PROTOTYPE

RNG = np.random.default_rng(4)
# Rows in no order of time, set-ups of different length, one of a single reading.
SHUFFLED = double_posture(PROTOTYPE).subset(RNG.permutation(60)[:37])
PLAN = replace(SHUFFLED, setup=np.where(np.arange(37) == 11, 6, SHUFFLED.setup))
N = len(PLAN)
VALUES = RNG.normal(size=(N, 3))
STEPS = (PLAN.setup[:, None] == PLAN.setup) & (PLAN.order[:, None] >= PLAN.order)


@pytest.mark.parametrize("weighted", [False, True])
def test_contrasts_are_the_complement_of_the_zeros(weighted: bool) -> None:
    """Those of a complete factorisation: the same projector, and the same from either side."""
    zeros, _ = np.linalg.qr(PLAN.zeros)
    axes = np.linalg.qr(RNG.normal(size=(N - 7, 2)))[0] if weighted else None
    factors = np.array([0.3, 0.8]) if weighted else None
    precision = RNG.uniform(0.5, 2.0, N)
    contrasts = Contrasts(zeros, precision, axes=axes, factors=factors)
    assert contrasts.shape == (len(contrasts), N) == (N - 7, N)
    matrix = contrasts @ np.eye(N)
    assert np.abs(matrix @ (zeros / precision[:, None])).max() < 1e-12
    middle = np.eye(N - 7)
    if axes is not None and factors is not None:
        middle -= axes * (1.0 - factors) @ axes.T
    basis = np.linalg.solve(middle, matrix) / precision
    assert basis.T @ basis == pytest.approx(np.eye(N) - zeros @ zeros.T, abs=1e-12)
    data = RNG.normal(size=(2, N - 7, 4))
    assert contrasts.T @ data == pytest.approx(matrix.T @ data, abs=1e-12)
    assert data.swapaxes(1, 2) @ contrasts == pytest.approx(data.swapaxes(1, 2) @ matrix, abs=1e-12)
    assert pytest.approx(VALUES.T @ matrix.T, abs=1e-12) == VALUES.T @ contrasts.T
    assert contrasts @ VALUES[:, 0] == pytest.approx(matrix @ VALUES[:, 0], abs=1e-12)


def test_columns_of_many_places_are_those_written_out() -> None:
    reading = np.array([5, 0, 30, 5, 11])
    onward = np.array([True, False, True, False, True])
    other = RNG.normal(size=(N, 2))
    patterns = Patterns(PLAN, reading, onward, other)
    wanted = np.hstack((np.where(onward, STEPS[:, reading], np.eye(N)[:, reading]), other))
    assert np.all(wanted[:, :3:2].sum(axis=0) > 1)
    assert np.array_equal(patterns.columns(slice(None)), wanted)
    assert np.array_equal(patterns.columns(slice(4, 6)), wanted[:, 4:6])
    assert patterns.products(VALUES) == pytest.approx(wanted.T @ VALUES, abs=1e-12)
    matrix = zero_free(PLAN) @ np.eye(N)
    for reduction in (zero_free(PLAN), matrix):
        places = Places(reduction, patterns)
        assert places.power == pytest.approx(((matrix @ wanted) ** 2).sum(axis=0), abs=1e-12)
        assert places.column(2) == pytest.approx(matrix @ wanted[:, 2], abs=1e-12)
        data = RNG.normal(size=(len(matrix), 2))
        assert places.products(data) == pytest.approx(data.T @ matrix @ wanted, abs=1e-12)
