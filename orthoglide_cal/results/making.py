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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import chain

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import (
    Diagnosis,
    Explanation,
    FoundCause,
    NextMeasurement,
    UnshownFault,
    Verdict,
    diagnose,
    nothing_wrong,
)
from orthoglide_cal.diagnosis.assess import DISMISSED
from orthoglide_cal.diagnosis.result import WORTH_SAYING, estimated
from orthoglide_cal.errors import PostureError, UnusableResultError
from orthoglide_cal.estimation import (
    OffsetEstimate,
    PromisedDifference,
    Solution,
    promise,
    solve,
    stays,
)
from orthoglide_cal.estimation.accuracy import (
    CONFIDENCE,
    Scatter,
    chance_of_residual,
    determined,
    half_width,
    rms,
)
from orthoglide_cal.estimation.budget import Budget, Contribution, budget_lines, warmth
from orthoglide_cal.files.input import Input
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.model.workspace import Workspace, workspace_error
from orthoglide_cal.results import answer as schema
from orthoglide_cal.results.answer import Release, Remedy
from orthoglide_cal.results.validity import validity
from orthoglide_cal.words import counted, entered_decimals, percent, two_figures

# Beyond this Student's t is the normal distribution to two decimals.
NORMAL_DOF = 500.0
# What the answer takes from a diagnosis as it is.
_DIAGNOSED = (
    *("verdict", "lack_of_fit", "causes", "baselines", "ambiguous_with", "not_excluded"),
    *("rivals", "unshown", "beyond_tolerance", "assumed_sizes"),
)


@dataclass(frozen=True, eq=False)
class _Found:
    """Parameters under one model, and what is known of the machine that they are entered in."""

    values: Floats  # what is found beyond what is active, shape (p,)
    budget: Budget  # where their uncertainty comes from
    noise: Scatter  # of one reading
    real: OffsetEstimate  # the machine, as well as it is known


def answer_to(
    given: Input,
    method: str | None = None,
    *,
    diagnosed: Diagnosis | None = None,
    holdout: str | None = None,
    details: bool = False,
    promised: bool = True,
) -> schema.Answer:
    """Solve, diagnose and judge one input.

    Args:
        method: name of an estimator; then the answer holds the parameters alone.
        diagnosed: a diagnosis of it that was made already; it is made here if None.
        holdout: file of the readings that the diagnosis predicted; None for those left out.
        details: also what only details, JSON and pages show: how the answer depends on plausible
            sizes, the tool's error over the workspace, and the residuals if nothing is wrong.
        promised: also what will be measured after the parameters are entered.

    Raises:
        UsageError, InputError: as `solve`. A result that must not be used raises nothing: the
            answer says so.
    """
    measured, model = given.measured, given.model
    file, conditions = schema.InputFile.of(given), validity(given)
    machine = model.machine
    name = schema.MachineName(name=machine.name, kind=machine.kind)
    try:
        diagnosis = diagnosed or diagnose(measured, model, sensitivity=details)
    except UnusableResultError:
        # Numbers out of all proportion: the solution's own check is all there is.
        diagnosis = None
    try:
        solution = solve(measured, model, method, diagnosis.alone_mm if diagnosis else None)
    except UnusableResultError as error:
        remedies = (Remedy(sentence=error.remedy),) if error.remedy else ()
        refused = Release(reasons=(error.what,), remedies=remedies, sound=False)
        return schema.Answer(input=file, machine=name, release=refused, validity=conditions)
    following = None
    if diagnosis is not None and diagnosis.undecided:
        # Planning takes long to load, and has nothing to say where all is decided.
        from orthoglide_cal.planning import best_next

        following = best_next(diagnosis)
    decision = release(solution, diagnosis, following)
    kept = given.conditions.questioned if given.is_session else ()
    if kept and diagnosis and diagnosis.verdict in (Verdict.AMBIGUOUS, Verdict.UNEXPLAINED):
        few = len(kept) <= 3  # to say why
        listed = ", ".join(f"r {step} ({why})" if few else f"r {step}" for step, why in kept)
        again = f"Retake what was questioned and kept: {listed}:"
        retake = Remedy(sentence=again, verb="measure", options="--resume")
        decision = decision.changed(remedies=(retake, *decision.remedies))
    alone, found = _alone(given, solution, diagnosis), None
    if diagnosis is not None and method is None and diagnosis.verdict is not Verdict.CONSISTENT:
        found = _as_diagnosed(given, solution, diagnosis)
    named = diagnosis is not None and diagnosis.verdict is Verdict.NAMED
    chosen = found or alone
    known = found.budget if found else solution.budget
    budget, std = chosen.budget, chosen.budget.std_mm
    decision = decision.changed(settled=decision.usable and _settled(model, chosen, known))
    decimals = machine.decimals or entered_decimals(budget.expanded_mm.tolist(), machine.active)
    parameters = tuple(_parameters(model, chosen, decimals, enter=decision.usable))
    entered = np.array([each.change(decimals) for each in parameters])
    right = diagnosis.put_right if diagnosis else None
    rows = promise(measured, chosen.real, entered, chosen.noise, right) if promised else ()
    after = solution.rms_after_mm
    if diagnosis is not None and named and found is not None:
        after = rms(measured.weight * (measured.value - diagnosis.explained_mm))
    if decision.usable:
        left = remainder(rows, chosen.real.model)
        if left:
            decision = decision.changed(cautions=(left, *decision.cautions))
    shift = np.abs(alone.values - chosen.values)
    lines, total = budget_lines(budget)
    correlation = budget.covariance_mm2 / np.outer(std, std)
    np.fill_diagonal(correlation, 1.0)
    found_alone = schema.Answer(
        input=file,
        machine=name,
        method=solution.method,
        judgement=solution.judgement,
        release=decision,
        validity=conditions,
        parameters=parameters,
        decimals=decimals,
        k=budget.k,
        dof=None if budget.dof >= NORMAL_DOF else round(budget.dof),
        correlation=tuple(map(tuple, correlation.tolist())),
        sigma_rho_mm=rms(std) if set(machine.parameter_units) == {"mm"} else None,
        alone=schema.Alone(
            parameters=tuple(_parameters(model, alone, decimals, enter=False)),
            rms_after_mm=solution.rms_after_mm,
            wrong_by=float(shift.max()),
            unit=machine.parameter_units[int(np.argmax(shift))],
        )
        if named and found is not None
        else None,
        rms=schema.Residue(before_mm=solution.rms_before_mm, after_mm=after),
        noise=schema.Noise(
            used_mm=chosen.noise.sigma_mm,
            repeats_mm=solution.sigma_repeats_mm,
            residuals_mm=solution.sigma_residuals_mm,
            stated_mm=model.machine.instrument.noise_mm,
            floor_mm=model.machine.instrument.rounding_mm,
            dof=solution.dof,
            p_value=solution.lack_of_fit_p,
        ),
        deviations=rows,
        as_found=spread({row.name: row.measured_mm for row in rows}) if rows else None,
        expected=spread({row.name: row.expected_mm for row in rows}) if rows else None,
        budget=lines,
        total=total,
        remains=stays(rows),
        converged=solution.converged,
        residuals=tuple(_residuals(measured, solution, diagnosis)) if details or found else (),
        undetermined=tuple(_undetermined(model, parameters)),
        check=_check(given, solution, rows, budget.k),
        ruled_out=model.ruled_out,
        workspace=_workspace(chosen, model) if details else None,
        holdout=holdout,
        warnings=solution.warnings,
        notes=decision.cautions,
    )
    if diagnosis is None:
        return found_alone
    return found_alone.changed(
        **{name: getattr(diagnosis, name) for name in _DIAGNOSED},
        explanations=tuple(_explanations(diagnosis, solution, alone)),
        shims=tuple(_shims(diagnosis.causes)) if named else (),
        assumed=tuple(each.id for each in diagnosis.assumed_sizes),
        next_measurement=following,
        sensitivity=dict(diagnosis.sensitivity) or None,
        notes=(*decision.cautions, *diagnosis.notes),
    )


def with_dates(
    answer: schema.Answer, diagnosis: Diagnosis, inputs: Sequence[Input]
) -> schema.Answer:
    """An answer to several dates as one measurement, with the parameters of each under what lasts.

    `inputs` are the dates, oldest first.
    """
    day, sha256 = datetime.now(UTC).date().isoformat(), diagnosis.measured.source.sha256
    lasting = [effect.accepted(day, sha256) for effect in diagnosis.effects if effect.cause.lasting]
    dates = []
    for each in inputs:
        before, own = diagnosis.model.machine, each.model.machine
        model = each.model.extended(effect.transferred(before, own) for effect in lasting)
        found = _alone(replace(each, model=model), solve(each.measured, model), None)
        dates.append(
            schema.OfDate(
                path=each.measured.source.path,
                parameters=tuple(_parameters(model, found, answer.decimals, enter=False)),
            )
        )
    return answer.changed(inputs=tuple(map(schema.InputFile.of, inputs)), dates=tuple(dates))


def _alone(given: Input, solution: Solution, diagnosis: Diagnosis | None) -> _Found:
    """The solution's own parameters; what they leave takes named causes into account."""
    named = diagnosis if diagnosis and diagnosis.verdict is Verdict.NAMED else None
    budget = solution.budget.extended(diagnosis.adds_to(solution) if diagnosis else ())
    model = with_causes(given.model, named) if named else given.model
    known = named or solution
    real = OffsetEstimate(model, known.offsets_mm, known.covariance_mm2)
    return _Found(solution.offsets_mm, budget.extended(_warmth(given)), solution.noise, real)


def _as_diagnosed(given: Input, solution: Solution, diagnosis: Diagnosis) -> _Found:
    """The parameters under what the diagnosis found."""
    model = with_causes(given.model, diagnosis)
    held = set(model.machine.fixed_parameters) - {cause.id for cause in diagnosis.causes}
    taken = [each for each in solution.budget.contributions if each.source in held]
    budget = diagnosis.budget.extended([*taken, *_warmth(given)])
    noise = Scatter(diagnosis.left_open[0][1].sigma, np.inf)
    real = OffsetEstimate(model, diagnosis.offsets_mm, diagnosis.covariance_mm2)
    return _Found(diagnosis.offsets_mm, budget, noise, real)


def _warmth(given: Input) -> tuple[Contribution, ...]:
    return warmth(given.conditions.mean_temperature_c, given.model.machine.expanding_mm)


def with_causes(model: Model, diagnosis: Diagnosis) -> Model:
    """The machine with the lasting causes that a diagnosis names in it, as if accepted now."""
    if diagnosis.verdict is not Verdict.NAMED:
        return model
    day = datetime.now(UTC).date().isoformat()
    return model.extended(
        effect.accepted(day, diagnosis.measured.source.sha256)
        for effect in diagnosis.effects
        if effect.cause.in_machine and effect.cause.lasting
    )


def _settled(model: Model, found: _Found, known: Budget) -> bool:
    """Whether the controller has the parameters already, as well as the readings know them.

    No change exceeds what noise and a local shape make of it, nor do all together (χ²): what else
    may be wrong, and what is taken as the controller has it, would be the same again. Never of
    joint offsets, which are stated as an excess.
    """
    if not model.machine.may_be_settled:
        return False
    if any(effect.cause.compensable for effect in model.accepted):
        return False  # it is to be entered, too
    budget, change = known.without(model.machine.fixed_parameters), found.values
    if np.any(np.abs(change) > budget.expanded_mm):
        return False
    apart = float(change @ np.linalg.solve(budget.covariance_mm2, change))
    widened = budget.k / half_width(np.inf)
    return chance_of_residual(apart, len(change), widened) >= 1.0 - CONFIDENCE


def remainder(promised: Sequence[PromisedDifference], model: Model) -> str | None:
    """What offsets do not remove, in a sentence; None where nothing but noise is left."""
    if not stays(promised):
        return None
    left = two_figures(rms(np.array([row.expected_mm for row in promised])))
    causes = " and ".join(effect.cause.id for effect in model.accepted)
    return f"Offsets do not remove {causes or 'this'}: {left} mm r.m.s. will remain."


def _parameters(
    model: Model, found: _Found, decimals: int, enter: bool
) -> Iterator[schema.Parameter]:
    machine, budget = model.machine, found.budget
    known = zip(found.values.tolist(), determined(model, budget.expanded_mm), strict=True)
    values = [value if sure else None for value, sure in known]
    columns = machine.parameter_names, machine.parameter_units, machine.active, values
    rows = zip(*columns, budget.std_mm.tolist(), budget.expanded_mm.tolist(), strict=True)
    for name, unit, active, value, std, expanded in rows:
        one = schema.Parameter(
            name=name, unit=unit, active=active, found=value, std=std, expanded=expanded
        )
        yield one.changed(enter=one.new(decimals)) if enter else one


def spread(values: Mapping[str, float]) -> schema.Spread:
    """Size of named deviations, one at least, all together."""
    largest = max(values, key=lambda name: abs(values[name]))
    size = rms(np.array([*values.values()]))
    return schema.Spread(rms_mm=size, largest_mm=values[largest], largest=largest)


def _residuals(
    measured: Measured, solution: Solution, diagnosis: Diagnosis | None
) -> Iterator[schema.Residual]:
    """Every reading, in the order of the file."""
    with_causes: list[float | None] = [None] * len(measured)
    if diagnosis is not None and diagnosis.causes:
        with_causes = [*diagnosis.explained_mm.tolist()]
    predicted = solution.predicted_mm if diagnosis is None else diagnosis.nominal_mm
    values = zip(measured.value.tolist(), predicted.tolist(), with_causes, strict=True)
    in_time = np.arange(len(measured))
    if not isinstance(measured, Differences):
        in_time = measured.plan.in_time
    order = (np.argsort(in_time, kind="stable") + 1).tolist()
    for k, (value, modelled, explained) in enumerate(values):
        if isinstance(measured, Differences):
            which = measured.which[k]
            leg, direction = (AXES[axis] for axis in which.series)
            own: dict[str, object] = {"leg": leg, "direction": direction, "posture": which.name}
        else:
            own = {"cycle": int(measured.cycle[k]), "weight": float(measured.weight[k])}
            own |= {"posture": measured.posture[k] or None, **measured.plan.entry(k)}
        left = {"measured_mm": value, "modelled_mm": modelled, "with_causes_mm": explained}
        yield schema.Residual.model_validate({**own, "order": order[k], **left})


def _undetermined(
    model: Model, parameters: Iterable[schema.Parameter]
) -> Iterator[schema.Undetermined]:
    """Parameters, and what no reading of this kind determines: taken as the controller has it."""
    for each in parameters:
        if not each.determined:
            yield schema.Undetermined(name=each.name, within=each.expanded, unit=each.unit)
    known = {effect.cause.id for effect in model.accepted}
    for cause in (CAUSES[id] for id in model.machine.fixed_parameters if id not in known):
        yield schema.Undetermined(name=cause.id, within=cause.size(model.machine), unit=cause.unit)


def _check(
    given: Input, solution: Solution, promised: Sequence[PromisedDifference], k: float
) -> schema.CheckReading | None:
    """The difference that the offsets change most: it shows whether they were entered."""
    if not promised:
        return None
    row = max(promised, key=lambda each: abs(each.measured_mm - each.expected_mm))
    machine = given.model.orthoglide
    series, posture = next(e for e in chain(*DIFFERENCES.values()) if e.name == row.name)
    ends = (posture, posture) if posture else (Posture.MIN, Posture.MAX)
    moved = [machine.displacement_mm(end) for end in ends]
    tools = [tuple(value if axis == series.leg else 0.0 for axis in range(3)) for value in moved]
    joints = [tuple(machine.joints_at(series.leg, value).tolist()) for value in moved]
    sigma = max(solution.sigma_mm, machine.gauge.noise_mm)
    return schema.CheckReading(
        what=row.name,
        leg=AXES[series.leg],
        direction=AXES[series.direction],
        first_mm=tools[0],
        second_mm=tools[1],
        first_joints_mm=joints[0],
        second_joints_mm=joints[1],
        ends=posture is not None,
        before_mm=row.measured_mm,
        expected_mm=row.expected_mm,
        # The promise is of as many readings as were taken before; the check is of two.
        expanded_mm=math.hypot(row.expanded_mm, k * math.sqrt(2.0) * sigma),
    )


def _workspace(found: _Found, model: Model) -> Workspace | None:
    """Tool-position error before and after the adjustment; None if it cannot be computed."""
    if not model.machine.has_cube:
        return None
    budget = found.budget
    try:
        return workspace_error(found.real.model, found.values, budget.covariance_mm2, budget.k)
    except PostureError:
        return None


def _shims(causes: Iterable[FoundCause]) -> Iterator[schema.Shim]:
    """Rail x lies g_xy above rail y, along z: rail y rises by that, and so on."""
    for gap in (each for cause in causes if cause.id == "axis_gap" for each in cause.parameters):
        along = next(axis for axis in AXES if axis not in gap.name)
        yield schema.Shim(
            rail=gap.name[1],
            along=f"{'-' if gap.value < 0.0 else '+'}{along}",
            mm=abs(gap.value),
            expanded_mm=gap.expanded,
        )


def _explanations(diagnosis: Diagnosis, solution: Solution, alone: _Found) -> Iterator[Explanation]:
    """Those not dismissed; the parameters alone are those of the solution."""
    names = diagnosis.model.machine.parameter_names
    bound = DISMISSED * diagnosis.explanations[0].probability
    for each in diagnosis.explanations:
        if not each.parameters and each.probability < (WORTH_SAYING if each.sound else bound):
            continue
        if each.sound:
            found = estimated(names, alone.values, alone.budget.std_mm)
            yield each.changed(rms_mm=solution.rms_after_mm, parameters=found)
        else:
            yield each


# --- may the parameters be entered? one rule for every command that says so -------------------


def release(
    solution: Solution, diagnosis: Diagnosis | None, following: NextMeasurement | None = None
) -> Release:
    """Whether the solution's offsets may be entered, from its own check and the diagnosis.

    Readings that this gauge can hardly have shown prevent it, whatever fits them. A named cause
    prevents it only if it moves the offsets by more than their uncertainty.

    Args:
        solution: of the offsets alone, with the accepted causes; it checks itself again here.
        diagnosis: of the same data; None if it was not or could not be made.
        following: what would distinguish the explanations that it leaves open; None without.
    """
    failures = tuple(_failures(solution, diagnosis))
    vocabulary = solution.model.machine.vocabulary
    if diagnosis is None or diagnosis.verdict is Verdict.CONSISTENT:
        judged = Release()
    elif diagnosis.verdict is Verdict.NAMED:
        judged = _named(solution, diagnosis)
    elif diagnosis.verdict is Verdict.AMBIGUOUS:
        judged = _ambiguous(solution, diagnosis, following)
    elif failures:
        # What the check found is the explanation.
        judged = Release()
    else:
        usual = " of usual size" if diagnosis.beyond_tolerance else ""
        lack = diagnosis.lack_of_fit
        reason = (
            f"No listed cause{usual} explains these data: they leave {lack.left_mm:.3f} mm r.m.s.,"
            f" where the {vocabulary.noise}'s noise{vocabulary.also} would leave"
            f" {lack.expected_mm:.3f} mm."
        )
        judged = Release(reasons=(reason,), remedies=(Remedy(sentence=vocabulary.again),))
    if not failures:
        more = tuple(_cautions(solution, diagnosis)) if judged.usable else ()
        return judged.changed(cautions=(*judged.cautions, *more))
    return Release(
        reasons=(*(reason for reason, _ in failures), *judged.reasons),
        remedies=(*(remedy for _, remedy in failures), *judged.remedies),
        sound=False,
    )


def _cautions(solution: Solution, diagnosis: Diagnosis | None) -> Iterator[str]:
    """What to know of offsets that are released."""
    rough = 1.0 if diagnosis is None else diagnosis.left_open[0][1].scale_factor
    if solution.suspicious and rough > 1.0:
        yield (
            f"The bed's local shape is about {rough:.1f} times as large as is stated or usual, and"
            " U does not cover all of that. State it as texture_mm of the probe."
        )
    elif not solution.dof or (
        solution.suspicious and (diagnosis is None or diagnosis.verdict is Verdict.CONSISTENT)
    ):
        # Without spare readings nothing can contradict or support the offsets. What a named
        # cause explains does not.
        yield solution.judgement


def _failures(solution: Solution, diagnosis: Diagnosis | None) -> Iterator[tuple[str, Remedy]]:
    """What the solution's own check has against it, each with what to do."""
    machine, vocabulary = solution.model.machine, solution.model.machine.vocabulary
    if not solution.converged:
        what = f"The search for the {vocabulary.many} did not converge."
        yield what, Remedy(sentence="Check the file:", verb="validate")
        return
    columns = machine.parameter_names, machine.parameter_units, solution.offsets_mm.tolist()
    parameters = zip(*columns, machine.plausible, strict=True)
    beyond = [each for each in parameters if abs(each[2]) > each[3]]
    if beyond:
        listed = ", ".join(f"{name} {value:+.1f} {unit}" for name, unit, value, _ in beyond)
        limit = ", ".join(dict.fromkeys(f"{most:g} {unit}" for _, unit, _, most in beyond))
        why = vocabulary.beyond.format(limit=limit)
        yield f"{vocabulary.one.capitalize()} {listed}: {why}", Remedy(sentence=vocabulary.recheck)
    pairs = zip(machine.parameter_names, solution.determined, strict=True)
    open_ = [name for name, known in pairs if not known]
    if open_:
        yield (
            f"These readings do not determine {', '.join(open_)}: they add nothing to what is"
            " known without them.",
            Remedy(sentence=vocabulary.more),
        )
    for doubt in solution.doubts:
        yield doubt.what, Remedy(sentence=doubt.remedy)
    if diagnosis is None and solution.suspicious:
        yield solution.judgement, Remedy(sentence=vocabulary.more)


def _ambiguous(
    solution: Solution, diagnosis: Diagnosis, following: NextMeasurement | None
) -> Release:
    vocabulary = solution.model.machine.vocabulary
    answer = " with ".join(cause.id for cause in diagnosis.causes) or "a cause"
    open_ = [answer, *map(" with ".join, diagnosis.rivals[:1])]
    if len(diagnosis.rivals) > 1:
        open_.append(counted(len(diagnosis.rivals) - 1, "other"))
    either = " or ".join(filter(None, (", ".join(open_[:-1]), open_[-1])))
    sound = nothing_wrong(diagnosis.explanations) is not None
    reasons = [
        f"Something {'may be' if sound else 'is'} wrong besides the {vocabulary.many}: {either}."
        f" These data do not distinguish {'them' if diagnosis.rivals else 'it'}"
        f"{', nor from a sound machine' if sound else ''}."
    ]
    advice = [cause.remedy for cause in diagnosis.causes] or [vocabulary.more]
    if following is not None:
        advice = [following.what]
    if diagnosis.measured.kind is DataKind.READINGS and diagnosis.spare <= 0:
        reasons.append("With so few readings nearly anything fits.")
        advice = [vocabulary.more]
    remedies = tuple(Remedy(sentence=each) for each in dict.fromkeys(advice))
    return Release(reasons=tuple(reasons), remedies=remedies)


def _to_check(diagnosis: Diagnosis, names: str, faults: Sequence[UnshownFault]) -> Release:
    """What these readings would not show must be looked at before anything is entered."""
    machine, reasons, remedies = diagnosis.model.machine, [f"{names} was found."], []
    for fault in faults:
        title = CAUSES[fault.id].words(machine).title
        where = f" ({fault.where})" if fault.where else ""
        reasons.append(
            f"If {title} as well{where}, which these readings would not show, the"
            f" {machine.vocabulary.many} change by up to {fault.change:.3f} {fault.unit}."
        )
        look = f"Check whether {title}{where}. What shows it: {fault.check}. If all is in order,"
        ruled_out = f"--rule-out {fault.id}"
        remedies.append(Remedy(sentence=f"{look} say so:", verb="diagnose", options=ruled_out))
    return Release(reasons=tuple(reasons), remedies=tuple(remedies))


def _named(solution: Solution, diagnosis: Diagnosis) -> Release:
    machine = solution.model.machine
    one, many = machine.vocabulary.one, machine.vocabulary.many
    ids = " and ".join(cause.id for cause in diagnosis.causes)
    titles = " and ".join(CAUSES[cause.id].words(machine).title for cause in diagnosis.causes)
    shift = np.abs(solution.offsets_mm - diagnosis.offsets_mm)
    largest = f"{float(shift.max()):.3f} {machine.parameter_units[int(np.argmax(shift))]}"
    check = [fault for fault in diagnosis.unshown if fault.matters]
    if check:
        return _to_check(diagnosis, ids, check)
    if np.all(shift <= half_width(np.inf) * diagnosis.std_mm):
        moves = "moves" if len(diagnosis.causes) == 1 else "move"
        within = f"{ids} {moves} no {one} by more than {largest}, which is within U."
        return Release(cautions=(within,))
    # A slip in the record is looked for sooner than a machine is taken apart.
    remedies = [
        Remedy(
            sentence=f"Correct it, or make {cause.id} part of the machine and use the new machine"
            " file:",
            verb="diagnose",
            options=f"--accept {cause.id}",
        )
        if cause.recommended
        else Remedy(sentence=cause.remedy)
        for cause in sorted(diagnosis.causes, key=lambda cause: cause.in_machine)
    ]
    sure = f"{titles[0].upper()}{titles[1:]} ({ids}, {percent(diagnosis.causes[0].probability, 1)})"
    reason = f"{sure}: {many} alone would be wrong by up to {largest}."
    return Release(reasons=(reason,), remedies=tuple(dict.fromkeys(remedies)))
