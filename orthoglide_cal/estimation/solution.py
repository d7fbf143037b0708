"""The result of an estimation: joint offsets, how sure they are, and whether the model fits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.estimation.accuracy import (
    Scatter,
    chance_of_residual,
    determined,
    rms,
    scatter_of_repeats,
    sigma_rho,
)
from orthoglide_cal.estimation.budget import Budget, Budgeted
from orthoglide_cal.estimation.gaussian import unexplained
from orthoglide_cal.estimation.least_squares import OPTIMAL_MM
from orthoglide_cal.estimation.methods import Method, Posed, choose_method, pose_differences
from orthoglide_cal.estimation.promise import Known, PromisedDifference, promise
from orthoglide_cal.model import (
    DataKind,
    Differences,
    Floats,
    Measured,
    Model,
    ReadOnly,
    Source,
    gauge_doubts,
    simulate,
)
from orthoglide_cal.model.plan import read_only

# Below this chance the residuals are called larger than the gauge's noise.
SUSPICIOUS = 0.001
# Below this one they are called larger than usual.
UNUSUAL = 0.01


@dataclass(frozen=True, eq=False)
class Solution(Budgeted, ReadOnly):
    """Joint offsets identified from one file.

    Attributes:
        measured: the data.
        method: the estimator.
        posed: the problem that was solved, with its model and what it compares with it.
        offsets_mm: Δρ, shape (3,); true joint position = indicated + Δρ.
        residuals_mm: what the solver left of the data it compared, shape (k,).
        budget: where the offsets' uncertainty comes from.
        scatter: of one reading, from the residuals; None without degrees of freedom.
        iterations: of the nonlinear solver; 0 for linear methods.
    """

    measured: Measured
    method: Method
    posed: Posed
    offsets_mm: Floats
    residuals_mm: Floats
    budget: Budget
    scatter: Scatter | None
    iterations: int

    @property
    def source(self) -> Source:
        """The data's path and digest."""
        return self.measured.source

    @property
    def kind(self) -> DataKind:
        """Of the data."""
        return self.measured.kind

    @property
    def count(self) -> int:
        """Number of readings or differences."""
        return len(self.measured)

    @property
    def method_is_default(self) -> bool:
        """Whether it is the estimator that nobody needs to name."""
        return self.method is choose_method(self.measured, None)

    @property
    def model(self) -> Model:
        """The machine and its accepted causes."""
        return self.posed.problem.model

    @property
    def machine(self) -> str:
        """Name of the machine."""
        return self.model.machine.name

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of one reading that the uncertainty rests on [mm]."""
        if self.scatter is None:
            return self.sigma_stated_mm
        return max(self.scatter.sigma_mm, self.sigma_floor_mm)

    @property
    def sigma_floor_mm(self) -> float:
        """q/√12 of the gauge's resolution q [mm]."""
        return self.model.machine.gauge.rounding_mm

    @property
    def sigma_stated_mm(self) -> float:
        """What the machine file states for the gauge (repeatability, rounding) [mm]."""
        return self.model.machine.gauge.noise_mm

    @property
    def sigma_residuals_mm(self) -> float | None:
        """Standard deviation of one reading from the residuals; None without degrees of freedom."""
        return None if self.scatter is None else self.scatter.sigma_mm

    @property
    def dof(self) -> int:
        """Degrees of freedom of it (effective ones, rounded)."""
        return 0 if self.scatter is None else round(self.scatter.dof)

    @property
    def sigma_repeats_mm(self) -> float | None:
        """Standard deviation of one reading from repeated readings; None without repeats."""
        if isinstance(self.measured, Differences):
            return None
        scatter = scatter_of_repeats(self.measured.plan, self.measured.value)
        return None if scatter is None else scatter.sigma_mm

    @property
    def lack_of_fit_p(self) -> float | None:
        """Probability of a residual this large from this gauge's noise alone."""
        if self.scatter is None:
            return None
        sum_of_squares = self.scatter.dof * self.scatter.sigma_mm**2
        return chance_of_residual(sum_of_squares, self.scatter.dof, self.sigma_stated_mm)

    @property
    def noise(self) -> Scatter:
        """Of one reading, as the covariance takes it; stated noise has infinite dof."""
        return Scatter(self.sigma_mm, math.inf if self.scatter is None else self.scatter.dof)

    def promised(
        self, entered: Floats | None = None, right: Measured | None = None
    ) -> tuple[PromisedDifference, ...]:
        """What the differences will be once (3,) [mm] were entered; its own offsets if None.

        `right` as in `promise`.
        """
        known = Known(self.model, self.offsets_mm, self.covariance_mm2)
        change = self.offsets_mm if entered is None else entered
        return promise(self.measured, known, change, self.noise, right)

    @cached_property
    def _fit(self) -> tuple[float, float, Floats]:
        """r.m.s. before and after, and what is predicted for each entry of the file.

        Of readings about the model with fitted gauge zeros; else of the differences that the
        method uses, as in Table 4.
        """
        measured, model = self.measured, self.model
        if isinstance(measured, Differences):
            every = pose_differences(measured, model, measured.kind)
            order = [every.which.index(each) for each in measured.which]
            predicted = every.problem.predict(self.offsets_mm)[order]
            return rms(self.posed.data), rms(self.residuals_mm), read_only(predicted)
        zeros, both = measured.plan.zeros, np.stack((0.0 * self.offsets_mm, self.offsets_mm))
        simulated = simulate(model, both, measured.plan)
        fitted = np.linalg.lstsq(zeros, (measured.value - simulated).T, rcond=None)[0]
        before, after = simulated + (zeros @ fitted).T
        # Of readings that are less precise than most, as much less counts.
        left = measured.plan.precision * (measured.value - np.stack((before, after)))
        return rms(left[0]), rms(left[1]), read_only(after)

    @property
    def predicted_mm(self) -> Floats:
        """For each entry of the file, with fitted gauge zeros, shape (count,) [mm]."""
        return self._fit[2]

    @property
    def rms_before_mm(self) -> float:
        """Root mean square of the data with zero offsets."""
        return self._fit[0]

    @property
    def rms_after_mm(self) -> float:
        """Root mean square of the residuals."""
        return self._fit[1]

    @property
    def rms_of_noise_mm(self) -> float | None:
        """Root mean square that noise as stated leaves on average; None without spare readings."""
        if self.scatter is None:
            return None
        share = self.scatter.dof / self.count
        if isinstance(self.measured, Differences):
            # tr(P G Pᵀ)/k: what the offsets cannot explain of the differences' covariance σ² G.
            slope = self.posed.problem.at_zero[1]
            left = unexplained(slope, np.eye(len(slope)))
            share = np.trace(left @ self.posed.problem.covariance() @ left.T) / len(slope)
        return self.sigma_stated_mm * math.sqrt(share)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences for the user."""
        found, floor = self.sigma_residuals_mm, self.sigma_floor_mm
        doubts = gauge_doubts(self.measured, self.model.machine.gauge)
        said = (*(str(doubt) for doubt in doubts), *self.measured.remarks)
        if found is None or found >= floor:
            return said
        limit = (
            f"The residuals are smaller than the {self.model.machine.vocabulary.noise}'s"
            f" resolution allows ({floor:.2g} mm);"
            " the intervals use the resolution."
        )
        return (*said, limit)

    @cached_property
    def remaining_mm(self) -> float:
        """How far the offsets are from their optimum, recomputed from the problem [mm].

        A nonlinear method: the step that it would still take. A linear one: what its own
        estimator finds in its residual.
        """
        problem, data = self.posed.problem, self.posed.data
        if not self.method.linear:
            return float(problem.remaining_step(data, self.offsets_mm))
        predicted, slope = problem.at_zero
        left = data - predicted - slope @ self.offsets_mm
        return float(np.abs(self.method.estimator(self.posed) @ left).max())

    @property
    def converged(self) -> bool:
        """True if that check holds."""
        return self.remaining_mm <= OPTIMAL_MM

    @property
    def determined(self) -> tuple[bool, ...]:
        """Of which parameters the data tell more than what any such machine can have."""
        return determined(self.model, self.expanded_mm)

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of the offsets, shape (3, 3)."""
        std = self.std_mm
        matrix = self.covariance_mm2 / (std[:, None] * std)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    @property
    def sigma_rho_mm(self) -> float:
        """σ_ρ = √(trace V / 3) (eq. 33) of the offsets of the three joints [mm]."""
        return sigma_rho(self.covariance_mm2[:3, :3])

    @property
    def suspicious(self) -> bool:
        """True if the residuals are larger than this gauge's noise would give."""
        return self.lack_of_fit_p is not None and self.lack_of_fit_p < SUSPICIOUS

    @property
    def judgement(self) -> str:
        """One sentence: are the residuals what this gauge's noise would give?"""
        noise, beside = self.model.machine.vocabulary.noise, self.model.machine.vocabulary.also
        if self.sigma_residuals_mm is None or self.lack_of_fit_p is None:
            return (
                "There are no spare readings: whether the model fits this machine cannot be told,"
                f" and the intervals rest on the {noise}'s stated noise ({self.sigma_stated_mm:.2g}"
                " mm)."
            )
        sizes = (
            f"one reading scatters by {self.sigma_residuals_mm:.2g} mm against"
            f" {self.sigma_stated_mm:.2g} mm"
        )
        if self.suspicious:
            return (
                f"The residuals are larger than this {noise}'s noise{beside} would give ({sizes}):"
                " the model leaves something out, and the intervals do not cover it."
            )
        if self.lack_of_fit_p < UNUSUAL:
            return (
                f"The residuals are larger than usual for this {noise}'s noise{beside}, not large"
                f" enough to call the model wrong ({sizes}; a chance below 1 % of larger ones)."
            )
        chance = f"a chance of {100.0 * self.lack_of_fit_p:.0f} % of larger ones"
        return (
            f"The residuals are what this {noise}'s noise{beside} would give ({sizes}; {chance})."
        )
