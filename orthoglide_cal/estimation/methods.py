"""The estimators: each is a reduction of the readings and a way to solve.

single            eq. 10, pseudoinverse              single-posture differences
single-sequential eq. 11, one offset after the other
six-linear        eq. 17, pseudoinverse              max − min
twelve-linear     eq. 16, pseudoinverse              max − iso, min − iso
six, twelve       eq. 25, nonlinear least squares on the same differences
readings          all raw readings at once, one unknown zero per gauge set-up
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation.gaussian import shrink, shrinking
from orthoglide_cal.estimation.least_squares import Problem
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference, Measured, Readings
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import ideal_plan, reduction
from orthoglide_cal.model.plan import Contrasts, Floats, Plan, ReadOnly, Reduction, zero_free
from orthoglide_cal.model.readings import Posture

DESCRIPTIONS = {
    DataKind.READINGS: "raw readings",
    DataKind.SIX: "six differences (max − min)",
    DataKind.TWELVE: "twelve differences (relative to iso)",
    DataKind.SINGLE: "single-posture differences",
}


class Method(StrEnum):
    """An estimator, by the name that users know."""

    SINGLE = "single"
    SINGLE_SEQUENTIAL = "single-sequential"
    SIX_LINEAR = "six-linear"
    TWELVE_LINEAR = "twelve-linear"
    SIX = "six"
    TWELVE = "twelve"
    READINGS = "readings"

    @property
    def uses(self) -> DataKind:
        """Data that it compares with the model: all readings, or differences of them."""
        return DataKind(self.partition("-")[0])

    @property
    def linear(self) -> bool:
        """True if it solves with the Jacobian at zero offsets instead of iterating."""
        return self not in (Method.SIX, Method.TWELVE, Method.READINGS)

    def estimator(self, posed: Posed) -> Floats:
        """M of a linear method, Δρ = M d with the Jacobian J at zero offsets, shape (3, k).

        (JᵀJ)⁻¹Jᵀ (eqs. 10, 16, 17), or one offset after the other (eq. 11).

        Raises:
            UnusableResultError: eq. (11) lacks one of its six differences.
        """
        jacobian = posed.problem.at_zero[1]
        if self is Method.SINGLE_SEQUENTIAL:
            return _sequential(jacobian, posed.which)
        return np.asarray(np.linalg.pinv(jacobian), dtype=np.float64)


def choose_method(measured: Measured, name: str | None) -> Method:
    """The method asked for, or the default for this kind of data.

    Raises:
        UsageError: unknown name, or a method that these data cannot feed.
    """
    if name is None:
        return Method(measured.kind)
    if name not in list(Method):
        raise UsageError(f"There is no method {name!r}.", f"Choose one of {', '.join(Method)}.")
    usable = [method for method in Method if method.uses in measured.kinds]
    if name not in usable:
        raise UsageError(
            f"Method {name} cannot use {DESCRIPTIONS[measured.kind]}.",
            f"Choose one of {', '.join(usable)}.",
        )
    return Method(name)


def table_kind(measured: Measured) -> DataKind:
    """The differences in which results are shown: those of Table 4, or single-posture ones."""
    return DataKind.SIX if DataKind.SIX in measured.kinds else DataKind.SINGLE


@dataclass(frozen=True, eq=False)
class Posed(ReadOnly):
    """A problem with its data: d, shape (k,) [mm], and which differences they are, if any."""

    problem: Problem
    data: Floats
    which: tuple[Difference, ...]

    def weighted(self, ratio: Floats) -> Posed:
        """The same, with data whose covariance is σ² (G + C Cᵀ/σ²) made independent.

        `ratio` is C/σ, what else is uncertain of the data, shape (k, p).
        """
        matrix: Reduction = self.problem.matrix
        if isinstance(matrix, Contrasts):
            axes, factors = shrinking(ratio)
            matrix = replace(matrix, axes=axes, factors=factors)
            data = shrink(self.data, axes, factors)
        else:
            matrix, data = self.problem.whitened(ratio, matrix, self.data)
        return replace(self, problem=replace(self.problem, matrix=matrix), data=data)


@functools.lru_cache(maxsize=8)
def pose_plan(plan: Plan, model: Model, kind: DataKind) -> tuple[Problem, tuple[Difference, ...]]:
    """Problem and differences that a method makes of readings, whatever these will be.

    Differences that the plan lacks are left out.
    """
    if kind is DataKind.READINGS:
        return Problem(model, plan, zero_free(plan)), ()
    wanted = DIFFERENCES[kind]
    matrix = reduction(kind, wanted, model.machine, plan.steps)
    present = np.abs(matrix).sum(axis=1) > 0.0
    kept = tuple(difference for difference, ok in zip(wanted, present, strict=True) if ok)
    return Problem(model, plan, matrix[present]), kept


def pose(measured: Measured, model: Model, kind: DataKind) -> Posed:
    """Reduce the data to what is compared with the model, of a kind that can be made of them.

    Differences that they lack are left out.
    """
    if isinstance(measured, Readings):
        problem, kept = pose_plan(measured.plan, model, kind)
        return Posed(problem, problem.matrix @ measured.value, kept)
    wanted = DIFFERENCES[kind]
    values = dict(zip(measured.which, measured.value.tolist(), strict=True))
    if measured.kind is DataKind.TWELVE and kind is DataKind.SIX:
        ends = [(Difference(s, Posture.MAX), Difference(s, Posture.MIN)) for s, _ in wanted]
        values = {
            six: values[high] - values[low]
            for six, (high, low) in zip(wanted, ends, strict=True)
            if high in values and low in values
        }
    kept = tuple(difference for difference in wanted if difference in values)
    # The readings behind the printed differences: one of each cell, so that a difference of
    # the twelve shares its isotropic reading with its partner (errata, eq. 30).
    plan = ideal_plan(measured.kind, model.machine)
    problem = Problem(model, plan, reduction(kind, kept, model.machine, plan))
    return Posed(problem, np.array([values[difference] for difference in kept]), kept)


def _sequential(jacobian: Floats, which: Sequence[Difference]) -> Floats:
    """M of eq. (11): Δρ_z from the isotropic posture, then Δρ_x and Δρ_y, shape (3, 6).

        Δρ_z = (Δz_x0 + Δz_y0)/2,  Δρ_i = Σ_k a_k (Δz_i^k − Δρ_z)/Σ_k a_k²,  k = max, min

    These are three weighted sums W d = W J Δρ of the differences, solved for the offsets. Written
    so, it also holds where accepted causes couple the isotropic differences with Δρ_x and Δρ_y.

    Args:
        jacobian: Jacobian at zero offsets, shape (6, 3).
        which: the differences of its rows.
    """
    needed = DIFFERENCES[DataKind.SINGLE]
    missing = [difference.name for difference in needed if difference not in which]
    if missing:
        raise UnusableResultError(
            f"Eq. (11) needs all six differences; {', '.join(missing)} missing.",
            "Measure them, or use --method single.",
        )
    at_iso, moved = needed[:2], (needed[2:4], needed[4:])
    weights = np.zeros((3, len(which)))
    weights[2, [which.index(difference) for difference in at_iso]] = 1.0
    for axis, pair in enumerate(moved):
        rows = [which.index(difference) for difference in pair]
        weights[axis, rows] = jacobian[rows, axis]
    return np.asarray(np.linalg.solve(weights @ jacobian, weights), dtype=np.float64)
