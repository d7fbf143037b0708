"""From one input to its answer: solved, diagnosed, judged once, whoever asks.

The parameters are those under the verdict:

    consistent     the calibrated parameters alone, widened by what may hide
    named          with the causes that were found
    ambiguous      their mean over the open explanations, widened by that choice
    unexplained    alone, widened by the unexplained part

and with a method that was asked for always the parameters alone, as the paper has them. Whether
they may be entered, and if not what to do, is decided here, too.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import PostureError, UnusableResultError, UsageError
from orthoglide_cal.estimation import (
    OffsetEstimate,
    PromisedDifference,
    Solution,
    fit_parameters,
    promise,
    solve,
    stays,
)
from orthoglide_cal.estimation.accuracy import Scatter, chance_of_residual, rms
from orthoglide_cal.estimation.budget import Budget, Contribution, budget_lines, warmth
from orthoglide_cal.estimation.losses import FALSE_RELEASE, NEEDLESS_HOLD, is_likely
from orthoglide_cal.estimation.solution import judgement_of, require_settings
from orthoglide_cal.files.input import Input
from orthoglide_cal.inference import (
    Diagnosis,
    FoundCause,
    NextMeasurement,
    Parameter,
    Verdict,
    diagnose,
    nothing_wrong,
)
from orthoglide_cal.model.cause import CONFIDENCE, NORMAL_K, Effect
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.model.workspace import workspace_error
from orthoglide_cal.results import answer as schema
from orthoglide_cal.results.answer import Release, Remedy
from orthoglide_cal.results.validity import validity
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import entered_decimals

# Beyond this Student's t is the normal distribution to two decimals.
NORMAL_DOF = 500.0
# What the answer takes from a diagnosis as it is.
_DIAGNOSED = (
    *("verdict", "lack_of_fit", "causes", "baselines", "ambiguous_with", "not_excluded"),
    *("refuted", "rivals", "patterns", "unshown", "beyond_tolerance", "assumed_sizes"),
)


def answer_to(
    given: Input,
    method: str | None = None,
    *,
    diagnosed: Diagnosis | None = None,
    holdout: str | None = None,
    details: bool = False,
    corrects: Collection[str] = (),
) -> schema.Answer:
    """Solve, diagnose and judge one input.

    Args:
        method: name of an estimator; then the answer holds the parameters alone.
        diagnosed: a diagnosis of it that was made already; it is made here if None.
        holdout: file of the readings that the diagnosis predicted; None for those left out.
        details: also what only details, JSON and pages show: how the answer depends on plausible
            sizes, the tool's error over the workspace, and the residuals if nothing is wrong.
        corrects: ids that the controller is to correct, too: those hold no release.

    Raises:
        UsageError, InputError: as `solve`. A result that must not be used raises nothing: the
            answer says so.
    """
    measured, model = given.measured, given.model
    file, conditions = schema.InputFile.of(given), validity(given)
    machine = model.machine
    name = schema.MachineName(name=machine.name, kind=machine.kind)
    try:
        require_settings(measured)
        diagnosis = diagnosed or diagnose(measured, model, sensitivity=details)
        solution = fit_parameters(measured, model, method) if method else diagnosis.alone
        solution.require_possible()
    except UnusableResultError as error:
        remedy = (Remedy(sentence=Reason.of("do", what=error.remedy)),) if error.remedy else ()
        excerpt = measured.source.excerpt
        unknown = excerpt is not None and excerpt.unknown
        reason = Reason.of("settings_unknown" if unknown else "refused", what=error.what)
        refused = Release(reasons=(reason,), remedies=remedy, sound=False)
        return schema.Answer(input=file, machine=name, release=refused, validity=conditions)
    following = None
    if diagnosis.undecided:
        # Planning takes long to load, and has nothing to say where all is decided.
        from orthoglide_cal.planning import best_next

        following = best_next(diagnosis)
    decision = release(solution, diagnosis, following, corrects)
    kept = given.conditions.questioned if given.is_session else ()
    if kept and diagnosis.verdict is not Verdict.CONSISTENT:
        again = Reason.of("retake", kept=kept)
        retake = Remedy(sentence=again, verb="measure", options="--resume")
        decision = decision.changed(remedies=(retake, *decision.remedies))
    alone, diagnosed_as = widened(given, solution, diagnosis), None
    if diagnosis.verdict is not Verdict.CONSISTENT:
        diagnosed_as = _as_diagnosed(given, solution, diagnosis)
    named = diagnosis.verdict is Verdict.NAMED
    shown_as = None if method else diagnosed_as
    chosen = shown_as or alone
    # What is entered acts on the machine as well as it is known, whatever method was asked for.
    real = (diagnosed_as if named else None) or chosen
    budget, std = chosen.budget, chosen.budget.std_mm
    decimals = machine.decimals or entered_decimals(budget.expanded_mm.tolist(), machine.active)
    offsets_only = parameters_of(alone)
    parameters = parameters_of(shown_as) if shown_as else offsets_only
    # They may hold a release; without one only a page shows them.
    asked = given.others if decision.usable or details else ()
    others = tuple(answer_to(other, method, details=details) for other in asked)
    if decision.usable:
        decision = _with_others(decision, parameters, others)
    right = diagnosis.put_right
    change = np.array([parameter.change(decimals) for parameter in parameters])
    rows = promise(measured, real, change, right)
    shown_budget = shown_as.budget if shown_as else solution.budget
    if decision.usable and _within_noise(model, chosen, shown_budget):
        # What would change then; the differences become no smaller where U allows for all of it.
        gain = sum((row.measured_mm - row.expected_mm) ** 2 for row in rows)
        if gain <= sum(row.expanded_mm**2 for row in rows):
            decision = decision.changed(needed=False)
            rows = promise(measured, real, 0.0 * change, right)
    if decision.usable:
        parameters = tuple(
            parameter.changed(
                enter=parameter.new(decimals) if decision.needed else parameter.active
            )
            for parameter in parameters
        )
        left = remainder(rows, real.model)
        cautions = *([left] if left else []), *decision.cautions, *conditions.cautions
        decision = decision.changed(cautions=cautions)
    # Of the fit whose parameters are shown; undecided, of the offsets alone with these values.
    left_mm = solution.at(chosen.offsets_mm).rms_after_mm if shown_as else solution.rms_after_mm
    if shown_as:
        if named and diagnosis.causes:
            left_mm = diagnosis.causes[0].rms_after_mm
        elif any(pattern.accepted for pattern in diagnosis.patterns):
            left_mm = rms(measured.weight * (measured.value - diagnosis.explained_mm))
    judged = _left_over(solution, diagnosis)
    shift = np.abs(alone.offsets_mm - chosen.offsets_mm)
    lines, total = budget_lines(budget)
    workspace, covariance = None, budget.covariance_mm2
    if details:
        with suppress(PostureError, UsageError):  # it has none, or cannot reach all of it
            workspace = workspace_error(real.model, chosen.offsets_mm, covariance, budget.k)
    correlation = covariance / np.outer(std, std)
    np.fill_diagonal(correlation, 1.0)
    return schema.Answer(
        **{name: getattr(diagnosis, name) for name in _DIAGNOSED},
        input=file,
        machine=name,
        method=solution.method,
        judgement=judgement_of(*judged),
        release=decision,
        validity=conditions,
        parameters=parameters,
        decimals=decimals,
        k=budget.k,
        dof=None if budget.dof >= NORMAL_DOF else round(budget.dof),
        correlation=tuple(map(tuple, correlation.tolist())),
        sigma_rho_mm=rms(std) if set(machine.parameter_units) == {"mm"} else None,
        alone=schema.Alone(
            parameters=offsets_only,
            rms_after_mm=solution.rms_after_mm,
            wrong_by=float(shift.max()),
            unit=machine.parameter_units[int(np.argmax(shift))],
        )
        if named and shown_as is not None
        else None,
        rms=schema.Residue(before_mm=solution.rms_before_mm, after_mm=left_mm),
        noise=schema.Noise(
            used_mm=chosen.noise.sigma_mm,
            repeats_mm=solution.repeats.sigma_mm if solution.repeats else None,
            residuals_mm=judged[1],
            stated_mm=model.machine.instrument.noise_mm,
            floor_mm=model.machine.instrument.rounding_mm,
            dof=solution.dof,
            p_value=judged[0],
        ),
        deviations=rows,
        as_found=spread({row.name: row.measured_mm for row in rows}) if rows else None,
        expected=spread({row.name: row.expected_mm for row in rows}) if rows else None,
        budget=lines,
        total=total,
        remains=stays(rows),
        converged=solution.converged,
        residuals=tuple(_residuals(measured, solution, diagnosis)) if details or shown_as else (),
        undetermined=tuple(_undetermined(model, parameters)),
        check=_check(given, solution, rows, budget.k) if decision.needed else None,
        ruled_out=model.ruled_out,
        workspace=workspace,
        holdout=holdout,
        warnings=solution.warnings,
        notes=(*decision.cautions, *diagnosis.notes),
        others=others,
        # The parameters alone are those of the solution.
        explanations=tuple(
            one.changed(rms_mm=solution.rms_after_mm, parameters=offsets_only) if one.sound else one
            for one in diagnosis.explanations
        ),
        shims=tuple(_shims(diagnosis.causes)) if named else (),
        assumed=tuple(assumed.id for assumed in diagnosis.assumed_sizes),
        next_measurement=following,
        sensitivity=dict(diagnosis.sensitivity) or None,
    )


def with_dates(
    answer: schema.Answer, diagnosis: Diagnosis, inputs: Sequence[Input]
) -> schema.Answer:
    """An answer to several dates as one measurement, with the parameters of each under what lasts.

    `inputs` are the dates, oldest first.
    """
    lasting, dates = _lasting(diagnosis), []
    for dated in inputs:
        machines = diagnosis.model.machine, dated.model.machine
        model = dated.model.extended(effect.transferred(*machines) for effect in lasting)
        alone = widened(dated, solve(dated.measured, model), None)
        path = dated.measured.source.path
        dates.append(schema.OfDate(path=path, parameters=parameters_of(alone)))
    return answer.changed(inputs=tuple(map(schema.InputFile.of, inputs)), dates=tuple(dates))


def widened(given: Input, solution: Solution, diagnosis: Diagnosis | None) -> Solution:
    """The solution as unsure as the diagnosis and the temperature leave it."""
    more = diagnosis.adds_to(solution) if diagnosis else ()
    return replace(solution, budget=solution.budget.extended([*more, *_warmth(given)]))


def _as_diagnosed(given: Input, solution: Solution, diagnosis: Diagnosis) -> OffsetEstimate:
    """The parameters under what the diagnosis found."""
    model = with_causes(given.model, diagnosis)
    held = set(model.machine.fixed_parameters) - {cause.id for cause in diagnosis.causes}
    taken = [source for source in solution.budget.contributions if source.source in held]
    budget = diagnosis.budget.extended([*taken, *_warmth(given)])
    noise = Scatter(diagnosis.left_open[0][1].sigma, np.inf)
    return OffsetEstimate(model, diagnosis.offsets_mm, budget, noise)


def _warmth(given: Input) -> tuple[Contribution, ...]:
    return warmth(given.conditions.mean_temperature_c, given.model.machine.leg_mm)


def with_causes(model: Model, diagnosis: Diagnosis) -> Model:
    """The machine with the lasting causes that a diagnosis names in it."""
    if diagnosis.verdict is not Verdict.NAMED:
        return model
    return model.extended(effect for effect in _lasting(diagnosis) if effect.cause.in_machine)


def _lasting(diagnosis: Diagnosis) -> list[Effect]:
    """The lasting causes of a diagnosis, as if accepted now."""
    day, sha256 = datetime.now(UTC).date().isoformat(), diagnosis.measured.source.sha256
    return [effect.accepted(day, sha256) for effect in diagnosis.effects if effect.cause.lasting]


def _within_noise(model: Model, estimate: OffsetEstimate, known: Budget) -> bool:
    """True if the controller has the parameters already, as well as the readings know them.

    No change exceeds its U, nor all together what noise and a local shape make of them (χ²): what
    else may be wrong, and what is taken as the controller has it, would be the same again.
    """
    for effect in model.remaining():
        # It is to be entered, too.
        if effect.cause.compensable and np.any(np.abs(effect.theta) > NORMAL_K * effect.std):
            return False
    if np.any(np.abs(estimate.offsets_mm) > estimate.budget.expanded_mm):
        return False
    budget, change = known.without(model.machine.fixed_parameters), estimate.offsets_mm
    apart = float(change @ np.linalg.solve(budget.covariance_mm2, change))
    widened = budget.k / NORMAL_K
    return chance_of_residual(apart, len(change), widened) >= 1.0 - CONFIDENCE


def _with_others(
    decision: Release, parameters: Sequence[Parameter], others: Iterable[schema.Answer]
) -> Release:
    """The release of parameters, knowing what the other data of the same file say.

    They hold the release only where their parameters contradict these beyond U, and belong to the
    same settings.
    """
    reasons, cautions, remedies = [], [], []
    for other in others:
        pairs = zip(parameters, other.parameters, strict=False)
        apart = [
            (one.name, abs(one.found - its.found), one.unit)
            for one, its in pairs
            if one.found is not None and its.found is not None
            if abs(one.found - its.found) > math.hypot(one.expanded, its.expanded)
        ]
        data = other.input.data
        stale = any(reservation.code == "stale_mesh" for reservation in other.validity.reservations)
        if apart and not stale:
            reasons.append(Reason.of("other_data_contradict", data=data, apart=apart))
            remedies.append(Remedy(sentence=Reason.of("probe_both")))
        elif apart or not other.release.usable:
            ids = tuple(cause.id for cause in other.causes)
            cautions.append(Reason.of("other_data", data=data, verdict=other.verdict, ids=ids))
    if reasons:
        return Release(reasons=tuple(reasons), remedies=tuple(remedies))
    return decision.changed(cautions=(*decision.cautions, *cautions))


def remainder(promised: Sequence[PromisedDifference], model: Model) -> Reason | None:
    """Deviations that offsets do not remove; None where nothing but noise is left."""
    if not stays(promised):
        return None
    left = rms(np.array([row.expected_mm for row in promised]))
    ids = [effect.cause.id for effect in model.remaining()]
    return Reason.of("remains", ids=ids, left_mm=left)


def parameters_of(known: OffsetEstimate) -> tuple[Parameter, ...]:
    """Every parameter with its U."""
    budget = known.budget
    return Parameter.all_of(known.model, known.offsets_mm, budget.std_mm, budget.k)


def spread(values: Mapping[str, float]) -> schema.Spread:
    """Size of named deviations, one at least, all together."""
    largest = max(values, key=lambda name: abs(values[name]))
    size = rms(np.array([*values.values()]))
    return schema.Spread(rms_mm=size, largest_mm=values[largest], largest=largest)


def _residuals(
    measured: Measured, solution: Solution, diagnosis: Diagnosis
) -> Iterator[schema.Residual]:
    """Every reading, in the order of the file."""
    with_causes: list[float | None] = [None] * len(measured)
    patterns = [one for one in diagnosis.patterns if one.accepted]
    if diagnosis.causes or patterns:
        with_causes = [*diagnosis.explained_mm.tolist()]
    values = zip(measured.value.tolist(), solution.predicted_mm.tolist(), with_causes, strict=True)
    in_time, moved = np.arange(len(measured)), np.full(len(measured), np.nan)
    if not isinstance(measured, Differences):
        in_time, (rows, first) = measured.plan.in_time, measured.plan.sequence
        moved[rows] = np.where(first, np.nan, np.diff(measured.value[rows], prepend=0.0))
    order, weight = (np.argsort(in_time, kind="stable") + 1).tolist(), measured.weight.tolist()
    travel = [None if math.isnan(way) else way for way in moved.tolist()]
    for k, (value, modelled, explained) in enumerate(values):
        if isinstance(measured, Differences):
            which = measured.which[k]
            leg, direction = (AXES[axis] for axis in which.series)
            place: dict[str, object] = {"leg": leg, "direction": direction, "posture": which.name}
        else:
            warm = float(measured.temperature[k])
            place = {
                "cycle": int(measured.cycle[k]),
                "weight": weight[k],
                "posture": measured.posture[k] or None,
                **measured.plan.entry(k),
                "moved_mm": travel[k],
                "temperature_c": None if math.isnan(warm) else warm,
                "minutes": 60.0 * measured.plan.hours[k],
                "pattern_mm": [one.effect_mm[k] for one in patterns],
                "pattern_expanded_mm": [one.effect_expanded_mm[k] for one in patterns],
                "wrong": k in diagnosis.wrong_readings,
            }
        left = {"measured_mm": value, "modelled_mm": modelled, "with_causes_mm": explained}
        yield schema.Residual.model_validate({**place, "order": order[k], **left})


def _undetermined(model: Model, parameters: Iterable[Parameter]) -> Iterator[schema.Undetermined]:
    """Parameters, and what no reading of this kind determines: taken as the controller has it."""
    for parameter in parameters:
        if not parameter.determined:
            yield schema.Undetermined(
                name=parameter.name, within=parameter.expanded, unit=parameter.unit
            )
    known = {effect.cause.id for effect in model.accepted}
    for cause in (CAUSES[id] for id in model.machine.fixed_parameters if id not in known):
        yield schema.Undetermined(name=cause.id, within=cause.size(model.machine), unit=cause.unit)


def _check(
    given: Input, solution: Solution, promised: Sequence[PromisedDifference], k: float
) -> schema.CheckReading | None:
    """The difference that the offsets change most: it shows whether they were entered."""
    if not promised:
        return None
    row = max(promised, key=lambda row: abs(row.measured_mm - row.expected_mm))
    machine = given.model.machine
    series, posture = next(e for e in chain(*DIFFERENCES.values()) if e.name == row.name)
    ends = (posture, posture) if posture else (Posture.MIN, Posture.MAX)
    moved = [machine.displacement_mm(end) for end in ends]
    tools = [tuple(value if axis == series.leg else 0.0 for axis in range(3)) for value in moved]
    joints = [tuple(machine.joints_at(series.leg, value).tolist()) for value in moved]
    sigma = max(solution.noise.sigma_mm, machine.instrument.noise_mm)
    return schema.CheckReading(
        what=row.name,
        leg=AXES[series.leg],
        direction=AXES[series.direction],
        first_mm=tools[0],
        second_mm=tools[1],
        first_joints_mm=joints[0],
        second_joints_mm=joints[1],
        ends=posture is not None,
        gauge_mm=None if posture else 0.5 * machine.leg_mm,
        before_mm=row.measured_mm,
        expected_mm=row.expected_mm,
        # The promise is of as many readings as were taken before; the check is of two.
        expanded_mm=math.hypot(row.expanded_mm, k * math.sqrt(2.0) * sigma),
    )


def _shims(causes: Iterable[FoundCause]) -> Iterator[schema.Shim]:
    for id, gap in ((cause.id, parameter) for cause in causes for parameter in cause.parameters):
        if (screw := CAUSES[id].adjustment(gap.name)) and screw.along:
            size = {"mm": abs(gap.value), "expanded_mm": gap.expanded}
            along = f"{'-' if gap.value < 0.0 else '+'}{screw.along}"
            yield schema.Shim(rail=AXES[screw.leg], along=along, **size)


# --- may the parameters be entered? one rule for every command that says so -------------------


def release(
    solution: Solution,
    diagnosis: Diagnosis,
    following: NextMeasurement | None = None,
    corrects: Collection[str] = (),
) -> Release:
    """Decide whether the solution's offsets may be entered, from its own check and the diagnosis.

    Readings that this gauge can hardly have shown prevent it, whatever fits them. A named cause
    prevents it only if it moves the offsets by more than their uncertainty.

    Args:
        solution: of the offsets alone, with the accepted causes; it checks itself again here.
        diagnosis: of the same data.
        following: what would distinguish the explanations that it leaves open; None without.
        corrects: as of `answer_to`.
    """
    failures = tuple(_failures(solution))
    patterns = [one for one in diagnosis.patterns if one.accepted]
    if diagnosis.verdict is Verdict.CONSISTENT:
        judged = Release()
    elif diagnosis.verdict is Verdict.NAMED:
        judged = _named(solution, diagnosis, corrects)
    elif diagnosis.verdict is Verdict.AMBIGUOUS:
        judged = _ambiguous(diagnosis, following)
    elif failures:
        # What the check found is the explanation.
        judged = Release()
    elif not is_likely(diagnosis.enterable, FALSE_RELEASE, NEEDLESS_HOLD):
        judged = Release(cautions=(Reason.of("beyond_list", patterns=patterns),))
    else:
        lack, beyond = diagnosis.lack_of_fit, bool(diagnosis.beyond_tolerance)
        sizes = {"left_mm": lack.left_mm, "expected_mm": lack.expected_mm}
        reason = diagnosis.refuted or Reason.of("unexplained", beyond=beyond, **sizes)
        advice = [Reason.of("beyond_remedy", pattern=one) for one in patterns]
        advice = advice or [Reason.of("again")]
        judged = Release(reasons=(reason,), remedies=tuple(Remedy(sentence=a) for a in advice))
    if not failures:
        more = tuple(_cautions(solution, diagnosis)) if judged.usable else ()
        return judged.changed(cautions=(*judged.cautions, *more))
    return Release(
        reasons=(*(reason for reason, _ in failures), *judged.reasons),
        remedies=(*(remedy for _, remedy in failures), *judged.remedies),
        sound=False,
    )


def _cautions(solution: Solution, diagnosis: Diagnosis) -> Iterator[Reason]:
    """Cautions about offsets that are released."""
    rough = diagnosis.left_open[0][1].scale_factor
    judged = judgement_of(*_left_over(solution, diagnosis))
    suspicious = judged.code == "residuals_too_large"
    # As stated, not as widened by the diagnosis to cover what is left.
    if rough > 1.0 and solution.judgement.code == "residuals_too_large":
        yield Reason.of("local_shape", factor=rough)
    elif not solution.dof or (suspicious and diagnosis.verdict is Verdict.CONSISTENT):
        # Without spare readings nothing can contradict or support the offsets. What a named
        # cause explains does not.
        yield judged


def _left_over(
    solution: Solution, diagnosis: Diagnosis
) -> tuple[float | None, float | None, float]:
    """Return p, and scatter and stated noise [mm], of what a solution leaves.

    They are those of the diagnosis where that made the solution: one answer has one judgement.
    """
    if solution is not diagnosis.alone or not solution.dof:
        return solution.lack_of_fit_p, solution.sigma_residuals_mm, solution.stated_mm
    lack = diagnosis.lack_of_fit
    return lack.p_value, lack.residual_mm, lack.noise_mm


def _failures(solution: Solution) -> Iterator[tuple[Reason, Remedy]]:
    """Objections of the solution's own check, each with what to do."""
    machine = solution.model.machine
    if not solution.converged:
        check = Remedy(sentence=Reason.of("validate"), verb="validate")
        yield Reason.of("not_converged"), check
        return
    columns = machine.parameter_names, machine.parameter_units, solution.offsets_mm.tolist()
    parameters = zip(*columns, machine.plausible, strict=True)
    beyond = [parameter for parameter in parameters if abs(parameter[2]) > parameter[3]]
    if beyond:
        yield Reason.of("implausible", values=beyond), Remedy(sentence=Reason.of("recheck"))
    if names := [size.name for size in parameters_of(solution) if not size.determined]:
        more = Remedy(sentence=Reason.of("more_readings"))
        yield Reason.of("undetermined", names=names), more
    for doubt in machine.instrument.doubts(solution.measured):
        remedy = Remedy(sentence=Reason.of("check_gauge", doubt=doubt))
        yield Reason.of("gauge_doubt", doubt=doubt), remedy


def _ambiguous(diagnosis: Diagnosis, following: NextMeasurement | None) -> Release:
    data = {
        "ids": [cause.id for cause in diagnosis.causes],
        "rivals": diagnosis.rivals,
        "sound": nothing_wrong(diagnosis.explanations) is not None,
    }
    few = diagnosis.measured.kind is DataKind.READINGS and diagnosis.spare <= 0
    reasons = Reason.of("undecided", **data), *([Reason.of("few_readings")] * few)
    advice = [Reason.of("do", what=cause.remedy) for cause in diagnosis.causes]
    if few or not (following or advice):
        advice = [Reason.of("more_readings")]
    elif following:
        advice = [following.what]
    return Release(reasons=reasons, remedies=tuple(Remedy(sentence=a) for a in advice))


def _named(solution: Solution, diagnosis: Diagnosis, corrects: Collection[str]) -> Release:
    ids, units = [cause.id for cause in diagnosis.causes], solution.model.machine.parameter_units
    reasons, remedies = [Reason.of("cause_found", ids=ids)], []
    for fault in diagnosis.unshown:
        if fault.matters:
            # Faults that these readings would not show are looked at first.
            place = {"id": fault.id, "where": fault.where}
            size = {"change": fault.change, "unit": fault.unit}
            reasons.append(Reason.of("unshown_fault", **place, **size))
            look, ruled_out = Reason.of("look", **place), f"--rule-out {fault.id}"
            remedies.append(Remedy(sentence=look, verb="diagnose", options=ruled_out))
    if remedies:
        return Release(reasons=tuple(reasons), remedies=tuple(remedies))
    shift = np.abs(solution.offsets_mm - diagnosis.offsets_mm)
    size = {"change": float(shift.max()), "unit": units[int(np.argmax(shift))]}
    if np.all(shift <= NORMAL_K * diagnosis.std_mm):
        return Release(cautions=(Reason.of("within_u", ids=ids, **size),))
    if all(id in corrects for id in ids):
        return Release(cautions=(Reason.of("corrected", ids=ids, **size),))
    # A slip in the record is looked for sooner than a machine is taken apart.
    for cause in sorted(diagnosis.causes, key=lambda cause: CAUSES[cause.id].fix_order):
        remedy = Remedy(sentence=Reason.of("do", what=cause.remedy))
        if cause.recommended:
            accept, option = Reason.of("accept", id=cause.id), f"--accept {cause.id}"
            remedy = Remedy(sentence=accept, verb="diagnose", options=option)
        remedies.append(remedy)
        if CAUSES[cause.id].corrected_at_joints(solution.model.machine):
            let = Reason.of("controller_corrects", id=cause.id)
            remedies.append(Remedy(sentence=let, verb="apply", options="--to FILE.ini"))
    probability = diagnosis.causes[0].probability
    reason = Reason.of("offsets_wrong", ids=ids, probability=probability, **size)
    return Release(reasons=(reason,), remedies=tuple(remedies))
