"""One condition of a machine, given to the program and to the independent simulator alike."""

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.cause import Effect
from orthoglide_cal.model.readings import Contact, GaugePlan
from tests import truth
from tests.machines import NOMINAL, NOMINAL_LARGE
from tests.truth.plan import plan_of

# The truth's large machine has other lengths than the file's in parts that no reading sees.
MACHINES = {"prototype": (NOMINAL, truth.PROTOTYPE), "large": (NOMINAL_LARGE, truth.LARGE)}
# In the contract's units, no two alike, no symmetry between the axes.
HIDDEN = {
    id: truth.Effect(id, parameters=sizes)
    for id, sizes in {
        "axis_gap": (0.37, -0.58, 0.23),
        "axis_squareness": (1.9, -0.7, 1.2),
        "leg_length": (0.05, -0.03, 0.11),
        "encoder_scale": (1.4, -2.3, 0.6),
        "backlash": (0.061, 0.023, 0.042, 0.011, -0.007, 0.017),
        "thermal_drift": (0.13, -0.07, 0.19),
        "bar_skew": (1.1, -0.6, 0.4, 0.9, -1.3, 0.5),
    }.items()
}


def standard(machine: truth.Machine) -> truth.Plan:
    return truth.standard_plan(machine, np.random.default_rng(12))


def with_stands_at_rest(machine: truth.Machine, plan: truth.Plan) -> truth.Plan:
    """The plan behind six more readings, one per set-up: the machine at iso, before anything.

    The truth sets each gauge up where the leg really stands at its first reading; the program
    where the offsets alone put it. Here both mean these six readings.
    """
    first = np.unique(plan.stand)
    columns = {
        name: np.concatenate((getattr(plan, name)[first], getattr(plan, name)))
        for name in ("leg", "direction", "displacement")
    }
    return plan_of(machine, **columns, minutes=np.concatenate((np.zeros(6), plan.minutes)))


def as_plan(plan: truth.Plan) -> GaugePlan:
    """The truth's plan as the program's."""
    same = "leg", "direction", "displacement", "gauge_at", "hours", "part", "turned", "entered"
    rest = {"contact": np.full(plan.count, Contact.FIXED), "order": np.arange(plan.count)}
    return GaugePlan(**{name: getattr(plan, name) for name in same}, setup=plan.zero, **rest)


def effect_of(id: str) -> Effect:
    """The program's effect of the same sizes."""
    values = np.array(HIDDEN[id].parameters)
    if id == "backlash":
        # The truth counts the first positions against the sense of the carriage.
        values[3:] *= -1.0
    return CAUSES[id].at(values * CAUSES[id].scale)
