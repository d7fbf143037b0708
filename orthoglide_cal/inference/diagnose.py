"""Lead from what was measured to a verdict on the model, and to a model extended by a cause.

A diagnosis is the decision about one data set with what follows from it: parameters and their
uncertainty, causes and patterns with size and gain, and what later readings say of them.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property
from itertools import chain
from types import MappingProxyType

import numpy as np
from scipy.special import fdtrc

from orthoglide_cal.causes import CAUSES, UNLISTED
from orthoglide_cal.errors import PostureError, UnusableResultError, command
from orthoglide_cal.estimation.budget import Budget, Contribution, Scatter, budget_of
from orthoglide_cal.estimation.gaussian import mixture, unexplained
from orthoglide_cal.estimation.solution import (
    Solution,
    chance_of_residual,
    fitted_here,
    scatter_of_repeats,
    suspicious,
)
from orthoglide_cal.inference.alone import solution_of, solve, weighing
from orthoglide_cal.inference.data import Candidates, Ids, Linearised, Whitened, unit_of
from orthoglide_cal.inference.decision import Decision, keep_ratio
from orthoglide_cal.inference.fit import (
    LARGEST,
    MISFIT,
    Fit,
    HeldOut,
    fit_hypothesis,
    leave_out,
    left_out,
)
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.inference.patterns import PASSING, describe, fits_of, residual_of
from orthoglide_cal.inference.prediction import REPEATS, Later, baselines, repeats
from orthoglide_cal.inference.result import (
    WORTH_SAYING,
    AssumedSize,
    Baselines,
    Explanation,
    FoundCause,
    FoundPattern,
    LackOfFit,
    Noise,
    Otherwise,
    Parameter,
    TimesStated,
    UnshownFault,
    Verdict,
)
from orthoglide_cal.losses import DISMISSED, FALSE_RELEASE, MISSED_CHANGE, is_likely, surprising
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.model.measured import Differences, Measured, Readings, notes_on
from orthoglide_cal.model.model import NORMAL_K, Cause, Effect, Model, Place
from orthoglide_cal.model.plan import Floats, read_only
from orthoglide_cal.schema import Reason

# Tolerances with which it is asked whether the answer depends on them, by what was done to them.
SCALED = {"halved": 0.5, "doubled": 2.0}
# Limits of effort: no place less probable than this is looked at, no more than so many.
PLACE_COUNTS, PLACES = 0.002, 6
# A cause that many times its plausible size is beyond it; for the search for one of any size.
BEYOND, ANY_SIZE = 3.0, 1e3


@dataclass(frozen=True, eq=False)
class Diagnosis(Decision):
    """A decision with what follows from it."""

    # Errors of predicting readings that were not fitted, without the causes and with them; None
    # where nothing was to be predicted.
    held_out: tuple[HeldOut, HeldOut] | None = None
    # Of a printer, what the extension is compared with; None where it was not asked.
    baselines: Baselines | None = None
    # With all tolerances "halved" and "doubled"; None if it was not asked for, or nothing is wrong.
    sensitivity: Mapping[str, Otherwise] | None = None
    remarks: tuple[Reason, ...] = ()  # on other dates, and on the held-out data

    # --- the fits behind it ---

    @property
    def carried(self) -> Fit:
        """The fit of what lasts, to be carried to other days."""
        return self._carried(self.best if self.verdict is Verdict.UNEXPLAINED else self.accepted)

    def _carried(self, ids: Ids) -> Fit:
        """The same of a set; of readings of one plane a shape, whatever makes it, and motions."""
        if (self.shape,) in self.hypotheses:
            beside = (id for id in ids if not CAUSES[id].repeats)
            ids = tuple(sorted((self.shape, *beside)))
            ids = ids if ids in self.hypotheses else (self.shape,)
        return self.fit_of(ids)

    def refutation(self, later: Later) -> Reason | None:
        """Return how later readings refute all sets that are named or left open, if they do."""
        sets = (self.accepted, *(self.rival_sets if self.verdict is Verdict.AMBIGUOUS else ()))
        if not all(any(CAUSES[id].lasting for id in ids) for ids in sets):
            return None  # something else may have acted that day
        nothing = self.fit_of(())
        reasons = [later.refute(ids, self._carried(ids), nothing) for ids in sets]
        return reasons[0] if all(reasons) else None

    @cached_property
    def alone(self) -> Solution:
        """The calibrated parameters alone."""
        measured, model = self.measured, self.model
        if self.white.raw and self.at.complete and not fitted_here(measured, model):
            return solution_of(self.fit_of(()), measured, model)
        return solve(measured, model)

    def alone_with(self, scale_factor: float) -> Fit:
        """The fit of the same with a local shape so many times as large as stated."""
        fit, nothing = self.fit_of(()), self.hypotheses[()]
        return fit if fit.scale_factor == scale_factor else fit_hypothesis(nothing, scale_factor)

    @cached_property
    def left_open(self) -> tuple[tuple[float, Fit], ...]:
        """The explanations that the data leave open, the accepted one first, and their shares."""
        if self.verdict is Verdict.UNEXPLAINED:
            return self.patterned_fits
        sets = [self.accepted, *self.same_answer(self.accepted)]
        if self.verdict is Verdict.AMBIGUOUS:
            sets += self.rival_sets
        elif self.verdict is Verdict.CONSISTENT:
            sets += self.hidden()
        weights = np.array([self.listed[ids] for ids in sets])
        weights /= weights.sum()
        return tuple(zip(weights.tolist(), map(self.fit_of, sets), strict=True))

    @cached_property
    def silent_fits(self) -> Mapping[str, list[tuple[float, Fit]]]:
        """Faults of the record besides the named causes that these data would not show, by id.

        At each place its share next to what is left open, and its fit.
        """
        if self.verdict is not Verdict.NAMED or not self.wrong:
            return {}
        fits, best = dict[str, list[tuple[float, Fit]]](), self.accepted
        total = self.share((best, *self.same_answer(best)))
        for ids in self.silent:
            # To keep any other place open would cost more than to be wrong.
            least, share = keep_ratio(ids, best), self.listed[ids] / total
            placed = fits_at_places(self.hypotheses[ids], share, least)
            fits |= dict.fromkeys(set(ids) - set(best), placed)
        return fits

    @cached_property
    def beyond_tolerance(self) -> tuple[TimesStated, ...]:
        """Causes that would explain what is unexplained, how many times their size."""
        if self.verdict is not Verdict.UNEXPLAINED:
            return ()
        explaining = []
        for cause in self.at.candidates.broad:
            try:
                fit = fit_hypothesis(replace(self.hypotheses[cause.id,], scale=ANY_SIZE))
            except PostureError:  # no machine of any size is like that
                continue
            times = fit.effects[0].times(self.white.machine)
            if times > BEYOND and round(times) <= LARGEST and self._leaves_noise(fit):
                explaining.append((float(fit.residual @ fit.residual), cause.id, times))
        return tuple(TimesStated(id=id, times=times) for _, id, times in sorted(explaining))

    # --- the parameters ---

    @cached_property
    def offsets(self) -> tuple[Floats, Floats]:
        """Offsets (3,) [mm] and their covariance (3, 3) [mm²], over all that is left open."""
        shares, fits = zip(*self.left_open, strict=True)
        values, spreads = zip(*((fit.offsets, fit.offsets_covariance) for fit in fits), strict=True)
        mean, covariance = mixture(shares, values, spreads)
        if self.verdict is Verdict.UNEXPLAINED and not self.described:
            # What may return with its posture, in each cell as large as what is left: repeats
            # cannot average it out.
            white, fit = self.white, fits[0]
            left = float(fit.residual @ fit.residual) / max(len(white) - mean.size, 1)
            cells, returning = fit.estimator(fit.sigma) @ white.matrix, white.plan.returning
            cells = cells @ returning if returning.size else cells
            covariance = covariance + left * cells @ cells.T
        return read_only(mean), read_only(covariance)

    @property
    def stays_entered(self) -> bool:
        """True if under every explanation left open to enter nothing costs less than a correction.

        Its offsets do not differ (χ²) from those that are entered by what had better be corrected.
        """
        rows = ((fit.offsets, fit.offsets_covariance) for _, fit in self.left_open)
        far = [float(offsets @ np.linalg.solve(spread, offsets)) for offsets, spread in rows]
        chance = chance_of_residual(max(far), self.offsets_mm.size, 1.0)
        return chance >= surprising(UNLISTED / (1.0 - UNLISTED), MISSED_CHANGE, self.needless_hold)

    @property
    def offsets_mm(self) -> Floats:
        """The offsets, shape (3,)."""
        return self.offsets[0]

    @property
    def covariance_mm2(self) -> Floats:
        """Their covariance, shape (3, 3)."""
        return self.offsets[1]

    @property
    def std_mm(self) -> Floats:
        """Their standard deviations, shape (3,)."""
        return np.sqrt(np.diag(self.covariance_mm2))

    @property
    def budget(self) -> Budget:
        """Their uncertainty by source; what causes, then the verdict, leave open comes last."""
        (_, fit), *_ = self.left_open
        gauge, scatter = self.model.machine.instrument, Scatter(fit.sigma, np.inf)
        budget = budget_of(fit.estimator(fit.sigma), gauge, scatter, fit.uncertain)
        causes = " and ".join(e.cause.id for e in fit.effects if e.covariance is not None)
        beyond = [(causes, fit.offsets_covariance)] if causes else []
        for source, covariance in (*beyond, (Origin.EXPLANATIONS, self.covariance_mm2)):
            left = Contribution.beyond(source, covariance - budget.covariance_mm2)
            budget = budget.extended([left])
        return budget

    def adds_to(self, solution: Solution) -> tuple[Contribution, ...]:
        """Contributions to the uncertainty of a solution's offsets for these data, by cause.

        Each explanation by its share: how far it moves the offsets, and how much it widens them.
        """
        least, fits = solution.budget.covariance_mm2, self.left_open
        if self.verdict is Verdict.UNEXPLAINED:
            return (Contribution.beyond(Origin.EXPLANATIONS, self.covariance_mm2 - least),)
        consistent = self.verdict is Verdict.CONSISTENT
        if consistent:
            (_, alone), *others = fits
            least, fits = alone.offsets_covariance, tuple(others)
        contributions = []
        for share, fit in fits:
            apart = fit.offsets - solution.offsets_mm
            spread = share * (fit.offsets_covariance - least + np.outer(apart, apart))
            contributions.append(
                Contribution.beyond(" and ".join(fit.ids), spread, possible=consistent)
            )
        return tuple(contributions)

    # --- the causes ---

    @cached_property
    def causes(self) -> tuple[FoundCause, ...]:
        """The accepted causes; the one without which the data are hardest to explain comes first.

        What can act together with any other comes after it.
        """
        if self.held_out is None:
            return ()
        white, machine, fit, ids = self.white, self.model.machine, self.fit, set(self.accepted)
        (before, after), unit = self.held_out, unit_of(fit.effects)
        rivals = self.rival_sets if self.wrong else ()
        same, single = self.same_answer(self.accepted), self.hypotheses
        order = sorted(
            self.accepted, key=lambda id: (id in machine.companions, -single[id,].log_evidence)
        )
        alike = {tuple(order): self.listed[self.accepted]} | {one: self.listed[one] for one in same}
        by_parameters = fit.columns[:, : fit.offsets.size]
        # What needs no cause may predict better: then no shape is recommended.
        better = self.baselines is not None and self.baselines.better is not None
        causes = []
        for effect, slot in zip(fit.effects, fit.slots, strict=True):
            cause, id, parameters = effect.cause, effect.cause.id, self.model.called(effect)
            where, times = cause.label(effect.place, white.plan, machine), effect.times(machine)
            if cause.hides_reading and len(effect.place) > 1:
                # Several wrong readings are called by their places.
                parameters = tuple(
                    one.changed(name=cause.label((row,), white.plan, machine))
                    for one, row in zip(parameters, effect.place, strict=True)
                )
            adds = fit.columns[:, slot] @ effect.theta[: slot.stop - slot.start]
            # Causes that stand in its place in a rival explanation, or in one of the same remedy.
            lacking = (rival for rival in (*same, *rivals) if id not in rival)
            instead = [rival for rival in lacking if ids - {id} <= {*rival}]
            aliases = dict.fromkeys(other for rival in instead for other in rival)
            # An explanation without it may need a fault of the measurement in its place.
            others = {other for rival in rivals if id not in rival for other in rival} - ids
            sure = id == self.shape or all(CAUSES[other].compensable for other in others)
            taken = cause.compensable or id in machine.recommended
            gains = after.rms_mm < before.rms_mm and not (better and id == self.shape)
            causes.append(
                FoundCause(
                    id=id,
                    probability=self.listed[self.accepted],
                    where=where,
                    parameters=parameters,
                    adds_mm=white.rms(unexplained(by_parameters, adds)),
                    rms_before_mm=self.alone.rms_after_mm * unit,
                    rms_after_mm=white.rms(fit.left),
                    heldout_before_mm=before.rms_mm,
                    heldout_after_mm=after.rms_mm,
                    heldout_ratio=after.ratio,
                    aliases=tuple(other for other in aliases if other not in ids),
                    alike=alike,
                    times_stated=times if times > BEYOND else None,
                    remedy=Reason.of("advice", id=id, where=where),
                    recommended=taken and gains and sure,
                    in_machine=cause.in_machine,
                )
            )
        return tuple(sorted(causes, key=lambda one: order.index(one.id)))

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The accepted causes as fitted to these data, in the order of `causes`."""
        effects = {effect.cause.id: effect for effect in self.fit.effects}
        return tuple(effects[cause.id] for cause in self.causes)

    @cached_property
    def unshown(self) -> tuple[UnshownFault, ...]:
        """Faults of the record that would not show besides the named causes, at all places."""
        plan, machine, shown = self.white.plan, self.model.machine, []
        for id, fits in self.silent_fits.items():
            effects = (effect for _, fit in fits for effect in fit.effects if effect.cause.id == id)
            wheres = (effect.cause.label(effect.place, plan, machine) for effect in effects)
            change = np.max([np.abs(fit.offsets - self.offsets_mm) for _, fit in fits], axis=0)
            largest = int(np.argmax(ratio := change / (NORMAL_K * self.std_mm)))
            shown.append(
                UnshownFault(
                    id=id,
                    where=" or ".join(filter(None, wheres)),
                    check=Reason.of("check", id=id),
                    change=float(change[largest]),
                    unit=machine.parameter_units[largest],
                    matters=bool(ratio[largest] > 1.0),
                )
            )
        return tuple(shown)

    @property
    def undecided(self) -> bool:
        """True if the offsets depend on what these data leave open, or would not show."""
        return self.verdict is Verdict.AMBIGUOUS or any(fault.matters for fault in self.unshown)

    @property
    def by_place(self) -> tuple[tuple[float, Fit], ...]:
        """Fits that are left open; of several each fault at every place where it may be.

        Also patterns that make it too costly to name the best cause, and faults that would not
        show but matter.
        """
        if self.verdict is Verdict.AMBIGUOUS:
            placed = (
                fits_at_places(fit.hypothesis, share, PLACE_COUNTS) for share, fit in self.left_open
            )
            unit = self.left_open[0][0] / self.listed[self.best]
            beyond = (
                (unit * self.unlisted[one.label] * share, replace(fit, hypothesis=one))
                for one in (() if self.is_nameable else self.beyond_list)
                if self.loss_of_name(self.best, one)
                for share, fit in fits_of(one, self.fit_of(one.ids))
            )
            return (*chain(*placed), *beyond)
        matter = (self.silent_fits[fault.id] for fault in self.unshown if fault.matters)
        return (*self.left_open, *chain(*matter))

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """States that are not dismissed, best first; those left open with their parameters."""
        fits = {fit.hypothesis.ids: fit for _, fit in self.left_open if not fit.patterns}
        least = DISMISSED * max(self.probability.values())
        # What is open is compared with the parameters alone, however improbable.
        sound = WORTH_SAYING * (self.verdict in (Verdict.CONSISTENT, Verdict.NAMED))
        explanations = []
        for key, probability in self.probability.items():
            fit = fits.get(key) if isinstance(key, tuple) else None
            if fit is None and probability < (least if key else sound):
                continue
            ids, pattern = (key, None) if isinstance(key, tuple) else ((), key)
            explanation = Explanation(ids=ids, pattern=pattern, probability=probability)
            if fit is not None:
                std = np.sqrt(np.diag(fit.offsets_covariance))
                explanation = explanation.changed(
                    rms_mm=self.white.rms(fit.left) if ids else None,
                    parameters=Parameter.all_of(self.model, fit.offsets, std, NORMAL_K),
                    sizes={effect.cause.id: self.model.called(effect) for effect in fit.effects},
                )
            explanations.append(explanation)
        return tuple(explanations)

    @property
    def assumed_sizes(self) -> tuple[AssumedSize, ...]:
        """Size of each cause that was tried at its default: the machine file gives none."""
        machine, tried = self.model.machine, {id for ids in self.hypotheses for id in ids}
        return tuple(
            AssumedSize(id=id, size=cause.size(machine), unit=cause.unit)
            for id, cause in CAUSES.items()
            if id in tried and cause.assumed(machine)
        )

    def extend(self, id: str, on: date) -> Model:
        """The model with one more accepted cause, and that date noted.

        Raises:
            UnusableResultError: these data do not support it, or it is not recommended, the machine
                file rules it out, or it lies in the measurement; with what to do instead.
        """
        cause, accepted = CAUSES[id], self.accepted
        if not cause.lasting:
            raise UnusableResultError(
                f"{id} lies in the measurement, not in the machine: it cannot be accepted.",
                "Correct it, and measure again.",
            )
        if not cause.possible(self.model.machine):
            raise UnusableResultError(
                f"The machine file rules {id} out: its size under tolerances is 0.",
                "Give it a size there if the machine may have it.",
            )
        if any(named.id == id and not named.recommended for named in self.causes):
            raise UnusableResultError(
                f"Making {id} part of the machine's model is not recommended: it does not last as"
                f" it is, does not predict better than {self.model.machine.vocabulary.many} only,"
                " or something else explains these data as well.",
                f"See what helps: {command('guide', id)}",
            )
        if not accepted:
            raise UnusableResultError(
                f"These data are {self.verdict}: they do not support {id} as an extension.",
                "See what diagnose says about them.",
            )
        # Faults of the measurement that stand in its place in an explanation without it; those that
        # hold it may differ in what else was wrong with the measurement.
        sets = (accepted, *self.rival_sets)
        shared = set.intersection(*map(set, sets))
        others = dict.fromkeys(other for ids in sets for other in ids if other not in (id, *shared))
        doubtful = [other for other in others if not CAUSES[other].in_machine]
        if self.verdict is Verdict.AMBIGUOUS and id not in shared and doubtful:
            raise UnusableResultError(
                f"These data do not distinguish what lies in the machine from"
                f" {', '.join(doubtful)}, which lies in the measurement.",
                "Take the reading that diagnose names, then accept.",
            )
        best = next((ids for ids in self.listed if id in ids), ())
        if not best or not (best == accepted or self.is_open(best)):
            raise UnusableResultError(
                f"These data contradict {id}.", f"They name {', '.join(accepted)}."
            )
        (effect,) = (one for one in self.fit_of(best).effects if one.cause.id == id)
        source, model = self.measured.source, self.model
        total = replace(effect, theta=model.total(effect)).accepted(on.isoformat(), source.sha256)
        model = model.extended([total]).correcting(model.machine.corrected)
        if source.simulated:  # what is accepted from it is no knowledge of a machine
            return replace(model, machine=model.machine.changed(practice=True))
        return model

    # --- patterns beyond the list, those that act together first ---

    @cached_property
    def _fits_beyond(self) -> Mapping[str, list[tuple[float, Fit]]]:
        """Fits with the patterns of each of these explanations and their shares, by its label."""
        return {one.label: fits_of(one, self.fit_of(one.ids)) for one in self.beyond_list}

    @property
    def patterned_fits(self) -> tuple[tuple[float, Fit], ...]:
        """All of them and their shares, the likeliest first."""
        pairs = ((p, self._fits_beyond[one.label]) for one, p in self.beyond_list.items())
        return tuple((p * share, fit) for p, fits in pairs for share, fit in fits)

    def _left_under(self, one: Hypothesis) -> Floats:
        """Remainder of the data under one of these explanations, shape (k,) [mm]."""
        return residual_of(one, self.fit_of(one.ids), self._fits_beyond[one.label])

    @cached_property
    def patterned_left(self) -> Floats:
        """Remainder under all of them, by their shares, shape (k,) [mm]."""
        return read_only(sum(p * self._left_under(one) for one, p in self.beyond_list.items()))

    @property
    def enterable(self) -> bool:
        """True if to enter the offsets costs less than to look for what may falsify them."""
        known = all(self.model.machine.determined(NORMAL_K * self.std_mm))
        return known and not is_likely(self._unmoved, FALSE_RELEASE, self.needless_hold)

    @property
    def _unmoved(self) -> float:
        """Probability that what acts moves the offsets alone by less than U.

        What is not listed has to pass, and to leave no more than noise.
        """
        if self.verdict is Verdict.AMBIGUOUS:
            shares, fits = zip(*self.by_place, strict=True)
            u = NORMAL_K * np.min([np.sqrt(np.diag(f.offsets_covariance)) for f in fits], axis=0)
            moved = [np.abs(fit.offsets - self.alone.offsets_mm) for fit in fits]
            return float(np.dot(shares, np.all(moved <= u, axis=1)) / sum(shares))
        probability = 0.0
        for one, share in self.beyond_list.items() if self.described else ():
            unlisted = [pattern for pattern in one.patterns if pattern.how not in CAUSES]
            if {pattern.how for pattern in unlisted} <= PASSING:
                alone = self.patterned[", ".join(pattern.label for pattern in unlisted)]
                offsets, covariance = self._offsets_under(alone), self.offsets[1]
                unmoved = alone is one or not self._moves(one, offsets, covariance)
                probability += share * self.beyond * unmoved
        return probability

    @property
    def described(self) -> bool:
        """True if the likeliest pattern leaves no more than noise, and nothing else was refuted."""
        return self.refuted is None and self._leaves_noise(self.patterned_fits[0][1])

    @cached_property
    def patterns(self) -> tuple[FoundPattern, ...]:
        """The patterns themselves; none unless the verdict is that something beyond it acts."""
        if self.verdict is not Verdict.UNEXPLAINED or self.refuted is not None:
            return ()
        holding = dict[str, list[Hypothesis]]()  # by the label of each pattern
        for hypothesis in self.beyond_list:
            for pattern in hypothesis.patterns:
                if pattern.how not in CAUSES:
                    holding.setdefault(pattern.label, []).append(hypothesis)
        likeliest, before_mm, patterns = next(iter(self.beyond_list)), self.alone.rms_after_mm, []
        for label, (first, *others) in holding.items():
            fit, last = self.fit_of(first.ids), lambda one, label=label: one.label == label
            with_it_last = replace(first, patterns=tuple(sorted(first.patterns, key=last)))
            share = sum(self.unlisted[one.label] for one in (first, *others))
            acting = first is likeliest
            left = self.patterned_left if acting else self._left_under(first)
            known = share, acting, before_mm, self.white.rms(left)
            patterns.append(describe(with_it_last, fit, self.measured, *known))
        return tuple(filter(None, patterns))

    @property
    def acting(self) -> tuple[FoundPattern, ...]:
        """Patterns of the likeliest explanation."""
        return tuple(pattern for pattern in self.patterns if pattern.accepted)

    def _beside_patterns(self) -> Iterator[tuple[Cause, Place]]:
        """Listed causes of the likeliest explanation beyond the list, and where they act."""
        if self.verdict is not Verdict.UNEXPLAINED or self.refuted is not None:
            return
        hypothesis = next(iter(self.beyond_list))
        for effect in self.fit_of(hypothesis.ids).effects:
            yield effect.cause, effect.place
        for one in hypothesis.patterns:
            if one.how in CAUSES:
                placed = hypothesis.at.extras[one.how]
                yield placed.cause, placed.tried[int(one.log_shape.max(axis=1).argmax())]

    # --- the data under it ---

    @cached_property
    def explained_mm(self) -> Floats:
        """Prediction of the accepted model, or with patterns, shape (n,)."""
        if not (self.acting or self.accepted):
            return self.alone.predicted_mm
        white, hypothesis = self.white, self.fit.hypothesis
        if self.acting:
            hypothesis = next(iter(self.beyond_list))
        fit = self.fit_of(hypothesis.ids)
        left = self.patterned_left if self.acting else fit.left
        for effect in fit.effects:
            cause, place = effect.cause, effect.place
            if cause.exchanges and cause.reversible(white.plan, place):
                left = white.relabelled(left, (cause, place))[0] / cause.unit_mm(place)
        return read_only(self.measured.value - white.plain(left)[white.in_file])

    @property
    def wrong_readings(self) -> tuple[int, ...]:
        """Indices of wrong readings, by what explains these data best."""
        if not self.acting:
            return self.fit.wrong_readings
        return sum((place for cause, place in self._beside_patterns() if cause.hides_reading), ())

    @property
    def put_right(self) -> Measured:
        """The data without the named faults, and the patterns, that belong to this session alone.

        Differences stay as they are, as do readings in which a fault cannot be undone.
        """
        measured = self.measured
        if isinstance(measured, Differences):
            return measured
        value, machine = measured.value, self.model.machine
        for effect in self.effects if self.verdict is Verdict.NAMED else ():
            if not effect.cause.lasting:
                value = effect.cause.inverted(value, effect, measured.plan, machine)
        for pattern in self.acting:
            if pattern.how in PASSING:
                value = value - np.array(pattern.effect_mm)
        return measured if value is measured.value else replace(measured, value=value)

    @property
    def unsure_mm(self) -> Floats:
        """Standard deviation of each reading besides its noise, shape (n,), or (1,) where none."""
        more = [one.effect_expanded_mm for one in self.acting if one.how == "scatters"]
        known = [np.array(expanded) for expanded in more if expanded]
        return read_only(np.linalg.norm(known or np.zeros((1, 1)), axis=0) / NORMAL_K)

    @cached_property
    def lack_of_fit(self) -> LackOfFit:
        """Test of the parameters alone; a bed's local shape as large as it is found."""
        alone, gauge = self.alone, self.model.machine.instrument
        size = alone.scatter.sigma_mm if alone.scatter else 0.0
        dof, p_value = alone.dof, alone.lack_of_fit_p
        if self.white.texture is not None:
            as_stated = self.verdict is Verdict.UNEXPLAINED
            fit = self.alone_with(1.0 if as_stated else self.fit.scale_factor)
            p_value = self.chance(fit)
            size = math.sqrt(fit.square / dof) if dof else 0.0
        repeats, chance, measured = None, None, self.measured
        if isinstance(measured, Readings):
            repeats = scatter_of_repeats(measured.plan, measured.value)
        if repeats is not None and repeats.sigma_mm > 0.0 and dof > repeats.dof:
            lack = max(dof * size**2 - repeats.dof * repeats.sigma_mm**2, 0.0) / (dof - repeats.dof)
            chance = float(fdtrc(dof - repeats.dof, repeats.dof, lack / repeats.sigma_mm**2))
        left = alone.rms_after_mm
        return LackOfFit(
            statistic=dof * size**2 / gauge.noise_mm**2,
            dof=dof,
            p_value=p_value,
            repeats_p_value=chance,
            left_mm=left,
            # The fit takes a part of the noise away, too.
            expected_mm=gauge.noise_mm * (left / size if size else 1.0),
            suspicious=suspicious(self.model.machine),
            noise=Noise(
                used_mm=alone.noise.sigma_mm,
                repeats_mm=repeats and repeats.sigma_mm,
                residuals_mm=size if dof else None,
                stated_mm=gauge.noise_mm,
                floor_mm=gauge.rounding_mm,
                dof=alone.dof,
            ),
        )

    @property
    def notes(self) -> Iterator[Reason]:
        """Remarks: the data, listed causes with patterns, what is open, other dates.

        Last what stays unexplained of a local shape, where that is the rule, and claims not made.
        """
        yield from notes_on(self.measured)
        white, machine = self.white, self.model.machine
        accepted, fit = self.accepted, self.fit
        for id, spread in machine.doubted.items():
            lengths = machine.nominal_rails.lengths.tolist()
            yield Reason.of(f"doubted_{id}", lengths_mm=lengths, spread_mm=spread)
        if self.not_excluded:
            yield Reason.of("not_excluded", ids=self.not_excluded)
        for cause, place in self._beside_patterns():
            rows = [(row,) for row in place] if cause.hides_reading else [place]
            wheres = (cause.label(row, white.plan, machine) for row in rows)
            yield from (Reason.of("acts_too", id=cause.id, where=where) for where in wheres)
        if self.verdict is Verdict.UNEXPLAINED:
            best, least = self.best, DISMISSED * max(self.unlisted.values())
            if len(best) > 1 and self.listed[best] >= least:
                yield Reason.of("two_would_follow", ids=best)
        if self.verdict is Verdict.AMBIGUOUS:
            for ids in self.rival_sets:
                if set(accepted) < set(ids):
                    yield Reason.of("perhaps_also", ids=[id for id in ids if id not in accepted])
        for part, probability in self.listed.items():
            if part and set(part) < set(accepted) and self.is_open(part):
                others = [id for id in accepted if id not in part]
                yield Reason.of("perhaps_alone", id=part[0], others=others, probability=probability)
        causes = [effect.cause for effect in fit.effects]
        if causes and not white.raw:
            count, unknowns = len(self.measured), sum(len(cause.names) for cause in causes)
            spare = count - fit.offsets.size
            yield Reason.of("few_differences", count=count, spare=spare, unknowns=unknowns)
        if white.raw and any(cause.placed and not cause.exchanges for cause in causes):
            yield Reason.of("measure_again")
        yield from self.remarks
        if white.texture is None:
            return
        for cause in causes:
            if cause.id in machine.companions:
                yield Reason.of("companion", id=cause.id)
        # Otherwise the answer follows anything.
        if len(white) > fit.offsets.size + sum(cause.freedom for cause in causes):
            noise, left = machine.instrument.noise_mm, white.rms(fit.left)
            if left > noise:
                sizes = {"left_mm": left, "noise_mm": noise}
                yield Reason.of("local_residual", **sizes, beyond_mm=math.sqrt(left**2 - noise**2))


def fits_at_places(hypothesis: Hypothesis, share: float, least: float) -> list[tuple[float, Fit]]:
    """Fits of a hypothesis at the likeliest places of its extra, which divide its share.

    No more than `PLACES`, and none with a share below `least` but the likeliest.
    """
    extra, by_place = hypothesis.extra, hypothesis.by_place
    if extra is None or by_place is None:
        return [(share, fit_hypothesis(hypothesis))]
    placed = hypothesis.at.extras[extra.cause.id]
    likeliest = np.argsort(-by_place, kind="stable")[:PLACES]
    least = min(least / max(share, least), by_place.max())
    kept = likeliest[by_place[likeliest] >= least]
    parts = share * by_place[kept] / by_place[kept].sum()
    alone = replace(hypothesis, by_place=None)
    return [
        (part, fit_hypothesis(replace(alone, extra=placed.numbered(number))))
        for part, number in zip(parts.tolist(), kept.tolist(), strict=True)
    ]


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
        holdout: later data that no fit may see.
        applied: offsets entered in the controller before these, shape (3,) [mm].
        then: the model at that time; None for the same.
        sensitivity: also judge with all tolerances halved and doubled, unless all is well.
        recalibrated: the machine was calibrated again before; models may say so.

    Raises UnusableResultError: the data do not determine the offsets, or cannot be weighed.
    """

    def otherwise(factor: float) -> Otherwise:
        scaled = diagnosis.scaled(factor).settled()
        return Otherwise(verdict=scaled.verdict, ids=scaled.accepted)

    diagnosis, machine, remarks = decided(measured, model), model.machine, list[Reason]()
    white, nothing, accepted = diagnosis.white, diagnosis.fit_of(()), diagnosis.fit
    wrong = accepted.wrong_readings
    later, held_out, baseline, changes = None, None, None, None
    if holdout is not None:
        changed = machine.differing(then.machine) if then is not None else ()
        known = then if then is not None and changed else model
        entered = np.zeros(len(machine.parameter_names))
        entered[: len(applied)] = applied
        later = Later(Whitened.of(holdout, known), machine, entered)
        if recalibrated or changed:
            later = replace(later, free=entered.size)
            remarks.append(Reason.of("recalibrated", changed=changed))
        elif (shift := later.moved_origin(diagnosis.carried)) is not None:
            later = replace(later, free=len(shift))
            names, units = machine.parameter_names, machine.parameter_units
            moves = [*zip(names, shift.tolist(), units, strict=False)]
            remarks.append(Reason.of("origin_moved", moves=moves))
    again = repeats(white, later)
    if again is not None and again > REPEATS:
        remarks.append(Reason.of("maps_repeat", correlation=again))
    touched = bool(white.plan.touches.any())
    if accepted.effects or (touched and (sensitivity or later)):
        before, after = (
            later.held_out(fit) if later else leave_out(fit, left_out(white, wrong))[2]
            for fit in (nothing, diagnosis.carried)
        )
        # Whoever adjusted the machine may have removed what acted before.
        if later and not later.entered.any():
            diagnosis = replace(diagnosis, refuted=diagnosis.refuted or diagnosis.refutation(later))
        # Without the cause the errors are in the unit that was written down, too.
        unit = 1.0 if later else unit_of(diagnosis.fit.effects)
        held_out = replace(before, rms_mm=before.rms_mm * unit), after
        if touched:
            before_mm, after_mm = (held.rms_mm for held in held_out)
            errors = {"parameters_mm": before_mm, "extension_mm": after_mm, "repeats": again}
            baseline = Baselines(**errors, **baselines(white, later))
    if sensitivity and diagnosis.verdict is not Verdict.CONSISTENT:
        changes = MappingProxyType({name: otherwise(by) for name, by in SCALED.items()})
    if not (held_out or changes or remarks):
        return diagnosis  # with all that was worked out of it
    return replace(
        diagnosis,
        held_out=held_out,
        baselines=baseline,
        sensitivity=changes,
        remarks=tuple(remarks),
    )


def decided(measured: Measured, model: Model) -> Diagnosis:
    """Decide what the data say; maps of several dates that repeat are no noise.

    A name has to predict what is left out of its fit, and each date from those before it. Raises
    UnusableResultError: the data do not determine the offsets, or cannot be weighed.
    """
    with weighing(model.machine):
        decision = Diagnosis.about(measured, model).settled()
        white = decision.white
        again = repeats(white)
        if again is not None and again > REPEATS:
            decision = replace(decision, repeats=True)
        verdict, fit = decision.verdict, decision.fit
    if verdict is not Verdict.NAMED:
        return decision
    held = leave_out(fit, left_out(white, fit.wrong_readings))[2]
    if held.chance >= MISFIT:
        refuted = _refuted_by_date(decision)
        return replace(decision, refuted=refuted) if refuted else decision
    sizes = {"error_mm": held.rms_mm, "stated_mm": held.rms_mm / held.ratio}
    return replace(decision, refuted=Reason.of("refuted_left_out", ids=decision.accepted, **sizes))


def _refuted_by_date(diagnosis: Diagnosis) -> Reason | None:
    """Return how a date refutes what lasts of a name, predicted from those before it.

    The parameters are others on each date.
    """
    fit, measured, model = diagnosis.carried, diagnosis.measured, diagnosis.model
    entered = 0.0 * fit.offsets
    lasting = tuple(cause for cause in fit.hypothesis.base if cause.lasting)
    if not isinstance(measured, Readings) or not lasting:
        return None
    for day in np.unique(measured.plan.date)[1:]:
        parts = measured.plan.date < day, measured.plan.date == day
        earlier, dated = (Whitened.of(measured.subset(part), model) for part in parts)
        later = Later(dated, model.machine, entered, entered.size)
        at = Linearised.of(earlier, Candidates(lasting, (), (), {}))
        bases = (Hypothesis(at, 0.0, base, fit.hypothesis.scale) for base in (lasting, ()))
        if refuted := later.refute(diagnosis.accepted, *map(fit_hypothesis, bases)):
            return refuted
    return None
