"""A machine and readings of each kind, and every cause on each kind that can have it."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Cause, Model, simulate
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Floats
from tests.machines import NOMINAL, PROTOTYPE
from tests.printers import NOMINAL_PRINTER, readings_of_touches, standard_plan
from tests.readings import readings_of


class Subject(NamedTuple):
    """What causes are tried on.

    Attributes:
        model: the machine; its tolerances are those of the file that ships.
        plan: readings of every sort that the kind has.
        values: of what a calibration determines, (p,).
        file: name of the machine file that ships.
        made: readings of a plan as a file would give them, from their values.
    """

    model: Model
    plan: Any
    values: Floats
    file: str
    made: Callable[[Any, Floats], Readings]

    @property
    def machine(self) -> Machine:
        return self.model.machine

    def measured(self, model: Model, seed: int = 4) -> Readings:
        """What is read on a machine with these values, with the noise of its gauge or probe."""
        rng = np.random.default_rng(seed)
        noise = (
            self.machine.instrument.noise_mm / self.plan.precision * rng.normal(size=len(self.plan))
        )
        return self.made(self.plan, simulate(model, self.values, self.plan) + noise)


SUBJECTS = {
    "Orthoglide": Subject(
        NOMINAL,
        double_posture(PROTOTYPE),
        np.array([0.4, -0.9, 0.6]),
        "orthoglide_prototype.yaml",
        partial(readings_of, PROTOTYPE),
    ),
    "LinearDelta": Subject(
        NOMINAL_PRINTER,
        standard_plan(),
        np.array([0.4, -0.9, 0.6, -0.3, 0.2, -0.1]),
        "linear_delta.yaml",
        readings_of_touches,
    ),
}
every_subject = pytest.mark.parametrize("subject", SUBJECTS.values(), ids=list(SUBJECTS))


def on_each_kind(causes: list[Cause]) -> pytest.MarkDecorator:
    """Parametrise by `cause` and `subject`: each cause on every kind that can have it."""
    cases = [
        pytest.param(cause, SUBJECTS[kind.__name__], id=f"{cause.id}-{kind.__name__}")
        for cause in causes
        for kind in cause.sizes
    ]
    return pytest.mark.parametrize(("cause", "subject"), cases)


every_cause = on_each_kind(list(CAUSES.values()))
