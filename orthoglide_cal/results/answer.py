"""The answer to one measurement, as `--json` prints and every page draws it, and its identity.

`true position = indicated + found`. Lengths are in mm unless a unit is given. A list over
the parameters has one entry for each of `parameters`, in their order.
"""

import hashlib
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Literal, Self

from pydantic import AwareDatetime, Field, computed_field

from orthoglide_cal import __version__
from orthoglide_cal.estimation.budget import Contribution
from orthoglide_cal.estimation.solution import PromisedDifference
from orthoglide_cal.files.input import Input, InputFile
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.files.readings import GaugeIdentity
from orthoglide_cal.inference.data import Ids
from orthoglide_cal.inference.result import (
    AssumedSize,
    Baselines,
    Explanation,
    FoundCause,
    FoundPattern,
    LackOfFit,
    NextMeasurement,
    Noise,
    Otherwise,
    Parameter,
    TimesStated,
    UnshownFault,
    Verdict,
)
from orthoglide_cal.model.workspace import Workspace
from orthoglide_cal.schema import Reason, Schema, Sentence

STEP_K = 2.0  # a change of temperature beyond this is said next to the verdict
# Options of `measure` in remedies: further readings after these; some of these once more.
THEN, RETAKE = "--then", "--resume"


class MachineName(Schema):
    """The machine that it is judged by."""

    name: str
    kind: str


class Remedy(Schema):
    """Step to take about the result, or instead of entering it.

    A command about the same file follows the sentence, of `verb` and `options`; "measure" with
    options of its own begins a session.
    """

    sentence: Sentence
    verb: str | None = None
    options: str = ""

    @classmethod
    def of(cls, code: str, verb: str | None = None, options: str = "", **data: object) -> Self:
        return cls(sentence=Reason.of(code, **data), verb=verb, options=options)


class Release(Schema):
    """Decision whether the parameters may be entered in the controller."""

    reasons: tuple[Sentence, ...] = Field((), description="why not; empty if they may be")
    cautions: tuple[Sentence, ...] = Field((), description="what to know although they may be")
    remedies: tuple[Remedy, ...] = Field((), description="what to do instead, or about causes")
    sound: bool = Field(True, description="false: no parameters, or they fail their own check")
    needed: bool = Field(True, description="false: entering nothing has the least expected loss")

    @computed_field(description="they may be entered")
    @property
    def usable(self) -> bool:
        return not self.reasons

    @computed_field(description="usable, and not needed")
    @property
    def settled(self) -> bool:
        return self.usable and not self.needed

    @computed_field(description="of the reasons, then of the cautions")
    @property
    def codes(self) -> tuple[str, ...]:
        return tuple(reason.code for reason in (*self.reasons, *self.cautions))


class UsedGauge(GaugeIdentity):
    """A gauge of a session; what the session does not say of it, the machine file may."""

    resolution_mm: float | None = None
    overdue: bool = Field(description="that day was past when it was used")


class Validity(Schema):
    """Conditions of one measurement; null or empty where nobody recorded them."""

    measured: str | None = Field(description="when it ended, else began")
    operator: str | None
    gauges: tuple[UsedGauge, ...]
    temperature_start_c: float | None
    temperature_end_c: float | None
    reservations: tuple[Sentence, ...] = Field(description="what to know before relying on it")

    @property
    def cautions(self) -> tuple[Reason, ...]:
        """The reservations on the result itself, not on its papers."""
        return tuple(r for r in self.reservations if r.code != "not_recorded")


class Alone(Schema):
    """The parameters without any cause."""

    parameters: tuple[Parameter, ...]
    rms_after_mm: float


class Residue(Schema):
    """r.m.s. of data, and what the parameters (with the causes found) leave of them."""

    before_mm: float
    after_mm: float


class Residual(Schema):
    """One reading (or difference): measured and modelled."""

    leg: str | None = None
    direction: str | None = None
    posture: str | None = Field(None, description="or the name of the difference")
    end: str | None = Field(None, description="joint or tool, of the single-posture protocol")
    displacement_mm: float | None = Field(None, description="of the leg's carriage")
    gauge_at: float | None = None
    part: int | None = Field(None, description="gauge set-up of the leg and direction, from 1")
    x_mm: float | None = Field(None, description="place of a touch")
    y_mm: float | None = None
    z_mm: float | None = None
    surface_mm: float | None = Field(None, description="height of the touched surface")
    distance: bool = Field(False, description="a measured distance instead of a height")
    cycle: int = 1
    order: int = Field(description="rank in time, from 1")
    minutes: float | None = Field(None, description="since the session began")
    temperature_c: float | None = None
    moved_mm: float | None = Field(None, description="since the reading before; null: the first")
    measured_mm: float
    modelled_mm: float = Field(description="with the parameters alone")
    with_causes_mm: float | None = Field(None, description="with causes, or patterns, found")
    pattern_mm: tuple[float, ...] = Field((), description="by each accepted pattern, in order")
    pattern_expanded_mm: tuple[float, ...] = Field((), description="U of that")
    wrong: bool = Field(False, description="called wrong by itself: nothing else rests on it")


class Undetermined(Schema):
    """A parameter that these readings do not determine, and how far it may be off."""

    name: str
    within: float
    unit: str


class CheckReading(Schema):
    """One difference to measure after entering; the gauge stands on its leg."""

    what: str = Field(description="which difference")
    leg: str
    direction: str
    first_mm: tuple[float, ...] = Field(description="tool position of the first reading")
    second_mm: tuple[float, ...]
    ends: bool = Field(description="the gauge moves from joint to tool end instead")
    gauge_mm: float | None = Field(description="from the carriage joint along the leg; null: both")
    before_mm: float
    expected_mm: float
    expanded_mm: float


class OfDate(Schema):
    """The parameters on one of several dates that were judged together."""

    path: str
    parameters: tuple[Parameter, ...]


class Answer(Schema):
    """Everything that one measurement says.

    `parameters` are those under the verdict: with the causes where they are `named`, widened by the
    open choice where it is `ambiguous`.
    """

    schema_version: Literal[2] = 2
    input: InputFile
    inputs: tuple[InputFile, ...] = Field((), description="of --together, oldest first")
    dates: tuple[OfDate, ...] = Field((), description="of --together: parameters of each date")
    machine: MachineName
    simulated: bool = Field(description="a simulator made readings: never exported, nor written")
    method: str | None = Field(None, description="null: there is no result")
    verdict: Verdict | None = Field(None, description="null: there is no result")
    refuted: Sentence | None = Field(None, description="what refutes the best explanation")
    judgement: Sentence | None = Field(None, description="are the residuals what noise would give?")
    explanations: tuple[Explanation, ...] = Field((), description="those not dismissed, best first")
    release: Release
    validity: Validity
    parameters: tuple[Parameter, ...] = ()
    decimals: int = Field(3, description="of what is entered")
    k: float | None = Field(None, description="coverage factor U/u")
    dof: int | None = Field(None, description="of k; null: normal distribution")
    correlation: tuple[tuple[float, ...], ...] = ()
    sigma_rho_mm: float | None = Field(None, description="√(trace/3) of joint offsets")
    alone: Alone | None = Field(None, description="null unless a named cause changes parameters")
    rms: Residue | None = None
    noise: Noise | None = None
    deviations: tuple[PromisedDifference, ...] = ()
    deviations_rms: Residue | None = Field(None, description="as measured, and after entering")
    budget: tuple[Contribution, ...] = ()
    lack_of_fit: LackOfFit | None = None
    converged: bool = False
    residuals: tuple[Residual, ...] = ()
    causes: tuple[FoundCause, ...] = Field((), description="best first")
    patterns: tuple[FoundPattern, ...] = Field((), description="beyond the list, best first")
    baselines: Baselines | None = None
    ambiguous_with: Ids = ()
    beyond_tolerance: tuple[TimesStated, ...] = Field(
        (), description="would explain all, but far beyond their plausible size"
    )
    unshown: tuple[UnshownFault, ...] = Field((), description="possible besides the named causes")
    ruled_out: Ids = Field((), description="looked at by hand, and not there")
    not_excluded: Ids = Field((), description="may be there, too small to show")
    assumed: Ids = Field((), description="causes whose plausible size nobody stated")
    assumed_sizes: tuple[AssumedSize, ...] = ()
    undetermined: tuple[Undetermined, ...] = ()
    holdout: str | None = Field(None, description="file of held-out readings; null: cell by cell")
    next_measurement: NextMeasurement | None = None
    check: CheckReading | None = None
    workspace: Workspace | None = None
    sensitivity: Mapping[Literal["halved", "doubled"], Otherwise] | None = Field(
        None, description="with all plausible sizes changed"
    )
    others: tuple["Answer", ...] = Field(
        (), exclude=True, description="to the other data of the same file; `report` shows them"
    )
    notes: tuple[Sentence, ...] = Field((), description="cautions, on the data, of the diagnosis")

    @property
    def beyond(self) -> tuple[FoundPattern, ...]:
        """The patterns of the likeliest state beyond the list."""
        return tuple(pattern for pattern in self.patterns if pattern.accepted)

    @property
    def named(self) -> Ids:
        """The causes that the parameters take into account."""
        return tuple(cause.id for cause in self.causes) if self.alone else ()


class Identity(Schema):
    """The number that makes a report unique, its date and program."""

    number: str = Field(description="the same for the same inputs and options")
    issued: AwareDatetime
    software: str


def identify(inputs: Iterable[Input], *options: object, issued: datetime | None = None) -> Identity:
    """Identity of a result; it is issued now if no time is given.

    The number depends on the files, the machines that they are judged by, and the options that
    change the content (by their `str`).
    """
    software = f"orthocal {__version__}"
    judged = [(InputFile.of(one), one.model.ruled_out, machine_values(one.model)) for one in inputs]
    made_of = repr((software, judged, [str(option) for option in options]))
    digest = hashlib.sha256(made_of.encode()).hexdigest()[:12].upper()
    return Identity(
        number=f"OC-{digest[:6]}-{digest[6:]}",
        issued=issued or datetime.now(UTC),
        software=software,
    )
