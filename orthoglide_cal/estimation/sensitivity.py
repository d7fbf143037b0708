"""What offsets do to a leg (Table 1), and what noise does to the offsets (eqs. 29, 32, 33)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES
from orthoglide_cal.estimation.accuracy import sigma_rho, unit_covariance
from orthoglide_cal.estimation.linear import calibration_matrix
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.kinematics import leg_angle
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact
from orthoglide_cal.protocols import NAMES, ideal_plan, other_axes, reduction, zero_free
from orthoglide_cal.protocols.postures import Step, plan_of
from orthoglide_cal.simulation import simulate_with_jacobian

POSTURES = ("iso", "max", "min")


@dataclass(frozen=True)
class Sensitivity:
    """One row of Table 1: deviation of a leg from parallelism with one plane, per offset.

    Attributes:
        posture: "iso", "max" or "min" of this leg.
        leg, direction: axes; the plane is spanned by the leg and the third axis.
        own: derivative by the leg's own offset Δρ_leg, computed from the forward model.
        other: derivative by Δρ_direction.
        third: derivative by the remaining offset.
        tangent: what the paper gives for `own`: T_α = tan α.
    """

    posture: str
    leg: str
    direction: str
    own: float
    other: float
    third: float
    tangent: float

    @property
    def plane(self) -> str:
        """The plane that the deviation is measured from, e.g. "XY"."""
        return "".join(axis for axis in AXES if axis != self.direction).upper()

    @property
    def typical(self) -> float:
        """Deviation for offsets of 1 mm in all three joints [mm]."""
        return self.own + self.other + self.third


def sensitivities(machine: Machine) -> tuple[Sensitivity, ...]:
    """Table 1: exact derivatives, at zero offsets, of the height of a leg's tool end over its
    joint end, at the isotropic, Max and Min posture of each leg, in both directions."""
    rows = [
        (posture, leg, direction)
        for posture in POSTURES
        for leg in range(3)
        for direction in other_axes(leg)
    ]
    slopes = []
    for end in (Contact.TOOL, Contact.JOINT):
        steps = [
            Step(leg, direction, machine.displacement_mm(posture), end, 0.0)
            for posture, leg, direction in rows
        ]
        slopes.append(simulate_with_jacobian(machine, np.zeros(3), plan_of(steps))[1])
    slope = (slopes[0] - slopes[1]).tolist()
    return tuple(
        Sensitivity(
            posture,
            AXES[leg],
            AXES[direction],
            own=slope[k][leg],
            other=slope[k][direction],
            third=slope[k][3 - leg - direction],
            tangent=math.tan(leg_angle(machine.displacement_mm(posture), machine.leg_length_mm)),
        )
        for k, (posture, leg, direction) in enumerate(rows)
    )


def accuracy_factor(machine: Machine, method: str) -> float:
    """σ_ρ/σ of one cycle of readings: the paper's 1.98 (six) and 2.06 (twelve).

    Args:
        machine: nominal machine.
        method: "six" (eq. 29), "twelve" (eq. 32), or "readings": the Cramér–Rao bound of the
            same isotropic, Max and Min readings.
    """
    kind = "twelve" if method == "readings" else method
    plan = ideal_plan(kind, machine)
    raw = method == "readings"
    matrix = zero_free(plan) if raw else reduction(kind, NAMES[kind], machine, plan)
    problem = Problem(machine, plan, matrix)
    return sigma_rho(unit_covariance(problem, calibration_matrix(problem)))
