"""The forward model against Table 2 computed independently, and its laws."""

import numpy as np
import pytest

from orthoglide_cal.axes import AXES
from orthoglide_cal.effects import Commanded, Effect
from orthoglide_cal.errors import UnreachableError
from orthoglide_cal.kinematics import Geometry
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols import (
    NAMES,
    double_posture,
    ideal_plan,
    reduction,
    single_posture,
)
from orthoglide_cal.simulation import simulate, simulate_with_jacobian
from tests.machines import LARGE, PROTOTYPE, both_machines
from tests.simulation import table2

OFFSETS = np.array([1.7, -2.9, 0.8])
SHIFT = np.array([[0.0, 1.0, -2.0], [0.5, 0.0, 0.7], [-1.1, 0.4, 0.0]])


@both_machines
@pytest.mark.parametrize("gauge_at", [0.5, 0.3, 0.71])
def test_readings_are_those_of_table_2(machine: Machine, gauge_at: float) -> None:
    plan = double_posture(machine, cycles=1, gauge_at=gauge_at)
    rng = np.random.default_rng(6)
    for offsets in rng.uniform(-5.0, 5.0, (10, 3)):
        expected = [
            table2.gauge_reading(machine, offsets, leg, direction, displacement, gauge_at)
            for leg, direction, displacement in zip(
                plan.leg.tolist(), plan.direction.tolist(), plan.displacement.tolist(), strict=True
            )
        ]
        assert np.abs(simulate(machine, offsets, plan) - expected).max() < 1e-10


@both_machines
def test_twelve_deviations_of_table_2(machine: Machine) -> None:
    """δy_x⁺ = μ p_y − p_y⁰/2 and so on (eq. 24)."""
    plan = ideal_plan("twelve", machine)
    modelled = reduction("twelve", NAMES["twelve"], machine, plan) @ simulate(
        machine, OFFSETS, plan
    )
    for name, value in zip(NAMES["twelve"], modelled, strict=True):
        direction, leg = AXES.index(name[0]), AXES.index(name[2])
        displacement = machine.displacement_mm({"+": "max", "-": "min"}[name[3]])
        expected = table2.gauge_reading(
            machine, OFFSETS, leg, direction, displacement
        ) - table2.gauge_reading(machine, OFFSETS, leg, direction, 0.0)
        assert value == pytest.approx(expected, abs=1e-10)


@both_machines
def test_single_posture_differences_are_the_height_of_the_tool(machine: Machine) -> None:
    """Tool end minus joint end along z is p_z, because the rails x and y lie at z = 0."""
    plan = single_posture(machine)
    kind = "single"
    modelled = reduction(kind, NAMES[kind], machine, plan) @ simulate(machine, OFFSETS, plan)
    for name, value in zip(NAMES[kind], modelled, strict=True):
        leg = AXES.index(name[2])
        moved = machine.displacement_mm({"0": "iso", "+": "max", "-": "min"}[name[3]])
        p = table2.tool(machine.leg_length_mm, table2.joints(machine, leg, moved) + OFFSETS)
        assert value == pytest.approx(p[2], abs=1e-10)


@both_machines
def test_without_offsets_every_gauge_reads_zero(machine: Machine) -> None:
    for plan in (double_posture(machine), single_posture(machine)):
        assert np.abs(simulate(machine, np.zeros(3), plan)).max() < 1e-10


def test_a_gauge_at_the_carriage_reads_nothing_at_the_isotropic_posture() -> None:
    plan = double_posture(PROTOTYPE, cycles=1, gauge_at=0.0)
    readings = simulate(PROTOTYPE, OFFSETS, plan)
    isotropic = plan.displacement == 0.0
    assert np.abs(readings[isotropic]).max() < 1e-12
    assert np.abs(readings[~isotropic]).min() > 0.01


@both_machines
@pytest.mark.parametrize("protocol", [double_posture, single_posture])
def test_jacobian_against_finite_differences(machine: Machine, protocol: type) -> None:
    plan = protocol(machine)
    readings, slope = simulate_with_jacobian(machine, OFFSETS, plan)
    assert readings == pytest.approx(simulate(machine, OFFSETS, plan), abs=1e-13)
    step = 1e-3
    for k in range(3):
        move = step * np.eye(3)[k]
        difference = (
            simulate(machine, OFFSETS + move, plan) - simulate(machine, OFFSETS - move, plan)
        ) / (2.0 * step)
        assert np.abs(slope[:, k] - difference).max() < 1e-8


class _Bend(Effect):
    """A little of everything, to see that effects reach the derivative."""

    def geometry(self, geometry: Geometry) -> Geometry:
        directions = geometry.directions + 0.01 * np.arange(9.0).reshape(3, 3)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return Geometry(geometry.points + SHIFT, directions, geometry.lengths + 0.3)

    def motion(self, joints: np.ndarray, commanded: Commanded) -> np.ndarray:
        return joints * 1.002 + commanded.plan.hours[:, None]

    def contact(
        self, heights: np.ndarray, fraction: np.ndarray, commanded: Commanded
    ) -> np.ndarray:
        return heights + 0.05 * fraction


def test_jacobian_under_effects_against_finite_differences() -> None:
    plan, effects = double_posture(LARGE, cycles=1), (_Bend(),)
    slope = simulate_with_jacobian(LARGE, OFFSETS, plan, effects)[1]
    step = 1e-3
    for k in range(3):
        move = step * np.eye(3)[k]
        ahead, behind = (
            simulate(LARGE, OFFSETS + sign * move, plan, effects) for sign in (1.0, -1.0)
        )
        assert np.abs(slope[:, k] - (ahead - behind) / (2.0 * step)).max() < 1e-8


def test_jacobian_of_a_bent_geometry_is_closed_form_and_complex_step_alike() -> None:
    plan = double_posture(PROTOTYPE, cycles=1)
    bent = _Bend().geometry(Geometry.nominal(PROTOTYPE))

    class SameGeometry(Effect):
        def geometry(self, geometry: Geometry) -> Geometry:
            return bent

    closed = simulate_with_jacobian(PROTOTYPE, OFFSETS, plan, geometry=bent)
    stepped = simulate_with_jacobian(PROTOTYPE, OFFSETS, plan, (SameGeometry(),))
    assert np.abs(closed[0] - stepped[0]).max() < 1e-12
    assert np.abs(closed[1] - stepped[1]).max() < 1e-12


def test_offsets_and_machines_are_batched_together() -> None:
    rng = np.random.default_rng(2)
    plan = double_posture(PROTOTYPE, cycles=1)
    offsets = rng.normal(0.0, 1.0, (4, 5, 3))
    geometry = Geometry(
        rng.normal(0.0, 0.3, (5, 3, 3)), np.eye(3), 310.25 + rng.normal(0.0, 0.1, (5, 3))
    )
    together = simulate(PROTOTYPE, offsets, plan, geometry=geometry)
    assert together.shape == (4, 5, len(plan))
    for i, j in ((0, 0), (2, 3), (3, 4)):
        alone = simulate(
            PROTOTYPE,
            offsets[i, j],
            plan,
            geometry=Geometry(geometry.points[j], geometry.directions, geometry.lengths[j]),
        )
        assert np.abs(together[i, j] - alone).max() < 1e-12


def test_an_unreachable_session_is_an_error_or_nan() -> None:
    plan = double_posture(PROTOTYPE, cycles=1)
    offsets = np.array([[0.1, 0.2, 0.3], [300.0, 300.0, 300.0]])
    with pytest.raises(UnreachableError, match="Leg x displaced by 0 mm: The legs do not reach"):
        simulate(PROTOTYPE, offsets, plan)
    with pytest.raises(UnreachableError, match="Leg y displaced by 60 mm: The legs do not reach"):
        simulate(PROTOTYPE, np.array([30.0, 85.0, 30.0]), plan)
    readings, slope = simulate_with_jacobian(PROTOTYPE, offsets, plan, strict=False)
    assert np.isfinite(readings[0]).all()
    assert np.isfinite(slope[0]).all()
    assert np.isnan(readings[1]).any()


def test_a_displacement_as_long_as_the_leg_names_leg_and_size() -> None:
    plan = Plan(
        leg=[1], direction=[2], displacement=[-311.0], contact=[Contact.FIXED], gauge_at=[0.5],
        setup=[0], order=[0], hours=[0.0],
    )  # fmt: skip
    with pytest.raises(UnreachableError, match="Leg y cannot be displaced by -311 mm"):
        simulate(PROTOTYPE, OFFSETS, plan)
