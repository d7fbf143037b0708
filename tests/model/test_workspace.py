"""Tool-position error and compensation, against the kinematics of the independent truth."""

import numpy as np
import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.workspace import SAMPLES, compensation, workspace_error
from tests.machines import NOMINAL, PROTOTYPE, both_machines, extended
from tests.truth.forward import tool_from_carriages

LENGTH = PROTOTYPE.leg_length_mm
OFFSETS, NONE = np.array([-0.53, 0.59, -1.76]), np.zeros(3)
COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, -2.0], [0.0, -2.0, 5.0]]) * 1e-4
GAPS, SCALES, LONGER = (0.3, -0.2, 0.25), (1.0, -2.0, 0.5), (0.05, -0.02, 0.03)
SLICES = [0, SAMPLES // 2, SAMPLES - 1]


def cube(axis: Floats) -> Floats:
    """All points with such coordinates, x changing fastest and z least, shape (n, 3) [mm]."""
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.stack((x, y, z), axis=-1).reshape(-1, 3)


def inverse(tool: Floats, length: float = LENGTH) -> Floats:
    """ρ_i = p_i + √(L² − p_j² − p_k²) (eq. 3; errata, rows y and z), shape (n, 3) [mm]."""
    others = (tool**2).sum(axis=-1, keepdims=True) - tool**2
    return np.asarray(tool + np.sqrt(length**2 - others))


def reached(joints: Floats, gaps: Floats = NONE, longer: Floats = NONE) -> Floats:
    """The truth's tool, rails apart by half a gap each, other legs: (n, 3) → (n, 3) [mm]."""
    xy, yz, zx = 0.5 * np.array(gaps)
    points = np.array([[0.0, -zx, xy], [yz, 0.0, -xy], [-yz, zx, 0.0]])
    carriages = points[:, :, None] + np.eye(3)[:, :, None] * joints.T[:, None]
    legs = LENGTH + np.reshape(longer, (3, 1))
    return tool_from_carriages(carriages, legs, joints.T - LENGTH, steps=12).T


def test_entering_offsets_leaves_the_errors_of_accepted_causes() -> None:
    """Rails apart, longer legs, wrong scales, over the whole cube: with the offsets, without."""
    model = extended(axis_gap=GAPS, encoder_scale=SCALES, leg_length=LONGER)
    found = workspace_error(model, OFFSETS, np.zeros((3, 3)), 2.0)
    maps, axis = found.maps, found.maps.axis_mm
    assert len(axis) == SAMPLES
    assert (axis[0], axis[-1]) == found.cube_mm == NOMINAL.machine.cube
    assert maps.levels_mm == pytest.approx([axis[0], (axis[0] + axis[-1]) / 2.0, axis[-1]])
    points = cube(axis)
    joints = LENGTH + (1.0 + 1e-3 * np.array(SCALES)) * (inverse(points) - LENGTH)
    for offsets, slices, largest in (
        (OFFSETS, maps.before_mm, found.before_mm),
        (NONE, maps.after_mm, found.after_mm),
    ):
        error = np.linalg.norm(reached(joints + offsets, GAPS, LONGER) - points, axis=1)
        assert slices == pytest.approx(error.reshape((SAMPLES,) * 3)[SLICES], abs=1e-9)
        assert largest == pytest.approx(error.max(), abs=1e-9)
    assert found.left_mm == found.after_mm


def test_after_is_what_the_uncertainty_leaves() -> None:
    """k √(tr J C Jᵀ), with J from finite differences, which err by 1e-8 of it."""
    found = workspace_error(NOMINAL, OFFSETS, COVARIANCE, 3.0)
    joints = inverse(cube(found.maps.axis_mm))
    slope = np.stack(
        [(reached(joints + move) - reached(joints - move)) / 2e-3 for move in 1e-3 * np.eye(3)],
        axis=-1,
    )
    after = 3.0 * np.sqrt(np.einsum("nij,jk,nik->n", slope, COVARIANCE, slope))
    assert found.maps.after_mm == pytest.approx(after.reshape((SAMPLES,) * 3)[SLICES], rel=1e-6)
    assert found.after_mm == pytest.approx(after.max(), rel=1e-6)


def test_carriages_that_stand_have_no_past() -> None:
    """Lost motion and drift are of a session: nothing of them in a place of the workspace."""
    moving = extended(backlash=(0.3, 0.2, 0.4), thermal_drift=(0.5, -0.3, 0.4))
    found, plain = (workspace_error(m, OFFSETS, COVARIANCE, 2.0).maps for m in (moving, NOMINAL))
    assert np.array_equal(found.before_mm, plain.before_mm)
    assert np.array_equal(found.after_mm, plain.after_mm)


def displacements(machine: Machine, low: float, high: float) -> Floats:
    """Of the carriages from their isotropic places, all over the cube [low, high]³."""
    axis = np.append(np.linspace(low, high, 21), 0.0)
    return inverse(cube(axis), machine.leg_length_mm) - machine.leg_length_mm


@both_machines
@pytest.mark.parametrize("limits", [None, (-40.0, 60.0), (-100.0, 12.0)])
def test_the_cube_stays_within_the_joint_limits(
    machine: Machine, limits: tuple[float, float] | None
) -> None:
    """And reaches them: each limit is met somewhere in it."""
    machine = machine.changed(
        joint_limits_mm=limits or machine.joint_limits_mm, workspace_mm=1000.0
    )
    moved = displacements(machine, *machine.cube)
    assert moved.min() == pytest.approx(machine.joint_limits_mm[0], abs=1e-6)
    assert moved.max() == pytest.approx(machine.joint_limits_mm[1], abs=1e-6)


def test_the_cube_is_no_larger_than_the_workspace_and_stays_where_it_was() -> None:
    whole = PROTOTYPE.changed(workspace_mm=1000.0).cube
    small = PROTOTYPE.changed(workspace_mm=50.0).cube
    assert small[1] - small[0] == pytest.approx(50.0)
    assert sum(small) == pytest.approx(sum(whole))
    wide = PROTOTYPE.changed(joint_limits_mm=(-300.0, 300.0), workspace_mm=1000.0)
    low, high = wide.cube
    assert (low, high) == (-LENGTH / 2.0, LENGTH / 2.0)
    assert np.isfinite(displacements(wide, low, high)).all()


def test_compensated_joints_put_the_tool_right() -> None:
    """Each row, on a machine built here from the causes' definitions: rails apart, other legs,
    other scales."""
    model = extended(axis_gap=GAPS, encoder_scale=SCALES, leg_length=LONGER, backlash=(0.1,) * 3)
    table = compensation(model, points=3)
    assert table.causes == ("axis_gap", "encoder_scale", "leg_length")
    assert table.left_out == ("backlash",)
    low, high = NOMINAL.machine.cube
    points = cube(np.array([low, (low + high) / 2.0, high]))
    assert table.points_mm == pytest.approx(points, abs=1e-12)
    indicated = inverse(points) + table.corrections_mm
    joints = LENGTH + (1.0 + 1e-3 * np.array(SCALES)) * (indicated - LENGTH)
    assert reached(joints, GAPS, LONGER) == pytest.approx(points, abs=1e-7)
    assert np.abs(table.corrections_mm).max() > 0.05


def test_nothing_to_compensate_is_said() -> None:
    for model in (NOMINAL, extended(backlash=(0.1, 0.1, 0.1)), extended(bar_skew=(0.1,) * 6)):
        with pytest.raises(UsageError, match="no accepted cause"):
            compensation(model, 7)
    gap = extended(axis_gap=(0.1, 0.1, 0.1))
    for points in (1, 52):
        with pytest.raises(UsageError, match=f"2 to 51 points along each edge, not {points}"):
            compensation(gap, points)
    assert len(compensation(gap, 2).points_mm) == 8
