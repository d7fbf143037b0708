"""A plan as a whole: other ways on equal terms, targets, what limits."""

from itertools import pairwise

import numpy as np
import pytest

from orthoglide_cal.estimation import Method
from orthoglide_cal.model.model import Model
from orthoglide_cal.planning.forecast import SessionForecast, forecast
from orthoglide_cal.planning.plan import METHODS, SHOWN_CYCLES, Wanted, measurement_plan
from orthoglide_cal.planning.steps import MOST_CYCLES, MeasuringProtocol
from tests.machines import NOMINAL, both_models, sure

DOUBLE, SINGLE = MeasuringProtocol.DOUBLE, MeasuringProtocol.SINGLE


def worst(found: SessionForecast) -> float:
    return max(found.expanded_mm.values())


@both_models
def test_ways_are_compared_for_the_same_uncertainty(model: Model) -> None:
    plan = measurement_plan(model, Wanted(cycles=2))
    assert {(way.protocol, way.method) for way in plan.compare} == {
        (protocol, method) for protocol, methods in METHODS.items() for method in methods
    }
    assert {method for methods in METHODS.values() for method in methods} == set(Method)
    for way in plan.compare:
        assert way.same_cycles.cycles == 2
        cycles = way.same_expanded.cycles
        assert worst(way.same_expanded) <= worst(plan.chosen) * (1.0 + 1e-6)
        if cycles > 1:
            assert worst(forecast(model, way.protocol, cycles - 1, way.method)) > worst(plan.chosen)
    own = next(way for way in plan.compare if (way.protocol, way.method) == (DOUBLE, "readings"))
    assert own.same_expanded.cycles == 2


def test_a_gauge_alone_is_compared_with_its_fewest_moves() -> None:
    """One move for each leg and one between the legs; every move of it takes its time."""
    plan = measurement_plan(NOMINAL, Wanted(cycles=3, stands=1))
    for way in plan.compare:
        if way.protocol is SINGLE:
            assert way.same_cycles.gauge_moves == 3
    asked = measurement_plan(NOMINAL, Wanted(SINGLE, 3))
    assert asked.chosen.gauge_moves == 39
    # Twice ten postures, driven to once or once for each end; 19 slides, or one.
    assert asked.chosen.minutes == pytest.approx(2 * (10 * 0.4 + 19 * 0.5) + 4.0)
    own = next(w for w in asked.compare if (w.protocol, w.method) == (SINGLE, "readings"))
    assert own.same_cycles.minutes == pytest.approx(2 * (20 * 0.4 + 0.5) + 4.0)
    assert own.same_cycles.expanded_mm == asked.chosen.expanded_mm


@pytest.mark.parametrize("protocol", list(MeasuringProtocol))
def test_more_cycles_are_never_worse(protocol: MeasuringProtocol) -> None:
    plan = measurement_plan(NOMINAL, Wanted(protocol))
    assert [each.cycles for each in plan.by_cycles] == list(SHOWN_CYCLES)
    for fewer, more in pairwise(plan.by_cycles):
        assert np.all(more.budget.expanded_mm < fewer.budget.expanded_mm)
        assert more.minutes > fewer.minutes
        assert (more.tool_mm or 0.0) < (fewer.tool_mm or 0.0)


@pytest.mark.parametrize("protocol", list(MeasuringProtocol))
def test_what_stays_is_the_same_whatever_was_asked_for(protocol: MeasuringProtocol) -> None:
    """No session that `measure` guides comes below it, and it is near to what the longest gives."""
    plans = [measurement_plan(NOMINAL, Wanted(protocol, cycles)) for cycles in (1, MOST_CYCLES)]
    floors = [plan.floor for plan in plans if plan.floor]
    assert len(floors) == len(plans)
    longest = plans[-1].chosen
    for floor in floors:
        assert floor.expanded_mm.tolist() == floors[0].expanded_mm.tolist()
        assert np.all(floor.expanded_mm < longest.budget.expanded_mm)
        left = floor.std_mm**2 + np.array([*longest.noise_std_mm.values()]) ** 2
        assert left == pytest.approx(longest.budget.std_mm**2)


def test_the_tool_is_off_by_what_the_offsets_leave() -> None:
    """At the isotropic posture the tool moves as the carriages do; elsewhere it moves more."""
    plan = measurement_plan(sure(NOMINAL), Wanted())
    assert plan.floor is None
    middle = float(plan.chosen.budget.k * np.sqrt(np.trace(plan.chosen.budget.covariance_mm2)))
    assert middle < (plan.chosen.tool_mm or 0.0) < 2.0 * middle
