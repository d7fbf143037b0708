"""The best design: proved by the equivalence theorem, with the truth.

Of all designs w the best one for the sum of the offsets' variances, tr(L M⁻¹) with M = Σ w f fᵀ, is
that whose sensitivity fᵀ M⁻¹ L M⁻¹ f exceeds tr(L M⁻¹) nowhere (Kiefer–Wolfowitz, L-optimality).
Here f are the derivatives of a reading by the three offsets and six zeros, from the truth.
"""

from itertools import combinations

import numpy as np
import pytest

from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import MARGIN, double_posture, visiting
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.design import design_of, readings_needed
from orthoglide_cal.planning.forecast import forecast
from orthoglide_cal.planning.plan import Wanted, measurement_plan
from orthoglide_cal.planning.separation import Separations, separations
from orthoglide_cal.planning.steps import MeasuringProtocol
from tests.machines import PROTOTYPE, both_machines, both_models, sure
from tests.planning.truth import like
from tests.truth.effects import state_with
from tests.truth.forward import signals
from tests.truth.plan import SETUPS, plan_of

OF_OFFSETS = np.diag([1.0] * 3 + [0.0] * 6)


def places(machine: Machine, gauge_at: float, along: Floats) -> tuple[Floats, Floats]:
    """Readings that six gauges could take: displacements (n,) [mm], and f of each, (n, 9)."""
    gauge, own = np.repeat(np.arange(6), len(along) + 1), np.tile([0.0, *along], 6)
    leg, direction = np.array(SETUPS)[gauge].T
    there = {"leg": leg, "direction": direction, "displacement": own, "minutes": 0.0 * own}
    plan = plan_of(like(machine), **there, gauge_at=np.full(len(own), gauge_at))
    step = 1e-3
    states = np.stack([state_with(s * step * e, ()) for s in (1.0, -1.0) for e in np.eye(3)])
    read = signals(plan, like(machine), states)
    return own, np.hstack(((read[:3] - read[3:]).T / (2.0 * step), np.eye(6)[gauge]))


def criterion(columns: Floats, weights: Floats) -> tuple[float, Floats]:
    """tr(L M⁻¹), and the sensitivity at each column, shape (n,)."""
    inverse = np.linalg.inv((columns.T * weights) @ columns)
    bent = inverse @ OF_OFFSETS @ inverse
    return float(np.trace(inverse @ OF_OFFSETS)), np.einsum("ni,ij,nj->n", columns, bent, columns)


@both_machines
def test_no_postures_along_the_legs_do_better(machine: Machine) -> None:
    displacements, gauge_at = design_of(machine)
    own, columns = places(machine, gauge_at, np.linspace(*machine.joint_limits_mm, 81))
    share = [displacements.count(moved) for moved in own.tolist()]
    value, sensitivity = criterion(columns, np.array(share) / sum(share))
    assert sum(share) == 12
    assert sensitivity.max() == pytest.approx(value, rel=1e-6)
    # The same design is seen to be no best one where a posture half-way takes part.
    middle = np.isclose(own, 0.0) / 30.0 + 0.8 * np.array(share) / 12.0
    value, sensitivity = criterion(columns, middle / middle.sum())
    assert sensitivity.max() > 1.1 * value


@both_models
def test_it_takes_at_most_65_percent_of_the_readings(model: Model) -> None:
    """For the same variance of the worst offset; test_forecast finds these by Monte Carlo."""
    displacements, gauge_at = design_of(model.machine)
    plans = [visiting(displacements * 5, gauge_at), double_posture(model.machine, 3)]
    share = readings_needed(model, plans[0]) / readings_needed(model, plans[1])
    assert share <= 0.65
    forecasts = (
        forecast(sure(model), protocol, cycles)
        for protocol, cycles in ((MeasuringProtocol.BEST, 5), (MeasuringProtocol.DOUBLE, 3))
    )
    costs = [max(each.noise_std_mm.values()) ** 2 * len(each.plan) for each in forecasts]
    assert costs[0] / costs[1] == pytest.approx(share, rel=0.01)
    best = measurement_plan(model, Wanted()).design
    assert best.share_of_readings == pytest.approx(share, rel=1e-12)


@pytest.mark.parametrize("limits", [(-100.0, 60.0), (-60.0, 100.0), (-150.0, 130.0), (-20.0, 20.0)])
def test_every_plunger_stays_on_its_bar(limits: tuple[float, float]) -> None:
    """(-150, 130): the whole travel leaves no place for a gauge, so the design uses less of it."""
    machine = PROTOTYPE.changed(joint_limits_mm=limits)
    displacements, gauge_at = design_of(machine)
    moved = np.array(displacements)
    assert np.all((moved >= limits[0]) & (moved <= limits[1]))
    fraction = gauge_at + moved / machine.leg_length_mm
    assert np.all((fraction >= MARGIN - 1e-9) & (fraction <= 1.0 - MARGIN + 1e-9))
    plan = visiting(displacements * 2, gauge_at)
    assert len(plan) == 12 * len(moved)
    assert plan.setups == 6
    assert set(plan.gauge_at.tolist()) == {gauge_at}


def test_limits_of_nothing_let_nothing_be_seen() -> None:
    with pytest.raises(UnusableResultError, match="joint limits"):
        design_of(PROTOTYPE.changed(joint_limits_mm=(0.0, 0.0)))


def trace(found: Separations, id: str) -> float:
    return float(found.trace[[cause.id for cause in found.causes].index(id)])


@both_models
def test_what_it_gives_up_is_what_is_said(model: Model) -> None:
    """`GIVES_UP`, part by part, for the same U."""
    plan = measurement_plan(model, Wanted())
    usual, best = (separations(model, each.plan) for each in (plan.chosen, plan.design))
    left = {id: trace(best, id) / trace(usual, id) for id in ("encoder_scale", "backlash",
            "gauge_drift", "stand_shift", "thermal_drift")}  # fmt: skip
    assert max(left[id] for id in ("encoder_scale", "backlash", "gauge_drift")) < 0.6
    assert 0.8 < left["stand_shift"] < 0.95
    # A machine that warms shows more, not less: it is not said, and not listed.
    assert left["thermal_drift"] > 1.0
    before, after = (found.pairs for found in (usual, best))
    for pair in combinations(("axis_gap", "axis_squareness", "bar_skew"), 2):
        assert after[pair] < 0.1 < 5.0 < before[pair]
