"""Synthetic sessions: noise, zeros and steps of the gauge; what a file would say beside them."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.model import (
    Gauge,
    double_posture,
    simulate,
    zero_free,
)
from orthoglide_cal.model.model import synthetic_session
from orthoglide_cal.model.orthoglide import PlannedReading, plan_of
from orthoglide_cal.model.readings import Contact
from tests.machines import NOMINAL, PROTOTYPE

OFFSETS = np.array([0.4, -0.9, 0.6])


def test_written_down_readings_have_the_gauges_noise_zeros_and_steps() -> None:
    """Chance of failure about 1e-6 (five standard deviations of a variance)."""
    plan, rng = double_posture(PROTOTYPE), np.random.default_rng(3)
    signal = simulate(NOMINAL, OFFSETS, plan)
    made = (PROTOTYPE.synthetic(plan, lambda _: signal, rng, PROTOTYPE.gauge) for _ in range(4000))
    values = np.array([each.value for each in made])
    steps = values / PROTOTYPE.gauge.resolution_mm
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    spread = (values - signal) @ zero_free(plan).T
    expected = PROTOTYPE.gauge.noise_mm
    assert spread.std() == pytest.approx(expected, rel=5.0 / np.sqrt(2.0 * spread.size) + 0.01)
    zeros = (values - signal)[:, 0]
    assert zeros.min() < -0.9
    assert zeros.max() > 0.9


def test_the_noise_of_a_gauge_is_its_repeatability_and_its_rounding() -> None:
    """q/√12 by hand: 0.012/3.4641 = 0.003464; √(0.003464² + 0.0035²) = 0.004925."""
    gauge = Gauge.model_construct(
        resolution_mm=0.012, range_mm=10.0, revolution_mm=1.0, repeatability_mm=0.0035
    )
    assert gauge.rounding_mm == pytest.approx(0.0034641, abs=1e-7)
    assert gauge.noise_mm == pytest.approx(0.0049244, abs=1e-7)


def test_cycles_are_counted_in_time_within_a_set_up() -> None:
    """Each end of the leg for itself, and each direction."""
    readings = [
        PlannedReading(1, direction, displacement, contact)
        for direction, displacement, contact in (
            (0, 0.0, Contact.FIXED), (0, 30.0, Contact.FIXED), (0, 0.0, Contact.FIXED),
            (0, 30.0, Contact.TOOL), (0, 30.0, Contact.FIXED), (0, 30.0, Contact.FIXED),
            (2, 30.0, Contact.FIXED),
        )
    ]  # fmt: skip
    shuffled = replace(plan_of(readings), order=np.arange(7)[::-1])
    made = synthetic_session(NOMINAL, shuffled, OFFSETS, np.random.default_rng(1))
    assert made.posture == ("iso", "30", "iso", "30", "30", "30", "30")
    assert made.cycle.tolist() == [2, 3, 1, 1, 2, 1, 1]
