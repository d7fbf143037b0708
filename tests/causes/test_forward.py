"""The forward model with each cause against the independent simulator, and its derivatives."""

from typing import Any

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.kinematics import Command
from orthoglide_cal.model.model import Cause, Effect, Model, differentiate, simulate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan
from tests import truth
from tests.machines import NOMINAL, NOMINAL_LARGE
from tests.subjects import Subject, on_each_kind
from tests.truth import again
from tests.truth.effects import state_with
from tests.truth.plan import plan_of

# The truth's large machine has other lengths than the file's in parts that no reading sees.
MACHINES = {"prototype": (NOMINAL, truth.PROTOTYPE), "large": (NOMINAL_LARGE, truth.LARGE)}
# In the contract's units, no two alike, no symmetry between the axes.
HIDDEN = {
    id: truth.Effect(id, parameters=sizes)
    for id, sizes in {
        "axis_gap": (0.37, -0.58, 0.23),
        "axis_squareness": (1.9, -0.7, 1.2),
        "leg_length": (0.05, -0.03, 0.11),
        "encoder_scale": (1.4, -2.3, 0.6),
        "backlash": (0.061, 0.023, 0.042, 0.011, -0.007, 0.017),
        "thermal_drift": (0.13, -0.07, 0.19),
        "bar_skew": (1.1, -0.6, 0.4, 0.9, -1.3, 0.5),
    }.items()
}


def standard(machine: truth.Machine) -> truth.Plan:
    return truth.standard_plan(machine, np.random.default_rng(12))


def with_stands_at_rest(machine: truth.Machine, plan: truth.Plan) -> truth.Plan:
    """The plan behind six more readings, one per set-up: the machine at iso, before anything.

    The truth sets each gauge up where the leg really stands at its first reading; the program
    where the offsets alone put it. Here both mean these six readings.
    """
    first = np.unique(plan.stand)
    columns = {
        name: np.concatenate((getattr(plan, name)[first], getattr(plan, name)))
        for name in ("leg", "direction", "displacement")
    }
    return plan_of(machine, **columns, minutes=np.concatenate((np.zeros(6), plan.minutes)))


def as_plan(plan: truth.Plan) -> GaugePlan:
    """The truth's plan as the program's."""
    same = "leg", "direction", "displacement", "gauge_at", "hours", "part", "turned", "entered"
    rest = {"contact": np.full(plan.count, Contact.FIXED), "order": np.arange(plan.count)}
    return GaugePlan(**{name: getattr(plan, name) for name in same}, setup=plan.zero, **rest)


def effect_of(id: str) -> Effect:
    """The program's effect of the same sizes."""
    values = np.array(HIDDEN[id].parameters)
    if id == "backlash":
        # The truth counts the first positions against the sense of the carriage.
        values[3:] *= -1.0
    return CAUSES[id].at(values * CAUSES[id].scale)


both_machines = pytest.mark.parametrize(("model", "hidden"), MACHINES.values(), ids=list(MACHINES))
OFFSETS = np.random.default_rng(7).uniform(-3.0, 3.0, (4, 3))
# The carriages of these stand where the offsets put them when a gauge is set up.
AT_REST = ("axis_gap", "axis_squareness", "leg_length", "encoder_scale", "bar_skew")


def apart(one: Floats, other: Floats, plan: truth.Plan) -> float:
    """How far two sets of readings are apart, each set-up less its mean [mm]."""
    zeros = np.equal.outer(plan.zero, np.unique(plan.zero)).astype(float)
    left = one - other
    return float(np.abs(left - zeros @ (np.linalg.pinv(zeros) @ left)).max())


@both_machines
@pytest.mark.parametrize("cause", [None, *HIDDEN])
def test_readings_are_those_of_the_truth(
    model: Model, hidden: truth.Machine, cause: str | None
) -> None:
    """To rounding; where a cause moves the carriages, once both set the gauges up at rest.

    Where they differ, a stand δ further along a leg that leans by dy/dx reads δ·dy/dx less: some
    1e-4 mm. δ is at most half the lost motion and the first position, or what has drifted by the
    time the last leg is reached; the legs lean by (offsets + drift)/L·tan α, about 1 %.
    """
    plan, worse = standard(hidden), model.extended([effect_of(cause)] if cause else [])
    acting = (HIDDEN[cause],) if cause else ()
    for offsets in OFFSETS:
        state, at_rest, same = state_with(offsets, acting)[None], plan, worse
        if cause in ("backlash", "thermal_drift"):
            true = truth.signals(plan, hidden, state)[0]
            assert apart(simulate(worse, offsets, as_plan(plan)), true, plan) < 0.06 * 0.01
            at_rest = with_stands_at_rest(hidden, plan)
        if cause == "backlash":
            # Where the carriages stand before their first motion also shifts the six stands.
            widths = np.array([*HIDDEN[cause].parameters[:3], 0.0, 0.0, 0.0])
            same = model.extended([CAUSES[cause].at(widths)])
            state[0, 18:21] = 0.0
        true = truth.signals(at_rest, hidden, state)[0]
        mine = simulate(same, offsets, as_plan(at_rest))
        assert apart(mine, true, at_rest) < 1e-9
        without = simulate(model, offsets, as_plan(at_rest))
        assert (apart(mine, without, at_rest) > 1e-2) == bool(cause)


STEP = (0.5, -0.3, 1.2)


@both_machines
@pytest.mark.parametrize(
    "changed",
    [
        {"turned": 1},
        {"entered": STEP},
        {"gauge_at": 0.2},
        {"part": 0, "entered": STEP},
        {"part": 0, "turned": 1, "entered": STEP, "gauge_at": 0.8},
    ],
    ids=str,
)
def test_all_causes_at_once_are_those_of_the_truth(
    model: Model, hidden: truth.Machine, changed: dict[str, Any]
) -> None:
    """Rails, legs, motion and bars together, in any order in which they were accepted.

    Also after a bar was turned, offsets entered, or stands moved.
    """
    plan = again(truth.make_session(1, hidden, truth.MICRON), **changed).plan
    assert plan.count == 120
    for offsets, order in zip(OFFSETS, [AT_REST, AT_REST[::-1]] * 2, strict=True):
        worse = model.extended(effect_of(cause) for cause in order)
        state = state_with(offsets, tuple(HIDDEN[cause] for cause in AT_REST))
        true = truth.signals(plan, hidden, state[None])[0]
        assert apart(simulate(worse, offsets, as_plan(plan)), true, plan) < 1e-9


each_with_parameters = on_each_kind([cause for cause in CAUSES.values() if cause.unknowns])


def beside(cause: Cause, subject: Subject) -> Model:
    """The subject's model with other causes, so that nothing is zero."""
    others = (CAUSES[id] for id in ("axis_gap", "encoder_scale", "tower_lean", "bed_shape"))
    return subject.model.extended(
        each.at(each.scale * np.linspace(0.3, -0.8, each.unknowns))
        for each in others
        if type(subject.machine) in each.sizes and each is not cause
    )


@each_with_parameters
def test_derivatives_are_those_of_the_readings(cause: Cause, subject: Subject) -> None:
    """By what is calibrated and by the cause's parameters; differences err by 1e-8."""
    model, plan, p = beside(cause, subject), subject.plan, len(subject.values)
    place = cause.places(plan, subject.machine)[-1]
    theta = cause.scale * np.linspace(0.4, -0.7, cause.unknowns)
    slope = differentiate(model, subject.values, plan, [cause.at(theta, place)])[1]
    assert slope.shape == (len(plan), p + cause.unknowns)
    full = model.extended([cause.at(theta, place)])
    values, by_values = differentiate(full, subject.values, plan)
    assert values == pytest.approx(simulate(full, subject.values, plan), abs=1e-12)
    assert slope[:, :p] == pytest.approx(by_values, abs=1e-10)
    at, steps = np.concatenate((subject.values, theta)), np.full(p + cause.unknowns, 1e-4)
    steps[p:] *= cause.scale
    for k, step in enumerate(steps):
        up, down = (
            simulate(model.extended([cause.at(x[p:], place)]), x[:p], plan)
            for x in (at + step * np.eye(len(at))[k], at - step * np.eye(len(at))[k])
        )
        difference = (up - down) / (2.0 * step)
        size = np.abs(difference).max()
        assert size > 1e-3
        assert slope[:, k] == pytest.approx(difference, abs=1e-7 if k < p else 1e-6 * size)


@each_with_parameters
def test_many_machines_at_once_are_as_one_by_one(cause: Cause, subject: Subject) -> None:
    """With other sizes and other values each, or of the same values."""
    model, plan = beside(cause, subject), subject.plan
    place = cause.places(plan, subject.machine)[-1]
    theta = cause.scale * np.linspace(0.4, -0.7, cause.unknowns)
    factors = np.array([0.3, 1.0, -1.7])
    many = model.extended([cause.at(factors[:, None] * theta, place)])
    for given in (np.outer([1.0, -0.4, 0.7], subject.values), subject.values):
        found, slopes = differentiate(many, given, plan)
        assert np.abs(found - simulate(many, given, plan)).max() < 1e-12
        for k, values in enumerate(np.broadcast_to(given, (3, given.shape[-1]))):
            alone = model.extended([cause.at(factors[k] * theta, place)])
            expected, by_values = differentiate(alone, values, plan)
            assert np.abs(found[k] - expected).max() < 1e-12
            assert np.abs(slopes[k] - by_values).max() < 1e-12


@pytest.mark.parametrize("id", [id for id, cause in CAUSES.items() if cause.by_joint])
def test_a_correction_at_the_joints_cancels_its_cause(id: str) -> None:
    """On the way up and on the way down; so large that a correction of first order would show."""
    cause, home, wanted = CAUSES[id], 310.25, np.linspace(210.0, 370.0, 5)
    theta = np.zeros(cause.unknowns)
    theta[:3] = 20.0 * cause.scale * np.array([1.0, -0.6, 1.7])
    for sign, added in zip((1.0, -1.0), cause.correction(theta, wanted, home), strict=True):
        sent, nothing = wanted[:, None] + added, np.zeros((5, 3))
        command = Command(sent, home, nothing[:, 0], nothing, nothing + sign)
        reached = cause.motion(sent, theta, command)
        assert np.abs(added).min() > 0.1
        assert reached == pytest.approx(np.tile(wanted[:, None], 3), abs=1e-9)
