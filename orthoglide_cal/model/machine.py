"""The machine: what is known of it before it is measured; each kind of machine is a class of it.

Everything that one kind does differently from another is an attribute or a method here; the rest
of the program does not ask which kind it has.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, ValidationInfo

from orthoglide_cal.errors import InputError, OrthocalError, UsageError
from orthoglide_cal.losses import NEEDLESS_HOLD
from orthoglide_cal.model.kinematics import GaugeResponse, Geometry, RealMachine
from orthoglide_cal.model.measured import Measured, Readings
from orthoglide_cal.model.plan import AnyCell, AnyPlan, Floats, Numbers, Plan, ReadOnly
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.schema import Day, Digest, Number, Positive, Reason, Schema, Word, ask
from orthoglide_cal.words import entered_decimals

LARGEST_OFFSET_MM = 1000.0  # nobody enters more
# The home switch or index pulse of a carriage is set to within a few millimetres; an offset beyond
# that is a wrong unit, label or machine file.
HOMING_MM = 5.0

Length = Annotated[Number, Field(ge=1.0, le=1e5)]
Offset = Annotated[Number, Field(ge=-LARGEST_OFFSET_MM, le=LARGEST_OFFSET_MM)]
T = TypeVar("T")


def empty(value: object) -> object:
    """Nothing after a key is an empty group."""
    return {} if value is None else value


class JointOffsets(NamedTuple):
    """One number for each joint [mm]."""

    x: Offset
    y: Offset
    z: Offset


def stated_or(value: float | None, usual: float) -> tuple[float, bool]:
    """The stated value, or the usual one; and whether it is assumed."""
    return (usual, True) if value is None else (value, False)


Predicted = Callable[[Plan], Floats]  # gives the readings of any plan, (..., n) [mm]
# A named tuple is a group of keys in the file.
Named = Annotated[T, PlainSerializer(lambda values: values._asdict())]
# A group of keys that may be empty in the file.
Group = Annotated[
    Mapping[str, T], BeforeValidator(empty), AfterValidator(MappingProxyType), PlainSerializer(dict)
]
# Cause id → its parameters as the controller corrects them, in the unit of the cause.
Corrections = Group[Mapping[str, Number]]


def _of_the_kind(active: Mapping[str, float], info: ValidationInfo) -> Mapping[str, float]:
    """All parameters in their order; the context is the class of the machine."""
    names = info.context.parameter_names if info.context else tuple(active)
    for name in sorted(active.keys() ^ set(names)):
        fault = f"The key is {'missing' if name in names else 'not known'}."
        raise InputError(fault, f"Give {', '.join(names)}, each once.", column=name)
    return MappingProxyType({name: active[name] for name in names})


# Calibrated parameter → its value in the controller, in its unit.
Active = Annotated[Mapping[str, Offset], AfterValidator(_of_the_kind), PlainSerializer(dict)]


class WrittenValue(Schema):
    """One value of a controller's file that was replaced; the rest of its line stays."""

    line: Annotated[int, Field(ge=1)]  # of the file before
    key: Word
    before: str = ""  # "": the line was put above that one
    after: str = ""  # "": the line is removed


class WrittenTable(Schema):
    """A file of its own that was written beside a controller's."""

    path: Word
    sha256: Digest
    text: str = Field(default="", exclude=True)  # to be written


class Written(Schema):
    """Changes in a controller, so that it can be restored exactly."""

    target: Word  # path of its file, or address of its server
    sha256_before: Digest  # of the whole file
    sha256_after: Digest
    values: tuple[WrittenValue, ...] = ()
    tables: tuple[WrittenTable, ...] = ()
    # Of files of earlier versions: whether the running controller was told, too. Not written again.
    live: bool = Field(default=False, exclude=True)


class Entered(Schema):
    """Parameters that were entered in the controller."""

    date: Day  # ISO 8601
    # Active before and from then on, by name; None for a printer, whose own file has them.
    before: Active | None = None
    after: Active | None = None
    # `Machine.corrected` before and from then on; None where that did not change.
    corrected_before: Corrections | None = None
    corrected: Corrections | None = None
    data_sha256: Digest  # of the measurement that they came from
    written: Written | None = None  # to the controller; None if it was typed in by hand
    # Key of the machine file → its lines that this replaced, "" for none; or the whole file, by "".
    replaced: Group[str] | None = None  # None in files of earlier versions

    @property
    def active(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """`Machine.active` before and from then on; () where the entry does not say."""
        return tuple((self.before or {}).values()), tuple((self.after or {}).values())


class OwnGauge(Schema):
    """A gauge that belongs to the machine, for reports."""

    id: Word
    certificate: Word | None = None
    expanded_mm: Positive | None = Field(None, description="U that its certificate states, 95 %")
    due: Day | None = Field(None, description="day on which it is to be calibrated again")


class Details(Schema):
    """Entries of a report for the people who read it; None where not given."""

    organisation: Word | None = None  # who calibrates
    address: Word | None = None  # of that laboratory
    place: Word | None = None  # where
    serial_number: Word | None = None  # of the machine
    customer: Word | None = None  # whose it is
    method: Word | None = None  # procedure by which it is calibrated
    traceability: Word | None = None  # to what the gauges' values are traced
    authorised_by: Word | None = None  # who answers for the report
    # Day on which the gauge is to be calibrated again, of files without `gauges`.
    gauge_due: Day | None = None


class SimulationOptions(NamedTuple):
    """Wishes for synthetic readings; None where nobody says."""

    cycles: int | None = None
    protocol: Literal["double", "single"] | None = None
    gauge_at: float | None = None  # along the leg, from 0 to 1
    places: int | None = None  # on the bed
    heights: Sequence[float] | None = None  # of what lies under the probe [mm]
    further: Sequence[float] | None = None  # parameters behind the first three, in their units


class Layout(NamedTuple):
    """A way to measure: which readings, in which order."""

    name: str  # one word, for tables and commands
    what: str  # in words
    plan: Plan
    minutes: float  # that it takes


class Bed(NamedTuple):
    """Surface that a probe touches, seen from above."""

    radius_mm: float
    tower_angles_deg: tuple[float, ...]  # where what carries the tool stands around it
    highest_mm: float  # no reading is larger


class Suspicion(NamedTuple):
    """A plunger that leaves its bar, or comes near its end."""

    fault: str  # one sentence, with the place
    remedy: str
    size: float  # how far it is beyond the end [mm]; 0 on the bar

    def __str__(self) -> str:
        return f"{self.fault} {self.remedy}"


class Instrument(Schema):
    """A gauge or probe; each kind declares its values in the order of the machine file."""

    if TYPE_CHECKING:
        resolution_mm: float
        repeatability_mm: float

    @property
    def most_mm(self) -> float:
        """Largest change of a reading that can be right [mm]."""
        return HOMING_MM

    @property
    def turn_mm(self) -> float:
        """Travel of one turn of its dial [mm]; 0 where no turns can be miscounted."""
        return 0.0

    def doubts(self, measured: Measured) -> tuple[Reason, ...]:
        """Readings that it can hardly have shown; firmware may write them as it likes."""
        return ()

    def implausible(self) -> dict[str, Reason]:
        """Field → why no such instrument has the value that is stated, though it may be written."""
        return {}

    def mistaken_unit(self, measured: Measured) -> float | None:
        """The unit of readings that it cannot show in mm [mm]; None if it can, or nothing tells."""
        return None

    @property
    def rounding_mm(self) -> float:
        """Standard deviation that the resolution q alone gives to a reading: q/√12 [mm]."""
        return self.resolution_mm / math.sqrt(12.0)

    @property
    def noise_mm(self) -> float:
        """Standard deviation to expect of one reading: repeatability and rounding [mm]."""
        return math.hypot(self.repeatability_mm, self.rounding_mm)

    def shown(self, values: Floats) -> Floats:
        """Values as it shows them, in steps of its resolution where it has one."""
        step = self.resolution_mm
        return np.asarray(np.rint(values / step) * step if step > 0.0 else values)


class Origin(StrEnum):
    """Sources that are no causes; those are named by their cause id."""

    NOISE = "noise"
    RESOLUTION = "resolution"
    GAUGE_SCALE = "gauge_scale"
    GAUGE_PLACEMENT = "gauge_placement"
    BED_TEXTURE = "bed_texture"
    TEMPERATURE = "temperature"
    EXPLANATIONS = "explanations"  # that the data leave open


@dataclass(frozen=True, eq=False)
class Influence(ReadOnly):
    """Unknowns of one source."""

    source: str  # an `Origin` or a cause id
    size: float | None  # one standard deviation, in `unit`; None where the unknowns differ
    unit: str  # "" without one
    assumed: bool  # nobody stated the size: a default
    columns: Floats  # what one standard deviation of each adds to the data, (..., n, p) [mm]
    # As many unknowns as readings, shared by neighbours: what is put down to them is not explained.
    local: bool = False
    rest: float = 0.0  # variance of what else it adds to each reading, as noise does [mm²]

    def scaled(self, scale_factor: float) -> Influence:
        """The same, of a local shape so many times as large as stated."""
        if not self.local or scale_factor == 1.0:
            return self
        columns, rest = scale_factor * self.columns, scale_factor**2 * self.rest
        return replace(
            self, columns=columns, rest=rest, size=self.size and scale_factor * self.size
        )


@dataclass(frozen=True)
class Vocabulary:
    """Words of one kind of machine; every page takes them from here."""

    one: str  # what is calibrated: "offset"
    many: str
    title: str  # its full name, as a heading: "Joint offsets"
    symbol: str  # of a change of it, as a column's head: "Δρ"
    relation: str  # how the found value belongs to the real one
    restart: str  # what makes the controller use the new values
    entering: str  # how they are entered, and that, in a few words
    beyond: str  # why a value is impossible; "{limit}" stands for the largest plausible ones
    recheck: str  # what to look at where a value is impossible
    more: str  # which readings would determine more
    noise: str  # what reads, and whose noise the readings have: "gauge"
    again: str  # what to do where nothing explains the readings
    positions: str  # at what readings are taken: "postures"
    repeat: str  # how to reduce noise
    further: str  # what besides the usual readings would distinguish causes
    subject: str = "a machine"  # what is calibrated, and by what
    everywhere: str = "every reading"  # or all that read
    anew: str = "Measure again"  # as a step
    pushed: str = "Measure again in the same way."  # after a part was adjusted
    fewest: str = ""  # which readings determine all of it, where missing ones have no names
    probing: str = ""  # how it is measured without a guide
    also: str = ""  # what belongs to that noise, too
    home: str = ""  # where all joints are at home; empty where the controller shows none


class Machine(Schema):
    """The nominal machine: three actuated rails, three legs, one tool centre point.

    What each kind of machine says is declared first, then the keys of the machine file.
    """

    # Of what a calibration determines.
    parameter_names: ClassVar[tuple[str, ...]]
    parameter_symbols: ClassVar[tuple[str, ...]]
    parameter_units: ClassVar[tuple[str, ...]]
    # The largest U with which each counts as determined, in its unit.
    max_reportable_u: ClassVar[tuple[float, ...]] = (math.inf,)
    linearization_points: ClassVar[Floats]  # offsets at which readings are foreseen, (k, p)
    # Ids of two causes that hide behind each other in the usual measurement; or ().
    rivals: ClassVar[tuple[str, ...]] = ()
    shape: ClassVar[str] = ""  # id of the cause that stands for whatever readings of one plane show
    # Ids of causes for which the controller's value is taken as it stands: its error goes into the
    # calibrated parameters.
    fixed_parameters: ClassVar[tuple[str, ...]] = ()
    # Some faults are several times their tolerance: scale of the sizes of a fault → its share.
    tolerance_scales: ClassVar[Mapping[float, float]]
    # Cause id → its usual size, where the cause states none for this kind.
    usual_sizes: ClassVar[Mapping[str, float]] = MappingProxyType({})
    homed: ClassVar[int] = 0  # so many of the parameters, the first, homing may set again
    needless_hold: ClassVar[float] = NEEDLESS_HOLD  # loss [min]
    # Ids of causes that may act together with any other, and that no readings make certain.
    companions: ClassVar[tuple[str, ...]] = ()
    # Ids that no controller compensates, but that are worth knowing for what is calibrated.
    recommended: ClassVar[tuple[str, ...]] = ()
    decimals: ClassVar[int | None] = None  # of what is entered; None for as many as U asks for
    # Where nothing was measured yet: what to do, the verb, a usual file; "" for none.
    first_steps: ClassVar[tuple[tuple[str, str, str], ...]]
    practice_steps: ClassVar[tuple[tuple[str, str, str], ...]]  # in a folder to practise
    adds_to_joints: ClassVar[bool] = False  # LinuxCNC adds its parameters, and tables, at joints
    keeps_entered: ClassVar[bool] = True  # its machine file, not its controller, has `active`
    controller_formats: ClassVar[tuple[str, ...]]  # of its usual controller's file first
    vocabulary: ClassVar[Vocabulary]
    # What is written down with its readings; where it is missing, pages leave a blank.
    noted: ClassVar[tuple[str, ...]] = ()
    # Where two differ in these they read differently; the rest says what is plausible.
    geometry_keys: ClassVar[tuple[str, ...]]

    kind: str  # what tells the classes apart in the file
    name: Annotated[Word, ask("Name of the machine", "stands on every report", unit="")]
    # How far a home switch can plausibly be off; None for what is usual.
    homing_mm: Annotated[Number, Field(ge=1e-3, le=1e3)] | None = None
    # Cause id → plausible size (one standard deviation, in its unit); 0 rules it out.
    tolerances: Group[Annotated[Number, Field(ge=0.0, le=1e6)]] = Field(
        default_factory=lambda: MappingProxyType({})
    )
    # What its controller corrects of what is wrong with it.
    corrected: Corrections = Field(default_factory=lambda: MappingProxyType({}))
    report: Annotated[Details, BeforeValidator(empty)] = Details()
    gauges: Annotated[tuple[OwnGauge, ...], BeforeValidator(lambda given: given or ())] = ()
    history: Annotated[tuple[Entered, ...], BeforeValidator(lambda given: given or ())] = ()
    practice: bool = False  # its file alone may hold what was simulated

    def __hash__(self) -> int:
        return hash((self.kind, self.name, self.active))

    @classmethod
    def require(cls, machine: Machine, otherwise: OrthocalError | None = None) -> Self:
        """The machine, if it is of this kind; raises this error, or UsageError, for another one."""
        if not isinstance(machine, cls):
            raise otherwise or machine._refusal(cls.model_fields["kind"].default)
        return machine

    def _refusal(self, kind: str) -> UsageError:
        """Error where only a machine of another kind will do."""
        remedy = f"Give the file of a machine of kind {kind}: --machine FILE"
        return UsageError(f"{self.name} is of kind {self.kind}.", remedy)

    @classmethod
    def of_kind(cls, values: Mapping[type[Machine], T], otherwise: T) -> T:
        """Look this kind up in a table by kinds of machine."""
        return values.get(cls, otherwise)

    @classmethod
    def named(cls, names: Sequence[str]) -> dict[str, str]:
        """Each parameter of a cause → its name on this kind, whose rails may not be x, y, z."""
        rails = dict(zip(AXES, cls.parameter_names, strict=False))
        return {name: rails.get(name, name) for name in names}

    def entered_from(self, sha256: str) -> Entered | None:
        """Entry from the measurement with this digest; None without one."""
        return next((entry for entry in self.history if entry.data_sha256 == sha256), None)

    def with_papers(self, owner: Machine) -> Self:
        """The same with what its owner wrote for reports since; nothing from another machine.

        U and due date of a gauge go with its certificate.
        """
        if (self.name, type(self)) != (owner.name, type(owner)):
            return self
        texts = {name: text for name, text in self.report if text is not None}
        gauges = {gauge.id: gauge for gauge in (*self.gauges, *owner.gauges)}
        for mine in self.gauges:
            same = mine.certificate in (None, gauges[mine.id].certificate)
            known = {name: value for name, value in mine if value is not None}
            gauges[mine.id] = gauges[mine.id].changed(**known) if same else mine
        return self.changed(report=owner.report.changed(**texts), gauges=tuple(gauges.values()))

    @property
    def common_unit(self) -> str:
        """Unit of all parameters, as it follows a title; "" where they have several."""
        units = {*self.parameter_units}
        return f", {units.pop()}" if len(units) == 1 else ""

    @property
    @abstractmethod
    def instrument(self) -> Instrument:
        """Its gauge or probe."""

    @property
    def bed(self) -> Bed:
        """Bed that its probe touches; raises UsageError for a machine without one."""
        raise self._refusal("linear_delta")

    @property
    def cube(self) -> tuple[float, float]:
        """(low, high), tool positions [low, high]³ to be shown [mm]; UsageError without them."""
        raise self._refusal("orthoglide")

    @property
    def limits_mm(self) -> tuple[float, float]:
        """Lowest and highest displacement of a carriage [mm]; UsageError without postures."""
        raise self._refusal("orthoglide")

    def displacement_mm(self, posture: Posture) -> float:
        """Displacement of the leg's own carriage at a posture [mm]."""
        low, high = self.limits_mm
        return {Posture.ISO: 0.0, Posture.MAX: high, Posture.MIN: low}[posture]

    def posture_at(self, displacement: float) -> Posture | None:
        """The named posture at a displacement [mm]; None for any other."""
        return next((p for p in Posture if self.displacement_mm(p) == displacement), None)

    def joints_at(self, leg: Numbers | int, displacement: Floats | float) -> Floats:
        """Indicated joints (..., 3) [mm] with legs 0, 1, 2 displaced; UsageError likewise."""
        raise self._refusal("orthoglide")

    def reach_mm(self, gauge_at: float) -> tuple[float, float]:
        """Lowest and highest displacement at which a plunger stays where it can read [mm]."""
        return self.limits_mm

    @property
    def gauge_places(self) -> tuple[float, ...]:
        """Places along a leg from which a gauge reads it over all travel; none by default."""
        return ()

    def together(
        self, dates: Sequence[tuple[Machine, Measured]], slope: Callable[[Plan], Floats]
    ) -> tuple[Plan, Floats]:
        """Readings of several dates as if all were taken with the settings in force on the last.

        `slope` gives their derivatives by the calibrated parameters, (n, p). Returns a plan with
        parameters of each date, and the readings, (n,) [mm]. Raises UsageError: not to be joined.
        """
        fault = "--together is for touches of one printer's bed on several dates."
        raise UsageError(fault, "Leave it out: each file is then judged alone.")

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Ids of causes that its readings cannot distinguish from something else."""
        return ()

    @property
    def doubted(self) -> Mapping[str, float]:
        """Id of a cause → its size by values of the controller that can hardly be right."""
        return MappingProxyType({})

    @property
    @abstractmethod
    def active(self) -> tuple[float, ...]:
        """The controller's value of each calibrated parameter, in its unit."""

    @abstractmethod
    def holding(self, active: Sequence[float]) -> Self:
        """Hold other values `active`; raises UsageError unless its file `keeps_entered`."""

    @property
    @abstractmethod
    def plausible(self) -> tuple[float, ...]:
        """The largest size of each calibrated parameter that a machine can have, in its unit."""

    def determined(self, expanded: Floats) -> tuple[bool, ...]:
        """True of each calibrated parameter that is known well enough to state, from U (p,)."""
        return tuple((expanded < self.max_reportable_u).tolist())

    @property
    def travel_mm(self) -> float:
        """Travel of a carriage, about [mm]."""
        low, high = self.limits_mm
        return high - low

    @property
    @abstractmethod
    def geometry_words(self) -> str:
        """Its nominal geometry in one line."""

    @property
    @abstractmethod
    def nominal_rails(self) -> Geometry:
        """Rails and legs as the controller has them."""

    @property
    def leg_mm(self) -> float:
        """Mean length of its legs or arms: what grows with the temperature [mm]."""
        return float(self.nominal_rails.lengths.mean())

    @property
    @abstractmethod
    def home_mm(self) -> float:
        """Joint value from which displacements count [mm]."""

    @abstractmethod
    def sensed(
        self, real: RealMachine, parameters: Numbers, plan: AnyPlan, strict: bool
    ) -> GaugeResponse:
        """Positions of gauges or probes; arguments and errors as of `simulate`."""

    @abstractmethod
    def reading_words(self, plan: AnyPlan, index: int) -> str:
        """One reading of a plan in words."""

    def differing(self, after: Machine) -> tuple[str, ...]:
        """Settings that the controller of the same machine has otherwise later, in words."""
        return ()

    def bar_warning(self, plan: AnyPlan) -> Suspicion | None:
        """The plunger that leaves its bar or comes nearest to its end; None if none comes near."""
        return None

    def check_guided(self) -> None:
        """Raises UsageError for a machine that nobody measures by hand, step by step."""
        if self.measuring(None) is None:
            fault = f"No protocol guides through measuring a {self.kind.replace('_', ' ')}."
            raise UsageError(fault, self.vocabulary.probing)

    def measuring(self, file: Path | None, options: str = "", **given: object) -> str | None:
        """The command that guides through a measurement; arguments as of `errors.command`."""
        return None

    def entered_decimals(self, expanded: Iterable[float]) -> int:
        """Decimals of what is entered, of U."""
        return self.decimals or entered_decimals(expanded, self.active)

    def judging(self, then: Machine) -> Machine:
        """The machine by which to judge readings that were taken when it was as `then`: itself,
        where postures say where the carriages stood."""
        return self

    def check_same(self, later: Machine) -> None:
        """Raises UsageError for a machine that calibration cannot make of this one."""

    def adjusting_cells(self, leg: int, plan: AnyPlan) -> Sequence[AnyCell]:
        """Readings, none by default, among which one shows best how a part of this leg is pushed;
        the plan is of what was measured before."""
        return ()

    def further(self, plan: AnyPlan) -> Iterator[tuple[Reason, Plan, float]]:
        """Further measurements besides its protocols: what to do, its plan, its minutes."""
        return iter(())

    def layouts(self) -> tuple[Layout, ...]:
        """Ways to measure that are worth comparing; none where readings follow a protocol."""
        return ()

    def distinguishing_layouts(self) -> tuple[Layout, ...]:
        """Ways to measure that distinguish its rivals more or less, quickest first."""
        return ()

    def local_shape(self, plan: AnyPlan) -> Influence | None:
        """Deviation that neighbouring readings share and nobody calls an error; None for none."""
        return None

    def uncertain(self, plan: AnyPlan, predict: Predicted) -> Iterator[Influence]:
        """Influences of gauges, or of what they touch, on the readings of a plan."""
        local = self.local_shape(plan)
        return iter(() if local is None else (local,))

    @abstractmethod
    def simulated_plan(self, wanted: SimulationOptions) -> Plan:
        """Readings for `synthetic`. Raises UsageError: options of another kind of machine."""

    @abstractmethod
    def synthetic(
        self, plan: AnyPlan, predict: Predicted, rng: np.random.Generator, gauge: Instrument
    ) -> Readings:
        """Readings that this instrument would show; arguments as of `synthetic_session`."""
