"""What is predicted before a reading exists, against readings of the independent truth."""

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.estimation import Method, solve
from orthoglide_cal.model.model import Model, synthetic_session
from orthoglide_cal.model.orthoglide import MINUTES_PER_POSTURE, OFFSET_MM
from orthoglide_cal.planning.forecast import fewest_cycles, forecast, session_of
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    MeasuringProtocol,
    Order,
    clock,
    gauge_moves,
    sequence,
)
from tests.estimation.sessions import solved
from tests.machines import NOMINAL, NOMINAL_LARGE, both_models, sure
from tests.planning.truth import true_readings

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


@pytest.mark.parametrize(("model", "protocol", "name", "cycles"), SESSIONS)
def test_predicted_noise_is_what_monte_carlo_finds(
    model: Model, protocol: MeasuringProtocol, name: str, cycles: int
) -> None:
    method, gauge = Method(name), model.machine.gauge
    found = forecast(model, protocol, cycles, method)
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
    ("model", "protocol", "name"),
    [(NOMINAL, *WAYS[2]), (NOMINAL_LARGE, *WAYS[7])],
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
        found = forecast(machine, protocol, 3, Method(name))
        rng, reach = np.random.default_rng(7), []
        for _ in range(60):
            offsets = OFFSET_MM * rng.choice([-1.0, 1.0], 3)
            session = synthetic_session(machine, found.plan, offsets, rng)
            reach.append(solve(session, machine, name).expanded_mm)
        assert found.budget.expanded_mm == pytest.approx(np.mean(reach, axis=0), rel=within)


@pytest.mark.parametrize("protocol", MeasuringProtocol)
def test_spare_readings_are_the_degrees_of_freedom(protocol: MeasuringProtocol) -> None:
    """Each zero and each offset takes one reading away; where noise is all, k is Student's t."""
    found = forecast(sure(NOMINAL), protocol, 1)
    spare = len(found.plan) - found.plan.setups - 3
    assert found.budget.k == pytest.approx(stats.t.ppf(0.975, spare))


def test_no_number_of_cycles_reaches_below_the_floor() -> None:
    longest = forecast(NOMINAL, DOUBLE, MOST_CYCLES)
    floor = longest.floor
    assert floor.largest.source == "leg_length"
    below = 0.99 * float(floor.expanded_mm.max())
    found = fewest_cycles(NOMINAL, DOUBLE, Method.READINGS, 2, below)
    assert found is None
    # What more cycles approach: 1.96 times a plausible leg, and a little.
    assert longest.budget.expanded_mm.max() == pytest.approx(floor.expanded_mm.max(), rel=0.04)
    assert floor.expanded_mm.max() == pytest.approx(1.96 * 0.01, rel=0.03)
    # Of a shorter session more is left beside noise, for its readings tell less of it.
    shorter = forecast(NOMINAL, DOUBLE, 3).floor
    assert np.all(shorter.std_mm > floor.std_mm)
    assert forecast(sure(NOMINAL), DOUBLE, 3).floor is None


@both_models
def test_minutes_and_moves_are_those_of_measure(model: Model) -> None:
    for protocol in MeasuringProtocol:
        session = session_of(model, protocol, 3)
        stands = 1 if protocol is SINGLE else 2
        steps = sequence(model.machine, protocol, 3, Order.PAPER, stands)
        assert session.minutes == clock(steps)[-1]
        assert session.gauge_moves == gauge_moves(steps)
        assert len(steps) == len(session.plan)
        # The last reading is taken one posture before the end.
        last = 60.0 * session.plan.hours.max()
        assert last == pytest.approx(session.minutes - MINUTES_PER_POSTURE)
    one, two = (forecast(model, DOUBLE, 3, stands=stands) for stands in (1, 2))
    assert one.minutes > two.minutes
    assert one.noise_std_mm == pytest.approx(two.noise_std_mm)
