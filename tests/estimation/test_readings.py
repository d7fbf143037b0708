"""All raw readings at once, also of several sittings: least squares with a zero per set-up."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Method, solve
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import Measured, Readings
from orthoglide_cal.model.model import Model, simulate_with_jacobian
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import GaugePlan
from tests import truth
from tests.estimation.sessions import (
    BENT,
    OFFSETS,
    SINGLE,
    SIX,
    TWELVE,
    differences,
    merged,
    readings,
)
from tests.inference.sessions import known
from tests.machines import NOMINAL, NOMINAL_LARGE, PROTOTYPE, both_models, sure
from tests.readings import some


def explicit(session: Readings, model: Model) -> tuple[Floats, Floats]:
    """Offsets and covariance/σ² by Gauss–Newton on offsets and zeros together, the long way."""
    many = len(model.machine.parameter_names)
    offsets = np.zeros(many)
    weight = session.plan.precision[:, None]
    for _ in range(20):
        h, jacobian = simulate_with_jacobian(model, offsets, session.plan)
        design = weight * np.hstack((jacobian, session.plan.zeros))
        step = np.linalg.lstsq(design, weight[:, 0] * (session.value - h), rcond=None)[0]
        offsets = offsets + step[:many]
    return offsets, np.asarray(np.linalg.inv(design.T @ design)[:many, :many], dtype=np.float64)


@both_models
@pytest.mark.parametrize("protocol", ["double", "part", "single"])
def test_the_default_for_raw_readings_is_least_squares_with_zeros(
    model: Model, protocol: str
) -> None:
    """Joining the repeats of a cell gives what all of them give, of whatever number they are."""
    machine = model.machine
    plan = single_posture(machine, 3) if protocol == "single" else double_posture(machine)
    session = readings(model, plan)
    if protocol == "part":
        session = some(session, np.random.default_rng(5).choice(60, 35, replace=False))
    solution = solve(session, sure(model))
    offsets, covariance = explicit(session, model)
    assert solution.method is Method.READINGS
    assert solution.offsets_mm == pytest.approx(offsets, abs=1e-9)
    assert solution.budget.covariance_mm2 == pytest.approx(
        solution.noise.sigma_mm**2 * covariance, rel=1e-7
    )
    assert solution.dof == len(session) - session.plan.setups - 3


# Unequal repeats, some missing.
SOME = np.random.default_rng(4).choice(60, 35, replace=False)


def other_postures(plan: GaugePlan) -> GaugePlan:
    """The same readings where nobody else takes them."""
    return replace(plan, displacement=0.6 * plan.displacement + 3.0)


PLANS: dict[str, Callable[[Machine], GaugePlan]] = {
    "whole": double_posture,
    "gauges near a carriage": lambda machine: double_posture(machine, gauge_at=0.2),
    "gauges near the tool": lambda machine: double_posture(machine, gauge_at=0.9),
    "gauges at two places": lambda machine: merged(
        *(double_posture(machine, 1, gauge_at=f) for f in (0.3, 0.6))
    ),
    "more postures": lambda machine: merged(
        double_posture(machine), other_postures(double_posture(machine))
    ),
    "other postures": lambda machine: other_postures(double_posture(machine)),
    "any part": lambda machine: double_posture(machine).subset(SOME),
}


@pytest.mark.parametrize("model", [NOMINAL, NOMINAL_LARGE, BENT], ids=["nominal", "large", "bent"])
@pytest.mark.parametrize("name", PLANS)
def test_exact_readings_give_the_true_offsets(model: Model, name: str) -> None:
    """By all readings, and by the paper's differences of those at its postures."""
    session = readings(model, PLANS[name](model.machine), seed=None)
    if name == "other postures":
        assert solve(session, model).promised() == ()
    papers = ["six", "twelve"] if name.startswith(("whole", "gauges near")) else []
    for method in ["readings", *papers]:
        solution = solve(session, model, method)
        assert solution.offsets_mm == pytest.approx(OFFSETS, abs=1e-9)
        assert solution.rms_after_mm < 1e-9
        assert solution.predicted_mm == pytest.approx(session.value, abs=1e-9)
        assert solution.method == method
        if model is BENT and name == "whole":
            assert np.abs(solve(session, NOMINAL, method).offsets_mm - OFFSETS).max() > 0.05


DOUBLE, SINGLE_POSTURE = (
    readings(NOMINAL, protocol(PROTOTYPE)) for protocol in (double_posture, single_posture)
)


@pytest.mark.parametrize(
    ("data", "usable"),
    [
        (differences(SIX, NOMINAL), ("six-linear", "six")),
        (differences(TWELVE, NOMINAL), ("six-linear", "twelve-linear", "six", "twelve")),
        (differences(SINGLE, NOMINAL), ("single", "single-sequential")),
        (DOUBLE, ("six-linear", "twelve-linear", "six", "twelve", "readings")),
        (SINGLE_POSTURE, ("single", "single-sequential", "readings")),
    ],
    ids=["six", "twelve", "single", "readings", "single-posture readings"],
)
def test_which_methods_data_can_feed(data: Measured, usable: tuple[str, ...]) -> None:
    assert solve(data, NOMINAL).method is Method(data.kind)
    for name in usable:
        assert solve(data, NOMINAL, name).method == name
    for name in set(Method) - set(usable):
        with pytest.raises(UsageError, match=f"Method {name} cannot use") as caught:
            solve(data, NOMINAL, name)
        assert f"one of {', '.join(usable)}." in caught.value.remedy
    with pytest.raises(UsageError, match="no method 'best'"):
        solve(data, NOMINAL, "best")


def test_what_depends_on_time_and_motion_runs_on_through_the_parts() -> None:
    """Drift by the clock, lost motion by where each carriage came from, a step's way included."""
    hidden = ("thermal_drift", "backlash")
    first = truth.make_session(7, truth.PROTOTYPE, truth.MICRON, hidden, exact=True, pace=2.0)
    # Each leg in the order iso, min, max, and a step entered for the last leg.
    new = np.concatenate([20 * leg + np.array([0, 4, 2, 6, 10, 8, 18]) for leg in range(3)])
    plan = first.plan
    names = ("leg", "direction", "displacement", "gauge_at", "turned")
    both = truth.continue_session(
        first, 1, **{name: getattr(plan, name)[new] for name in names},
        order=np.arange(21), hours=plan.hours[-1] + 1.0 + np.arange(21) / 30.0,
        part=np.ones(21, dtype=int), entered=np.outer(np.arange(21) > 13, [0.0, 0.4, -0.6]),
    )  # fmt: skip
    measured, model = known(both)
    command = model.machine.command(measured.plan)
    assert command.approach.tolist() == both.plan.approach.tolist()
    drift, lost = (np.array(effect.parameters) for effect in both.effects)
    causes = (
        CAUSES["thermal_drift"].at(drift),
        CAUSES["backlash"].at(np.concatenate((lost[:3], -lost[3:]))),
    )
    solution = solve(measured, model.extended(causes))
    assert solution.lack_of_fit_p > 1e-3
    assert np.all(np.abs(solution.offsets_mm - first.offsets) < 4.0 * solution.std_mm)
    assert solve(measured, model).lack_of_fit_p < 1e-12
