"""From evidence to an answer: probabilities of all explanations, and which cannot be told apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from orthoglide_cal.diagnosis.evidence import log_sum
from orthoglide_cal.diagnosis.explanations import UNLISTED, Menu, Names
from orthoglide_cal.diagnosis.result import AMBIGUOUS, CONSISTENT, NAMED, UNEXPLAINED

# Something is wrong only if that is this many times likelier than that nothing is: among healthy
# sessions fewer than one in a hundred gets that far.
ODDS_TO_NAME = 1.8
# A rival this unlikely beside the best explanation is dismissed.
DISMISSED = 0.01
# A cause this unlikely beside "nothing is wrong" would have been seen at plausible sizes.
WOULD_BE_SEEN = 0.001
# The best listed explanation must leave no more than noise, at this chance of a false refusal.
MISFIT = 2e-4


@dataclass(frozen=True)
class Posterior:
    """Probabilities of every explanation tried.

    Attributes:
        listed: set of ids → probability; () is "nothing is wrong".
        unlisted: description → probability.
    """

    listed: Mapping[Names, float]
    unlisted: Mapping[str, float]

    @classmethod
    def of(
        cls, log_evidence: Mapping[Names, float], menu: Menu, unlisted: Mapping[str, float]
    ) -> Posterior:
        """Bayes' rule with the menu's prior weights."""
        logs = {key: value + menu.log_prior[key] for key, value in log_evidence.items()}
        share = np.log(UNLISTED / max(len(unlisted), 1))
        others = {key: value + share for key, value in unlisted.items()}
        total = log_sum(np.array([*logs.values(), *others.values()]))
        return cls(
            {key: float(np.exp(value - total)) for key, value in logs.items()},
            {key: float(np.exp(value - total)) for key, value in others.items()},
        )

    @property
    def best(self) -> Names:
        """The most probable set of causes (not empty unless nothing else was tried)."""
        found = {key: value for key, value in self.listed.items() if key}
        return max(found, key=lambda key: found[key]) if found else ()

    @property
    def something(self) -> float:
        """Probability that one or two listed causes are at work."""
        return sum(value for key, value in self.listed.items() if key)

    @property
    def nothing_listed(self) -> float:
        """Probability of the unlisted patterns."""
        return sum(self.unlisted.values())

    def rivals(self) -> tuple[Names, ...]:
        """Sets that these data cannot tell from the best one, most probable first.

        A set that holds the best one and adds to it does not contradict it; one that holds
        another rival and adds to it says nothing new.
        """
        best = self.best
        floor = DISMISSED * self.listed[best]
        found = [
            key
            for key, value in self.listed.items()
            if key and value >= floor and not set(best) <= set(key)
        ]
        kept = [key for key in found if not any(set(other) < set(key) for other in found)]
        return tuple(sorted(kept, key=lambda key: -self.listed[key]))

    def unseen(self) -> tuple[str, ...]:
        """Single causes that may be there although nothing shows, most probable first."""
        floor = WOULD_BE_SEEN * self.listed[()]
        found = [k for k, value in self.listed.items() if len(k) == 1 and value >= floor]
        return tuple(k[0] for k in sorted(found, key=lambda key: -self.listed[key]))


@dataclass(frozen=True)
class Answer:
    """A verdict with the accepted set and the ids that cannot be told from it."""

    verdict: str
    accepted: Names
    ambiguous_with: tuple[str, ...]


def answer(posterior: Posterior, misfit_p: float) -> Answer:
    """The verdict.

    Args:
        posterior: of all explanations.
        misfit_p: chance that noise leaves more than the best set of causes does.
    """
    nothing, best = posterior.listed[()], posterior.best
    listed = nothing + posterior.something
    if posterior.nothing_listed > listed:
        return Answer(UNEXPLAINED, (), ())
    if posterior.something < ODDS_TO_NAME * nothing:
        return Answer(CONSISTENT, (), posterior.unseen())
    if misfit_p < MISFIT:
        return Answer(UNEXPLAINED, (), ())
    others: list[str] = []
    for rival in posterior.rivals():
        others += [cause for cause in rival if cause not in best and cause not in others]
    return Answer(AMBIGUOUS if others else NAMED, best, tuple(others))


def misfit(sum_of_squares: float, dof: float, sigma_mm: float) -> float:
    """Chance that noise of σ alone leaves a larger sum of squares (χ² test)."""
    return float(chdtrc(dof, sum_of_squares / sigma_mm**2)) if dof > 0 else 1.0
