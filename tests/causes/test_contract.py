"""The causes as a list: ids of the contract, one stage each, found by being there."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model import Cause, Model, Stage, double_posture, simulate
from tests.machines import NOMINAL, PROTOTYPE, ROOT

CONTRACT = {
    "axis_gap": ("geometry", "mm", 3),
    "axis_squareness": ("geometry", "mrad", 3),
    "leg_length": ("geometry", "mm", 3),
    "encoder_scale": ("motion", "1e-3", 3),
    "backlash": ("motion", "mm", 3),
    "thermal_drift": ("motion", "mm/h", 3),
    "bar_skew": ("contact", "mrad", 6),
    "gauge_drift": ("contact", "mm/h", 1),
    "stand_shift": ("contact", "mm", 1),
    "gauge_slip": ("record", "turns", 1),
    "misread": ("record", "mm", 1),
    "sign_flip": ("record", "", 0),
    "swapped_gauges": ("record", "", 0),
    "exchanged_columns": ("record", "", 0),
    "wrong_unit": ("record", "", 0),
}
PLAN = double_posture(PROTOTYPE)
every_cause = pytest.mark.parametrize("cause", CAUSES.values(), ids=list(CAUSES))


def test_ids_are_those_of_the_contract() -> None:
    assert set(CAUSES) == set(CONTRACT) == set(PROTOTYPE.tolerances)


@every_cause
def test_each_is_what_the_contract_says(cause: Cause) -> None:
    stage, unit, parameters = CONTRACT[cause.id]
    assert (cause.stage, cause.unit, len(cause.names)) == (stage, unit, parameters)
    assert cause.unknowns == parameters + (3 if cause.id == "backlash" else 0)
    assert CAUSES[cause.id] is cause


@every_cause
def test_each_acts_in_its_own_stage_alone(cause: Cause) -> None:
    """All four stages by hand: one changes what it is given, three give it back."""
    theta = cause.scale * np.linspace(1.0, 2.0, cause.unknowns)
    place = cause.places(PLAN, PROTOTYPE)[-1]
    geometry, command = NOMINAL.geometry, NOMINAL.kind.command(PROTOTYPE, PLAN)
    rng = np.random.default_rng(3)
    joints, heights = command.joints + 0.1, rng.normal(0.0, 1.0, len(PLAN))
    bent = cause.geometry(geometry, theta)
    given = {
        "geometry": np.concatenate((geometry.points, geometry.directions, [geometry.lengths])),
        "motion": joints,
        "contact": heights,
        "record": heights,
    }
    found = {
        "geometry": np.concatenate((bent.points, bent.directions, [bent.lengths])),
        "motion": cause.motion(joints, theta, command),
        "contact": cause.contact(
            heights, theta, place, rng.uniform(0.2, 0.8, len(PLAN)), PLAN, PROTOTYPE
        ),
        "record": cause.record(heights, theta, place, PLAN, PROTOTYPE),
    }
    changed = [stage for stage in Stage if not np.array_equal(given[stage], found[stage])]
    assert changed == [cause.stage]


@every_cause
def test_each_shows_in_the_readings_of_a_model_that_has_it(cause: Cause) -> None:
    offsets = np.array([0.4, -0.9, 0.6])
    theta = cause.scale * np.linspace(1.0, 2.0, cause.unknowns)
    effect = cause.at(theta, cause.places(PLAN, PROTOTYPE)[-1])
    before, after = (
        simulate(model, offsets, PLAN) for model in (NOMINAL, Model(PROTOTYPE, (effect,)))
    )
    assert np.abs(after - before).max() > 1e-2


@every_cause
def test_each_tells_a_technician_what_it_is_and_what_to_do(cause: Cause) -> None:
    assert cause.title
    assert cause.title[0].islower()
    assert cause.title[-1] != "."
    assert cause.advice.endswith(".")
    assert len(cause.advice) > 20


@every_cause
def test_each_takes_its_size_from_the_tolerances(cause: Cause) -> None:
    stds = cause.prior_std(PROTOTYPE)
    assert stds.shape == (cause.unknowns,)
    expected = PROTOTYPE.tolerances[cause.id] * cause.scale
    assert stds[: len(cause.names)] == pytest.approx(expected)
    assert cause.scale == {"mrad": 1e-3, "1e-3": 1e-3}.get(cause.unit, 1.0)


@every_cause
def test_its_default_is_what_the_prototype_s_file_states(cause: Cause) -> None:
    assert cause.sizes["orthoglide"] == PROTOTYPE.tolerances[cause.id]
    file = (ROOT / "configs" / "orthoglide_prototype.yaml").read_text(encoding="utf-8")
    unit = f"{cause.unit}; " if cause.unit else ""
    assert re.search(
        rf"^  {cause.id}: .*# {re.escape(unit + cause.size_reason)}$", file, re.MULTILINE
    )


def test_what_lies_in_the_measurement_is_never_compensable() -> None:
    for cause in CAUSES.values():
        assert cause.in_machine == (cause.stage in (Stage.GEOMETRY, Stage.MOTION))
        assert cause.in_machine or not cause.compensable
        # Only the machine, and the bars that belong to it, are the same in the next session.
        assert cause.lasting == (cause.in_machine or cause.id == "bar_skew")


def test_what_a_table_can_compensate_does_not_change_with_time_or_approach() -> None:
    compensable = {id for id, cause in CAUSES.items() if cause.compensable}
    assert compensable == {"axis_gap", "axis_squareness", "leg_length", "encoder_scale"}
    timed = {id for id, cause in CAUSES.items() if cause.timed}
    assert timed == {"backlash", "thermal_drift", "gauge_drift", "stand_shift"}
    assert {id for id, cause in CAUSES.items() if cause.positive} == {"backlash"}


@every_cause
def test_each_is_in_the_file_of_its_stage(cause: Cause) -> None:
    path = inspect.getsourcefile(type(cause))
    assert path is not None
    assert Path(path).stem == cause.stage
