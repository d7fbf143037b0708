"""The data as combinations of readings with equal, independent noise."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.model.measured import DIFFERENCES, DataKind
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import Orthoglide, double_posture
from orthoglide_cal.model.readings import Series
from tests.machines import NOMINAL, PROTOTYPE, SAMPLES
from tests.readings import readings_of


def sample(name: str) -> Whitened:
    return Whitened.of(read_input(str(SAMPLES / name)).measured, NOMINAL)


@pytest.mark.parametrize(
    "name", ["experiment2.csv", "double_posture_session.csv", "single_posture_session.csv"]
)
def test_noise_of_the_whitened_data_is_white(name: str) -> None:
    white = sample(name)
    rows = np.eye(len(white)) @ white.matrix
    assert rows @ rows.T == pytest.approx(np.eye(len(white)), abs=1e-12)
    assert np.abs(white.matrix @ white.plan.zeros).max() < 1e-12
    residual = np.linspace(-0.3, 0.7, len(white))
    assert white.rms(residual) == pytest.approx(np.sqrt(np.mean(white.plain(residual) ** 2)))


def test_six_differences_pass_the_isotropic_posture() -> None:
    """max − min alone would have the carriages go straight from limit to limit."""
    white = sample("experiment2.csv")
    assert set(white.plan.displacement.tolist()) == {0.0, 60.0, -100.0}
    readings = simulate(NOMINAL, np.array([0.3, -0.5, 0.2]), white.plan)
    differences = white.root @ white.matrix @ readings

    def at(series: Series, displacement: float) -> float:
        (value,) = readings[white.plan.of(series) & (white.plan.displacement == displacement)]
        return float(value)

    expected = [
        at(each.series, 60.0) - at(each.series, -100.0) for each in DIFFERENCES[DataKind.SIX]
    ]
    assert white.in_file.tolist() == list(range(6))
    assert differences == pytest.approx(expected, abs=1e-12)
    assert white.plain(white.matrix @ readings) == pytest.approx(expected, abs=1e-12)


def test_defaults_are_scaled_like_what_is_given() -> None:
    silent = Model(PROTOTYPE.changed(tolerances={"misread": 0.2}))
    plan = double_posture(PROTOTYPE)
    readings = replace(readings_of(PROTOTYPE, plan, np.linspace(0.0, 1.0, 60)), timed=False)
    white = Whitened.of(readings, silent)
    doubled = white.scaled(2.0).machine
    for id, cause in CAUSES.items():
        factor = 3.0 if cause.unit == "mm/h" else 1.0
        assert cause.size(white.machine) == factor * cause.size(silent.machine), id
        assert (cause.size(white.machine) > 0.0) == (Orthoglide in cause.sizes), id
        assert cause.size(doubled) == 2.0 * cause.size(white.machine), id
