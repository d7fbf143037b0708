"""Eqs. (1), (3), (4): the sphere equations decide, at asymmetric points."""

import numpy as np
import pytest

from orthoglide_cal.axes import Floats
from orthoglide_cal.errors import SingularError, UnreachableError
from orthoglide_cal.kinematics import WORKING_MODES, direct, inverse
from orthoglide_cal.machine import Machine
from tests.kinematics.workspace import tool_positions
from tests.machines import PROTOTYPE, both_machines

OFFSETS = np.array([0.7, -1.3, 2.1])
POINT = np.array([31.0, -47.0, 12.0])
L = PROTOTYPE.leg_length_mm


def sphere_errors(tool: Floats, joints: Floats, offsets: Floats, length: float) -> Floats:
    """|p − b_i| − L for the three legs (eq. 1), shape (..., 3) [mm]."""
    carriages = np.eye(3) * (joints + offsets)[..., None]
    return np.linalg.norm(tool[..., None, :] - carriages, axis=-1) - length


@both_machines
@pytest.mark.parametrize("mode", WORKING_MODES)
def test_every_working_mode_satisfies_the_sphere_equations(
    machine: Machine, mode: tuple[int, int, int]
) -> None:
    tool = tool_positions(machine)
    joints = inverse(tool, machine.leg_length_mm, OFFSETS, mode)
    assert np.abs(sphere_errors(tool, joints, OFFSETS, machine.leg_length_mm)).max() < 1e-10
    assert np.array_equal(np.sign(joints + OFFSETS - tool), np.broadcast_to(mode, tool.shape))


def test_there_are_eight_different_working_modes() -> None:
    joints = np.stack([inverse(POINT, L, OFFSETS, mode) for mode in WORKING_MODES])
    assert len(WORKING_MODES) == 8
    gaps = np.abs(joints[:, None] - joints).max(axis=-1) + np.eye(8) * 1e9
    assert gaps.min() > 100.0


@both_machines
@pytest.mark.parametrize("assembly", [-1, 1])
def test_both_assembly_modes_satisfy_the_sphere_equations(machine: Machine, assembly: int) -> None:
    joints = inverse(tool_positions(machine), machine.leg_length_mm, OFFSETS)
    tool = direct(joints, machine.leg_length_mm, OFFSETS, assembly)
    assert np.abs(sphere_errors(tool, joints, OFFSETS, machine.leg_length_mm)).max() < 1e-9


@both_machines
def test_direct_undoes_inverse(machine: Machine) -> None:
    tool = tool_positions(machine)
    joints = inverse(tool, machine.leg_length_mm, OFFSETS)
    assert np.abs(direct(joints, machine.leg_length_mm, OFFSETS) - tool).max() < 1e-9


@both_machines
def test_inverse_undoes_direct(machine: Machine) -> None:
    joints = inverse(tool_positions(machine), machine.leg_length_mm) + 0.37
    tool = direct(joints, machine.leg_length_mm, OFFSETS)
    assert np.abs(inverse(tool, machine.leg_length_mm, OFFSETS) - joints).max() < 1e-9


def test_assembly_modes_at_the_isotropic_posture() -> None:
    """Errata, sec. 2.4: m = −1 gives p = 0, m = +1 gives (2/3) L (1, 1, 1)."""
    joints = np.full(3, L)
    assert np.abs(direct(joints, L)).max() < 1e-12
    assert direct(joints, L, assembly=1) == pytest.approx(np.full(3, 2.0 * L / 3.0), abs=1e-10)


def test_offsets_shift_the_indicated_joints() -> None:
    """True = indicated + Δρ."""
    assert inverse(POINT, L, OFFSETS) == pytest.approx(inverse(POINT, L) - OFFSETS, abs=1e-12)
    joints = np.array([330.0, 290.0, 301.0])
    assert direct(joints, L, OFFSETS) == pytest.approx(direct(joints + OFFSETS, L), abs=1e-12)


def test_batches_have_the_shape_of_their_input() -> None:
    tool = tool_positions(PROTOTYPE, 24).reshape(2, 3, 4, 3)
    joints = inverse(tool, L)
    assert joints.shape == direct(joints, L).shape == (2, 3, 4, 3)
    assert joints[1, 2, 3] == pytest.approx(inverse(tool[1, 2, 3], L), abs=0.0)


@pytest.mark.parametrize(
    ("point", "rail"),
    [((10.0, 250.0, -200.0), "x"), ((250.0, 10.0, -200.0), "y"), ((-200.0, 250.0, 10.0), "z")],
)
def test_a_point_out_of_reach_names_the_rail(point: tuple[float, float, float], rail: str) -> None:
    batch = np.array([POINT, point])
    with pytest.raises(UnreachableError, match=f"farther from rail {rail}") as caught:
        inverse(batch, L)
    assert f"{point[1]:.3f}" in str(caught.value)
    assert "workspace" in caught.value.remedy


def test_joints_too_far_apart_name_themselves() -> None:
    with pytest.raises(UnreachableError, match=r"do not meet .* \(560\.000, 520\.000, 10\.000\)"):
        direct(np.array([[310.0, 300.0, 305.0], [560.0, 520.0, 10.0]]), L)


def test_a_carriage_at_the_origin_is_singular() -> None:
    with pytest.raises(SingularError, match="meeting point of the rails"):
        direct(np.array([L, 0.0, L]), L)
