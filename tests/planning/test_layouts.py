"""What layouts of a printer will give, against touches of the independent truth."""

import math
from dataclasses import replace
from functools import cache
from statistics import NormalDist

import numpy as np
import pytest

from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.linear_delta import LinearDelta, ProbePlan, mixed, rings
from orthoglide_cal.model.machine import SimulationOptions
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.plan import (
    MeasurementPlan,
    SessionForecast,
    chosen_session,
    measurement_plan,
    separations,
)
from tests.decisions import new_plan
from tests.estimation.sessions import solved
from tests.inference.sessions import model_from
from tests.printers import readings_of_touches, true_values
from tests.truth.delta import TOLERANCES, V400, Delta, Truth, delta_yaml, touches
from tests.truth.delta_separation import GRAIN
from tests.truth.plan import frozen

TRUTH = Truth(endstops=frozen([0.3, -0.4, 0.2]), radius=0.3, angles=frozen([0.1, -0.05, 0.0]))
# Standard error of a standard deviation from so many draws: 0.67 %. A deviation of 3 % is 4.5 of
# them; one of the 24 comparisons below fails by chance in 1 of 6,000 runs.
DRAWS, CHUNK = 11_000, 1_000
WITHIN = 0.03


V400_MODEL = model_from(delta_yaml(V400))


@cache
def usual() -> MeasurementPlan:
    return measurement_plan(chosen_session(V400_MODEL))


@cache
def layouts() -> dict[str, SessionForecast]:
    return {layout.name: layout for layout in usual().by_cycles}


def true_readings(machine: Delta, truth: Truth, plan: ProbePlan) -> tuple[ProbePlan, Floats]:
    """The plan with the heights at which the probe triggers, and the values, (n,) [mm]."""
    x, y = plan.place[:, 0], plan.place[:, 1]
    height = touches(machine, truth, x, y, plan.surface, np.zeros(len(plan)))
    place = np.stack((x, y, height), axis=1)
    return replace(plan, place=place, other=place), height - plan.surface


def drawn(machine: Delta, plan: ProbePlan, value: Floats, rng: np.random.Generator) -> Floats:
    """Many readings of it, with noise of the probe and beds of their own, (m, n)."""
    apart = np.linalg.norm(plan.place[:, None, :2] - plan.place[:, :2], axis=-1)
    size2, turn = np.linalg.eigh(np.exp(-apart / GRAIN))
    root = turn * np.sqrt(np.maximum(size2, 0.0)) * machine.texture
    shape = (CHUNK, len(plan))
    noise = machine.noise * rng.standard_normal(shape)
    return np.asarray(value + rng.standard_normal(shape) @ root.T + noise)


@pytest.mark.slow
@pytest.mark.parametrize("name", [layout.name for layout in V400_MODEL.machine.layouts()])
def test_predicted_standard_deviations_are_what_monte_carlo_finds(name: str) -> None:
    laid = layouts()[name]
    rng = np.random.default_rng(13)
    plan, value = true_readings(V400, TRUTH, laid.plan)
    expected = true_values(V400, TRUTH)
    chunks = (drawn(V400, plan, value, rng) for _ in range(DRAWS // CHUNK))
    every = np.concatenate([solved(V400_MODEL, plan, each, expected) for each in chunks])
    std = laid.budget.without(V400_MODEL.machine.fixed_parameters).std_mm
    assert std == pytest.approx(every.std(axis=0), rel=WITHIN)
    error = np.abs(every.mean(axis=0) - expected) / std
    assert error.max() < 0.05


def test_the_expected_uncertainty_is_what_solve_gives() -> None:
    """The mean of 40 sessions of 174 degrees of freedom: U scatters by 5 % at most, it by 0.9 %."""
    laid = layouts()["telling"]
    plan, value = true_readings(V400, TRUTH, laid.plan)
    every = drawn(V400, plan, value, np.random.default_rng(14))[:40]
    reach = [
        solve(readings_of_touches(plan, each), V400_MODEL).budget.expanded_mm for each in every
    ]
    assert laid.budget.expanded_mm == pytest.approx(np.mean(reach, axis=0), rel=0.04)


def test_a_flat_bed_does_not_tell_and_the_telling_layout_does() -> None:
    assert usual().chosen is usual().design
    sigma = {name: layout.rivals_sigma or 0.0 for name, layout in layouts().items()}
    assert all(sigma[f"bed-{count}"] < 1.0 for count in (7, 13, 25, 121))
    assert sigma["telling"] > 4.0 * max(sigma[f"bed-{count}"] for count in (7, 13, 25, 121))


@pytest.mark.parametrize("texture_mm", [GRAIN, 0.2])
def test_the_layout_that_costs_least_is_chosen(
    texture_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Among a few: minutes, and those of a shift later where the rivals stay alike."""
    every = LinearDelta.distinguishing_layouts
    monkeypatch.setattr(LinearDelta, "distinguishing_layouts", lambda machine: every(machine)[::4])
    machine = V400_MODEL.machine
    model = Model(machine.changed(probe=machine.probe.changed(texture_mm=texture_mm)))
    losses = {}
    for layout in model.machine.distinguishing_layouts():
        (apart,) = separations(model, layout.plan, machine.rivals)[0].values()
        log_odds = NormalDist(apart**2 / 2.0, apart)
        losses[len(layout.plan)] = layout.minutes + 480.0 * log_odds.cdf(math.log(100.0))
    design = new_plan(chosen_session(model)).design
    assert design.readings == min(losses, key=losses.__getitem__)


def test_where_there_is_nothing_to_tell_the_first_layout_is_taken() -> None:
    upright = V400_MODEL.machine.changed(tolerances={**TOLERANCES, "tower_lean": 0.0})
    plan = measurement_plan(chosen_session(Model(upright)))
    assert plan.design is None
    assert plan.chosen.name == "bed-7"
    assert all(each.rivals_sigma is None for each in plan.by_cycles)


def test_a_parameter_that_readings_do_not_determine_is_said_to_be_so() -> None:
    gauge = V400_MODEL.machine.probe.changed(repeatability_mm=0.3)
    coarse = measurement_plan(chosen_session(Model(V400_MODEL.machine.changed(probe=gauge))))
    of_coarse, of_usual = (
        {
            each.name
            for each in plan.by_cycles
            if not all(row["determined"] for row in each.parameters.values())
        }
        for plan in (coarse, usual())
    )
    assert "bed-7" in of_coarse
    assert "telling" not in of_coarse
    assert not of_usual


def test_minutes_are_those_of_touches_and_blocks() -> None:
    assert layouts()["bed-25"].minutes == pytest.approx(25 * 5 / 60)
    telling = layouts()["telling"]
    raised = np.sum(ProbePlan.require(telling.plan).surface > 0.0)
    assert raised > 5
    assert telling.minutes == pytest.approx(len(telling.plan) * 5 / 60 + raised * 0.5)
    for layout in layouts().values():
        assert np.all(np.diff(layout.plan.hours) > 0.0)
        assert layout.plan.hours.max() * 60.0 < layout.minutes


@pytest.mark.parametrize("count", [13, 121])
def test_time_says_little_of_the_place(count: int) -> None:
    """Regressed on tilt and bowl of the bed; row by row it is 0.9 and more."""
    at = rings(count, 100.0)
    order = mixed(np.vstack((at, at)))
    assert {tuple(each) for each in order.tolist()} == {tuple(each) for each in at.tolist()}
    assert len(order) == count
    x, y = order.T / 100.0
    terms = np.stack((np.ones(count), x, y, x**2, x * y, y**2), axis=1)
    time = np.arange(count) - (count - 1) / 2.0
    left = time - terms @ np.linalg.lstsq(terms, time, rcond=None)[0]
    # Of a random order the terms would follow 5 parts in count − 1.
    assert 1.0 - (left @ left) / (time @ time) < 5.0 / (count - 1) + 0.2


def test_a_simulated_bed_is_touched_at_the_same_places() -> None:
    """In the same mixed order at each height, one place or many."""
    machine = V400_MODEL.machine
    wanted = SimulationOptions(places=25, heights=(0.0, 40.0), cycles=2)
    plan = ProbePlan.require(machine.simulated_plan(wanted))
    places = mixed(rings(25, 0.95 * V400.bed))
    assert np.array_equal(plan.place[:, :2], np.tile(places, (4, 1)))
    assert plan.surface.tolist() == [0.0] * 25 + [40.0] * 25 + [0.0] * 25 + [40.0] * 25
    assert len(np.unique(plan.repeats)) == 50
    few = (SimulationOptions(places=count) for count in (1, 2, 5))
    assert [len(machine.simulated_plan(each)) for each in few] == [1, 2, 5]
