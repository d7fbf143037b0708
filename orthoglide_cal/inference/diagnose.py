"""From what was measured to a verdict on the model, and to a model extended by a cause."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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
from orthoglide_cal.inference.baselines import REPEATS, Baselines, baselines, repeats
from orthoglide_cal.inference.candidates import Candidates, Ids
from orthoglide_cal.inference.data import Linearised, Whitened, unit_of
from orthoglide_cal.inference.decision import BEYOND, MISFIT, Decision, decide, decide_by
from orthoglide_cal.inference.described import described
from orthoglide_cal.inference.fit import Fit, HeldOut, fit_hypothesis, leave_out_cells
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.inference.patterns import fits_of
from orthoglide_cal.inference.prediction import chance_of_worse, moved_origin, predict_later
from orthoglide_cal.inference.result import (
    WORTH_SAYING,
    AssumedSize,
    Diagnosis,
    Explanation,
    FoundCause,
    FoundPattern,
    LackOfFit,
    Otherwise,
    Parameter,
    TimesStated,
    UnshownFault,
    Verdict,
)
from orthoglide_cal.model.cause import NORMAL_K, Cause, Effect, Estimate, Place
from orthoglide_cal.model.measured import Measured, Readings, notes_on
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.schema import Reason


def diagnose(
    measured: Measured,
    model: Model,
    holdout: Measured | None = None,
    applied: Floats | None = None,
    then: Model | None = None,
    sensitivity: bool = False,
    recalibrated: bool | None = None,
) -> Diagnosis:
    """Say what the offsets-only model gets wrong, if anything.

    Args:
        measured, model: the data, and what they are of, with the causes accepted already.
        holdout: later data that no fit may see.
        applied: offsets entered in the controller before the held-out data, shape (3,) [mm].
        then: the model at the time of the held-out data; None for the same.
        sensitivity: also judge with all tolerances halved and doubled; of healthy data these say
            nothing, and that is left out.
        recalibrated: whether the machine was calibrated again before the held-out data; None if the
            models say so.

    Raises:
        UnusableResultError: the data do not determine the offsets, or the numbers of the machine
            file and the data are too far apart.
    """
    with _weighable(model):
        decision = decided(measured, model)
        white = decision.belief.at.white
        changed = model.machine.differing(then.machine) if then is not None else ()
        known = then if then is not None and changed else model
        anew = bool(changed) if recalibrated is None else recalibrated
        later = None if holdout is None else Whitened.of(holdout, known)
        entered = np.zeros(len(model.machine.parameter_names))
        if applied is not None:
            entered[: len(applied)] = applied
        alone = fit_parameters(measured, model, start=decision.belief.at.offsets[0])
        again = repeats(white, later)
        nothing, accepted = decision.belief.fit(()), decision.fit
        causes: tuple[FoundCause, ...] = ()
        free = len(entered) * anew
        beside = None
        notes: list[Reason] = []
        if later is not None and anew:
            notes.append(Reason.of("recalibrated", changed=changed))
        elif later is not None:
            shift = moved_origin(later, decision.carried, entered)
            if shift is not None:
                free = len(shift)
                names = zip(model.machine.parameter_names, shift.tolist(), strict=False)
                notes.append(Reason.of("origin_moved", moves=dict(names)))
        if again is not None and again > REPEATS:
            notes.append(Reason.of("maps_repeat", correlation=again))
        touched = bool(white.plan.touches.any())
        if accepted.effects or (touched and (sensitivity or later is not None)):
            before, after = (
                predict_later(later, fit, entered, free, model.machine)
                if later is not None
                else leave_out_cells(white, fit, accepted)
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
                quartic, earlier = baselines(white, later, entered, free)
                beside = Baselines(
                    parameters_mm=before.rms_mm,
                    extension_mm=after.rms_mm,
                    quartic_mm=quartic,
                    earlier_map_mm=earlier,
                    repeats=again,
                )
            better = beside is not None and beside.better is not None
            causes = _named(decision, alone, before, after, better)
        changes: dict[str, Otherwise] = {}
        if sensitivity and decision.verdict is not Verdict.CONSISTENT:
            for name, factor in (("halved", 0.5), ("doubled", 2.0)):
                other = decide_by(decision.belief.scaled(factor))
                changes[name] = Otherwise(verdict=other.verdict, ids=other.accepted)
        offsets, covariance = decision.offsets
        unshown = _unshown(decision, offsets, NORMAL_K * np.sqrt(np.diag(covariance)))
        matter = {fault.id for fault in unshown if fault.matters}
        tried = {id for ids in decision.belief.hypotheses for id in ids}
        patterns, wrong = tuple(_patterns(decision, alone)), accepted.wrong_readings
        explained = alone.predicted_mm
        if accepted.effects:
            explained = _predicted(white, measured, accepted.left, accepted.effects)
        if any(pattern.accepted for pattern in patterns):
            explained, wrong = _with_patterns(decision, measured)
        return Diagnosis(
            measured=measured,
            model=model,
            verdict=decision.verdict,
            refuted=decision.refuted,
            lack_of_fit=_lack_of_fit(decision, alone),
            causes=causes,
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
            explanations=_explanations(decision),
            unshown=unshown,
            patterns=patterns,
            enterable=decision.enterable if decision.verdict is Verdict.UNEXPLAINED else 0.0,
            beyond_tolerance=tuple(
                TimesStated(id=id, times=times) for id, times in decision.beyond_tolerance
            ),
            assumed_sizes=tuple(
                AssumedSize(id=id, size=cause.size(model.machine), unit=cause.unit)
                for id, cause in CAUSES.items()
                if id in tried and cause.assumed(model.machine)
            ),
            notes=(*_notes(decision, measured), *notes, *_of_local_shape(decision)),
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
    with _weighable(model):
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
        (effect,) = (
            effect for effect in decision.belief.fit(best).effects if effect.cause.id == id
        )
        return model.accepting(effect.accepted(on.isoformat(), measured.source.sha256))


def decided(measured: Measured, model: Model) -> Decision:
    """Decide what the data say; maps of several dates that repeat are no noise.

    A name has to predict what is left out of its fit, and each date from those before it.
    """
    white = Whitened.of(measured, model)
    again = repeats(white)
    decision = replace(decide(white), repeats=again is not None and again > REPEATS)
    if decision.verdict is not Verdict.NAMED:
        return decision
    held = leave_out_cells(white, decision.fit, decision.fit)
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
        refuted = refuted_later(decision, later, shaped, bare, fit.offsets.size)
        if refuted is not None:
            return refuted
    return None


@contextmanager
def _weighable(model: Model) -> Iterator[None]:
    """Turn a failure of linear algebra into an error that says what it comes from."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise UnusableResultError(
            "These data cannot be weighed: the gauge's stated noise"
            f" ({model.machine.instrument.noise_mm:.2g} mm) is out of all proportion to the"
            " readings.",
            "Check gauge and tolerances in the machine file.",
        ) from error


def _explanations(decision: Decision) -> tuple[Explanation, ...]:
    """Those not dismissed, best first; those that are left open with their parameters."""
    belief, white = decision.belief, decision.belief.at.white
    model, explanations = white.problem.model, []
    fits = {tuple(sorted(fit.ids)): fit for _, fit in decision.left_open}
    least = DISMISSED * max(belief.probability.values())
    # What is open is compared with the parameters alone, however improbable.
    sound = WORTH_SAYING * (decision.verdict in (Verdict.CONSISTENT, Verdict.NAMED))
    for key, probability in belief.probability.items():
        ids, pattern = (key, None) if isinstance(key, tuple) else ((), key)
        values: dict[str, object] = {"ids": ids, "pattern": pattern, "probability": probability}
        fit = fits.get(ids)
        if fit is not None and pattern is None:
            std = np.sqrt(np.diag(fit.offsets_covariance))
            values |= {
                "rms_mm": white.rms(fit.left) if ids else None,
                "parameters": Parameter.all_of(model, fit.offsets, std, NORMAL_K),
                "sizes": {effect.cause.id: model.called(effect) for effect in fit.effects},
            }
        elif probability < (least if key else sound):
            continue
        explanations.append(Explanation.model_validate(values))
    return tuple(explanations)


def _unshown(decision: Decision, offsets: Floats, u: Floats) -> tuple[UnshownFault, ...]:
    """Each fault that would not show, with all places where it may be; U (3,) of the offsets."""
    white, machine = decision.belief.at.white, decision.belief.at.white.machine
    wheres: dict[str, list[str]] = {}
    moved: dict[str, Floats] = {}
    for id, _, fit in decision.unshown:
        place = next(effect.place for effect in fit.effects if effect.cause.id == id)
        wheres.setdefault(id, []).append(CAUSES[id].label(place, white.plan, machine))
        moved[id] = np.maximum(moved.get(id, 0.0 * u), np.abs(fit.offsets - offsets))
    return tuple(
        UnshownFault(
            id=id,
            where=" or ".join(filter(None, wheres[id])),
            check=CAUSES[id].words(machine).instrument,
            change=float(change[largest]),
            unit=machine.parameter_units[largest],
            matters=bool(np.any(change > u)),
        )
        for id, change in moved.items()
        for largest in (int(np.argmax(change / u)),)
    )


def _named(
    decision: Decision, alone: Solution, before: HeldOut, after: HeldOut, better: bool
) -> tuple[FoundCause, ...]:
    """The accepted causes; the one without which the data are hardest to explain comes first.

    What can act together with any other comes after it. `better`: what needs no cause predicts
    better, and no shape is recommended.
    """
    white, machine = decision.belief.at.white, decision.belief.at.white.machine
    accepted, listed = decision.fit, decision.belief.listed
    ids, rivals = set(decision.accepted), decision.rivals if decision.wrong else ()
    by_parameters = accepted.columns[:, : accepted.offsets.size]

    def sure(id: str) -> bool:
        """No explanation without this cause needs a fault of the measurement in its place."""
        instead = {other for rival in rivals if id not in rival for other in rival} - ids
        return id == decision.shape or all(CAUSES[other].compensable for other in instead)

    def aliases(id: str) -> Ids:
        """Causes that stand in its place in a rival explanation, or in one of the same remedy."""
        others = (*decision.same_answer(decision.accepted), *rivals)
        instead = (rival for rival in others if ids - {id} <= set(rival) and id not in rival)
        return tuple(
            dict.fromkeys(other for rival in instead for other in rival if other not in ids)
        )

    named = [
        FoundCause(
            id=effect.cause.id,
            probability=listed[decision.accepted],
            where=where,
            parameters=_parameters(white, effect),
            adds_mm=white.rms(unexplained(by_parameters, accepted.columns[:, slot] @ sizes)),
            rms_before_mm=alone.rms_after_mm * unit_of(accepted.effects),
            rms_after_mm=white.rms(accepted.left),
            heldout_before_mm=before.rms_mm,
            heldout_after_mm=after.rms_mm,
            heldout_ratio=after.ratio,
            aliases=aliases(effect.cause.id),
            times_stated=times if times > BEYOND else None,
            remedy=effect.cause.words(machine).advice.format(where=where),
            recommended=(effect.cause.compensable or effect.cause.id in machine.recommended)
            and after.rms_mm < before.rms_mm
            and sure(effect.cause.id)
            and not (better and effect.cause.id == decision.shape),
            in_machine=effect.cause.in_machine,
        )
        for effect, slot in zip(accepted.effects, accepted.slots, strict=True)
        for where in (effect.cause.label(effect.place, white.plan, machine),)
        for sizes in (effect.theta[: slot.stop - slot.start],)
        for times in (effect.times(machine),)
    ]
    single = {cause.id: -decision.belief.hypotheses[(cause.id,)].log_evidence for cause in named}
    return tuple(
        sorted(named, key=lambda cause: (cause.id in machine.companions, single[cause.id]))
    )


def _patterns(decision: Decision, alone: Solution) -> Iterator[FoundPattern]:
    """Patterns beyond the list, those that act together first."""
    if decision.verdict is not Verdict.UNEXPLAINED or decision.refuted is not None:
        return
    best = {pattern.label for pattern in next(iter(decision.beyond_list)).patterns}
    total: dict[str, float] = {}
    first: dict[str, Hypothesis] = {}
    for hypothesis in decision.beyond_list:
        probability = decision.belief.unlisted[hypothesis.label]
        for pattern in (one for one in hypothesis.patterns if one.how not in CAUSES):
            others = tuple(one for one in hypothesis.patterns if one is not pattern)
            first.setdefault(pattern.label, replace(hypothesis, patterns=(*others, pattern)))
            total[pattern.label] = total.get(pattern.label, 0.0) + probability
    for label, last in first.items():
        of_it = alone.measured, total[label], label in best, alone.rms_after_mm
        numbers = described(last, decision.belief, *of_it)
        if numbers is not None:
            yield numbers


def _with_patterns(decision: Decision, measured: Measured) -> tuple[Floats, tuple[int, ...]]:
    """Prediction by the likeliest explanation beyond the list, (n,) [mm], and wrong readings.

    More noise predicts nothing.
    """
    hypothesis = next(iter(decision.beyond_list))
    fit = decision.belief.fit(hypothesis.ids)
    acting = tuple(one for one in hypothesis.patterns if one.how != "scatters")
    left = fit.left
    if acting:
        fits = fits_of(replace(hypothesis, patterns=acting), fit)
        left = np.sum([share * after.left for share, after in fits], axis=0)
    wrong = (place for cause, place in _beside_patterns(decision) if cause.hides_reading)
    return _predicted(decision.belief.at.white, measured, left, fit.effects), sum(wrong, ())


def _beside_patterns(decision: Decision) -> Iterator[tuple[Cause, Place]]:
    """Listed causes of the likeliest explanation beyond the list, and where they act."""
    hypothesis = next(iter(decision.beyond_list))
    for effect in decision.belief.fit(hypothesis.ids).effects:
        yield effect.cause, effect.place
    for one in hypothesis.patterns:
        if one.how in CAUSES:
            placed = hypothesis.at.extras[one.how]
            yield placed.cause, placed.tried[int(one.log_shape.max(axis=1).argmax())]


def _parameters(white: Whitened, effect: Effect) -> tuple[Estimate, ...]:
    """Parameters of a cause; several wrong readings are called by their places."""
    model, cause, place = white.problem.model, effect.cause, effect.place
    sizes = model.called(effect)
    if not cause.hides_reading or len(place) < 2:
        return sizes
    names = (cause.label((row,), white.plan, model.machine) for row in place)
    return tuple(one.changed(name=name) for one, name in zip(sizes, names, strict=True))


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
    white: Whitened, measured: Measured, residual: Floats, effects: Sequence[Effect] = ()
) -> Floats:
    """Prediction of each value by a fit with some effects, in the order of the file, (n,) [mm].

    `residual` is what it leaves of the whitened data, shape (k,) [mm].
    """
    for effect in effects:
        cause, place = effect.cause, effect.place
        if isinstance(cause, RelabelCause) and cause.reversible(white.plan, place):
            residual = white.relabelled(residual, (cause, place))[0] / cause.unit_mm(place)
    return measured.value - white.plain(residual)[white.in_file]


def _of_local_shape(decision: Decision) -> Iterator[Reason]:
    """Size of what stays unexplained where that is the rule, and claims not made."""
    white, accepted = decision.belief.at.white, decision.fit
    if white.texture is None:
        return
    companions = white.machine.companions
    for effect in accepted.effects:
        if effect.cause.id in companions:
            yield Reason.of("remark", text=companions[effect.cause.id])
    unknowns = accepted.offsets.size + sum(e.cause.freedom for e in accepted.effects)
    if len(white) <= unknowns:
        return  # the answer follows anything
    noise = white.machine.instrument.noise_mm
    left = white.rms(accepted.left)
    beyond = float(np.sqrt(max(left**2 - noise**2, 0.0)))
    yield Reason.of("local_residual", left_mm=left, noise_mm=min(noise, left), beyond_mm=beyond)


def _notes(decision: Decision, measured: Measured) -> Iterator[Reason]:
    yield from notes_on(measured)
    machine = decision.belief.at.white.machine
    for id, spread in machine.doubted.items():
        lengths = machine.nominal_rails.lengths.tolist()
        yield Reason.of(f"doubted_{id}", lengths_mm=lengths, spread_mm=spread)
    causes = [effect.cause for effect in decision.fit.effects]
    listed, unlisted = decision.belief.listed, decision.belief.unlisted
    accepted, raw = decision.accepted, decision.belief.at.white.raw
    if decision.not_excluded:
        yield Reason.of("not_excluded", ids=decision.not_excluded)
    if decision.verdict is Verdict.UNEXPLAINED:
        best, white = decision.best, decision.belief.at.white
        for cause, place in _beside_patterns(decision) if decision.refuted is None else ():
            where = cause.label(place, white.plan, white.machine)
            yield Reason.of("acts_too", id=cause.id, where=where)
        if len(best) > 1 and listed[best] >= DISMISSED * max(unlisted.values()):
            yield Reason.of("two_would_follow", ids=best)
    if decision.verdict is Verdict.AMBIGUOUS:
        for ids in decision.rivals:
            if set(accepted) < set(ids):
                yield Reason.of("perhaps_also", ids=[id for id in ids if id not in accepted])
    for part in (ids for ids in listed if ids and set(ids) < set(accepted)):
        if decision.is_open(part):
            others = [id for id in accepted if id not in part]
            yield Reason.of("perhaps_alone", id=part[0], others=others, probability=listed[part])
    if causes and not raw:
        unknowns, count = sum(len(cause.names) for cause in causes), len(measured)
        yield Reason.of("few_differences", count=count, spare=count - 3, unknowns=unknowns)
    if raw and any(isinstance(cause, PatternCause) for cause in causes):
        yield Reason.of("measure_again")
