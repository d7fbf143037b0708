"""Tool-position error and compensation, against kinematics written again for the tests."""

from collections.abc import Iterator

import numpy as np
import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.workspace import SAMPLES, WorkspaceMaps, compensation, workspace_error
from tests.machines import NOMINAL, PROTOTYPE, both_machines, extended
from tests.model.geometries import bent_rails, on_rails
from tests.model.paper_kinematics import direct, inverse, nominal_rails, tool_near

LENGTH = PROTOTYPE.leg_length_mm
RAILS = nominal_rails(LENGTH)
OFFSETS = np.array([-0.53, 0.59, -1.76])
COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, -2.0], [0.0, -2.0, 5.0]]) * 1e-4
# (slice, y, x): corners, edges and the inside of the cube.
PLACES = ((0, 0, 0), (1, 3, 12), (2, 16, 5))


GAPS, SCALES, LONGER = (0.3, -0.2, 0.25), (1.0, -2.0, 0.5), (0.05, -0.02, 0.03)


def at_places(found: WorkspaceMaps) -> Iterator[tuple[tuple[int, ...], Floats]]:
    """Indices of some places of the cube, and their points [mm]."""
    for level, row, column in PLACES:
        point = np.array([found.axis_mm[column], found.axis_mm[row], found.levels_mm[level]])
        yield (level, row, column), point


def moved_rails(gaps: tuple[float, ...], longer: tuple[float, ...]) -> Geometry:
    """Rails apart by half a gap each, other legs, as the causes define it."""
    xy, yz, zx = (value / 2.0 for value in gaps)
    points = np.array([[0.0, -zx, xy], [yz, 0.0, -xy], [-yz, zx, 0.0]])
    return Geometry(points, RAILS.directions, LENGTH + np.array(longer))


def test_the_whole_cube_counts_not_the_slices_alone() -> None:
    """Largest and mean over all 17³ points, by the closed forms of the paper."""
    found = workspace_error(NOMINAL, OFFSETS, COVARIANCE, 2.0)
    axis = found.maps.axis_mm
    assert len(axis) == SAMPLES
    assert (axis[0], axis[-1]) == found.cube_mm == NOMINAL.orthoglide.reachable_cube
    assert found.maps.levels_mm == pytest.approx([axis[0], (axis[0] + axis[-1]) / 2.0, axis[-1]])
    assert found.stated_edge_mm == PROTOTYPE.workspace_mm
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1)
    reached = direct(inverse(points, LENGTH), LENGTH, OFFSETS)
    errors = np.linalg.norm(reached - points, axis=-1)
    assert found.before_mm == pytest.approx(errors.max(), abs=1e-9)
    assert found.before_mean_mm == pytest.approx(errors.mean(), abs=1e-9)
    slices = found.maps.after_mm
    assert found.after_mm >= slices.max() > found.after_mean_mm > slices.min()


def test_after_is_what_the_uncertainty_leaves() -> None:
    """k √(tr J C Jᵀ), with J from finite differences, which err by 1e-8 of it."""
    found = workspace_error(NOMINAL, OFFSETS, COVARIANCE, 3.0).maps
    for place, point in at_places(found):
        joints, moves = inverse(point, LENGTH), 1e-3 * np.eye(3)
        slope = [
            (tool_near(RAILS, joints + move, point) - tool_near(RAILS, joints - move, point)) / 2e-3
            for move in moves
        ]
        spread = np.trace(np.transpose(slope) @ COVARIANCE @ slope)
        assert found.after_mm[place] == pytest.approx(3.0 * np.sqrt(spread), rel=1e-6)


def test_entering_offsets_leaves_the_errors_of_accepted_causes() -> None:
    """Rails apart, longer legs, wrong scales: before with the offsets, after without them."""
    model = extended(axis_gap=GAPS, encoder_scale=SCALES, leg_length=LONGER)
    found = workspace_error(model, OFFSETS, np.zeros((3, 3)), 2.0).maps
    rails = moved_rails(GAPS, LONGER)
    for place, point in at_places(found):
        travel = inverse(point, LENGTH) - LENGTH
        joints = LENGTH + (1.0 + 1e-3 * np.array(SCALES)) * travel
        for values, offsets in ((found.before_mm, OFFSETS), (found.after_mm, np.zeros(3))):
            reached = tool_near(rails, joints + offsets, point)
            assert values[place] == pytest.approx(np.linalg.norm(reached - point), abs=1e-9)


def test_carriages_that_stand_have_no_past() -> None:
    """Lost motion and drift are of a session: nothing of them in a place of the workspace."""
    moving = extended(backlash=(0.3, 0.2, 0.4), thermal_drift=(0.5, -0.3, 0.4))
    found, plain = (workspace_error(m, OFFSETS, COVARIANCE, 2.0).maps for m in (moving, NOMINAL))
    assert np.array_equal(found.before_mm, plain.before_mm)
    assert np.array_equal(found.after_mm, plain.after_mm)


def displacements(machine: Machine, low: float, high: float) -> Floats:
    """Of the carriages from their isotropic places, all over the cube [low, high]³."""
    axis = np.append(np.linspace(low, high, 21), 0.0)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    return inverse(points, machine.leg_length_mm) - machine.leg_length_mm


@both_machines
@pytest.mark.parametrize("limits", [None, (-40.0, 60.0), (-100.0, 12.0)])
def test_the_cube_stays_within_the_joint_limits(
    machine: Machine, limits: tuple[float, float] | None
) -> None:
    """And reaches them: each limit is met somewhere in it."""
    machine = machine.changed(
        joint_limits_mm=limits or machine.joint_limits_mm, workspace_mm=1000.0
    )
    moved = displacements(machine, *machine.reachable_cube)
    assert moved.min() == pytest.approx(machine.joint_limits_mm[0], abs=1e-6)
    assert moved.max() == pytest.approx(machine.joint_limits_mm[1], abs=1e-6)


def test_the_cube_is_no_larger_than_the_workspace_and_stays_where_it_was() -> None:
    whole = PROTOTYPE.changed(workspace_mm=1000.0).reachable_cube
    small = PROTOTYPE.changed(workspace_mm=50.0).reachable_cube
    assert small[1] - small[0] == pytest.approx(50.0)
    assert sum(small) == pytest.approx(sum(whole))
    wide = PROTOTYPE.changed(joint_limits_mm=(-300.0, 300.0), workspace_mm=1000.0)
    low, high = wide.reachable_cube
    assert (low, high) == (-LENGTH / 2.0, LENGTH / 2.0)
    assert np.isfinite(displacements(wide, low, high)).all()


def test_compensated_joints_put_the_tool_right() -> None:
    """Each row, on a machine built here from the causes' definitions: rails apart, other legs,
    other scales."""
    model = extended(axis_gap=GAPS, encoder_scale=SCALES, leg_length=LONGER, backlash=(0.1,) * 3)
    table = compensation(model, points=3)
    assert table.causes == ("axis_gap", "encoder_scale", "leg_length")
    assert table.left_out == ("backlash",)
    low, high = NOMINAL.orthoglide.reachable_cube
    axis = (low, (low + high) / 2.0, high)
    grid = [[x, y, z] for z in axis for y in axis for x in axis]
    assert table.points_mm == pytest.approx(np.array(grid), abs=1e-12)
    rails = moved_rails(GAPS, LONGER)
    for point, correction in zip(table.points_mm, table.corrections_mm, strict=True):
        indicated = inverse(point, LENGTH) + correction
        joints = LENGTH + (1.0 + 1e-3 * np.array(SCALES)) * (indicated - LENGTH)
        assert tool_near(rails, joints, point) == pytest.approx(point, abs=1e-7)
    assert np.abs(table.corrections_mm).max() > 0.05


def test_nothing_to_compensate_is_said() -> None:
    bent = on_rails(PROTOTYPE, bent_rails(PROTOTYPE))
    for model in (NOMINAL, extended(backlash=(0.1, 0.1, 0.1)), bent):
        with pytest.raises(UsageError, match="no accepted cause"):
            compensation(model, 7)
    gap = extended(axis_gap=(0.1, 0.1, 0.1))
    for points in (1, 52):
        with pytest.raises(UsageError, match=f"2 to 51 points along each edge, not {points}"):
            compensation(gap, points)
    assert len(compensation(gap, 2).points_mm) == 8
