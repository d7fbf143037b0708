"""All explanations of one data set, weighed: probabilities, verdict, the offsets that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.diagnosis.evidence import log_sum
from orthoglide_cal.diagnosis.explanations import UNLISTED, Candidates, Ids, Linearised, Whitened
from orthoglide_cal.diagnosis.fit import Fitted, fit_explanation
from orthoglide_cal.diagnosis.result import Verdict
from orthoglide_cal.diagnosis.scores import Score, Unlisted, score_all, score_unlisted
from orthoglide_cal.estimation.accuracy import chance_of_residual
from orthoglide_cal.model import Floats

# Something is wrong only if that is this many times likelier than that nothing is: among healthy
# sessions fewer than one in a hundred gets that far.
ODDS_TO_NAME = 1.8
# A rival this unlikely beside the best explanation is dismissed.
DISMISSED = 0.01
# A cause this unlikely beside "nothing is wrong" would have been seen at plausible sizes.
WOULD_BE_SEEN = 0.001
# The best listed explanation must leave no more than noise, at this chance of a false refusal.
MISFIT = 2e-4
# Explanations within this much log evidence of the best are fitted nonlinearly, the best few.
WORTH_A_FIT = 8.0
FITS = 3
# A cause this probable beside "nothing is wrong" widens the offsets' uncertainty.
WEIGHS = 0.01


@dataclass(frozen=True)
class Posterior:
    """Probabilities of every explanation tried.

    Attributes:
        listed: set of ids → probability.
        unlisted: pattern in words → probability.
    """

    listed: Mapping[Ids, float]
    unlisted: Mapping[str, float]

    @classmethod
    def of(
        cls,
        log_evidence: Mapping[Ids, float],
        log_prior: Mapping[Ids, float],
        unlisted: Mapping[str, float],
    ) -> Posterior:
        """Bayes' rule; the unlisted patterns share one prior weight."""
        logs = {ids: value + log_prior[ids] for ids, value in log_evidence.items()}
        share = np.log(UNLISTED / max(len(unlisted), 1))
        others = {what: value + share for what, value in unlisted.items()}
        total = log_sum(np.array([*logs.values(), *others.values()]))
        return cls(
            {ids: float(np.exp(value - total)) for ids, value in logs.items()},
            {what: float(np.exp(value - total)) for what, value in others.items()},
        )

    @property
    def best(self) -> Ids:
        """The most probable set of causes (not empty unless nothing else was tried)."""
        return max((ids for ids in self.listed if ids), key=self.listed.__getitem__, default=())

    def rivals(self) -> tuple[Ids, ...]:
        """Sets that these data cannot tell from the best one, most probable first.

        A set that holds the best one and adds to it does not contradict it; one that holds
        another rival and adds to it says nothing new.
        """
        best = self.best
        floor = DISMISSED * self.listed[best]
        found = [
            ids
            for ids, value in self.listed.items()
            if ids and value >= floor and not set(best) <= set(ids)
        ]
        kept = [ids for ids in found if not any(set(other) < set(ids) for other in found)]
        return tuple(sorted(kept, key=lambda ids: -self.listed[ids]))

    def unseen(self) -> Ids:
        """Single causes that may be there although nothing shows, most probable first."""
        floor = WOULD_BE_SEEN * self.listed[()]
        found = [ids for ids, value in self.listed.items() if len(ids) == 1 and value >= floor]
        return tuple(id for (id,) in sorted(found, key=lambda ids: -self.listed[ids]))


@dataclass(frozen=True)
class Judgement:
    """A verdict with the accepted set and the ids that cannot be told from it."""

    verdict: Verdict
    accepted: Ids = ()
    ambiguous_with: Ids = ()


def judge(posterior: Posterior, misfit: float) -> Judgement:
    """The verdict with the set that it accepts.

    Args:
        posterior: of all explanations.
        misfit: chance that noise leaves more than the best set of causes does.
    """
    nothing, best = posterior.listed[()], posterior.best
    something = sum(value for ids, value in posterior.listed.items() if ids)
    if sum(posterior.unlisted.values()) > nothing + something:
        return Judgement(Verdict.UNEXPLAINED)
    if something < ODDS_TO_NAME * nothing:
        return Judgement(Verdict.CONSISTENT, (), posterior.unseen())
    if misfit < MISFIT:
        return Judgement(Verdict.UNEXPLAINED)
    others = dict.fromkeys(id for rival in posterior.rivals() for id in rival if id not in best)
    return Judgement(Verdict.AMBIGUOUS if others else Verdict.NAMED, best, tuple(others))


@dataclass(frozen=True, eq=False)
class Assessment:
    """Explanations of one data set with their probabilities.

    Attributes:
        at: the data, and what every candidate would do to them.
        scores: set of ids → its score where the offsets-only model fits best.
        fits: nonlinear fits made so far.
        unlisted: patterns beyond the list.
        posterior: probabilities.
        judgement: the verdict, and what it accepts.
    """

    at: Linearised
    scores: Mapping[Ids, Score]
    fits: dict[Ids, Fitted]
    unlisted: tuple[Unlisted, ...]
    posterior: Posterior
    judgement: Judgement

    def fit(self, ids: Ids) -> Fitted:
        """The nonlinear fit of a set of causes; made when first asked for."""
        if ids not in self.fits:
            self.fits[ids] = fit_explanation(self.scores[ids])
        return self.fits[ids]

    @property
    def accepted(self) -> Fitted:
        """The fit of the accepted set; of the offsets alone if there is none."""
        return self.fit(self.judgement.accepted)

    @cached_property
    def left_open(self) -> tuple[tuple[float, Fitted], ...]:
        """The explanations that the data leave open, the accepted one first, and their shares."""
        listed, verdict = self.posterior.listed, self.judgement.verdict
        if verdict is Verdict.UNEXPLAINED:
            return ((1.0, self.accepted),)
        open_ = [self.judgement.accepted]
        if verdict is Verdict.AMBIGUOUS:
            open_ += self.posterior.rivals()
        elif verdict is Verdict.CONSISTENT:
            unseen = [(id,) for id in self.posterior.unseen()]
            open_ += [ids for ids in unseen if listed[ids] >= WEIGHS * listed[()]]
        weights = np.array([listed[ids] for ids in open_])
        weights /= weights.sum()
        return tuple(zip(weights.tolist(), map(self.fit, open_), strict=True))

    @property
    def offsets(self) -> tuple[Floats, Floats]:
        """Offsets (3,) [mm] and their covariance (3, 3) [mm²] under the judgement.

        Averaged over the explanations that the data leave open, weighted by probability, so
        that the choice among them is part of the uncertainty.
        """
        if self.judgement.verdict is Verdict.UNEXPLAINED:
            return self.accepted.offsets, self._unexplained_covariance()
        weights = np.array([share for share, _ in self.left_open])
        values = np.stack([fit.offsets for _, fit in self.left_open])
        within = np.stack([fit.joint_covariance() for _, fit in self.left_open])
        mean = weights @ values
        apart = values - mean
        between = apart[:, :, None] * apart[:, None, :]
        return mean, np.tensordot(weights, within + between, axes=1)

    def _unexplained_covariance(self) -> Floats:
        """Of the offsets-only fit, widened by the likeliest unlisted pattern, (3, 3) [mm²]."""
        pattern = max(self.unlisted, key=lambda unlisted: unlisted.log_evidence)
        fit, white = self.fit(()), self.at.white
        same = np.eye(len(white))
        estimator = np.linalg.pinv(fit.columns[:, :3])
        likeliest = pattern.sigma**2 * same + pattern.columns @ pattern.columns.T
        # Whatever it is may also return with its posture, where repeats cannot average it out:
        # as large in each cell as what is left in the readings.
        left = float(fit.residual @ fit.residual) / max(len(white) - 3, 1)
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
    candidates = Candidates.of(white.problem.model, ordered=white.raw)
    at = Linearised.of(white, candidates)
    scores, unlisted = score_all(at), score_unlisted(at)
    evidence = {ids: score.log_evidence for ids, score in scores.items()}
    weight = {ids: value + candidates.log_prior[ids] for ids, value in evidence.items()}
    order = sorted(weight, key=lambda ids: -weight[ids])[:FITS]
    chosen = [ids for ids in order if weight[ids] > weight[order[0]] - WORTH_A_FIT]
    fits = {ids: fit_explanation(scores[ids]) for ids in chosen}
    evidence |= {ids: fit.log_evidence for ids, fit in fits.items()}
    posterior = Posterior.of(
        evidence, candidates.log_prior, {found.what: found.log_evidence for found in unlisted}
    )
    best = posterior.best
    if best not in fits:
        fits[best] = fit_explanation(scores[best])
    left = fits[best].residual
    misfit = chance_of_residual(
        float(left @ left), len(white) - fits[best].unknowns, white.machine.gauge.noise_mm
    )
    return Assessment(at, scores, fits, tuple(unlisted), posterior, judge(posterior, misfit))
