"""Reductions: the paper's differences as matrices that act on readings.

A difference is the mean of some readings minus the mean of others of the same gauge set-up,
so a set of differences is d = R·readings with a matrix R of shape (k, n); gauge zeros vanish.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orthoglide_cal.model.measured import DataKind, Difference
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.protocols import double_posture, single_posture
from orthoglide_cal.model.readings import Contact, GaugePlan, Posture, Series


class _Cell(NamedTuple):
    """Readings of one leg, direction, displacement and contact, of the machine as it was found."""

    series: Series
    displacement: float
    contact: Contact

    def mask(self, plan: GaugePlan) -> np.ndarray:
        """Which readings of the plan belong to the cell, shape (n,)."""
        return np.asarray(
            plan.of(self.series)
            & (plan.contact == self.contact)
            & (np.abs(plan.displacement - self.displacement) < 1e-9)
            & plan.as_found
        )


def _cells(kind: DataKind, difference: Difference, machine: Orthoglide) -> tuple[_Cell, _Cell]:
    """The two cells whose readings a difference subtracts: (minuend, subtrahend).

    Max − min; that posture − iso (eq. 24); tool end − joint end at one posture (eq. 10).
    """
    series, posture = difference
    if kind is DataKind.SINGLE:
        moved = machine.displacement_mm(posture or Posture.ISO)
        return _Cell(series, moved, Contact.TOOL), _Cell(series, moved, Contact.JOINT)
    first, second = (posture, Posture.ISO) if posture else (Posture.MAX, Posture.MIN)
    return (
        _Cell(series, machine.displacement_mm(first), Contact.FIXED),
        _Cell(series, machine.displacement_mm(second), Contact.FIXED),
    )


def reduction(
    kind: DataKind, differences: Sequence[Difference], machine: Orthoglide, plan: Plan
) -> Floats:
    """R, shape (k, n), so that R·readings are these differences.

    Repeats are averaged within a gauge set-up, then over the set-ups that hold both cells.
    A row is all zero where the plan lacks one of the cells.
    """
    plan = GaugePlan.require(plan)
    matrix = np.zeros((len(differences), len(plan)))
    for row, difference in zip(matrix, differences, strict=True):
        minuend, subtrahend = (cell.mask(plan) for cell in _cells(kind, difference, machine))
        both = np.intersect1d(plan.setup[minuend], plan.setup[subtrahend])
        for setup in both:
            for mask, sign in ((minuend, 1.0), (subtrahend, -1.0)):
                chosen = mask & (plan.setup == setup)
                row[chosen] = sign / (chosen.sum() * both.size)
    return matrix


def ideal_plan(kind: DataKind, machine: Orthoglide) -> GaugePlan:
    """One reading of each cell that the differences of this kind need."""
    if kind is DataKind.SINGLE:
        return single_posture(machine)
    ends = (Posture.MAX, Posture.MIN)
    postures = ends if kind is DataKind.SIX else (Posture.ISO, *ends)
    return double_posture(machine, cycles=1, closing=False, postures=postures)
