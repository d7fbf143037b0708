"""Readings of several sittings solved together."""

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation import solve
from tests import truth
from tests.inference.sessions import known


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
