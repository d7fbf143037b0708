"""The causes as a list: ids of the contract, one step each, found by being there."""

import inspect
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES, Cause, PatternCause, RelabelCause, Step
from orthoglide_cal.data import CAUSE_IDS, CAUSE_UNITS
from orthoglide_cal.protocols import double_posture
from tests.machines import PROTOTYPE

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
}
every_cause = pytest.mark.parametrize("cause", CAUSES.values(), ids=list(CAUSES))
STEPS = [step.value for step in Step]


def test_ids_are_those_of_the_contract() -> None:
    assert set(CAUSES) == set(CONTRACT) == set(CAUSE_IDS)


@every_cause
def test_each_is_what_the_contract_says(cause: Cause) -> None:
    step, unit, parameters = CONTRACT[cause.id]
    assert (cause.step, cause.unit, len(cause.names)) == (step, unit, parameters)
    assert CAUSE_UNITS[cause.id] == unit
    assert CAUSES[cause.id] is cause


@every_cause
def test_each_overrides_its_own_step_alone(cause: Cause) -> None:
    bases = (Cause, PatternCause, RelabelCause)
    own = [
        step
        for step in STEPS
        if next(c for c in type(cause).__mro__ if step in vars(c)) is not Cause
    ]
    assert own == [cause.step.value]
    assert type(cause) not in bases


@every_cause
def test_each_tells_a_technician_what_it_is_and_what_to_do(cause: Cause) -> None:
    assert cause.title
    assert cause.title[0].islower()
    assert cause.title[-1] != "."
    assert cause.advice.endswith(".")
    assert len(cause.advice) > 20


@every_cause
def test_each_takes_its_size_from_the_tolerances(cause: Cause) -> None:
    machine = PROTOTYPE
    stds = cause.prior_std(machine)
    assert stds.shape == (len(cause.names) + len(cause.nuisance),)
    expected = machine.tolerances[cause.id] * cause.scale
    assert stds[: len(cause.names)] == pytest.approx(expected)
    scale = {"mrad": 1e-3, "1e-3": 1e-3}.get(cause.unit, 1.0)
    assert cause.scale == scale


def test_what_lies_in_the_measurement_is_never_compensable() -> None:
    for cause in CAUSES.values():
        assert cause.in_machine == (cause.step in (Step.GEOMETRY, Step.MOTION))
        assert cause.in_machine or not cause.compensable
        # Only the machine, and the bars that belong to it, are the same in the next session.
        assert cause.lasting == (cause.in_machine or cause.id == "bar_skew")


@every_cause
def test_each_has_its_own_file(cause: Cause) -> None:
    path = inspect.getsourcefile(type(cause))
    assert path is not None
    assert Path(path).name == f"{cause.id}.py"


def test_places_are_counted_from_the_plan() -> None:
    plan = double_posture(PROTOTYPE)
    count = {id: len(cause.places(plan, PROTOTYPE)) for id, cause in CAUSES.items()}
    wide = {id for id, cause in CAUSES.items() if len(cause.names) > 1}
    assert {count[id] for id in wide} == {1}
    assert count["gauge_drift"] == count["sign_flip"] == 6
    assert count["swapped_gauges"] == 3
    assert count["misread"] == 60
    assert count["stand_shift"] == 54
    # Each reading alone, and all from the second to the last but one of each set-up.
    assert count["gauge_slip"] == 60 + 6 * 8
    half = plan.subset(np.flatnonzero((plan.leg != 1) & (plan.direction != 2)))
    assert len(CAUSES["sign_flip"].places(half, PROTOTYPE)) == 3
    assert len(CAUSES["swapped_gauges"].places(half, PROTOTYPE)) == 1


def test_labels_lead_a_technician_to_the_reading() -> None:
    plan = double_posture(PROTOTYPE)
    misread = CAUSES["misread"]
    labels = {misread.label(place, plan, PROTOTYPE) for place in misread.places(plan, PROTOTYPE)}
    assert len(labels) == 60
    assert "leg y, direction x, min, cycle 2 (reading 31)" in labels
    assert "leg z, direction y, iso, cycle 4 (reading 60)" in labels
    shift = CAUSES["stand_shift"]
    place = shift.places(plan, PROTOTYPE)[0]
    assert shift.label(place, plan, PROTOTYPE) == (
        "from leg x, direction y, max, cycle 1 (reading 3) on"
    )
