"""What is uncertain of readings beside noise: its columns, the weights and the budget that follow.

Compared with the independent truth's finite differences and with a fit of every unknown.
"""

from dataclasses import replace

import GTC
import numpy as np
import pytest
from scipy.optimize import least_squares

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.budget import Contribution, Scatter, budget_of, influences, warmth
from orthoglide_cal.estimation.solution import without_zeros
from orthoglide_cal.files.readings import Conditions
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.machine import Influence, Origin
from orthoglide_cal.model.model import Effect, Model
from orthoglide_cal.model.orthoglide import single_posture
from orthoglide_cal.model.plan import Floats
from tests import truth
from tests.inference.sessions import known
from tests.machines import NOMINAL, PROTOTYPE, sure
from tests.truth.effects import state_with
from tests.truth.forward import PARTS, jacobian

OFFSETS = np.array([1.3, -0.8, 2.1])


# Healthy, a good deal out of adjustment.
SESSION = truth.make_session(4, truth.LARGE, truth.MICRON, offset_sd=1.5)
READINGS, MODEL = known(SESSION)
PLAN, HIDDEN = SESSION.plan, SESSION.machine


def by_source(model: Model, offsets: Floats = OFFSETS) -> dict[str, Influence]:
    return {each.source: each for each in influences(model, offsets, READINGS.plan)}


def test_an_accepted_cause_brings_its_own_uncertainty() -> None:
    """With correlations. One of the legs takes the place of their tolerance, counted once."""
    root = 1e-3 * np.array([[0.2, 0.0, 0.0], [0.15, 0.1, 0.0], [-0.07, 0.08, 0.05]])
    sizes = (1.3, -0.8, 0.6)
    tilted = Effect(CAUSES["axis_squareness"], 1e-3 * np.array(sizes), covariance=root @ root.T)
    at = state_with(OFFSETS, (truth.Effect("axis_squareness", parameters=sizes),))
    found = by_source(MODEL.extended([tilted]))
    by_size = 1e3 * jacobian(PLAN, HIDDEN, at)[:, PARTS["axis_squareness"]]
    columns = without_zeros(READINGS.plan, found["axis_squareness"].columns.T).T
    expected = without_zeros(READINGS.plan, (by_size @ root).T).T
    size = np.abs(expected @ expected.T).max()
    assert columns @ columns.T == pytest.approx(expected @ expected.T, abs=2e-3 * size)
    assert (found["axis_squareness"].size, found["axis_squareness"].assumed) == (None, False)
    assert found["leg_length"].size == truth.TOLERANCES["leg_length"]

    legs = Effect(CAUSES["leg_length"], np.zeros(3), covariance=np.diag([0.002, 0.0, 0.001]) ** 2)
    accepted = influences(MODEL.extended([legs]), OFFSETS, READINGS.plan)
    (one,) = [each for each in accepted if each.source == "leg_length"]
    assert one.size is None
    by_size = jacobian(PLAN, HIDDEN, state_with(OFFSETS, ()))[:, PARTS["leg_length"]] * [
        0.002,
        0.0,
        0.001,
    ]
    assert one.columns @ one.columns.T == pytest.approx(by_size @ by_size.T, rel=2e-3, abs=1e-9)


def test_sizes_that_nobody_stated_are_marked() -> None:
    stated = MODEL.machine.gauge.changed(placement_mm=0.4, scale_u=0.0003)
    found = by_source(Model(MODEL.machine.changed(gauge=stated)))
    assert [(each.size, each.unit, each.assumed) for each in found.values()] == [
        (0.0003, "", False), (0.4, "mm", False), (0.01, "mm", False),
    ]  # fmt: skip
    bare = MODEL.machine.changed(tolerances={})
    assumed = by_source(replace(MODEL, machine=bare))
    assert [each.assumed for each in assumed.values()] == [True, True, True]
    none = by_source(sure(MODEL))
    assert all(np.abs(each.columns).max() < 1e-9 for each in none.values())
    assert "leg_length" not in none
    # A gauge at the ends of a leg needs no place along it.
    sources = [each.source for each in influences(NOMINAL, OFFSETS, single_posture(PROTOTYPE))]
    assert sources == [Origin.GAUGE_SCALE, "leg_length"]


class EveryUnknown:
    """A fit of offsets, zeros, places, legs and scale together; the last three have priors."""

    def __init__(self, session: truth.Session) -> None:
        plan, n, sigma = session.plan, session.plan.count, session.gauge.sigma
        sizes = np.r_[np.full(6, truth.machines.PLACEMENT), np.full(3, 0.01), truth.machines.SCALE]

        def misfit(unknowns: Floats) -> Floats:
            offsets, zeros, others = np.split(unknowns, [3, 9])
            places, legs, scale = np.split(sizes * others, [6, 9])
            at = state_with(offsets, (truth.Effect("leg_length", parameters=tuple(legs)),))
            surface = truth.signals(plan, session.machine, at[None], None, places)[0]
            predicted = (1.0 + scale) * (surface + zeros[plan.setup])
            return np.asarray(np.concatenate(((session.readings - predicted) / sigma, others)))

        start = np.zeros(19)
        fit = least_squares(misfit, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15)
        self.offsets = fit.x[:3]
        # What each reading does to the offsets, (3, n).
        self.estimator = np.linalg.solve(fit.jac.T @ fit.jac, fit.jac[:n].T)[:3] / -sigma
        # What a standard deviation of each place, leg, and the scale adds to the readings, (n, 10).
        self.columns = -sigma * fit.jac[:n, 9:]
        self.dof = n - 9
        self.scatter = sigma * float(np.sqrt(2.0 * fit.cost / self.dof))


@pytest.mark.parametrize(
    ("gauge", "cycles"),
    [(truth.MICRON, 3), (truth.DIAL, 1), (replace(truth.DIAL, noise=0.04), 1)],
    ids=["micron", "dial", "rough"],
)
def test_the_budget_is_that_of_gtc(gauge: truth.Gauge, cycles: int) -> None:
    """Offsets; sources, u, k and U of uncertain numbers that know nothing of this program.

    The scatter of all readings is one estimate, with the rounding in it. To 0.1 % of u: the program
    is linear about plain least squares, this about the fit of every unknown.
    """
    session = truth.make_session(4, truth.PROTOTYPE, gauge, offset_sd=1.5, cycles=cycles)
    measured, model = known(session)
    solution = solve(measured, model)
    budget = solution.budget.extended(warmth(26.5, session.machine.leg))
    other, n = EveryUnknown(session), session.plan.count
    # The program weighs once, at plain least squares; the rest is of second order.
    assert solution.offsets_mm == pytest.approx(
        other.offsets, abs=0.01 * solution.budget.std_mm.min()
    )
    if gauge is truth.MICRON:
        plain = solve(measured, sure(model)).offsets_mm
        assert np.abs(solution.offsets_mm - plain).max() > 0.1 * solution.budget.std_mm.min()
    noise = GTC.multiple_ureal([0.0] * n, [other.scatter] * n, other.dof)
    unit = [GTC.ureal(0.0, 1.0) for _ in range(10)]
    # Up to all of the growth of steel legs, rectangular.
    growth = 11.5e-6 * session.machine.leg * 6.5
    warm = GTC.ureal(0.0, GTC.tb.uniform(growth))
    sources = {
        Origin.GAUGE_PLACEMENT: unit[:6],
        "leg_length": unit[6:9],
        Origin.GAUGE_SCALE: unit[9:],
        Origin.TEMPERATURE: [warm],
    }
    carried, offsets = other.estimator @ other.columns, []
    for by_reading, by_unit in zip(other.estimator.tolist(), carried.tolist(), strict=True):
        terms = [*zip(by_reading, noise, strict=True), *zip(by_unit, unit, strict=True)]
        offsets.append(GTC.result(sum(factor * x for factor, x in terms) + warm))
    std = np.array([GTC.uncertainty(offset) for offset in offsets])
    by_source = {one.source: one.std for one in budget.contributions}
    scatter = np.hypot(by_source.pop(Origin.NOISE), by_source.pop(Origin.RESOLUTION))
    assert by_source.keys() == sources.keys()
    for found, inputs in ((scatter, noise), *((by_source[key], sources[key]) for key in sources)):
        expected = [np.hypot.reduce([GTC.rp.u_component(y, x) for x in inputs]) for y in offsets]
        assert found == pytest.approx(expected, abs=1e-3 * std.min())
    dof = min(GTC.dof(offset) for offset in offsets)
    assert budget.std_mm == pytest.approx(std, rel=1e-3)
    assert budget.dof == pytest.approx(dof, rel=5e-3)
    assert budget.k == pytest.approx(GTC.rp.k_factor(dof), rel=1e-4)
    assert budget.expanded_mm == pytest.approx(GTC.rp.k_factor(dof) * std, rel=1e-3)


GAUGE = PROTOTYPE.gauge
ROUNDING = GAUGE.resolution_mm / np.sqrt(12.0)
RNG = np.random.default_rng(7)
ESTIMATOR = RNG.normal(size=(3, 8))  # of offsets from eight readings


def test_without_scatter_the_stated_repeatability_counts() -> None:
    noise, rounding = budget_of(ESTIMATOR, GAUGE, None, ()).contributions
    assert (noise.size, noise.type, noise.dof) == (GAUGE.repeatability_mm, "B", np.inf)
    assert rounding.size == pytest.approx(ROUNDING)
    unit = ESTIMATOR @ ESTIMATOR.T
    assert noise.covariance_mm2 == pytest.approx(GAUGE.repeatability_mm**2 * unit)


@pytest.mark.parametrize("dof", [1, 2, 3])
def test_few_readings_to_spare_cover_as_stated(dof: int) -> None:
    """By chance they scatter less than the gauge rounds; U holds 95 % of the errors all the same.

    Of 2,000 draws, always the same; others would be 3.3 standard deviations lower once in 2,000.
    """
    rng, draws, sigma = np.random.default_rng(dof), 2000, np.hypot(GAUGE.repeatability_mm, ROUNDING)
    scatters = sigma * np.sqrt(rng.chisquare(dof, draws) / dof)
    error = sigma * np.linalg.norm(ESTIMATOR[0]) * rng.normal(size=draws)
    budgets = [budget_of(ESTIMATOR, GAUGE, Scatter(one, dof), ()) for one in scatters]
    expanded = np.array([budget.expanded_mm[0] for budget in budgets])
    assert np.mean(np.abs(error) <= expanded) > 0.95 - 3.3 * np.sqrt(0.95 * 0.05 / draws)


def test_what_others_leave_is_never_negative() -> None:
    """Of a covariance less another: where that is larger, nothing is left."""
    directions = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    left = Contribution.beyond("axis_gap", directions @ np.diag([4.0, 1.0, -2.0]) @ directions.T)
    expected = directions @ np.diag([4.0, 1.0, 0.0]) @ directions.T
    assert left.covariance_mm2 == pytest.approx(expected)
    assert not left.covariance_mm2.flags.writeable


def test_warmth_is_what_the_legs_may_grow() -> None:
    """Either side of 20 °C, all offsets together; of a temperature that nobody wrote down, none."""
    (found,) = warmth(26.5, 310.25)
    assert found.covariance_mm2 == pytest.approx(np.full((3, 3), found.std[0] ** 2))
    assert (found.source, found.size, found.assumed) == ("temperature", pytest.approx(6.5), False)
    assert warmth(18.0, 310.25)[0].size == pytest.approx(2.0)
    assert warmth(None, 310.25) == ()


def test_the_temperature_is_that_of_the_readings_or_of_the_room() -> None:
    room = {"humidity": "60 %", "temperature_c": "24.5"}
    assert Conditions(environment=room).mean_temperature_c == 24.5
    assert Conditions(environment=room, temperature_c=(21.0, 22.0)).mean_temperature_c == 21.5
    assert Conditions(environment={"temperature_c": "warm"}).mean_temperature_c is None
    assert Conditions().mean_temperature_c is None
