"""Belief: every hypothesis about one data set with its probability, and the fits behind it.

A probability follows from prior weight and evidence by Bayes' rule, whatever the hypotheses are
about. Those of a diagnosis are sets of listed causes, or patterns beyond the list; the evidence is
that of the nonlinear fit where one was made, else the linear one. Nothing is decided here: see
`decision`.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import TypeVar

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.gaussian import log_sum
from orthoglide_cal.inference.data import Candidates, Ids, Linearised, Whitened, unit_of
from orthoglide_cal.inference.fit import Fit, fit_hypothesis
from orthoglide_cal.inference.hypothesis import Hypothesis, Pattern, score_all
from orthoglide_cal.inference.patterns import combined, pattern_candidates, placed_causes
from orthoglide_cal.model.plan import Floats

Key = TypeVar("Key", bound=Hashable)
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


@dataclass(frozen=True, eq=False)
class Belief:
    """Hypotheses about one data set with their probabilities and fits."""

    at: Linearised  # the data, and what every candidate would do to them
    hypotheses: Mapping[Ids, Hypothesis]  # sets of listed causes; () is that nothing is wrong
    patterns: Mapping[str, Hypothesis]  # those beyond the list, by their labels
    fits: Mapping[Ids, Fit] = field(default_factory=dict)  # those that the probabilities rest on
    # Fits of other hypotheses, made when first asked for; they change no probability.
    _further: dict[Ids, Fit] = field(default_factory=dict)
    # Every pattern at every where, looked at closely or not; no tolerance changes them.
    _tried: dict[bool, list[list[Pattern]]] = field(default_factory=dict)

    @classmethod
    def about(cls, white: Whitened) -> Belief:
        """Weigh every hypothesis by its linear evidence.

        Raises UnusableResultError: no offsets fit these data.
        """
        plan = white.plan
        spots = len(np.unique(plan.repeats[plan.touches]))
        at = Linearised.of(white, Candidates.of(white.problem.model, white.raw, spots))
        hypotheses = score_all(at)
        belief = cls(at, hypotheses, {}).refined([()])
        return replace(belief, patterns={one.label: one for one in belief.beside(())})

    def scaled(self, factor: float) -> Belief:
        """The same data and patterns with the plausible sizes of all causes multiplied."""
        at = replace(self.at, white=self.at.white.scaled(factor, CAUSES.values()))
        return Belief(at, score_all(at), self.patterns, _tried=self._tried)

    def refined(self, sets: Iterable[Ids]) -> Belief:
        """The belief with the nonlinear fits of some more sets of causes."""
        fits = {ids: self.fit(ids) for ids in sets}
        return replace(self, fits={**self.fits, **fits}) if fits.keys() - self.fits else self

    def beside(self, ids: Ids) -> list[Hypothesis]:
        """Every pattern in addition to a set of causes, not looked at closely."""
        return combined(self.hypotheses[ids], self.fit(ids), self._every(fine=False))

    def _every(self, *, fine: bool) -> list[list[Pattern]]:
        if fine not in self._tried:
            self._tried[fine] = pattern_candidates(self.fit(()), fine=fine)
        return self._tried[fine]

    def closely(self) -> Belief:
        """The belief with patterns looked at closely, also in addition to each other.

        The best one with a second one; each single cause with a pattern; the likely ones and the
        best of each kind with causes that have a place, which fitted alone would stand where the
        pattern acts. Each only if prior times evidence grows.
        """
        nothing, every = self.fit(()), self._every(fine=True)
        patterns = {one.label: one for one in combined(self.hypotheses[()], nothing, every)}
        ordered = sorted(patterns.values(), key=attrgetter("log_weight"))
        likely = {one.patterns[0].how: one for one in ordered} | {
            one.label: one for one in ordered[-LIKELY:-1]
        }
        pairs = combined(ordered[-1], nothing, every)
        for ids in (ids for ids in self.listed if len(ids) == 1):
            pairs += combined(self.hypotheses[ids], self.fit(ids), every)
        placed = placed_causes(self.at)
        for hypothesis in likely.values():
            pairs += combined(hypothesis, nothing, placed)
        alone = {label: one.log_weight for label, one in patterns.items()}
        for pair in sorted(pairs, key=attrgetter("log_weight")):
            if pair.log_weight > max(alone.get(one.label, -math.inf) for one in pair.patterns):
                patterns[pair.label] = pair
        return replace(self, patterns=patterns)

    def fit(self, ids: Ids) -> Fit:
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
        patterns = self.patterns.items()
        beyond = {label: scored.log_weight for label, scored in patterns}
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
