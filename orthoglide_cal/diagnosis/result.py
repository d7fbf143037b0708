"""The result of a diagnosis: a verdict, the accepted causes, what they gain, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis.candidates import Ids
from orthoglide_cal.diagnosis.explanations import Whitened
from orthoglide_cal.diagnosis.fit import Fitted
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.estimation.budget import Budget, Contribution
from orthoglide_cal.model import (
    Differences,
    Effect,
    Estimate,
    Floats,
    Measured,
    Model,
    ReadOnly,
)
from orthoglide_cal.model.influence import Origin
from orthoglide_cal.schema import Minutes, Schema

# Probability from which it is told that nothing may be wrong at all.
WORTH_SAYING = 0.005
# The fit takes one or two Gauss–Newton steps, which leave up to a quarter of a standard deviation.
OPTIMAL = 0.5


class Verdict(StrEnum):
    """What the data say of the offsets-only model."""

    CONSISTENT = "consistent"  # nothing speaks against it
    NAMED = "named"  # one explanation stands out
    AMBIGUOUS = "ambiguous"  # several explain the data
    UNEXPLAINED = "unexplained"  # something is wrong, and it is none of the causes


class NextMeasurement(Schema):
    """A measurement that may decide what is open.

    Attributes:
        what: to do, in words.
        minutes: that it takes.
        separates: of each of the two the first cause that the other lacks, or has as well.
        between: of the two likeliest explanations that it distinguishes, the causes that the other
            lacks, or all if one has no more; empty if nothing is open that readings tell.
        separation_sigma: expected distance between their predictions; 0 without them [standard
            deviations].
    """

    what: str
    minutes: Minutes
    separates: Ids
    between: tuple[Ids, ...]
    separation_sigma: float


class Explanation(NamedTuple):
    """What may be behind the data.

    Attributes:
        causes: ids of listed causes; () for "nothing is wrong" or a pattern.
        pattern: one that no listed cause makes, in words; None for listed causes.
    """

    causes: Ids = ()
    pattern: str | None = None


@dataclass(frozen=True)
class LackOfFit:
    """Does the offsets-only model explain the data to within this gauge's noise?

    Attributes:
        statistic: residual sum of squares over noise variance.
        dof: its degrees of freedom.
        p_value: probability of a larger one if nothing but noise is left.
        noise_mm: standard deviation of one reading that it was judged by.
        residual_mm: root mean square of the residuals per degree of freedom.
        repeats_mm: scatter of repeated readings; None without repeats. Repeats in sequence share
            one gauge set-up and understate the real scatter, so the verdict does not rest on it.
        repeats_p_value: chance that repeats of that scatter leave this residual (F test).
    """

    statistic: float
    dof: int
    p_value: float
    noise_mm: float
    residual_mm: float
    repeats_mm: float | None
    repeats_p_value: float | None


@dataclass(frozen=True)
class NamedCause:
    """A cause that the diagnosis accepts; several act together.

    Attributes:
        effect: the cause with its parameters and their covariance, as fitted to these data.
        parameters: name on this kind of machine → value with standard deviation, in the
            contract's unit.
        where: its place in words ("" for the whole machine), e.g. "leg x, direction y".
        advice: what a technician can do about it, and where.
        probability: posterior probability among all explanations tried.
        rms_before_mm, rms_after_mm: residuals of the fit without and with the cause.
        heldout_before_mm, heldout_after_mm: prediction errors on readings not fitted.
        heldout_ratio: held-out errors divided by what the extended model states for them, r.m.s.
        aliases: ids that explain the data as well at plausible sizes.
        recommended: True if accepting it as an extension of the machine is recommended.
    """

    effect: Effect
    parameters: Mapping[str, Estimate]
    where: str
    advice: str
    probability: float
    rms_before_mm: float
    rms_after_mm: float
    heldout_before_mm: float
    heldout_after_mm: float
    heldout_ratio: float
    aliases: Ids
    recommended: bool

    @property
    def id(self) -> str:
        """Cause id of the contract."""
        return self.effect.cause.id

    @property
    def in_machine(self) -> bool:
        """True if the cause is in the machine (not in the measurement)."""
        return self.effect.cause.in_machine


@dataclass(frozen=True, eq=False)
class Diagnosis(ReadOnly):
    """What the simulation gets wrong for one file.

    Attributes:
        measured: the data.
        model: the machine and its accepted causes that they were judged by.
        verdict: in one word.
        lack_of_fit: of the offsets-only model.
        causes: accepted ones, best first; empty if none is.
        ambiguous_with: ids that these data cannot separate from the answer.
        left_open: fits of the explanations that the data leave open, each after its share; the
            accepted one comes first.
        by_place: the same, each fault at every place where it may be if the verdict is ambiguous.
        offsets_mm: their mean, shape (3,).
        covariance_mm2: of the offsets, shape (3, 3); carries the choice within an alias class.
        alone_mm: offsets where the offsets-only model fits these data best, all readings alike,
            shape (3,).
        nominal_mm: prediction of the offsets-only model with fitted zeros, shape (n,).
        explained_mm: prediction of the accepted model, shape (n,).
        sensitivity: with all tolerances "halved" and "doubled" → verdict and accepted ids; empty
            if it was not asked for.
        ranking: every explanation tried → posterior probability, best first.
        notes: sentences for the user.
    """

    measured: Measured
    model: Model
    verdict: Verdict
    lack_of_fit: LackOfFit
    causes: tuple[NamedCause, ...]
    ambiguous_with: Ids
    left_open: tuple[tuple[float, Fitted], ...]
    by_place: tuple[tuple[float, Fitted], ...]
    offsets_mm: Floats
    covariance_mm2: Floats
    alone_mm: Floats
    nominal_mm: Floats
    explained_mm: Floats
    sensitivity: Mapping[str, tuple[Verdict, Ids]]
    ranking: Mapping[Explanation, float]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("sensitivity", "ranking"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def put_right(self) -> Measured:
        """The data without the named faults that belong to this session alone.

        Differences stay as they are, and so do readings in which a fault cannot be undone.
        """
        measured = self.measured
        if isinstance(measured, Differences) or self.verdict is not Verdict.NAMED:
            return measured
        value, machine = measured.value, self.model.machine
        for effect in (cause.effect for cause in self.causes):
            if not effect.cause.lasting:
                value = effect.cause.inverted(value, effect, measured.plan, machine)
        return replace(measured, value=value)

    def require_recommended(self, id: str) -> None:
        """Refuse to make a cause part of the machine that it names but does not recommend for it.

        Raises:
            UnusableResultError: with what to do instead.
        """
        for cause in self.causes:
            if cause.id == id and cause.effect.cause.lasting and not cause.recommended:
                many = self.model.machine.vocabulary.many
                raise UnusableResultError(
                    f"Making {id} part of the machine's model is not recommended: it does not"
                    f" last as it is, does not predict better than {many} only, or something else"
                    " explains these data as well.",
                    cause.advice,
                )

    def adds_to(self, solution: Solution) -> tuple[Contribution, ...]:
        """What it adds to the uncertainty of the solution's offsets, by cause.

        Each explanation beside the offsets alone by the probability that the data leave it: how
        far it would move the offsets, and how much less sure of them it is.

        Args:
            solution: of the same data.
        """
        least, fits = solution.covariance_mm2, self.left_open
        if self.verdict is Verdict.UNEXPLAINED:
            return (Contribution.beyond(Origin.EXPLANATIONS, self.covariance_mm2 - least),)
        consistent = self.verdict is Verdict.CONSISTENT
        if consistent:
            (_, alone), *others = fits
            least, fits = alone.joint_covariance(), tuple(others)
        found = []
        for share, fit in fits:
            apart = fit.offsets - solution.offsets_mm
            spread = share * (fit.joint_covariance() - least + np.outer(apart, apart))
            ids = " and ".join(effect.cause.id for effect in fit.effects)
            found.append(Contribution.beyond(ids, spread, possible=consistent))
        return tuple(found)

    @property
    def budget(self) -> Budget:
        """The uncertainty of the offsets by source; what the verdict leaves open comes last."""
        known = self.left_open[0][1].budget(self.model.machine.instrument)
        left = self.covariance_mm2 - known.covariance_mm2
        return known.extended([Contribution.beyond(Origin.EXPLANATIONS, left)])

    @property
    def std_mm(self) -> Floats:
        """Standard deviations of the offsets, shape (3,)."""
        return np.sqrt(np.diag(self.covariance_mm2))

    @property
    def rivals(self) -> tuple[Ids, ...]:
        """What is open in place of the answer or beside it, in the order of `ambiguous_with`.

        Causes that act together are one, unless each of them is open alone, too.
        """
        (_, answer), *others = self.left_open
        ours = {effect.cause.id for effect in answer.effects}
        found = [
            tuple(e.cause.id for e in fit.effects if e.cause.id not in ours) for _, fit in others
        ]
        order, alone = self.ambiguous_with, {ids for ids in found if len(ids) == 1}
        kept = {
            ids
            for ids in found
            if set(ids) <= set(order) and (ids in alone or any((id,) not in alone for id in ids))
        }
        return tuple(sorted(kept - {()}, key=lambda ids: [order.index(id) for id in ids]))

    @property
    def left_mm(self) -> float:
        """What the calibrated parameters alone leave, r.m.s. as the pages show it."""
        return rms(self.measured.weight * (self.measured.value - self.nominal_mm))

    @property
    def expected_mm(self) -> float:
        """What noise as stated would leave, r.m.s.: the fit takes a part of it away, too."""
        lack = self.lack_of_fit
        if not lack.residual_mm:
            return lack.noise_mm
        return self.left_mm * lack.noise_mm / lack.residual_mm

    @property
    def nothing_wrong(self) -> float | None:
        """Probability of a sound machine, soundly measured; None where it is not worth saying."""
        found = self.ranking.get(Explanation(), 0.0)
        return found if found >= WORTH_SAYING else None

    @property
    def spare(self) -> int:
        """How many readings there are beyond the unknowns of the answer."""
        return self.lack_of_fit.dof - sum(cause.effect.cause.unknowns for cause in self.causes)

    @property
    def assumed_tolerances(self) -> Mapping[str, float]:
        """Id → size of each cause that was tried at its default: the machine file gives none."""
        machine = self.model.machine
        tried = {id for explanation in self.ranking for id in explanation.causes}
        return {
            id: cause.size(machine)
            for id, cause in CAUSES.items()
            if id in tried and cause.assumed(machine)
        }

    @cached_property
    def remaining(self) -> float:
        """How far it is from its optimum, recomputed from the data [standard deviations].

        The largest of what each open explanation lacks, with the parameters of the named causes,
        and of how far the offsets are from the explanations' mean.
        """
        white = Whitened.of(self.measured, self.model)
        (_, accepted), *others = self.left_open
        named = {cause.id: cause.effect for cause in self.causes}
        effects = tuple(named[effect.cause.id] for effect in accepted.effects)
        fits = (replace(accepted, effects=effects), *(fit for _, fit in others))
        mean = sum(share * fit.offsets for share, fit in self.left_open)
        apart = np.abs(self.offsets_mm - mean) / self.std_mm
        return float(np.max([*apart, *(fit.remaining(white) for fit in fits)]))

    @property
    def converged(self) -> bool:
        """True if offsets and parameters are the optimum to a fraction of their uncertainty."""
        return self.remaining <= OPTIMAL
