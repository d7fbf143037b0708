"""Causes of which often one parameter acts alone: one bar is skewed, the other five are not.

Priced for all its parameters such a cause loses to one with fewer; so its evidence is the mean over
both readings of its name. Beside another fault only the first is tried, which is a lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import Cause
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid, log_sum, log_sums

# Share of the cases in which all parameters act.
ALL = 0.5
LOG_ALL = math.log(ALL)


def with_single(
    together: Sequence[tuple[Cause, Floats, float]],
    others: Floats,
    residual: Floats,
    noise: NoiseGrid,
) -> list[float]:
    """Log evidence of causes of which all parameters act, or any one of them.

    Args:
        together: each cause, its columns scaled by their plausible sizes, shape (k, p) [mm], and
            its log evidence if all its parameters act.
        others: scaled columns of offsets and doubts, shape (k, r) [mm].
        residual: data minus the model without the cause, shape (k,) [mm].
        noise: the grid.
    """
    counts = [len(cause.names) for cause, _, _ in together]
    always = others.shape[1]
    width = always + 1 + max(len(cause.nuisance) for cause, _, _ in together)
    columns = np.zeros((sum(counts), len(residual), width))
    columns[:, :, :always] = others
    row = 0
    for cause, own, _ in together:
        count = len(cause.names)
        columns[row : row + count, :, always] = own[:, :count].T
        columns[row : row + count, :, always + 1 : always + 1 + len(cause.nuisance)] = own[
            :, count:
        ]
        row += count
    density = Gaussian(columns, noise).log_density(residual[:, None])[..., 0]
    each = np.split(log_sums(density + noise.log_weight, 1), np.cumsum(counts)[:-1])
    return [
        float(np.logaddexp(log_all + LOG_ALL, log_sum(logs) + math.log((1.0 - ALL) / logs.size)))
        for (_, _, log_all), logs in zip(together, each, strict=True)
    ]
