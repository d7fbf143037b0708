"""Forecast of the next reading, from the readings before it, and how sure that is.

A reading is, near the nominal machine and before any of it is measured,

    y = h(0) + ∂h/∂Δρ · Δρ + zero + misfit + drift·t + settling + noise

with normally distributed unknowns: joint offsets, one zero per gauge set-up, what the model
leaves out at each posture (the same in each cycle), the drift of each gauge, and what changes
after a leg's first posture. Their sizes come from the machine file; how large the misfit is on
this machine shows only in the readings, so several sizes are carried along, each with the
likelihood that the readings give it.
"""

import functools
import math

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.budget import plausible_causes
from orthoglide_cal.estimation.gaussian import Mixture
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import PER_HOUR, Model, differentiate, simulate
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Ints
from orthoglide_cal.model.readings import GaugePlan

# Standard deviations of what nobody knows before the first reading [mm].
OFFSET_MM = 3.0
ZERO_MM = 50.0
UNKNOWN_MM = 5.0
# Sizes of the misfit that are carried along, in plausible ones.
_SIZES = np.array([1 / 27, 1 / 9, 1 / 3, 1.0, 3.0])


def forecast(model: Model, plan: GaugePlan, fresh: Ints, sigma_mm: float) -> Mixture:
    """Readings of a plan (m,) before the first is taken, for each size of the misfit.

    Args:
        model: the sizes of its machine's causes give standard deviations.
        plan: readings of one set-up share a zero.
        fresh: shape (m,); where not 0, nothing is known of a reading but its repeats with the same
            number.
        sigma_mm: standard deviation of one reading.
    """
    machine, causes = model.machine, CAUSES.values()
    zero = np.zeros(len(machine.parameter_names))
    drift = math.hypot(*(cause.size(machine) for cause in causes if cause.unit == PER_HOUR))
    settling = math.hypot(*(cause.size(machine) for cause in causes if cause.settles))
    _, slopes = differentiate(Model(machine), zero, plan)
    known, first = fresh == 0, _first_visits(plan)
    slopes, cells = slopes * known[:, None], _same(plan.cells, fresh)
    common = (
        OFFSET_MM**2 * slopes @ slopes.T
        + ZERO_MM**2 * _same(plan.setup)
        + UNKNOWN_MM**2 * (cells & ~known)
        + _same(plan.leg, plan.direction)
        * (drift**2 * np.outer(plan.hours, plan.hours) + settling**2 * np.outer(first, first))
        + sigma_mm**2 * np.eye(len(plan))
    )
    size2, count = (_SIZES * plausible_misfit_mm(machine))[:, None, None] ** 2, len(_SIZES)
    return Mixture(
        np.tile(simulate(model, zero, plan)[:, None], (count, 1, 1)),
        common + size2 * (cells & known),
        np.full((count, 1), -math.log(count)),
    )


def _first_visits(plan: GaugePlan) -> np.ndarray:
    """True while the leg's carriage has not moved away from where it began, shape (m,)."""
    first = np.zeros(len(plan), dtype=bool)
    for mine in (np.flatnonzero(plan.leg == leg) for leg in np.unique(plan.leg)):
        order, moved = plan.order[mine], plan.displacement[mine]
        away = moved != moved[np.argmin(order)]
        first[mine] = order < order[away].min(initial=np.iinfo(np.intp).max)
    return first


@functools.lru_cache(maxsize=8)  # asked for at every reading
def plausible_misfit_mm(machine: Machine) -> float:
    """Plausible size of what the model leaves out of a posture's reading, of all causes [mm].

    Of each cause at the posture that it changes most, compared with the isotropic one.
    """
    hidden, plan = machine.unobservable, double_posture(machine, cycles=1)
    ids = [cause.id for cause in CAUSES.values() if cause.repeats and cause.id not in hidden]
    _, plausible = plausible_causes(ids, Model(machine), np.zeros(3), plan)
    isotropic = np.unique(plan.setup, return_index=True)[1][plan.setup]
    moved = (one.columns - one.columns[isotropic] for one in plausible)
    return math.hypot(*(float(np.linalg.norm(columns, axis=1).max()) for columns in moved))


def _same(*keys: Ints) -> np.ndarray:
    """True where two entries are equal in every key (n,), shape (n, n)."""
    return np.asarray(np.all([key[:, None] == key for key in keys], axis=0))
