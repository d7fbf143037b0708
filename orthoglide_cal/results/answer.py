"""The answer to one measurement, as `--json` prints it and as every page draws it.

`true position = indicated + found`. Lengths are in mm unless a unit stands beside them. A list over
the parameters has one entry for each of `parameters`, in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import ConfigDict, Field
from pydantic.json_schema import SkipJsonSchema

from orthoglide_cal.diagnosis import NextMeasurement, Verdict
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.model.workspace import WorkspaceError
from orthoglide_cal.schema import Schema

Ids = tuple[str, ...]
# Probability from which it is told that nothing may be wrong at all.
WORTH_SAYING = 0.005


class InputFile(Schema):
    """What the answer is about."""

    path: str
    sha256: str
    kind: str = Field(description="readings, six, twelve or single")
    readings: int = Field(description="readings, or differences")
    data: str | None = Field(None, description="which measurement of a printer.cfg")


class MachineName(Schema):
    """The machine that it is judged by."""

    name: str
    kind: str


class Remedy(Schema):
    """What to do instead of entering the result.

    `sentence` ends with a colon where a command about the same file follows: `verb`, `options`.
    """

    sentence: str
    verb: str | None = None
    options: str = ""


class Release(Schema):
    """May the parameters be entered in the controller?"""

    reasons: tuple[str, ...] = Field((), description="why not; empty if they may be")
    cautions: tuple[str, ...] = Field((), description="what to know although they may be")
    remedies: tuple[Remedy, ...] = Field((), description="what to do instead")
    sound: bool = Field(True, description="false: no parameters, or they fail their own check")
    usable: bool = Field(
        default_factory=lambda known: not known["reasons"], description="they may be entered"
    )
    settled: bool = Field(
        False,
        description="the controller has them already, as well as these readings know them",
    )


class Parameter(Schema):
    """One parameter that a calibration determines."""

    name: str
    unit: str
    active: float = Field(description="what the controller has")
    found: float | None = Field(description="true = indicated + found; null if not determined")
    std: float = Field(description="standard uncertainty u")
    expanded: float = Field(description="expanded uncertainty U = k u")
    enter: float | None = Field(None, description="what to type in; null unless released")
    determined: bool

    def change(self, decimals: int) -> float:
        """The change as it is entered; nothing of what the readings do not determine."""
        return 0.0 if self.found is None else round(self.found, decimals) + 0.0

    def new(self, decimals: int) -> float:
        """What is active once it is entered, free of the errors of binary addition."""
        if self.found is None:
            return self.active
        return round(self.active + self.change(decimals), 9) + 0.0


class Estimated(Schema):
    """A parameter under one explanation."""

    name: str
    found: float
    std: float


class PossibleExplanation(Schema):
    """What may be behind the data."""

    ids: Ids = Field(description="causes that act together; empty: nothing is wrong")
    pattern: str | None = Field(None, description="that no listed cause makes, in words")
    probability: float
    rms_mm: float | None = Field(None, description="what it leaves; null: not fitted")
    parameters: tuple[Estimated, ...] = ()


class Alone(Schema):
    """What the parameters would be without any cause."""

    parameters: tuple[Parameter, ...]
    rms_after_mm: float


class Residue(Schema):
    """r.m.s. of the data, and what the parameters (with the causes found) leave of them."""

    before_mm: float
    after_mm: float


class Noise(Schema):
    """Standard deviation of one reading, by source."""

    used_mm: float = Field(description="what U rests on")
    repeats_mm: float | None = Field(description="from repeated readings")
    residuals_mm: float | None = Field(description="from the residuals")
    stated_mm: float = Field(description="as the machine file states it")
    floor_mm: float = Field(description="resolution / √12")
    dof: int = Field(description="degrees of freedom of the residuals")
    p_value: float | None = Field(description="of a larger residual from stated noise alone")


class DeviationPromise(Schema):
    """One difference of readings."""

    name: str
    measured_mm: float
    modelled_mm: float
    expected_mm: float = Field(description="after the parameters are entered")
    expanded_mm: float = Field(description="U of the expected value, new readings included")


class Spread(Schema):
    """Size of all deviations together."""

    rms_mm: float
    largest_mm: float
    largest: str = Field(description="which it is")


class BudgetLine(Schema):
    """One line of the uncertainty budget."""

    source: str
    type: Literal["A", "B"]
    size: float | None = Field(description="its standard uncertainty, in `unit`")
    unit: str
    assumed: bool = Field(description="nobody stated its size")
    possible: bool = Field(description="may be there or not")
    minor: bool = Field(description="too small for a line of its own on a page")
    std: tuple[float, ...] = Field(description="what it adds to each parameter's std")


class BudgetTotal(Schema):
    """What the sources of the budget add together."""

    minor: tuple[float, ...] = Field(description="the minor ones; empty without any")
    std: tuple[float, ...]
    expanded: tuple[float, ...]
    k: float


class GoodnessOfFit(Schema):
    """Do the parameters alone explain the data?"""

    statistic: float = Field(description="residual sum of squares / noise variance")
    dof: int
    p_value: float
    repeats_p_value: float | None = Field(description="judged by the scatter of repeats")
    repeats_mm: float | None = Field(description="that scatter")
    left_mm: float = Field(description="what the parameters alone leave, r.m.s.")
    expected_mm: float = Field(description="what noise as stated would leave, r.m.s.")
    noise_mm: float = Field(description="standard deviation of one reading, as stated")
    residual_mm: float = Field(description="r.m.s. of the residuals per degree of freedom")


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
    weight: float = Field(1.0, description="1: as precise as most")
    measured_mm: float
    modelled_mm: float = Field(description="with the parameters alone")
    with_causes_mm: float | None = Field(None, description="with the causes that were found")


class CauseParameter(Schema):
    """A parameter of a cause."""

    name: str
    unit: str
    value: float
    std: float
    expanded: float = Field(description="U, of a normal distribution")


class FoundCause(Schema):
    """A cause that was found; several act together."""

    id: str
    probability: float
    where: str = Field(description="empty: the whole machine")
    parameters: tuple[CauseParameter, ...]
    rms_before_mm: float
    rms_after_mm: float
    heldout_before_mm: float | None = Field(description="error on readings not fitted, without it")
    heldout_after_mm: float | None = Field(description="and with it")
    heldout_ratio: float | None = Field(description="the latter by what is stated for it, r.m.s.")
    aliases: Ids = Field(description="what would look like it")
    times_stated: float | None = Field(description="its largest value by its plausible size")
    remedy: str
    recommended: bool = Field(description="to be accepted as part of the machine")
    in_machine: bool = Field(description="false: it lies in the measurement")


class TimesStated(Schema):
    """A cause far beyond its plausible size."""

    id: str
    times: float


class Undetermined(Schema):
    """What these readings do not determine, and how far it may be off."""

    name: str
    within: float
    unit: str


class AssumedSize(Schema):
    """The plausible size of a cause that the machine file does not state."""

    id: str
    size: float
    unit: str


class CheckReading(Schema):
    """One difference to measure after entering; the gauge stands on its leg."""

    what: str = Field(description="which difference")
    leg: str
    direction: str
    first_mm: tuple[float, ...] = Field(description="tool position of the first reading")
    second_mm: tuple[float, ...]
    first_joints_mm: tuple[float, ...]
    second_joints_mm: tuple[float, ...]
    ends: bool = Field(description="the gauge moves from joint to tool end instead")
    before_mm: float
    expected_mm: float
    expanded_mm: float


class Workspace(Schema):
    """Largest error of the tool position over the cube that the joint limits allow."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    before_mm: float
    after_mm: float
    before_mean_mm: float
    after_mean_mm: float
    limit_mm: float | None = None
    left_mm: float = Field(description="what the causes alone leave after entering")
    cube_mm: tuple[float, float]
    stated_edge_mm: float = Field(description="of the workspace in the machine file")
    maps: SkipJsonSchema[WorkspaceError | None] = Field(None, exclude=True, repr=False)


class Otherwise(Schema):
    """The answer with all plausible sizes changed."""

    verdict: Verdict
    ids: Ids


class Baselines(Schema):
    """Held-out errors of a carried surface and of an earlier map."""

    quartic_mm: float
    earlier_map_mm: float | None


class Answer(Schema):
    """Everything that one measurement says.

    `parameters` are those under the verdict: with the causes where they are `named`, widened by the
    open choice where it is `ambiguous`.
    """

    schema_version: Literal[2] = 2
    input: InputFile
    machine: MachineName
    method: str | None = Field(None, description="null: there is no result")
    verdict: Verdict | None = Field(None, description="null: these data cannot be diagnosed")
    judgement: str = Field("", description="are the residuals what noise would give?")
    explanations: tuple[PossibleExplanation, ...] = Field(
        (), description="those not dismissed, best first"
    )
    release: Release
    parameters: tuple[Parameter, ...] = ()
    decimals: int = Field(3, description="of what is entered")
    k: float | None = Field(None, description="coverage factor U/u")
    confidence: float = 0.95
    dof: int | None = Field(None, description="of k; null: normal distribution")
    correlation: tuple[tuple[float, ...], ...] = ()
    sigma_rho_mm: float | None = Field(None, description="√(trace/3) of joint offsets")
    alone: Alone | None = Field(None, description="null unless a named cause changes parameters")
    rms: Residue | None = None
    noise: Noise | None = None
    deviations: tuple[DeviationPromise, ...] = ()
    as_found: Spread | None = Field(None, description="of the deviations as measured")
    expected: Spread | None = Field(None, description="of the deviations after entering")
    remains: bool = Field(False, description="more will be left than U allows")
    budget: tuple[BudgetLine, ...] = ()
    total: BudgetTotal | None = None
    lack_of_fit: GoodnessOfFit | None = None
    converged: bool = False
    residuals: tuple[Residual, ...] = ()
    causes: tuple[FoundCause, ...] = Field((), description="best first")
    baselines: Baselines | None = None
    ambiguous_with: Ids = ()
    rivals: tuple[Ids, ...] = Field((), description="the same, those that act together as one")
    beyond_tolerance: tuple[TimesStated, ...] = ()
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
    warnings: tuple[str, ...] = Field((), description="about the data")
    notes: tuple[str, ...] = Field((), description="of the diagnosis")

    @property
    def named(self) -> Ids:
        """The causes that the parameters take into account."""
        return tuple(cause.id for cause in self.causes) if self.alone else ()

    @property
    def nothing_wrong(self) -> float | None:
        """Probability of a sound machine, soundly measured; None where it is not worth saying."""
        alone = (each for each in self.explanations if not each.ids and each.pattern is None)
        return next((each.probability for each in alone if each.probability >= WORTH_SAYING), None)

    def require_result(self) -> None:
        """Refuse to go on without parameters.

        Raises:
            UnusableResultError: why there are none, and what to do.
        """
        if not self.parameters:
            remedies = " ".join(remedy.sentence for remedy in self.release.remedies)
            raise UnusableResultError(" ".join(self.release.reasons), remedies)
