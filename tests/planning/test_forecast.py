"""What is predicted before a reading exists, against the independent truth; plans made of it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.estimation.solution import Method
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model, synthetic_session
from orthoglide_cal.model.orthoglide import MINUTES_PER_POSTURE, OFFSET_MM
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan
from orthoglide_cal.planning.plan import (
    METHODS,
    SHOWN_CYCLES,
    fewest_cycles,
    forecast,
    measurement_plan,
)
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    GuidedSession,
    MeasuringProtocol,
    clock,
    gauge_moves,
)
from tests import truth
from tests.estimation.sessions import solved
from tests.machines import NOMINAL, NOMINAL_LARGE, both_models, sure
from tests.truth.effects import Effect, state_with
from tests.truth.forward import carriages_and_tool, signals
from tests.truth.plan import plan_of

DOUBLE, SINGLE, BEST = MeasuringProtocol
OFFSETS = np.array([0.43, -0.61, 0.32])
# Standard error of a standard deviation from so many draws: 0.67 %. A deviation of 3 % is 4.5 of
# them; one of the 33 comparisons below fails by chance in 1 of 4,400 runs.
DRAWS = 11_000
WITHIN = 0.03
OF_DOUBLE = ("six", "twelve", "readings", "six-linear", "twelve-linear")
WAYS = [
    *((DOUBLE, name) for name in OF_DOUBLE),
    *((SINGLE, name) for name in ("single", "readings", "single-sequential")),
    (BEST, "readings"),
]
# Every way with the usual cycles; all readings, whose weights depend on their number, with one.
SESSIONS = [
    *((NOMINAL, *way, 3) for way in WAYS),
    (NOMINAL, DOUBLE, "readings", 1),
    (NOMINAL_LARGE, SINGLE, "single", 3),
]


def like(machine: Machine) -> truth.Machine:
    """A machine of the truth with legs as long; nothing else of it shows in readings."""
    return replace(truth.PROTOTYPE, leg=machine.leg_length_mm)


def true_readings(
    plan: GaugePlan, machine: Machine, offsets: Floats, effects: tuple[Effect, ...] = ()
) -> Floats:
    """What perfect gauges read, shape (n,) [mm], of a plan of one part; offsets (3,) [mm]."""
    columns = {
        name: getattr(plan, name) for name in ("leg", "direction", "displacement", "gauge_at")
    }
    real, state = like(machine), state_with(offsets, effects)[None]
    there = plan_of(real, **columns, minutes=60.0 * plan.hours)
    if plan.fixed:
        return np.asarray(signals(there, real, state)[0])
    carriages, tool = carriages_and_tool(there, real, state, np.zeros((len(plan), 3)))
    rows = np.arange(len(plan))
    at_joint = carriages[plan.leg, plan.direction, 0, rows]
    at_tool = tool[plan.direction, 0, rows]
    return np.asarray(np.where(plan.contact == Contact.TOOL, at_tool, at_joint))


@pytest.mark.parametrize(("model", "protocol", "name", "cycles"), SESSIONS)
def test_predicted_noise_is_what_monte_carlo_finds(
    model: Model, protocol: MeasuringProtocol, name: str, cycles: int
) -> None:
    method, gauge = Method(name), model.machine.gauge
    found = forecast(model, GuidedSession(protocol=protocol, cycles=cycles), method)
    plan = found.plan
    rng = np.random.default_rng(12)
    signal = true_readings(plan, model.machine, OFFSETS)
    zeros = rng.uniform(-1.0, 1.0, (DRAWS, plan.setups))[:, plan.setup]
    noise = gauge.repeatability_mm * rng.standard_normal((DRAWS, len(plan)))
    values = np.round((signal + zeros + noise) / gauge.resolution_mm) * gauge.resolution_mm
    offsets = solved(model, plan, values, OFFSETS, method)
    assert [*found.noise_std_mm.values()] == pytest.approx(offsets.std(axis=0), rel=WITHIN)
    if not method.linear:
        # The readings are those of the machine that the model describes.
        assert offsets.mean(axis=0) == pytest.approx(OFFSETS, abs=5e-4)


@pytest.mark.parametrize(
    ("model", "protocol", "name"), [(NOMINAL, *WAYS[2]), (NOMINAL_LARGE, *WAYS[7])]
)
def test_the_expected_uncertainty_is_what_solve_gives(
    model: Model, protocol: MeasuringProtocol, name: str
) -> None:
    """The mean of 60 sessions. With 35 degrees of freedom or more U scatters by 12 % at most, its
    mean by 1.6 %: a quarter of what is allowed where noise is all.
    """
    known = sure(model).machine
    loose = Model(known.changed(gauge=known.gauge.changed(placement_mm=6.0)))
    for machine, within in ((model, 0.02), (sure(model), 0.06), (loose, 0.06)):
        found = forecast(machine, GuidedSession(protocol=protocol), Method(name))
        rng, reach = np.random.default_rng(7), []
        for _ in range(60):
            offsets = OFFSET_MM * rng.choice([-1.0, 1.0], 3)
            session = synthetic_session(machine, found.plan, offsets, rng)
            reach.append(solve(session, machine, name).budget.expanded_mm)
        assert found.budget.expanded_mm == pytest.approx(np.mean(reach, axis=0), rel=within)


@pytest.mark.parametrize("protocol", MeasuringProtocol)
def test_spare_readings_are_the_degrees_of_freedom(protocol: MeasuringProtocol) -> None:
    """Each zero and each offset takes one reading away; where noise is all, k is Student's t."""
    found = forecast(sure(NOMINAL), GuidedSession(protocol=protocol, cycles=1))
    spare = len(found.plan) - found.plan.setups - 3
    assert found.budget.k == pytest.approx(stats.t.ppf(0.975, spare))


def test_no_number_of_cycles_reaches_below_the_floor() -> None:
    """Which is 1.96 times a plausible leg, and a little."""
    floor = forecast(NOMINAL, GuidedSession(cycles=MOST_CYCLES)).floor
    assert floor.largest.source == "leg_length"
    below = 0.99 * float(floor.expanded_mm.max())
    assert fewest_cycles(NOMINAL, GuidedSession(), below) is None
    assert floor.expanded_mm.max() == pytest.approx(1.96 * 0.01, rel=0.03)
    # Of a shorter session more is left beside noise, for its readings tell less of it.
    shorter = forecast(NOMINAL).floor
    assert np.all(shorter.std_mm > floor.std_mm)
    assert forecast(sure(NOMINAL)).floor is None


@both_models
def test_minutes_and_moves_are_those_of_measure(model: Model) -> None:
    for protocol in MeasuringProtocol:
        session = forecast(model, GuidedSession(protocol=protocol))
        stands = 1 if protocol is SINGLE else 2
        steps = GuidedSession(protocol=protocol, stands=stands).steps(model.machine)
        assert session.minutes == clock(steps)[-1]
        assert session.gauge_moves == gauge_moves(steps)
        assert len(steps) == len(session.plan)
        # The last reading is taken one posture before the end.
        last = 60.0 * session.plan.hours.max()
        assert last == pytest.approx(session.minutes - MINUTES_PER_POSTURE)
    one, two = (forecast(model, GuidedSession(stands=stands)) for stands in (1, 2))
    assert one.minutes > two.minutes
    assert one.noise_std_mm == pytest.approx(two.noise_std_mm)


@both_models
def test_ways_are_compared_for_the_same_uncertainty(model: Model) -> None:
    plan = measurement_plan(forecast(model, GuidedSession(cycles=2)))
    assert {(way.name, way.method) for way in plan.compare} == {
        (protocol, method) for protocol, methods in METHODS.items() for method in methods
    }
    assert {method for methods in METHODS.values() for method in methods} == set(Method)
    for way in plan.compare:
        cycles = way.cycles
        assert way.worst_mm <= plan.chosen.worst_mm * (1.0 + 1e-6)
        if cycles > 1:
            shorter = forecast(
                model, GuidedSession(protocol=way.name, cycles=cycles - 1), way.method
            )
            assert shorter.worst_mm > plan.chosen.worst_mm
    own = next(way for way in plan.compare if (way.name, way.method) == (DOUBLE, "readings"))
    assert own.cycles == 2


def test_a_gauge_alone_is_compared_with_its_fewest_moves() -> None:
    """One move for each leg and one between the legs; every move of it takes its time."""
    plan = measurement_plan(forecast(NOMINAL, GuidedSession(stands=1)))
    moves = [way.gauge_moves for way in plan.compare if way.name == SINGLE]
    assert moves == [3] * len(METHODS[SINGLE])
    asked = measurement_plan(forecast(NOMINAL, GuidedSession(protocol=SINGLE)))
    assert asked.chosen.gauge_moves == 39
    # Twice ten postures, driven to once or once for each end; 19 slides, or one.
    assert asked.chosen.minutes == pytest.approx(2 * (10 * 0.4 + 19 * 0.5) + 4.0)
    own = next(w for w in asked.compare if (w.name, w.method) == (SINGLE, "readings"))
    assert own.cycles == 3
    assert own.minutes == pytest.approx(2 * (20 * 0.4 + 0.5) + 4.0)
    assert own.expanded_mm == pytest.approx(asked.chosen.expanded_mm)


@pytest.mark.parametrize("protocol", list(MeasuringProtocol))
def test_more_cycles_are_never_worse(protocol: MeasuringProtocol) -> None:
    plan = measurement_plan(forecast(NOMINAL, GuidedSession(protocol=protocol)))
    assert [each.cycles for each in plan.by_cycles] == list(SHOWN_CYCLES)
    for fewer, more in pairwise(plan.by_cycles):
        assert np.all(more.budget.expanded_mm < fewer.budget.expanded_mm)
        assert more.minutes > fewer.minutes
        assert (more.tool_mm or 0.0) < (fewer.tool_mm or 0.0)


@pytest.mark.parametrize("protocol", list(MeasuringProtocol))
def test_what_stays_is_the_same_whatever_was_asked_for(protocol: MeasuringProtocol) -> None:
    """It is what is left of the longest session that `measure` guides without its noise."""
    plans = [
        measurement_plan(forecast(NOMINAL, GuidedSession(protocol=protocol, cycles=cycles)))
        for cycles in (1, MOST_CYCLES)
    ]
    (floor, same), longest = (plan.floor for plan in plans), plans[-1].chosen
    assert floor.expanded_mm.tolist() == same.expanded_mm.tolist()
    left = floor.std_mm**2 + np.array([*longest.noise_std_mm.values()]) ** 2
    assert left == pytest.approx(longest.budget.std_mm**2)


def test_the_tool_is_off_by_what_the_offsets_leave() -> None:
    """At the isotropic posture the tool moves as the carriages do; elsewhere it moves more."""
    plan = measurement_plan(forecast(sure(NOMINAL)))
    assert plan.floor is None
    middle = float(plan.chosen.budget.k * np.sqrt(np.trace(plan.chosen.budget.covariance_mm2)))
    assert middle < (plan.chosen.tool_mm or 0.0) < 2.0 * middle
