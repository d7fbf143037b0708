"""What the next reading should be, from the readings before it, and how sure that is.

A reading is, near the nominal machine and before any of it is measured,

    y = h(0) + ∂h/∂Δρ · Δρ + zero + misfit + drift·t + settling + noise

with normally distributed unknowns: joint offsets, one zero per gauge set-up, what the model
leaves out at each posture (the same in each cycle), the drift of each gauge, and what changes
after a leg's first posture. Their sizes come from the machine file; how large the misfit is on
this machine shows only in the readings, so several sizes are carried along, each with the
likelihood that the readings give it. Everything is batched over leading axes of the readings.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import erfc

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.gaussian import log_density, log_sum, predict
from orthoglide_cal.model.model import Model, simulate, simulate_with_jacobian
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import GaugePlan

# Standard deviations of what nobody knows before the first reading [mm].
OFFSET_MM = 3.0
ZERO_MM = 50.0
UNKNOWN_MM = 5.0
# Sizes of the misfit that are carried along, in units of `misfit_mm`.
_SIZES = np.array([1 / 27, 1 / 9, 1 / 3, 1.0, 3.0])
# The parts of a plan that say what is read, not when and with which zero.
PLACE = ("leg", "direction", "displacement", "contact", "gauge_at", "part", "turned", "entered")


@dataclass(frozen=True, eq=False)
class Prediction:
    """A mixture of normal distributions, one for each of T sizes of the misfit."""

    means: Floats  # shape (..., T) [mm]
    stds: Floats  # shape (T,) [mm]
    chances: Floats  # of each size, shape (..., T)

    @property
    def mean(self) -> Floats:
        """Expected reading, shape (...) [mm]."""
        return np.asarray((self.chances * self.means).sum(axis=-1))

    @property
    def std(self) -> Floats:
        """Standard deviation of the prediction error, shape (...) [mm]."""
        spread = self.stds**2 + (self.means - self.mean[..., None]) ** 2
        return np.asarray(np.sqrt((self.chances * spread).sum(axis=-1)))

    def tail(self, value: Floats | float) -> Floats:
        """Chance of a reading at least this far off, shape (...)."""
        far = np.abs(np.asarray(value)[..., None] - self.means) / self.stds
        return np.asarray((self.chances * erfc(far / math.sqrt(2.0))).sum(axis=-1))


@dataclass(frozen=True, eq=False)
class Forecast:
    """A Gaussian model of m readings, taken or to come."""

    base: Floats  # expected readings before any measurement, shape (m,) [mm]
    common: Floats  # their covariance but for the misfit, shape (m, m) [mm²]
    cells: Floats  # 1 where two readings share a cell with its own misfit, shape (m, m)
    misfits: Floats  # the T sizes of the misfit, shape (T,) [mm]
    sigma_mm: float  # standard deviation of one reading about all of this

    def predict(self, values: Floats, past: Ints, new: int) -> Prediction:
        """What readings (..., k) [mm] of some rows (k,) say about one more."""
        one, covariance = np.array([new]), self._covariance(past, past)
        off = (values - self.base[past]).reshape(-1, len(past)).T
        prior = self._covariance(one, one)
        means, variance = predict(covariance, off, self._covariance(past, one), prior)
        fits = self.log_likelihoods(values, past)
        return Prediction(
            self.base[new] + means[:, 0].T.reshape(fits.shape),
            np.sqrt(np.maximum(variance[:, 0, 0], self.sigma_mm**2)),
            np.exp(fits - log_sum(fits, -1)[..., None]),
        )

    def log_likelihood(self, values: Floats, rows: Ints) -> Floats:
        """Log-density of readings (..., k) at these rows, over all sizes of the misfit, (...)."""
        return log_sum(self.log_likelihoods(values, rows), -1) - math.log(len(self.misfits))

    def log_likelihoods(self, values: Floats, rows: Ints) -> Floats:
        """Log-density of readings (..., k) at these rows for each size of the misfit, (..., T)."""
        off = (values - self.base[rows]).reshape(-1, len(rows)).T
        fits = log_density(self._covariance(rows, rows), off).T
        return fits.reshape(*np.shape(values)[:-1], len(self.misfits))

    def _covariance(self, rows: Ints, columns: Ints) -> Floats:
        """Covariance of two sets of readings for each size of the misfit, (T, k, l) [mm²]."""
        chosen = np.ix_(rows, columns)
        return np.asarray(
            self.common[chosen] + self.misfits[:, None, None] ** 2 * self.cells[chosen]
        )


class PlanForecast:
    """What is known of a plan's readings before the first is taken: computed once.

    Any of them, in the order in which they are taken, are then forecast by selection.
    """

    def __init__(self, model: Model, plan: GaugePlan) -> None:
        """The gauge of its machine and the sizes of its causes give the standard deviations;
        set-ups and times are those that a forecast names."""
        self._model, self._plan, machine = model, plan, model.machine
        self._zero = np.zeros(len(model.machine.parameter_names))
        self._base, jacobian = simulate_with_jacobian(Model(machine), self._zero, plan)
        if model.accepted:
            self._base = simulate(model, self._zero, plan)
        self._offsets = OFFSET_MM**2 * jacobian @ jacobian.T
        self._series = _same(plan.leg) & _same(plan.direction)
        self._cells = _same(plan.cells)
        drifts = (CAUSES[id].size(machine) for id in ("thermal_drift", "gauge_drift"))
        self._drift, self._settling = math.hypot(*drifts), CAUSES["backlash"].size(machine)
        self._misfits = _SIZES * misfit_mm(model.orthoglide)

    def forecast(
        self,
        rows: Ints,
        setup: Ints,
        order: Ints,
        hours: Floats,
        fresh: Ints | None = None,
        scatter_mm: float = 0.0,
    ) -> Forecast:
        """The model of some of the plan's readings; all arrays have shape (m,).

        Args:
            rows: which readings of the plan.
            setup: 0 … k−1; readings of one set-up share a zero.
            order, hours: rank in time, and when they are taken [h].
            fresh: where not 0, nothing is known of a reading but its repeats with the same
                number; 0 everywhere if None.
            scatter_mm: standard deviation of one reading, if that exceeds the stated one.
        """
        sigma_mm = max(self._model.machine.instrument.noise_mm, scatter_mm)
        fresh = np.zeros(len(rows), dtype=np.intp) if fresh is None else fresh
        known = fresh == 0
        pairs = np.ix_(rows, rows)
        cells = self._cells[pairs] & _same(fresh)
        first = self._first_visits(rows, order)
        common = (
            self._offsets[pairs] * np.outer(known, known)
            + ZERO_MM**2 * _same(setup)
            + UNKNOWN_MM**2 * (cells & ~known)
            + self._series[pairs]
            * (self._drift**2 * np.outer(hours, hours) + self._settling**2 * np.outer(first, first))
            + sigma_mm**2 * np.eye(len(rows))
        )
        base = self._base[rows]
        if not self._model.repeats:
            # Time plays a part in a known effect: what is expected depends on when it is read.
            parts = {name: getattr(self._plan, name)[rows] for name in PLACE}
            plan = GaugePlan(**parts, setup=setup, order=order, hours=hours)
            base = simulate(self._model, self._zero, plan)
        return Forecast(base, common, (cells & known).astype(np.float64), self._misfits, sigma_mm)

    def _first_visits(self, rows: Ints, order: Ints) -> np.ndarray:
        """Where the leg's carriage has not yet moved away from where it began, shape (m,)."""
        leg, moved = self._plan.leg[rows], self._plan.displacement[rows]
        first = np.zeros(len(rows), dtype=bool)
        for mine in (np.flatnonzero(leg == k) for k in np.unique(leg)):
            away = moved[mine] != moved[mine[np.argmin(order[mine])]]
            first[mine] = order[mine] < order[mine][away].min(initial=np.iinfo(np.intp).max)
        return first


def misfit_mm(machine: Orthoglide) -> float:
    """Plausible size of what the model leaves out of a posture's reading [mm].

    From the plausible sizes: axes that miss each other by g change a reading by about g/6 between
    postures, axes that lean by s by about L·s/7, a skew bar by its slope times the travel of the
    leg under the gauge, a wrong scale by a third of the travel times its error.
    """
    size = {id: cause.size(machine) for id, cause in CAUSES.items()}
    travel = max(abs(limit) for limit in machine.joint_limits_mm)
    return math.hypot(
        size["axis_gap"] / 6.0,
        1e-3 * size["axis_squareness"] * machine.leg_length_mm / 7.0,
        1e-3 * size["bar_skew"] * travel,
        1e-3 * size["encoder_scale"] * travel / 3.0,
    )


def _same(keys: Ints) -> np.ndarray:
    """Where two entries are equal, shape (n, n)."""
    return np.asarray(keys[:, None] == keys)
