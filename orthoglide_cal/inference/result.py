"""The result of a diagnosis: a verdict, the accepted causes, what they gain, what to do next."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal, Self

import numpy as np
from pydantic import Field, computed_field

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import determined
from orthoglide_cal.estimation.budget import Budget, Contribution
from orthoglide_cal.estimation.losses import MENTION, NEEDLESS_HOLD
from orthoglide_cal.inference.data import Ids
from orthoglide_cal.inference.fit import Fit
from orthoglide_cal.model.cause import Effect, Estimate
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.model.measured import Differences, Measured
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, Plan, ReadOnly, Where
from orthoglide_cal.schema import Minutes, Reason, Schema, Sentence

# Probability from which it is told that nothing may be wrong at all: to read it costs less than to
# look in vain for a fault.
WORTH_SAYING = MENTION / NEEDLESS_HOLD


class Verdict(StrEnum):
    """Statement of the data about the offsets-only model."""

    CONSISTENT = "consistent"  # nothing contradicts it
    NAMED = "named"  # one explanation stands out
    AMBIGUOUS = "ambiguous"  # several explain the data
    UNEXPLAINED = "unexplained"  # something is wrong, and it is none of the causes


class NextMeasurement(Schema):
    """A measurement that could be taken next; what it is worth once it is ranked."""

    what: Sentence  # to do
    minutes: Minutes  # that it takes
    # The new readings alone; part, set-ups, order and hours as in the joined data.
    plan: Plan = Field(exclude=True)
    # The stands are still where they were: same part, same set-ups.
    continues: bool = Field(default=False, exclude=True)
    # What `measure` is told for it if it is a session of its own; None if it continues what was
    # read.
    session: str | None = None
    separates: Ids = ()  # of each of the two the first cause that the other lacks, or has as well
    # Of the two likeliest explanations that it distinguishes, the causes that the other lacks, or
    # all if one has no more; empty if nothing is open that readings tell.
    between: tuple[Ids, ...] = ()
    # Expected distance between their predictions; 0 without them [standard deviations].
    separation_sigma: float = 0.0
    chance: float = 0.0  # that it leaves one answer; 0 where nothing is open that readings tell
    # U of the parameters that `solve` is expected to print of all readings together, or of a
    # session of its own alone, shape (p,).
    expanded: Floats = Field(default_factory=lambda: np.zeros(0), exclude=True)
    expanded_mm: dict[str, float] = Field(default_factory=dict)  # of those that are lengths


class Parameter(Schema):
    """One parameter that a calibration determines."""

    name: str
    unit: str
    active: float = Field(description="what the controller has")
    found: float | None = Field(description="true = indicated + found; null if not determined")
    std: float = Field(description="standard uncertainty u")
    expanded: float = Field(description="expanded uncertainty U = k u")
    enter: float | None = Field(None, description="what to enter; null unless released")
    determined: bool = Field(default_factory=lambda known: known["found"] is not None)

    @classmethod
    def all_of(cls, model: Model, values: Floats, std: Floats, k: float) -> tuple[Self, ...]:
        """Every parameter of a machine from values and standard uncertainties (p,), U = k u."""
        machine, expanded = model.machine, k * std
        known = zip(values.tolist(), determined(model, expanded), strict=True)
        columns = {
            "name": machine.parameter_names,
            "unit": machine.parameter_units,
            "active": machine.active,
            "found": [value if sure else None for value, sure in known],
            "std": std.tolist(),
            "expanded": expanded.tolist(),
        }
        rows = zip(*columns.values(), strict=True)
        return tuple(cls(**dict(zip(columns, row, strict=True))) for row in rows)

    def change(self, decimals: int) -> float:
        """The change as it is entered, if it is; nothing of what the readings do not determine."""
        if self.enter is not None:
            return round(self.enter - self.active, 9) + 0.0
        return 0.0 if self.found is None else round(self.found, decimals) + 0.0

    def new(self, decimals: int) -> float:
        """Value that is active once it is entered, free of the errors of binary addition."""
        return round(self.active + self.change(decimals), 9) + 0.0


class Explanation(Schema):
    """A possible state of machine and record."""

    ids: Ids = Field((), description="causes that act together; empty: nothing is wrong")
    pattern: str | None = Field(None, description="that no listed cause makes: how and where")
    probability: float = Field(
        description="of a sound machine those of exchanges are estimates, a little too large"
    )
    rms_mm: float | None = Field(None, description="what it leaves; null: not fitted")
    parameters: tuple[Parameter, ...] = ()
    sizes: dict[str, tuple[Estimate, ...]] = Field({}, description="parameters of its causes")

    @property
    def sound(self) -> bool:
        """True if it is that nothing is wrong."""
        return not self.ids and self.pattern is None


def nothing_wrong(explanations: Iterable[Explanation]) -> float | None:
    """Probability of a sound machine, soundly measured; None where it is not worth saying."""
    probability = next((one.probability for one in explanations if one.sound), 0.0)
    return probability if probability >= WORTH_SAYING else None


class LackOfFit(Schema):
    """Test of the parameters alone against the data.

    Repeats in sequence share one gauge set-up and understate the real scatter: no verdict rests on
    what is judged by them.
    """

    statistic: float = Field(description="residual sum of squares / noise variance")
    dof: int
    p_value: float = Field(description="of a larger residual; a bed's local shape as found")
    repeats_p_value: float | None = Field(description="judged by the scatter of repeats")
    repeats_mm: float | None = Field(description="that scatter")
    left_mm: float = Field(description="what the parameters alone leave, r.m.s.")
    expected_mm: float = Field(description="what noise as stated would leave, r.m.s.")
    noise_mm: float = Field(description="standard deviation of one reading, as stated")
    residual_mm: float = Field(description="r.m.s. of the residuals per degree of freedom")


class FoundCause(Schema):
    """A cause that was found; several act together."""

    id: str
    probability: float
    where: str = Field(description="empty: the whole machine")
    parameters: tuple[Estimate, ...]
    adds_mm: float = Field(description="r.m.s. of its part that the machine's parameters leave")
    rms_before_mm: float
    rms_after_mm: float
    heldout_before_mm: float = Field(description="error on readings not fitted, without it")
    heldout_after_mm: float = Field(description="and with it")
    heldout_ratio: float = Field(description="the latter by what is stated for it, r.m.s.")
    aliases: Ids = Field(description="what would look like it")
    times_stated: float | None = Field(
        description="its largest value by its plausible size, where that is beyond three"
    )
    remedy: str
    recommended: bool = Field(description="to be accepted as part of the machine")
    in_machine: bool = Field(description="false: it lies in the measurement")


class FoundPattern(Schema):
    """Something in the readings that no listed cause makes: how they deviate, and where."""

    how: Literal["repeats", "drifts", "settles", "steps", "scatters", "hysteresis", "temperature"]
    where: Where = Field(description="leg, direction, posture, region of a bed, as they apply")
    from_minutes: float | None = Field(description="when it steps, or begins to settle")
    between: tuple[Where, ...] = Field(
        (), description="the last reading before a step and the first after it, order: rank in time"
    )
    size_mm: float = Field(
        description="largest peak-to-peak effect on the readings of one gauge; of scatters the"
        " standard deviation of the additional noise"
    )
    expanded_mm: float = Field(description="U of that size, of a normal distribution")
    parameters: tuple[Estimate, ...] = Field(description="of a gauge y_x: along y on leg x")
    probability: float
    accepted: bool = Field(description="part of the likeliest explanation")
    rms_before_mm: float = Field(description="left by the offsets alone")
    rms_after_mm: float | None = Field(
        description="with all that acts in its explanation; null in addition to more noise"
    )
    heldout_before_mm: float | None = Field(
        description="error of predicting its readings, a cycle left out at a time, without it"
    )
    heldout_after_mm: float | None = Field(description="and with it")
    heldout_ratio: float | None = Field(description="the latter by the former; null: one cycle")
    last_third_before_mm: float | None = Field(
        None, description="the same error in the last third of each set-up, of patterns in time"
    )
    last_third_after_mm: float | None = None
    # What it adds to each reading, and U of that, shape (n,); empty for a table of differences.
    effect_mm: tuple[float, ...] = Field((), exclude=True)
    effect_expanded_mm: tuple[float, ...] = Field((), exclude=True)


class UnshownFault(Schema):
    """A fault of the record, besides the named causes, that these readings would not show."""

    id: str
    where: str = Field(description="empty: the whole table")
    check: str = Field(description="what would show it")
    change: float = Field(description="largest change of a parameter if it is there")
    unit: str = Field(description="of that parameter")
    matters: bool = Field(description="a parameter changes by more than U: nothing is released")


class Baselines(Schema):
    """Held-out errors of a printer: of its extension, and of what needs no cause."""

    parameters_mm: float = Field(description="of the calibrated parameters alone")
    extension_mm: float = Field(description="with the carried shape, or causes, and motions")
    quartic_mm: float | None = Field(None, description="with a carried quartic surface")
    earlier_map_mm: float | None = Field(None, description="with the map of the first date")
    repeats: float | None = Field(None, description="correlation of the maps of several dates")

    @computed_field(description="what predicts better than extension and parameters, if anything")
    @property
    def better(self) -> Literal["quartic", "earlier_map"] | None:
        best: Literal["quartic", "earlier_map"] | None = None
        least = min(self.parameters_mm, self.extension_mm)
        if self.quartic_mm is not None and self.quartic_mm < least:
            best, least = "quartic", self.quartic_mm
        return "earlier_map" if (self.earlier_map_mm or math.inf) < least else best


class TimesStated(Schema):
    """A cause that would explain everything, but only far beyond its plausible size."""

    id: str
    times: float = Field(description="its largest value by its plausible size")


class AssumedSize(Schema):
    """The plausible size of a cause that the machine file does not state."""

    id: str
    size: float
    unit: str


class Otherwise(Schema):
    """The answer with all plausible sizes changed."""

    verdict: Verdict
    ids: Ids


@dataclass(frozen=True, eq=False)
class Diagnosis(ReadOnly):
    """Everything that the simulation gets wrong for one file."""

    measured: Measured
    model: Model  # that they were judged by
    verdict: Verdict
    lack_of_fit: LackOfFit  # of the offsets-only model
    causes: tuple[FoundCause, ...]  # accepted ones, best first; empty if none is
    # Of a printer, what the extension is compared with; None where it was not asked.
    baselines: Baselines | None
    ambiguous_with: Ids  # ids that these data cannot separate from the answer
    not_excluded: Ids  # ids that may be there where nothing shows
    # Fits of the explanations that the data leave open, each after its share; the accepted one
    # comes first.
    left_open: tuple[tuple[float, Fit], ...]
    # The same, each fault at every place where it may be if the verdict is ambiguous; after a named
    # answer, faults that would not show but matter.
    by_place: tuple[tuple[float, Fit], ...]
    offsets_mm: Floats  # their mean, shape (3,)
    covariance_mm2: Floats  # of the offsets, shape (3, 3); carries the choice within an alias class
    alone: Solution  # the calibrated parameters alone
    explained_mm: Floats  # prediction of the accepted model, or with patterns, shape (n,)
    # With all tolerances "halved" and "doubled"; empty if it was not asked for.
    sensitivity: Mapping[str, Otherwise]
    # Those not dismissed, best first, those that are left open with their parameters.
    explanations: tuple[Explanation, ...]
    # Faults of the record that would not show besides the named causes.
    unshown: tuple[UnshownFault, ...] = ()
    # Beyond the list, best first; empty unless the verdict is that something is.
    patterns: tuple[FoundPattern, ...] = ()
    enterable: float = 0.0  # probability of patterns that falsify no offsets
    wrong_readings: tuple[int, ...] = ()  # their indices, by what explains these data best
    # What refuted the causes that explain the data best; None where nothing did.
    refuted: Reason | None = None
    # Causes that would explain what is unexplained, far beyond their size.
    beyond_tolerance: tuple[TimesStated, ...] = ()
    # Size of each cause that was tried at its default: the machine file gives none.
    assumed_sizes: tuple[AssumedSize, ...] = ()
    notes: tuple[Reason, ...] = ()

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The accepted causes as fitted to these data, in the order of `causes`."""
        effects = {effect.cause.id: effect for effect in self.left_open[0][1].effects}
        return tuple(effects[cause.id] for cause in self.causes)

    @property
    def undecided(self) -> bool:
        """True if the offsets depend on what these data leave open, or would not show."""
        return self.verdict is Verdict.AMBIGUOUS or any(fault.matters for fault in self.unshown)

    @property
    def put_right(self) -> Measured:
        """The data without the named faults that belong to this session alone.

        Differences stay as they are, and so do readings in which a fault cannot be undone.
        """
        measured = self.measured
        if isinstance(measured, Differences) or self.verdict is not Verdict.NAMED:
            return measured
        value, machine = measured.value, self.model.machine
        for effect in self.effects:
            if not effect.cause.lasting:
                value = effect.cause.inverted(value, effect, measured.plan, machine)
        return replace(measured, value=value)

    def require_recommended(self, id: str) -> None:
        """Refuse to make a cause part of the machine that it names but does not recommend for it.

        Raises:
            UnusableResultError: with what to do instead.
        """
        for cause in self.causes:
            if cause.id == id and CAUSES[id].lasting and not cause.recommended:
                many = self.model.machine.vocabulary.many
                raise UnusableResultError(
                    f"Making {id} part of the machine's model is not recommended: it does not"
                    f" last as it is, does not predict better than {many} only, or something else"
                    " explains these data as well.",
                    cause.remedy,
                )

    def adds_to(self, solution: Solution) -> tuple[Contribution, ...]:
        """Contributions to the uncertainty of a solution's offsets for these data, by cause.

        Each explanation, besides the offsets alone, by the probability that the data leave it: how
        far it would move the offsets, and how much less sure of them it is.
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
        """Causes open in place of the answer or besides it, in the order of `ambiguous_with`.

        Causes that act together are one, unless each of them is open alone, too.
        """
        (_, answer), *others = self.left_open
        apart = [tuple(id for id in fit.ids if id not in answer.ids) for _, fit in others]
        order, alone = self.ambiguous_with, {ids for ids in apart if len(ids) == 1}
        kept = {
            ids
            for ids in apart
            if set(ids) <= set(order) and (ids in alone or any((id,) not in alone for id in ids))
        }
        return tuple(sorted(kept - {()}, key=lambda ids: [order.index(id) for id in ids]))
