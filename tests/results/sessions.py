"""Synthetic sessions in memory, as inputs; shared by the tests of results and verification."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from orthoglide_cal.files.input import Input
from orthoglide_cal.files.readings import Conditions, session_of_readings, session_text
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.readings import GaugePlan
from tests.machines import NOMINAL, PROTOTYPE
from tests.readings import readings_of

TRUE = np.array([-0.53, 0.59, -1.76])
# With a digital gauge of 1 µm.
FINE_GAUGE = PROTOTYPE.gauge.changed(resolution_mm=0.001, repeatability_mm=0.003)
FINE = Model(PROTOTYPE.changed(gauge=FINE_GAUGE))


def session(
    offsets: Sequence[float] | np.ndarray,
    seed: int,
    model: Model = NOMINAL,
    plan: GaugePlan | None = None,
) -> Readings:
    """A simulated session with noise, rounding and arbitrary gauge zeros.

    Args:
        offsets: true Δρ that the controller does not know [mm].
        seed: of the random numbers.
        model: the machine with what is wrong with it.
        plan: the double-posture protocol if None.
    """
    machine = model.machine
    plan = plan or double_posture(machine)
    rng = np.random.default_rng(seed)
    signal = simulate(model, np.array(offsets, dtype=float), plan)
    zeros = rng.uniform(0.5, 5.0, plan.setups)
    noisy = signal + zeros[plan.setup] + rng.normal(0.0, machine.gauge.repeatability_mm, len(plan))
    step = machine.gauge.resolution_mm
    return readings_of(machine, plan, np.round(noisy / step) * step)


def given(
    measured: Readings, model: Model = NOMINAL, conditions: Conditions | None = None
) -> Input:
    """Readings as the input of a command that reads a session."""
    return Input(measured, model, conditions or Conditions(), recorded=model)


def write(measured: Readings, model: Model, path: Path, **more: str) -> None:
    """A session file of readings; `more` are further keys of it."""
    session = session_of_readings(measured, model, {}).model_copy(update=more)
    path.write_text(session_text(session), encoding="utf-8")
