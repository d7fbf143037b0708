"""Three rails in any position: as eqs. (3), (4) where they hold, as spheres elsewhere."""

import numpy as np
import pytest

from orthoglide_cal.errors import SingularError, UnreachableError
from orthoglide_cal.kinematics import (
    WORKING_MODES,
    Geometry,
    direct,
    inverse,
    inverse_jacobian,
    rail_position,
    tool_derivative,
    trilaterate,
)
from orthoglide_cal.machine import Machine
from tests.kinematics.workspace import bent_geometry, tool_positions
from tests.machines import PROTOTYPE, both_machines

L = PROTOTYPE.leg_length_mm


@both_machines
@pytest.mark.parametrize("assembly", [-1, 1])
def test_general_form_agrees_with_eq_4_over_the_workspace(machine: Machine, assembly: int) -> None:
    length, geometry = machine.leg_length_mm, Geometry.nominal(machine)
    joints = inverse(tool_positions(machine, 2000), length)
    general = trilaterate(geometry.carriages(joints), geometry.lengths, assembly)
    assert np.abs(general - direct(joints, length, assembly=assembly)).max() < 1e-9


@both_machines
@pytest.mark.parametrize("mode", WORKING_MODES)
def test_general_inverse_agrees_with_eq_3(machine: Machine, mode: tuple[int, int, int]) -> None:
    tool = tool_positions(machine)
    general = rail_position(Geometry.nominal(machine), tool, mode)
    assert np.abs(general - inverse(tool, machine.leg_length_mm, mode=mode)).max() < 1e-10


@both_machines
def test_bent_rails_keep_the_legs_as_long_as_they_are(machine: Machine) -> None:
    geometry, tool = bent_geometry(machine), tool_positions(machine)
    for mode in WORKING_MODES:
        carriages = geometry.carriages(rail_position(geometry, tool, mode))
        lengths = np.linalg.norm(tool[:, None, :] - carriages, axis=-1)
        assert np.abs(lengths - geometry.lengths).max() < 1e-10


@both_machines
def test_bent_rails_direct_undoes_inverse(machine: Machine) -> None:
    geometry, tool = bent_geometry(machine), tool_positions(machine)
    carriages = geometry.carriages(rail_position(geometry, tool))
    assert np.abs(trilaterate(carriages, geometry.lengths) - tool).max() < 1e-9


def test_mirror_assembly_lies_on_the_other_side_of_the_carriages() -> None:
    geometry = bent_geometry(PROTOTYPE)
    joints = rail_position(geometry, np.array([20.0, -30.0, 10.0]))
    carriages = geometry.carriages(joints)
    both = [trilaterate(carriages, geometry.lengths, m) for m in (-1, 1)]
    normal = np.cross(carriages[1] - carriages[0], carriages[2] - carriages[0])
    heights = [float((p - carriages[0]) @ normal) for p in both]
    assert heights[0] == pytest.approx(-heights[1], rel=1e-12)
    for p in both:
        lengths = np.linalg.norm(p - carriages, axis=-1)
        assert lengths == pytest.approx(geometry.lengths, abs=1e-10)


@both_machines
def test_derivative_of_bent_rails_against_finite_differences(machine: Machine) -> None:
    geometry, tool = bent_geometry(machine), tool_positions(machine, 50)
    joints = rail_position(geometry, tool)
    computed = tool_derivative(geometry, joints, tool)
    step = 1e-3
    for k in range(3):
        ahead, behind = (
            trilaterate(geometry.carriages(joints + sign * step * np.eye(3)[k]), geometry.lengths)
            for sign in (1.0, -1.0)
        )
        assert np.abs(computed[..., k] - (ahead - behind) / (2.0 * step)).max() < 1e-7


def test_derivative_inverts_eq_5_on_nominal_rails() -> None:
    tool = tool_positions(PROTOTYPE, 50)
    joints = inverse(tool, L)
    product = inverse_jacobian(tool, joints) @ tool_derivative(
        Geometry.nominal(PROTOTYPE), joints, tool
    )
    assert np.abs(product - np.eye(3)).max() < 1e-12


def test_many_machines_in_one_call() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(0.0, 1.0, (5, 3, 3))
    lengths = L + rng.normal(0.0, 1.0, (5, 3))
    geometry = Geometry(points, np.eye(3), lengths)
    tool = tool_positions(PROTOTYPE, 5)
    joints = rail_position(geometry, tool)
    assert np.abs(trilaterate(geometry.carriages(joints), lengths) - tool).max() < 1e-9


def test_legs_that_do_not_reach_say_by_how_much() -> None:
    centres = np.diag([600.0, 600.0, 600.0])
    with pytest.raises(UnreachableError, match=r"do not reach each other .* miss by") as caught:
        trilaterate(centres, np.full(3, L))
    assert "limits" in caught.value.remedy


def test_a_batch_that_may_fail_marks_what_fails() -> None:
    centres = np.stack((np.diag([L, L, L]), np.diag([600.0, 600.0, 600.0])))
    point = trilaterate(centres, np.full(3, L), strict=False)
    assert point[0] == pytest.approx(np.zeros(3), abs=1e-10)
    assert np.isnan(point[1]).all()


def test_carriages_on_a_line_are_singular() -> None:
    centres = np.array([[0.0, 0.0, 0.0], [10.0, 20.0, 5.0], [30.0, 60.0, 15.0]])
    with pytest.raises(SingularError, match="lie on a line"):
        trilaterate(centres, np.full(3, L))


def test_a_leg_too_short_is_named() -> None:
    geometry = bent_geometry(PROTOTYPE)
    with pytest.raises(
        UnreachableError, match=r"Leg y is too short to reach the point \(250.000, 0.000, 250.000\)"
    ):
        rail_position(geometry, np.array([250.0, 0.0, 250.0]))


def test_general_machine_with_its_legs_in_one_plane_is_singular() -> None:
    with pytest.raises(SingularError, match="three legs lie in one plane"):
        tool_derivative(Geometry.nominal(PROTOTYPE), np.full(3, 150.0), np.full(3, 50.0))
