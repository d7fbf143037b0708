"""One condition of a machine, given to the program and to the independent simulator alike."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.cause import Effect
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan
from tests import truth
from tests.machines import NOMINAL, NOMINAL_LARGE
from tests.truth.forward import PARTS, SIZE

# The truth's large machine has other lengths than the file's in parts that no reading sees.
MACHINES = {"prototype": (NOMINAL, truth.PROTOTYPE), "large": (NOMINAL_LARGE, truth.LARGE)}
# In the contract's units, no two alike, no symmetry between the axes.
SIZES = {
    "axis_gap": (0.37, -0.58, 0.23),
    "axis_squareness": (1.9, -0.7, 1.2),
    "leg_length": (0.05, -0.03, 0.11),
    "encoder_scale": (1.4, -2.3, 0.6),
    "backlash": (0.061, 0.023, 0.042, 0.011, -0.007, 0.017),
    "thermal_drift": (0.13, -0.07, 0.19),
    "bar_skew": (1.1, -0.6, 0.4, 0.9, -1.3, 0.5),
}


def standard(machine: truth.Machine) -> truth.Plan:
    return truth.standard_plan(machine, np.random.default_rng(12))


def with_stands_at_rest(plan: truth.Plan) -> truth.Plan:
    """The plan behind six more readings, one per set-up: the machine at iso, before anything.

    The truth sets each gauge up where the leg really stands at its first reading; the program
    where the offsets alone put it. Here both mean these six readings.
    """
    first = np.array([int(np.flatnonzero(plan.setup == s)[0]) for s in range(6)])

    count = plan.count
    both = plan.rows(np.concatenate((first, np.arange(count))))
    early = np.arange(6 + count) < 6
    return replace(
        both,
        posture=(("iso",) * 6 + plan.posture),
        displacement=np.where(early, 0.0, both.displacement),
        minutes=np.where(early, 0.0, both.minutes),
        approach=np.where(early[:, None], 0.0, both.approach),
        stand=np.concatenate((np.arange(6), plan.setup)),
    )


def as_plan(plan: truth.Plan) -> GaugePlan:
    """The truth's plan as the program's."""
    n = plan.count
    return GaugePlan(
        leg=plan.leg,
        direction=plan.direction,
        displacement=plan.displacement,
        contact=np.full(n, Contact.FIXED),
        gauge_at=plan.gauge_at,
        setup=plan.zero,
        order=np.arange(n),
        hours=plan.hours,
        part=plan.part,
        turned=plan.turned,
        entered=plan.entered,
    )


def state_of(cause: str | None, offsets: Floats) -> Floats:
    """The truth's condition vector, shape (1, 30)."""
    state = np.zeros((1, SIZE))
    state[0, PARTS["offsets"]] = offsets
    if cause is not None:
        state[0, PARTS[cause]] = SIZES[cause]
    return state


def effect_of(id: str) -> Effect:
    """The program's effect of the same sizes."""
    values = np.array(SIZES[id])
    if id == "backlash":
        # The truth counts the first positions against the sense of the carriage.
        values[3:] *= -1.0
    return CAUSES[id].at(values * CAUSES[id].scale)
