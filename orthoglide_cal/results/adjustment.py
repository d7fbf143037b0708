"""What to enter in the controller, and the check that shows that it was entered rightly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis
from orthoglide_cal.estimation import Known, PromisedDifference, Solution, promise
from orthoglide_cal.estimation.accuracy import CONFIDENCE, Scatter, determined
from orthoglide_cal.estimation.budget import Budget, Budgeted, warmth
from orthoglide_cal.model import Difference, Floats, Machine, Measured, Posture, ReadOnly
from orthoglide_cal.words import entered_decimals


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
    """One joint: previous + change = new, with the expanded uncertainty of the change [mm].

    Or another parameter that a calibration determines; then in its own unit.
    """

    axis: str
    previous_mm: float
    change_mm: float
    new_mm: float
    expanded_mm: float
    unit: str = "mm"
    determined: bool = True


@dataclass(frozen=True, eq=False)
class Adjustment(Budgeted, ReadOnly):
    """Joint offsets with expanded uncertainty U, and what follows for the controller.

    Attributes:
        causes: ids of the causes found beside the offsets; empty for the offsets alone.
        offsets_mm: Δρ that the controller does not know yet, shape (3,); or all parameters of
            another kind of machine, in its units, (p,).
        budget: where their uncertainty comes from.
        previous_mm: what is active in the controller so far, shape (3,) or (p,).
        machine: it knows names, units and words.
        determined: which of them the readings determine.
        decimals: of what is entered.
        promised: each difference as measured, modelled, and expected once these offsets are
            entered; empty if nothing measured makes one.
        check: what to measure afterwards; None if nothing measured fits it.
    """

    causes: tuple[str, ...]
    offsets_mm: Floats
    budget: Budget
    previous_mm: Floats
    machine: Machine
    determined: tuple[bool, ...]
    decimals: int
    promised: tuple[PromisedDifference, ...]
    check: CheckPosture | None

    confidence = CONFIDENCE

    @property
    def applied_mm(self) -> tuple[float, ...]:
        """The changes as they are entered, and as `verify --applied` takes them."""
        return tuple(_rounded(value, self.decimals) for value in self.offsets_mm.tolist())

    @property
    def joints(self) -> tuple[JointOffset, ...]:
        """What to enter, joint by joint; new values are free of the errors of binary addition.

        What the readings do not determine stays as it is.
        """
        names, units = self.machine.parameter_names, self.machine.parameter_units
        columns = (self.previous_mm.tolist(), self.applied_mm, self.expanded_mm.tolist())
        every = zip(names, *columns, units, self.determined, strict=True)
        return tuple(
            JointOffset(name, now, change, _rounded(now + change, 9), expanded, unit, known)
            if known
            else JointOffset(name, now, 0.0, now, expanded, unit, known)
            for name, now, change, expanded, unit, known in every
        )

    @property
    def values(self) -> Floats:
        """What is told as the result, shape (p,): the parameters themselves, or the excess."""
        return self.offsets_mm + self.previous_mm if self.machine.absolute else self.offsets_mm

    @property
    def limits(self) -> Floats:
        """The values less and plus U, shape (p, 2)."""
        reach = self.expanded_mm
        return np.stack((self.values - reach, self.values + reach), axis=1)


def as_found(
    solution: Solution, diagnosis: Diagnosis | None, real: Known, mean_c: float | None
) -> Adjustment:
    """The solution's own offsets, and what follows from entering them.

    Args:
        solution: the offsets as they stand.
        diagnosis: of the same data; None if there is none.
        real: what is known of the machine in which they would be entered.
        mean_c: mean temperature of the readings [°C]; None if unknown.
    """
    budget = solution.budget.extended(diagnosis.adds_to(solution) if diagnosis else ())
    budget = budget.extended(warmth(mean_c, real.model.machine.leg_length_mm))
    right = diagnosis.put_right if diagnosis else solution.measured
    return _adjustment(solution, (), solution.offsets_mm, budget, real, right, solution.noise)


def as_diagnosed(
    solution: Solution, diagnosis: Diagnosis, real: Known, mean_c: float | None
) -> Adjustment:
    """The offsets under what the diagnosis found, and what follows from entering them.

    Args:
        solution: of the same data, for the noise of a reading.
        diagnosis: gives the offsets.
        real: what is known of the machine in which they would be entered.
        mean_c: mean temperature of the readings [°C]; None if unknown.
    """
    causes = tuple(cause.id for cause in diagnosis.causes)
    held = set(real.model.machine.fixed_parameters) - set(causes)
    given = [each for each in solution.budget.contributions if each.source in held]
    budget = diagnosis.budget.extended(given)
    budget = budget.extended(warmth(mean_c, real.model.machine.leg_length_mm))
    noise = Scatter(diagnosis.left_open[0][1].sigma, np.inf)
    right = diagnosis.put_right
    return _adjustment(solution, causes, diagnosis.offsets_mm, budget, real, right, noise)


def _adjustment(
    solution: Solution,
    causes: tuple[str, ...],
    offsets: Floats,
    budget: Budget,
    real: Known,
    right: Measured,
    noise: Scatter,
) -> Adjustment:
    machine = real.model.machine
    previous = machine.active
    decimals = machine.decimals or entered_decimals(budget.expanded_mm.tolist(), previous)
    entered = np.array([_rounded(value, decimals) for value in offsets.tolist()])
    promised = promise(solution.measured, real, entered, noise, right)
    return Adjustment(
        causes=causes,
        offsets_mm=offsets,
        budget=budget,
        previous_mm=np.array(previous),
        machine=machine,
        determined=determined(real.model, budget.expanded_mm),
        decimals=decimals,
        promised=promised,
        check=_check(solution, promised, budget.k),
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
    machine = solution.model.orthoglide
    leg, posture = row.difference.series.leg, row.difference.posture
    ends = (posture, posture) if posture else (Posture.MIN, Posture.MAX)
    moved = [machine.displacement_mm(end) for end in ends]
    tools = [tuple(value if k == leg else 0.0 for k in range(3)) for value in moved]
    joints = [tuple(machine.joints_at(leg, value).tolist()) for value in moved]
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
        # The promise is of as many readings as were taken before; the check is of two.
        tolerance_mm=math.hypot(row.expanded_mm, k * math.sqrt(2.0) * sigma),
    )
