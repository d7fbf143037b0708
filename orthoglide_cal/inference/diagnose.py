"""From what was measured to a verdict on the model, and to a model extended by a cause."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import date
from types import MappingProxyType

import numpy as np
from scipy.special import fdtrc

from orthoglide_cal.causes import CAUSES, PatternCause, RelabelCause
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import Solution, fit_parameters
from orthoglide_cal.estimation.gaussian import unexplained
from orthoglide_cal.estimation.losses import DISMISSED
from orthoglide_cal.inference.data import Candidates, Ids, Linearised, Whitened, unit_of
from orthoglide_cal.inference.decision import BEYOND, MISFIT, Decision, decide, decide_by
from orthoglide_cal.inference.fit import Fit, HeldOut, fit_hypothesis, leave_out, left_out
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.inference.patterns import describe, fits_of
from orthoglide_cal.inference.prediction import (
    REPEATS,
    baselines,
    chance_of_worse,
    moved_origin,
    predict_later,
    repeats,
)
from orthoglide_cal.inference.result import (
    WORTH_SAYING,
    AssumedSize,
    Baselines,
    Diagnosis,
    Explanation,
    FoundCause,
    FoundPattern,
    LackOfFit,
    Otherwise,
    Parameter,
    UnshownFault,
    Verdict,
)
from orthoglide_cal.model.cause import NORMAL_K, Cause, Effect, Place
from orthoglide_cal.model.measured import Measured, Readings, notes_on
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.schema import Reason


def diagnose(
    measured: Measured,
    model: Model,
    holdout: Measured | None = None,
    applied: Floats | Sequence[float] = (),
    then: Model | None = None,
    sensitivity: bool = False,
    recalibrated: bool = False,
) -> Diagnosis:
    """Say what the offsets-only model gets wrong, if anything.

    Args:
        measured, model: the data, and what they are of, with the causes accepted already.
        holdout: later data that no fit may see.
        applied: offsets entered in the controller before the held-out data, shape (3,) [mm].
        then: the model at the time of the held-out data; None for the same.
        sensitivity: also judge with all tolerances halved and doubled; of healthy data these say
            nothing, and that is left out.
        recalibrated: the machine was calibrated again before the held-out data; models may say so.

    Raises UnusableResultError: as of `decided`.
    """
    decision, machine, notes = decided(measured, model), model.machine, list[Reason]()
    belief, white = decision.belief, decision.belief.at.white
    changed = machine.differing(then.machine) if then is not None else ()
    anew = recalibrated or bool(changed)
    known = then if then is not None and changed else model
    later = None if holdout is None else Whitened.of(holdout, known)
    entered = np.zeros(len(machine.parameter_names))
    entered[: len(applied)] = applied
    free = len(entered) * anew
    if later is not None and anew:
        notes.append(Reason.of("recalibrated", changed=changed))
    elif later is not None:
        shift = moved_origin(later, decision.carried, entered)
        if shift is not None:
            free = len(shift)
            moves = dict(zip(machine.parameter_names, shift.tolist(), strict=False))
            notes.append(Reason.of("origin_moved", moves=moves))
    again = repeats(white, later)
    if again is not None and again > REPEATS:
        notes.append(Reason.of("maps_repeat", correlation=again))
    alone = fit_parameters(measured, model, start=belief.at.offsets[0])
    nothing, accepted = belief.fit(()), decision.fit
    causes, beside = list[FoundCause](), None
    touched = bool(white.plan.touches.any())
    if accepted.effects or (touched and (sensitivity or later is not None)):
        before, after = (
            predict_later(later, fit, entered, free, machine)
            if later is not None
            else leave_out(fit, left_out(white, accepted.wrong_readings))[2]
            for fit in (nothing, decision.carried)
        )
        # Whoever adjusted the machine may have removed what acted before.
        if later is not None and decision.verdict is Verdict.NAMED and not entered.any():
            refuted = refuted_later(decision, later, decision.carried, nothing, free)
            decision = replace(decision, refuted=refuted)
            accepted = decision.fit
        # Without the cause the errors are in the unit that was written down, too.
        unit = 1.0 if later is not None else unit_of(accepted.effects)
        before = replace(before, rms_mm=before.rms_mm * unit)
        if touched:
            errors = {"parameters_mm": before.rms_mm, "extension_mm": after.rms_mm}
            others = baselines(white, later, entered, free)
            beside = Baselines(**errors, **others, repeats=again)
        better = beside is not None and beside.better is not None
        causes = _named(decision, alone, before, after, better)
    changes: dict[str, Otherwise] = {}
    if sensitivity and decision.verdict is not Verdict.CONSISTENT:
        for name, factor in (("halved", 0.5), ("doubled", 2.0)):
            other = decide_by(belief.scaled(factor))
            changes[name] = Otherwise(verdict=other.verdict, ids=other.accepted)
    offsets, covariance = decision.offsets
    unshown = tuple(_unshown(decision, offsets, NORMAL_K * np.sqrt(np.diag(covariance))))
    matter = {fault.id for fault in unshown if fault.matters}
    tried = {id for ids in belief.hypotheses for id in ids}
    patterns, with_it = list[FoundPattern](), list[tuple[Cause, Place]]()
    if decision.verdict is Verdict.UNEXPLAINED and decision.refuted is None:
        patterns, with_it = [*_patterns(decision, alone)], [*_beside_patterns(decision)]
    explained, wrong = alone.predicted_mm, accepted.wrong_readings
    if any(pattern.accepted for pattern in patterns):
        explained = _predicted(decision, measured, *_with_patterns(decision))
        wrong = sum((place for cause, place in with_it if cause.hides_reading), ())
    elif accepted.effects:
        explained = _predicted(decision, measured, accepted.left, accepted.effects)
    return Diagnosis(
        measured=measured,
        model=model,
        verdict=decision.verdict,
        refuted=decision.refuted,
        lack_of_fit=_lack_of_fit(decision, alone),
        causes=tuple(causes),
        baselines=beside,
        ambiguous_with=decision.ambiguous_with,
        not_excluded=decision.not_excluded,
        left_open=decision.left_open,
        by_place=(
            *decision.by_place,
            *((share, fit) for id, share, fit in decision.unshown if id in matter),
        ),
        offsets_mm=offsets,
        covariance_mm2=covariance,
        alone=alone,
        explained_mm=explained,
        wrong_readings=wrong,
        sensitivity=MappingProxyType(changes),
        explanations=tuple(_explanations(decision)),
        unshown=unshown,
        patterns=tuple(patterns),
        enterable=decision.enterable if decision.verdict is Verdict.UNEXPLAINED else 0.0,
        beyond_tolerance=decision.beyond_tolerance,
        assumed_sizes=tuple(
            AssumedSize(id=id, size=cause.size(model.machine), unit=cause.unit)
            for id, cause in CAUSES.items()
            if id in tried and cause.assumed(model.machine)
        ),
        notes=tuple(_notes(decision, measured, with_it, notes)),
    )


def extend(measured: Measured, model: Model, id: str, on: date) -> Model:
    """The model with one more accepted cause.

    Args:
        measured, model: the data that it is identified from, and what is known so far.
        id, on: cause to accept, and date to note.

    Raises:
        UnusableResultError: these data do not support it, the machine file rules it out, or it
            lies in the measurement.
    """
    cause = CAUSES[id]
    if not cause.lasting:
        raise UnusableResultError(
            f"{id} lies in the measurement, not in the machine: it cannot be accepted.",
            "Correct it, and measure again.",
        )
    if not cause.possible(model.machine):
        raise UnusableResultError(
            f"The machine file rules {id} out: its size under tolerances is 0.",
            "Give it a size there if the machine may have it.",
        )
    decision = decided(measured, model)
    verdict, accepted = decision.verdict, decision.accepted
    if not accepted:
        raise UnusableResultError(
            f"These data are {verdict}: they do not support {id} as an extension.",
            "See what diagnose says about them.",
        )
    # Faults of the measurement that stand in its place in an explanation without it; those that
    # hold it may differ in what else was wrong with the measurement.
    sets = (accepted, *decision.rivals)
    shared = set.intersection(*map(set, sets))
    others = dict.fromkeys(other for ids in sets for other in ids if other not in (id, *shared))
    doubtful = [other for other in others if not CAUSES[other].in_machine]
    if verdict is Verdict.AMBIGUOUS and id not in shared and doubtful:
        raise UnusableResultError(
            f"These data do not distinguish what lies in the machine from"
            f" {', '.join(doubtful)}, which lies in the measurement.",
            "Take the reading that diagnose names, then accept.",
        )
    listed = decision.belief.listed
    best = max((ids for ids in listed if id in ids), key=listed.__getitem__, default=())
    if id not in best or not (best == accepted or decision.is_open(best)):
        raise UnusableResultError(
            f"These data contradict {id}.", f"They name {', '.join(accepted)}."
        )
    (effect,) = (effect for effect in decision.belief.fit(best).effects if effect.cause.id == id)
    return model.accepting(effect.accepted(on.isoformat(), measured.source.sha256))


# What cannot be weighed shows as NaN and is refused; warnings would say nothing more.
@np.errstate(invalid="ignore")
def decided(measured: Measured, model: Model) -> Decision:
    """Decide what the data say; maps of several dates that repeat are no noise.

    A name has to predict what is left out of its fit, and each date from those before it. Raises
    UnusableResultError: the data do not determine the offsets, or cannot be weighed.
    """
    try:
        white = Whitened.of(measured, model)
        again = repeats(white)
        decision = replace(decide(white), repeats=again is not None and again > REPEATS)
        verdict, fit = decision.verdict, decision.fit
    except np.linalg.LinAlgError as error:
        raise UnusableResultError(
            "These data cannot be weighed: the gauge's stated noise"
            f" ({model.machine.instrument.noise_mm:.2g} mm) is out of all proportion to the"
            " readings.",
            "Check gauge and tolerances in the machine file.",
        ) from error
    if verdict is not Verdict.NAMED:
        return decision
    held = leave_out(fit, left_out(white, fit.wrong_readings))[2]
    if held.chance >= MISFIT:
        return replace(decision, refuted=_refuted_by_date(measured, decision))
    sizes = {"error_mm": held.rms_mm, "stated_mm": held.rms_mm / held.ratio}
    return replace(decision, refuted=Reason.of("refuted_left_out", ids=decision.accepted, **sizes))


def refuted_later(
    decision: Decision, later: Whitened, fit: Fit, alone: Fit, free: int
) -> Reason | None:
    """How later data refute the named causes, of which a fit is; None if they do not.

    So many parameters, `free`, are others then.
    """
    before, nothing = decision.belief.at.white.machine, np.zeros(fit.offsets.size)
    if chance_of_worse(later, fit, alone, nothing, free, before) >= MISFIT:
        return None
    errors = (predict_later(later, one, nothing, free, before).rms_mm for one in (alone, fit))
    sizes = dict(zip(("without_mm", "with_mm"), errors, strict=True))
    return Reason.of("refuted_later", ids=decision.accepted, **sizes)


def _refuted_by_date(measured: Measured, decision: Decision) -> Reason | None:
    """How a date refutes what lasts of a name, predicted from those before it.

    The parameters are others on each date.
    """
    fit, model = decision.carried, decision.belief.at.white.problem.model
    lasting = tuple(cause for cause in fit.hypothesis.base if cause.lasting)
    if not isinstance(measured, Readings) or not lasting:
        return None
    for day in np.unique(measured.plan.date)[1:]:
        parts = measured.plan.date < day, measured.plan.date == day
        earlier, later = (Whitened.of(measured.subset(part), model) for part in parts)
        at = Linearised.of(earlier, Candidates(lasting, (), (), {}))
        bases = (Hypothesis(at, 0.0, base, fit.hypothesis.scale) for base in (lasting, ()))
        shaped, bare = map(fit_hypothesis, bases)
        if refuted := refuted_later(decision, later, shaped, bare, fit.offsets.size):
            return refuted
    return None


def _explanations(decision: Decision) -> Iterator[Explanation]:
    """Those not dismissed, best first; those that are left open with their parameters."""
    belief, white = decision.belief, decision.belief.at.white
    model = white.problem.model
    fits: dict[Ids | str, Fit] = {tuple(sorted(fit.ids)): fit for _, fit in decision.left_open}
    least = DISMISSED * max(belief.probability.values())
    # What is open is compared with the parameters alone, however improbable.
    sound = WORTH_SAYING * (decision.verdict in (Verdict.CONSISTENT, Verdict.NAMED))
    for key, probability in belief.probability.items():
        fit = fits.get(key)
        if fit is None and probability < (least if key else sound):
            continue
        ids, pattern = (key, None) if isinstance(key, tuple) else ((), key)
        values: dict[str, object] = {"ids": ids, "pattern": pattern, "probability": probability}
        if fit is not None:
            std = np.sqrt(np.diag(fit.offsets_covariance))
            values |= {
                "rms_mm": white.rms(fit.left) if ids else None,
                "parameters": Parameter.all_of(model, fit.offsets, std, NORMAL_K),
                "sizes": {effect.cause.id: model.called(effect) for effect in fit.effects},
            }
        yield Explanation.model_validate(values)


def _unshown(decision: Decision, offsets: Floats, u: Floats) -> Iterator[UnshownFault]:
    """Each fault that would not show, with all places where it may be; U (3,) of the offsets."""
    plan, machine = decision.belief.at.white.plan, decision.belief.at.white.machine
    faults: dict[str, list[Fit]] = {}
    for id, _, fit in decision.unshown:
        faults.setdefault(id, []).append(fit)
    for id, fits in faults.items():
        places = (effect.place for fit in fits for effect in fit.effects if effect.cause.id == id)
        wheres = (CAUSES[id].label(place, plan, machine) for place in places)
        change = np.max([np.abs(fit.offsets - offsets) for fit in fits], axis=0)
        largest = int(np.argmax(change / u))
        yield UnshownFault(
            id=id,
            where=" or ".join(filter(None, wheres)),
            check=CAUSES[id].words(machine).instrument,
            change=float(change[largest]),
            unit=machine.parameter_units[largest],
            matters=bool(np.any(change > u)),
        )


def _named(
    decision: Decision, alone: Solution, before: HeldOut, after: HeldOut, better: bool
) -> list[FoundCause]:
    """The accepted causes; the one without which the data are hardest to explain comes first.

    What can act together with any other comes after it. `better`: what needs no cause predicts
    better, and no shape is recommended.
    """
    white, machine = decision.belief.at.white, decision.belief.at.white.machine
    accepted, ids = decision.fit, set(decision.accepted)
    rivals = decision.rivals if decision.wrong else ()
    same = decision.same_answer(decision.accepted)
    by_parameters = accepted.columns[:, : accepted.offsets.size]
    causes = []
    for effect, slot in zip(accepted.effects, accepted.slots, strict=True):
        cause, id = effect.cause, effect.cause.id
        where, times = cause.label(effect.place, white.plan, machine), effect.times(machine)
        parameters = white.problem.model.called(effect)
        if cause.hides_reading and len(effect.place) > 1:
            # Several wrong readings are called by their places.
            names = (cause.label((row,), white.plan, machine) for row in effect.place)
            pairs = zip(parameters, names, strict=True)
            parameters = tuple(one.changed(name=name) for one, name in pairs)
        adds = accepted.columns[:, slot] @ effect.theta[: slot.stop - slot.start]
        # Causes that stand in its place in a rival explanation, or in one of the same remedy.
        instead = [rival for rival in (*same, *rivals) if id not in rival if ids - {id} <= {*rival}]
        aliases = dict.fromkeys(other for rival in instead for other in rival if other not in ids)
        # An explanation without it may need a fault of the measurement in its place.
        others = {other for rival in rivals if id not in rival for other in rival} - ids
        sure = id == decision.shape or all(CAUSES[other].compensable for other in others)
        taken = cause.compensable or id in machine.recommended
        gains = after.rms_mm < before.rms_mm and not (better and id == decision.shape)
        causes.append(
            FoundCause(
                id=id,
                probability=decision.belief.listed[decision.accepted],
                where=where,
                parameters=parameters,
                adds_mm=white.rms(unexplained(by_parameters, adds)),
                rms_before_mm=alone.rms_after_mm * unit_of(accepted.effects),
                rms_after_mm=white.rms(accepted.left),
                heldout_before_mm=before.rms_mm,
                heldout_after_mm=after.rms_mm,
                heldout_ratio=after.ratio,
                aliases=tuple(aliases),
                times_stated=times if times > BEYOND else None,
                remedy=cause.words(machine).advice.format(where=where),
                recommended=taken and gains and sure,
                in_machine=cause.in_machine,
            )
        )
    single = {cause.id: -decision.belief.hypotheses[(cause.id,)].log_evidence for cause in causes}
    return sorted(causes, key=lambda cause: (cause.id in machine.companions, single[cause.id]))


def _patterns(decision: Decision, alone: Solution) -> Iterator[FoundPattern]:
    """Patterns beyond the list, those that act together first."""
    belief, likeliest = decision.belief, next(iter(decision.beyond_list))
    total: dict[str, float] = {}
    first: dict[str, Hypothesis] = {}
    for hypothesis in decision.beyond_list:
        for pattern in (one for one in hypothesis.patterns if one.how not in CAUSES):
            others = tuple(one for one in hypothesis.patterns if one is not pattern)
            first.setdefault(pattern.label, replace(hypothesis, patterns=(*others, pattern)))
            share = belief.unlisted[hypothesis.label]
            total[pattern.label] = total.get(pattern.label, 0.0) + share
    for label, last in first.items():
        accepted = label in (pattern.label for pattern in likeliest.patterns)
        of_it = alone.measured, total[label], accepted, alone.rms_after_mm
        numbers = describe(last, belief.fit(last.ids), *of_it)
        if numbers is not None:
            yield numbers


def _with_patterns(decision: Decision) -> tuple[Floats, tuple[Effect, ...]]:
    """Remainder of the likeliest explanation beyond the list, (k,) [mm], and its listed causes.

    More noise predicts nothing.
    """
    hypothesis = next(iter(decision.beyond_list))
    fit = decision.belief.fit(hypothesis.ids)
    acting = tuple(one for one in hypothesis.patterns if one.how != "scatters")
    fits = fits_of(replace(hypothesis, patterns=acting), fit) if acting else [(1.0, fit)]
    return np.sum([share * after.left for share, after in fits], axis=0), fit.effects


def _beside_patterns(decision: Decision) -> Iterator[tuple[Cause, Place]]:
    """Listed causes of the likeliest explanation beyond the list, and where they act."""
    hypothesis = next(iter(decision.beyond_list))
    for effect in decision.belief.fit(hypothesis.ids).effects:
        yield effect.cause, effect.place
    for one in hypothesis.patterns:
        if one.how in CAUSES:
            placed = hypothesis.at.extras[one.how]
            yield placed.cause, placed.tried[int(one.log_shape.max(axis=1).argmax())]


def _lack_of_fit(decision: Decision, alone: Solution) -> LackOfFit:
    """Judge the parameters alone; a bed's local shape as large as it is found."""
    white = decision.belief.at.white
    noise, dof, size = white.machine.instrument.noise_mm, alone.dof, alone.sigma_residuals_mm or 0.0
    p_value = 1.0 if alone.lack_of_fit_p is None else alone.lack_of_fit_p
    if white.texture is not None:
        dof, p_value = len(white) - alone.offsets_mm.size, decision.chance(decision.alone)
        size = math.sqrt(decision.alone.square / dof) if dof else 0.0
    repeats, chance = alone.repeats, None
    if repeats is not None and repeats.sigma_mm > 0.0 and dof > repeats.dof:
        lack = max(dof * size**2 - repeats.dof * repeats.sigma_mm**2, 0.0) / (dof - repeats.dof)
        chance = float(fdtrc(dof - repeats.dof, repeats.dof, lack / repeats.sigma_mm**2))
    left = alone.rms_after_mm
    return LackOfFit(
        statistic=dof * size**2 / noise**2,
        dof=dof,
        p_value=p_value,
        repeats_p_value=chance,
        repeats_mm=None if repeats is None else repeats.sigma_mm,
        left_mm=left,
        # The fit takes a part of the noise away, too.
        expected_mm=left * noise / size if size else noise,
        noise_mm=noise,
        residual_mm=size,
    )


def _predicted(
    decision: Decision, measured: Measured, residual: Floats, effects: Sequence[Effect]
) -> Floats:
    """Prediction of each value, (n,) [mm], by a fit that leaves a whitened residual (k,) [mm]."""
    white = decision.belief.at.white
    for effect in effects:
        cause, place = effect.cause, effect.place
        if isinstance(cause, RelabelCause) and cause.reversible(white.plan, place):
            residual = white.relabelled(residual, (cause, place))[0] / cause.unit_mm(place)
    return measured.value - white.plain(residual)[white.in_file]


def _notes(
    decision: Decision,
    measured: Measured,
    beside: Sequence[tuple[Cause, Place]],
    more: Sequence[Reason],
) -> Iterator[Reason]:
    """Remarks on the answer: the data, listed causes `beside` patterns, what is open, and `more`.

    Last what stays unexplained of a local shape, where that is the rule, and claims not made.
    """
    yield from notes_on(measured)
    belief, white = decision.belief, decision.belief.at.white
    machine, accepted, fit = white.machine, decision.accepted, decision.fit
    for id, spread in machine.doubted.items():
        lengths = machine.nominal_rails.lengths.tolist()
        yield Reason.of(f"doubted_{id}", lengths_mm=lengths, spread_mm=spread)
    if decision.not_excluded:
        yield Reason.of("not_excluded", ids=decision.not_excluded)
    for cause, place in beside:
        yield Reason.of("acts_too", id=cause.id, where=cause.label(place, white.plan, machine))
    if decision.verdict is Verdict.UNEXPLAINED:
        best, least = decision.best, DISMISSED * max(belief.unlisted.values())
        if len(best) > 1 and belief.listed[best] >= least:
            yield Reason.of("two_would_follow", ids=best)
    if decision.verdict is Verdict.AMBIGUOUS:
        for ids in decision.rivals:
            if set(accepted) < set(ids):
                yield Reason.of("perhaps_also", ids=[id for id in ids if id not in accepted])
    for part, probability in belief.listed.items():
        if part and set(part) < set(accepted) and decision.is_open(part):
            others = [id for id in accepted if id not in part]
            yield Reason.of("perhaps_alone", id=part[0], others=others, probability=probability)
    causes = [effect.cause for effect in fit.effects]
    if causes and not white.raw:
        unknowns, count = sum(len(cause.names) for cause in causes), len(measured)
        yield Reason.of("few_differences", count=count, spare=count - 3, unknowns=unknowns)
    if white.raw and any(isinstance(cause, PatternCause) for cause in causes):
        yield Reason.of("measure_again")
    yield from more
    if white.texture is None:
        return
    for cause in causes:
        if cause.id in machine.companions:
            yield Reason.of("remark", text=machine.companions[cause.id])
    # Otherwise the answer follows anything.
    if len(white) > fit.offsets.size + sum(cause.freedom for cause in causes):
        noise, left = machine.instrument.noise_mm, white.rms(fit.left)
        beyond = math.sqrt(max(left**2 - noise**2, 0.0))
        yield Reason.of("local_residual", left_mm=left, noise_mm=min(noise, left), beyond_mm=beyond)
