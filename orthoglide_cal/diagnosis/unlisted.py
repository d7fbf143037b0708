"""Explanations by nothing on the list: patterns too general for any one cause.

They compete with the listed causes on equal terms. Where one of them wins, the data hold
something real that no listed cause explains, and its size goes into the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.causes.stand_shift import onwards
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid, log_sum
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.screen import OFFSETS_MM

# Sizes at which each pattern is tried, in standard deviations of one reading.
SIZES = (5.0, 30.0)
NOISIER = (2.0, 4.0, 8.0)


@dataclass(frozen=True, eq=False)
class Unlisted:
    """One unlisted pattern.

    Attributes:
        what: description.
        log_evidence: averaged over its sizes.
        columns: at its likeliest size, whitened, shape (k, q) [mm].
        sigma: standard deviation of one reading at its likeliest size [mm].
    """

    what: str
    log_evidence: float
    columns: Floats
    sigma: float


def unlisted_patterns(
    frame: Frame, slope: Floats, doubt: Floats, residual: Floats, noise: NoiseGrid
) -> list[Unlisted]:
    """Judge every unlisted pattern.

    Args:
        frame: the data.
        slope: derivative of the data by the offsets where `residual` was taken, (k, 3).
        doubt: what the uncertainty of accepted causes adds to the data, (k, p) [mm].
        residual: of the offsets-only fit, (k,) [mm].
        noise: grid of σ around the stated one.
    """
    stated = float(noise.sigma[np.argmax(noise.log_weight)])
    offsets = np.hstack([slope * OFFSETS_MM, doubt])
    found = []
    for what, pattern in _patterns(frame):
        white = frame.matrix @ pattern * stated
        logs = [
            _log_evidence(np.hstack([offsets, white * size]), residual, noise) for size in SIZES
        ]
        size = SIZES[int(np.argmax(logs))]
        found.append(Unlisted(what, _mean(logs), white * size, stated))
    logs = [
        _log_evidence(offsets, residual, NoiseGrid(noise.sigma * factor, noise.log_weight))
        for factor in NOISIER
    ]
    factor = NOISIER[int(np.argmax(logs))]
    what = "every reading scatters more than the gauge's stated noise"
    found.append(Unlisted(what, _mean(logs), np.zeros((len(frame), 0)), stated * factor))
    return found


def _mean(logs: list[float]) -> float:
    return log_sum(np.array(logs)) - math.log(len(logs))


def _log_evidence(columns: Floats, residual: Floats, noise: NoiseGrid) -> float:
    log = Gaussian(columns, noise).log_density(residual[:, None])[:, 0]
    return log_sum(noise.log_weight + log)


def _patterns(frame: Frame) -> Iterator[tuple[str, Floats]]:
    """Name and columns (n, q) of unit size."""
    plan = frame.plan
    repeatable = plan.cells[:, None] == np.arange(plan.cells.max() + 1)
    yield "the same deviation whenever a posture returns", repeatable.astype(np.float64)
    if not frame.timed:
        return
    same = onwards(plan)
    yield "readings that wander with time", same / np.sqrt(same.sum(axis=0).max())
    for leg in np.unique(plan.leg):
        own = np.flatnonzero(plan.leg == leg)
        yield f"more scatter on leg {AXES[leg]}", np.eye(len(plan))[:, own]
