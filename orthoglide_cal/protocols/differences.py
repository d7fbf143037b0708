"""Reductions: the paper's differences as matrices that act on readings.

A difference is the mean of some readings minus the mean of others of the same gauge set-up,
so a set of differences is d = R·readings with a matrix R of shape (k, n); gauge zeros vanish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols.double_posture import double_posture
from orthoglide_cal.protocols.single_posture import single_posture

# The order of Table 4: direction first, leg second.
SIX = ("x_y", "x_z", "y_x", "y_z", "z_x", "z_y")
TWELVE = tuple(f"{name}{sign}" for name in SIX for sign in "+-")
SINGLE = ("z_x0", "z_y0", "z_x+", "z_x-", "z_y+", "z_y-")
NAMES = {"six": SIX, "twelve": TWELVE, "single": SINGLE}

_POSTURE = {"+": "max", "-": "min", "0": "iso"}


@dataclass(frozen=True)
class Cell:
    """Readings that repeat each other: same leg, direction, displacement and contact."""

    leg: int
    direction: int
    displacement: float
    contact: Contact

    def mask(self, plan: Plan) -> np.ndarray:
        """Which readings of the plan belong to the cell, shape (n,)."""
        return np.asarray(
            (plan.leg == self.leg)
            & (plan.direction == self.direction)
            & (plan.contact == self.contact)
            & (np.abs(plan.displacement - self.displacement) < 1e-9)
        )


def cells(name: str, machine: Machine) -> tuple[Cell, Cell]:
    """The two cells whose readings a difference subtracts: (minuend, subtrahend).

    "y_x": max − min; "y_x+", "y_x-": that posture − iso (eq. 24).
    """
    direction, leg = AXES.index(name[0]), AXES.index(name[2])
    first, second = ("max", "min") if len(name) == 3 else (_POSTURE[name[3]], "iso")
    return (
        Cell(leg, direction, machine.displacement_mm(first), Contact.FIXED),
        Cell(leg, direction, machine.displacement_mm(second), Contact.FIXED),
    )


def single_cells(name: str, machine: Machine) -> tuple[Cell, Cell]:
    """Tool end minus joint end at one posture (sec. 3.2, eq. 10)."""
    direction, leg = AXES.index(name[0]), AXES.index(name[2])
    displacement = machine.displacement_mm(_POSTURE[name[3]])
    return (
        Cell(leg, direction, displacement, Contact.TOOL),
        Cell(leg, direction, displacement, Contact.JOINT),
    )


def reduction(kind: str, names: Sequence[str], machine: Machine, plan: Plan) -> Floats:
    """R, shape (k, n), so that R·readings are the named differences.

    Repeats are averaged within a gauge set-up, then over the set-ups that hold both cells.
    A row is all zero where the plan lacks one of the cells.
    """
    pair = single_cells if kind == "single" else cells
    matrix = np.zeros((len(names), len(plan)))
    for row, name in zip(matrix, names, strict=True):
        minuend, subtrahend = (cell.mask(plan) for cell in pair(name, machine))
        both = np.intersect1d(plan.setup[minuend], plan.setup[subtrahend])
        for setup in both:
            for mask, sign in ((minuend, 1.0), (subtrahend, -1.0)):
                chosen = mask & (plan.setup == setup)
                row[chosen] = sign / (chosen.sum() * both.size)
    return matrix


def ideal_plan(kind: str, machine: Machine) -> Plan:
    """One reading of each cell that the differences of this kind need."""
    if kind == "single":
        return single_posture(machine)
    postures = ("max", "min") if kind == "six" else ("iso", "max", "min")
    return double_posture(machine, cycles=1, closing=False, postures=postures)


def zero_free(plan: Plan) -> Floats:
    """Orthonormal contrasts that no gauge zero enters, shape (n − setups, n).

    Least squares on the contrasts is generalised least squares on the readings with one
    unknown zero per set-up.
    """
    q, _ = np.linalg.qr(plan.zeros, mode="complete")
    return np.ascontiguousarray(q[:, plan.setups :].T)


def cell_contrasts(plan: Plan) -> Floats:
    """`zero_free` for readings that repeat each other exactly: orthonormal contrasts of cells.

    A cell holds the repeats of one posture in one gauge set-up. Where the model says the same of
    all of them, only their mean matters: least squares on the weighted means, with the zeros
    removed, is least squares on all readings, with m cells instead of n readings.

    Returns:
        Shape (m − setups, n).
    """
    keys = np.stack((plan.setup, plan.displacement, plan.contact, plan.gauge_at), axis=1)
    cells, cell, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    weight = np.sqrt(count)
    zeros = weight[:, None] * (cells[:, :1] == np.arange(plan.setups))
    q, _ = np.linalg.qr(zeros, mode="complete")
    return np.ascontiguousarray((q[:, plan.setups :].T / weight)[:, cell.reshape(-1)])


def without_zeros(plan: Plan, values: Floats) -> Floats:
    """Values (..., n) less the mean of their gauge set-up: what no gauge zero can explain."""
    count = np.bincount(plan.setup, minlength=plan.setups)
    means = values @ (plan.zeros / count)
    return np.asarray(values - means[..., plan.setup])
