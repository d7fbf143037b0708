"""Tool-position error and compensation, against kinematics written anew here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.data import default_machine
from orthoglide_cal.errors import UsageError
from orthoglide_cal.machine import Estimate, IdentifiedCause
from orthoglide_cal.outcome import compensation
from orthoglide_cal.outcome.workspace import reachable_cube, workspace_error

MACHINE = default_machine()
LENGTH = MACHINE.leg_length_mm
OFFSETS = np.array([-0.53, 0.59, -1.76])


def nominal_joints(point):
    return np.array(
        [point[i] + np.sqrt(LENGTH**2 - point @ point + point[i] ** 2) for i in range(3)]
    )


def tool(points, directions, lengths, joints, start):
    """The point at the legs' lengths from the carriages, by Newton's method."""
    centres, point = points + joints[:, None] * directions, np.array(start)
    for _ in range(12):
        legs = point - centres
        point = point - np.linalg.solve(2.0 * legs, (legs**2).sum(axis=1) - lengths**2)
    return point


def test_before_is_the_distance_that_the_offsets_cause():
    found = workspace_error(MACHINE, OFFSETS, np.zeros((3, 3)), 2.0)
    for level, row, column in ((0, 0, 0), (1, 3, 12), (2, 16, 5)):
        axis = found.axis_mm
        point = np.array([axis[column], axis[row], found.levels_mm[level]])
        joints = nominal_joints(point) + OFFSETS
        reached = tool(np.zeros((3, 3)), np.eye(3), np.full(3, LENGTH), joints, point)
        assert found.before_mm[level, row, column] == pytest.approx(
            np.linalg.norm(reached - point), abs=1e-9
        )
    assert found.after_mm == pytest.approx(0.0, abs=1e-12)
    assert found.before_max_mm >= found.before_mm.max() - 1e-12


def test_after_is_what_the_uncertainty_leaves():
    """k·u of the tool position, against 4,000 drawn offsets at one point."""
    covariance = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, -2.0], [0.0, -2.0, 5.0]]) * 1e-4
    found = workspace_error(MACHINE, OFFSETS, covariance, 2.0)
    point = np.array([found.axis_mm[0], found.axis_mm[0], found.levels_mm[0]])
    drawn = np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, 4000)
    joints = nominal_joints(point)
    reached = np.array(
        [
            tool(np.zeros((3, 3)), np.eye(3), np.full(3, LENGTH), joints + d, point)
            for d in drawn[:400]
        ]
    )
    spread = np.sqrt(np.mean(((reached - point) ** 2).sum(axis=1)))
    # 400 draws of three components: the r.m.s. scatters by about 2 %; 8 % is four of that.
    assert found.after_mm[0, 0, 0] == pytest.approx(2.0 * spread, rel=0.08)


def test_the_cube_stays_within_the_joint_limits():
    low, high = reachable_cube(MACHINE)
    corners = np.stack(np.meshgrid(*[np.linspace(low, high, 21)] * 3), axis=-1).reshape(-1, 3)
    moved = np.array([nominal_joints(point) for point in corners]) - LENGTH
    assert moved.min() >= MACHINE.joint_limits_mm[0] - 1e-6
    assert moved.max() <= MACHINE.joint_limits_mm[1] + 1e-6
    assert moved.min() == pytest.approx(MACHINE.joint_limits_mm[0], abs=1e-6)
    small = reachable_cube(replace(MACHINE, workspace_mm=50.0))
    assert small[1] - small[0] == pytest.approx(50.0)
    wide = reachable_cube(replace(MACHINE, joint_limits_mm=(-300.0, 300.0), workspace_mm=1000.0))
    assert wide[0] < 0.0 < wide[1]


def extended(**causes):
    found = tuple(
        IdentifiedCause(
            name,
            "",
            {
                key: Estimate(value, 0.01, CAUSES[name].unit)
                for key, value in zip(CAUSES[name].names, values, strict=True)
            },
            "2026-01-01",
            "0" * 64,
        )
        for name, values in causes.items()
    )
    return replace(MACHINE, identified=found)


def test_compensated_joints_put_the_tool_right():
    """Each row, on a machine built here from the causes' definitions: rails apart, other legs,
    other scales."""
    gaps, scales, longer = (0.3, -0.2, 0.25), (1.0, -2.0, 0.5), (0.05, -0.02, 0.03)
    machine = extended(axis_gap=gaps, encoder_scale=scales, leg_length=longer, backlash=(0.1,) * 3)
    table = compensation(machine, points=3)
    assert table.causes == ("axis_gap", "encoder_scale", "leg_length")
    assert table.left_out == ("backlash",)
    assert len(table.points_mm) == 27
    xy, yz, zx = (value / 2.0 for value in gaps)
    rails = np.array([[0.0, -zx, xy], [yz, 0.0, -xy], [-yz, zx, 0.0]])
    for point, correction in zip(table.points_mm, table.corrections_mm, strict=True):
        indicated = nominal_joints(point) + correction
        joints = LENGTH + (1.0 + 1e-3 * np.array(scales)) * (indicated - LENGTH)
        reached = tool(rails, np.eye(3), LENGTH + np.array(longer), joints, point)
        assert reached == pytest.approx(point, abs=1e-7)
    assert np.abs(table.corrections_mm).max() > 0.05


def test_nothing_to_compensate_is_said():
    with pytest.raises(UsageError, match="no accepted cause"):
        compensation(MACHINE)
    with pytest.raises(UsageError, match="no accepted cause"):
        compensation(extended(backlash=(0.1, 0.1, 0.1)))
    with pytest.raises(UsageError, match="2 to 51 points"):
        compensation(extended(axis_gap=(0.1, 0.1, 0.1)), points=1)
