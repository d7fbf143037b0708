"""What fixes the frame: moving or turning the whole machine is no cause of anything."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model import (
    Floats,
    GaugePlan,
    Machine,
    Model,
    double_posture,
    simulate,
    zero_free,
)
from orthoglide_cal.model.kinematics import Geometry
from tests.machines import PROTOTYPE, both_machines
from tests.model.geometries import bent_rails, on_rails

OFFSETS = np.array([0.8, -1.3, 0.5])
PAIRS = ((0, 1), (1, 2), (2, 0))


def seen(machine: Machine, offsets: Floats, plan: GaugePlan, rails: Geometry) -> Floats:
    """Predicted readings without their gauge zeros."""
    return zero_free(plan) @ simulate(on_rails(machine, rails), offsets, plan)


@both_machines
def test_moving_the_whole_machine_changes_no_reading(machine: Machine) -> None:
    plan, moved = double_posture(machine), np.array([1.7, -2.9, 0.6])
    nominal = machine.nominal_rails
    away = Geometry(nominal.points + moved, nominal.directions, nominal.lengths)
    before = seen(machine, OFFSETS, plan, nominal)
    assert seen(machine, OFFSETS, plan, away) == pytest.approx(before, abs=1e-10)
    # Along its own axis a rail that moves is an offset: the same machine, written otherwise.
    across = Geometry(moved * (1.0 - np.eye(3)), nominal.directions, nominal.lengths)
    assert seen(machine, OFFSETS + moved, plan, across) == pytest.approx(before, abs=1e-10)
    assert np.abs(seen(machine, OFFSETS, plan, across) - before).max() > 0.1


@both_machines
def test_gaps_and_offsets_say_all_that_rails_moved_across_can_do(machine: Machine) -> None:
    """Six shifts across are three gaps and three moves of the whole machine, exactly.

    g_k = s_ij − s_kj for the pair (i, k) that passes along j; the mean of the two is the move,
    and seen from the moved origin each offset is smaller by it.
    """
    plan, rng = double_posture(machine), np.random.default_rng(8)
    nominal = machine.nominal_rails
    for _ in range(5):
        shift = rng.uniform(-1.0, 1.0, (3, 3)) * (1.0 - np.eye(3))
        moved = Geometry(shift, nominal.directions, nominal.lengths)
        gaps, origin = np.zeros(3), np.zeros(3)
        for k, (first, second) in enumerate(PAIRS):
            along = 3 - first - second
            gaps[k] = shift[first, along] - shift[second, along]
            origin[along] = 0.5 * (shift[first, along] + shift[second, along])
        cause = CAUSES["axis_gap"]
        explained = simulate(Model(machine, (cause.at(gaps),)), OFFSETS - origin, plan)
        assert zero_free(plan) @ explained == pytest.approx(
            seen(machine, OFFSETS, plan, moved), abs=1e-10
        )


def turned(angles: Floats) -> Floats:
    """Rotation matrix about a small vector, to second order and orthonormal."""
    x, y, z = angles
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    left, _, right = np.linalg.svd(np.eye(3) + skew + 0.5 * skew @ skew)
    return left @ right


@both_machines
def test_turning_the_machine_is_seen_to_second_order_only(machine: Machine) -> None:
    """The gauges stay along the axes of the base, so a turned machine is not quite the same.

    An adjusted machine moves each leg along itself: a turn ω tilts the line that a gauge touches,
    which its zero takes up. What is left is ω times a deviation, here under 2e-3 · 1 mm, and
    ω²: halving both the turn and the offsets quarters it.
    """
    plan, angles = double_posture(machine), np.array([1.1e-3, -0.7e-3, 1.6e-3])
    nominal = machine.nominal_rails

    def change(scale: float) -> Floats:
        leaning = Geometry(
            nominal.points, nominal.directions @ turned(scale * angles).T, nominal.lengths
        )
        offsets = scale * OFFSETS
        return seen(machine, offsets, plan, leaning) - seen(machine, offsets, plan, nominal)

    whole, half = np.abs(change(1.0)).max(), np.abs(change(0.5)).max()
    assert 0.0 < whole < 2e-3
    assert half == pytest.approx(whole / 4.0, rel=0.05)


@both_machines
def test_squareness_and_turns_say_all_that_leaning_rails_can_do(machine: Machine) -> None:
    """Six leans are three angles between axes and three turns of the whole machine.

    To first order in the lean: the rest is lean × deviation, under 2e-3 · 1 mm, where the lean
    itself moves readings by ten times as much.
    """
    plan, rng = double_posture(machine), np.random.default_rng(9)
    nominal, cause = machine.nominal_rails, CAUSES["axis_squareness"]
    for _ in range(5):
        lean = rng.uniform(-1e-3, 1e-3, (3, 3)) * (1.0 - np.eye(3))
        ways = np.eye(3) + lean
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        leaning = Geometry(nominal.points, ways, nominal.lengths)
        angles = np.array([lean[i, j] + lean[j, i] for i, j in PAIRS])
        explained = zero_free(plan) @ simulate(Model(machine, (cause.at(angles),)), OFFSETS, plan)
        true = seen(machine, OFFSETS, plan, leaning)
        assert np.abs(true - explained).max() < 2e-3
        assert np.abs(true - seen(machine, OFFSETS, plan, nominal)).max() > 2e-2


def test_gaps_and_angles_add_to_rails_that_are_bent_already() -> None:
    """Each rail of a pair is shifted, or leans towards the other, by half."""
    rails = bent_rails(PROTOTYPE)
    xy, yz, zx = 0.5 * np.array([0.41, -0.27, 0.63])
    apart = CAUSES["axis_gap"].geometry(rails, 2.0 * np.array([xy, yz, zx]))
    shift = np.array([[0.0, -zx, xy], [yz, 0.0, -xy], [-yz, zx, 0.0]])
    assert apart.points == pytest.approx(rails.points + shift, abs=1e-12)
    assert np.array_equal(apart.directions, rails.directions)
    leaning = CAUSES["axis_squareness"].geometry(rails, 2e-3 * np.array([xy, yz, zx]))
    ways = rails.directions + 1e-3 * np.array([[0.0, xy, zx], [xy, 0.0, yz], [zx, yz, 0.0]])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert leaning.directions == pytest.approx(ways, abs=1e-12)
    assert np.array_equal(leaning.points, rails.points)
