"""What two sessions have in common: contrasts that both determine, with their covariance.

For raw readings y = C·m + Z·z + noise with cell means m (leg, direction, displacement, contact)
and gauge zeros z, the information on m after eliminating z is I = Cᵀ(1 − P_Z)C. A contrast of m
is compared if it lies in the range of I of both sessions: missing readings, unequal repeats and
moved stands then need no special case. Of differences, the named ones that both files hold are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Problem, pose_differences
from orthoglide_cal.estimation.methods import DESCRIPTIONS, table_kind
from orthoglide_cal.model import (
    DataKind,
    Floats,
    GaugePlan,
    Ints,
    Measured,
    Model,
    Readings,
    ReadOnly,
)

# Eigenvalues of the information matrix below this are zero; real ones are 1/2 and more.
NO_INFORMATION = 1e-9


@dataclass(frozen=True, eq=False)
class Comparison(ReadOnly):
    """k quantities measured in both sessions.

    Attributes:
        kind: what they are: contrasts of readings, or differences.
        problem: predicts them for given offsets.
        before, after: measured, shape (k,) [mm].
        covariance: of after − before for unit variance of one reading, shape (k, k).
    """

    kind: DataKind
    problem: Problem
    before: Floats
    after: Floats
    covariance: Floats

    def __len__(self) -> int:
        return len(self.before)

    @property
    def change(self) -> Floats:
        """after − before, shape (k,) [mm]."""
        return self.after - self.before


def compare(before: Measured, after: Measured, model: Model) -> Comparison:
    """The quantities that both sessions determine.

    Raises:
        UsageError: they have nothing in common.
    """
    raw = [each for each in (before, after) if isinstance(each, Readings)]
    if len(raw) == 2:
        comparison = _compare_readings(raw[0], raw[1], model)
    else:
        comparison = _compare_differences(before, after, model)
    if len(comparison) < 4:
        raise UsageError(
            f"The two files share {len(comparison)} quantities;"
            " three offsets cannot be verified with so few.",
            "Measure the same postures with the same gauge directions before and after.",
        )
    return comparison


def _compare_differences(before: Measured, after: Measured, model: Model) -> Comparison:
    kinds = {
        table_kind(each) if each.kind is DataKind.READINGS else each.kind
        for each in (before, after)
    }
    if kinds == {DataKind.SIX, DataKind.TWELVE}:
        kinds = {DataKind.SIX}
    if len(kinds) > 1:
        raise UsageError(
            f"The first file holds {DESCRIPTIONS[before.kind]}, the second"
            f" {DESCRIPTIONS[after.kind]}: they measure different things.",
            "Measure both with the same protocol.",
        )
    kind = kinds.pop()
    first, second = (pose_differences(each, model, kind) for each in (before, after))
    shared = [each for each in first.which if each in second.which]
    rows = [[posed.which.index(each) for each in shared] for posed in (first, second)]
    spread = [
        posed.problem.covariance()[np.ix_(chosen, chosen)]
        for posed, chosen in zip((first, second), rows, strict=True)
    ]
    return Comparison(
        kind=kind,
        problem=Problem(model, first.problem.plan, first.problem.matrix[rows[0]]),
        before=first.data[rows[0]],
        after=second.data[rows[1]],
        covariance=spread[0] + spread[1],
    )


def _compare_readings(before: Readings, after: Readings, model: Model) -> Comparison:
    # Each session's machine as it was found: not what was read with something entered meanwhile.
    as_found = [each.plan.as_found for each in (before, after)]
    keys = [_keys(each.plan)[found] for each, found in zip((before, after), as_found, strict=True)]
    cells, cell = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    of = np.split(cell.reshape(-1), [len(keys[0])])
    information = [
        _information(each.value[found], each.plan.zeros[found], own, len(cells))
        for each, found, own in zip((before, after), as_found, of, strict=True)
    ]
    unknown = np.concatenate([_null_space(matrix) for matrix, _ in information])
    contrasts = _null_space(unknown.T @ unknown)
    inverses = [np.linalg.pinv(matrix, rcond=NO_INFORMATION) for matrix, _ in information]
    estimates = [
        contrasts @ inverse @ right
        for inverse, (_, right) in zip(inverses, information, strict=True)
    ]
    return Comparison(
        kind=DataKind.READINGS,
        problem=Problem(model, _cells_plan(cells), contrasts),
        before=estimates[0],
        after=estimates[1],
        covariance=contrasts @ (inverses[0] + inverses[1]) @ contrasts.T,
    )


def _keys(plan: GaugePlan) -> Floats:
    where = (plan.leg, plan.direction, plan.displacement, plan.contact, plan.gauge_at)
    keys: Floats = np.stack((*where, plan.turned), axis=1).astype(np.float64)
    return keys.round(9)


def _cells_plan(cells: Floats) -> GaugePlan:
    count = len(cells)
    return GaugePlan(
        leg=cells[:, 0].astype(np.intp),
        direction=cells[:, 1].astype(np.intp),
        displacement=cells[:, 2],
        contact=cells[:, 3].astype(np.intp),
        gauge_at=cells[:, 4],
        setup=np.zeros(count, dtype=np.intp),
        order=np.arange(count),
        hours=np.zeros(count),
        turned=cells[:, 5] != 0.0,
    )


def _information(value: Floats, zeros: Floats, cell: Ints, count: int) -> tuple[Floats, Floats]:
    """I (m, m) and its right-hand side (m,) [mm]."""
    design = (cell[:, None] == np.arange(count)).astype(np.float64)
    free: Floats = np.eye(len(value)) - zeros @ np.linalg.pinv(zeros)
    return design.T @ free @ design, design.T @ free @ value


def _null_space(matrix: Floats) -> Floats:
    """Orthonormal rows that span the null space of a symmetric matrix, shape (j, m)."""
    values, vectors = np.linalg.eigh(matrix)
    return np.ascontiguousarray(vectors[:, values < NO_INFORMATION].T)
