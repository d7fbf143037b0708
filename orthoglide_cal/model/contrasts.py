"""Contrasts: combinations of readings that no unknown zero enters, weighted by their precision.

What is estimated from readings is estimated from these.
"""

import functools
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.model.plan import Floats, Plan, ReadOnly, read_only


@dataclass(frozen=True, eq=False)
class Contrasts(ReadOnly):
    """W of shape (k, n), as what it does to readings: combinations that no zero enters.

        W y = D (Qᵀ F y)[s:],   D = I − U diag(1 − f) Uᵀ,   Q = I − V T Vᵀ

    F takes the readings as precise as they are. Q is orthogonal, and its first s columns span the
    zeros (Householder). It costs n·s steps and numbers instead of n².
    """

    zeros: Floats  # s columns that span the zeros, orthonormal, (n, s)
    precision: Floats  # of each reading, shape (n,)
    axes: Floats | None = None  # U, orthonormal columns, (k, q); None where D = I
    factors: Floats | None = None  # f, (q,)
    turned: bool = False  # Wᵀ instead, of shape (n, k)

    # Arrays leave `values @ W` to this class.
    __array_ufunc__ = None

    @cached_property
    def _reflected(self) -> tuple[Floats, Floats]:
        """V, shape (m, s), and T, shape (s, s)."""
        width = self.zeros.shape[1]
        packed, _ = np.linalg.qr(self.zeros, mode="raw")
        v = np.tril(packed.T, -1)
        v[np.arange(width), np.arange(width)] = 1.0
        inner = v.T @ v
        t = np.linalg.inv(np.triu(inner, 1) + np.diag(0.5 * np.diag(inner)))
        return read_only(v), read_only(t)

    def __len__(self) -> int:
        return len(self.zeros) - int(self.zeros.shape[1])

    @cached_property
    def T(self) -> "Contrasts":
        turned = copy(self)
        vars(turned).update(turned=not self.turned, _reflected=self._reflected)  # worked out once
        return turned

    def __matmul__(self, values: Floats) -> Floats:
        """W y of readings (n,), or of columns (..., n, q); Wᵀ d of data if it is turned."""
        if values.ndim == 1:
            return np.asarray((self @ values[:, None])[:, 0])
        v, t = self._reflected
        width, precision = v.shape[1], self.precision[:, None]
        if self.turned:
            values = self._weighed(values)
            spread = -v @ (t @ (v[width:].T @ values))
            spread[..., width:, :] += values
            return np.asarray(precision * spread)
        values = precision * values
        inner = t.T @ (v.T @ values)
        values = values[..., width:, :]
        values -= v[width:] @ inner
        return self._weighed(values)

    def __rmatmul__(self, values: Floats) -> Floats:
        """Y W of rows (..., q, k), or of one row (k,)."""
        if values.ndim == 1:
            return self.T @ values
        return np.asarray(np.swapaxes(self.T @ np.swapaxes(values, -1, -2), -1, -2))

    def _weighed(self, values: Floats) -> Floats:
        """D d of columns (..., k, q)."""
        if self.axes is None or self.factors is None:
            return np.asarray(values)
        along = (1.0 - self.factors)[:, None] * (self.axes.T @ values)
        return np.asarray(values - self.axes @ along)


# What reduces readings (n,) to data (k,): a few differences, or contrasts of all of them.
Reduction = Floats | Contrasts


@functools.lru_cache(maxsize=8)
def zero_free(plan: Plan) -> Contrasts:
    """Contrasts that no zero enters, of independent, equal noise, shape (n − setups, n).

    Orthonormal where all readings are equally precise. Least squares on the contrasts is
    generalised least squares on the readings with one unknown zero per set-up.
    """
    if plan is not plan.steps:
        return zero_free(plan.steps)
    zeros = plan.precision[:, None] * plan.zeros
    return Contrasts(np.linalg.qr(zeros)[0], plan.precision)


def without_zeros(plan: Plan, values: Floats) -> Floats:
    """Values (..., n) less what gauge zeros can explain: the mean of their set-up."""
    zeros, _ = np.linalg.qr(plan.zeros)
    return np.asarray(values - (values @ zeros) @ zeros.T)
