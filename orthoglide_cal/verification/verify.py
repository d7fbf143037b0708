"""Two sessions of one machine, before and after an adjustment: promised against measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from orthoglide_cal.diagnosis import diagnose
from orthoglide_cal.errors import UnusableResultError, UsageError
from orthoglide_cal.estimation import PromisedDifference, Solution, pose_differences, solve
from orthoglide_cal.estimation.accuracy import half_width, rms
from orthoglide_cal.estimation.methods import table_kind
from orthoglide_cal.files import Conditions, Input, machine_values
from orthoglide_cal.model import Difference, Entered, Floats, Measured, Model, ReadOnly, Source
from orthoglide_cal.verification.comparison import Comparison, compare
from orthoglide_cal.verification.response import Response, respond

RULE = (
    "Pass if |deviation| + U is within the limit for every difference; fail if |deviation| - U is"
    " beyond it for any; otherwise undecided (guard band U on both sides, as in ISO 14253-1)."
)
_SMALLEST_MM = 1e-6  # no controller takes finer offsets
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
class Verification(ReadOnly):
    """A correction compared with its promise.

    Attributes:
        before, after: solutions of the two sessions; the second holds the offsets that remain.
        conditions: under which the two were measured.
        applied_mm: what was entered in the controller, shape (3,).
        deviations: of each difference that both sessions hold, at least one.
        k: coverage factor of their expanded uncertainty.
        comparison: all quantities that both sessions determine, with the problem behind them.
        response: how the machine responded.
        decision: about the limit; None without one.
    """

    before: Solution
    after: Solution
    conditions: tuple[Conditions, Conditions]
    applied_mm: Floats
    deviations: tuple[Deviation, ...]
    k: float
    comparison: Comparison
    response: Response
    decision: Decision | None

    @property
    def inputs(self) -> tuple[tuple[Source, Model], ...]:
        """Both files, each with the machine that it was judged by."""
        return tuple((each.source, each.model) for each in (self.before, self.after))

    @property
    def options(self) -> tuple[object, ...]:
        """What the user chose beside the files."""
        return self.applied_mm.tolist(), self.decision and self.decision.limit_mm

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
    history: Callable[[], Sequence[Entered]] = tuple,
) -> Verification:
    """What was promised, what came true, and whether the machine responded as the model says.

    Args:
        before, after: of the same machine, measured with the same protocol.
        applied_mm: what was added to the controller's offsets between the two (x, y, z) [mm];
            None takes what the inputs or the history say.
        limit_mm: largest deviation allowed in any difference; None for no decision.
        history: gives that of the machine file; only asked where the inputs do not say enough.

    Raises:
        UsageError: different machines, nobody says what was applied or nothing was, or the two
            inputs have nothing in common.
        RankDeficientError, NotConvergedError: one of them does not determine the offsets.
    """
    _require_same_machine(before.model, after.model)
    if applied_mm is None:
        applied = _recorded(before, after, history)
    else:
        applied = np.array(applied_mm, dtype=float)
    if np.abs(applied).max() < _SMALLEST_MM:
        raise UsageError(
            "Nothing was applied, so there is no response to verify.",
            "Give the change that was entered in the controller: --applied DX DY DZ",
        )
    require_limit(limit_mm)
    model = before.model
    (first, kept), (second, _) = (_solved(each, model) for each in (before, after))
    comparison = compare(before.measured, after.measured, model)
    response = respond(comparison, first.offsets_mm, applied)
    factor = half_width(np.inf)
    deviations = _deviations(first, kept, after, applied, factor)
    return Verification(
        before=first,
        after=second,
        conditions=(before.conditions, after.conditions),
        applied_mm=applied,
        deviations=deviations,
        k=factor,
        comparison=comparison,
        response=response,
        decision=None if limit_mm is None else decide(deviations, limit_mm),
    )


def require_limit(limit_mm: float | None) -> None:
    """Raises UsageError unless it is a length, or not given."""
    if limit_mm is not None and not 0.0 < limit_mm < np.inf:
        raise UsageError("The limit must be greater than zero.", "Give it in mm: --limit 0.05")


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
    reach = (
        factor * model.machine.instrument.noise_mm * np.sqrt(np.diag(later.problem.covariance()))
    )
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


def _recorded(before: Input, after: Input, history: Callable[[], Sequence[Entered]]) -> Floats:
    """Difference of the offsets that were active, rounded as offsets are entered [mm]."""
    first, second = (each.model.machine.active for each in (before, after))
    if first == second or not (before.is_session and after.is_session):
        sha256 = before.measured.source.sha256
        known = next((each for each in history() if each.data_sha256 == sha256), None)
        if known is None:
            raise UsageError(
                "The files do not say what was entered in the controller between them.",
                "Say it: --applied DX DY DZ; next time record it with orthocal apply.",
            )
        if first == second:
            # The later one was measured without knowing what had been entered.
            first, second = known.before, known.after
    return np.asarray((np.array(second) - np.array(first)).round(9))
