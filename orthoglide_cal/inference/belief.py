"""Belief: every hypothesis about one data set with its probability, and the fits behind it.

A probability follows from prior weight and evidence by Bayes' rule: of a set of listed causes, or
of patterns beyond the list; the evidence is that of the nonlinear fit where one was made, else the
linear one. Nothing is decided here: see `decision`.
"""

import math
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import Self

import numpy as np

from orthoglide_cal.estimation.gaussian import probabilities
from orthoglide_cal.inference.data import Candidates, Ids, Linearised, Whitened
from orthoglide_cal.inference.fit import Fit, fit_hypothesis
from orthoglide_cal.inference.hypothesis import Hypothesis, Pattern, score_all
from orthoglide_cal.inference.patterns import combined, pattern_candidates, placed_causes
from orthoglide_cal.model.measured import Measured
from orthoglide_cal.model.model import Model

# So many likely patterns are combined with causes that have a place.
LIKELY = 5
# Fits of causes are kept up to so many readings in all; that of a longer session is large.
KEPT = 1 << 15


@dataclass(frozen=True, eq=False)
class Belief:
    """Hypotheses about one data set, and how probable each is."""

    measured: Measured
    model: Model  # that they were judged by
    at: Linearised  # the data, and what every candidate would do to them
    hypotheses: Mapping[Ids, Hypothesis]  # sets of listed causes; () is that nothing is wrong
    # Those with patterns beyond the list, by their labels.
    patterned: Mapping[str, Hypothesis] = field(default_factory=dict)
    # Those of listed causes that were fitted, with the evidence of their fits.
    fits: Mapping[Ids, Hypothesis] = field(default_factory=dict)
    # Fits of them and of others, made when asked for; the last is the one asked for last.
    _kept: dict[Ids, Fit] = field(default_factory=dict)
    # Every pattern at every where, looked at closely or not; no tolerance changes them.
    _tried: dict[bool, list[list[Pattern]]] = field(default_factory=dict)

    @classmethod
    def about(cls, measured: Measured, model: Model) -> Self:
        """Weigh every hypothesis by its linear evidence.

        Raises UnusableResultError: no offsets fit these data, or they do not determine any.
        """
        white = Whitened.of(measured, model)
        plan = white.plan
        spots = len(np.unique(plan.repeats[plan.touches]))
        at = Linearised.of(white, Candidates.of(white.problem.model, white.raw, spots))
        listed = cls(measured, model, at, score_all(at)).refined([()])
        patterns = listed.beside(listed.hypotheses[()])
        return replace(listed, patterned={one.label: one for one in patterns})

    def refined(self, sets: Iterable[Ids]) -> Self:
        """The same with the nonlinear fits of some more sets of causes."""
        fits = dict(self.fits)
        for ids in sets:
            if ids not in fits:
                fits[ids] = self.fit_of(ids).judged
        return replace(self, fits=fits) if len(fits) > len(self.fits) else self

    def beside(self, hypothesis: Hypothesis, *, fine: bool = False) -> list[Hypothesis]:
        """Every pattern in addition to what a hypothesis holds, perhaps looked at closely."""
        if fine not in self._tried:
            self._tried[fine] = pattern_candidates(self.fit_of(()), fine=fine)
        return combined(hypothesis, self.fit_of(hypothesis.ids), self._tried[fine])

    def closely(self) -> Self:
        """The same with patterns looked at closely, also in addition to each other.

        The best one with a second one; each single cause with a pattern; the likely ones and the
        best of each kind with causes that have a place, which fitted alone would stand where the
        pattern acts. Each only if prior times evidence grows.
        """
        patterns = {one.label: one for one in self.beside(self.hypotheses[()], fine=True)}
        ordered = sorted(patterns.values(), key=attrgetter("log_weight"))
        likely = {one.patterns[0].how: one for one in ordered} | {
            one.label: one for one in ordered[-LIKELY:-1]
        }
        pairs = self.beside(ordered[-1], fine=True)
        for ids in (ids for ids in self.listed if len(ids) == 1):
            pairs += self.beside(self.hypotheses[ids], fine=True)
        nothing, placed = self.fit_of(()), placed_causes(self.at)
        for hypothesis in likely.values():
            pairs += combined(hypothesis, nothing, placed)
        alone = {label: one.log_weight for label, one in patterns.items()}
        for pair in sorted(pairs, key=attrgetter("log_weight")):
            if pair.log_weight > max(alone.get(one.label, -math.inf) for one in pair.patterns):
                patterns[pair.label] = pair
        return replace(self, patterned=patterns)

    def fit_of(self, ids: Ids) -> Fit:
        """The nonlinear fit of a set of causes."""
        fit = self._kept.pop(ids, None) or fit_hypothesis(self.hypotheses[ids])
        self._kept[ids] = fit
        some = [one for one in self._kept if one]
        if len(some) > 1 and len(some) * len(self.white) > KEPT:
            del self._kept[some[0]]
        return fit

    @property
    def white(self) -> Whitened:
        """The data, in units of independent noise."""
        return self.at.white

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
    def answers(self) -> Mapping[Ids, tuple[Ids, ...]]:
        """Sets that ask the same of a technician as a set does, the most probable first."""
        by_remedy: dict[Hashable, list[Ids]] = {}
        for ids in self.listed:
            by_remedy.setdefault(self.hypotheses[ids].remedy, []).append(ids)
        return {ids: tuple(alike) for alike in by_remedy.values() for ids in alike}

    def share(self, sets: Iterable[Ids]) -> float:
        """Probability of some sets of causes together."""
        return sum(map(self.listed.__getitem__, sets))

    def gain(self, ids: Ids, part: Ids) -> float:
        """Log odds by which the data favour a fault without size, which a set adds to a part of it.

        The smaller of those in the mean over plausible sizes and of those where both fit best: that
        the other causes are then of more usual size is no evidence.
        """
        both = [self.fits.get(one, self.hypotheses[one]) for one in (ids, part)]
        gain = both[0].log_evidence - both[1].log_evidence
        likelihood = [one.log_likelihood for one in both if one.log_likelihood is not None]
        return min(gain, likelihood[0] - likelihood[1]) if len(likelihood) == 2 else gain
