"""The Orthoglide: three orthogonal rails, gauges that touch the legs, two measuring protocols.

What the paper makes of readings is a difference: the mean of some minus the mean of others of the
same gauge set-up, d = R·readings with a matrix R of shape (k, n); zeros vanish.
"""

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from orthoglide_cal.errors import InputError, PostureError, UsageError, command
from orthoglide_cal.model.gauge import PLACEMENT_MM, SCALE_U, Gauge
from orthoglide_cal.model.kinematics import (
    UNREACHED,
    ByUnknowns,
    Command,
    GaugeResponse,
    Geometry,
    Points,
    RealMachine,
)
from orthoglide_cal.model.machine import (
    HOMING_MM,
    Influence,
    Instrument,
    JointOffsets,
    Length,
    Machine,
    Named,
    Origin,
    Predicted,
    SimulationOptions,
    Suspicion,
    Vocabulary,
    stated_or,
)
from orthoglide_cal.model.measured import DataKind, Difference, Readings, Source
from orthoglide_cal.model.plan import Floats, Ints, Numbers, Plan, known_plan, read_only
from orthoglide_cal.model.readings import AXES, Contact, GaugePlan, Posture, Series, other_axes
from orthoglide_cal.schema import Number, ask

# Usual assembly leaves this much of each joint offset (sec. 2.2), one standard deviation [mm].
OFFSET_MM = 0.5
ZERO_RANGE_MM = 1.0  # synthetic gauge zeros lie anywhere within this distance of the origin
_ZERO = JointOffsets(0.0, 0.0, 0.0)
# Pace assumed where nobody measured the time: readings, and moves of the stand [min].
MINUTES_PER_POSTURE = 0.4
MINUTES_PER_SETUP = 4.0
# The plunger keeps this share of the leg from both joints: forks, bolts and the stand's arm.
MARGIN = 0.1
PLACE_STEP = 0.05  # of gauge places, as a share of the leg
ROUNDING = 1e-9
POSTURES = (Posture.ISO, Posture.MAX, Posture.MIN)
HEIGHT = 2  # single-posture gauges can stand on the xy-surface only, so they measure along z


class Orthoglide(Machine):
    """The machine of the paper, its joint limits as displacements (errata, eq. 2)."""

    parameter_names = AXES
    parameter_symbols = tuple(f"Δρ_{axis}" for axis in AXES)
    parameter_units = ("mm", "mm", "mm")
    # Independent offsets of that size, up to a sign that changes no square, shape (4, 3) [mm].
    linearization_points = read_only(
        OFFSET_MM * np.array([(1.0, *s) for s in product((1.0, -1.0), repeat=2)])
    )
    adds_to_joints = True
    controller_formats = ("linuxcnc", "table")
    vocabulary = Vocabulary(
        one="offset",
        many="offsets",
        title="Joint offsets",
        symbol="Δρ",
        relation="true position = indicated + Δρ",
        restart="Re-home all three axes.",
        entering="Enter the offsets, home all axes",
        beyond="no home switch is that far off (up to {limit} is plausible).",
        recheck="Check the unit of the readings, their legs and directions, and the leg length in"
        " the machine file. If a carriage really is that far off, move its home switch,"
        " or state homing_mm in the machine file.",
        more="Measure again with more postures.",
        noise="gauge",
        again="Check the set-up, measure again, and compare the two sessions.",
        positions="postures",
        repeat="Take more cycles",
        subject="an Orthoglide with a dial indicator",
        everywhere="every gauge",
        home="At the isotropic posture",
        further="two more postures of each leg between the isotropic one and its limits",
    )
    first_steps = (
        ("Measure", "measure", ""),
        ("Or practise first, in another folder", "machine new --practice", ""),
    )
    practice_steps = (("Practise without a machine", "measure --gauge simulated", ""),)
    noted = ("date", "operator", "temperature", "gauges")
    geometry_keys = ("leg_length_mm", "parallelogram_width_mm", "tool_offset_mm", "joint_limits_mm")
    # One fault in five is several times as large as its tolerance: at that alone a bar skewed by
    # three of them would be taken for a smaller skew together with a second fault.
    tolerance_scales: ClassVar[Mapping[float, float]] = MappingProxyType(
        {1.0: 0.8, 3.0: 0.17, 30.0: 0.03}
    )

    kind: Literal["orthoglide"] = "orthoglide"
    leg_length_mm: Annotated[Length, ask("L, length of a leg", "centre to centre of its joints")]
    parallelogram_width_mm: Annotated[Length, ask("d, width of a leg", "between its two bars")]
    tool_offset_mm: Annotated[
        Annotated[Number, Field(ge=0.0, le=1e5)],
        ask("r of the tool", "from the legs' ends to its centre point"),
    ]
    joint_limits_mm: Annotated[
        tuple[Number, Number], ask("Travel", "lowest and highest, from the isotropic posture")
    ]
    workspace_mm: Annotated[Length, ask("Workspace", "edge of the cube in which errors are shown")]
    gauge: Gauge  # normally used on it
    # Already active in the controller; nothing after the key is zero; of some, all are needed.
    offsets_mm: Annotated[Named[JointOffsets], BeforeValidator(lambda given: given or _ZERO)] = (
        _ZERO
    )

    @field_validator("parallelogram_width_mm")
    @classmethod
    def _narrow(cls, width: float, given: ValidationInfo) -> float:
        if width >= given.data.get("leg_length_mm", math.inf):
            raise InputError("The leg is wider than it is long.", "Check d and L.")
        return width

    @field_validator("offsets_mm")
    @classmethod
    def _within_travel(cls, offsets: JointOffsets, given: ValidationInfo) -> JointOffsets:
        low, high = given.data.get("joint_limits_mm", (-math.inf, math.inf))
        beyond = [name for name, offset in offsets._asdict().items() if abs(offset) > high - low]
        if beyond:
            fault = f"The offset is larger than the travel of {high - low:g} mm."
            raise InputError(fault, "Check its unit: mm.", column=beyond[0])
        return offsets

    @field_validator("joint_limits_mm")
    @classmethod
    def _ordered(cls, limits: tuple[float, float], given: ValidationInfo) -> tuple[float, float]:
        if not limits[0] < 0.0 < limits[1]:
            raise InputError(
                "The limits must be ordered, with the isotropic posture (0) between them.",
                "Give displacements from the isotropic posture, such as [-100, 60].",
            )
        length = given.data.get("leg_length_mm", math.inf)
        if beyond := [k for k, limit in enumerate(limits) if abs(limit) >= length]:
            raise InputError(
                f"The limit is beyond the leg's length of {length} mm.",
                "Give the displacement from the isotropic posture, not the joint value.",
                column=f"[{beyond[0]}]",
            )
        return limits

    @property
    def instrument(self) -> Gauge:
        return self.gauge

    @property
    def unobservable(self) -> tuple[str, ...]:
        """A longer leg looks like a smaller offset."""
        return ("leg_length",)

    @property
    def active(self) -> tuple[float, ...]:
        return self.offsets_mm

    def holding(self, active: Sequence[float]) -> Self:
        return self.changed(offsets_mm=JointOffsets(*active))

    @property
    def plausible(self) -> tuple[float, ...]:
        return (self.homing_mm or HOMING_MM,) * len(AXES)

    def measuring(self, file: Path | None, options: str = "", **given: object) -> str:
        return command("measure", **given, machine=file, options=options)

    @property
    def limits_mm(self) -> tuple[float, float]:
        return self.joint_limits_mm

    @property
    def geometry_words(self) -> str:
        low, high = self.joint_limits_mm
        return f"leg {self.leg_length_mm:g} mm, travel {low:g} to {high:+g} mm"

    @property
    def nominal_rails(self) -> Geometry:
        """Orthogonal rails that meet in the origin, equal legs (modelling assumption iv)."""
        return Geometry(np.zeros((3, 3)), np.eye(3), np.full(3, self.leg_length_mm))

    @property
    def home_mm(self) -> float:
        """Joint value of the isotropic posture, from which displacements count [mm]."""
        return self.leg_length_mm

    def joints_at(self, leg: Ints | int, displacement: Floats | float) -> Floats:
        """Indicated joints with one leg displaced by d: ρ_i = L + d, ρ_j = √(L² − d²) (sec. 2.5).

        Shape (..., 3) [mm] for legs 0, 1, 2 and displacements [mm] of shape (...). Raises
        PostureError: a displacement is not shorter than the legs.
        """
        length = self.leg_length_mm
        moved = np.asarray(displacement, dtype=np.float64)
        if np.any(np.abs(moved) >= length):
            worst = np.argmax(np.abs(moved))
            raise PostureError(
                f"Leg {AXES[int(np.ravel(leg)[worst])]} cannot be displaced by"
                f" {np.ravel(moved)[worst]:g} mm: the legs are {length:g} mm long.",
                "Use a posture inside the joint limits.",
            )
        displaced = np.asarray(leg)[..., None] == np.arange(3)
        return np.where(
            displaced, (length + moved)[..., None], np.sqrt(length**2 - moved**2)[..., None]
        )

    @property
    def cube(self) -> tuple[float, float]:
        """The cube within the joint limits, no larger than the workspace.

        A carriage is displaced by p_i + √(L² − p_j² − p_k²) − L: most at the middle of the upper
        face, least at the corner (low, ±m, ±m), m the larger of |low| and high.
        """
        low_limit, high_limit = self.joint_limits_mm
        length = self.leg_length_mm
        # No farther than half a leg from the origin, whatever the limits: legs stay long enough.
        high = min(high_limit, length / 2.0)
        reach = length + low_limit
        low = reach - math.sqrt(length**2 - 2.0 * high**2)
        if -low > high:
            low = (reach - math.sqrt(3.0 * length**2 - 2.0 * reach**2)) / 3.0
        low = min(max(low, -length / 2.0), 0.0)
        excess = max(high - low - self.workspace_mm, 0.0) / 2.0
        return low + excess, high - excess

    def reach_mm(self, gauge_at: float) -> tuple[float, float]:
        """Lowest and highest displacement within the limits at which the plunger keeps `MARGIN`.

        The plunger touches the bar of a leg displaced by d at gauge_at + d/L (sec. 2.5). The
        isotropic posture, where the gauge was set up, is always within reach.
        """
        low, high = self.joint_limits_mm
        near, far = ((at - gauge_at) * self.leg_length_mm for at in (MARGIN, 1.0 - MARGIN))
        return min(max(low, near), 0.0), max(min(high, far), 0.0)

    @property
    def gauge_places(self) -> tuple[float, ...]:
        """Outermost places along the leg where the plunger stays on the bar over all travel.

        Nearest to the carriage first; none if the travel is too long.
        """
        low, high = (limit / self.leg_length_mm for limit in self.joint_limits_mm)
        near = math.ceil((MARGIN - low) / PLACE_STEP - ROUNDING)
        far = math.floor((1.0 - MARGIN - high) / PLACE_STEP + ROUNDING)
        if near > far:
            return ()
        return tuple(round(at * PLACE_STEP, 9) for at in sorted({near, far}))

    def adjusting_cells(self, leg: int, plan: GaugePlan) -> list["PlannedReading"]:
        """All that gauges on this leg can read at the named postures."""
        places = dict.fromkeys((0.5, *self.gauge_places))
        moves = [self.displacement_mm(posture) for posture in POSTURES]
        return [
            PlannedReading(leg, direction, moved, Contact.FIXED, gauge_at=at)
            for at, direction, moved in product(places, other_axes(leg), moves)
            if self.reach_mm(at)[0] <= moved <= self.reach_mm(at)[1]
        ]

    def bar_warning(self, plan: GaugePlan) -> Suspicion | None:
        rows = np.flatnonzero(plan.contact == Contact.FIXED)
        if not rows.size:
            return None
        at = plan.gauge_at[rows] + plan.displacement[rows] / self.leg_length_mm
        # From the nearer joint, as a share of the leg; negative off the bar.
        keeps = np.minimum(at, 1.0 - at)
        worst = int(np.argmin(keeps))
        if keeps[worst] >= MARGIN - ROUNDING:
            return None
        row, left = rows[worst], float(keeps[worst]) * self.leg_length_mm
        where = f"with carriage {AXES[plan.leg[row]]} at {plan.displacement[row]:+g} mm"
        fault = f"The plunger comes near the end of the bar: {left:.3g} mm from it {where}."
        if left < 0.0:
            end = "carriage joint" if at[worst] < 0.5 else "tool"
            fault = f"The plunger leaves the bar: {where} the gauge is {-left:.3g} mm beyond the"
            fault += f" {end}."
        # In whole millimetres that are no farther out, if there are any.
        reach = self.reach_mm(0.5)
        low, high = (math.trunc(end + math.copysign(ROUNDING, end)) or end for end in reach)
        remedy = (
            "Measure with --design best, whose postures and gauge place fit; or make"
            f" joint_limits_mm in the machine file smaller: [{low:g}, {high:g}] is safe with the"
            " gauges half-way."
        )
        return Suspicion(fault, remedy, max(-left, 0.0))

    def command(self, plan: GaugePlan) -> Command:
        """Commands for the carriages; errors as of `joints_at`."""
        return _command(self, plan)

    def sensed(
        self, real: RealMachine, parameters: Numbers, plan: GaugePlan, strict: bool
    ) -> GaugeResponse:
        command = self.command(plan)
        if real.still:
            # Readings at one posture share their moment.
            first, moment = plan.moments
            joints: Numbers = command.sent[first] + parameters[..., None, :]
        else:
            joints, moment = real.joints(command, parameters), np.arange(len(plan))
        # Behind them the isotropic posture with what was entered when gauges were set up.
        stood, which = plan.set_up_moments
        set_up = command.home - stood + parameters[..., None, :]
        if set_up.shape[:-2] != joints.shape[:-2]:
            set_up = np.broadcast_to(set_up, (*joints.shape[:-2], *set_up.shape[-2:]))
        moments = moment, joints.shape[-2] + which
        joints = np.concatenate((joints, set_up), axis=-2)
        points = Points.of(real.geometry, joints)
        if strict and np.isnan(points.tool).any():
            failed = np.isnan(points.tool[0])
            bad = np.flatnonzero(failed.any(axis=tuple(range(1, failed.ndim)))[moment])
            named = "Isotropic posture"
            if bad.size:
                moved = plan.displacement[bad[0]]
                named = f"Leg {AXES[plan.leg[bad[0]]]} displaced by {moved:g} mm"
            raise PostureError(f"{named}: {UNREACHED[0]}", UNREACHED[1])
        return _touched(points, plan, command, *moments)

    def reading_words(self, plan: GaugePlan, index: int) -> str:
        """Such as "leg x, direction y, min, cycle 2 (reading 12)"."""
        moved = float(plan.displacement[index])
        posture = self.posture_at(moved) or f"{moved:g} mm"
        alike = (plan.setup == plan.setup[index]) & (plan.displacement == moved)
        so_far = plan.order <= plan.order[index]
        where = f"{plan.series[index].words}, {posture}, cycle {np.sum(alike & so_far)}"
        return f"{where}{plan.part_words(int(plan.part[index]))} (reading {np.sum(so_far)})"

    def simulated_plan(self, wanted: SimulationOptions) -> GaugePlan:
        if wanted.places or wanted.heights or wanted.further:
            options = "--places, --height and --radius-angles"
            raise UsageError(f"{options} are for a linear delta.", "Leave them out.")
        if wanted.protocol == "single":
            return single_posture(self, wanted.cycles or 3)
        at = 0.5 if wanted.gauge_at is None else wanted.gauge_at
        return double_posture(self, wanted.cycles or 3, gauge_at=at)

    def synthetic(
        self, plan: GaugePlan, predict: Predicted, rng: np.random.Generator, gauge: Instrument
    ) -> Readings:
        signal = predict(plan)
        zeros = rng.uniform(-ZERO_RANGE_MM, ZERO_RANGE_MM, plan.setups)[plan.setup]
        noise = gauge.repeatability_mm * rng.standard_normal(len(plan))
        return Readings(
            plan=plan,
            # Rounded again, because 3 · 0.01 is not 0.03.
            value=np.round(gauge.shown(signal + zeros + noise), 9),
            cycle=plan.cycles,
            posture=tuple(str(self.posture_at(d) or f"{d:g}") for d in plan.displacement.tolist()),
            line=np.arange(2, len(plan) + 2),
            timed=True,
            source=Source("simulate", "", simulated=True),
        )

    def uncertain(self, plan: GaugePlan, predict: Predicted) -> Iterator[Influence]:
        gauge, predicted = self.gauge, predict(plan)
        scale, assumed = stated_or(gauge.scale_u, SCALE_U)
        yield Influence(Origin.GAUGE_SCALE, scale, "", assumed, scale * predicted[..., None])
        if np.any(plan.contact == Contact.FIXED):
            # As far along the leg as the stand plausibly is from where it was meant to be.
            size, assumed = stated_or(gauge.placement_mm, PLACEMENT_MM)
            moved = replace(plan, gauge_at=plan.gauge_at + size / self.leg_length_mm)
            shift = (predict(known_plan(moved)) - predicted)[..., None] * plan.zeros
            yield Influence(Origin.GAUGE_PLACEMENT, size, "mm", assumed, shift)


@functools.lru_cache(maxsize=16)
def _command(machine: Orthoglide, plan: GaugePlan) -> Command:
    joints = machine.joints_at(plan.leg, plan.displacement)
    approach = Command.approach_of(joints - plan.entered, plan.in_time)
    return Command(joints, machine.home_mm, plan.elapsed, plan.entered, approach)


def _touched(
    points: Points, plan: GaugePlan, command: Command, moment: Ints, set_up: Ints
) -> GaugeResponse:
    """Places where the gauges touch the legs (Table 2, eqs. 18–24, errata).

    When each reading was taken and when its gauge was set up are moments of the points, (n,); only
    the offsets move the latter. In closed form: d carriage = u_i dq_i, d tool = (∂p/∂q) dq, and
    d fraction = (d place − d carriage − fraction·d span)/span, zero where the gauge is not fixed.
    In place: fresh memory for such long arrays costs more than the arithmetic.
    """
    leg, direction = plan.leg, plan.direction
    column = (-1, *[1] * (points.tool.ndim - 2))
    gauge_at, contact = plan.gauge_at.reshape(column), plan.contact.reshape(column)
    fixed = contact == Contact.FIXED
    carriage, side = points.centres[leg, leg, moment], points.centres[leg, direction, moment]
    # The gauge's place along the leg's axis, and the point of the leg that it now touches.
    place = (1.0 - gauge_at) * points.centres[leg, leg, set_up]
    place = place + gauge_at * points.tool[leg, set_up]
    span = points.tool[leg, moment] - carriage
    across = points.tool[direction, moment] - side
    fraction = (place - carriage) / span
    if not plan.fixed:
        fraction = np.where(fixed, fraction, contact == Contact.TOOL)

    def derivative(joints: ByUnknowns | None) -> Floats:
        tool_by_joint, every = points.tool_derivative, np.arange(len(leg))
        along, sideways = points.directions[leg, leg, 0], points.directions[leg, direction, 0]
        turn = fixed * across / span
        jacobian = tool_by_joint[direction, :, moment]
        jacobian *= fraction[:, None]
        part = tool_by_joint[leg, :, moment]
        part *= (turn * fraction)[:, None]
        jacobian -= part
        jacobian[every, leg] += (1.0 - fraction) * (sideways - turn * along)
        part[...] = tool_by_joint[leg, :, set_up]
        part *= (turn * gauge_at)[:, None]
        part[every, leg] += turn * (1.0 - gauge_at) * along
        if joints is None:
            return Points.batch_first(np.add(jacobian, part, out=part), 2)
        jacobian, part = Points.batch_first(jacobian, 2), Points.batch_first(part, 2)
        moved = (jacobian[..., None, :] @ joints(command))[..., 0, :]
        moved[..., : part.shape[-1]] += part
        return np.asarray(moved)

    heights = side + fraction * across
    return Points.batch_first(heights, 1), Points.batch_first(fraction, 1), derivative


# --- protocols -----------------------------------------------------------------------------


class PlannedReading(NamedTuple):
    """One reading to take, as in `GaugePlan`; the place of a gauge at an end is that end."""

    leg: int
    direction: int
    displacement: float  # mm
    contact: Contact
    gauge_at: float = 0.5
    part: int = 0
    turned: bool = False
    entered: tuple[float, float, float] = (0.0, 0.0, 0.0)  # mm

    @staticmethod
    def planned(readings: Sequence["PlannedReading"], **known: Numbers) -> GaugePlan:
        """The plan of readings in time order, at no time at all, with one set-up for each place.

        Order, hours and set-ups (n,) are those that are `known` instead.
        """
        given = {
            name: np.array([getattr(reading, name) for reading in readings])
            for name in PlannedReading._fields
        }
        entered, at = given.pop("entered").reshape(-1, 3), given["contact"] == Contact.TOOL
        order = np.arange(len(readings))
        given["gauge_at"] = np.where(given["contact"] == Contact.FIXED, given["gauge_at"], at)
        if "setup" not in known:
            places = np.reshape([reading.place for reading in readings], (-1, 5))
            known["setup"] = np.unique(places, axis=0, return_inverse=True)[1].reshape(-1)
        given |= {"order": order, "hours": 0.0 * order, "entered": entered, **known}
        return GaugePlan(**given)

    @property
    def series(self) -> Series:
        return Series(self.leg, self.direction)

    @property
    def ways(self) -> tuple[str, str]:
        """Ways to push a bar for more, and for less on the gauge."""
        axis = AXES[self.direction].upper()
        return f"towards +{axis}", f"towards -{axis}"

    @property
    def words(self) -> str:
        """Words for how it is taken; empty: by a gauge that is set up, a session says how."""
        return ""

    @property
    def place(self) -> tuple[float, ...]:
        """Place of its gauge: (part, leg, direction, place along the leg, bar turned).

        Both ends of a leg share a zero. No plunger stays where it was while its bar is turned.
        """
        at = self.gauge_at if self.contact == Contact.FIXED else -1.0
        return self.part, self.leg, self.direction, at, self.turned


def planned_readings(plan: Plan) -> list[PlannedReading]:
    """The readings of a plan of gauges."""
    plan = GaugePlan.require(plan)
    rows = zip(*(getattr(plan, name).tolist() for name in PlannedReading._fields), strict=True)
    return [
        PlannedReading(leg, direction, moved, Contact(contact), at, part, turned, (x, y, z))
        for leg, direction, moved, contact, at, part, turned, (x, y, z) in rows
    ]


def _paced(readings: Sequence[PlannedReading]) -> GaugePlan:
    """The plan of readings at the usual pace, two gauges side by side."""
    plan = PlannedReading.planned(readings)
    moved = np.diff((plan.leg, plan.displacement, plan.contact)).any(axis=0)
    pace = MINUTES_PER_POSTURE * moved + MINUTES_PER_SETUP * (np.diff(plan.leg) != 0)
    return replace(plan, hours=np.cumsum([0.0, *pace]) / 60.0)


def double_posture(
    machine: Machine,
    cycles: int = 3,
    closing: bool = True,
    postures: Sequence[Posture] = POSTURES,
    gauge_at: float = 0.5,
) -> GaugePlan:
    """Iso → Max → Min, repeated, for the x-, y- and z-leg in turn (sec. 3.3, 4.1).

    Two gauges, fixed in space, stand at `gauge_at` along the leg at the isotropic posture. The plan
    has 6·(len(postures)·cycles + closing) readings in time order: a `closing` isotropic one on each
    leg shows drift and knocks.
    """
    visited = [*postures] * cycles + [Posture.ISO] * closing
    return visiting([machine.displacement_mm(posture) for posture in visited], gauge_at)


def visiting(
    displacements: Sequence[float], gauge_at: float = 0.5, legs: Sequence[int] = (0, 1, 2)
) -> GaugePlan:
    """The same displacements [mm] of one leg after the other, read by two gauges."""
    readings = [
        PlannedReading(leg, direction, moved, Contact.FIXED, gauge_at)
        for leg, moved in product(legs, displacements)
        for direction in other_axes(leg)
    ]
    return _paced(readings)


def single_posture(machine: Machine, cycles: int = 1, closing: bool = False) -> GaugePlan:
    """Iso, Max, Min of the x-leg, then of the y-leg; at each, joint end and tool end along z.

    The height of both leg ends above the base, at the same posture (sec. 3.2). The plan has
    12·cycles readings in time order, 4 more if closed, and one gauge zero per leg.
    """
    visited = (*POSTURES * cycles, *[Posture.ISO] * closing)
    readings = [
        PlannedReading(leg, HEIGHT, machine.displacement_mm(posture), end)
        for leg, posture, end in product((0, 1), visited, (Contact.JOINT, Contact.TOOL))
    ]
    return _paced(readings)


@functools.lru_cache(maxsize=8)
def reduction(
    kind: DataKind, differences: tuple[Difference, ...], machine: Machine, plan: Plan
) -> Floats:
    """R, shape (k, n), so that R·readings are these differences, of the machine as it was found.

    Max − min; that posture − iso (eq. 24); tool end − joint end at one posture (eq. 10). Repeats
    are averaged within a gauge set-up, then over those that hold both cells; where there is none, a
    row is zero.
    """
    plan = GaugePlan.require(plan)
    # Something was entered, then or when their gauge was set up, or a bar was turned.
    changed = plan.entered.any(axis=1) | plan.stood.any(axis=1) | plan.turned
    matrix = np.zeros((len(differences), len(plan)))
    for row, (series, posture) in zip(matrix, differences, strict=True):
        if kind is DataKind.SINGLE:
            at = posture or Posture.ISO
            cells = (at, Contact.TOOL), (at, Contact.JOINT)
        else:
            ends = (posture, Posture.ISO) if posture else (Posture.MAX, Posture.MIN)
            cells = (ends[0], Contact.FIXED), (ends[1], Contact.FIXED)
        minuend, subtrahend = (
            plan.of(series)
            & ~changed
            & (plan.contact == contact)
            & (np.abs(plan.displacement - machine.displacement_mm(at)) < 1e-9)
            for at, contact in cells
        )
        both = np.intersect1d(plan.setup[minuend], plan.setup[subtrahend])
        for setup in both:
            for mask, sign in ((minuend, 1.0), (subtrahend, -1.0)):
                chosen = mask & (plan.setup == setup)
                row[chosen] = sign / (chosen.sum() * both.size)
    return read_only(matrix)


def ideal_plan(kind: DataKind, machine: Machine) -> GaugePlan:
    """One reading of each cell that the differences of this kind need."""
    if kind is DataKind.SINGLE:
        return single_posture(machine)
    ends = (Posture.MAX, Posture.MIN)
    postures = ends if kind is DataKind.SIX else (Posture.ISO, *ends)
    return double_posture(machine, cycles=1, closing=False, postures=postures)
