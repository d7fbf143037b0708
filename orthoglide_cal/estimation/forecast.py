"""What the next reading should be, from the readings before it, and how sure that is.

A reading is, near the nominal machine and before any of it is measured,

    y = h(0) + ∂h/∂Δρ · Δρ + zero + misfit + drift·t + settling + noise

with normally distributed unknowns: joint offsets, one zero per gauge set-up, what the model
leaves out at each posture (the same in each cycle), the drift of each gauge, and what changes
after a leg's first posture. Their sizes come from the machine file; how large the misfit is on
this machine shows only in the readings, so several sizes are carried along, each with the
likelihood that the readings give it. Everything is batched over leading axes of the readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.effects import Effect
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan
from orthoglide_cal.simulation import simulate, simulate_with_jacobian

# Standard deviations of what nobody knows before the first reading [mm].
OFFSET_MM = 3.0
ZERO_MM = 50.0
UNKNOWN_MM = 5.0
# Sizes of the misfit that are carried along, in units of `misfit_mm`.
_SIZES = np.array([1 / 27, 1 / 9, 1 / 3, 1.0, 3.0])
# Tolerances where the machine file gives none.
_DEFAULTS = {
    "axis_gap": 0.3,
    "axis_squareness": 1.0,
    "bar_skew": 1.0,
    "encoder_scale": 1.0,
    "backlash": 0.02,
    "thermal_drift": 0.05,
    "gauge_drift": 0.05,
}


@dataclass(frozen=True, eq=False)
class Prediction:
    """A mixture of normal distributions, one for each of T sizes of the misfit.

    Attributes:
        means: shape (..., T) [mm].
        stds: shape (T,) [mm].
        chances: of each size, shape (..., T).
    """

    means: Floats
    stds: Floats
    chances: Floats

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
        return np.asarray((self.chances * _two_sided(far)).sum(axis=-1))


@dataclass(frozen=True, eq=False)
class Forecast:
    """A linear Gaussian model of n readings.

    Attributes:
        design: shape (n, p), columns scaled to unknowns of unit variance [mm].
        cells: shape (n, c), 1 where a reading belongs to a cell with its own misfit.
        misfits: the T sizes of the misfit, shape (T,) [mm].
        base: expected readings before any measurement, shape (n,) [mm].
        sigma_mm: standard deviation of one reading about all of this.
    """

    design: Floats
    cells: Floats
    misfits: Floats
    base: Floats
    sigma_mm: float

    def predict(self, values: Floats, past: Ints, new: int) -> Prediction:
        """What readings of known rows say about one more.

        Args:
            values: readings, shape (..., k) [mm].
            past: their rows, shape (k,).
            new: row of the reading to predict.
        """
        known, shared = self._covariance(past, past), self._covariance(past, np.array([new]))
        white = np.linalg.solve(np.linalg.cholesky(known), shared)[..., 0]
        weights = np.linalg.solve(known, shared)[..., 0]
        variance = self._covariance(np.array([new]), np.array([new]))[:, 0, 0]
        stds = np.sqrt(np.maximum(variance - (white**2).sum(axis=-1), self.sigma_mm**2))
        means = self.base[new] + (values - self.base[past]) @ weights.T
        fits = self.log_likelihoods(values, past)
        chances = np.exp(fits - fits.max(axis=-1, keepdims=True))
        return Prediction(means, stds, chances / chances.sum(axis=-1, keepdims=True))

    def log_likelihood(self, values: Floats, rows: Ints) -> Floats:
        """Log-density of readings (..., k) at these rows, over all sizes of the misfit, (...)."""
        fits = self.log_likelihoods(values, rows)
        best = fits.max(axis=-1)
        return np.asarray(best + np.log(np.exp(fits - best[..., None]).mean(axis=-1)))

    def log_likelihoods(self, values: Floats, rows: Ints) -> Floats:
        """Log-density of readings (..., k) at these rows for each size of the misfit, (..., T)."""
        root = np.linalg.cholesky(self._covariance(rows, rows))
        off = np.moveaxis(values - self.base[rows], -1, 0).reshape(len(rows), -1)
        white = np.linalg.solve(root, np.broadcast_to(off, (len(root), *off.shape)))
        scale = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        fits = -0.5 * (white**2).sum(axis=-2) - scale[:, None]
        batch = np.shape(values)[:-1]
        return np.asarray(np.moveaxis(fits, 0, -1).reshape(*batch, len(root)))

    def _covariance(self, rows: Ints, columns: Ints) -> Floats:
        """Covariance of two sets of readings for each size of the misfit, (T, k, l) [mm²]."""
        common = self.design[rows] @ self.design[columns].T
        common = common + self.sigma_mm**2 * (rows[:, None] == columns)
        own = self.cells[rows] @ self.cells[columns].T
        return np.asarray(common + self.misfits[:, None, None] ** 2 * own)


def forecast(
    machine: Machine,
    plan: Plan,
    effects: Sequence[Effect] = (),
    fresh: Ints | None = None,
    sigma_mm: float | None = None,
) -> Forecast:
    """The model of a plan's readings.

    Args:
        machine: nominal machine; its gauge and tolerances give the standard deviations.
        plan: n readings; `setup` says which of them share a zero, `hours` when they are taken.
        effects: known departures from the nominal machine.
        fresh: shape (n,); where not 0, nothing is known of a reading but its repeats with the
            same number.
        sigma_mm: standard deviation of one reading; the gauge's stated one if None.
    """
    nominal = np.zeros(3)
    base, slope = simulate_with_jacobian(machine, nominal, plan)
    if effects:
        base = simulate(machine, nominal, plan, effects)
    fresh = np.zeros(len(plan), dtype=np.intp) if fresh is None else fresh
    known = (fresh == 0)[:, None]
    tolerance = {**_DEFAULTS, **machine.tolerances}
    series = np.stack((plan.leg, plan.direction), axis=1)
    cells = _members(np.column_stack((series, plan.contact, _exact(plan.displacement), fresh)))
    drifts = _members(series) * plan.hours[:, None]
    first_visit = _members(series) * _first_visits(plan)[:, None]
    rate = math.hypot(tolerance["thermal_drift"], tolerance["gauge_drift"])
    design = np.hstack(
        (
            slope * known * OFFSET_MM,
            plan.zeros * ZERO_MM,
            cells * ~known * UNKNOWN_MM,
            drifts * rate,
            first_visit * tolerance["backlash"],
        )
    )
    stated = machine.gauge.noise_mm if sigma_mm is None else sigma_mm
    return Forecast(design, cells * known, _SIZES * misfit_mm(machine), base, stated)


def misfit_mm(machine: Machine) -> float:
    """Plausible size of what the model leaves out of a posture's reading [mm].

    From the tolerances: axes that miss each other by g change a reading by about g/6 between
    postures, axes that lean by s by about L·s/7, a skew bar by its slope times the travel of the
    leg under the gauge, a wrong scale by a third of the travel times its error.
    """
    tolerance = {**_DEFAULTS, **machine.tolerances}
    travel = max(abs(limit) for limit in machine.joint_limits_mm)
    return math.hypot(
        tolerance["axis_gap"] / 6.0,
        1e-3 * tolerance["axis_squareness"] * machine.leg_length_mm / 7.0,
        1e-3 * tolerance["bar_skew"] * travel,
        1e-3 * tolerance["encoder_scale"] * travel / 3.0,
    )


def _two_sided(far: Floats) -> Floats:
    """Chance that a normal variable is more than `far` standard deviations off."""
    return np.asarray(np.vectorize(math.erfc, otypes=[np.float64])(far / math.sqrt(2.0)))


def _exact(displacement: Floats) -> Ints:
    """Displacements as whole nanometres, to compare them."""
    return np.rint(displacement * 1e6).astype(np.intp)


def _members(keys: Ints) -> Floats:
    """Indicator columns, shape (n, number of distinct rows of `keys`)."""
    group = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    return np.asarray(group[:, None] == np.arange(group.max(initial=-1) + 1), dtype=np.float64)


def _first_visits(plan: Plan) -> Floats:
    """1 for readings before the leg's carriage first moves away from where it began, else 0."""
    first = np.zeros(len(plan))
    for leg in range(3):
        mine = [i for i in plan.in_time if plan.leg[i] == leg]
        for i in mine:
            if plan.displacement[i] != plan.displacement[mine[0]]:
                break
            first[i] = 1.0
    return first
