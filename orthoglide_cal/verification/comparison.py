"""What two sessions have in common: contrasts that both determine, with their covariance.

For raw readings y = C·m + Z·z + noise with cell means m (leg, direction, displacement, contact)
and gauge zeros z, the information on m after eliminating z is I = Cᵀ(1 − P_Z)C. A contrast of m
is compared if it lies in the range of I of both sessions: missing readings, unequal repeats and
moved stands then need no special case. Of differences, the named ones that both files hold are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats, Ints
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.methods import describe, pose_differences
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Differences, Measured, Readings
from orthoglide_cal.plan import Contact, Plan

# Eigenvalues of the information matrix below this are zero; real ones are 1/2 and more.
NO_INFORMATION = 1e-9


@dataclass(frozen=True, eq=False)
class Comparison:
    """k quantities measured in both sessions.

    Attributes:
        kind: "readings", "six", "twelve" or "single".
        problem: predicts them for given offsets.
        before, after: measured, shape (k,) [mm].
        covariance: of after − before for unit variance of one reading, shape (k, k).
    """

    kind: str
    problem: Problem
    before: Floats
    after: Floats
    covariance: Floats

    @property
    def change(self) -> Floats:
        """after − before, shape (k,) [mm]."""
        return self.after - self.before


def compare(
    before: Measured, after: Measured, machine: Machine, effects: Sequence[Effect] = ()
) -> Comparison:
    """The quantities that both sessions determine.

    Raises:
        UsageError: they have nothing in common.
    """
    if isinstance(before, Readings) and isinstance(after, Readings):
        comparison = _compare_readings(before, after, machine, effects)
    else:
        comparison = _compare_differences(before, after, machine, effects)
    if len(comparison.before) < 4:
        raise UsageError(
            f"The two files share {len(comparison.before)} quantities;"
            " three offsets cannot be verified with so few.",
            "Measure the same postures with the same gauge directions before and after.",
        )
    return comparison


def _compare_differences(
    before: Measured, after: Measured, machine: Machine, effects: Sequence[Effect]
) -> Comparison:
    kinds = {_difference_kind(before), _difference_kind(after)}
    if kinds == {"six", "twelve"}:
        kinds = {"six"}
    if len(kinds) > 1:
        raise UsageError(
            f"The first file holds {describe(before)}, the second {describe(after)}:"
            " they measure different things.",
            "Measure both with the same protocol.",
        )
    kind = kinds.pop()
    first, second = (pose_differences(m, machine, kind, effects) for m in (before, after))
    names = [name for name in first.names if name in second.names]
    rows = [[posed.names.index(name) for name in names] for posed in (first, second)]
    problem = Problem(
        machine, first.problem.plan, first.problem.matrix[rows[0]], first.problem.effects
    )
    spread = [
        posed.problem.covariance()[np.ix_(chosen, chosen)]
        for posed, chosen in zip((first, second), rows, strict=True)
    ]
    return Comparison(
        kind, problem, first.data[rows[0]], second.data[rows[1]], spread[0] + spread[1]
    )


def _difference_kind(measured: Measured) -> str:
    if isinstance(measured, Differences):
        return measured.kind
    return "six" if np.all(measured.plan.contact == Contact.FIXED) else "single"


def _compare_readings(
    before: Readings, after: Readings, machine: Machine, effects: Sequence[Effect]
) -> Comparison:
    keys = np.concatenate([_keys(before.plan), _keys(after.plan)])
    cells, cell = np.unique(keys, axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    sessions = (before, cell[: len(before)]), (after, cell[len(before) :])
    information = [_information(session, of, len(cells)) for session, of in sessions]
    unknown = np.concatenate([_null_space(matrix) for matrix, _ in information])
    contrasts = _null_space(unknown.T @ unknown)
    inverses = [np.linalg.pinv(matrix, rcond=NO_INFORMATION) for matrix, _ in information]
    estimates = [
        contrasts @ inverse @ right
        for inverse, (_, right) in zip(inverses, information, strict=True)
    ]
    problem = Problem(machine, _cells_plan(cells), contrasts, effects)
    covariance = contrasts @ (inverses[0] + inverses[1]) @ contrasts.T
    return Comparison("readings", problem, estimates[0], estimates[1], covariance)


def _keys(plan: Plan) -> Floats:
    columns = (plan.leg, plan.direction, plan.displacement, plan.contact, plan.gauge_at)
    keys: Floats = np.stack(columns, axis=1).astype(np.float64)
    return keys.round(9)


def _cells_plan(cells: Floats) -> Plan:
    count = len(cells)
    return Plan(
        leg=cells[:, 0].astype(np.intp),
        direction=cells[:, 1].astype(np.intp),
        displacement=cells[:, 2],
        contact=cells[:, 3].astype(np.intp),
        gauge_at=cells[:, 4],
        setup=np.zeros(count, dtype=np.intp),
        order=np.arange(count),
        hours=np.zeros(count),
    )


def _information(session: Readings, cell: Ints, count: int) -> tuple[Floats, Floats]:
    """I (m, m) and its right-hand side (m,) [mm]."""
    design = (cell[:, None] == np.arange(count)).astype(np.float64)
    zeros = session.plan.zeros
    free: Floats = np.eye(len(session)) - zeros @ np.linalg.pinv(zeros)
    return design.T @ free @ design, design.T @ free @ session.value


def _null_space(matrix: Floats) -> Floats:
    """Orthonormal rows that span the null space of a symmetric matrix, shape (j, m)."""
    values, vectors = np.linalg.eigh(matrix)
    return np.ascontiguousarray(vectors[:, values < NO_INFORMATION].T)
