"""The forward model against Table 2 computed independently, its derivatives and its laws."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import SingularError, UnreachableError
from orthoglide_cal.model import (
    Contact,
    Floats,
    GaugePlan,
    Machine,
    Model,
    Posture,
    double_posture,
    simulate,
    simulate_with_jacobian,
    single_posture,
)
from orthoglide_cal.model.model import STEP
from tests.machines import NOMINAL, PROTOTYPE, both_machines
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


# --- batches, and postures that cannot be taken -----------------------------------------------


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
