"""Forecast of the next reading, from the readings before it, and how sure that is.

A reading is, near the nominal machine and before any of it is measured,

    y = h(0) + ∂h/∂Δρ · Δρ + zero + misfit + drift·t + settling + noise

with normally distributed unknowns: joint offsets, one zero per gauge set-up, what the model
leaves out at each posture (the same in each cycle), the drift of each gauge, and what changes
after a leg's first posture. Their sizes come from the machine file; how large the misfit is on
this machine shows only in the readings, so several sizes are carried along, each with the
likelihood that the readings give it.
"""

import math
from dataclasses import replace

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.budget import plausible_causes
from orthoglide_cal.estimation.gaussian import Mixture
from orthoglide_cal.model.cause import PER_HOUR
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model, simulate, simulate_with_jacobian
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import GaugePlan

# Standard deviations of what nobody knows before the first reading [mm].
OFFSET_MM = 3.0
ZERO_MM = 50.0
UNKNOWN_MM = 5.0
# Sizes of the misfit that are carried along, in units of `misfit_mm`.
_SIZES = np.array([1 / 27, 1 / 9, 1 / 3, 1.0, 3.0])


class PlanForecast:
    """Knowledge of a plan's readings before the first is taken: computed once.

    Some of them, in the order in which they are taken, are then forecast by selection.
    """

    def __init__(self, model: Model, plan: GaugePlan) -> None:
        """The gauge of its machine and the sizes of its causes give the standard deviations;
        set-ups and times are those that a forecast names."""
        self._model, self._plan, machine = model, plan, model.machine
        self._zero = np.zeros(len(machine.parameter_names))
        self._base, self._jacobian = simulate_with_jacobian(Model(machine), self._zero, plan)
        if model.accepted:
            self._base = simulate(model, self._zero, plan)
        causes = CAUSES.values()
        self._drift = math.hypot(*(c.size(machine) for c in causes if c.unit == PER_HOUR))
        self._settling = math.hypot(*(c.size(machine) for c in causes if c.settles))
        self._misfits = _SIZES * misfit_mm(machine)

    def forecast(
        self, rows: Ints, setup: Ints, order: Ints, hours: Floats, fresh: Ints, sigma_mm: float
    ) -> Mixture:
        """Some of the plan's readings, for each size of the misfit; all arrays have shape (m,).

        Args:
            rows: which readings of the plan.
            setup: 0 … k−1; readings of one set-up share a zero.
            order, hours: rank in time, and when they are taken [h].
            fresh: where not 0, nothing is known of a reading but its repeats with the same number.
            sigma_mm: standard deviation of one reading.
        """
        known, plan = fresh == 0, self._plan
        slopes, first = self._jacobian[rows] * known[:, None], self._first_visits(rows, order)
        cells = _same(plan.cells[rows], fresh)
        common = (
            OFFSET_MM**2 * slopes @ slopes.T
            + ZERO_MM**2 * _same(setup)
            + UNKNOWN_MM**2 * (cells & ~known)
            + _same(plan.leg[rows], plan.direction[rows])
            * (self._drift**2 * np.outer(hours, hours) + self._settling**2 * np.outer(first, first))
            + sigma_mm**2 * np.eye(len(rows))
        )
        base = self._base[rows]
        if not self._model.repeats:
            # Time plays a part in a known effect: what is expected depends on when it is read.
            plan = replace(plan.subset(rows), setup=setup, order=order, hours=hours)
            base = simulate(self._model, self._zero, plan)
        size2, count = self._misfits[:, None, None] ** 2, len(self._misfits)
        return Mixture(
            np.tile(base[:, None], (count, 1, 1)),
            common + size2 * (cells & known),
            np.full((count, 1), -math.log(count)),
        )

    def _first_visits(self, rows: Ints, order: Ints) -> np.ndarray:
        """True while the leg's carriage has not moved away from where it began, shape (m,)."""
        leg, moved = self._plan.leg[rows], self._plan.displacement[rows]
        first = np.zeros(len(rows), dtype=bool)
        for mine in (np.flatnonzero(leg == k) for k in np.unique(leg)):
            away = moved[mine] != moved[mine[np.argmin(order[mine])]]
            first[mine] = order[mine] < order[mine][away].min(initial=np.iinfo(np.intp).max)
        return first


def misfit_mm(machine: Machine) -> float:
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
