"""As found in a few numbers, and how much of the residuals is explained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.diagnosis.result import Diagnosis
from orthoglide_cal.estimation import Solution


@dataclass(frozen=True)
class Deviations:
    """Size of a set of differences [mm].

    Attributes:
        rms_mm: root mean square.
        largest_mm: largest, with its sign.
        largest: its name.
    """

    rms_mm: float
    largest_mm: float
    largest: str

    @classmethod
    def of(cls, values: dict[str, float]) -> Deviations | None:
        """None without values."""
        if not values:
            return None
        largest = max(values, key=lambda name: abs(values[name]))
        rms = float(np.sqrt(np.mean(np.square(list(values.values())))))
        return cls(rms, values[largest], largest)


def as_found(solution: Solution) -> Deviations | None:
    """The measured differences of the expected-improvement table."""
    return Deviations.of({row.difference: row.measured_mm for row in solution.table})


def as_expected(solution: Solution) -> Deviations | None:
    """What should remain of them after the adjustment."""
    return Deviations.of({row.difference: row.expected_mm for row in solution.table})


@dataclass(frozen=True, eq=False)
class Explained:
    """What a diagnosis explains of the residuals of the offsets-only model.

    Attributes:
        before_mm, after_mm: residuals without and with the cause, in order of time, shape (n,).
        leg: of each, shape (n,).
        rms_before_mm, rms_after_mm: of those.
        by_cause, noise, unexplained: shares of the sum of squares before; they sum to 1.
    """

    before_mm: Floats
    after_mm: Floats
    leg: Ints
    rms_before_mm: float
    rms_after_mm: float
    by_cause: float
    noise: float
    unexplained: float


def explained(diagnosis: Diagnosis, leg: Ints, order: Ints) -> Explained:
    """Split the residuals' sum of squares.

    Args:
        diagnosis: gives the residuals.
        leg: of each reading, shape (n,).
        order: rank of each in time, from 1, shape (n,).
    """
    in_time = np.argsort(order)
    before = (diagnosis.measured_mm - diagnosis.nominal_mm)[in_time]
    after = (diagnosis.measured_mm - diagnosis.explained_mm)[in_time]
    total, left = float(before @ before), float(after @ after)
    expected = diagnosis.lack_of_fit.dof * diagnosis.lack_of_fit.noise_mm**2
    by_cause = max(1.0 - left / total, 0.0) if total else 0.0
    noise = min(expected / total, 1.0 - by_cause) if total else 1.0
    return Explained(
        before_mm=before,
        after_mm=after,
        leg=leg[in_time],
        rms_before_mm=float(np.sqrt(np.mean(before**2))),
        rms_after_mm=float(np.sqrt(np.mean(after**2))),
        by_cause=by_cause,
        noise=noise,
        unexplained=max(1.0 - by_cause - noise, 0.0),
    )
