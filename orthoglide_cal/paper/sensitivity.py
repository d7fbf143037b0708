"""What offsets do to a leg (Table 1), and what noise does to the offsets (eqs. 29, 32, 33)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.estimation import Problem
from orthoglide_cal.estimation.accuracy import sigma_rho, unit_covariance
from orthoglide_cal.model import (
    AXES,
    DIFFERENCES,
    Contact,
    DataKind,
    Model,
    Posture,
    Series,
    ideal_plan,
    other_axes,
    reduction,
    simulate_with_jacobian,
    zero_free,
)
from orthoglide_cal.model.protocols import PlannedReading, plan_of


@dataclass(frozen=True)
class Sensitivity:
    """One row of Table 1: deviation of a leg from parallelism with one plane, per offset.

    Attributes:
        posture: of this leg.
        series: leg and direction; the plane is spanned by the leg and the third axis.
        own: derivative by the leg's own offset Δρ_leg, computed from the forward model.
        other: derivative by Δρ_direction.
        third: derivative by the remaining offset.
        tangent: what the paper gives for `own`: T_α = tan α.
    """

    posture: Posture
    series: Series
    own: float
    other: float
    third: float
    tangent: float

    @property
    def plane(self) -> str:
        """The plane that the deviation is measured from, e.g. "XY"."""
        return "".join(axis for axis in AXES if axis != AXES[self.series.direction]).upper()

    @property
    def typical(self) -> float:
        """Deviation for offsets of 1 mm in all three joints [mm]."""
        return self.own + self.other + self.third


def sensitivities(model: Model) -> tuple[Sensitivity, ...]:
    """Table 1: exact derivatives, at zero offsets, of the height of a leg's tool end over its
    joint end, at the isotropic, Max and Min posture of each leg, in both directions."""
    machine = model.orthoglide
    rows = [
        (posture, Series(leg, direction))
        for posture in Posture
        for leg in range(3)
        for direction in other_axes(leg)
    ]
    jacobians = []
    for end in (Contact.TOOL, Contact.JOINT):
        readings = [
            PlannedReading(*series, machine.displacement_mm(posture), end)
            for posture, series in rows
        ]
        jacobians.append(simulate_with_jacobian(model, np.zeros(3), plan_of(readings))[1])
    jacobian = (jacobians[0] - jacobians[1]).tolist()
    return tuple(
        Sensitivity(
            posture,
            series,
            own=jacobian[k][series.leg],
            other=jacobian[k][series.direction],
            third=jacobian[k][3 - series.leg - series.direction],
            # α = asin(d/L), negative at the min posture (errata, Table 1).
            tangent=math.tan(math.asin(machine.displacement_mm(posture) / machine.leg_length_mm)),
        )
        for k, (posture, series) in enumerate(rows)
    )


def accuracy_factor(model: Model, kind: DataKind) -> float:
    """σ_ρ/σ of one cycle of readings: the paper's 1.98 (six) and 2.06 (twelve).

    Args:
        model: the machine.
        kind: six (eq. 29) or twelve differences (eq. 32), or readings: the Cramér–Rao bound of the
            same isotropic, Max and Min readings.
    """
    raw = kind is DataKind.READINGS
    plan = ideal_plan(DataKind.TWELVE if raw else kind, model.orthoglide)
    matrix = zero_free(plan) if raw else reduction(kind, DIFFERENCES[kind], model.orthoglide, plan)
    problem = Problem(model, plan, matrix)
    return sigma_rho(unit_covariance(problem, problem.at_zero[1]))
