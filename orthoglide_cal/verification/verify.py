"""Compare two sessions with the correction that was entered between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation import Solution, solve
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.estimation.methods import pose_differences
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Measured
from orthoglide_cal.verification.comparison import compare
from orthoglide_cal.verification.decision import decide
from orthoglide_cal.verification.response import respond
from orthoglide_cal.verification.result import Deviation, Verification


def verify(
    before: Measured,
    after: Measured,
    machine: Machine,
    applied_mm: Sequence[float],
    limit_mm: float | None = None,
    effects: Sequence[Effect] = (),
) -> Verification:
    """What was promised, what came true, and whether the machine responded as the model says.

    Args:
        before, after: readings or differences, measured with the same protocol.
        machine: nominal machine and its gauge.
        applied_mm: what was added to the controller's offsets between the two (x, y, z) [mm].
        limit_mm: largest deviation allowed in any difference; None for no decision.
        effects: departures from the nominal machine that are already known.

    Raises:
        UsageError: nothing was applied, or the two files have nothing in common.
        RankDeficientError, NotConvergedError: one of the files does not determine the offsets.
    """
    applied = np.array(applied_mm, dtype=np.float64)
    if not np.any(applied):
        raise UsageError(
            "Nothing was applied, so there is no response to verify.",
            "Give the change that was entered in the controller: --applied DX DY DZ",
        )
    if limit_mm is not None and limit_mm <= 0.0:
        raise UsageError("The limit must be greater than zero.", "Give it in mm: --limit 0.05")
    first, second = (solve(m, machine, effects=effects) for m in (before, after))
    comparison = compare(before, after, machine, effects)
    response = respond(
        comparison,
        first.offsets_mm,
        applied,
        noise_mm=machine.gauge.noise_mm,
        floor_mm=machine.gauge.rounding_mm,
    )
    factor = half_width(np.inf)
    deviations = _deviations(before, after, first, second, machine, effects, applied, factor)
    return Verification(
        before=before.source,
        after=after.source,
        machine=machine.name,
        kind=comparison.kind,
        count=len(comparison.before),
        applied_mm=applied,
        deviations=deviations,
        rms_before_mm=_rms([d.before_mm for d in deviations]),
        rms_promised_mm=_rms([d.promised_mm for d in deviations]),
        rms_after_mm=_rms([d.after_mm for d in deviations]),
        response=response.response,
        sigma_mm=response.sigma_mm,
        dof=response.dof,
        axes=response.axes,
        answer=response.answer,
        acted_as_mm=response.acted_as_mm,
        change=response.change,
        remaining_mm=second.offsets_mm,
        remaining_expanded_mm=(second.interval_mm[:, 1] - second.interval_mm[:, 0]) / 2.0,
        decision=None if limit_mm is None else decide(deviations, limit_mm),
        k=factor,
    )


def _deviations(
    before: Measured,
    after: Measured,
    first: Solution,
    second: Solution,
    machine: Machine,
    effects: Sequence[Effect],
    applied: Floats,
    factor: float,
) -> tuple[Deviation, ...]:
    """The differences of Table 4 before, promised (after the correction) and after."""
    kind = "single" if first.table[0].difference[-1] in "0+-" else "six"
    posed = pose_differences(before, machine, kind, effects)
    offsets = first.offsets_mm
    change = posed.problem.model(offsets - applied) - posed.problem.model(offsets)
    predicted = dict(zip(posed.names, change.tolist(), strict=True))
    later = pose_differences(after, machine, kind, effects)
    reach = factor * machine.gauge.noise_mm * np.sqrt(np.diag(later.problem.covariance()))
    expanded = dict(zip(later.names, reach.tolist(), strict=True))
    measured = {row.difference: row.measured_mm for row in second.table}
    return tuple(
        Deviation(
            name=row.difference,
            before_mm=row.measured_mm,
            promised_mm=row.measured_mm + predicted[row.difference],
            after_mm=measured[row.difference],
            expanded_mm=expanded[row.difference],
        )
        for row in first.table
        if row.difference in measured
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
