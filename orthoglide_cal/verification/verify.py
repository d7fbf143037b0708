"""Two sessions of one machine, before and after an adjustment: promised against measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation import PromisedDifference, Solution, pose_differences, solve
from orthoglide_cal.estimation.accuracy import half_width, rms
from orthoglide_cal.estimation.methods import table_kind
from orthoglide_cal.files import Input, machine_values
from orthoglide_cal.model import Difference, Floats, Measured, Model, freeze
from orthoglide_cal.verification.comparison import Comparison, compare
from orthoglide_cal.verification.response import Response, respond

RULE = (
    "Pass if |deviation| + U is within the limit for every difference; fail if |deviation| - U is"
    " beyond it for any; otherwise undecided (guard band U on both sides, as in ISO 14253-1)."
)
# Entries of the machine file in which two sessions of one machine agree.
_SAME = ("kind", "leg_length_mm", "joint_limits_mm", "identified")


@dataclass(frozen=True)
class Size:
    """Size of a set of differences [mm].

    Attributes:
        rms_mm: root mean square.
        largest_mm: largest, with its sign.
        largest: which.
    """

    rms_mm: float
    largest_mm: float
    largest: Difference

    @classmethod
    def of(cls, values: Mapping[Difference, float]) -> Size:
        """Of one difference or more [mm]."""
        largest = max(values, key=lambda each: abs(values[each]))
        return cls(rms(np.array(list(values.values()))), values[largest], largest)


@dataclass(frozen=True)
class Deviation:
    """One difference before and after the correction [mm].

    Attributes:
        promise: as it was measured before, and as the model said it would be left.
        after_mm: measured after.
        expanded_mm: expanded uncertainty U of the value measured after.
    """

    promise: PromisedDifference
    after_mm: float
    expanded_mm: float

    @property
    def difference(self) -> Difference:
        """Which."""
        return self.promise.difference

    @property
    def before_mm(self) -> float:
        """Measured before."""
        return self.promise.measured_mm

    @property
    def promised_mm(self) -> float:
        """What the model said would be left."""
        return self.promise.expected_mm


class Outcome(StrEnum):
    """Conformity with a limit, by `RULE`."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Decision:
    """Conformity with a stated limit.

    Attributes:
        limit_mm: largest deviation allowed in any difference.
        outcome: by the decision rule.
        largest: the largest deviation measured after the correction.
    """

    limit_mm: float
    outcome: Outcome
    largest: Deviation


@dataclass(frozen=True, eq=False)
class Verification:
    """A correction compared with its promise.

    Attributes:
        before, after: solutions of the two sessions; the second holds the offsets that remain.
        applied_mm: what was entered in the controller, shape (3,).
        deviations: of each difference that both sessions hold, at least one.
        k: coverage factor of their expanded uncertainty.
        comparison: all quantities that both sessions determine, with the problem behind them.
        response: how the machine responded.
        decision: about the limit; None without one.
    """

    before: Solution
    after: Solution
    applied_mm: Floats
    deviations: tuple[Deviation, ...]
    k: float
    comparison: Comparison
    response: Response
    decision: Decision | None

    def __post_init__(self) -> None:
        freeze(self, "applied_mm")

    @property
    def as_found(self) -> Size:
        """The differences before the correction."""
        return Size.of({d.difference: d.before_mm for d in self.deviations})

    @property
    def promised(self) -> Size:
        """What the model said would remain of them."""
        return Size.of({d.difference: d.promised_mm for d in self.deviations})

    @property
    def as_left(self) -> Size:
        """The differences after the correction."""
        return Size.of({d.difference: d.after_mm for d in self.deviations})


def verify(
    before: Input,
    after: Input,
    applied_mm: Sequence[float] | None = None,
    limit_mm: float | None = None,
) -> Verification:
    """What was promised, what came true, and whether the machine responded as the model says.

    Args:
        before, after: of the same machine, measured with the same protocol.
        applied_mm: what was added to the controller's offsets between the two (x, y, z) [mm];
            None takes the difference between the offsets that two sessions record as active.
        limit_mm: largest deviation allowed in any difference; None for no decision.

    Raises:
        UsageError: different machines, nobody says what was applied or nothing was, or the two
            inputs have nothing in common.
        RankDeficientError, NotConvergedError: one of them does not determine the offsets.
    """
    _require_same_machine(before.model, after.model)
    applied = _recorded(before, after) if applied_mm is None else np.array(applied_mm, dtype=float)
    if not np.any(applied):
        raise UsageError(
            "Nothing was applied, so there is no response to verify.",
            "Give the change that was entered in the controller: --applied DX DY DZ",
        )
    if limit_mm is not None and limit_mm <= 0.0:
        raise UsageError("The limit must be greater than zero.", "Give it in mm: --limit 0.05")
    model = before.model
    (first, kept), (second, _) = (_solved(each, model) for each in (before, after))
    comparison = compare(before.measured, after.measured, model)
    response = respond(comparison, first.offsets_mm, applied)
    factor = half_width(np.inf)
    deviations = _deviations(first, kept, after, applied, factor)
    return Verification(
        before=first,
        after=second,
        applied_mm=applied,
        deviations=deviations,
        k=factor,
        comparison=comparison,
        response=response,
        decision=None if limit_mm is None else decide(deviations, limit_mm),
    )


def decide(deviations: Sequence[Deviation], limit_mm: float) -> Decision:
    """Compare every deviation measured after the correction with the limit (ISO 14253-1).

    Args:
        deviations: at least one.
        limit_mm: largest size of a deviation that is allowed.
    """
    largest = max(deviations, key=lambda d: abs(d.after_mm))
    if any(abs(d.after_mm) - d.expanded_mm > limit_mm for d in deviations):
        outcome = Outcome.FAIL
    elif all(abs(d.after_mm) + d.expanded_mm <= limit_mm for d in deviations):
        outcome = Outcome.PASS
    else:
        outcome = Outcome.UNDECIDED
    return Decision(limit_mm, outcome, largest)


def _solved(given: Input, model: Model) -> tuple[Solution, Measured]:
    """The offsets, as unsure as the diagnosis leaves them, and the data without passing faults."""
    solution = solve(given.measured, model)
    try:
        found = diagnose(given.measured, model)
    except UnusableResultError:
        return solution, given.measured
    budget = solution.budget.extended(found.adds_to(solution))
    return replace(solution, budget=budget), found.put_right


def _deviations(
    before: Solution, right: Measured, after: Input, applied: Floats, factor: float
) -> tuple[Deviation, ...]:
    """The differences of Table 4 before, promised and after, where both sessions hold them."""
    model = before.model
    later = pose_differences(after.measured, model, table_kind(before.measured))
    reach = factor * model.machine.gauge.noise_mm * np.sqrt(np.diag(later.problem.covariance()))
    measured = zip(later.data.tolist(), reach.tolist(), strict=True)
    came_true = dict(zip(later.which, measured, strict=True))
    deviations = tuple(
        Deviation(row, *came_true[row.difference])
        for row in before.promised(applied, right)
        if row.difference in came_true
    )
    if not deviations:
        raise UsageError(
            "The two files share no difference between the ends of a leg's travel.",
            "Measure the postures max and min before and after.",
        )
    return deviations


def _require_same_machine(before: Model, after: Model) -> None:
    """Raises UsageError, which says in what the two machine files differ."""
    first, second = machine_values(before), machine_values(after)
    different = [name for name in _SAME if first.get(name) != second.get(name)]
    if different:
        raise UsageError(
            f"The two sessions are of different machines: {', '.join(different)} differ.",
            "Give the machine that both are to be judged by: --machine FILE",
        )


def _recorded(before: Input, after: Input) -> Floats:
    """Difference of the active offsets of two sessions, rounded as offsets are entered [mm]."""
    change = np.array(after.model.machine.offsets_mm) - np.array(before.model.machine.offsets_mm)
    if not (before.is_session and after.is_session) or not np.any(change):
        raise UsageError(
            "The files do not say what was entered in the controller between them.",
            "Say it: --applied DX DY DZ",
        )
    return np.asarray(change.round(9))
