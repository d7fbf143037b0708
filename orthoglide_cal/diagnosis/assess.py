"""All explanations of one data set, weighed: probabilities, verdict, the offsets that follow."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis.candidates import Candidates, Ids
from orthoglide_cal.diagnosis.explanations import Linearised, Whitened, unit_of
from orthoglide_cal.diagnosis.fit import Fitted, fit_explanations
from orthoglide_cal.diagnosis.result import Verdict
from orthoglide_cal.diagnosis.scores import Score, Unlisted, score_all, score_unlisted
from orthoglide_cal.errors import PostureError
from orthoglide_cal.estimation.accuracy import chance_of_residual
from orthoglide_cal.estimation.gaussian import log_sum
from orthoglide_cal.estimation.solution import SUSPICIOUS
from orthoglide_cal.model.cause import Stage
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import Floats

# Something is wrong only if that is this many times likelier than that nothing is. Of 1,200 healthy
# sessions of two cycles 9 get that far; at 2.5 half of them, but more real causes are passed over.
ODDS_TO_NAME = 1.5
# A rival this unlikely against the best answer is dismissed. Of 2,067 blind sessions of one cause
# 1,840 are named then, one of them wrongly; two of 1,905 at 0.03, eight of 1,956 at 0.1. A wrong
# name costs a part, an open one a reading.
DISMISSED = 0.01
# A second fault without size, such as an exchange, is dismissed below half of what data that say
# nothing of it leave it.
WITHOUT_SIZE = 0.02
# The data must favour a further fault by this factor before it is an open question: less
# is what they cannot show. Then it is told, and changes no verdict.
SPEAKS = 3.0
# But where the causes alone are this unlikely against it, the evidence for it is their size.
PART_COUNTS = 0.03
TINY = 1e-300  # a probability, for its logarithm
# Something beyond the list is dismissed like a rival of one cause. Against two it must be far
# less likely: they have so many parameters that they follow nearly any pattern of the postures.
BEYOND_TWO = 0.0015
# A cause this unlikely relative to "nothing is wrong" would have been seen at plausible sizes.
WOULD_BE_SEEN = 0.001
# The best listed explanation must leave no more than noise, at this chance of a false refusal.
MISFIT = 2e-4
# A cause that many times its plausible size is beyond it; for the search for one of any size.
BEYOND, ANY_SIZE = 3.0, 1e3
# Explanations within this much log evidence of the best are fitted nonlinearly, the best few.
WORTH_A_FIT = 8.0
FITS = 3
# No rival is dismissed by its linear score alone unless that is so far below `DISMISSED`.
FAR_BELOW = 0.03
# A place this unlikely for a fault that is left open is not looked at, and no more than so many.
PLACE_COUNTS, PLACES = 0.002, 6
# One this unlikely is not told as a place of a fault that would not show.
PLACE_LIKELY = 0.05
# A cause this probable relative to "nothing is wrong" widens the offsets' uncertainty.
WEIGHS = 0.01
# Nothing is wrong, whatever fits would add, where all else together is likelier than that by no
# more than this share of what it takes to be something.
SURELY = 0.5


def sizeless(ids: Ids, part: Ids) -> bool:
    """Whether what a set adds to a part of it are faults without size, such as an exchange."""
    more = set(ids) - set(part)
    return set(part) < set(ids) and not any(CAUSES[id].unknowns for id in more)


def bound(ids: Ids, best: Ids) -> float:
    """From which probability relative to the best answer a set of causes is left open.

    A set that adds to the best one does not contradict it while little speaks for it: what it adds
    may be too small to be seen. Only a fault without size cannot.
    """
    if not set(best) < set(ids):
        return DISMISSED
    return WITHOUT_SIZE if sizeless(ids, best) else 1.0 / ODDS_TO_NAME


def probabilities(
    log_evidence: Mapping[Ids, float], log_prior: Mapping[Ids, float], unlisted: Mapping[str, float]
) -> tuple[Mapping[Ids, float], Mapping[str, float]]:
    """Bayes' rule; `unlisted` holds evidence and prior weight together."""
    logs = {ids: value + log_prior[ids] for ids, value in log_evidence.items()}
    values = np.array([*logs.values(), *unlisted.values()])
    shares = np.exp(values - log_sum(values)).tolist()
    beyond = zip(unlisted, shares[len(logs) :], strict=True)
    return dict(zip(logs, shares, strict=False)), dict(beyond)


@dataclass(frozen=True)
class Posterior:
    """Probabilities of every explanation tried."""

    listed: Mapping[Ids, float]  # set of ids → probability
    unlisted: Mapping[str, float]  # pattern in words → probability
    # What a set asks of a technician, where it is not fixing these causes.
    remedies: Mapping[Ids, Hashable] = field(default_factory=dict)
    # How many times likelier something must be than nothing, or two causes than one.
    odds: float = ODDS_TO_NAME
    # Id of the cause that stands for any shape where nothing tells what makes it, or "".
    shape: str = ""
    doubted: Ids = ()  # ids of causes that the controller's own values make likely
    log_prior: Mapping[Ids, float] = field(default_factory=dict)
    # ln of the likelihood of a set where it fits best, of those that were fitted.
    log_fit: Mapping[Ids, float] = field(default_factory=dict)

    @cached_property
    def _sets(self) -> list[Ids]:
        """All that were tried, the most probable first."""
        return sorted(self.listed, key=lambda ids: -self.listed[ids])

    @cached_property
    def _answers(self) -> Mapping[Hashable, tuple[Ids, ...]]:
        """Sets of causes by what they ask of a technician, the most probable first."""
        found: dict[Hashable, tuple[Ids, ...]] = {}
        for ids in filter(None, self._sets):
            remedy = self.remedies.get(ids, ids)
            found[remedy] = (*found.get(remedy, ()), ids)
        return found

    def _share(self, ids: Ids) -> float:
        """Probability of the answer that a set belongs to."""
        return self._sum((ids, *self.same_answer(ids)))

    def _sum(self, sets: Iterable[Ids]) -> float:
        return sum(map(self.listed.__getitem__, sets))

    def same_answer(self, ids: Ids) -> tuple[Ids, ...]:
        """Other sets, not dismissed, that ask the same of a technician, most probable first."""
        answer = self._answers.get(self.remedies.get(ids, ids), ())
        floor = DISMISSED * self.listed[ids]
        return tuple(other for other in answer if other != ids and self.listed[other] >= floor)

    @cached_property
    def best(self) -> Ids:
        """The set of causes to accept (not empty unless nothing else was tried).

        Of the most probable answer the set that `_name`s it; but a second cause is added only
        where that is as many times likelier as something must be than nothing.
        """
        # No answer is less probable than the most probable set of causes, a part of one.
        least = max((value for ids, value in self.listed.items() if ids), default=0.0)
        likely = [sets for sets in self._answers.values() if self._sum(sets) >= least]
        most = max(map(self._name, likely), key=self._share, default=())
        parts = [ids for ids in self.listed if ids and set(ids) < set(most)]
        enough = [ids for ids in parts if self._adds_little(most, ids)]
        best = max(enough, key=self.listed.__getitem__, default=most)
        return self.as_shape(best) if self.shape in best else best

    def as_shape(self, ids: Ids) -> Ids:
        """A set with the shape in place of all that might make it; itself without one."""
        makers = {id for id in ids if CAUSES[id].repeats}
        found = tuple(sorted({self.shape} | set(ids) - makers))
        return found if self.shape and makers and found in self.listed else ids

    def _name(self, answer: tuple[Ids, ...]) -> Ids:
        """Of the sets of an answer the most probable, or one of the record that is nearly so.

        Whatever spoiled a reading, it is wrong: that it was a knock needs better odds.
        """
        enough = self.listed[answer[0]] / ODDS_TO_NAME
        near = (ids for ids in answer if self.listed[ids] >= enough)
        return min(near, key=lambda ids: sum(CAUSES[id].stage is not Stage.RECORD for id in ids))

    def rivals(self) -> tuple[Ids, ...]:
        """Sets that these data cannot distinguish from the best one, most probable first.

        A set that holds another rival and adds to it says nothing new, unless it is the likelier.
        """
        best, share, same = self.best, self._share(self.best), self.same_answer(self.best)
        held = {self.as_shape(best)}
        if self.shape and any(CAUSES[id].repeats for id in best):
            # It leaves open what makes the shape: the likeliest with each cause that is doubted.
            for doubted in set(self.doubted) - set(best):
                held.update([ids for ids in self._sets if doubted in ids][:1])
        found = [
            ids
            for ids in self._sets
            if ids not in ((), best, *same)
            and (ids in held or self.listed[ids] >= bound(ids, best) * share)
        ]

        def adds(ids: Ids) -> bool:
            parts = (other for other in (*found, *same) if set(other) < set(ids))
            return not any(self._adds_little(ids, part) for part in parts)

        return tuple(ids for ids in found if ids in held or adds(ids))

    def silent(self, ids: Ids, part: Ids) -> bool:
        """Whether the data say nothing of what a set adds to a part of it.

        Neither in the mean over plausible sizes nor, of a fault without size, where both fit best:
        that the other causes are then of more usual size is no evidence.
        """
        if not set(part) < set(ids) or not self.listed[part] or ids not in self.log_prior:
            return False
        gain = math.log(max(self.listed[ids], TINY)) - math.log(self.listed[part])
        gain -= self.log_prior[ids] - self.log_prior[part]
        if sizeless(ids, part) and {ids, part} <= self.log_fit.keys():
            gain = min(gain, self.log_fit[ids] - self.log_fit[part])
        return gain < math.log(SPEAKS)

    def unshown(self) -> tuple[Ids, ...]:
        """Faults without size besides the best answer of which the data say nothing, however likely
        they are."""
        best, least = self.best, WITHOUT_SIZE * self._share(self.best)
        return tuple(
            ids
            for ids, value in self.listed.items()
            if sizeless(ids, best) and value >= least and self.silent(ids, best)
        )

    def nearly_dismissed(self, ids: Ids) -> bool:
        """Whether a set contradicts the best one, and is below the bound but not far below."""
        bound = DISMISSED * self._share(self.best)
        return not set(self.best) <= set(ids) and FAR_BELOW * bound <= self.listed[ids] < bound

    def _adds_little(self, ids: Ids, part: Ids) -> bool:
        """Whether a set is not so much likelier than a part of it that it were to be accepted."""
        counts = self.listed[part] >= PART_COUNTS * self.listed[ids]
        if part and counts and sizeless(ids, part) and self.silent(ids, part):
            return True
        return self._share(ids) < self.odds * self._share(part)

    def unseen(self) -> Ids:
        """Single causes that may be there although nothing shows, most probable first.

        Not faults without a size: what does not show moves nothing, but for the sign of a whole
        table, which the opposite offsets give, too, and which nobody could ever rule out.
        """
        floor = WOULD_BE_SEEN * self.listed[()]
        likely = (ids for ids in self._sets if len(ids) == 1 and self.listed[ids] >= floor)
        return tuple(id for (id,) in likely if CAUSES[id].names)

    def hidden(self, machine: Machine) -> list[Ids]:
        """Those of them that are so probable that they widen the offsets' uncertainty.

        What no reading shows is uncertain in every explanation already.
        """
        known = (*machine.unobservable, *machine.fixed_parameters)
        unseen = [(id,) for id in self.unseen() if id not in known]
        return [ids for ids in unseen if self.listed[ids] >= WEIGHS * self.listed[()]]

    @property
    def surely_sound(self) -> bool:
        """Whether nothing is wrong by so far that no fit of a cause can change it."""
        return 1.0 - self.listed[()] < SURELY * self.odds * self.listed[()]


@dataclass(frozen=True)
class Judgement:
    """A verdict, the accepted set, the ids not distinguishable from it, and hidden ones."""

    verdict: Verdict
    accepted: Ids = ()
    ambiguous_with: Ids = ()
    not_excluded: Ids = ()


def judge(posterior: Posterior, misfit: float) -> Judgement:
    """The verdict; `misfit` is the chance that noise leaves more than the best set of causes."""
    nothing = posterior.listed[()]
    something = sum(value for ids, value in posterior.listed.items() if ids)
    beyond = sum(posterior.unlisted.values())
    if beyond > nothing + something:
        return Judgement(Verdict.UNEXPLAINED)
    if something < posterior.odds * nothing:
        return Judgement(Verdict.CONSISTENT, not_excluded=posterior.unseen())
    if misfit < MISFIT:
        return Judgement(Verdict.UNEXPLAINED)
    best, rivals, unshown = posterior.best, posterior.rivals(), posterior.unshown()
    if beyond <= DISMISSED * something and all(each in unshown for each in rivals):
        rivals = ()
    others = dict.fromkeys(id for rival in rivals for id in rival if id not in best)
    # An ambiguous cause is not claimed to be the one; a second in addition to it is.
    claimed = len(best) > 1 or not others
    if claimed and beyond > (BEYOND_TWO if len(best) > 1 else DISMISSED) * something:
        return Judgement(Verdict.UNEXPLAINED)
    return Judgement(Verdict.AMBIGUOUS if others else Verdict.NAMED, best, tuple(others))


@dataclass(frozen=True, eq=False)
class Assessment:
    """Explanations of one data set with their probabilities."""

    at: Linearised  # the data, and what every candidate would do to them
    scores: Mapping[Ids, Score]  # where the offsets-only model fits best
    fits: dict[Ids, Fitted]  # nonlinear ones made so far
    unlisted: tuple[Unlisted, ...]
    posterior: Posterior
    judgement: Judgement

    def scaled(self, factor: float) -> Assessment:
        """The same data with the sizes of all causes multiplied, to see what depends on them."""
        return weigh(replace(self.at, white=self.at.white.scaled(factor)), self.unlisted)

    def repeated(self) -> Assessment:
        """The same where the maps of several dates repeat: what is left is no noise, but a shape.

        Only the shape is claimed where nothing else was.
        """
        shape = self.posterior.shape
        if self.judgement.verdict is not Verdict.CONSISTENT or (shape,) not in self.scores:
            return self
        listed = {(): 0.0, (shape,): 1.0}
        posterior = replace(self.posterior, listed=listed, unlisted={})
        return replace(self, posterior=posterior, judgement=Judgement(Verdict.NAMED, (shape,)))

    def fit(self, ids: Ids) -> Fitted:
        """The nonlinear fit of a set of causes, made when first asked for."""
        return self.fit_all([ids])[0]

    def fit_all(self, sets: Sequence[Ids]) -> list[Fitted]:
        """Nonlinear fits of sets of causes, together."""
        new = [ids for ids in sets if ids not in self.fits]
        found = fit_explanations([self.scores[ids] for ids in new])
        self.fits.update(zip(new, found, strict=True))
        return [self.fits[ids] for ids in sets]

    @property
    def chance(self) -> float:
        """Chance that noise as stated leaves more than the calibrated parameters alone do."""
        noise = self.at.white.machine.instrument.noise_mm
        dof = len(self.at.white) - self.alone.offsets.size
        return chance_of_residual(self.alone.square, dof, noise)

    @cached_property
    def alone(self) -> Fitted:
        """The calibrated parameters alone, with a local shape as large as the answer has it."""
        nothing, unexplained = self.fit(()), self.judgement.verdict is Verdict.UNEXPLAINED
        factor = 1.0 if unexplained else self.accepted.scale_factor
        if factor == nothing.scale_factor:
            return nothing
        return fit_explanations([self.scores[()]], factor)[0]

    @property
    def accepted(self) -> Fitted:
        """The fit of the accepted set; of the offsets alone if there is none."""
        return self.fit(self.judgement.accepted)

    @property
    def carried(self) -> Fitted:
        """What lasts, to be carried to other days.

        Of readings of one plane a smooth shape, whatever makes it, and the motions that they show.
        """
        posterior, ids = self.posterior, self.judgement.accepted
        if self.judgement.verdict is Verdict.UNEXPLAINED:
            ids = posterior.best
        if not posterior.shape or (posterior.shape,) not in self.scores:
            return self.accepted
        beside = (id for id in ids if not CAUSES[id].repeats)
        with_shape = tuple(sorted((posterior.shape, *beside)))
        return self.fit(with_shape if with_shape in self.scores else (posterior.shape,))

    @cached_property
    def left_open(self) -> tuple[tuple[float, Fitted], ...]:
        """The explanations that the data leave open, the accepted one first, and their shares."""
        listed, verdict = self.posterior.listed, self.judgement.verdict
        if verdict is Verdict.UNEXPLAINED:
            return ((1.0, self.accepted),)
        open_ = [self.judgement.accepted, *self.posterior.same_answer(self.judgement.accepted)]
        if verdict is Verdict.AMBIGUOUS:
            open_ += self.posterior.rivals()
        elif verdict is Verdict.CONSISTENT:
            open_ += self.posterior.hidden(self.at.white.machine)
        weights = np.array([listed[ids] for ids in open_])
        weights /= weights.sum()
        return tuple(zip(weights.tolist(), self.fit_all(open_), strict=True))

    @cached_property
    def unshown(self) -> tuple[tuple[str, float, Fitted], ...]:
        """Faults of the record, besides the named causes that these data would not show, where they
        may be: each with its share next to what is left open, and the fit that holds it."""
        if self.judgement.verdict is not Verdict.NAMED:
            return ()
        best, posterior = self.judgement.accepted, self.posterior
        total = sum(posterior.listed[ids] for ids in (best, *posterior.same_answer(best)))
        found = []
        for ids in posterior.unshown():
            (more,) = set(ids) - set(best)
            places = self.scores[ids].at_places(PLACE_LIKELY, PLACES)
            fits = fit_explanations([score for _, score in places])
            share = posterior.listed[ids] / total
            found += [(more, share * own, fit) for (own, _), fit in zip(places, fits, strict=True)]
        return tuple(found)

    @cached_property
    def beyond(self) -> tuple[tuple[str, float], ...]:
        """Of what is unexplained: causes that would explain it, how many times their size."""
        if self.judgement.verdict is not Verdict.UNEXPLAINED:
            return ()
        white, broad = self.at.white, self.at.candidates.broad
        found = []
        for cause in broad:
            try:
                (fit,) = fit_explanations([replace(self.scores[(cause.id,)], scale=ANY_SIZE)])
            except PostureError:  # no machine of any size is like that
                continue
            square, spare = float(fit.residual @ fit.residual), len(white) - fit.unknowns
            noise = fit.sigma if self.at.local else self.at.noise.stated
            times = fit.effects[0].times(white.machine)
            if times > BEYOND and chance_of_residual(square, spare, noise) >= MISFIT:
                found.append((square, cause.id, times))
        return tuple((id, times) for _, id, times in sorted(found))

    @property
    def by_place(self) -> tuple[tuple[float, Fitted], ...]:
        """Where several are left open: the same, each fault at every place where it may be."""
        if self.judgement.verdict is not Verdict.AMBIGUOUS:
            return self.left_open
        found = []
        for share, fit in self.left_open:
            least = PLACE_COUNTS / max(share, PLACE_COUNTS)
            best, *others = self.scores[tuple(sorted(fit.ids))].at_places(least, PLACES)
            found.append((share * best[0], fit))
            fits = fit_explanations([score for _, score in others])
            found += [(share * own, fit) for (own, _), fit in zip(others, fits, strict=True)]
        return tuple(found)

    @property
    def offsets(self) -> tuple[Floats, Floats]:
        """Offsets (3,) [mm] and their covariance (3, 3) [mm²] under the judgement.

        Averaged over the explanations that the data leave open, weighted by probability, so
        that the choice among them is part of the uncertainty.
        """
        if self.judgement.verdict is Verdict.UNEXPLAINED:
            # What noise cannot have left must not be laid on stands and scales.
            return self.at.offsets[0], self._unexplained_covariance()
        weights = np.array([share for share, _ in self.left_open])
        values = np.stack([fit.offsets for _, fit in self.left_open])
        within = np.stack([fit.offsets_covariance for _, fit in self.left_open])
        mean = weights @ values
        apart = values - mean
        between = apart[:, :, None] * apart[:, None, :]
        return mean, np.tensordot(weights, within + between, axes=1)

    def _unexplained_covariance(self) -> Floats:
        """Of the offsets-only fit, widened by the likeliest unlisted pattern, (3, 3) [mm²]."""
        pattern = max(self.unlisted, key=lambda unlisted: unlisted.log_evidence)
        fit, white = self.fit(()), self.at.white
        same = np.eye(len(white))
        width = fit.offsets.size
        estimator = np.linalg.pinv(fit.columns[:, :width])
        likeliest = pattern.sigma**2 * same + pattern.columns @ pattern.columns.T
        # Whatever it is may also return with its posture, where repeats cannot average it out:
        # as large in each cell as what is left in the readings.
        left = float(fit.residual @ fit.residual) / max(len(white) - width, 1)
        cells = white.matrix @ (white.plan.cells[:, None] == np.unique(white.plan.cells))
        returning = left * (same + cells @ cells.T)
        spreads = [estimator @ spread @ estimator.T for spread in (likeliest, returning)]
        # Correlated like the larger of the two, and for each offset as wide as the wider.
        larger = max(spreads, key=np.trace)
        widest = np.max([np.diag(spread) for spread in spreads], axis=0)
        widened = np.sqrt(widest / np.diag(larger))
        return np.asarray(larger * np.outer(widened, widened))


def assess(white: Whitened) -> Assessment:
    """Weigh every explanation.

    Raises:
        NotConvergedError: no offsets fit these data.
    """
    at = Linearised.of(white, Candidates.of(white.problem.model, ordered=white.raw))
    return weigh(at, tuple(score_unlisted(at)))


def weigh(at: Linearised, unlisted: tuple[Unlisted, ...]) -> Assessment:
    """Weigh the listed explanations against each other and the unlisted patterns."""
    white, candidates, scores = at.white, at.candidates, score_all(at)
    evidence = {ids: score.log_evidence for ids, score in scores.items()}
    weight = {ids: value + candidates.log_prior[ids] for ids, value in evidence.items()}
    order = sorted(weight, key=lambda ids: -weight[ids])
    remedies = {ids: score.remedy for ids, score in scores.items()}
    patterns = {found.what: found.log_evidence + found.log_prior for found in unlisted}
    odds = ODDS_TO_NAME * white.machine.caution
    shape = white.machine.shape if white.plan.flat else ""
    doubted = tuple(white.machine.doubted)
    fits: dict[Ids, Fitted] = {}
    log_fit: dict[Ids, float] = {}

    def weighed(chosen: Iterable[Ids]) -> Posterior:
        new = list(chosen)
        found = fit_explanations([scores[ids] for ids in new])
        fits.update(zip(new, found, strict=True))
        evidence.update((ids, fits[ids].log_evidence) for ids in new)
        comparable = [ids for ids in new if unit_of(fits[ids].effects) == 1.0]
        log_fit.update((ids, fits[ids].log_likelihood) for ids in comparable)
        listed, beyond = probabilities(evidence, candidates.log_prior, patterns)
        return Posterior(
            listed, beyond, remedies, odds, shape, doubted, candidates.log_prior, log_fit
        )

    # With a local shape that is found to be larger or smaller, the noise is found, too.
    noise_found = at.local
    posterior = weighed(())
    if posterior.surely_sound and not noise_found:
        # Linear scores know no bounds: one of what cannot be negative may fall short of its fit.
        positive = [(cause.id,) for cause in candidates.broad if cause.positive]
        hidden = posterior.hidden(white.machine)
        posterior = weighed(dict.fromkeys([(), *hidden, *positive]))
        if posterior.surely_sound:
            return Assessment(at, scores, fits, unlisted, posterior, judge(posterior, 1.0))
    near = (ids for ids in order[:FITS] if weight[ids] > weight[order[0]] - WORTH_A_FIT)
    posterior = weighed(ids for ids in near if ids not in fits)
    if noise_found:
        # Of printers the causes are large against what linear scores can follow.
        again = [ids for ids in order if ids not in fits and posterior.nearly_dismissed(ids)]
        posterior = weighed(again[:FITS])
    # What has no size is judged by the fits, too; and linear scores know no bounds: what is left
    # open is so by its fit.
    least = WITHOUT_SIZE * posterior.listed[posterior.best]
    likely = [ids for ids, value in posterior.listed.items() if value >= least]
    pairs = [(ids, (id,)) for ids in likely for id in ids if sizeless(ids, (id,))]
    wanted = [*(ids for ids, _ in pairs), *(part for _, part in pairs)]
    for _ in range(FITS):
        wanted += (posterior.best, *posterior.rivals())
        missing = [ids for ids in dict.fromkeys(wanted) if ids not in fits]
        if not missing:
            break
        posterior = weighed(missing)
    best = posterior.best
    if best not in fits:
        posterior = weighed([best])
    left = fits[best].residual
    noise = max(at.noise.stated, fits[best].sigma if noise_found else 0.0)
    misfit = chance_of_residual(float(left @ left), len(white) - fits[best].unknowns, noise)
    found = Assessment(at, scores, fits, unlisted, posterior, judge(posterior, misfit))
    # Evidence alone then lets noise be as large as it must.
    consistent = found.judgement.verdict is Verdict.CONSISTENT
    if noise_found and consistent and found.chance < SUSPICIOUS:
        return replace(found, judgement=Judgement(Verdict.UNEXPLAINED))
    return found
