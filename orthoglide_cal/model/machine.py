"""The machine: what is known of it before it is measured; each kind of machine is a class of it.

Everything that one kind does differently from another is an attribute or a method here: where the
nominal rails are, how the controller turns a wanted place into joints, which parameters a
calibration determines, what a gauge reads, how such a machine is measured, and the words for it.
The rest of the program does not ask which kind it has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self

from orthoglide_cal.errors import UsageError
from orthoglide_cal.model.influence import Influence
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.layouts import Layout
from orthoglide_cal.model.plan import Floats, Numbers
from orthoglide_cal.model.readings import AXES, Posture
from orthoglide_cal.model.real import Command, GaugeResponse, RealMachine
from orthoglide_cal.model.vocabulary import Vocabulary

# Where the machine file says nothing of a gauge: a stand put by eye or with a rule is within a
# millimetre or so; dial indicators may be off by 15 µm in 10 mm, and a plunger that leans by 2°
# reads 0.06 % short.
PLACEMENT_MM = 1.0
SCALE_U = 0.001


@dataclass(frozen=True)
class Gauge:
    """A dial indicator.

    Attributes:
        resolution_mm: smallest step that it shows.
        range_mm: travel of the plunger.
        revolution_mm: travel of one turn of the dial; None for a gauge without a dial.
        repeatability_mm: standard deviation of one reading as the maker or the last check states.
        placement_mm: how well its stand is put at its place along the leg, one standard deviation;
            None if nobody stated it.
        scale_u: standard uncertainty of its scale (1); None if nobody stated it.
    """

    resolution_mm: float
    range_mm: float
    revolution_mm: float | None
    repeatability_mm: float
    placement_mm: float | None = None
    scale_u: float | None = None

    @property
    def placement_std_mm(self) -> float:
        """`placement_mm`, or its default."""
        return PLACEMENT_MM if self.placement_mm is None else self.placement_mm

    @property
    def scale_std(self) -> float:
        """`scale_u`, or its default."""
        return SCALE_U if self.scale_u is None else self.scale_u

    @cached_property
    def rounding_mm(self) -> float:
        """Standard deviation q/√12 that the resolution q alone gives to a reading [mm]."""
        return self.resolution_mm / math.sqrt(12.0)

    @cached_property
    def noise_mm(self) -> float:
        """Standard deviation to expect of one reading: repeatability and rounding [mm]."""
        return math.hypot(self.repeatability_mm, self.rounding_mm)


class Entered(NamedTuple):
    """Offsets that were entered in the controller.

    Attributes:
        date: when, ISO 8601.
        before_mm, after_mm: active before and from then on (x, y, z).
        data_sha256: digest of the measurement that they came from.
    """

    date: str
    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]
    data_sha256: str


@dataclass(frozen=True)
class Details:
    """What the people who read a report want to see on it; None where it is not given.

    Attributes:
        organisation, place: who calibrates, and where.
        serial_number: of the machine.
        customer: whose it is.
        method: procedure by which it is calibrated.
        gauge_due: day on which the gauge is to be calibrated again, ISO 8601.
    """

    organisation: str | None = None
    place: str | None = None
    serial_number: str | None = None
    customer: str | None = None
    method: str | None = None
    gauge_due: str | None = None


@dataclass(frozen=True)
class Machine:
    """The nominal machine: three actuated rails, three legs, one tool centre point.

    Attributes:
        name: for people.
        leg_length_mm: L, parallelogram length.
        parallelogram_width_mm: d.
        tool_offset_mm: r, from the leg's end C to the tool centre point.
        joint_limits_mm: (min, max) displacement from the isotropic posture (errata, eq. 2).
        workspace_mm: edge of the cube-like workspace.
        gauge: the indicator normally used on it.
        offsets_mm: joint offsets already active in the controller (x, y, z).
        tolerances: cause id → plausible size (one standard deviation, contract's unit), 0 for a
            cause that is ruled out; `Cause.size` says what holds for the others.
        homing_mm: how far a home switch can plausibly be off; None for what is usual of its kind.
        history: what was entered in the controller, oldest first.
        report: what its reports say of it besides the numbers.

    Each kind of machine says:
        kind: its id in the machine file.
        parameter_names, parameter_units: of what a calibration determines.
        linearization_points: offsets at which what is expected of readings is taken, (k, p).
        rivals: ids of two causes that hide behind each other in the usual measurement; or ().
        unobservable: ids of causes that no reading distinguishes from the parameters.
        fixed_parameters: ids of causes for which the controller's value is taken as it stands;
            the calibrated parameters make up for its error, and are as uncertain as it is.
        usual_homing_mm: `homing_mm` where the file gives none.
        tolerance_scales: a tolerance is a standard deviation, yet some faults are several times
            as large: scale of the sizes of a fault → its share.
        caution: how many times more must speak for a fault than elsewhere before it is named.
        companions: id of a cause in the machine that may act together with any other one → what
            is not claimed with it.
        recommended: ids of causes that no controller compensates, but that are worth knowing for
            what is calibrated.
        absolute: the values themselves are told, not their excess over what the controller has.
        recorded: what was entered is kept in the machine file.
        probes: it measures itself.
        decimals: of what is entered; None for as many as the uncertainty asks for.
        has_cube: the error of its tool is shown over a cube of its workspace.
        controller_formats: which of its controllers' formats there are.
        vocabulary: its words.
    """

    kind: ClassVar[str]
    parameter_names: ClassVar[tuple[str, ...]]
    parameter_units: ClassVar[tuple[str, ...]]
    linearization_points: ClassVar[Floats]
    rivals: ClassVar[tuple[str, ...]] = ()
    unobservable: ClassVar[tuple[str, ...]] = ()
    fixed_parameters: ClassVar[tuple[str, ...]] = ()
    usual_homing_mm: ClassVar[float]
    tolerance_scales: ClassVar[Mapping[float, float]]
    caution: ClassVar[float] = 1.0
    companions: ClassVar[Mapping[str, str]] = MappingProxyType({})
    recommended: ClassVar[tuple[str, ...]] = ()
    absolute: ClassVar[bool]
    recorded: ClassVar[bool]
    probes: ClassVar[bool]
    decimals: ClassVar[int | None] = None
    has_cube: ClassVar[bool]
    controller_formats: ClassVar[tuple[str, ...]]
    vocabulary: ClassVar[Vocabulary]

    name: str
    leg_length_mm: float
    parallelogram_width_mm: float
    tool_offset_mm: float
    joint_limits_mm: tuple[float, float]
    workspace_mm: float
    gauge: Gauge
    offsets_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    tolerances: Mapping[str, float] = field(default_factory=dict, hash=False)
    homing_mm: float | None = None
    history: tuple[Entered, ...] = ()
    report: Details = Details()

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerances", MappingProxyType(dict(self.tolerances)))

    @classmethod
    def require(cls, machine: Machine) -> Self:
        """The machine, if it is of this kind.

        Raises:
            UsageError: it is of another one.
        """
        if not isinstance(machine, cls):
            raise UsageError(
                f"{machine.name} is a machine of kind {machine.kind}, not {cls.kind}.",
                f"Give the machine file of a machine of kind {cls.kind}.",
            )
        return machine

    @classmethod
    def named(cls, names: Sequence[str]) -> dict[str, str]:
        """Each parameter of a cause → its name on this kind of machine.

        Causes of several kinds count the rails x, y and z; a kind calls them as its joint offsets.
        """
        rails = dict(zip(AXES, cls.parameter_names, strict=False))
        return {name: rails.get(name, name) for name in names}

    def displacement_mm(self, posture: Posture) -> float:
        """Displacement of the leg's own carriage at a posture [mm]."""
        low, high = self.joint_limits_mm
        return {Posture.ISO: 0.0, Posture.MAX: high, Posture.MIN: low}[posture]

    def posture_at(self, displacement: float) -> Posture | None:
        """The named posture at a displacement [mm]; None for any other."""
        return next((p for p in Posture if self.displacement_mm(p) == displacement), None)

    def entered_from(self, sha256: str) -> Entered | None:
        """What was entered from the measurement with this digest; None if nothing was."""
        return next((each for each in self.history if each.data_sha256 == sha256), None)

    @property
    def homing_std_mm(self) -> float:
        """`homing_mm`, or what is usual of its kind."""
        return self.usual_homing_mm if self.homing_mm is None else self.homing_mm

    @property
    def active(self) -> tuple[float, ...]:
        """What the controller has of each calibrated parameter, in its unit."""
        raise NotImplementedError

    @property
    def plausible(self) -> tuple[float, ...]:
        """The largest size of each calibrated parameter that a machine can have, in its unit."""
        raise NotImplementedError

    @property
    def max_reportable_u(self) -> tuple[float, ...]:
        """The largest U with which each parameter counts as determined, in its unit."""
        raise NotImplementedError

    @property
    def geometry_words(self) -> str:
        """Its nominal geometry in one line."""
        raise NotImplementedError

    @cached_property
    def nominal_rails(self) -> Geometry:
        """Rails and legs as the controller has them."""
        raise NotImplementedError

    @property
    def home_mm(self) -> float:
        """Joint value from which displacements count [mm]."""
        raise NotImplementedError

    def joints_for(self, tool: Floats) -> Floats:
        """What the controller commands for tool positions (..., 3) → (..., 3) [mm].

        Raises:
            UnreachableError: a point that a leg is too short for.
        """
        raise NotImplementedError

    def command(self, plan: Any) -> Command:
        """Where the controller sends the carriages for each reading of a plan.

        Raises:
            UnreachableError: a posture outside the machine's reach.
        """
        raise NotImplementedError

    def sensed(
        self, real: RealMachine, parameters: Numbers, plan: Any, strict: bool, derivative: bool
    ) -> GaugeResponse:
        """What gauges or probes are pushed to, and its derivative where that is asked for and
        known in closed form; arguments and errors as of `simulate`."""
        raise NotImplementedError

    def recalibrated(self, after: Machine) -> bool:
        """Whether the controller of the same machine has other parameters later, under which it
        was homed anew: what the real ones exceed them by is then unknown again."""
        return False

    def further(self, plan: Any) -> Iterator[tuple[str, Any, float]]:
        """What can be measured next besides its protocols: in words, its plan, its minutes."""
        return iter(())

    def layouts(self) -> tuple[Layout, ...]:
        """Ways to measure that are worth comparing; none where readings follow a protocol."""
        return ()

    def distinguishing_layouts(self) -> tuple[Layout, ...]:
        """Ways to measure that distinguish its rivals more or less, quickest first."""
        return ()

    def local_shape(self, plan: Any) -> Influence | None:
        """What neighbouring readings share, and what nobody calls an error; None for nothing."""
        return None

    def uncertain(self, plan: Any, predict: Callable[[Any], Floats]) -> Iterator[Influence]:
        """What nobody knows exactly of the gauges or of what they touch.

        Args:
            plan: n readings.
            predict: readings of a plan, (n,) [mm].
        """
        raise NotImplementedError
