"""Parts of a diagnosis as they are printed: verdict, causes, their gain, what to do next."""

import math
from enum import StrEnum
from typing import Literal, Self

import numpy as np
from pydantic import Field, computed_field

from orthoglide_cal.inference.data import Ids
from orthoglide_cal.losses import MENTION, NEEDLESS_HOLD
from orthoglide_cal.model.model import CONFIDENCE, Estimate, Model
from orthoglide_cal.model.plan import Floats, Plan, Where
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
    # Of each of the two the first cause that the other lacks, or has as well; of one with patterns
    # what it is called among the explanations.
    separates: Ids = ()
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
        known = zip(values.tolist(), machine.determined(expanded), strict=True)
        found = [value if sure else None for value, sure in known]
        keys = "name", "unit", "active", "found", "std", "expanded"
        named = machine.parameter_names, machine.parameter_units, machine.active
        rows = zip(*named, found, std.tolist(), expanded.tolist(), strict=True)
        return tuple(cls(**dict(zip(keys, row, strict=True))) for row in rows)

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


class Noise(Schema):
    """Standard deviation of one reading, by source."""

    used_mm: float = Field(description="what U rests on")
    repeats_mm: float | None = Field(description="from repeated readings")
    residuals_mm: float | None = Field(description="from the residuals")
    stated_mm: float = Field(description="as the machine file states it")
    floor_mm: float = Field(description="resolution / √12")
    dof: int = Field(description="degrees of freedom of the residuals")


class LackOfFit(Schema):
    """Test of the parameters alone against the data.

    Repeats in sequence share one gauge set-up and understate the real scatter: no verdict rests on
    what is judged by them.
    """

    statistic: float = Field(description="residual sum of squares / noise variance")
    dof: int
    p_value: float = Field(description="of a larger residual; a bed's local shape as found")
    repeats_p_value: float | None = Field(description="judged by the scatter of repeats")
    left_mm: float = Field(description="what the parameters alone leave, r.m.s.")
    expected_mm: float = Field(description="what noise as stated would leave, r.m.s.")
    suspicious: float = Field(exclude=True)  # p below which residuals are larger than noise
    noise: Noise = Field(exclude=True)

    @property
    def judgement(self) -> Reason:
        """Statement on whether the residuals are what this gauge's noise would give."""
        stated = {"stated_mm": self.noise.stated_mm}
        if not self.dof:
            return Reason.of("no_spare_readings", **stated)
        code = "residuals_agree"
        if self.p_value < 1.0 - CONFIDENCE:  # words alone: nothing follows from them
            code = "residuals_too_large" if self.p_value < self.suspicious else "residuals_unusual"
        return Reason.of(code, scatter_mm=self.noise.residuals_mm, **stated, p_value=self.p_value)


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
    # Probability of each set of causes that asks the same of a technician, the accepted one first.
    alike: dict[Ids, float] = Field(exclude=True)
    times_stated: float | None = Field(
        description="its largest value by its plausible size, where that is beyond three"
    )
    remedy: Sentence
    recommended: bool = Field(description="to be accepted as part of the machine")
    in_machine: bool = Field(description="false: it lies in the measurement")


class FoundPattern(Schema):
    """Pattern in the readings that no listed cause makes: how they deviate, and where."""

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
    rms_after_mm: float = Field(description="with all that acts in its explanation")
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
    check: Sentence = Field(description="what would show it")
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
