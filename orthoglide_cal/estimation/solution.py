"""The result of an estimation: joint offsets, how sure they are, and whether the model fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.measured import Source

# Below this chance the residuals are called larger than the gauge's noise.
SUSPICIOUS = 0.001


@dataclass(frozen=True)
class TableRow:
    """One difference of the expected-improvement table (the paper's Table 4).

    Attributes:
        difference: name, direction first, leg second, e.g. "x_y".
        measured_mm: from the data.
        modelled_mm: what the fitted model gives.
    """

    difference: str
    measured_mm: float
    modelled_mm: float

    @property
    def expected_mm(self) -> float:
        """Measured minus modelled: what should remain after the correction [mm]."""
        return self.measured_mm - self.modelled_mm


@dataclass(frozen=True, eq=False)
class Solution:
    """Joint offsets identified from one file.

    Attributes:
        source: the data's path and digest.
        kind: "readings", "six", "twelve" or "single".
        count: number of readings or differences used.
        machine: name of the machine.
        method: name of the estimator.
        offsets_mm: Δρ, shape (3,); true joint position = indicated + Δρ.
        covariance_mm2: of the offsets, shape (3, 3) (eqs. 26–32).
        interval_mm: 95 % Student-t interval of each offset, shape (3, 2).
        sigma_mm: standard deviation of one reading used for the covariance.
        sigma_residuals_mm: from the residuals; None without degrees of freedom.
        sigma_repeats_mm: from repeated readings; None without repeats.
        sigma_floor_mm: q/√12 of the gauge's resolution q.
        sigma_stated_mm: what the machine file states for the gauge (repeatability, rounding).
        dof: degrees of freedom of sigma_residuals_mm.
        rms_before_mm: root mean square of the data about the nominal model (zero offsets).
        rms_after_mm: root mean square of the residuals.
        converged: True if the optimality recomputed from the data holds.
        optimality: that check: |gradient| relative to its natural scale.
        iterations: of the nonlinear solver; 0 for linear methods.
        table: the six differences (or those of the single-posture protocol).
        readings_mm: predicted readings including the fitted zeros, shape (n,); None for
            differences.
        lack_of_fit_p: probability of a residual this large from this gauge's noise alone.
        warnings: sentences for the user.
    """

    source: Source
    kind: str
    count: int
    machine: str
    method: str
    offsets_mm: Floats
    covariance_mm2: Floats
    interval_mm: Floats
    sigma_mm: float
    sigma_residuals_mm: float | None
    sigma_repeats_mm: float | None
    sigma_floor_mm: float
    sigma_stated_mm: float
    dof: int
    rms_before_mm: float
    rms_after_mm: float
    converged: bool
    optimality: float
    iterations: int
    table: tuple[TableRow, ...]
    readings_mm: Floats | None
    lack_of_fit_p: float | None
    warnings: tuple[str, ...] = ()

    @property
    def std_mm(self) -> Floats:
        """Standard deviations of the offsets, shape (3,) [mm]."""
        return np.sqrt(np.diag(self.covariance_mm2))

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of the offsets, shape (3, 3)."""
        std = self.std_mm
        matrix = self.covariance_mm2 / (std[:, None] * std)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    @property
    def sigma_rho_mm(self) -> float:
        """σ_ρ = √(trace V / 3) (eq. 33) [mm]."""
        return float(np.sqrt(np.trace(self.covariance_mm2) / 3.0))

    @property
    def suspicious(self) -> bool:
        """True if the residuals are larger than this gauge's noise would give."""
        return self.lack_of_fit_p is not None and self.lack_of_fit_p < SUSPICIOUS

    @property
    def judgement(self) -> str:
        """One sentence: are the residuals what this gauge's noise would give?"""
        if self.sigma_residuals_mm is None or self.lack_of_fit_p is None:
            return (
                "There are no spare readings: whether the model fits this machine cannot be told,"
                f" and the intervals rest on the gauge's stated noise ({self.sigma_stated_mm:.2g}"
                " mm)."
            )
        sizes = f"{self.sigma_residuals_mm:.2g} mm against {self.sigma_stated_mm:.2g} mm"
        if self.suspicious:
            return (
                f"The residuals are larger than this gauge's noise would give ({sizes}): the model"
                " leaves something out, and the intervals do not cover it."
            )
        chance = (
            f"a chance of {100.0 * self.lack_of_fit_p:.0f} % of larger ones"
            if self.lack_of_fit_p >= 0.01
            else "though larger ones would be rare: a chance below 1 %"
        )
        return f"The residuals are what this gauge's noise would give ({sizes}; {chance})."
