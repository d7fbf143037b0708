"""Eqs. (5) to (9), against finite differences and against each other."""

import math

import numpy as np
import pytest

from orthoglide_cal.errors import SingularError
from orthoglide_cal.kinematics import (
    direct,
    displaced_jacobian,
    inverse,
    inverse_jacobian,
    isotropic_jacobian,
    jacobian,
    leg_angle,
)
from orthoglide_cal.machine import Machine
from tests.kinematics.workspace import tool_positions
from tests.machines import PROTOTYPE, both_machines

L = PROTOTYPE.leg_length_mm
STEP = 1e-3  # mm: truncation about STEP²/L² ~ 1e-11, rounding about 1e-13 L/STEP ~ 1e-8


@both_machines
def test_inverse_jacobian_is_the_derivative_of_inverse_kinematics(machine: Machine) -> None:
    length, tool = machine.leg_length_mm, tool_positions(machine, 50)
    computed = inverse_jacobian(tool, inverse(tool, length))
    for k in range(3):
        move = STEP * np.eye(3)[k]
        difference = (inverse(tool + move, length) - inverse(tool - move, length)) / (2.0 * STEP)
        assert np.abs(computed[..., k] - difference).max() < 1e-8


@both_machines
def test_jacobian_is_the_derivative_of_direct_kinematics(machine: Machine) -> None:
    length = machine.leg_length_mm
    joints = inverse(tool_positions(machine, 50), length)
    computed = jacobian(direct(joints, length), joints)
    for k in range(3):
        move = STEP * np.eye(3)[k]
        difference = (direct(joints + move, length) - direct(joints - move, length)) / (2.0 * STEP)
        assert np.abs(computed[..., k] - difference).max() < 1e-7


def test_jacobian_at_the_isotropic_posture_is_the_identity() -> None:
    assert np.array_equal(isotropic_jacobian(), np.eye(3))
    assert jacobian(np.zeros(3), np.full(3, L)) == pytest.approx(np.eye(3), abs=1e-15)


@both_machines
@pytest.mark.parametrize("leg", [0, 1, 2])
@pytest.mark.parametrize("posture", ["max", "min"])
def test_displaced_form_agrees_with_the_general_one(
    machine: Machine, leg: int, posture: str
) -> None:
    """Eq. (8): identity with T_α in the column of the displaced leg."""
    length, moved = machine.leg_length_mm, machine.displacement_mm(posture)
    tool = moved * np.eye(3)[leg]
    general = jacobian(tool, inverse(tool, length))
    assert displaced_jacobian(leg, moved, length) == pytest.approx(general, abs=1e-12)


@pytest.mark.parametrize(("posture", "printed"), [("max", 0.197), ("min", -0.3405)])
def test_tangents_of_the_prototype(posture: str, printed: float) -> None:
    """Errata, Table 1: −0.3405 at the min posture, +0.197 at the max posture."""
    angle = leg_angle(PROTOTYPE.displacement_mm(posture), L)
    assert math.tan(angle) == pytest.approx(printed, abs=5e-4)
    assert math.sin(angle) * L == pytest.approx(PROTOTYPE.displacement_mm(posture), abs=1e-10)


def test_small_offsets_move_the_tool_as_eq_9_says() -> None:
    """Δp_x = Δρ_x, Δp_y = T Δρ_x + Δρ_y, Δp_z = T Δρ_x + Δρ_z at the x-maximum posture."""
    offsets = 1e-4 * np.array([1.0, -2.0, 3.0])
    tool = np.array([60.0, 0.0, 0.0])
    moved = direct(inverse(tool, L), L, offsets) - tool
    tangent = 60.0 / math.sqrt(L**2 - 60.0**2)
    expected = (offsets[0], tangent * offsets[0] + offsets[1], tangent * offsets[0] + offsets[2])
    assert moved == pytest.approx(expected, abs=1e-9)


def test_a_leg_square_to_its_rail_is_named() -> None:
    with pytest.raises(SingularError, match="Leg y stands square to its rail"):
        inverse_jacobian(np.array([10.0, 5.0, 20.0]), np.array([300.0, 5.0, 310.0]))


def test_legs_in_one_plane_are_singular() -> None:
    """All three legs perpendicular to (1, 1, 1): p = (s, s, s), q = 3 s on each rail."""
    with pytest.raises(
        SingularError, match=r"three legs lie in one plane with the tool at \(50\.000, "
    ):
        jacobian(np.full(3, 50.0), np.full(3, 150.0))


@pytest.mark.parametrize("displacement", [L, -L, 400.0])
def test_a_displacement_as_long_as_the_leg_has_no_angle(displacement: float) -> None:
    with pytest.raises(SingularError, match="not shorter than the leg"):
        leg_angle(displacement, L)
