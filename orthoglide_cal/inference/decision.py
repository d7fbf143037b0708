"""Decision: what to say of a machine, by least expected loss.

A technician is told that nothing is wrong, a name, several answers that are left open, or that no
listed cause explains the data, each weighed by what it costs if it is wrong: see `losses`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Self

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.gaussian import probabilities
from orthoglide_cal.estimation.solution import chance_of_residual, fitted_here, suspicious
from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.data import Ids
from orthoglide_cal.inference.fit import MISFIT, Fit
from orthoglide_cal.inference.hypothesis import LOST, Hypothesis, score_all
from orthoglide_cal.inference.patterns import PASSING, fits_of
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.losses import (
    DISMISSED,
    FALSE_RELEASE,
    MENTION,
    MISSED_FAULT,
    NEEDLESS_HOLD,
    OPEN_ANSWER,
    WRONG_NAME,
    is_likely,
)
from orthoglide_cal.model.model import NORMAL_K, Stage
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.schema import Reason

# Hypotheses within this much log evidence of the best are fitted nonlinearly, the best few.
WORTH_A_FIT, FITS = 8.0, 3
# What was dismissed by its linear score is fitted down to this share of its bound.
FAR_BELOW = 0.03
# No further fit is sought while the odds of all faults together against none stay below this
# share of the odds that establish a fault.
SURELY = 0.5
# Limit of effort: causes less probable than this relative to nothing wrong are not fitted. With all
# of them U would be some per cent larger.
WEIGHS = 0.01


def is_sizeless(ids: Ids, part: Ids) -> bool:
    """Return whether a set adds to a part of it only faults without size, such as an exchange."""
    return set(part) < set(ids) and not any(CAUSES[id].unknowns for id in set(ids) - set(part))


def keep_ratio(ids: Ids, best: Ids) -> float:
    """Probability relative to the answer `best` from which a set of causes is left open.

    To keep it costs a measurement; to drop it wrongly costs a wrong name. A set that adds to the
    answer does not contradict it: dropped, a fault is missed, or, of a fault of the record without
    size, false offsets are released.
    """
    if not set(best) < set(ids):
        return DISMISSED
    return OPEN_ANSWER / (FALSE_RELEASE if is_sizeless(ids, best) else MISSED_FAULT)


@dataclass(frozen=True, eq=False)
class Decision(Belief):
    """The statement of least expected loss about one data set, and what it leaves open."""

    # Maps of several dates of a bed agree: what the parameters leave is no noise, but a shape.
    repeats: bool = False
    # What the named causes did not see contradicts them; None where nothing does.
    refuted: Reason | None = None

    def scaled(self, factor: float) -> Self:
        """The same data, patterns and wrong readings; all plausible sizes multiplied."""
        at = replace(self.at, white=self.at.white.scaled(factor, CAUSES.values()))
        wrong = (one for one in self.hypotheses.values() if one.wrong_readings)
        likeliest = max(wrong, key=attrgetter("log_weight"), default=None)
        anew = score_all(at, likeliest.wrong_readings if likeliest else ())
        return replace(self, at=at, hypotheses=anew, fits={}, _kept={}, repeats=False, refuted=None)

    def settled(self) -> Self:
        """The same with the fits that may change the statement: linear evidence alone says less."""
        order, at, weight = list(self.listed), self.at, self.log_weight
        decision = self.refined([()])
        # With a local shape that is found to be larger or smaller, the noise is found, too.
        noise_found = at.white.texture is not None
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
        # No fit of listed causes makes up for what a pattern explains beyond the best of them.
        patterns = (one.log_weight for one in decision.patterned.values())
        hopeless = max(patterns, default=-math.inf) > max(decision.log_weight.values()) + LOST
        for _ in range(0 if hopeless else FITS):
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

        Several causes, or several wrong readings, follow most patterns; one, alone or with the
        accepted cause, may make it a wrong name. Where they were looked at closely and nothing else
        explains the data, other tolerances show no others.
        """
        accepted = self.accepted
        if not accepted:
            return self.verdict is Verdict.UNEXPLAINED and True not in self._tried
        if len(accepted) > 1 or len(self.fit.wrong_readings) > 1:
            return True
        patterns = (*self.patterned.values(), *self.beside(self.hypotheses[accepted]))
        likeliest = max(one.log_weight for one in patterns) - self.log_weight[accepted]
        bearable = OPEN_ANSWER * self.something / self.listed[accepted]
        return likeliest > math.log(bearable / (WRONG_NAME + FALSE_RELEASE))

    @cached_property
    def best(self) -> Ids:
        """The set of causes to accept (not empty unless nothing else was tried).

        Of the most probable answer the set that names it; a second cause is added only where to
        miss it costs more than to look for it in vain.
        """
        listed = self.listed
        answers = (answer for ids, answer in self.answers.items() if ids)
        answer = max(answers, key=self.share, default=((),))
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
        return replaced if makers and replaced in self.listed else ids

    def same_answer(self, ids: Ids) -> tuple[Ids, ...]:
        """Other sets, not dismissed, that ask the same of a technician, most probable first."""
        listed, answer = self.listed, self.answers[ids]
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
        if (self.shape,) in listed and any(CAUSES[id].repeats for id in best):
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
        least = math.log(self.needless_hold / MISSED_FAULT)
        return tuple(ids for ids in adding if self.gain(ids, best) < least)

    def nearly_dismissed(self, ids: Ids) -> bool:
        """Return whether a set contradicts the best one and is below its bound, not far below."""
        bound = keep_ratio(ids, self.best) * self.something
        contradicts = not set(self.best) <= set(ids)
        return contradicts and FAR_BELOW * bound <= self.listed[ids] < bound

    def _adds_little(self, ids: Ids, part: Ids) -> bool:
        """Return whether to look for what a set adds to a part of it costs more than to miss it."""
        both, alone = (self.share(self.answers[one]) for one in (ids, part))
        return both * MISSED_FAULT < self.needless_hold * alone

    @property
    def needless_hold(self) -> float:
        """Loss if a fault is looked for, or corrected, that is not there [min]."""
        return self.white.machine.needless_hold

    @property
    def wrong(self) -> bool:
        """True if to look for a fault costs less than to miss one."""
        return is_likely(self.listed[()], MISSED_FAULT, self.needless_hold)

    @property
    def surely_sound(self) -> bool:
        """True if nothing is wrong by so far that no fit of a cause can change it."""
        nothing = self.listed[()]
        return (1.0 - nothing) * MISSED_FAULT < SURELY * nothing * self.needless_hold

    @cached_property
    def verdict(self) -> Verdict:
        """The statement itself."""
        if self.refuted is not None:
            return Verdict.UNEXPLAINED
        if not self.wrong:
            if self.repeats and (self.shape,) in self.hypotheses:
                return Verdict.NAMED
            # Evidence alone lets noise be as large as it must.
            shaped = self.white.texture is not None
            too_large = shaped and self.chance(self.fit_of(())) < suspicious(self.white.machine)
            return Verdict.UNEXPLAINED if too_large else Verdict.CONSISTENT
        best = self.best
        # If it is beyond the list, an open question costs a measurement in vain; if it is not, to
        # look for it in the set-up costs a hold.
        lost = self.beyond * OPEN_ANSWER > self.something * NEEDLESS_HOLD
        fit = self.fit_of(best)
        if lost or math.isinf(fit.log_evidence) or not self._leaves_noise(fit):
            return Verdict.UNEXPLAINED
        if self.is_nameable:
            return Verdict.AMBIGUOUS if self._others else Verdict.NAMED
        # Two causes follow nearly any pattern: a further measurement would not decide.
        return Verdict.UNEXPLAINED if len(best) > 1 else Verdict.AMBIGUOUS

    @cached_property
    def is_nameable(self) -> bool:
        """True if to name the best cause costs less than to leave it open; of two, than a hold.

        Where a pattern acts, each that does not act with it is a wrong name: of what is in every
        reading a part. Offsets are false that it moves beyond their U, or by what returns with its
        posture.
        """
        best = self.best
        bearable = (NEEDLESS_HOLD if len(best) > 1 else OPEN_ANSWER) * self.something
        if (len(best) * WRONG_NAME + FALSE_RELEASE) * self.beyond <= bearable:
            return True  # whatever they do: no pattern has to be fitted
        losses = {one: self.loss_of_name(best, one) for one in self.beyond_list}
        return sum(self.unlisted[one.label] * loss for one, loss in losses.items()) <= bearable

    def loss_of_name(self, ids: Ids, one: Hypothesis) -> float:
        """Loss if a set of causes is named and a pattern acts."""
        fit, hows = self.fit_of(ids), {pattern.how for pattern in one.patterns}
        wrong = [CAUSES[id] for id in set(ids) - {*one.ids} - hows]
        parts = sum(cause.in_machine and cause.repeats for cause in wrong)
        loss = parts * WRONG_NAME + (len(wrong) - parts) * NEEDLESS_HOLD
        moved = self._moves(one, fit.offsets, fit.offsets_covariance)
        return loss + FALSE_RELEASE * (moved or bool(hows - CAUSES.keys() - PASSING))

    def kept(self, rival: Hypothesis, best: Hypothesis) -> float:
        """Probability relative to the explanation `best` from which a rival is left open."""
        if best.patterns:
            return OPEN_ANSWER / NEEDLESS_HOLD
        if rival.patterns:
            loss = self.loss_of_name(best.ids, rival)
            return OPEN_ANSWER / loss if loss else math.inf
        return keep_ratio(rival.ids, best.ids)

    @cached_property
    def accepted(self) -> Ids:
        """The causes that are named, or the likeliest of an open question."""
        if self.verdict in (Verdict.NAMED, Verdict.AMBIGUOUS):
            return self.best if self.wrong else (self.shape,)
        return ()

    @property
    def fit(self) -> Fit:
        """The fit of the accepted causes; of the offsets alone if there are none."""
        return self.fit_of(self.accepted)

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

    def _leaves_noise(self, fit: Fit) -> bool:
        """Return whether a fit leaves no more than noise, as large as its statement may mean."""
        at = self.at
        # A fit with priors takes up as many degrees of freedom as the trace of its hat matrix.
        taken = float(np.trace(fit.covariance @ fit.columns.T @ fit.columns)) / fit.sigma**2
        square, dof = float(fit.residual @ fit.residual), len(at.white) - taken
        if at.white.texture is not None:
            chance = chance_of_residual(square, dof, max(at.noise.stated, fit.sigma))
        else:
            by_noise = [chance_of_residual(square, dof, sigma) for sigma in at.noise.sigma]
            chance = float(np.exp(at.noise.log_weight) @ by_noise)
        return chance >= MISFIT

    def chance(self, fit: Fit) -> float:
        """Chance that noise as stated leaves more than a fit of the parameters alone does."""
        white = self.white
        here = sum(fitted_here(self.measured, self.model).values())
        noise, dof = white.machine.instrument.noise_mm, len(white) - fit.offsets.size - here
        return chance_of_residual(fit.square, dof, noise)

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
        """Unseen causes that are so probable that they widen the offsets' uncertainty."""
        machine, listed = self.white.machine, self.listed
        # What no reading shows is uncertain in every explanation already.
        known = (*machine.unobservable, *machine.fixed_parameters)
        unseen = [(id,) for id in self.unseen if id not in known]
        return [ids for ids in unseen if listed[ids] >= WEIGHS * listed[()]]

    @cached_property
    def beyond_list(self) -> Mapping[Hypothesis, float]:
        """Patterns that remain of those beyond the list, best first, and their shares, 1 in all."""
        weight = {one: one.log_weight for one in self.patterned.values()}
        # Of weights: all probabilities may be too small for a number.
        least = max(weight.values()) + math.log(DISMISSED)
        return probabilities({one: value for one, value in weight.items() if value >= least})

    def _offsets_under(self, hypothesis: Hypothesis) -> Floats:
        fits = fits_of(hypothesis, self.fit_of(hypothesis.ids))
        return np.asarray(sum(share * fit.offsets for share, fit in fits))

    def _moves(self, hypothesis: Hypothesis, offsets: Floats, covariance: Floats) -> bool:
        """Return whether the offsets under a hypothesis differ from others by more than their U."""
        moved = np.abs(self._offsets_under(hypothesis) - offsets)
        return bool(np.any(moved > NORMAL_K * np.sqrt(np.diag(covariance))))
