"""Compare two measurements by what was entered between them: did it work as predicted?

The change c of the differences that both hold is regressed on what the model predicts,

    c = β·g(δ) + noise,  g(δ) = h(Δρ − δ) − h(Δρ)

h: predicted differences, Δρ: offsets before, δ: entered in the controller; theory says β = 1. What
the controller corrects of causes from then on is in g, too; each axis is judged without it.

A machine that probes itself has other places each time: it is as predicted if the mean squares of
its heights differ by no more than noise and local shape, as stated, explain.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from operator import attrgetter
from typing import Literal, Self

import numpy as np
from pydantic import Field, InstanceOf

from orthoglide_cal.causes import HOME_SWITCH, correcting
from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.budget import half_width
from orthoglide_cal.estimation.gaussian import whiten
from orthoglide_cal.estimation.solution import (
    Problem,
    PromisedDifference,
    Solution,
    chance_of_residual,
    pose,
    promise,
    rms,
    suspicious,
    table_kind,
)
from orthoglide_cal.files.input import Input, InputFile, require_distinct, require_order
from orthoglide_cal.files.machine_file import differing
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.inference.result import Parameter
from orthoglide_cal.inference.sessions import Behaviour, decide_response
from orthoglide_cal.model.machine import Corrections, Instrument
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Measured
from orthoglide_cal.model.model import NORMAL_K, Effect, Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.planning.adjustment import Removed
from orthoglide_cal.results.answer import STEP_K, Validity
from orthoglide_cal.results.making import as_judged, parameters_of, remainder, validity, widened
from orthoglide_cal.schema import Reason, Schema, Sentence

FINEST = 6  # decimals of offsets in mm: no controller takes finer ones


class Outcome(StrEnum):
    """Conformity with a limit, with a guard band U on both sides (ISO 14253-1); worst first."""

    FAIL = "fail"
    UNDECIDED = "undecided"
    PASS = "pass"


class ComparedInput(InputFile):
    """One of the two measurements."""

    validity: Validity
    parameters: tuple[Parameter, ...]


class Coefficient(Schema):
    """A number with its 95 % Student-t interval; theory says 1."""

    value: float
    ci95: tuple[float, float]


class AxisResponse(Schema):
    """The response of one joint."""

    applied_mm: float
    found_mm: float  # change that the readings show
    ci95_mm: tuple[float, float]
    otherwise: bool  # something else than what was applied is stated


class OtherChange(Schema):
    """Change that no joint offset explains."""

    rms_mm: float  # unexplained change of a difference, per degree of freedom
    noise_mm: float  # what the gauge's noise alone gives for it
    dof: int
    p_value: float
    found: bool  # noise alone hardly ever gives it


class ComparedDifference(PromisedDifference):
    """One difference, and the value measured after the correction."""

    after_mm: float
    after_expanded_mm: float  # U of that
    outcome: Outcome | None  # by the rule; null where no limit was given

    @classmethod
    def of(cls, row: PromisedDifference, after: float, u: float, limit: float | None) -> Self:
        """The promise and what was measured, with its U and a limit [mm]."""
        outcome, room = None, (limit or 0.0) - abs(after)
        if limit is not None:
            unsure = Outcome.FAIL if room < -u else Outcome.UNDECIDED
            outcome = Outcome.PASS if room >= u else unsure
        return cls(**dict(row), after_mm=after, after_expanded_mm=u, outcome=outcome)


class Conformity(Schema):
    """Conformity with a stated limit."""

    outcome: Outcome  # the worst of all differences
    limit_mm: float
    coverage_factor: float = NORMAL_K
    rule: Sentence = Reason.of("guard_band")


class Verification(Schema):
    """A correction compared with its prediction; its dump is `verify --json`."""

    # Both measurements, each with the machine that it was judged by.
    inputs: tuple[InstanceOf[Input], InstanceOf[Input]] = Field(exclude=True, repr=False)
    schema_version: Literal[1] = 1
    simulated: bool  # one of the two, or both
    before: ComparedInput
    after: ComparedInput
    machine: str
    kind: str  # what is compared: six, twelve or single differences, or heights
    compared: int  # differences, or touches afterwards
    kept: bool  # the correction worked as predicted
    apart_mm: float | None = None  # of differences: r.m.s. of measured less predicted
    apart_expanded_mm: float | None = None  # r.m.s. of U of both; beyond it not as predicted
    improves: bool | None = None  # of heights: the prediction is better than before, beyond noise
    moved: bool = False  # worse than before, although nothing was entered
    reservations: tuple[Sentence, ...]  # what to know before relying on it
    rms_before_mm: float
    rms_promised_mm: float
    rms_expanded_mm: float | None = None  # of heights, on the side of what was measured
    rms_after_mm: float
    remains: Sentence | None = None  # what offsets do not remove; null: only noise is left
    # Change of each parameter in between; null: nobody knows.
    entered: dict[str, float | None]
    applied_mm: dict[str, float] = Field({})  # entered, and moved by screws
    corrected: Corrections = Field({})  # causes that the controller corrects since then
    differences: tuple[ComparedDifference, ...] = ()
    response: Coefficient | None = None  # all axes together
    response_dof: int | None = None
    axes: dict[str, AxisResponse] = Field({})
    answer: Behaviour | None = None
    acted_as_mm: dict[str, float] | None = None  # in the signed order that explains more
    other_change: OtherChange | None = None
    decision: Conformity | None = None

    @property
    def failed(self) -> bool:
        beyond = self.decision is not None and self.decision.outcome is Outcome.FAIL
        return beyond or not self.kept


def verify(
    before: Input,
    after: Input,
    applied_mm: Sequence[float] | None = None,
    limit_mm: float | None = None,
    adjusted: Removed = (),
    typed: str = "",
) -> Verification:
    """Compare the predicted effect of a correction with the measured one.

    Args:
        before, after: of the same machine, measured with the same protocol.
        applied_mm: added to the controller's values between the two, in their order; None takes
            what the inputs say, or the machine file that records it.
        limit_mm: largest deviation allowed in any difference; None for no decision.
        adjusted: what screws removed between the two, in addition.
        typed: the command with the two in the other order, for a refusal.

    Raises UsageError: the two cannot be compared, or nobody says what was applied;
    UnusableResultError: one of them does not determine the parameters.
    """
    require_distinct((before, after))
    ordered = require_order(before, after, typed)
    # Heights are compared where no differences can be made of what was read.
    heights = [given.measured.kinds == (DataKind.READINGS,) for given in (before, after)]
    if all(heights):
        if limit_mm is not None:
            raise UsageError("--limit is for differences of readings.", "Leave it out.")
        return _of_touches(before, after, applied_mm)
    if any(heights):
        raise UsageError("Only one of the two files holds touches of a bed.", "Name two that do.")
    if different := differing(before.model, after.model):
        fault = f"The two sessions are of different machines: {', '.join(different)} differ."
        raise UsageError(fault, "Give the machine that both are to be judged by: --machine FILE")
    pushed, screws = dict.fromkeys(AXES, 0.0), dict[str, dict[str, float]]()
    for id, size in adjusted:
        sizes = pushed if id == HOME_SWITCH.id else screws.setdefault(id, {})
        sizes[size.name] = round(sizes.get(size.name, 0.0) + size.value, 4)
    model, (entered, held) = before.model, _entered(before, after, applied_mm, bool(adjusted))
    held = {**held, **screws}
    corrected = _more(model.machine.corrected, held)
    applied = np.add(entered, [*pushed.values()]).round(FINEST)
    if not applied.any() and not corrected:
        raise UsageError(
            "Nothing was applied, so there is no response to verify.",
            "Give the change that was entered in the controller: --applied DX DY DZ",
        )
    after = replace(after, model=model.correcting(held))
    (first, right, side), (*_, other) = map(_solved, (before, after))
    added = correcting(model.machine, corrected)
    response = _respond(before.measured, after.measured, model, added, first.offsets_mm, applied)
    later, data = pose(after.measured, model, table_kind(before.measured))
    u = NORMAL_K * model.machine.instrument.noise_mm * np.sqrt(np.diag(later.covariance()))
    promised = {row.name: row for row in promise(before.measured, first, applied, right, added)}
    rows = [
        ComparedDifference.of(promised[which.name], value, unsure, limit_mm)
        for which, value, unsure in zip(later.which, data.tolist(), u.tolist(), strict=True)
        if which.name in promised
    ]
    if not rows:
        fault = "The two files share no difference between the ends of a leg's travel."
        raise UsageError(fault, "Measure the postures max and min before and after.")
    columns = "measured_mm", "expected_mm", "expanded_mm", "after_mm", "after_expanded_mm"
    was, will_be, sure, now, now_sure = np.array([attrgetter(*columns)(row) for row in rows]).T
    apart, both = rms(now - will_be), rms(np.hypot(sure, now_sure))
    grown = min(rms(will_be), rms(now)) > rms(was) + both
    if grown and not ordered and rms(applied) > 2.0 * rms(first.offsets_mm):  # nobody enters that
        fault = f"{after.name} seems to have been measured before {before.name}: in this order the"
        fault += " deviations grow, as what was entered predicts."
        raise UsageError(fault, f"Name it first: {typed}")
    outcomes, decision = [row.outcome for row in rows if row.outcome], None
    if limit_mm is not None:
        decision = Conformity(outcome=min(outcomes, key=[*Outcome].index), limit_mm=limit_mm)
    return Verification(
        **_common((before, after), (side, other), entered.tolist()),
        kept=response["answer"] is Behaviour.AS_MODELLED and apart <= both,
        apart_mm=apart,
        apart_expanded_mm=both,
        rms_before_mm=rms(was),
        rms_promised_mm=rms(will_be),
        rms_after_mm=rms(now),
        remains=None if adjusted else remainder(rows, model),
        applied_mm=dict(zip(AXES, applied.tolist(), strict=True)),
        corrected=corrected,
        differences=tuple(rows),
        **response,
        decision=decision,
    )


def _of_touches(before: Input, after: Input, applied: Sequence[float] | None) -> Verification:
    """Touches of a bed, each judged with the parameters that were in the controller then."""
    if applied is not None:
        pairs = zip(before.model.machine.active, applied, strict=False)
        held = [round(active + by, 9) for active, by in pairs]
        after = replace(after, model=after.model.holding(held))  # refused where its file says it
    machine, later = before.model.machine, after.model.machine
    machine.check_same(later)
    stated = all(given.measured.source.excerpt is not None for given in (before, after))
    entered: list[float | None] = [None] * len(machine.active)
    # A table says nothing of the firmware: with one machine file for both nobody knows.
    if machine != later or stated:
        entered = np.subtract(later.active, machine.active).round(9).tolist()
    keeper, sha256 = before.keeper, before.measured.source.sha256
    entry = keeper.model.machine.entered_from(sha256) if keeper else None
    corrected = _more(entry.corrected_before or {}, entry.corrected or {}) if entry else {}
    # What the firmware corrects since then was wrong, and is promised not to be.
    wrong = (effect.cause.at(-effect.theta) for effect in correcting(machine, corrected))
    before = replace(before, model=before.model.extended(wrong))
    (first, _, side), (second, _, other) = map(_solved, (before, after))
    count, touches = (int(one.problem.plan.touches.sum()) for one in (first, second))
    was, u_was, noise2 = _mean_square(first, first.measured.value)
    promised, u_promised, _ = _mean_square(first, first.measured.value - first.predicted_mm)
    now, u_now, _ = _mean_square(second, second.measured.value)
    reach = NORMAL_K * math.hypot(u_promised, u_now)
    # Touches that p parameters were fitted to fit better than others will, by 2 p/n of the noise
    # (Mallows).
    most = promised + 2.0 * len(entered) * noise2 / count + reach
    squares = was, promised, now, max(promised - reach, 0.0), most
    before_mm, promised_mm, after_mm, least_mm, most_mm = np.sqrt(squares).tolist()
    taken = count * (was - promised)  # by the parameters; of noise they take p degrees of freedom
    improves = chance_of_residual(taken, len(entered), math.sqrt(noise2)) < suspicious(machine)
    if improves:
        # Maps repeat, noise does not: what is as far from it as before is not as predicted.
        most_mm = min(most_mm, (before_mm + promised_mm) / 2.0)
    return Verification(
        **_common((before, after), (side, other), entered),
        kind="heights",
        corrected=corrected,
        compared=touches,
        kept=least_mm <= after_mm <= most_mm,
        improves=improves,
        moved=set(entered) == {0.0} and now - was > NORMAL_K * math.hypot(u_was, u_now),
        rms_before_mm=before_mm,
        rms_promised_mm=promised_mm,
        rms_expanded_mm=abs((least_mm if after_mm < promised_mm else most_mm) - promised_mm),
        rms_after_mm=after_mm,
    )


def _mean_square(solution: Solution, heights: Floats) -> tuple[float, float, float]:
    """Mean square of touches [mm²], its u, and what noise and local shape make of it; (n,) [mm]."""
    plan, machine = solution.problem.plan, solution.model.machine
    # Without their mean: the first layer's height is set apart.
    left = heights[plan.touches] - heights[plan.touches].mean()
    count, total = len(left), float(left @ left)
    shape = machine.local_shape(plan)
    columns = shape.columns[plan.touches] if shape else np.zeros((count, 0))
    white2 = machine.instrument.noise_mm**2 + (shape.rest if shape else 0.0)
    inner = columns.T @ columns
    noise2 = white2 + float(np.trace(inner)) / count
    # tr(C²) and mᵀCm of C = σ²I + BBᵀ; m is what is more than noise.
    square = count * white2**2 + 2.0 * white2 * np.trace(inner) + np.sum(inner**2)
    share = max(1.0 - noise2 * count / total, 0.0) if total else 0.0  # all may be equal
    along = share * (white2 * total + np.sum((left @ columns) ** 2))
    return total / count, math.sqrt(2.0 * square + 4.0 * along) / count, noise2


def _common(
    inputs: tuple[Input, Input],
    sides: tuple[ComparedInput, ComparedInput],
    entered: Sequence[float | None],
) -> dict[str, object]:
    (before, after), machine = sides, inputs[0].model.machine
    return {
        "inputs": inputs,
        "simulated": any(given.measured.source.simulated for given in inputs),
        "before": before,
        "after": after,
        "machine": machine.name,
        "reservations": tuple(compare_reservations(before.validity, after.validity)),
        "entered": dict(zip(machine.parameter_names, entered, strict=True)),
    }


def compare_reservations(before: Validity, after: Validity) -> Iterator[Reason]:
    """Reservations of two measurements together: of each, and of both."""
    for when, conditions, other in (("Before", before, after), ("After", after, before)):
        for reason in conditions.reservations:
            both = reason in other.reservations
            # Nothing is entered now that could lower a nozzle.
            if reason.code != "nozzle_lower" and (not both or conditions is before):
                session = "Before and after" if both else when
                yield Reason.of("of_session", when=session, reason=reason)
    ids = [[gauge.id for gauge in conditions.gauges] for conditions in (before, after)]
    if all(ids) and set(ids[0]) != set(ids[1]):
        yield Reason.of("other_gauges", before=ids[0], after=ids[1])
    ends = ((one.temperature_start_c, one.temperature_end_c) for one in (before, after))
    known = [[end for end in pair if end is not None] for pair in ends]
    if all(known):
        first, second = (sum(pair) / len(pair) for pair in known)
        if abs(second - first) > STEP_K:
            yield Reason.of("temperatures_differ", before_c=first, after_c=second)


def _solved(given: Input) -> tuple[Solution, Measured, ComparedInput]:
    """The parameters alone, data without passing faults, and the parameters under the verdict."""
    diagnosis = diagnose(given.measured, given.model)
    alone = widened(given, diagnosis.alone, diagnosis.adds_to(diagnosis.alone))
    judged = as_judged(given, diagnosis.alone, alone, diagnosis)
    side = ComparedInput.of(given, validity=validity(given), parameters=parameters_of(judged))
    return alone, diagnosis.put_right, side


def _entered(
    before: Input, after: Input, applied: Sequence[float] | None, adjusted: bool
) -> tuple[Floats, Corrections]:
    """Values added to the offsets, (3,) [mm], and corrections of the controller from then on.

    Where screws were `adjusted` and no file says that anything was entered, nothing was.
    """
    keeper, first, second = before.keeper, before.model.machine, after.model.machine
    known = keeper.model.machine.entered_from(before.measured.source.sha256) if keeper else None
    then, now, corrected = first.active, second.active, second.corrected
    if known and known.corrected is not None and corrected == first.corrected:
        corrected = known.corrected
    if applied is not None:
        return np.array(applied, dtype=float), corrected
    if known and after.precedes(known):
        paths = (given.measured.source.path for given in (after, before))
        raise UsageError(
            "{} was measured before the offsets of {} were entered.".format(*paths),
            "Measure again; or give what had been entered by then: --applied DX DY DZ",
        )
    sessions = before.is_session and after.is_session
    if not (known or adjusted or (sessions and then != now)):
        raise UsageError(
            "The files do not say what was entered in the controller between them.",
            "Give it: --applied DX DY DZ; next time record it with orthocal apply.",
        )
    if known and then == now:
        then, now = known.active
    return np.subtract(now, then).round(9), corrected


def _more(before: Corrections, after: Corrections) -> Corrections:
    """Corrections in addition to those before."""
    pairs = {id: (before.get(id, {}), after.get(id, {})) for id in {**before, **after}}
    return {
        id: {name: new.get(name, 0.0) - old.get(name, 0.0) for name in {**old, **new}}
        for id, (old, new) in pairs.items()
        if old != new
    }


# --- how the machine responded ----------------------------------------------------------------


def _respond(
    before: Measured,
    after: Measured,
    model: Model,
    added: Sequence[Effect],
    offsets: Floats,
    applied: Floats,
) -> dict[str, object]:
    """The fields of a verification that say how the machine responded.

    To `applied`, δ (3,) [mm], or what its controller corrects since (`added`); `offsets`: Δρ
    before, (3,) [mm].
    """
    kind, first, second, change = shared_differences(before, after, model)
    gauge, remaining = model.machine.instrument, offsets - applied
    # Midway, where a linear model of the change is right to third order.
    jacobian = -second.predict_with_jacobian(offsets - applied / 2.0)[1]
    later = replace(second, model=model.extended(added)).predict(remaining)
    predicted = later - first.predict(offsets)
    moved = change - (later - second.predict(remaining))  # by the offsets alone
    covariance = first.covariance() + second.covariance()  # for unit variance of a reading
    typical = rms(np.sqrt(np.diag(covariance)))
    change, moved, predicted, jacobian = whiten(
        covariance, change, moved, predicted[:, None], jacobian
    )
    # The axes are fitted together; corrections have one gain.
    acting, moves = (change, predicted, np.ones(1)), list[Coefficient]()
    (gain,), left, spare = _regress(change, predicted, gauge)
    if applied.any():
        acting = moved, jacobian, applied
        moves, left, spare = _regress(moved, jacobian, gauge)
    answer, likeliest = decide_response(*acting, gauge.noise_mm)
    otherwise = (likeliest.moved != applied) | likeliest.free.any(axis=1)
    rows = zip(AXES, applied.tolist(), moves, otherwise.tolist(), strict=False)
    axes = {
        axis: AxisResponse(applied_mm=by, found_mm=move.value, ci95_mm=move.ci95, otherwise=other)
        for axis, by, move, other in rows
    }
    another = bool(axes) and answer in (Behaviour.OPPOSITE, Behaviour.EXCHANGED)
    p_value = chance_of_residual(left, spare, gauge.noise_mm)
    return {
        "kind": kind,
        "compared": len(change),
        "response": gain,
        "response_dof": len(change) - 1,
        "axes": axes,
        "answer": answer,
        "acted_as_mm": dict(zip(AXES, likeliest.moved.tolist(), strict=True)) if another else None,
        "other_change": OtherChange(
            rms_mm=typical * math.sqrt(left / spare),
            noise_mm=typical * gauge.noise_mm,
            dof=spare,
            p_value=p_value,
            found=p_value < suspicious(model.machine),
        ),
    }


def shared_differences(
    before: Measured, after: Measured, model: Model
) -> tuple[DataKind, Problem, Problem, Floats]:
    """The k differences that both sessions hold, of the kind with most of them; at least four.

    That kind, the problems of both, and the measured change, after − before, (k,) [mm].
    """
    every = []
    for kind in (kind for kind in DIFFERENCES if kind in before.kinds and kind in after.kinds):
        (first, was), (second, now) = (pose(data, model, kind) for data in (before, after))
        one = np.array([difference in second.which for difference in first.which], dtype=bool)
        other = np.array([difference in first.which for difference in second.which], dtype=bool)
        every.append((kind, first.only(one), second.only(other), now[other] - was[one]))
    shared = max(every, key=lambda row: len(row[-1]), default=None)
    if shared is None or len(shared[-1]) < 4:
        raise UsageError(
            "The two files share fewer than four differences: three offsets cannot be verified.",
            "Measure the same legs at iso, max and min with the same protocol before and after.",
        )
    return shared


def _regress(
    change: Floats, columns: Floats, gauge: Instrument
) -> tuple[list[Coefficient], float, int]:
    """Least squares of a whitened change: coefficients, squares left [mm²], degrees of freedom."""
    inverse = np.linalg.pinv(columns)
    sizes = inverse @ change
    residual = change - columns @ sizes
    left, spare = float(residual @ residual), len(change) - len(sizes)
    # No reading is known better than its gauge's resolution allows.
    sigma = max(math.sqrt(left / spare), gauge.rounding_mm)
    reach = half_width(spare) * sigma * np.linalg.norm(inverse, axis=1)
    rows = np.stack((sizes, sizes - reach, sizes + reach), axis=1).tolist()
    return [Coefficient(value=value, ci95=ends) for value, *ends in rows], left, spare
