"""The forward model: its derivatives, what it cannot reach, and what a gauge makes of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import PostureError
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import (
    STEP,
    Model,
    simulate,
    simulate_with_jacobian,
)
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import zero_free
from orthoglide_cal.model.readings import GaugePlan, Posture
from tests.machines import NOMINAL, PROTOTYPE, both_machines
from tests.model.geometries import bent_rails, mixed_plan, on_rails

OFFSETS = np.array([1.7, -2.9, 0.8])


def stepped_within(plan: GaugePlan) -> GaugePlan:
    """The closing readings of each leg are taken after a step was entered, stands untouched."""
    closing = np.array([np.flatnonzero(plan.setup == k)[-1] for k in range(plan.setups)])
    entered = np.zeros((len(plan), 3))
    entered[closing] = 0.5, 0.0, -0.2
    return replace(plan, entered=entered)


@both_machines
@pytest.mark.parametrize("made", [Model, lambda m: on_rails(m, bent_rails(m))])
@pytest.mark.parametrize("gauges", [0.25, 0.5, "mixed", "ends", "stepped"])
def test_the_closed_form_of_the_jacobian(
    machine: Machine, gauges: float | str, made: Callable[[Machine], Model]
) -> None:
    """On rails of every sort, with gauges anywhere."""
    plans = {
        "mixed": mixed_plan(machine),
        "ends": single_posture(machine, 2),
        "stepped": stepped_within(double_posture(machine, 1)),
    }
    plan = plans.get(gauges) or double_posture(machine, cycles=2, gauge_at=gauges)
    model = made(machine)
    assert model.real.still
    readings, slope = simulate_with_jacobian(model, OFFSETS, plan)
    assert np.array_equal(readings, simulate(model, OFFSETS, plan))
    # By complex steps: exact, and they know no closed form.
    exact = simulate(model, OFFSETS + 1j * STEP * np.eye(3), plan).imag.T / STEP
    assert np.abs(slope - exact).max() < 1e-12
    # What bends the rails is in it: readings change by more per millimetre than is resolved here.
    nominal = simulate_with_jacobian(Model(machine), OFFSETS, plan)[1]
    assert (np.abs(slope - nominal).max() > 1e-4) == (made is not Model)


def test_an_unreachable_session_is_an_error_or_nan() -> None:
    plan = double_posture(PROTOTYPE, cycles=1)
    offsets = np.array([[0.1, 0.2, 0.3], [300.0, 300.0, 300.0]])
    with pytest.raises(PostureError, match="Leg x displaced by 0 mm: The legs do not reach"):
        simulate(NOMINAL, offsets, plan)
    with pytest.raises(PostureError, match="Leg y displaced by 60 mm: The legs do not reach"):
        simulate(NOMINAL, np.array([30.0, 85.0, 30.0]), plan)
    creeping = NOMINAL.extended([CAUSES["thermal_drift"].at(np.array([0.1, -0.2, 0.1]))])
    for model in (NOMINAL, creeping):
        readings, slope = simulate_with_jacobian(model, offsets, plan, strict=False)
        assert np.isfinite(readings[0]).all()
        assert np.isfinite(slope[0]).all()
        assert np.isnan(readings[1]).any()
        with pytest.raises(PostureError, match="Leg x displaced by 0 mm"):
            simulate_with_jacobian(model, offsets, plan)


def test_postures_without_a_tool_position_are_named() -> None:
    """Rails along one line; legs too short for the posture at which the gauges are set up."""
    low = double_posture(PROTOTYPE, cycles=1, closing=False, postures=(Posture.MIN,))
    nominal = NOMINAL.real.geometry
    line = replace(nominal, directions=np.array([[1.0, 0.0, 0.0]] * 3))
    with pytest.raises(PostureError, match=r"Leg x displaced by -100 mm: .* on a line"):
        simulate(on_rails(PROTOTYPE, line), OFFSETS, low)
    short = replace(nominal, lengths=np.full(3, 250.0))
    with pytest.raises(PostureError, match="Isotropic posture: The legs do not reach"):
        simulate(on_rails(PROTOTYPE, short), OFFSETS, low)


def test_written_down_readings_have_the_gauges_noise_zeros_and_steps() -> None:
    """Chance of failure about 1e-6 (five standard deviations of a variance)."""
    plan, rng = double_posture(PROTOTYPE), np.random.default_rng(3)
    signal = simulate(NOMINAL, OFFSETS, plan)
    made = (PROTOTYPE.synthetic(plan, lambda _: signal, rng, PROTOTYPE.gauge) for _ in range(1000))
    values = np.array([each.value for each in made])
    steps = values / PROTOTYPE.gauge.resolution_mm
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    spread = (values - signal) @ zero_free(plan).T
    expected = PROTOTYPE.gauge.noise_mm
    assert spread.std() == pytest.approx(expected, rel=5.0 / np.sqrt(2.0 * spread.size) + 0.01)
    zeros = (values - signal)[:, 0]
    assert zeros.min() < -0.9
    assert zeros.max() > 0.9
