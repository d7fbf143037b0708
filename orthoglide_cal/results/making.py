"""Lead from one input to its answer: solved, diagnosed, judged once, whoever asks.

The parameters are those under the verdict:

    consistent     the calibrated parameters alone, widened by what may hide
    named          with the causes that were found
    ambiguous      their mean over the open explanations, widened by that choice
    unexplained    alone, widened by the unexplained part

With a method that was asked for they are always those alone, as the paper has them.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import PostureError, UnusableResultError, UsageError
from orthoglide_cal.estimation.budget import Contribution, Scatter, warmth
from orthoglide_cal.estimation.solution import (
    PromisedDifference,
    Solution,
    promise,
    require_settings,
    rms,
)
from orthoglide_cal.files.input import Input, InputFile
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.result import WORTH_SAYING, NextMeasurement, Parameter, Verdict
from orthoglide_cal.model.machine import OwnGauge
from orthoglide_cal.model.measured import CAUTIONS, DIFFERENCES, DataKind, Differences, Measured
from orthoglide_cal.model.model import NORMAL_K, Effect, Model, Stage
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.model.workspace import workspace_error
from orthoglide_cal.results import answer as schema
from orthoglide_cal.results.answer import RETAKE, STEP_K, THEN, Release, Remedy, UsedGauge, Validity
from orthoglide_cal.schema import Reason

# Beyond this Student's t is the normal distribution to two decimals.
NORMAL_DOF = 500.0
# What the answer takes from a diagnosis as it is.
_DIAGNOSED = (
    *("verdict", "lack_of_fit", "causes", "baselines", "ambiguous_with", "not_excluded"),
    *("refuted", "patterns", "unshown", "beyond_tolerance", "assumed_sizes", "sensitivity"),
)


def answer_to(
    given: Input,
    method: str | None = None,
    *,
    diagnosed: Diagnosis | None = None,
    holdout: str | None = None,
    details: bool = False,
    corrects: Collection[str] = (),
    dates: Sequence[Input] = (),
) -> schema.Answer:
    """Solve, diagnose and judge one input.

    Args:
        method: name of an estimator; then the answer holds the parameters alone.
        diagnosed: its diagnosis, if that was made already.
        holdout: file of the readings that the diagnosis predicted; None for those left out.
        details: also sensitivity, the tool's error, and the residuals if nothing is wrong.
        corrects: ids that the controller is to correct, too: those hold no release.
        dates: of which the input is made, oldest first.

    Raises UsageError, InputError as `solve`; of a result that must not be used the answer says so.
    """
    measured, model = given.measured, given.model
    machine, conditions = model.machine, validity(given)
    known = {
        "input": InputFile.of(given),
        "machine": schema.MachineName(name=machine.name, kind=machine.kind),
        "validity": conditions,
        "simulated": measured.source.simulated,
    }
    try:
        require_settings(measured)
        diagnosis = diagnosed or diagnose(measured, model, sensitivity=details)
        solution = solve(measured, model, method) if method else diagnosis.alone
    except UnusableResultError as error:
        unknown = measured.source.excerpt and measured.source.excerpt.unknown
        reason = Reason.of("settings_unknown" if unknown else "refused", what=error.what)
        remedies = (Remedy.of("do", what=error.remedy),) if error.remedy else ()
        refused = Release(reasons=(reason,), remedies=remedies, sound=False)
        return schema.Answer(**known, release=refused)
    following = None
    if diagnosis.undecided:
        # Planning takes long to load, and has nothing to say where all is decided.
        from orthoglide_cal.planning.next_measurement import best_next

        following = best_next(diagnosis)
    verdict, alone = diagnosis.verdict, widened(given, solution, diagnosis.adds_to(solution))
    # What may be there unseen may leave less known than the readings alone do.
    decision = release(alone, diagnosis, following, corrects)
    kept = given.conditions.questioned if given.is_session else ()
    if kept and verdict is not Verdict.CONSISTENT:
        retake = Remedy.of("retake", "measure", RETAKE, kept=kept)
        decision = decision.changed(remedies=(retake, *decision.remedies))
    judged = as_judged(given, solution, alone, diagnosis)
    chosen, named = alone if method else judged, verdict is Verdict.NAMED
    # What is entered acts on the machine as well as it is known, whatever method was asked for.
    real, shown_alone = judged if named else chosen, chosen is alone
    budget, offsets_only = chosen.budget, parameters_of(alone)
    parameters = offsets_only if shown_alone else parameters_of(chosen)
    decimals = machine.entered_decimals(budget.expanded_mm.tolist())
    # They may hold a release; without one only a page shows them.
    asked = given.others if decision.usable or details else ()
    others = tuple(answer_to(other, method, details=details) for other in asked)
    if decision.usable:
        decision = _with_others(decision, parameters, others)
    change = np.array([parameter.change(decimals) for parameter in parameters])
    promised = partial(
        promise, measured, real, right=diagnosis.put_right, unsure_mm=diagnosis.unsure_mm
    )
    rows = promised(change)
    if decision.usable and diagnosis.stays_entered and _within_u(model, chosen):
        decision = decision.changed(needed=False)
        rows = promised(0.0 * change)
    if decision.usable:
        parameters = tuple(
            one.changed(enter=one.new(decimals) if decision.needed else one.active)
            for one in parameters
        )
        left = remainder(rows, real.model)
        cautions = *([left] if left else []), *decision.cautions, *conditions.cautions
        decision = decision.changed(cautions=cautions)
    # Of the fit whose parameters are shown; undecided, of the offsets alone with these values.
    if explaining := () if shown_alone else diagnosis.causes if named else diagnosis.acting:
        left_mm = explaining[0].rms_after_mm
    else:
        left_mm = replace(solution, offsets_mm=chosen.offsets_mm).rms_after_mm
    was, will_be = np.array([(row.measured_mm, row.expected_mm) for row in rows]).reshape(-1, 2).T
    lack, shown = diagnosis.lack_of_fit, details or not shown_alone
    workspace, std = None, budget.std_mm
    if details:
        with suppress(PostureError, UsageError):  # it has none, or cannot reach all of it
            spread = budget.covariance_mm2, budget.k
            workspace = workspace_error(real.model, chosen.offsets_mm, *spread)
    without = schema.Alone(parameters=offsets_only, rms_after_mm=solution.rms_after_mm)
    correlation = budget.covariance_mm2 / np.outer(std, std)
    np.fill_diagonal(correlation, 1.0)
    return schema.Answer(
        **known,
        **{name: getattr(diagnosis, name) for name in _DIAGNOSED},
        method=solution.method,
        judgement=lack.judgement,
        release=decision,
        parameters=parameters,
        decimals=decimals,
        k=budget.k,
        dof=None if budget.dof >= NORMAL_DOF else round(budget.dof),
        correlation=tuple(map(tuple, correlation.tolist())),
        sigma_rho_mm=rms(std) if set(machine.parameter_units) == {"mm"} else None,
        alone=None if shown_alone or not named else without,
        rms=schema.Residue(before_mm=solution.rms_before_mm, after_mm=left_mm),
        noise=lack.noise.changed(used_mm=chosen.noise.sigma_mm, dof=solution.dof),
        deviations=rows,
        deviations_rms=schema.Residue(before_mm=rms(was), after_mm=rms(will_be)) if rows else None,
        budget=budget.contributions,
        converged=solution.converged,
        residuals=tuple(_residuals(measured, solution, diagnosis) if shown else ()),
        undetermined=tuple(_undetermined(model, parameters)),
        check=_check(given, chosen, rows, budget.k) if rows and decision.needed else None,
        ruled_out=model.ruled_out,
        workspace=workspace,
        holdout=holdout,
        notes=(*decision.cautions, *diagnosis.notes),
        others=others,
        # The parameters alone are those of the solution.
        explanations=tuple(
            one.changed(rms_mm=solution.rms_after_mm, parameters=offsets_only) if one.sound else one
            for one in diagnosis.explanations
        ),
        assumed=tuple(assumed.id for assumed in diagnosis.assumed_sizes),
        next_measurement=following,
        inputs=tuple(map(InputFile.of, dates)),
        dates=tuple(_of_dates(diagnosis, dates)),
    )


def _of_dates(diagnosis: Diagnosis, inputs: Iterable[Input]) -> Iterator[schema.OfDate]:
    """The parameters of each date under what lasts."""
    lasting = _lasting(diagnosis)
    for dated in inputs:
        machines = diagnosis.model.machine, dated.model.machine
        model = dated.model.extended(effect.transferred(*machines) for effect in lasting)
        parameters = parameters_of(widened(dated, solve(dated.measured, model)))
        yield schema.OfDate(path=dated.measured.source.path, parameters=parameters)


def validity(given: Input) -> Validity:
    """Conditions of one input."""
    conditions, machine = given.conditions, given.model.machine
    measured = conditions.finished or conditions.started
    owned = {gauge.id: gauge for gauge in reversed(machine.gauges)}
    gauges = []
    for gauge in conditions.gauges:
        known = dict(owned.get(gauge.id, OwnGauge(id=gauge.id)))
        if gauge.certificate and known["certificate"] not in (None, gauge.certificate):
            known = dict(OwnGauge(id=gauge.id))  # that is of another time
        known |= {name: value for name, value in gauge if value}
        due = known["due"] = known["due"] or machine.report.gauge_due
        used, last = (day and datetime.fromisoformat(day).date() for day in (measured, due))
        gauges.append(UsedGauge(**known, overdue=bool(used and last and used > last)))
    start, end = conditions.temperature_ends_c
    return Validity(
        measured=measured,
        operator=conditions.operator,
        gauges=tuple(gauges),
        temperature_start_c=start,
        temperature_end_c=end,
        reservations=tuple(_reservations(given, gauges)),
    )


def _reservations(given: Input, gauges: Sequence[UsedGauge]) -> Iterator[Reason]:
    conditions = given.conditions
    for gauge in gauges:
        if gauge.overdue:
            yield Reason.of("overdue_gauge", id=gauge.id, due=gauge.due)
    for remark in given.measured.remarks:
        if remark.code in CAUTIONS:
            yield remark
        elif remark.code == "nozzle_lowered":
            yield Reason.of("nozzle_lower", **remark.data)
    known = conditions.temperatures_c
    if known and max(known) - min(known) > STEP_K:
        yield Reason.of("temperature_changed", kelvin=max(known) - min(known))
    stated = {
        "date": conditions.finished or conditions.started,
        "operator": conditions.operator,
        "temperature": conditions.temperature_ends_c[0] is not None,
        "gauges": gauges,
    }
    missing = [name for name in given.model.machine.noted if not stated[name]]
    for gauge in gauges:
        papers = {"certificate": gauge.certificate, "due date": gauge.due}
        missing += [f"{name} of gauge {gauge.id}" for name, known in papers.items() if not known]
    if missing and not given.measured.source.simulated:
        yield Reason.of("not_recorded", missing=missing)


def widened(given: Input, known: Solution, more: Iterable[Contribution] = ()) -> Solution:
    """The parameters as unsure as `more` and the temperature leave them."""
    warm = warmth(given.conditions.mean_temperature_c, given.model.machine.leg_mm)
    return replace(known, budget=known.budget.extended([*more, *warm]))


def as_judged(given: Input, solution: Solution, alone: Solution, diagnosis: Diagnosis) -> Solution:
    """The parameters under the verdict; those `alone`, widened, where readings leave any open."""
    known = all(given.model.machine.determined(alone.budget.expanded_mm))
    if diagnosis.verdict is Verdict.CONSISTENT or not known:
        return alone
    model = given.model
    if diagnosis.verdict is Verdict.NAMED:
        model = model.extended(effect for effect in _lasting(diagnosis) if effect.cause.in_machine)
    held = set(model.machine.fixed_parameters) - {cause.id for cause in diagnosis.causes}
    taken = [source for source in solution.budget.contributions if source.source in held]
    noise = Scatter(diagnosis.left_open[0][1].sigma, np.inf)
    offsets, budget = diagnosis.offsets_mm, diagnosis.budget
    judged = replace(solution, model=model, offsets_mm=offsets, budget=budget, noise=noise)
    return widened(given, judged, taken)


def _lasting(diagnosis: Diagnosis) -> list[Effect]:
    """The lasting causes of a diagnosis, as if accepted now."""
    day, sha256 = datetime.now(UTC).date().isoformat(), diagnosis.measured.source.sha256
    return [effect.accepted(day, sha256) for effect in diagnosis.effects if effect.cause.lasting]


def _within_u(model: Model, estimate: Solution) -> bool:
    """True if nothing that is entered differs from what the controller has by more than its U."""
    entered_too = (effect for effect in model.remaining() if effect.cause.compensable)
    return not any(np.any(np.abs(e.theta) > NORMAL_K * e.std) for e in entered_too) and bool(
        np.all(np.abs(estimate.offsets_mm) <= estimate.budget.expanded_mm)
    )


def _with_others(
    decision: Release, parameters: Sequence[Parameter], others: Iterable[schema.Answer]
) -> Release:
    """The release, held where other data of the same file and settings contradict it beyond U."""
    reasons, cautions = [], []
    for other in others:
        apart = [
            (one.name, its.found - one.found, one.unit)
            for one, its in zip(parameters, other.parameters, strict=False)
            if one.found is not None and its.found is not None
            if abs(one.found - its.found) > math.hypot(one.expanded, its.expanded)
        ]
        data = other.input.data
        stale = any(reservation.code == "stale_mesh" for reservation in other.validity.reservations)
        if apart and not stale:
            reasons.append(Reason.of("other_data_contradict", data=data, apart=apart))
        elif apart or not other.release.usable:
            refused = other.verdict in (None, Verdict.CONSISTENT)
            ids = tuple(cause.id for cause in other.causes)
            judged = Reason.of("alone_refused" if refused else f"alone_{other.verdict}", ids=ids)
            cautions.append(Reason.of("other_data", data=data, judged=judged))
    if reasons:
        return Release(reasons=tuple(reasons), remedies=(Remedy.of("probe_both"),) * len(reasons))
    return decision.changed(cautions=(*decision.cautions, *cautions))


def remainder(promised: Sequence[PromisedDifference], model: Model) -> Reason | None:
    """Deviations that offsets do not remove; None where U allows for all that is left."""
    left, u = np.array([(row.expected_mm, row.expanded_mm) for row in promised]).reshape(-1, 2).T
    if (left**2).sum() <= (u**2).sum():
        return None
    ids = [effect.cause.id for effect in model.remaining()]
    return Reason.of("remains", ids=ids, left_mm=rms(left))


def parameters_of(known: Solution) -> tuple[Parameter, ...]:
    """Every parameter with its U."""
    budget = known.budget
    return Parameter.all_of(known.model, known.offsets_mm, budget.std_mm, budget.k)


def _residuals(
    measured: Measured, solution: Solution, diagnosis: Diagnosis
) -> Iterator[schema.Residual]:
    """Every reading, in the order of the file."""
    patterns, wrong, explained = diagnosis.acting, diagnosis.wrong_readings, None
    if diagnosis.causes or patterns:
        explained = diagnosis.explained_mm.tolist()
    modelled, in_time = solution.predicted_mm.tolist(), np.arange(len(measured))
    moved = np.full(len(measured), np.nan)
    if not isinstance(measured, Differences):
        in_time, (rows, first) = measured.plan.in_time, measured.plan.sequence
        moved[rows] = np.where(first, np.nan, np.diff(measured.value[rows], prepend=0.0))
    order = np.argsort(in_time, kind="stable") + 1
    for k, value in enumerate(measured.value.tolist()):
        if isinstance(measured, Differences):
            which = measured.which[k]
            leg, direction = (AXES[axis] for axis in which.series)
            place: dict[str, object] = {"leg": leg, "direction": direction, "posture": which.name}
        else:
            place = {
                "cycle": int(measured.cycle[k]),
                "posture": measured.posture[k] or None,
                **measured.plan.entry(k),
                "moved_mm": _number(moved[k]),
                "temperature_c": _number(measured.temperature[k]),
                "minutes": 60.0 * measured.plan.hours[k],
                "pattern_mm": [one.effect_mm[k] for one in patterns],
                "pattern_expanded_mm": [one.effect_expanded_mm[k] for one in patterns],
                "wrong": k in wrong,
            }
        both = explained[k] if explained else None
        left = {"measured_mm": value, "modelled_mm": modelled[k], "with_causes_mm": both}
        yield schema.Residual.model_validate({**place, "order": int(order[k]), **left})


def _number(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _undetermined(model: Model, parameters: Iterable[Parameter]) -> Iterator[schema.Undetermined]:
    """Parameters, and what no such reading determines: taken as the controller has it."""
    unsure = [(one.name, one.expanded, one.unit) for one in parameters if not one.determined]
    known = {effect.cause.id for effect in model.accepted}
    fixed = (CAUSES[id] for id in model.machine.fixed_parameters if id not in known)
    unsure += [(cause.id, cause.size(model.machine), cause.unit) for cause in fixed]
    for name, within, unit in unsure:
        yield schema.Undetermined(name=name, within=within, unit=unit)


def _check(
    given: Input, known: Solution, promised: Sequence[PromisedDifference], k: float
) -> schema.CheckReading:
    """The difference that the offsets change most."""
    row = max(promised, key=lambda row: abs(row.measured_mm - row.expected_mm))
    machine = given.model.machine
    series, posture = next(e for e in chain(*DIFFERENCES.values()) if e.name == row.name)
    tools = np.zeros((2, len(AXES)))
    for tool, end in zip(tools, (posture or Posture.MIN, posture or Posture.MAX), strict=True):
        tool[series.leg] = machine.displacement_mm(end)
    sigma = max(known.noise.sigma_mm, machine.instrument.noise_mm)
    return schema.CheckReading(
        what=row.name,
        leg=AXES[series.leg],
        direction=AXES[series.direction],
        first_mm=tuple(tools[0].tolist()),
        second_mm=tuple(tools[1].tolist()),
        ends=posture is not None,
        gauge_mm=None if posture else 0.5 * machine.leg_mm,
        before_mm=row.measured_mm,
        expected_mm=row.expected_mm,
        # The promise is of as many readings as were taken before; the check is of two.
        expanded_mm=math.hypot(row.expanded_mm, k * math.sqrt(2.0) * sigma),
    )


# --- may the parameters be entered? one rule for every command that says so -------------------


def release(
    solution: Solution,
    diagnosis: Diagnosis,
    following: NextMeasurement | None = None,
    corrects: Collection[str] = (),
) -> Release:
    """Decide whether the solution's offsets may be entered, from its own check and the diagnosis.

    A named cause prevents it only if it moves them by more than their uncertainty, and the
    controller is not to correct it (`corrects`). `following` would distinguish what is left open.
    """
    failures, judged = tuple(_failures(solution)), Release()
    if diagnosis.verdict is Verdict.NAMED:
        judged = _named(solution, diagnosis, following, corrects)
    elif diagnosis.verdict is Verdict.AMBIGUOUS:
        judged = _ambiguous(diagnosis, following)
    elif diagnosis.verdict is Verdict.UNEXPLAINED and not failures:
        judged = _unexplained(diagnosis)  # else what the check found is the explanation
    if failures:
        reasons, remedies = zip(*failures, strict=True)
        if judged.reasons:
            reasons, remedies = (*reasons, *judged.reasons), (*remedies, *judged.remedies)
        return Release(reasons=reasons, remedies=remedies, sound=False)
    remedies, baselines = judged.remedies, diagnosis.baselines
    if baselines and baselines.better and diagnosis.causes:
        # What needs no cause predicts better.
        code, mm = "keep_mesh", baselines.earlier_map_mm
        if baselines.better == "quartic":
            code, mm = "make_mesh", baselines.quartic_mm
        remedies = (Remedy.of(code, mm=mm, extension_mm=baselines.extension_mm), *remedies)
    factor, lack = diagnosis.left_open[0][1].scale_factor, diagnosis.lack_of_fit
    fit = lack.judgement
    doubtful = not solution.dof or (
        diagnosis.verdict is Verdict.CONSISTENT and fit.code == "residuals_too_large"
    )
    # As stated, not as widened to cover what is left; "1.0 times" says nothing.
    if round(factor, 1) > 1.0 and diagnosis.chance(diagnosis.alone_with(1.0)) < lack.suspicious:
        fit, doubtful = Reason.of("local_shape", factor=factor), True
    more = [fit] if doubtful and judged.usable else []
    return judged.changed(cautions=(*judged.cautions, *more), remedies=remedies)


def _failures(solution: Solution) -> Iterator[tuple[Reason, Remedy]]:
    """Objections of the solution's own check, each with what to do."""
    machine = solution.model.machine
    if not solution.converged:
        yield Reason.of("not_converged"), Remedy.of("validate", "validate")
        return
    sizes, offsets = parameters_of(solution), solution.offsets_mm.tolist()
    rows = zip(sizes, offsets, machine.plausible, strict=True)
    if beyond := [row for row in rows if abs(row[1]) > row[2]]:
        values = [(size.name, offset, size.unit) for size, offset, _ in beyond]
        limits = [(most, size.unit) for size, _, most in beyond]
        yield Reason.of("implausible", values=values, limits=limits), Remedy.of("recheck")
    if names := [size.name for size in sizes if not size.determined]:
        yield Reason.of("undetermined", names=names), Remedy.of("more_readings")
    for doubt in machine.instrument.doubts(solution.measured):
        yield Reason.of("gauge_doubt", doubt=doubt), Remedy.of("check_gauge", doubt=doubt)


def _unexplained(diagnosis: Diagnosis) -> Release:
    patterns = diagnosis.acting
    remedies = tuple(Remedy.of("beyond_remedy", "measure", THEN, pattern=one) for one in patterns)
    if diagnosis.enterable:
        return Release(cautions=(Reason.of("beyond_list", patterns=patterns),), remedies=remedies)
    lack = diagnosis.lack_of_fit
    sizes = {"left_mm": lack.left_mm, "expected_mm": lack.expected_mm}
    code = "more_remains" if lack.left_mm > lack.expected_mm else "order_remains"
    reason = diagnosis.refuted or Reason.of("unexplained", remains=Reason.of(code, **sizes))
    return Release(reasons=(reason,), remedies=remedies or (Remedy.of("again"),))


def _ambiguous(diagnosis: Diagnosis, following: NextMeasurement | None) -> Release:
    """Release it only if nothing open moves it; what is wrong in any case comes first."""
    ids = [cause.id for cause in diagnosis.causes]
    sound = any(e.sound and e.probability >= WORTH_SAYING for e in diagnosis.explanations)
    answers = tuple(fit.hypothesis.ids for _, fit in diagnosis.left_open)
    reasons = [Reason.of("undecided", answers=answers, sound=sound)]
    sure = set() if sound else set(ids).intersection(*answers)
    if any(state.pattern for state in diagnosis.explanations):
        # Instead of what happened at one place something beyond the list may have.
        sure -= {cause.id for cause in diagnosis.causes if cause.where}
    passing = [cause for cause in diagnosis.causes if not cause.in_machine]
    remedies = [Remedy(sentence=cause.remedy) for cause in passing if cause.id in sure]
    spare = diagnosis.lack_of_fit.dof - sum(e.cause.freedom for e in diagnosis.effects)
    if diagnosis.measured.kind is DataKind.READINGS and spare <= 0:
        reasons.append(Reason.of("few_readings"))
        remedies.append(Remedy.of("more_readings"))
    else:
        remedies.append(_decisive(diagnosis, following))
    unsure = (cause for cause in passing if cause.where and cause.id not in sure)
    remedies += (Remedy.of("or", first=cause.remedy) for cause in unsure)
    baselines, shape = diagnosis.baselines, diagnosis.model.machine.shape
    best = baselines and not baselines.better and baselines.extension_mm < baselines.parameters_mm
    if best and shape in (*ids, *diagnosis.ambiguous_with):
        # What lasts may be carried, whatever its cause.
        remedies.append(Remedy.of("accept_shape", "diagnose", f"--accept {shape}"))
    if len(reasons) == 1 and diagnosis.enterable:
        caution = Reason.of("undecided_within_u", answers=answers, sound=sound)
        return Release(cautions=(caution,), remedies=tuple(remedies))
    return Release(reasons=tuple(reasons), remedies=tuple(remedies))


def _decisive(diagnosis: Diagnosis, following: NextMeasurement | None) -> Remedy:
    """The measurement that would decide what is open, or that none would."""
    if following is not None and following.between:
        session = THEN if following.session is None else following.session
        return Remedy.of("decides", "measure", session, best=following)
    if not diagnosis.ambiguous_with:
        return Remedy.of("repeat_once")
    ids = (*[cause.id for cause in diagnosis.causes if cause.aliases], *diagnosis.ambiguous_with)
    in_machine = any(CAUSES[id].in_machine for id in ids)
    return Remedy.of("none_decides") if in_machine else Remedy.of("leave_out", ids=ids)


def _named(
    solution: Solution,
    diagnosis: Diagnosis,
    following: NextMeasurement | None,
    corrects: Collection[str],
) -> Release:
    """Released if the causes move the offsets within U, or the controller corrects them, too."""
    ids, machine = [cause.id for cause in diagnosis.causes], solution.model.machine
    shift = np.abs(solution.offsets_mm - diagnosis.offsets_mm)
    largest = int(np.argmax(shift))
    size = {"change": float(shift[largest]), "unit": machine.parameter_units[largest]}
    remedies = list[Remedy]()
    if faults := [fault for fault in diagnosis.unshown if fault.matters]:
        # Faults that these readings would not show are looked at first.
        reasons = [Reason.of("cause_found", ids=ids, **size)]
        for fault in faults:
            place = {"id": fault.id, "where": fault.where}
            moved = {"change": fault.change, "unit": fault.unit}
            reasons.append(Reason.of("unshown_fault", **place, **moved))
            remedies.append(Remedy.of("look", "diagnose", f"--rule-out {fault.id}", **place))
        if following is not None:
            decides = _decisive(diagnosis, following)
            remedies.append(decides.changed(sentence=Reason.of("or", first=decides.sentence)))
        return Release(reasons=tuple(reasons), remedies=tuple(remedies))
    # A slip in the record is looked for sooner than a machine is taken apart.
    for finding in sorted(
        diagnosis.causes, key=lambda one: (CAUSES[one.id].stage is not Stage.RECORD, one.in_machine)
    ):
        id, cause = finding.id, CAUSES[finding.id]
        accept = Remedy.of("accept", "diagnose", f"--accept {id}", id=id)
        remedies.append(accept if finding.recommended else Remedy(sentence=finding.remedy))
        if cause.by_joint and machine.adds_to_joints:
            remedies.append(Remedy.of("controller_corrects", "apply", "--to FILE.ini", id=id))
        elif cause.with_travel or id in machine.fixed_parameters:
            remedies.append(Remedy.of("klipper_corrects", "apply", "--to printer.cfg", id=id))
        beyond = any(abs(size.value) > size.expanded for size in finding.parameters)
        if cause.adjustable and beyond:
            remedies.append(Remedy.of("adjust", "adjust", f"--cause {id}"))
    u = NORMAL_K * diagnosis.std_mm
    if np.all(shift <= u) and all(machine.determined(u)):
        caution = Reason.of("within_u", ids=ids, **size)
    elif all(id in corrects for id in ids):
        caution = Reason.of("corrected", ids=ids, **size)
    else:
        alike = diagnosis.causes[0].alike
        reason = Reason.of("offsets_wrong", causes=diagnosis.causes, alike=alike, **size)
        return Release(reasons=(reason,), remedies=tuple(remedies))
    return Release(cautions=(caution,), remedies=tuple(remedies))
