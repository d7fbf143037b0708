"""What to enter in the controller, and the check that shows that it was entered rightly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis
from orthoglide_cal.estimation import PromisedDifference, Solution, promise
from orthoglide_cal.estimation.accuracy import CONFIDENCE, entered_decimals, half_width
from orthoglide_cal.model import AXES, Difference, Floats, Measured, Model, Posture, freeze


@dataclass(frozen=True)
class CheckPosture:
    """One difference of readings to repeat after the adjustment.

    Attributes:
        difference: which; the gauge stands on its leg and measures in its direction.
        first, second: tool positions to drive to, in this order [mm].
        first_joints, second_joints: joint values there [mm].
        ends: True if the gauge moves along the leg at one posture instead (single-posture).
        before_mm: what it was.
        expected_mm: second reading minus the first, after the adjustment.
        tolerance_mm: expanded uncertainty of that expectation, with the noise of the check itself.
    """

    difference: Difference
    first: tuple[float, ...]
    second: tuple[float, ...]
    first_joints: tuple[float, ...]
    second_joints: tuple[float, ...]
    ends: bool
    before_mm: float
    expected_mm: float
    tolerance_mm: float


class JointOffset(NamedTuple):
    """One joint: previous + change = new, with the expanded uncertainty of the change [mm]."""

    axis: str
    previous_mm: float
    change_mm: float
    new_mm: float
    expanded_mm: float


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Joint offsets with expanded uncertainty U, and what follows for the controller.

    Attributes:
        causes: ids of the causes found beside the offsets; empty for the offsets alone.
        offsets_mm: Δρ that the controller does not know yet, shape (3,).
        covariance_mm2: of the offsets, shape (3, 3).
        expanded_mm: U at the confidence below, shape (3,).
        k: coverage factor, U/u.
        dof: degrees of freedom of k; None for the normal distribution.
        previous_mm: offsets active in the controller so far, shape (3,).
        decimals: of what is entered.
        promised: each difference as measured, modelled, and expected once these offsets are
            entered; empty if nothing measured makes one.
        check: what to measure afterwards; None if nothing measured fits it.
    """

    causes: tuple[str, ...]
    offsets_mm: Floats
    covariance_mm2: Floats
    expanded_mm: Floats
    k: float
    dof: int | None
    previous_mm: Floats
    decimals: int
    promised: tuple[PromisedDifference, ...]
    check: CheckPosture | None

    confidence = CONFIDENCE

    def __post_init__(self) -> None:
        freeze(self, "offsets_mm", "covariance_mm2", "expanded_mm", "previous_mm")

    @property
    def std_mm(self) -> Floats:
        """Standard uncertainties u of the offsets, shape (3,) [mm]."""
        return np.sqrt(np.diag(self.covariance_mm2))

    @property
    def applied_mm(self) -> tuple[float, ...]:
        """The changes as they are entered, and as `verify --applied` takes them."""
        return tuple(_rounded(value, self.decimals) for value in self.offsets_mm.tolist())

    @property
    def joints(self) -> tuple[JointOffset, ...]:
        """What to enter, joint by joint; new values are free of the errors of binary addition."""
        columns = (AXES, self.previous_mm.tolist(), self.applied_mm, self.expanded_mm.tolist())
        return tuple(
            JointOffset(axis, previous, change, _rounded(previous + change, 9), expanded)
            for axis, previous, change, expanded in zip(*columns, strict=True)
        )


def adjust(
    measured: Measured, solution: Solution, diagnosis: Diagnosis | None, real: Model
) -> Adjustment:
    """What the offsets would be entered as, and the promise of the model that they rest on.

    Args:
        measured: the data of both.
        solution: the offsets as they stand, with Student's t of their degrees of freedom.
        diagnosis: the one that knows the offsets better than the solution; None if none does.
        real: the machine with the causes that the diagnosis finds in it.
    """
    if diagnosis is None:
        causes: tuple[str, ...] = ()
        offsets, covariance = solution.offsets_mm, solution.covariance_mm2
        expanded, k, dof = solution.expanded_mm, solution.k, solution.dof or None
        promised = solution.table
    else:
        causes = tuple(cause.id for cause in diagnosis.causes)
        offsets, covariance = diagnosis.offsets_mm, diagnosis.covariance_mm2
        k, dof = half_width(np.inf), None
        expanded = k * diagnosis.std_mm
        promised = promise(measured, real, offsets, offsets)
    previous = real.machine.offsets_mm
    return Adjustment(
        causes=causes,
        offsets_mm=offsets,
        covariance_mm2=covariance,
        expanded_mm=expanded,
        k=k,
        dof=dof,
        previous_mm=np.array(previous),
        decimals=entered_decimals(expanded.tolist(), previous),
        promised=promised,
        check=_check(solution, promised, k),
    )


def _rounded(value: float, decimals: int) -> float:
    """The value rounded, without a negative zero."""
    return round(value, decimals) + 0.0


def _check(
    solution: Solution, promised: Sequence[PromisedDifference], k: float
) -> CheckPosture | None:
    """The difference that the offsets change most: it tells an entered one from a forgotten."""
    if not promised:
        return None
    row = max(promised, key=lambda each: abs(each.measured_mm - each.expected_mm))
    machine, kind = solution.model.machine, solution.model.kind
    leg, posture = row.difference.series.leg, row.difference.posture
    ends = (posture, posture) if posture else (Posture.MIN, Posture.MAX)
    moved = [machine.displacement_mm(end) for end in ends]
    tools = [tuple(value if k == leg else 0.0 for k in range(3)) for value in moved]
    joints = [tuple(kind.joints_at(machine, leg, value).tolist()) for value in moved]
    sigma = max(solution.sigma_mm, machine.gauge.noise_mm)
    return CheckPosture(
        difference=row.difference,
        first=tools[0],
        second=tools[1],
        first_joints=joints[0],
        second_joints=joints[1],
        ends=posture is not None,
        before_mm=row.measured_mm,
        expected_mm=row.expected_mm,
        # Two readings of the check, and at most as much again in the differences measured before.
        tolerance_mm=k * 2.0 * sigma,
    )
