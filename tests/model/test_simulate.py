"""The forward model against Table 2 computed independently, its derivatives and its laws."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import SingularError, UnreachableError
from orthoglide_cal.model import (
    DIFFERENCES,
    Cause,
    Contact,
    DataKind,
    Effect,
    Floats,
    GaugePlan,
    Machine,
    Model,
    Numbers,
    Place,
    Posture,
    Stage,
    carried_uncertainty,
    differentiate,
    double_posture,
    ideal_plan,
    reduction,
    simulate,
    simulate_with_jacobian,
    single_posture,
)
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.model import STEP
from orthoglide_cal.model.plan import Plan
from orthoglide_cal.model.real import Command
from tests.machines import LARGE, NOMINAL, NOMINAL_LARGE, PROTOTYPE, both_machines
from tests.model import table2
from tests.model.geometries import bent_rails, mixed_plan, on_rails

OFFSETS = np.array([1.7, -2.9, 0.8])


def complex_jacobian(model: Model, offsets: Floats, plan: GaugePlan) -> Floats:
    """∂readings/∂Δρ by complex steps of `simulate`, (n, 3): exact, and knows no closed form."""
    return simulate(model, offsets + 1j * STEP * np.eye(3), plan).imag.T / STEP


def difference_jacobian(model: Model, offsets: Floats, plan: GaugePlan) -> Floats:
    """The same by central differences of 1e-3 mm, which err by less than 1e-8."""
    moves = 1e-3 * np.eye(3)
    ahead, behind = (simulate(model, offsets + sign * moves, plan) for sign in (1.0, -1.0))
    return (ahead - behind).T / 2e-3


# --- readings ---------------------------------------------------------------------------------


@both_machines
@pytest.mark.parametrize("gauge_at", [0.5, 0.3, 0.71, 0.0])
def test_readings_are_those_of_table_2(machine: Machine, gauge_at: float) -> None:
    plan = double_posture(machine, cycles=1, gauge_at=gauge_at)
    for offsets in np.random.default_rng(6).uniform(-5.0, 5.0, (10, 3)):
        expected = table2.gauge_readings(machine, offsets, plan)
        assert np.abs(simulate(Model(machine), offsets, plan) - expected).max() < 1e-10


@both_machines
def test_readings_on_bent_rails_wherever_the_gauges_touch(machine: Machine) -> None:
    """Rails that neither meet nor are square: joint end, tool end and all places between."""
    rails, plan = bent_rails(machine), mixed_plan(machine)
    expected = table2.gauge_readings(machine, OFFSETS, plan, rails)
    readings = simulate(on_rails(machine, rails), OFFSETS, plan)
    assert np.abs(readings - expected).max() < 1e-10
    assert {np.sum(plan.contact == contact) > 4 for contact in Contact} == {True}


@both_machines
def test_twelve_deviations_of_table_2(machine: Machine) -> None:
    """δy_x⁺ = μ p_y − p_y⁰/2 and so on (eq. 24)."""
    plan, wanted = ideal_plan(DataKind.TWELVE, machine), DIFFERENCES[DataKind.TWELVE]
    readings = simulate(Model(machine), OFFSETS, plan)
    modelled = reduction(DataKind.TWELVE, wanted, machine, plan) @ readings
    for ((leg, direction), posture), value in zip(wanted, modelled, strict=True):
        assert posture in (Posture.MAX, Posture.MIN)
        moved, still = (
            table2.gauge_reading(machine, OFFSETS, leg, direction, displacement)
            for displacement in (machine.displacement_mm(posture), 0.0)
        )
        assert value == pytest.approx(moved - still, abs=1e-10)


@both_machines
def test_single_posture_differences_are_the_height_of_the_tool(machine: Machine) -> None:
    """Tool end minus joint end along z is p_z, because the rails x and y lie at z = 0."""
    plan, wanted = single_posture(machine), DIFFERENCES[DataKind.SINGLE]
    readings = simulate(Model(machine), OFFSETS, plan)
    modelled = reduction(DataKind.SINGLE, wanted, machine, plan) @ readings
    for (series, posture), value in zip(wanted, modelled, strict=True):
        moved = table2.joints(machine, series.leg, machine.displacement_mm(posture))
        height = table2.tool(machine.leg_length_mm, moved + OFFSETS)[2]
        assert value == pytest.approx(height, abs=1e-10)


# --- derivatives by the offsets ---------------------------------------------------------------


def caused(machine: Machine) -> Model:
    """Gaps, leaning axes and longer legs together."""
    sizes = {"axis_gap": 0.4, "axis_squareness": 1.5, "leg_length": 0.2}
    return Model(machine).extended(
        CAUSES[id].at(size * CAUSES[id].scale * np.array([1.0, -0.7, 0.3]))
        for id, size in sizes.items()
    )


@both_machines
@pytest.mark.parametrize("made", [Model, lambda m: on_rails(m, bent_rails(m)), caused])
@pytest.mark.parametrize("gauges", [0.25, 0.5, "mixed", "ends"])
def test_the_closed_form_of_the_jacobian(
    machine: Machine, gauges: float | str, made: Callable[[Machine], Model]
) -> None:
    """On rails of every sort, with gauges anywhere."""
    plans = {"mixed": mixed_plan(machine), "ends": single_posture(machine, 2)}
    plan = plans.get(gauges) or double_posture(machine, cycles=2, gauge_at=gauges)
    model = made(machine)
    assert model.real.still
    readings, slope = simulate_with_jacobian(model, OFFSETS, plan)
    assert np.array_equal(readings, simulate(model, OFFSETS, plan))
    assert np.abs(slope - complex_jacobian(model, OFFSETS, plan)).max() < 1e-12
    assert np.abs(slope - difference_jacobian(model, OFFSETS, plan)).max() < 1e-8
    # What bends the rails is in it: readings change by more per millimetre than is resolved here.
    nominal = simulate_with_jacobian(Model(machine), OFFSETS, plan)[1]
    assert (np.abs(slope - nominal).max() > 1e-4) == (made is not Model)


class Moving(Cause):
    """Scales the joints, lets them creep, and shifts a gauge by where it touches the leg."""

    id, title, lasting = "moving", "everything moves", True

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def motion(self, joints: Numbers, theta: Numbers, command: Command) -> Numbers:
        """q → 1.002 q + t."""
        return joints * 1.002 + command.hours[:, None] if self.stage is Stage.MOTION else joints

    def contact(
        self, heights: Numbers, effect: Effect, fraction: Numbers, plan: Plan, machine: Machine
    ) -> Numbers:
        """A bar bent to a parabola."""
        return heights + 0.5 * fraction**2 if self.stage is Stage.CONTACT else heights

    def record(self, readings: Numbers, effect: Effect, plan: Plan, machine: Machine) -> Numbers:
        """A gauge that shows 3 % too much."""
        return readings * 1.03 if self.stage is Stage.RECORD else readings


@both_machines
@pytest.mark.parametrize("stage", [Stage.MOTION, Stage.CONTACT, Stage.RECORD])
def test_jacobian_with_causes_of_every_stage(machine: Machine, stage: Stage) -> None:
    """A cause that is not of the geometry leaves no closed form; each acts in the derivative."""
    rails, plan = bent_rails(machine), mixed_plan(machine)
    plain = on_rails(machine, rails)
    model = plain.extended([Moving(stage).at(np.zeros(0))])
    assert not model.real.still
    readings, slope = simulate_with_jacobian(model, OFFSETS, plan)
    assert np.array_equal(readings, simulate(model, OFFSETS, plan))
    assert np.abs(slope - difference_jacobian(model, OFFSETS, plan)).max() < 1e-8
    assert np.abs(slope - simulate_with_jacobian(plain, OFFSETS, plan)[1]).max() > 1e-5


# --- derivatives by the parameters of causes --------------------------------------------------


def some_effects() -> tuple[Effect, ...]:
    """One cause of each stage, one without parameters among them."""
    return (
        CAUSES["leg_length"].at(np.array([0.05, -0.03, 0.11])),
        CAUSES["sign_flip"].at(np.zeros(0), Place((2, 1))),
        CAUSES["thermal_drift"].at(np.array([0.13, -0.07, 0.19])),
        CAUSES["gauge_slip"].at(np.array([2.0]), Place((7, 1))),
        CAUSES["bar_skew"].at(1e-3 * np.array([1.1, -0.6, 0.4, 0.9, -1.3, 0.5])),
    )


def test_derivatives_by_offsets_and_causes_against_finite_differences() -> None:
    known = NOMINAL_LARGE.extended([CAUSES["axis_gap"].at(np.array([0.3, -0.2, 0.25]))])
    effects, plan = some_effects(), mixed_plan(LARGE)
    sizes = [effect.theta.size for effect in effects]
    readings, slope = differentiate(known, OFFSETS, plan, effects)
    assert readings == pytest.approx(simulate(known.extended(effects), OFFSETS, plan), abs=1e-12)
    assert slope.shape == (len(plan), 3 + sum(sizes))

    def at(values: Floats) -> Floats:
        offsets, *thetas = np.split(values, np.cumsum([3, *sizes])[:-1])
        moved = [replace(e, theta=theta) for e, theta in zip(effects, thetas, strict=True)]
        return simulate(known.extended(moved), offsets, plan)

    point = np.concatenate([OFFSETS, *(effect.theta for effect in effects)])
    # Millimetres and millimetres per hour, one slip, then radians.
    steps = np.array([1e-3] * 10 + [1e-5] * 6)
    for k, step in enumerate(steps):
        move = step * np.eye(point.size)[k]
        difference = (at(point + move) - at(point - move)) / (2.0 * step)
        assert np.abs(difference).max() > 1e-2
        assert slope[:, k] == pytest.approx(difference, abs=2e-8 * np.abs(difference).max() + 1e-9)


def test_what_the_uncertainty_of_accepted_causes_adds_to_readings() -> None:
    """To first order J C Jᵀ, with correlated parameters; a cause known exactly adds nothing."""
    gap, lean = CAUSES["axis_gap"], CAUSES["axis_squareness"]
    some, other = np.random.default_rng(5).normal(0.0, 1.0, (2, 3, 3))
    sizes = 1e-3 * some @ some.T, 1e-9 * other @ other.T
    accepted = (
        Effect(gap, np.array([0.3, -0.2, 0.25]), covariance=sizes[0]),
        CAUSES["leg_length"].at(np.array([0.05, -0.03, 0.11])),
        Effect(lean, np.array([1e-3, -2e-3, 5e-4]), covariance=sizes[1]),
    )
    model, plan = NOMINAL.extended(accepted), mixed_plan(PROTOTYPE)
    carried = np.hstack(carried_uncertainty(model, OFFSETS, plan))
    assert carried.shape == (len(plan), 6)
    slope = differentiate(NOMINAL, OFFSETS, plan, accepted)[1]
    expected = slope[:, 3:6] @ sizes[0] @ slope[:, 3:6].T + slope[:, 9:] @ sizes[1] @ slope[:, 9:].T
    assert carried @ carried.T == pytest.approx(expected, abs=2e-3 * expected.max())
    assert carried_uncertainty(NOMINAL, OFFSETS, plan) == ()


# --- batches, and postures that cannot be taken -----------------------------------------------


def test_offsets_and_machines_are_batched_together() -> None:
    rng = np.random.default_rng(2)
    plan = mixed_plan(PROTOTYPE)
    offsets = rng.normal(0.0, 1.0, (4, 5, 3))
    directions = np.eye(3) + rng.normal(0.0, 0.01, (5, 3, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    lengths = PROTOTYPE.leg_length_mm + rng.normal(0.0, 0.1, (5, 3))
    rails = Geometry(rng.normal(0.0, 0.3, (5, 3, 3)), directions, lengths)
    model = on_rails(PROTOTYPE, rails)
    together, slope = simulate_with_jacobian(model, offsets, plan)
    assert together.shape == (4, 5, len(plan))
    assert slope.shape == (4, 5, len(plan), 3)
    assert np.array_equal(together, simulate(model, offsets, plan))
    for i, j in ((0, 0), (2, 3), (3, 4)):
        one = on_rails(PROTOTYPE, Geometry(rails.points[j], rails.directions[j], rails.lengths[j]))
        readings, by_offsets = simulate_with_jacobian(one, offsets[i, j], plan)
        assert np.abs(together[i, j] - readings).max() < 1e-12
        assert np.abs(slope[i, j] - by_offsets).max() < 1e-12


def test_an_unreachable_session_is_an_error_or_nan() -> None:
    plan = double_posture(PROTOTYPE, cycles=1)
    offsets = np.array([[0.1, 0.2, 0.3], [300.0, 300.0, 300.0]])
    with pytest.raises(UnreachableError, match="Leg x displaced by 0 mm: The legs do not reach"):
        simulate(NOMINAL, offsets, plan)
    with pytest.raises(UnreachableError, match="Leg y displaced by 60 mm: The legs do not reach"):
        simulate(NOMINAL, np.array([30.0, 85.0, 30.0]), plan)
    creeping = NOMINAL.extended([CAUSES["thermal_drift"].at(np.array([0.1, -0.2, 0.1]))])
    for model in (NOMINAL, creeping):
        readings, slope = simulate_with_jacobian(model, offsets, plan, strict=False)
        assert np.isfinite(readings[0]).all()
        assert np.isfinite(slope[0]).all()
        assert np.isnan(readings[1]).any()
        with pytest.raises(UnreachableError, match="Leg x displaced by 0 mm"):
            simulate_with_jacobian(model, offsets, plan)


def test_postures_without_a_tool_position_are_named() -> None:
    """Rails along one line; legs too short for the posture at which the gauges are set up."""
    low = double_posture(PROTOTYPE, cycles=1, closing=False, postures=(Posture.MIN,))
    nominal = NOMINAL.real.geometry
    line = replace(nominal, directions=np.array([[1.0, 0.0, 0.0]] * 3))
    with pytest.raises(SingularError, match=r"Leg x displaced by -100 mm: .* on a line"):
        simulate(on_rails(PROTOTYPE, line), OFFSETS, low)
    short = replace(nominal, lengths=np.full(3, 250.0))
    with pytest.raises(UnreachableError, match="Isotropic posture: The legs do not reach"):
        simulate(on_rails(PROTOTYPE, short), OFFSETS, low)


def test_a_displacement_as_long_as_the_leg_names_leg_and_size() -> None:
    plan = GaugePlan(
        leg=[1], direction=[2], displacement=[-311.0], contact=[Contact.FIXED], gauge_at=[0.5],
        setup=[0], order=[0], hours=[0.0],
    )  # fmt: skip
    with pytest.raises(UnreachableError, match="Leg y cannot be displaced by -311 mm"):
        simulate(NOMINAL, OFFSETS, plan)
