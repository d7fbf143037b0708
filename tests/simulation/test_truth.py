"""The forward model against the independent truth simulator: offsets, bent machines, motions."""

import numpy as np
import pytest

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES
from orthoglide_cal.machine import Machine
from orthoglide_cal.simulation import simulate
from tests import truth
from tests.causes.condition import as_plan
from tests.machines import LARGE, PROTOTYPE
from tests.truth.forward import PARTS, SIZE

OFFSETS = np.array([0.83, -1.46, 0.57])
# The truth's large machine has other lengths than the file's in parts that no reading sees.
MACHINES = [(PROTOTYPE, truth.PROTOTYPE), (LARGE, truth.LARGE)]
SIZES = {
    "axis_gap": (0.31, -0.52, 0.44),
    "axis_squareness": (1.3, -0.7, 0.9),
    "leg_length": (0.04, -0.02, 0.03),
    "bar_skew": (1.1, -0.6, 0.4, 0.9, -1.3, 0.5),
    "encoder_scale": (0.8, -1.2, 0.5),
    "thermal_drift": (0.05, -0.08, 0.06),
    "backlash": (0.03, 0.02, 0.04),
}
# The truth sets a gauge up where the leg really stood, the model where the offsets alone put it:
# hundredths of a millimetre along a leg that leans by some thousandths.
EXACT, NEAR = 1e-9, 1e-3


def both(
    machine: Machine, hidden: truth.Machine, cause: str | None, offsets: Floats
) -> tuple[Floats, Floats]:
    """Predicted and true signals, each with its gauge zeros removed."""
    plan = truth.standard_plan(hidden, np.random.default_rng(12))
    state = np.zeros(SIZE)
    state[PARTS["offsets"]] = offsets
    effects = []
    if cause is not None:
        values = np.array(SIZES[cause])
        state[PARTS[cause]][: values.size] = values
        kind = CAUSES[cause]
        theta = np.concatenate((values, np.zeros(len(kind.nuisance)))) * kind.scale
        effects = [kind.at(theta)]
    mine = as_plan(plan)
    true = truth.signals(plan, hidden, state[None])[0]
    predicted = simulate(machine, offsets, mine, effects)
    zeros = mine.zeros @ np.linalg.pinv(mine.zeros)
    return predicted - zeros @ predicted, true - zeros @ true


@pytest.mark.parametrize(("machine", "hidden"), MACHINES, ids=["prototype", "large"])
def test_random_offsets(machine: Machine, hidden: truth.Machine) -> None:
    for offsets in np.random.default_rng(20).uniform(-3.0, 3.0, (20, 3)):
        predicted, true = both(machine, hidden, None, offsets)
        assert np.abs(predicted - true).max() < EXACT


@pytest.mark.parametrize(("machine", "hidden"), MACHINES, ids=["prototype", "large"])
@pytest.mark.parametrize("cause", ["axis_gap", "axis_squareness", "leg_length", "bar_skew"])
def test_bent_machines(machine: Machine, hidden: truth.Machine, cause: str) -> None:
    predicted, true = both(machine, hidden, cause, OFFSETS)
    plain = both(machine, hidden, None, OFFSETS)[0]
    assert np.abs(predicted - true).max() < EXACT
    assert np.abs(predicted - plain).max() > 1e-3


@pytest.mark.parametrize(("machine", "hidden"), MACHINES, ids=["prototype", "large"])
@pytest.mark.parametrize("cause", ["encoder_scale", "thermal_drift", "backlash"])
def test_motions(machine: Machine, hidden: truth.Machine, cause: str) -> None:
    predicted, true = both(machine, hidden, cause, OFFSETS)
    plain = both(machine, hidden, None, OFFSETS)[0]
    assert np.abs(predicted - true).max() < NEAR
    assert np.abs(predicted - plain).max() > 3.0 * np.abs(predicted - true).max()
