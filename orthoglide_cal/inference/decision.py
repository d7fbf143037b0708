"""Hypotheses about one data set with their probabilities, and what to do: least expected loss.

A probability follows from prior weight and evidence by Bayes' rule: of a set of listed causes, or
of patterns beyond the list; the evidence is that of the nonlinear fit where one was made, else the
linear one. A technician is told that nothing is wrong, a name, several answers that are left open,
or that no listed cause explains the data. Each statement is weighed by what it costs if it is
wrong; the table is in `estimation.losses`. No probability is compared with a number of its own.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import Self, TypeVar

import numpy as np

from orthoglide_cal.causes import CAUSES, UNLISTED
from orthoglide_cal.errors import PostureError
from orthoglide_cal.estimation.accuracy import chance_of_residual
from orthoglide_cal.estimation.gaussian import log_sum
from orthoglide_cal.estimation.losses import (
    DISMISSED,
    FALSE_RELEASE,
    MENTION,
    MISSED_FAULT,
    NEEDLESS_HOLD,
    OPEN_ANSWER,
    WRONG_NAME,
    is_dismissed,
    is_likely,
    surprising,
)
from orthoglide_cal.estimation.solution import SUSPICIOUS
from orthoglide_cal.inference.data import (
    ONE_CAUSE,
    TWO_CAUSES,
    Candidates,
    Ids,
    Linearised,
    Whitened,
    unit_of,
)
from orthoglide_cal.inference.fit import LARGEST, Fit, fit_hypothesis
from orthoglide_cal.inference.hypothesis import Hypothesis, Pattern, score_all
from orthoglide_cal.inference.patterns import (
    PASSING,
    combined,
    fits_of,
    pattern_candidates,
    placed_causes,
)
from orthoglide_cal.inference.result import TimesStated, Verdict
from orthoglide_cal.model.cause import NORMAL_K, Stage
from orthoglide_cal.model.plan import Floats, read_only
from orthoglide_cal.schema import Reason

Key = TypeVar("Key", bound=Hashable)

# The fit of the best listed causes must leave no more than noise, which the evidence lets be larger
# than stated. If something beyond the list stands in their place, an open question costs a
# measurement in vain; if not, to look for it in the set-up costs a hold.
MISFIT = surprising(UNLISTED / (ONE_CAUSE + TWO_CAUSES), OPEN_ANSWER, NEEDLESS_HOLD)

# --- limits of effort -------------------------------------------------------------------------

# Hypotheses within this much log evidence of the best are fitted nonlinearly, the best few.
WORTH_A_FIT, FITS = 8.0, 3
# What was dismissed by its linear score is fitted down to this share of its bound.
FAR_BELOW = 0.03
# No further fit is sought while the odds of all faults together against none stay below this
# share of the odds that establish a fault.
SURELY = 0.5
# A cause less probable than this relative to nothing wrong is not fitted: it moves no digit of U.
WEIGHS = 0.01
# A place less probable than this is not looked at, no more than so many.
PLACE_COUNTS, PLACES = 0.002, 6
# A cause that many times its plausible size is beyond it; for the search for one of any size.
BEYOND, ANY_SIZE = 3.0, 1e3
# So many likely patterns are combined with causes that have a place.
LIKELY = 5


def probabilities(log_weight: Mapping[Key, float]) -> dict[Key, float]:
    """Probability of each hypothesis from ln of its prior times evidence, most probable first.

    Raises numpy.linalg.LinAlgError: rounding left no evidence of one.
    """
    total = float(log_sum(np.array([*log_weight.values()])))
    if math.isnan(total):
        raise np.linalg.LinAlgError("the evidence is no number")
    ordered = sorted(log_weight.items(), key=lambda pair: -pair[1])
    return {key: math.exp(value - total) for key, value in ordered}


def mixture(
    shares: Sequence[float], values: Sequence[Floats], covariances: Sequence[Floats]
) -> tuple[Floats, Floats]:
    """Mean (p,) and covariance (p, p) over hypotheses whose shares sum to 1.

    The choice among their values (p,) is added to the covariance (p, p) under each.
    """
    weights, means = np.array(shares), np.stack(values)
    mean = weights @ means
    apart = means - mean
    between = (apart.T * weights) @ apart
    return mean, np.tensordot(weights, np.stack(covariances), axes=1) + between


def is_sizeless(ids: Ids, part: Ids) -> bool:
    """Return whether a set adds to a part of it only faults without size, such as an exchange."""
    more = set(ids) - set(part)
    return set(part) < set(ids) and not any(CAUSES[id].unknowns for id in more)


def keep_ratio(ids: Ids, best: Ids) -> float:
    """Probability relative to the answer `best` from which a set of causes is left open.

    To keep it costs a measurement; to drop it wrongly costs a wrong name. A set that adds to the
    answer does not contradict it: dropped, a fault is missed, or, of a fault of the record without
    size, false offsets are released.
    """
    if not set(best) < set(ids):
        return DISMISSED
    return OPEN_ANSWER / (FALSE_RELEASE if is_sizeless(ids, best) else MISSED_FAULT)


def state(
    belief: Mapping[Key, float], nothing: Key, missed: float, needless: float
) -> tuple[Key, tuple[Key, ...]]:
    """The statement of least expected loss, and what it leaves open, most probable first.

    Something has happened, or the hypothesis `nothing` is stated: by the losses of `is_likely`.
    """
    happened = is_likely(belief[nothing], missed, needless)
    others = sorted(belief, key=lambda key: -belief[key])
    stated = next(key for key in others if key != nothing) if happened else nothing
    lost = needless if happened else missed
    others.remove(stated)
    return stated, tuple(key for key in others if not is_dismissed(belief[key], lost))


@dataclass(frozen=True, eq=False)
class Decision:
    """Hypotheses about one data set, the statement of least expected loss, and what follows."""

    at: Linearised  # the data, and what every candidate would do to them
    hypotheses: Mapping[Ids, Hypothesis]  # sets of listed causes; () is that nothing is wrong
    patterned: Mapping[str, Hypothesis]  # those with patterns beyond the list, by their labels
    fits: Mapping[Ids, Fit] = field(default_factory=dict)  # those that the probabilities rest on
    # Fits of other hypotheses, made when first asked for; they change no probability.
    _further: dict[Ids, Fit] = field(default_factory=dict)
    # Every pattern at every where, looked at closely or not; no tolerance changes them.
    _tried: dict[bool, list[list[Pattern]]] = field(default_factory=dict)
    # Maps of several dates of a bed agree: what the parameters leave is no noise, but a shape.
    repeats: bool = False
    # What the named causes did not see contradicts them; None where nothing does.
    refuted: Reason | None = None

    @classmethod
    def about(cls, white: Whitened) -> Self:
        """Weigh every hypothesis by its linear evidence.

        Raises UnusableResultError: no offsets fit these data.
        """
        plan = white.plan
        spots = len(np.unique(plan.repeats[plan.touches]))
        at = Linearised.of(white, Candidates.of(white.problem.model, white.raw, spots))
        listed = cls(at, score_all(at), {}).refined([()])
        return replace(listed, patterned={one.label: one for one in listed.beside(())})

    def scaled(self, factor: float) -> Self:
        """The same data and patterns with the plausible sizes of all causes multiplied."""
        at = replace(self.at, white=self.at.white.scaled(factor, CAUSES.values()))
        anew = replace(self, at=at, hypotheses=score_all(at), fits={}, _further={})
        return replace(anew, repeats=False, refuted=None)

    def refined(self, sets: Iterable[Ids]) -> Self:
        """The same with the nonlinear fits of some more sets of causes."""
        fits = {ids: self.fit_of(ids) for ids in sets}
        return replace(self, fits={**self.fits, **fits}) if fits.keys() - self.fits else self

    def beside(self, ids: Ids) -> list[Hypothesis]:
        """Every pattern in addition to a set of causes, not looked at closely."""
        return combined(self.hypotheses[ids], self.fit_of(ids), self._every(fine=False))

    def _every(self, *, fine: bool) -> list[list[Pattern]]:
        if fine not in self._tried:
            self._tried[fine] = pattern_candidates(self.fit_of(()), fine=fine)
        return self._tried[fine]

    def closely(self) -> Self:
        """The same with patterns looked at closely, also in addition to each other.

        The best one with a second one; each single cause with a pattern; the likely ones and the
        best of each kind with causes that have a place, which fitted alone would stand where the
        pattern acts. Each only if prior times evidence grows.
        """
        nothing, every = self.fit_of(()), self._every(fine=True)
        patterns = {one.label: one for one in combined(self.hypotheses[()], nothing, every)}
        ordered = sorted(patterns.values(), key=attrgetter("log_weight"))
        likely = {one.patterns[0].how: one for one in ordered} | {
            one.label: one for one in ordered[-LIKELY:-1]
        }
        pairs = combined(ordered[-1], nothing, every)
        for ids in (ids for ids in self.listed if len(ids) == 1):
            pairs += combined(self.hypotheses[ids], self.fit_of(ids), every)
        placed = placed_causes(self.at)
        for hypothesis in likely.values():
            pairs += combined(hypothesis, nothing, placed)
        alone = {label: one.log_weight for label, one in patterns.items()}
        for pair in sorted(pairs, key=attrgetter("log_weight")):
            if pair.log_weight > max(alone.get(one.label, -math.inf) for one in pair.patterns):
                patterns[pair.label] = pair
        return replace(self, patterned=patterns)

    def fit_of(self, ids: Ids) -> Fit:
        """The nonlinear fit of a set of causes."""
        if ids in self.fits:
            return self.fits[ids]
        if ids not in self._further:
            self._further[ids] = fit_hypothesis(self.hypotheses[ids])
        return self._further[ids]

    @cached_property
    def log_weight(self) -> Mapping[Ids, float]:
        """ln of prior times evidence of each set of causes."""
        prior, by_ids = self.at.candidates.log_prior, self.hypotheses.items()
        return {ids: self.fits.get(ids, one).log_evidence + prior[ids] for ids, one in by_ids}

    @cached_property
    def probability(self) -> Mapping[Ids | str, float]:
        """Probability of each set of listed causes and each pattern, the most probable first."""
        beyond = {label: one.log_weight for label, one in self.patterned.items()}
        return probabilities({**self.log_weight, **beyond})

    @cached_property
    def listed(self) -> Mapping[Ids, float]:
        """Probability of each set of listed causes, the most probable first."""
        return {key: p for key, p in self.probability.items() if isinstance(key, tuple)}

    @cached_property
    def unlisted(self) -> Mapping[str, float]:
        """Probability of each pattern beyond the list, by its label."""
        return {key: p for key, p in self.probability.items() if isinstance(key, str)}

    @cached_property
    def something(self) -> float:
        """Probability of listed causes, whichever."""
        return sum(value for ids, value in self.listed.items() if ids)

    @cached_property
    def beyond(self) -> float:
        """Probability of something beyond the list."""
        return sum(self.unlisted.values())

    @cached_property
    def answers(self) -> Mapping[Hashable, tuple[Ids, ...]]:
        """Sets of causes by what they ask of a technician, the most probable first in each."""
        by_remedy: dict[Hashable, tuple[Ids, ...]] = {}
        for ids in filter(None, self.listed):
            remedy = self.hypotheses[ids].remedy
            by_remedy[remedy] = (*by_remedy.get(remedy, ()), ids)
        return by_remedy

    def answer_of(self, ids: Ids) -> tuple[Ids, ...]:
        """The answer that a set belongs to."""
        return self.answers[self.hypotheses[ids].remedy] if ids else (ids,)

    def share(self, sets: Iterable[Ids]) -> float:
        """Probability of some sets of causes together."""
        return sum(map(self.listed.__getitem__, sets))

    def gain(self, ids: Ids, part: Ids) -> float:
        """Log odds by which the data favour a fault without size, which a set adds to a part of it.

        The smaller of those in the mean over plausible sizes and of those where both fit best: that
        the other causes are then of more usual size is no evidence.
        """
        first, second = (self.fits.get(one, self.hypotheses[one]) for one in (ids, part))
        gain = first.log_evidence - second.log_evidence
        if isinstance(first, Fit) and isinstance(second, Fit):
            units = unit_of(first.effects), unit_of(second.effects)
            if units == (1.0, 1.0):
                gain = min(gain, first.log_likelihood - second.log_likelihood)
        return gain

    @property
    def white(self) -> Whitened:
        """The data, in units of independent noise."""
        return self.at.white

    # --- which answers are left open ---

    @cached_property
    def best(self) -> Ids:
        """The set of causes to accept (not empty unless nothing else was tried).

        Of the most probable answer the set that names it; a second cause is added only where to
        miss it costs more than to look for it in vain.
        """
        listed = self.listed
        answer = max(self.answers.values(), key=self.share, default=((),))
        # Of sets that are nearly as probable one of the record: whatever spoiled a reading, it is
        # wrong, and to look for a knock in vain costs more.
        least = listed[answer[0]] * MISSED_FAULT / NEEDLESS_HOLD
        near = (ids for ids in answer if listed[ids] >= least)
        most = min(near, key=lambda ids: sum(CAUSES[id].stage is not Stage.RECORD for id in ids))
        parts = [ids for ids in listed if ids and set(ids) < set(most)]
        enough = [ids for ids in parts if self._adds_little(most, ids)]
        best = max(enough, key=listed.__getitem__, default=most)
        return self.as_shape(best) if self.shape in best else best

    @property
    def shape(self) -> str:
        """Id of the cause that stands for any shape where nothing tells what makes it, or ""."""
        white = self.white
        return white.machine.shape if white.plan.flat else ""

    def as_shape(self, ids: Ids) -> Ids:
        """A set with the shape in place of all that might make it; itself without one."""
        makers = {id for id in ids if CAUSES[id].repeats}
        replaced = tuple(sorted({self.shape} | set(ids) - makers))
        return replaced if self.shape and makers and replaced in self.listed else ids

    def same_answer(self, ids: Ids) -> tuple[Ids, ...]:
        """Other sets, not dismissed, that ask the same of a technician, most probable first."""
        listed, answer = self.listed, self.answer_of(ids)
        least = DISMISSED * listed[ids]
        return tuple(other for other in answer if other != ids and listed[other] >= least)

    def is_open(self, ids: Ids) -> bool:
        """Return whether a set of causes is too probable to be dismissed for the best answer."""
        return self.listed[ids] >= keep_ratio(ids, self.best) * self.something

    @cached_property
    def rival_sets(self) -> tuple[Ids, ...]:
        """Sets that these data cannot distinguish from the best one, most probable first.

        A set that holds another rival and adds to it says nothing new, unless it is the likelier.
        """
        best, same = self.best, self.same_answer(self.best)
        listed = self.listed
        held = {self.as_shape(best)}
        if self.shape and any(CAUSES[id].repeats for id in best):
            # It leaves open what makes the shape: the likeliest with each cause that is doubted.
            for doubted in set(self.white.machine.doubted) - set(best):
                held.update([ids for ids in listed if doubted in ids][:1])
        others = [ids for ids in listed if ids not in ((), best, *same)]
        rivals = [ids for ids in others if ids in held or self.is_open(ids)]
        parts = {ids: [part for part in (*rivals, *same) if {*part} < {*ids}] for ids in rivals}
        little = {ids for ids in rivals if any(self._adds_little(ids, part) for part in parts[ids])}
        return tuple(ids for ids in rivals if ids in held or ids not in little)

    @cached_property
    def silent(self) -> tuple[Ids, ...]:
        """Faults without size besides the best answer that are open, but not by these data: as
        plausible as not beforehand, to look for them would cost more than to miss them."""
        best = self.best
        adding = (ids for ids in self.listed if is_sizeless(ids, best) and self.is_open(ids))
        least = math.log(self.hold / MISSED_FAULT)
        return tuple(ids for ids in adding if self.gain(ids, best) < least)

    def nearly_dismissed(self, ids: Ids) -> bool:
        """Return whether a set contradicts the best one and is below its bound, not far below."""
        bound = keep_ratio(ids, self.best) * self.something
        contradicts = not set(self.best) <= set(ids)
        return contradicts and FAR_BELOW * bound <= self.listed[ids] < bound

    def _adds_little(self, ids: Ids, part: Ids) -> bool:
        """Return whether to look for what a set adds to a part of it costs more than to miss it."""
        both, alone = (self.share(self.answer_of(one)) for one in (ids, part))
        return both * MISSED_FAULT < self.hold * alone

    @property
    def hold(self) -> float:
        """Loss of a needless hold on this kind of machine [min]."""
        return NEEDLESS_HOLD * self.white.machine.caution

    # --- the statement ---

    @property
    def wrong(self) -> bool:
        """True if to look for a fault costs less than to miss one."""
        return is_likely(self.listed[()], MISSED_FAULT, self.hold)

    @property
    def surely_sound(self) -> bool:
        """True if nothing is wrong by so far that no fit of a cause can change it."""
        nothing = self.listed[()]
        return (1.0 - nothing) * MISSED_FAULT < SURELY * nothing * self.hold

    @cached_property
    def verdict(self) -> Verdict:
        """The statement itself."""
        if self.refuted is not None:
            return Verdict.UNEXPLAINED
        if not self.wrong:
            if self.repeats and (self.shape,) in self.hypotheses:
                return Verdict.NAMED
            # Evidence alone lets noise be as large as it must.
            too_large = self.at.local and self.chance(self.fit_of(())) < SUSPICIOUS
            return Verdict.UNEXPLAINED if too_large else Verdict.CONSISTENT
        best = self.best
        # If it is beyond the list, an open question costs a measurement in vain; if it is not, to
        # look for it in the set-up costs a hold.
        lost = self.beyond * OPEN_ANSWER > self.something * NEEDLESS_HOLD
        fit = self.fit_of(best)
        if lost or math.isinf(fit.log_evidence) or self._chance_beyond(fit) < MISFIT:
            return Verdict.UNEXPLAINED
        if self.is_nameable:
            return Verdict.AMBIGUOUS if self._others else Verdict.NAMED
        # Two causes follow nearly any pattern: a further measurement would not decide.
        return Verdict.UNEXPLAINED if len(best) > 1 else Verdict.AMBIGUOUS

    @cached_property
    def is_nameable(self) -> bool:
        """True if to name the best causes costs less than to leave them open.

        Where a pattern acts, each that does not act with it is a wrong name: of what is in every
        reading a part. Offsets are false that it moves beyond their U, or by what returns with its
        posture.
        """
        best, fit = self.best, self.fit_of(self.best)
        bearable, risk = OPEN_ANSWER * self.something, 0.0
        if (len(best) * WRONG_NAME + FALSE_RELEASE) * self.beyond <= bearable:
            return True  # whatever they do: no pattern has to be fitted
        for one in self.beyond_list:
            hows = {pattern.how for pattern in one.patterns}
            wrong = [CAUSES[id] for id in set(best) - {*one.ids} - hows]
            parts = sum(cause.in_machine and cause.repeats for cause in wrong)
            loss = parts * WRONG_NAME + (len(wrong) - parts) * NEEDLESS_HOLD
            moved = self._moves(one, fit.offsets, fit.offsets_covariance)
            if moved or hows - CAUSES.keys() - PASSING:
                loss += FALSE_RELEASE
            risk += self.unlisted[one.label] * loss
        return risk <= bearable

    @cached_property
    def accepted(self) -> Ids:
        """The causes that are named, or the likeliest of an open question."""
        if self.verdict in (Verdict.NAMED, Verdict.AMBIGUOUS):
            return self.best if self.wrong else (self.shape,)
        return ()

    @property
    def ambiguous_with(self) -> Ids:
        """Ids that these data cannot separate from the accepted ones."""
        return self._others if self.verdict is Verdict.AMBIGUOUS else ()

    @cached_property
    def _others(self) -> Ids:
        """Causes open in place of the best answer or in addition to it."""
        rivals = self.rival_sets
        if self.is_nameable and all(ids in self.silent for ids in rivals):
            rivals = ()
        return tuple(dict.fromkeys(id for ids in rivals for id in ids if id not in self.best))

    def _chance_beyond(self, fit: Fit) -> float:
        """Chance that noise leaves more than a fit does, as large as its statement may mean."""
        at = self.at
        # A fit with priors takes up as many degrees of freedom as the trace of its hat matrix.
        taken = float(np.trace(fit.covariance @ fit.columns.T @ fit.columns)) / fit.sigma**2
        square, dof = float(fit.residual @ fit.residual), len(at.white) - taken
        if at.local:
            return chance_of_residual(square, dof, max(at.noise.stated, fit.sigma))
        by_noise = [chance_of_residual(square, dof, sigma) for sigma in at.noise.sigma]
        return float(np.exp(at.noise.log_weight) @ by_noise)

    @cached_property
    def unseen(self) -> Ids:
        """Single causes that may be there although nothing shows, most probable first.

        Not faults without a size: what does not show moves nothing, but for the sign of a whole
        table, which the opposite offsets give, too, and which nobody could ever rule out.
        """
        listed = self.listed
        single = (ids for ids in listed if len(ids) == 1 and CAUSES[ids[0]].names)
        return tuple(id for (id,) in single if listed[id,] * MISSED_FAULT >= MENTION * listed[()])

    @property
    def not_excluded(self) -> Ids:
        """The same where nothing is said to be wrong."""
        return self.unseen if self.verdict is Verdict.CONSISTENT else ()

    def hidden(self) -> list[Ids]:
        """Unseen causes that are so probable that they widen the offsets' uncertainty.

        What no reading shows is uncertain in every explanation already.
        """
        machine, listed = self.white.machine, self.listed
        known = (*machine.unobservable, *machine.fixed_parameters)
        unseen = [(id,) for id in self.unseen if id not in known]
        return [ids for ids in unseen if listed[ids] >= WEIGHS * listed[()]]

    # --- what follows from it ---

    def chance(self, fit: Fit) -> float:
        """Chance that noise as stated leaves more than a fit of the parameters alone does."""
        white = self.white
        noise, dof = white.machine.instrument.noise_mm, len(white) - fit.offsets.size
        return chance_of_residual(fit.square, dof, noise)

    @property
    def fit(self) -> Fit:
        """The fit of the accepted causes; of the offsets alone if there are none."""
        return self.fit_of(self.accepted)

    @property
    def carried(self) -> Fit:
        """The fit of what lasts, to be carried to other days.

        Of readings of one plane a smooth shape, whatever makes it, and the motions that they show.
        """
        hypotheses = self.hypotheses
        ids = self.best if self.verdict is Verdict.UNEXPLAINED else self.accepted
        if not self.shape or (self.shape,) not in hypotheses:
            return self.fit
        beside = (id for id in ids if not CAUSES[id].repeats)
        with_shape = tuple(sorted((self.shape, *beside)))
        return self.fit_of(with_shape if with_shape in hypotheses else (self.shape,))

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

        At each place: its share next to what is left open, and the fit that holds it.
        """
        if self.verdict is not Verdict.NAMED or not self.wrong:
            return {}
        best = self.accepted
        total = self.share((best, *self.same_answer(best)))
        # To keep any other place open would cost more than to be wrong.
        return {
            more: fits_at_places(
                self.hypotheses[ids], self.listed[ids] / total, keep_ratio(ids, best)
            )
            for ids in self.silent
            for more in set(ids) - set(best)
        }

    @cached_property
    def beyond_tolerance(self) -> tuple[TimesStated, ...]:
        """Causes that would explain what is unexplained, how many times their size."""
        if self.verdict is not Verdict.UNEXPLAINED:
            return ()
        at, hypotheses = self.at, self.hypotheses
        explaining = []
        for cause in at.candidates.broad:
            try:
                fit = fit_hypothesis(replace(hypotheses[(cause.id,)], scale=ANY_SIZE))
            except PostureError:  # no machine of any size is like that
                continue
            times = fit.effects[0].times(at.white.machine)
            if times > BEYOND and round(times) <= LARGEST and self._chance_beyond(fit) >= MISFIT:
                explaining.append((float(fit.residual @ fit.residual), cause.id, times))
        return tuple(TimesStated(id=id, times=times) for _, id, times in sorted(explaining))

    @cached_property
    def offsets(self) -> tuple[Floats, Floats]:
        """Offsets (3,) [mm] and their covariance (3, 3) [mm²] under the verdict.

        Averaged over the explanations that the data leave open, weighted by probability, so
        that the choice among them is part of the uncertainty.
        """
        shares, fits = zip(*self.left_open, strict=True)
        values, spreads = zip(*((fit.offsets, fit.offsets_covariance) for fit in fits), strict=True)
        mean, covariance = mixture(shares, values, spreads)
        if self.verdict is Verdict.UNEXPLAINED and not self.described:
            # What may return with its posture, in each cell as large as what is left in the
            # readings: repeats cannot average it out.
            white, fit, width = self.white, fits[0], mean.size
            estimator = fit.covariance[:width] @ fit.columns.T / fit.sigma**2
            left = float(fit.residual @ fit.residual) / max(len(white) - width, 1)
            cells = estimator @ (white.matrix @ white.plan.returning)
            covariance = covariance + left * cells @ cells.T
        return read_only(mean), read_only(covariance)

    @cached_property
    def beyond_list(self) -> Mapping[Hypothesis, float]:
        """Patterns that remain of those beyond the list, best first, and their shares, 1 in all."""
        weight = {one: one.log_weight for one in self.patterned.values()}
        # Of weights: all probabilities may be too small for a number.
        least = max(weight.values()) + math.log(DISMISSED)
        return probabilities({one: value for one, value in weight.items() if value >= least})

    @cached_property
    def patterned_fits(self) -> tuple[tuple[float, Fit], ...]:
        """Fits with these patterns and their shares, the likeliest first."""
        return tuple(
            (probability * share, fit)
            for hypothesis, probability in self.beyond_list.items()
            for share, fit in fits_of(hypothesis, self.fit_of(hypothesis.ids))
        )

    @property
    def enterable(self) -> float:
        """Probability that what is not listed falsifies no offsets; 0 if more than noise stays.

        All that acts has to pass: U allows for it. Listed causes that act with it may stay, as
        those that are named may, if they move no parameter by more than U.
        """
        probability = 0.0
        for one, share in self.beyond_list.items() if self.described else ():
            unlisted = [pattern for pattern in one.patterns if pattern.how not in CAUSES]
            if {pattern.how for pattern in unlisted} <= PASSING:
                alone = self.patterned[", ".join(pattern.label for pattern in unlisted)]
                beside = self._offsets_under(alone), self.offsets[1]
                stays = alone is one or not self._moves(one, *beside)
                probability += share * self.beyond * stays
        return probability

    def _moves(self, hypothesis: Hypothesis, offsets: Floats, covariance: Floats) -> bool:
        """Return whether the offsets under a hypothesis differ from others by more than their U."""
        moved = np.abs(self._offsets_under(hypothesis) - offsets)
        return bool(np.any(moved > NORMAL_K * np.sqrt(np.diag(covariance))))

    def _offsets_under(self, hypothesis: Hypothesis) -> Floats:
        fits = fits_of(hypothesis, self.fit_of(hypothesis.ids))
        return np.asarray(sum(share * fit.offsets for share, fit in fits))

    @property
    def described(self) -> bool:
        """True if the likeliest pattern leaves no more than noise, and nothing else was refuted."""
        return self.refuted is None and self._chance_beyond(self.patterned_fits[0][1]) >= MISFIT

    def settled(self) -> Self:
        """The same with the fits that may change the statement: linear evidence alone says less."""
        order, at, weight = list(self.listed), self.at, self.log_weight
        decision = self.refined([()])
        # With a local shape that is found to be larger or smaller, the noise is found, too.
        noise_found = at.local
        if decision.surely_sound and not noise_found:
            # Linear scores know no bounds: what cannot be negative may fit better than it scores.
            positive = [(cause.id,) for cause in at.candidates.broad if cause.positive]
            decision = decision.refined([*decision.hidden(), *positive])
            if decision.surely_sound:
                return decision
        near = (ids for ids in order[:FITS] if weight[ids] > weight[order[0]] - WORTH_A_FIT)
        decision = decision.refined(near)
        if noise_found:
            # Of printers the causes are large against what linear scores can follow.
            fits = decision.fits
            again = [ids for ids in order if ids not in fits and decision.nearly_dismissed(ids)]
            decision = decision.refined(again[:FITS])
        # What has no size is judged by the fits, too; and linear scores know no bounds: what is
        # left open is so by its fit.
        listed = decision.listed
        least = OPEN_ANSWER / FALSE_RELEASE * listed[decision.best]
        likely = [ids for ids in listed if ids and listed[ids] >= least]
        pairs = [(ids, (id,)) for ids in likely for id in ids if is_sizeless(ids, (id,))]
        wanted = [ids for pair in pairs for ids in pair]
        for _ in range(FITS):
            wanted += (decision.best, *decision.rival_sets)
            if decision.fits.keys() >= set(wanted):
                break
            decision = decision.refined(wanted)
        decision = decision.refined([decision.best])
        # Few differences follow nearly any pattern.
        return decision.closely() if at.white.raw and decision.doubted else decision

    @property
    def doubted(self) -> bool:
        """True if patterns looked at closely may change the statement.

        Several causes, or several wrong readings, follow most patterns; one, alone or beside the
        accepted cause, may make it a wrong name.
        """
        accepted = self.accepted
        if self.verdict is Verdict.UNEXPLAINED or len(accepted) > 1:
            return True
        if not accepted or len(self.fit.wrong_readings) > 1:
            return bool(accepted)
        patterns = (*self.patterned.values(), *self.beside(accepted))
        likeliest = max(one.log_weight for one in patterns) - self.log_weight[accepted]
        bearable = OPEN_ANSWER * self.something / self.listed[accepted]
        return likeliest > math.log(bearable / (WRONG_NAME + FALSE_RELEASE))


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
