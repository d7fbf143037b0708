"""Healthy sessions are left alone: less than one in a hundred has any false question."""

import numpy as np
import pytest

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import plan_of
from orthoglide_cal.planning.steps import MeasuringProtocol, SessionStep
from orthoglide_cal.session.checks import check_number, gather
from orthoglide_cal.session.events import advance
from orthoglide_cal.words import Unit
from tests.inference.sessions import model_of
from tests.truth.machines import DIAL, LARGE, MICRON, PROTOTYPE
from tests.truth.machines import Gauge as TrueGauge
from tests.truth.machines import Machine as TrueMachine
from tests.truth.session import make_session

from .virtual import DOUBLE, SINGLE, play, read_next, state_of, steps_of, taken


def healthy_values(
    steps: tuple[SessionStep, ...], sessions: int, machine: Machine, seed: int
) -> np.ndarray:
    """Readings of healthy sessions at the gauge's stated repeatability, (sessions, steps)."""
    rng = np.random.default_rng(seed)
    plan = plan_of([s.cell for s in steps])
    offsets = rng.normal(0.0, 1.0, (sessions, 3))
    zeros = rng.uniform(-2.5, 2.5, (sessions, 3, 3))
    exact = simulate(Model(machine), offsets, plan) + zeros[:, plan.leg, plan.direction]
    gauge = machine.gauge
    noisy = exact + rng.normal(0.0, gauge.repeatability_mm, exact.shape)
    return np.round(noisy / gauge.resolution_mm) * gauge.resolution_mm


@pytest.mark.parametrize(("protocol", "gauge"), [(DOUBLE, DIAL), (SINGLE, MICRON)])
def test_fewer_than_one_healthy_session_in_a_hundred_is_ever_questioned(
    protocol: MeasuringProtocol, gauge: TrueGauge
) -> None:
    """1,000 healthy sessions through the very decision of `check_reading`, all at once.

    By construction about one session in a thousand has a false question; if it were one in 400,
    this test would fail by chance once in 40,000 runs.
    """
    machine = model_of(PROTOTYPE, gauge).machine
    steps = steps_of(protocol)
    values = healthy_values(steps, 1000, machine, seed=11)
    state = state_of([])
    false = np.zeros(len(values), dtype=bool)
    for index, step in enumerate(steps):
        minutes = 0.2 * index + 4.0 * (step.setup - 1)
        now = read_next(state, steps, index, minutes, 0.0, machine)
        assert now.sigma_mm == machine.gauge.noise_mm
        if now.series:
            false |= gather(now, values[:, now.past].T, values[:, index]).questioned
        for value in values[:20, index].tolist():
            now = read_next(state, steps, index, minutes, value, machine)
            assert check_number(now, Unit.MM) is None
        state = advance(state, taken(step.number, 0.0, minutes))
    assert false.sum() < 10


@pytest.mark.parametrize(
    ("machine", "gauge", "imperfection"),
    [(PROTOTYPE, DIAL, "none"), (LARGE, MICRON, "axis_gap"), (PROTOTYPE, DIAL, "bar_skew"),
     (LARGE, MICRON, "backlash")],
)  # fmt: skip
def test_sessions_of_an_independent_truth_are_left_alone(
    gauge: TrueGauge, machine: TrueMachine, imperfection: str
) -> None:
    """Also on machines that are imperfect within their tolerances, with times of a real pace."""
    hidden = () if imperfection == "none" else (imperfection,)
    session = make_session(0, machine, gauge, hidden, offset_sd=1.0)
    asked = play(
        session.readings.tolist(),
        steps_of(),
        model_of(machine, gauge).machine,
        session.plan.minutes.tolist(),
    )
    assert asked == []
