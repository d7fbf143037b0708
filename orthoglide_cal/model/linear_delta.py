"""The linear delta: three upright rails around a round bed, probed from above.

The frame is the bed's: x and y as the controller has them, z upwards. The bed is level, since its
tilt and the endstops are one and the same to a probe; tower c, whose angle is not calibrated, fixes
the rotation.

The reading of a touch is how much higher the controller believed the nozzle when the probe
triggered than the touched surface should be; that of a distance, which a calliper reads between two
places of a printed object, its excess over the commanded one. Both are zero on a perfect machine.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from types import MappingProxyType
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    TypeAdapter,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
)

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.losses import COLD_HOLD
from orthoglide_cal.model.kinematics import Command, GaugeResponse, Geometry, Points, RealMachine
from orthoglide_cal.model.machine import (
    HOMING_MM,
    Bed,
    Influence,
    Instrument,
    Layout,
    Length,
    Machine,
    Named,
    Origin,
    Predicted,
    SimulationOptions,
    Vocabulary,
    stated_or,
)
from orthoglide_cal.model.measured import Measured, Readings, Source
from orthoglide_cal.model.plan import Bools, Floats, Ints, Numbers, Plan, Where, alike, read_only
from orthoglide_cal.schema import Number, Reason, ask

TOWERS = ("a", "b", "c")
FEW = 13  # places, to be touched once more on blocks
SHOWING = 49  # places, among which an adjustment is read
UNEQUAL_MM = 0.5  # stored arms that differ by more than this are doubted
_STEPS = 8  # each closes the gap between nozzle and bed by all but some per cent
ANOTHER = 0.05  # a printer whose arms or radius differ by a larger share is another one
TOWERS_TURN = "The towers a, b, c must follow each other counter-clockwise, seen from above."

# Pace assumed where nobody measured the time: a touch, and putting a block under the probe [min].
MINUTES_PER_TOUCH = 5.0 / 60.0
MINUTES_PER_BLOCK = 0.5
BLOCKS_MM = (25.0, 50.0)  # blocks that lie about in a workshop, or are printed
HIGH_MM = max(BLOCKS_MM)  # the higher, the less a bed imitates a frame that is out of square
PLACES = (7, 13, 25, 121)  # numbers of places
REACH = 0.95  # share of the bed's radius, within which they are
# To tell what a bed alone does not: so many places of the bed, so many of them on blocks, too.
SPREAD, RAISED = (25, 49, 81, 121, 169, 241), (7, 13, 19, 25, 31)
DECIMALS = 1  # with which places are sent to a printer [mm]
GOLDEN = (5.0**0.5 - 1.0) / 2.0  # fractional parts of its multiples are spread most evenly
PATCH = 1.0 / 3.0  # side of the patches that are left out together, in radii of the bed
GRAIN_MM = 20.0  # over this distance the local shape of a bed is forgotten: glue, magnets, dirt
# The local shape under more touches is described by that at so many places at most.
MOST_TOUCHES, KNOTS = 600, 200
FINER = (7, 8)  # degrees of shapes that are finer than `bed_shape`
_SCALES = np.array([0.25, 0.7, 2.0, 5.0, 12.0, 30.0])
_SHARES = np.exp(-0.5 * (np.log(_SCALES) / math.log(3.0)) ** 2)  # log-normal around 1

Height = Annotated[Number, Field(ge=-1e4, le=1e4)]


def counter_clockwise(angles: Sequence[float]) -> bool:
    """True if three towers follow each other in this sense; angles in degrees, of any turn."""
    turns = [(b - a) % 360.0 for a, b in zip(angles, (*angles[1:], angles[0]), strict=True)]
    return all(turn > 1.0 for turn in turns) and math.isclose(sum(turns), 360.0)


def _turning(angles: tuple[float, float, float]) -> tuple[float, float, float]:
    if not counter_clockwise(angles):
        raise InputError(
            TOWERS_TURN, "Give the angles as the firmware has them, such as [210, 330, 90]."
        )
    return angles


_ONE_ARM: TypeAdapter[float] = TypeAdapter(Length)


def _of_each(given: object, check: ValidatorFunctionWrapHandler) -> object:
    """One length for all arms, or one for each tower."""
    if isinstance(given, list | tuple):
        return check(given)
    return (_ONE_ARM.validate_python(given),) * len(TOWERS)


# Where the machine file says nothing of a calliper: it shows hundredths, but is put to edges that
# were printed.
CALLIPER_MM = 0.06
# Where it says nothing of a bed: foil, glue and magnets under a plate.
TEXTURE_MM = 0.02
Step = Annotated[Number, Field(ge=0.0, le=10.0)]
Spread = Annotated[Number, Field(ge=1e-6, le=10.0)]


class Probe(Instrument):
    """The probe of a printer, its bed, and the calliper for what it printed."""

    resolution_mm: Annotated[Step, ask("Probe: resolution", "the smallest step that it resolves")]
    repeatability_mm: Annotated[
        Spread, ask("Probe: repeatability", "standard deviation of one touch")
    ]
    calliper_mm: Annotated[
        Spread, ask("Calliper", "standard deviation of a distance on a printed object")
    ] = CALLIPER_MM
    # Standard deviation of the local shape of the bed; None if nobody stated it.
    texture_mm: Step | None = None
    scanning: bool = False  # it reads while it moves


class Endstops(NamedTuple):
    """Height of the nozzle above the bed, in the middle, with all carriages where that endstop
    triggers [mm]."""

    a: Height
    b: Height
    c: Height


@dataclass(frozen=True, eq=False, kw_only=True)
class ProbePlan(Plan):
    """Touches and distances; no zero is unknown, for a probe's is the endstops'."""

    place: Floats  # where the controller believes the nozzle to be, shape (n, 3) [mm]
    other: Floats  # the second place of a distance; of a touch the place itself, (n, 3) [mm]
    surface: Floats  # height of the touched surface over the bed, (n,) [mm]; 0 for a distance
    distance: Bools = field(default_factory=lambda: read_only(False, np.bool_))
    # Derivatives by the calibrated parameters of each day, (n, 6); 0 on that which is looked for.
    slope: Floats = field(default_factory=lambda: read_only(0.0))

    rows = MappingProxyType({"place": 3, "other": 3, "slope": 6})

    @cached_property
    def zeros(self) -> Floats:
        """Columns of the parameters of each other day, shape (n, 6 for each)."""
        days = [self.slope * (self.date == day)[:, None] for day in np.unique(self.date)]
        return read_only(np.hstack([np.zeros((len(self), 0)), *(s for s in days if s.any())]))

    def subset(self, chosen: Ints | Bools) -> Self:
        """The plan of some; the parameters of the latest date are looked for."""
        part = super().subset(chosen)
        earlier = part.date < part.date.max(initial=0)
        return replace(part, slope=part.slope * earlier[:, None])

    @property
    def wanted(self) -> Floats:
        """Commanded distances, shape (n,) [mm]; 0 of a touch."""
        return np.asarray(np.linalg.norm(self.other - self.place, axis=1))

    @property
    def touches(self) -> Bools:
        return ~self.distance

    @property
    def spots(self) -> Floats:
        return self.place

    @cached_property
    def shared(self) -> Ints:
        """The part of a touch; each distance is alone."""
        alone = self.parts + np.arange(len(self))
        _, number = np.unique(np.where(self.distance, alone, self.part), return_inverse=True)
        return read_only(number, np.intp)

    @property
    def flat(self) -> bool:
        """True if all are touches of one height."""
        return not self.distance.any() and len(np.unique(self.surface)) < 2

    @cached_property
    def movers(self) -> Bools:
        """Places as of any plan, with those of each region of the bed."""
        regions = [rows for where, rows in self.wheres(True) if where]
        return read_only(np.stack([*super().movers, *regions]), np.bool_)

    def wheres(self, ordered: bool) -> Iterator[tuple[Where, Bools]]:
        """A quarter of the bed, a half, or a ring, as seen from the front, of one sitting."""
        (x, y), touch = self.place[:, :2].T, self.touches
        far2 = (x**2 + y**2) * touch
        sides: list[tuple[tuple[str, Bools], ...]] = [
            (("", touch), (low, touch & (at < 0.0)), (high, touch & (at > 0.0)))
            for at, low, high in ((y, "front", "back"), (x, "left", "right"))
        ]
        ring = touch & (2.0 * far2 > far2.max(initial=0.0))
        regions = {f"{a} {b}".strip(): one & two for (a, one), (b, two) in product(*sides)}
        regions |= {"edge": ring, "centre": touch & ~ring}
        for region in sorted(regions, key=lambda region: -region.count(" ")):
            rows = regions[region]
            if self.parts == 1 and region and rows.any() and not rows[touch].all():
                yield {"region": region}, rows
        yield from super().wheres(ordered)

    @cached_property
    def repeats(self) -> Ints:
        """Number of the touches of the same spot, or of the same distance, shape (n,)."""
        ends = np.where(self.distance[:, None], self.other, 0.0)
        height = np.where(self.distance, self.place[:, 2], self.surface)
        kind = self.distance.astype(np.intp)
        return alike(*self.place[:, :2].T, height, *ends.T, self.precision, kind, self.part)[1]

    @cached_property
    def texture(self) -> Floats:
        """Local shape of the bed under each touch, columns of unit size, shape (n, m).

        Its covariance falls off as exp(−r/λ), λ = `GRAIN_MM`. Of more than `MOST_TOUCHES` it is
        what the shape at no more than `KNOTS` places says of them (Nyström).
        """
        touches = np.flatnonzero(self.touches)
        knots = place = self.place[touches, :2]
        if len(place) > MOST_TOUCHES:
            once = np.unique(place.round(3), axis=0)
            knots = once[_spread(once, KNOTS)]
        size2, vectors = np.linalg.eigh(_alikeness(knots, knots))
        size = np.sqrt(np.maximum(size2, 0.0))
        shape = vectors * size
        if knots is not place:
            axes, size, _ = np.linalg.svd(_alikeness(place, knots) @ (vectors / size), False)
            shape = axes * size
        local = np.zeros((len(self), len(size)))
        local[touches] = shape
        return read_only(local)

    @cached_property
    def cells(self) -> Ints:
        """Square patches of the bed; neighbours share what the bed has there, shape (n,)."""
        reach = float(np.abs(self.place[:, :2]).max(initial=1.0))
        patch = np.floor(self.place[:, :2] / (reach * PATCH)).astype(np.intp)
        alone = np.where(self.distance, 1 + np.arange(len(self)), 0)
        return alike(*patch.T, alone)[1]

    def entry(self, index: int) -> Mapping[str, object]:
        place = dict(zip(("x_mm", "y_mm", "z_mm"), self.place[index].tolist(), strict=True))
        surface, distance = float(self.surface[index]), bool(self.distance[index])
        return {**place, "surface_mm": surface, "distance": distance}

    @property
    def returning(self) -> Floats:
        """Shapes of the bed that are finer than a cause has."""
        touch = self.touches
        reach = float(np.abs(self.place[:, :2]).max(initial=1.0))
        x, y = self.place[:, 0] / reach, self.place[:, 1] / reach
        coarse, fine = (
            np.stack([touch * x**i * y ** (k - i) for k in degrees for i in range(k + 1)], axis=1)
            for degrees in (range(FINER[0]), FINER)
        )
        # What a smooth surface follows is its own.
        return np.asarray(fine - coarse @ np.linalg.lstsq(coarse, fine)[0])


class PlannedTouch(NamedTuple):
    """One touch of the bed for an adjustment."""

    x_mm: float
    y_mm: float

    @staticmethod
    def planned(cells: Sequence["PlannedTouch"]) -> ProbePlan:
        """The plan of such touches in time order."""
        place, nothing = np.array([(*cell, 0.0) for cell in cells]), np.zeros(len(cells))
        return touching(place, nothing)

    @property
    def place(self) -> tuple[()]:
        """Nothing: no gauge is set up."""
        return ()

    @property
    def words(self) -> str:
        return f"Home, switch the bed mesh off, and probe at  X {self.x_mm:g}  Y {self.y_mm:g}  mm"


class LinearDelta(Machine):
    """The machine of many printers: endstops, radius and two tower angles are calibrated.

    Arm lengths are not: on one height they and the radius are nearly the same. All fields are as
    the controller has them, of towers a, b, c in this order.
    """

    parameter_names = (*TOWERS, "radius", "angle_a", "angle_b")
    parameter_symbols = parameter_names
    parameter_units = ("mm", "mm", "mm", "mm", "deg", "deg")
    # As well as a rule shows how high a switch is and how far out, a square the towers.
    max_reportable_u = (1.5, 1.5, 1.5, 1.5, 1.0, 1.0)
    # What is expected of readings hardly depends on how far such a machine is off.
    linearization_points = read_only(np.zeros((1, 6)))
    # On a flat bed these look alike.
    rivals = ("tower_lean", "bed_shape")
    shape = "bed_shape"
    fixed_parameters = ("leg_length",)
    # Frames and beds of printers are good or bad by a factor of ten: a plausible size is right
    # within a factor of three.
    tolerance_scales = MappingProxyType(
        dict(zip(_SCALES.tolist(), (_SHARES / _SHARES.sum()).tolist(), strict=True))
    )
    needless_hold = COLD_HOLD
    # Belts have lost motion whatever else is wrong.
    companions = ("backlash",)
    # No firmware has a setting for these, yet with them what is calibrated is found right.
    recommended = ("tower_lean", "tower_radius", "bed_shape", "probe_tilt")
    homed = len(TOWERS)
    decimals = 4
    keeps_entered = False
    controller_formats = ("klipper", "reprapfirmware", "marlin", "linuxcnc")
    vocabulary = Vocabulary(
        one="parameter",
        many="parameters",
        title="Parameters",
        symbol="found",
        relation="real value = the controller's + found",
        restart="Restart the firmware, home the printer, and make a new bed mesh.",
        entering="Enter the parameters, restart the firmware, home, make a new mesh",
        beyond="no printer is that far off (up to {limit} is plausible).",
        recheck="Check the unit of the readings and the numbers of the machine: arm lengths,"
        " radius, endstops.",
        more="Probe more places, spread over the whole bed. If that is not enough, repeat the"
        " same places on blocks of two known heights, or measure distances on a printed object.",
        fewest="Touch at least seven places spread over the whole bed: the middle and six near the"
        " edge, evenly around. More places, or heights, show how sure that is. A series at one"
        " place says how the probe scatters and drifts once it stands with them in one file.",
        noise="probe",
        again="Clean bed and nozzle and probe again: more places, spread over the whole bed. Few"
        " places fit nearly anything, and cannot show what is wrong.",
        probing="Klipper: DELTA_CALIBRATE or BED_MESH_CALIBRATE, then SAVE_CONFIG, and bring"
        " printer.cfg. Others: probe with G30 at places all over the bed, bed mesh off, and write"
        " x, y and the height at which it triggers in a CSV: orthocal template touches. Then:"
        " orthocal diagnose FILE",
        subject="a linear delta by its own probe",
        everywhere="the probe",
        anew="Probe again in the same way",
        pushed="Calibrate again, as the push requires, and probe in the same way.",
        also=" and the bed's local shape",
        positions="places",
        repeat="Probe more places",
        further="more places, and on blocks of two known heights",
    )
    first_steps = (
        ("How to probe it, and what to bring", "guide delta", ""),
        ("See the parameters", "solve", "printer.cfg"),
        ("Check the model", "diagnose", "printer.cfg"),
    )
    practice_steps = first_steps
    geometry_keys = ("arm_length_mm", "delta_radius_mm", "tower_angles_deg", "endstops_mm")

    kind: Literal["linear_delta"] = "linear_delta"
    arm_length_mm: Annotated[
        tuple[Length, Length, Length],
        WrapValidator(_of_each),
        ask("Length of an arm", "centre to centre of its joints"),
    ]
    delta_radius_mm: Annotated[
        Length, ask("Delta radius", "from upper to lower joint of an arm, seen from above")
    ]
    # Counter-clockwise from x.
    tower_angles_deg: Annotated[tuple[Number, Number, Number], AfterValidator(_turning)]
    endstops_mm: Annotated[
        Named[Endstops], ask("Endstop", "height of the nozzle, in the middle, where it triggers")
    ]
    bed_radius_mm: Annotated[Length, ask("Radius of the bed", "as far as the probe may touch")]
    probe: Probe

    @field_validator("delta_radius_mm")
    @classmethod
    def _within_arms(cls, radius: float, given: ValidationInfo) -> float:
        if radius >= min(given.data.get("arm_length_mm", (math.inf,))):
            raise InputError(
                "The radius is as large as an arm is long.",
                "Give the horizontal distance between the arm's joints with the tool in the"
                " middle.",
            )
        return radius

    @property
    def instrument(self) -> Probe:
        return self.probe

    @property
    def bed(self) -> Bed:
        return Bed(self.bed_radius_mm, self.tower_angles_deg, max(self.arm_length_mm))

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Lost motion, where the probe reads while it moves: its lag looks the same."""
        return ("backlash",) if self.probe.scanning else ()

    @property
    def doubted(self) -> Mapping[str, float]:
        """Arms of one printer are cut alike; what a calibration made of them need not be."""
        spread = max(self.arm_length_mm) - min(self.arm_length_mm)
        return {"leg_length": spread} if spread > UNEQUAL_MM else {}

    @property
    def active(self) -> tuple[float, ...]:
        return (*self.endstops_mm, self.delta_radius_mm, *self.tower_angles_deg[:2])

    @property
    def plausible(self) -> tuple[float, ...]:
        """A radius is measured with a ruler, and towers are bolted to plates [mm, deg]."""
        radius_mm, angle_deg = 5.0, 2.0
        return (*[self.homing_mm or HOMING_MM] * len(TOWERS), radius_mm, angle_deg, angle_deg)

    @property
    def travel_mm(self) -> float:
        return max(self.endstops_mm)

    @property
    def geometry_words(self) -> str:
        arms = ", ".join(f"{arm:g}" for arm in dict.fromkeys(self.arm_length_mm))
        return f"arms {arms} mm, bed of radius {self.bed_radius_mm:g} mm"

    @property
    def nominal_rails(self) -> Geometry:
        """Upright rails on a circle."""
        points = _on_circle(self.delta_radius_mm, np.radians(self.tower_angles_deg))
        return Geometry(points, np.tile([0.0, 0.0, 1.0], (3, 1)), np.array(self.arm_length_mm))

    @property
    def home_mm(self) -> float:
        """Height of the carriages, about, with the tool in the middle of the bed [mm]."""
        return float(np.mean(self._above(self.delta_radius_mm)))

    @property
    def endstop_carriages_mm(self) -> Floats:
        """Heights of the carriages at their endstops, shape (3,) [mm]."""
        return np.asarray(self.endstops_mm + self._above(self.delta_radius_mm))

    @property
    def equal_arms(self) -> bool:
        return float(np.ptp(np.round(self.arm_length_mm, self.decimals))) == 0.0

    def having(self, arms: Floats, radius: float, angles: Floats, endstops: Floats) -> Self:
        """The machine with these settings in force [mm, deg]; arrays are of shape (3,)."""
        return self.changed(
            arm_length_mm=tuple(arms.tolist()),
            delta_radius_mm=radius,
            tower_angles_deg=tuple(angles.tolist()),
            endstops_mm=Endstops(*endstops.tolist()),
        )

    def command(self, plan: ProbePlan) -> Command:
        """Commands for all first places, then for all second ones if a distance has any."""
        ends = 1 + bool(plan.distance.any())
        rails, places = self.nominal_rails, np.concatenate((plan.place, plan.other)[:ends])
        # On the way the height does not depend on what is touched.
        level = np.column_stack((places[:, :2], np.tile(plan.surface, ends)))
        # A printed object was approached from all sides.
        touches = plan.in_time[~plan.distance[plan.in_time]]
        approach = Command.approach_of(rails.joints_for(level), touches)
        hours, nothing = np.tile(plan.elapsed, ends), np.zeros(places.shape)
        return Command(rails.joints_for(places), self.home_mm, hours, nothing, approach)

    def calibrated_as(self, geometry: Geometry, parameters: Numbers) -> tuple[Geometry, Numbers]:
        """Rails, and offsets of the carriages, that exceed the values in force by (..., 6)."""
        radius = self.delta_radius_mm + parameters[..., 3, None]
        turned = np.concatenate((parameters[..., 4:], 0.0 * parameters[..., :1]), axis=-1)
        angles = np.radians(self.tower_angles_deg) + np.radians(1.0) * turned
        shift = _on_circle(radius, angles) - self.nominal_rails.points
        raised = np.sqrt(geometry.lengths**2 - radius**2) - self._above(self.delta_radius_mm)
        real = Geometry(geometry.points + shift, geometry.directions, geometry.lengths)
        return real, parameters[..., :3] + raised

    def differing(self, after: Machine) -> tuple[str, ...]:
        words = ("endstops", "delta radius", "tower angles", "arm lengths")
        names = ("endstops_mm", "delta_radius_mm", "tower_angles_deg", "arm_length_mm")
        named = zip(words, names, strict=True)
        return tuple(word for word, name in named if getattr(self, name) != getattr(after, name))

    def believed(self, other: "LinearDelta", place: Floats) -> Floats:
        """Place by this controller of what is `place` by `other`, of another date, (n, 3) [mm]."""
        ends, others = self.endstop_carriages_mm, other.endstop_carriages_mm
        joints = other.nominal_rails.joints_for(place) + ends - others
        return np.asarray(self.nominal_rails.tool_for(joints))

    def together(
        self, dates: Sequence[tuple[Machine, Measured]], slope: Callable[[Plan], Floats]
    ) -> tuple[Plan, Floats]:
        """Touches stand where these settings put the nozzle, carriages as they were."""
        plans, values = list[ProbePlan](), list[Floats]()
        for day, (then, read) in enumerate(dates):
            plan = read.plan if isinstance(read, Readings) else None
            if not (isinstance(then, LinearDelta) and isinstance(plan, ProbePlan)):
                return super().together(dates, slope)
            then.check_same(self)
            place, other = (self.believed(then, at) for at in (plan.place, plan.other))
            order, at = plan.order + sum(map(len, plans)), np.full(len(plan), day)
            now = replace(plan, place=place, other=other, order=order, part=at)
            grown = plan.wanted - now.wanted
            values.append(np.where(plan.distance, read.value + grown, place[:, 2] - plan.surface))
            last = day == len(dates) - 1
            plans.append(replace(now, slope=slope(now) * (not last), date=at))
        return Plan.joined(*plans), np.concatenate(values)

    def judging(self, then: Machine) -> Machine:
        return then if then.kind == self.kind else self

    def holding(self, active: Sequence[float]) -> Self:
        fault = "The firmware of a printer keeps what it is given; nothing is recorded here."
        raise UsageError(fault, "Leave --applied out, and name a printer.cfg of each time.")

    def check_same(self, later: Machine) -> None:
        both = self, LinearDelta.require(later)
        sizes = np.array([(*machine.arm_length_mm, machine.delta_radius_mm) for machine in both])
        # Endstops, rods and stored arms may be changed from date to date.
        if np.abs(sizes[1] / sizes[0] - 1.0).max() > ANOTHER:
            arms, radii = sizes[:, :-1].mean(axis=1), sizes[:, -1]
            raise UsageError(
                f"These are two machines: arms {arms[0]:.0f} and {arms[1]:.0f} mm long, delta"
                f" radius {radii[0]:.0f} and {radii[1]:.0f} mm.",
                "Name two files of the same one; a machine file has its arm_length_mm and"
                " delta_radius_mm.",
            )

    def sensed(
        self, real: RealMachine, parameters: Numbers, plan: ProbePlan, strict: bool
    ) -> GaugeResponse:
        geometry, offsets = self.calibrated_as(real.geometry, parameters)
        points = Points.of(geometry, real.joints(self.command(plan), offsets), strict)
        tool = np.moveaxis(points.tool, (1, 0), (-2, -1))
        first, second = tool[..., : len(plan), :], tool[..., len(plan) :, :]
        readings = plan.place[:, 2] - first[..., 2]
        if plan.distance.any():
            # In addition to a touch a length of one, whose derivative is finite.
            apart = np.sqrt(((second - first) ** 2).sum(axis=-1) + ~plan.distance)
            readings = np.where(plan.distance, apart - plan.wanted, readings)
        return readings, first / self.bed_radius_mm, None

    def reading_words(self, plan: ProbePlan, index: int) -> str:
        """Such as "x 12.5, y -30 mm (touch 12)"."""
        x, y, _ = (f"{value:g}" for value in (plan.place[index].round(2) + 0.0).tolist())
        number = int(np.sum(plan.order <= plan.order[index]))
        kind = "distance" if plan.distance[index] else "touch"
        return f"x {x}, y {y} mm ({kind} {number})"

    def simulated_plan(self, wanted: SimulationOptions) -> Plan:
        """Touches spread evenly over the bed in a mixed order; all of one height, then the next."""
        if wanted.protocol or wanted.gauge_at is not None:
            fault = "--protocol and --gauge-at are for machines that are measured with gauges."
            raise UsageError(fault, "Leave them out.")
        at = mixed(rings(wanted.places or 41, REACH * self.bed_radius_mm))
        parts = [(at, height) for height in wanted.heights or (0.0,)] * (wanted.cycles or 1)
        return layout_of("simulated", "", parts).plan

    def synthetic(
        self, plan: ProbePlan, predict: Predicted, rng: np.random.Generator, gauge: Instrument
    ) -> Readings:
        touched, n, shape = plan, len(plan), self.local_shape(plan)
        local = shape.columns @ rng.standard_normal(shape.columns.shape[1])
        local += np.sqrt(shape.rest) * rng.standard_normal(n) if shape.rest else 0.0
        for _ in range(_STEPS):
            # The nozzle is sent lower or higher until it touches.
            height = plan.surface + predict(touched)
            touched = replace(touched, place=np.column_stack((plan.place[:, :2], height)))
        shown = gauge.shown(height + local + gauge.repeatability_mm * rng.standard_normal(n))
        value, lines = np.round(shown, 6) - plan.surface, np.arange(2, n + 2)
        source = Source("simulate", "", simulated=True)
        return Readings(touched, value, lines, timed=True, source=source)

    def adjusting_cells(self, leg: int, plan: ProbePlan) -> list[PlannedTouch]:
        """Choose some of the places that were touched before."""
        touched = np.unique(plan.place[plan.touches, :2].round(DECIMALS) + 0.0, axis=0)
        return [PlannedTouch(x, y) for x, y in touched[_spread(touched, SHOWING)].tolist()]

    def further(self, plan: ProbePlan) -> Iterator[tuple[Reason, ProbePlan, float]]:
        """Blocks under the probe: higher up the effect of the frame changes, not of the bed."""
        touches = np.flatnonzero(plan.touches)
        some = touches[_spread(plan.place[touches, :2], FEW)]
        for height in BLOCKS_MM:
            raised = plan.place[some] + [0.0, 0.0, height]
            yield (
                Reason.of("touch_raised", places=len(some), height_mm=height),
                touching(raised, plan.surface[some] + height),
                len(some) * (MINUTES_PER_TOUCH + MINUTES_PER_BLOCK),
            )

    def layouts(self) -> tuple[Layout, ...]:
        places = (mixed(rings(count, REACH * self.bed_radius_mm)) for count in PLACES)
        beds = ((f"{len(at)} places of the bed", at) for at in places)
        return tuple(layout_of(f"bed-{len(at)}", words, [(at, 0.0)]) for words, at in beds)

    def distinguishing_layouts(self) -> tuple[Layout, ...]:
        layouts = []
        for some, count in product(RAISED, SPREAD):
            upper = rings(some, REACH * self.bed_radius_mm)
            # A place that is touched on both heights has one local shape.
            bed = mixed(np.vstack((rings(count, REACH * self.bed_radius_mm), upper)))
            again = f"{some} of them again on a block of {HIGH_MM:g} mm"
            words = f"{len(bed)} places of the bed, and {again}"
            layouts.append(layout_of("telling", words, [(bed, 0.0), (mixed(upper), HIGH_MM)]))
        return tuple(sorted(layouts, key=lambda layout: layout.minutes))

    def local_shape(self, plan: ProbePlan) -> Influence:
        size, assumed = stated_or(self.probe.texture_mm, TEXTURE_MM)
        columns, touches = size * plan.texture, int(plan.touches.sum())
        # Mean variance of what is finer than the columns.
        finer2 = max(size**2 - float((columns**2).sum()) / max(touches, 1), 0.0)
        rest = finer2 if touches > MOST_TOUCHES else 0.0
        return Influence(Origin.BED_TEXTURE, size, "mm", assumed, columns, local=True, rest=rest)

    def _above(self, radius: Numbers | float) -> Numbers:
        """Height of each carriage over the tool in the middle, (..., 3) [mm]."""
        return np.sqrt(np.array(self.arm_length_mm) ** 2 - radius**2)


def _spread(place: Floats, count: int) -> Ints:
    """Choose places that are as far from each other as can be, indices (count,) of (n, 2)."""
    chosen = [int(np.argmin(np.linalg.norm(place, axis=1)))]
    apart = np.full(len(place), np.inf)
    while len(chosen) < min(count, len(place)):
        apart = np.minimum(apart, np.linalg.norm(place - place[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(apart)))
    return np.sort(np.array(chosen, dtype=np.intp))


def _alikeness(place: Floats, other: Floats) -> Floats:
    """Covariance of the local shape at places (n, 2) and others (m, 2), of unit size, (n, m)."""
    apart = np.hypot(*(place[:, None, axis] - other[:, axis] for axis in (0, 1)))
    return np.asarray(np.exp(-apart / GRAIN_MM))


def _on_circle(radius: Numbers | float, angles: Numbers) -> Numbers:
    """Places (..., 3, 3) at angles (..., 3) on a level circle of radius (..., 1)."""
    return np.stack((radius * np.cos(angles), radius * np.sin(angles), 0.0 * angles), axis=-1)


# --- ways to touch ----------------------------------------------------------------------------


def rings(count: int, radius: float) -> Floats:
    """The middle, and places on rings up to a radius [mm] around it, evenly, (count, 2) [mm]."""
    # Ring k of n has a share of places that grows with k: as many as stand equally close.
    n = max(round((np.sqrt(1.0 + 4.0 * (count - 1) / 3.0) - 1.0) / 2.0), 1)
    shares = np.cumsum(np.arange(1, n + 1)) / (n * (n + 1) / 2.0)
    sizes = np.diff(np.round((count - 1) * shares).astype(int), prepend=0)
    ring, first = np.repeat(np.arange(1, n + 1), sizes), np.repeat(np.cumsum(sizes) - sizes, sizes)
    along = (np.arange(count - 1) - first + ring / 2.0) / sizes[ring - 1]
    turn = np.radians(30.0) + 2.0 * np.pi * along
    around = radius * ring / n * np.stack((np.cos(turn), np.sin(turn)))
    return np.asarray(np.round(np.vstack((np.zeros(2), around.T)), DECIMALS) + 0.0)


def mixed(places: Floats) -> Floats:
    """The same places, each once, in an order that has little to do with where they are, (m, 2).

    So drift is taken neither for a tilt nor for a shape.
    """
    at = np.unique(places, axis=0)
    return np.asarray(at[np.argsort(np.arange(len(at)) * GOLDEN % 1.0, kind="stable")])


def touching(
    place: Floats,
    surface: Floats,
    order: Ints | None = None,
    minutes: Floats | None = None,
    **distances: Numbers,
) -> ProbePlan:
    """Touches of surfaces (n,) at places (n, 3) [mm]; further columns are those of `ProbePlan`."""
    order = np.arange(len(place)) if order is None else order
    clock = np.asarray(MINUTES_PER_TOUCH * order if minutes is None else minutes, np.float64)
    columns: dict[str, Numbers] = {"other": place, **distances}
    return ProbePlan(order=order, hours=clock / 60.0, place=place, surface=surface, **columns)


def layout_of(name: str, words: str, parts: Sequence[tuple[Floats, float]]) -> Layout:
    """Touches of places (m, 2) [mm], height by height."""
    place = np.vstack([np.column_stack((at, np.full(len(at), high))) for at, high in parts])
    pace = MINUTES_PER_TOUCH + MINUTES_PER_BLOCK * (place[:, 2] > 0.0)
    plan = touching(place, place[:, 2], minutes=np.cumsum(pace) - pace[0])
    return Layout(name, words, plan, float(pace.sum()))
