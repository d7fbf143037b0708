"""What the fit leaves of each reading, and how much of that is explained; for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.model import (
    Contact,
    Differences,
    Floats,
    GaugePlan,
    Ints,
    Measured,
    ReadOnly,
    Series,
    View,
)


@dataclass(frozen=True, eq=False)
class Residuals(ReadOnly):
    """Measured and predicted readings (or differences) without the arbitrary gauge zeros.

    Attributes:
        series: leg and direction of each, n entries.
        label: posture, or the name of the difference.
        end: "joint" or "tool" for the single-posture protocol, else None.
        displacement_mm: of the leg's carriage, shape (n,); NaN for differences.
        cycle: repeat, from 1, shape (n,).
        order: rank in time, from 1, shape (n,).
        measured_mm: relative to the prediction at the isotropic posture of the same set-up, (n,).
        predicted_mm: likewise, shape (n,).
    """

    series: tuple[Series, ...]
    label: tuple[str, ...]
    end: tuple[str | None, ...]
    displacement_mm: Floats
    cycle: Ints
    order: Ints
    measured_mm: Floats
    predicted_mm: Floats

    @property
    def leg(self) -> Ints:
        """0, 1, 2, shape (n,)."""
        return np.array([series.leg for series in self.series], dtype=np.intp)

    @property
    def residual_mm(self) -> Floats:
        """measured − predicted, shape (n,)."""
        return self.measured_mm - self.predicted_mm

    def rms_by_series(self) -> dict[Series, float]:
        """Root mean square residual of each leg and direction [mm], legs in order."""
        return {
            series: rms(self.residual_mm[[each == series for each in self.series]])
            for series in sorted(set(self.series))
        }


def residuals(measured: Measured, predicted: Floats) -> Residuals:
    """Measured and predicted, entry by entry in the order of the file.

    Args:
        measured: readings or differences.
        predicted: for readings including the fitted zeros, shape (n,) [mm].
    """
    count = len(measured)
    if isinstance(measured, Differences):
        return Residuals(
            series=tuple(each.series for each in measured.which),
            label=tuple(each.name for each in measured.which),
            end=(None,) * count,
            displacement_mm=np.full(count, np.nan),
            cycle=np.ones(count, dtype=np.intp),
            order=np.arange(1, count + 1),
            measured_mm=measured.value,
            predicted_mm=predicted,
        )
    plan = measured.plan
    zero = _zeros(plan, predicted)
    order = np.empty(count, dtype=np.intp)
    order[plan.in_time] = np.arange(1, count + 1)
    return Residuals(
        series=plan.series,
        label=measured.posture,
        end=tuple(Contact(contact).end for contact in plan.contact.tolist()),
        displacement_mm=plan.displacement,
        cycle=measured.cycle,
        order=order,
        measured_mm=measured.value - zero,
        predicted_mm=predicted - zero,
    )


def _zeros(plan: GaugePlan, predicted: Floats) -> Floats:
    """Prediction at the isotropic posture of each reading's set-up (else its mean), (n,)."""
    zero = np.zeros(len(plan))
    for setup in range(plan.setups):
        mine = plan.setup == setup
        iso = mine & (plan.displacement == 0.0) & (plan.contact != Contact.TOOL)
        zero[mine] = predicted[iso if np.any(iso) else mine].mean()
    return zero


@dataclass(frozen=True, eq=False)
class Explained(ReadOnly):
    """What a diagnosis explains of the residuals of the offsets-only model.

    Attributes:
        before_mm, after_mm: residuals without and with the cause, in order of time, each by its
            weight: noise is as large in all of them, shape (n,).
        leg: of each, shape (n,); None where nothing is read at a leg.
        by_cause, noise, unexplained: shares of the sum of squares before; they sum to 1.
    """

    before_mm: Floats
    after_mm: Floats
    leg: Ints | None
    by_cause: float
    noise: float
    unexplained: float

    @property
    def rms_before_mm(self) -> float:
        """Root mean square without the cause [mm]."""
        return rms(self.before_mm)

    @property
    def rms_after_mm(self) -> float:
        """Root mean square with the cause [mm]."""
        return rms(self.after_mm)


def explained(diagnosis: Diagnosis) -> Explained:
    """Split the residuals' sum of squares, without the cause of a diagnosis and with it."""
    measured = diagnosis.measured
    if isinstance(measured, Differences):
        in_time = np.arange(len(measured))
        leg: Ints | None = np.array([each.series.leg for each in measured.which], dtype=np.intp)
    else:
        in_time = measured.plan.in_time
        leg = measured.plan.leg if measured.view is View.LEGS else None
    before = (measured.weight * (diagnosis.measured_mm - diagnosis.nominal_mm))[in_time]
    after = (measured.weight * (diagnosis.measured_mm - diagnosis.explained_mm))[in_time]
    total, left = float(before @ before), float(after @ after)
    expected = diagnosis.lack_of_fit.dof * diagnosis.lack_of_fit.noise_mm**2
    by_cause = max(1.0 - left / total, 0.0) if total else 0.0
    noise = min(expected / total, 1.0 - by_cause) if total else 1.0
    return Explained(
        before_mm=before,
        after_mm=after,
        leg=None if leg is None else leg[in_time],
        by_cause=by_cause,
        noise=noise,
        unexplained=max(1.0 - by_cause - noise, 0.0),
    )
