"""What to enter in the controller, and the check that shows that it was entered rightly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Floats, axis_index
from orthoglide_cal.estimation import Solution
from orthoglide_cal.machine import Machine
from orthoglide_cal.outcome.answer import Answer
from orthoglide_cal.outcome.rounding import rounded

# A controller takes micrometres: rounding what is entered to the digits of a large uncertainty
# would throw information away.
ENTERED_DECIMALS = 3


@dataclass(frozen=True)
class CheckPosture:
    """One difference of readings to repeat after the adjustment.

    Attributes:
        difference: its name, direction first, leg second, e.g. "z_x".
        leg, direction: "x", "y" or "z".
        first, second: tool positions to drive to, in this order [mm].
        first_joints, second_joints: joint values there [mm].
        ends: True if the gauge moves along the leg at one posture instead (single-posture).
        before_mm: what it was.
        expected_mm: second reading minus the first, after the adjustment.
        tolerance_mm: expanded uncertainty of that expectation, with the noise of the check itself.
    """

    difference: str
    leg: str
    direction: str
    first: tuple[float, float, float]
    second: tuple[float, float, float]
    first_joints: tuple[float, float, float]
    second_joints: tuple[float, float, float]
    ends: bool
    before_mm: float
    expected_mm: float
    tolerance_mm: float


@dataclass(frozen=True)
class JointOffset:
    """One joint: previous + change = new [mm]; `change_mm` has as many digits as are entered."""

    axis: str
    previous_mm: float
    change_mm: float
    expanded_mm: float

    @property
    def new_mm(self) -> float:
        """Value to enter; free of the rounding errors of binary addition."""
        return rounded(self.previous_mm + self.change_mm, 9)


@dataclass(frozen=True)
class Adjustment:
    """The joints' new offsets and the check afterwards; `check` is None if nothing fits it."""

    joints: tuple[JointOffset, ...]
    decimals: int
    check: CheckPosture | None

    @property
    def applied_mm(self) -> tuple[float, ...]:
        """The changes as `verify --applied` takes them."""
        return tuple(joint.change_mm for joint in self.joints)


def adjust(solution: Solution, answer: Answer, machine: Machine) -> Adjustment:
    """New offsets from those active in the controller and the answer."""
    decimals = max(answer.decimals, ENTERED_DECIMALS, *map(_decimals, machine.offsets_mm))
    joints = tuple(
        JointOffset(axis, previous, rounded(float(change), decimals), float(expanded))
        for axis, previous, change, expanded in zip(
            AXES, machine.offsets_mm, answer.offsets_mm, answer.expanded_mm, strict=True
        )
    )
    return Adjustment(joints, decimals, _check(solution, answer, machine))


def _decimals(previous: float) -> int:
    """Decimals that an offset active so far was entered with, at most six."""
    return len(f"{previous:.6f}".rstrip("0").partition(".")[2])


def _check(solution: Solution, answer: Answer, machine: Machine) -> CheckPosture | None:
    """The difference in which the offsets show most: it tells an entered one from a forgotten."""
    if not solution.table:
        return None
    row = max(solution.table, key=lambda r: abs(r.modelled_mm))
    direction, leg = row.difference[0], row.difference[2]
    low, high = machine.joint_limits_mm
    ends = len(row.difference) > 3
    moved = {"0": (0.0, 0.0), "+": (high, high), "-": (low, low)}
    first, second = moved[row.difference[3]] if ends else (low, high)
    sigma = max(solution.sigma_mm, machine.gauge.noise_mm)
    # Two readings of the check, and at most as much again in the differences measured before.
    return CheckPosture(
        difference=row.difference,
        leg=leg,
        direction=direction,
        first=_tool(leg, first),
        second=_tool(leg, second),
        first_joints=_joints(leg, first, machine),
        second_joints=_joints(leg, second, machine),
        ends=ends,
        before_mm=row.measured_mm,
        expected_mm=row.expected_mm,
        tolerance_mm=answer.k * 2.0 * sigma,
    )


def _tool(leg: str, moved: float) -> tuple[float, float, float]:
    position: Floats = np.zeros(3)
    position[axis_index(leg)] = moved
    return _triple(position)


def _joints(leg: str, moved: float, machine: Machine) -> tuple[float, float, float]:
    """Indicated joints of a tool position on the leg's axis (sec. 2.5)."""
    length = machine.leg_length_mm
    joints = np.full(3, math.sqrt(length**2 - moved**2))
    joints[axis_index(leg)] = length + moved
    return _triple(joints)


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
