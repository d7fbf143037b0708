"""Measured and predicted readings without the arbitrary zeros of the gauges, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Ints
from orthoglide_cal.measured import Differences, Measured, Readings
from orthoglide_cal.plan import Contact


@dataclass(frozen=True, eq=False)
class Traces:
    """One entry per reading (or difference); arrays have shape (n,).

    Attributes:
        series: name of the (leg, direction), direction first, leg second, e.g. "y_x".
        leg: 0, 1, 2.
        label: posture, or the name of the difference.
        end: "joint" or "tool" for the single-posture protocol, else "".
        displacement_mm: of the leg's carriage; NaN for differences.
        cycle: repeat, from 1.
        order: rank in time, from 1.
        measured_mm: relative to the prediction at the isotropic posture of the same set-up.
        predicted_mm: likewise; its difference from `measured_mm` is the residual.
        raw: True for readings, False for differences.
    """

    series: tuple[str, ...]
    leg: Ints
    label: tuple[str, ...]
    end: tuple[str, ...]
    displacement_mm: Floats
    cycle: Ints
    order: Ints
    measured_mm: Floats
    predicted_mm: Floats
    raw: bool

    @property
    def residual_mm(self) -> Floats:
        """measured − predicted, shape (n,)."""
        return self.measured_mm - self.predicted_mm

    def rms_by_series(self) -> dict[str, float]:
        """Root mean square residual of each (leg, direction) [mm], legs in order."""
        names = sorted(set(self.series), key=lambda name: (name[2], name[0]))
        chosen = {name: [s == name for s in self.series] for name in names}
        return {
            name: float(np.sqrt(np.mean(self.residual_mm[mask] ** 2)))
            for name, mask in chosen.items()
        }


def traces(measured: Measured, predicted: Floats) -> Traces:
    """Prepare the pictures' arrays.

    Args:
        measured: readings or differences.
        predicted: for readings including the fitted zeros, shape (n,) [mm].
    """
    if isinstance(measured, Differences):
        count = len(measured)
        return Traces(
            series=tuple(name[:3] for name in measured.names),
            leg=np.array([AXES.index(name[2]) for name in measured.names]),
            label=measured.names,
            end=("",) * count,
            displacement_mm=np.full(count, np.nan),
            cycle=np.ones(count, dtype=np.intp),
            order=np.arange(1, count + 1),
            measured_mm=measured.value,
            predicted_mm=predicted,
            raw=False,
        )
    zero = _zeros(measured, predicted)
    plan = measured.plan
    order = np.empty(len(plan), dtype=np.intp)
    order[plan.in_time] = np.arange(1, len(plan) + 1)
    return Traces(
        series=tuple(plan.series_name(i) for i in range(len(plan))),
        leg=plan.leg,
        label=measured.posture,
        end=tuple(
            "" if contact == Contact.FIXED else Contact(contact).name.lower()
            for contact in plan.contact.tolist()
        ),
        displacement_mm=plan.displacement,
        cycle=measured.cycle,
        order=order,
        measured_mm=measured.value - zero,
        predicted_mm=predicted - zero,
        raw=True,
    )


def _zeros(measured: Readings, predicted: Floats) -> Floats:
    """Prediction at the isotropic posture of each reading's set-up (else its mean), (n,)."""
    plan = measured.plan
    zero = np.zeros(len(plan))
    for setup in range(plan.setups):
        mine = plan.setup == setup
        iso = mine & (plan.displacement == 0.0) & (plan.contact != Contact.TOOL)
        zero[mine] = predicted[iso if np.any(iso) else mine].mean()
    return zero
