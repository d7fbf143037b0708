"""The estimation problem: which combinations of readings are compared with the model.

    minimise |d − R·h(Δρ)|² over the joint offsets Δρ        (eq. 25)

d are the data, h the predicted readings and R the reduction of the method: differences of
readings for the paper's methods, zero-free contrasts of all readings for `readings`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan
from orthoglide_cal.simulation import simulate, simulate_with_jacobian

# An offset is compared with this many millimetres to call a Newton step "nothing left".
OPTIMAL_MM = 1e-9


@dataclass(frozen=True, eq=False)
class Problem:
    """One estimation problem; many data sets may share it.

    Attributes:
        machine: nominal machine.
        plan: n readings.
        matrix: R, shape (k, n).
        effects: known departures from the nominal machine.
    """

    machine: Machine
    plan: Plan
    matrix: Floats
    effects: Sequence[Effect] = ()

    def model(self, offsets: Floats) -> Floats:
        """R·h(Δρ), offsets (..., 3) → (..., k) [mm]."""
        plan, matrix = self._folded
        readings = simulate(self.machine, offsets, plan, self.effects)
        return _reduce(matrix, readings, -1)

    def model_with_jacobian(self, offsets: Floats, strict: bool = True) -> tuple[Floats, Floats]:
        """R·h and R·∂h/∂Δρ: offsets (..., 3) → (..., k) [mm], (..., k, 3)."""
        plan, matrix = self._folded
        readings, slope = simulate_with_jacobian(
            self.machine, offsets, plan, self.effects, strict=strict
        )
        return _reduce(matrix, readings, -1), _reduce(matrix, slope, -2)

    @cached_property
    def at_zero(self) -> tuple[Floats, Floats]:
        """`model_with_jacobian` at zero offsets, where every search starts: (k,) [mm], (k, 3)."""
        return self.model_with_jacobian(np.zeros(3))

    @cached_property
    def _folded(self) -> tuple[Plan, Floats]:
        """Plan and R with readings that repeat each other predicted once.

        With an effect that may tell them apart nothing is folded.
        """
        if not all(effect.repeats for effect in self.effects):
            return self.plan, self.matrix
        first, kind = self.plan.distinct
        fold = kind[:, None] == np.arange(len(first))
        return self.plan.subset(first), self.matrix @ fold

    def covariance(self) -> Floats:
        """R Rᵀ: covariance of the data for unit variance of one reading (eqs. 28, 31), (k, k)."""
        return np.asarray(self.matrix @ self.matrix.T)

    def remaining_step(self, data: Floats, offsets: Floats) -> Floats:
        """How far the offsets are from the least-squares optimum, recomputed from the data.

        The Gauss–Newton step |(JᵀJ)⁻¹Jᵀr| that would still be taken; zero at a stationary point
        of eq. (25).

        Args:
            data: d, shape (..., k) [mm].
            offsets: shape (..., 3) [mm].

        Returns:
            Shape (...) [mm]; NaN where the model cannot be evaluated.
        """
        model, slope = self.model_with_jacobian(offsets, strict=False)
        return np.asarray(np.abs(normal_step(slope, data - model)).max(axis=-1))


def _reduce(matrix: Floats, values: Floats, axis: int) -> Floats:
    """Apply R (k, n) along one axis; keeps the order of the batch in memory."""
    reduced = np.tensordot(matrix, values, axes=(1, values.ndim + axis))
    return np.moveaxis(reduced, 0, axis)


def normal_step(slope: Floats, residual: Floats, damping: Floats | float = 0.0) -> Floats:
    """Solve (JᵀJ + λ diag JᵀJ) s = Jᵀr by cofactors: (..., k, 3), (..., k) → (..., 3)."""
    columns = [slope[..., i] for i in range(3)]
    gradient = [(column * residual).sum(axis=-1) for column in columns]
    xx, yy, zz = ((column**2).sum(axis=-1) * (1.0 + damping) for column in columns)
    x, y, z = columns
    xy, yz, zx = ((a * b).sum(axis=-1) for a, b in ((x, y), (y, z), (z, x)))
    adjugate = (
        (yy * zz - yz**2, yz * zx - xy * zz, xy * yz - yy * zx),
        (yz * zx - xy * zz, zz * xx - zx**2, zx * xy - yz * xx),
        (xy * yz - yy * zx, zx * xy - yz * xx, xx * yy - xy**2),
    )
    determinant = xx * adjugate[0][0] + xy * adjugate[0][1] + zx * adjugate[0][2]
    return np.stack(
        [sum(a * g for a, g in zip(row, gradient, strict=True)) / determinant for row in adjugate],
        axis=-1,
    )
