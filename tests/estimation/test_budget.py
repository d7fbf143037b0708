"""The uncertainty budget where readings say little, and what U becomes."""

import numpy as np
import pytest

from orthoglide_cal.estimation.accuracy import Scatter
from orthoglide_cal.estimation.budget import Contribution, budget_of, warmth
from orthoglide_cal.files.readings import Conditions
from tests.machines import PROTOTYPE

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
    room = (("humidity", "60 %"), ("temperature_c", "24.5"))
    assert Conditions(environment=room).mean_temperature_c == 24.5
    assert Conditions(environment=room, temperature_c=(21.0, 22.0)).mean_temperature_c == 21.5
    assert Conditions(environment=(("temperature_c", "warm"),)).mean_temperature_c is None
    assert Conditions().mean_temperature_c is None
