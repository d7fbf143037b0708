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
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid, log_sum, log_sums
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
    sizes = np.array(SIZES)
    found = []
    for what, pattern in _patterns(frame):
        white = frame.matrix @ pattern * stated
        columns = np.stack([np.hstack([offsets, white * size]) for size in sizes])
        logs = _log_evidence(Gaussian(columns, noise), residual, noise)
        size = sizes[np.argmax(logs)]
        found.append(Unlisted(what, _mean(logs), white * size, stated))
    factors = np.array(NOISIER)
    wider = NoiseGrid(
        np.outer(factors, noise.sigma).reshape(-1), np.tile(noise.log_weight, len(factors))
    )
    logs = _log_evidence(Gaussian(offsets, wider), residual, wider, len(factors))
    what = "every reading scatters more than the gauge's stated noise"
    noisier = stated * float(factors[np.argmax(logs)])
    found.append(Unlisted(what, _mean(logs), np.zeros((len(frame), 0)), noisier))
    return found


def _mean(logs: Floats) -> float:
    return log_sum(logs) - math.log(len(logs))


def _log_evidence(density: Gaussian, residual: Floats, noise: NoiseGrid, grids: int = 1) -> Floats:
    """Of each B, or of each of several grids of σ one after the other, shape (b,)."""
    log = density.log_density(residual[:, None])[..., 0] + noise.log_weight
    return log_sums(log.reshape(-1, log.shape[-1] // grids), 1)


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
