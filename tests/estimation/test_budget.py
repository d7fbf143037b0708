"""The uncertainty budget: sums, degrees of freedom by the GUM's own example, and what U becomes."""

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.estimation import solve
from orthoglide_cal.estimation.accuracy import Scatter
from orthoglide_cal.estimation.budget import Budget, Contribution, budget_of, warmth
from orthoglide_cal.files.readings import Conditions
from orthoglide_cal.model.machine import Influence, Origin
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Floats
from tests.estimation.sessions import OFFSETS, readings
from tests.machines import NOMINAL, PROTOTYPE, sure

GAUGE = PROTOTYPE.gauge
ROUNDING = GAUGE.resolution_mm / np.sqrt(12.0)
RNG = np.random.default_rng(7)
# What an estimator does with eight readings, and two influences on them.
ESTIMATOR = RNG.normal(size=(3, 8))
PLACES = Influence(Origin.GAUGE_PLACEMENT, 1.0, "mm", True, RNG.normal(0.0, 2e-3, (8, 2)))
LEGS = Influence("leg_length", 0.01, "mm", False, RNG.normal(0.0, 1e-2, (8, 3)))


def part(*stds: float, dof: float = np.inf, source: str = "misread") -> Contribution:
    covariance = np.diag(np.square(stds))
    return Contribution(source, "B", None, "", False, covariance, dof)


def test_each_source_adds_what_it_does_to_the_offsets() -> None:
    """By many readings drawn from it; their covariance is known to 3 % (30,000 draws: 5 σ)."""
    budget = budget_of(ESTIMATOR, GAUGE, Scatter(0.008, 5.0), (PLACES, LEGS))
    rng = np.random.default_rng(1)

    def spread(values: Floats) -> Floats:
        return np.asarray(np.cov(ESTIMATOR @ values))

    repeat = rng.normal(0.0, np.sqrt(0.008**2 - ROUNDING**2), (8, 30_000))
    rounding = rng.uniform(-0.5, 0.5, (8, 30_000)) * GAUGE.resolution_mm
    places, legs = (each.columns @ rng.normal(size=(each.columns.shape[1], 30_000))
                    for each in (PLACES, LEGS))  # fmt: skip
    drawn = (repeat, rounding, places, legs)
    assert [each.source for each in budget.contributions] == [
        Origin.NOISE, Origin.RESOLUTION, Origin.GAUGE_PLACEMENT, "leg_length",
    ]  # fmt: skip
    for each, values in zip(budget.contributions, drawn, strict=True):
        expected = spread(values)
        assert each.covariance_mm2 == pytest.approx(expected, abs=0.03 * np.trace(expected))
        assert each.std_mm == pytest.approx(np.sqrt(np.diag(expected)), rel=0.03)
    together = spread(sum(drawn, np.zeros((8, 30_000))))
    assert budget.covariance_mm2 == pytest.approx(together, abs=0.03 * np.trace(together))
    assert budget.std_mm == pytest.approx(np.sqrt(np.diag(together)), rel=0.03)
    assert [each.evaluation for each in budget.contributions] == ["A", "B", "B", "B"]
    assert [(each.size, each.assumed) for each in budget.contributions[2:]] == [
        (1.0, True), (0.01, False),
    ]  # fmt: skip
    assert budget.largest.source == "leg_length"


def test_without_scatter_the_stated_repeatability_counts() -> None:
    noise, rounding = budget_of(ESTIMATOR, GAUGE, None, ()).contributions
    assert (noise.size, noise.evaluation, noise.dof) == (GAUGE.repeatability_mm, "B", np.inf)
    assert rounding.size == pytest.approx(ROUNDING)
    unit = ESTIMATOR @ ESTIMATOR.T
    assert noise.covariance_mm2 == pytest.approx(GAUGE.repeatability_mm**2 * unit)


@pytest.mark.parametrize(
    ("sigma", "counted"), [(0.001, ROUNDING), (0.003, 0.003), (0.0067, 0.0067), (0.5, 0.5)]
)
def test_the_scatter_alone_has_its_own_degrees_of_freedom(sigma: float, counted: float) -> None:
    """However it is divided between the noise and the rounding, which is in the scatter already.

    No scatter is smaller than the rounding.
    """
    budget = budget_of(ESTIMATOR, GAUGE, Scatter(sigma, 3.0), ())
    assert budget.covariance_mm2 == pytest.approx(counted**2 * ESTIMATOR @ ESTIMATOR.T)
    if sigma == counted:
        assert budget.dof == pytest.approx(3.0)
        assert budget.k == pytest.approx(stats.t.ppf(0.975, 3.0))


def test_effective_degrees_of_freedom_are_those_of_the_gum() -> None:
    """GUM H.1.6, the end gauge: 25, 9.7, 2.9 and 16.6 nm of 18, 25.6, 50 and 2 give 16.7."""
    terms = ((25.0, 18.0), (9.7, 25.6), (2.9, 50.0), (16.6, 2.0))
    # The other two offsets are surer: the one with the fewest degrees of freedom decides.
    budget = Budget(tuple(part(0.0, size, 0.0, dof=dof) for size, dof in terms)).extended(
        [part(10.0, 0.0, 10.0)]
    )
    assert budget.dof == pytest.approx(16.7, abs=0.1)
    assert budget.std_mm[1] == pytest.approx(32.0, abs=0.5)
    assert budget.k == pytest.approx(stats.t.ppf(0.975, budget.dof), rel=1e-9)
    # 93 nm at 99 %.
    assert budget.std_mm[1] * stats.t.ppf(0.995, int(budget.dof)) == pytest.approx(93.0, abs=1.5)
    assert budget.expanded_mm == pytest.approx(budget.k * budget.std_mm)


def test_what_others_leave_is_never_negative() -> None:
    """Of a covariance less another: where that is larger, nothing is left."""
    directions = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    left = Contribution.beyond("axis_gap", directions @ np.diag([4.0, 1.0, -2.0]) @ directions.T)
    expected = directions @ np.diag([4.0, 1.0, 0.0]) @ directions.T
    assert left.covariance_mm2 == pytest.approx(expected)
    assert not left.covariance_mm2.flags.writeable


@pytest.mark.parametrize("method", ["readings", "six", "twelve-linear"])
def test_legs_within_their_tolerance_are_offsets_of_as_much(method: str) -> None:
    """No reading shows a leg's length."""
    session = readings(NOMINAL, double_posture(PROTOTYPE))
    noise = solve(session, sure(NOMINAL), method)
    found = solve(session, NOMINAL, method)
    by_source = {each.source: each for each in found.budget.contributions}
    # But for Δρ/L, half a per cent here.
    assert by_source["leg_length"].std_mm == pytest.approx(np.full(3, 0.01), rel=0.01)
    assert found.budget.largest.source == "leg_length"
    others = [by_source[each].std_mm for each in (Origin.GAUGE_PLACEMENT, Origin.GAUGE_SCALE)]
    expected = np.sqrt(noise.std_mm**2 + 0.01**2 + sum(np.square(others)))
    assert found.std_mm == pytest.approx(expected, rel=0.02)
    # A gauge that is off by 0.1 % makes every offset as much too large or too small.
    assert by_source[Origin.GAUGE_SCALE].std_mm == pytest.approx(
        1e-3 * np.abs(OFFSETS), rel=0.05, abs=2e-5
    )


def test_warmth_is_what_the_legs_may_grow() -> None:
    """Steel, 11.5 µm per metre and kelvin, rectangular; the three offsets go together."""
    (found,) = warmth(26.5, 310.25)
    std = 11.5e-6 * 310.25 * 6.5 / np.sqrt(3.0)
    assert found.covariance_mm2 == pytest.approx(np.full((3, 3), std**2))
    assert (found.source, found.size, found.assumed) == ("temperature", pytest.approx(6.5), False)
    assert warmth(18.0, 310.25)[0].size == pytest.approx(2.0)
    assert warmth(None, 310.25) == ()


def test_the_temperature_is_that_of_the_readings_or_of_the_room() -> None:
    room = (("humidity", "60 %"), ("temperature_c", "24.5"))
    assert Conditions(environment=room).mean_temperature_c == 24.5
    assert Conditions(environment=room, temperature_c=(21.0, 22.0)).mean_temperature_c == 21.5
    assert Conditions(environment=(("temperature_c", "warm"),)).mean_temperature_c is None
    assert Conditions().mean_temperature_c is None
