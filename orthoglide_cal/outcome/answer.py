"""The offsets that a calibration answers with, and their expanded uncertainty U = k·u."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.diagnosis.result import CONSISTENT, Diagnosis
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import CONFIDENCE, half_width
from orthoglide_cal.outcome.rounding import decimals_for


@dataclass(frozen=True, eq=False)
class Answer:
    """Joint offsets with expanded uncertainty.

    Attributes:
        model: ids of the causes beside the offsets; empty for the offsets alone.
        offsets_mm: Δρ, shape (3,).
        covariance_mm2: shape (3, 3).
        k: coverage factor.
        confidence: of U = k·u, e.g. 0.95.
        dof: degrees of freedom of k; None for the normal distribution.
    """

    model: tuple[str, ...]
    offsets_mm: Floats
    covariance_mm2: Floats
    k: float
    confidence: float
    dof: int | None

    @property
    def std_mm(self) -> Floats:
        """Standard uncertainties u, shape (3,) [mm]."""
        return np.sqrt(np.diag(self.covariance_mm2))

    @property
    def expanded_mm(self) -> Floats:
        """Expanded uncertainties U = k·u, shape (3,) [mm]."""
        return self.k * self.std_mm

    @property
    def decimals(self) -> int:
        """Decimals at which all three offsets end: those of the smallest uncertainty."""
        return decimals_for(float(self.expanded_mm.min()))


def plain_answer(solution: Solution) -> Answer:
    """The solution as it stands, with Student's t of its degrees of freedom."""
    reach = (solution.interval_mm[:, 1] - solution.interval_mm[:, 0]) / 2.0
    return Answer(
        model=(),
        offsets_mm=solution.offsets_mm,
        covariance_mm2=solution.covariance_mm2,
        k=float(reach[0] / solution.std_mm[0]),
        confidence=CONFIDENCE,
        dof=solution.dof or None,
    )


def diagnosed_answer(diagnosis: Diagnosis) -> Answer:
    """The offsets under the model that the diagnosis accepts."""
    return Answer(
        model=tuple(cause.id for cause in diagnosis.causes),
        offsets_mm=diagnosis.offsets_mm,
        covariance_mm2=np.diag(diagnosis.std_mm**2),
        k=half_width(np.inf),
        confidence=CONFIDENCE,
        dof=None,
    )


def choose_answer(solution: Solution, diagnosis: Diagnosis | None) -> Answer:
    """The solution where it is sound or nothing else is known, otherwise the diagnosis."""
    if diagnosis is None or diagnosis.verdict == CONSISTENT:
        return plain_answer(solution)
    return diagnosed_answer(diagnosis)
