"""How fast the offsets of a machine drift, and when it is due to be adjusted again.

The total offsets of n sessions are fitted with one straight line per axis,

    total(t) = level + rate · t

each session weighted by the covariance of what is new in it: its readings and the places of its
gauges. What is the same in all sessions, as the lengths of the legs, moves the level and no rate.
What is due is told by what a gauge would read: the
line says which offsets the controller will miss, the model what differences they make.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.estimation.accuracy import chance_of_residual, half_width
from orthoglide_cal.model import (
    DIFFERENCES,
    DataKind,
    Floats,
    Model,
    ReadOnly,
    ideal_plan,
    reduction,
    simulate_with_jacobian,
)

DAY = 86400.0
MONTH = 365.25 * DAY / 12.0
# A line through less time than this says nothing of months.
SHORTEST_DAYS = 7.0
# Nobody plans further ahead than this, nor is a line worth more.
FARTHEST_DAYS = 5 * 365
# Below this chance the sessions scatter about the line by more than their own uncertainty.
SCATTERED = 0.01


@dataclass(frozen=True, eq=False)
class Trend(ReadOnly):
    """Straight lines through the total offsets of one machine.

    Attributes:
        start: moment from which the time of the lines counts [s].
        level_mm: totals at that moment, shape (3,).
        rate_mm: change in a month, shape (3,).
        covariance: of the three levels, then the three rates, by what is new in each session,
            shape (6, 6) [mm²].
        k: coverage factor; Student's t where the scatter about the lines had to be estimated.
    """

    start: float
    level_mm: Floats
    rate_mm: Floats
    covariance: Floats
    k: float

    @property
    def expanded_mm(self) -> Floats:
        """Expanded uncertainty of the rates, shape (3,) [mm in a month]."""
        return np.asarray(self.k * np.sqrt(np.diag(self.covariance)[3:]))

    @property
    def drifts(self) -> tuple[bool, ...]:
        """Axes whose rate is larger than its expanded uncertainty."""
        return tuple((np.abs(self.rate_mm) > self.expanded_mm).tolist())

    def at(self, moments: Floats) -> tuple[Floats, Floats]:
        """Total offsets at some moments [s], shape (m, 3) [mm], and covariances (m, 3, 3)."""
        months = (np.asarray(moments) - self.start) / MONTH
        slope = _slope(months)
        theta = np.concatenate((self.level_mm, self.rate_mm))
        return slope @ theta, slope @ self.covariance @ slope.transpose(0, 2, 1)

    def due(self, model: Model, since: float, limit_mm: float) -> float | None:
        """First moment at which a difference max − min may be beyond a limit [s].

        That is |difference| + U, as `verify` decides; the differences are those that the offsets
        make which the controller lacks, on this machine with all its accepted causes.

        Args:
            model: the machine with the offsets that are active now.
            since: the last session; the answer is not before it [s].
            limit_mm: largest size of a difference that is allowed.

        Returns:
            None if that is further away than anybody plans.
        """
        moments = np.linspace(since, since + FARTHEST_DAYS * DAY, FARTHEST_DAYS + 1)
        total, covariance = self.at(moments)
        plan = ideal_plan(DataKind.SIX, model.machine)
        which = reduction(DataKind.SIX, DIFFERENCES[DataKind.SIX], model.machine, plan)
        left = total - np.array(model.machine.offsets_mm)
        readings, jacobian = simulate_with_jacobian(model, left, plan)
        healthy, _ = simulate_with_jacobian(model, np.zeros(3), plan)
        slope = which @ jacobian
        reach = self.k * np.sqrt(np.einsum("mdi,mij,mdj->md", slope, covariance, slope))
        beyond = np.abs((readings - healthy) @ which.T) + reach > limit_mm
        days = np.flatnonzero(beyond.any(axis=-1))
        return float(moments[days[0]]) if days.size else None


def trend(moments: Sequence[float], total_mm: Floats, covariances_mm2: Floats) -> Trend | None:
    """Lines through the sessions of one machine; None where there is too little time between.

    Args:
        moments: of n sessions, ascending [s].
        total_mm: active plus found offsets, shape (n, 3).
        covariances_mm2: of what is new in each session's totals, shape (n, 3, 3).
    """
    if (moments[-1] - moments[0]) / DAY < SHORTEST_DAYS:
        return None
    slope = _slope((np.array(moments) - moments[-1]) / MONTH)
    weights = np.linalg.inv(np.linalg.cholesky(covariances_mm2))
    design = (weights @ slope).reshape(-1, 6)
    data = (weights @ total_mm[..., None]).reshape(-1)
    covariance = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
    theta = covariance @ (design.T @ data)
    left, dof = float(((data - design @ theta) ** 2).sum()), data.size - 6
    k = half_width(np.inf)
    if chance_of_residual(left, dof, 1.0) < SCATTERED:
        covariance, k = covariance * left / dof, half_width(dof)
    return Trend(moments[-1], theta[:3], theta[3:], covariance, k)


def _slope(months: Floats) -> Floats:
    """d total / d (level, rate) at some times, shape (m, 3, 6)."""
    one = np.broadcast_to(np.eye(3), (len(months), 3, 3))
    return np.concatenate((one, months[:, None, None] * one), axis=-1)
