"""A model: a machine with what is known to be wrong with it, and what every gauge reads on it.

A reading is made in four stages, and whatever is wrong with it acts in exactly one of them:

    geometry   where the rails and legs are            a_i, u_i, L_i
    motion     where the carriages really stand        q = ρ + Δρ
    contact    what the gauge touches                  Table 2, eqs. (18)–(24)
    record     what was written down

A cause is such a fault; bound to values it is an `Effect`. Predicted readings are those of gauges
whose zero is the frame's origin; each real one adds an unknown zero, which the estimation removes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, partial
from statistics import NormalDist
from types import MappingProxyType
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, computed_field

from orthoglide_cal.model.kinematics import Command, Derivative, Geometry, RealMachine
from orthoglide_cal.model.machine import Corrections, Instrument, Machine
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.plan import AnyPlan, Floats, Ints, Numbers, Patterns, Plan, ReadOnly
from orthoglide_cal.schema import Number, Schema


class Stage(StrEnum):
    """The stage of a reading in which a cause acts."""

    GEOMETRY = "geometry"
    MOTION = "motion"
    CONTACT = "contact"
    RECORD = "record"


# Where a cause acts, as indices that the cause understands.
Place = tuple[int, ...]
EVERYWHERE: Place = ()
CONFIDENCE = 0.95  # of every expanded uncertainty
NORMAL_K = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2.0)  # U/u of a normal distribution


class Estimate(Schema):
    """A number with its standard uncertainty, in `unit` (the unit of the files)."""

    name: str = ""  # in a machine file it is the key
    unit: str
    value: Annotated[Number, Field(ge=-1e6, le=1e6)]
    std: Annotated[Number, Field(ge=0.0, le=1e6)]

    @computed_field(description="U, of a normal distribution")
    @property
    def expanded(self) -> float:
        return NORMAL_K * self.std


class Screw(NamedTuple):
    """Fastener that a technician loosens to correct one parameter of a cause."""

    leg: int  # whose rail, or what is on whose leg: it alone is moved, the gauge is on this leg
    loosen: str  # in words
    move: str  # what is pushed then, in words
    homed: bool = False  # a push shows only after homing
    along: str = ""  # axis along which a shim as thick as the parameter moves the rail
    ways: tuple[str, ...] = ()  # to +, to -, in words; none where the gauge's direction says it
    about_foot: bool = False  # a rail turns where it meets the bed's plane


class Cause:
    """Base of all causes; overrides exactly one of geometry, motion, contact and record."""

    id: str  # cause id of the contract; its words stand in its page of the guide
    stage: Stage  # that whose method it overrides
    unit: str  # of its parameters and of its size in the machine file
    # Kind of machine → plausible size of a parameter (one standard deviation, in `unit`) where the
    # machine file gives none; see `Machine.usual_sizes`.
    sizes: Mapping[type[Machine], float] = MappingProxyType({})
    scale: float = 1.0  # one unit in internal units (mm, rad, mm/h, 1)
    names: tuple[str, ...] = ()  # of its parameters
    # Of further parameters, not reported: their plausible sizes, in sizes of the cause.
    nuisance: tuple[float, ...] = ()
    # The same of the named parameters; a fit chooses one of these.
    shares: tuple[tuple[float, ...], ...] = ()
    # Sizes that are whole numbers → how plausible each is; empty for a size of any value.
    counts: Mapping[int, float] = MappingProxyType({})
    positive: bool = False  # its parameters cannot be negative
    placed: bool = False  # it acts at one of its places, not on the whole machine
    lasting: bool = False  # the same machine still has it in the next session
    compensable: bool = False  # a controller can compensate it
    by_joint: bool = False  # it moves a carriage by what its position and direction alone decide
    with_travel: bool = False  # by the position alone: in proportion to the travel
    timed: bool = False  # it can only be seen in readings whose time order is known
    hides_reading: bool = False  # the reading at its place says nothing any more
    any_size: bool = False  # a blunder: no size of it is usual
    settles: bool = False  # readings before a carriage's first motion differ from all later ones
    weight: float = 1.0  # how likely it is before anything is read
    same_remedy_as: str | None = None  # id of another cause: they are one answer
    # Kind of machine → key of the machine file whose wrong number would look like it.
    number: Mapping[type[Machine], str] = MappingProxyType({})

    def __init_subclass__(cls) -> None:
        for stage in Stage:
            if stage in vars(cls):
                cls.stage = stage

    def key(self, machine: Machine) -> str:
        """The key of the machine file to correct where the cause is no damage."""
        return machine.of_kind(self.number, f"{self.id} under tolerances")

    def usual(self, kind: type[Machine] | Machine) -> float | None:
        """Its plausible size on a kind of machine, in `unit`; None where it does not happen."""
        return kind.of_kind(self.sizes, kind.usual_sizes.get(self.id))

    def stated(self, machine: Machine) -> float:
        """Plausible size of a parameter (one standard deviation), in `unit`; 0 rules it out."""
        return machine.tolerances.get(self.id, self.usual(machine) or 0.0)

    def size(self, machine: Machine) -> float:
        """The same, wider where the controller's own values are doubted."""
        stated = self.stated(machine)
        return math.hypot(stated, machine.doubted.get(self.id, 0.0)) if stated > 0.0 else stated

    def assumed(self, machine: Machine) -> bool:
        """True if that size is the default of its kind."""
        return self.usual(machine) is not None and self.id not in machine.tolerances

    def possible(self, machine: Machine) -> bool:
        """True if it can happen on this machine and its gauge."""
        return self.size(machine) > 0.0

    def within(self, spots: int) -> Self | None:
        """The cause with no more parameters than so many places may show; None if with none."""
        return self

    def adjustment(self, name: str) -> Screw | None:
        """Fastener that corrects a parameter; None if no screw or shim does."""
        return None

    @property
    def adjustable(self) -> bool:
        """True if a screw or shim corrects any of its parameters."""
        return any(map(self.adjustment, self.names))

    def admissible(self, value: float) -> float:
        """The nearest value that a parameter can have."""
        return max(value, 0.0) if self.positive else value

    @property
    def in_machine(self) -> bool:
        """True if the machine itself is wrong, not the contact or the record."""
        return self.stage in (Stage.GEOMETRY, Stage.MOTION)

    @property
    def repeats(self) -> bool:
        """True if readings that differ in nothing but set-up and time stay equal under it."""
        return self.lasting and not self.timed

    @property
    def is_rate(self) -> bool:
        """True if its parameters are rates: what it does grows with time."""
        return self.unit.endswith("/h")

    @property
    def unknowns(self) -> int:
        """Number of its parameters, nuisance ones included."""
        return len(self.names) + len(self.nuisance)

    @property
    def exchanges(self) -> bool:
        """True if it has no size: it exchanges readings, their signs or their unit."""
        return not self.unknowns

    @property
    def freedom(self) -> int:
        """Number of those that are as large as the first."""
        return self.shares[0].count(1.0) if self.shares else self.unknowns

    def places(self, plan: AnyPlan, machine: Machine) -> tuple[Place, ...]:
        """Places where it may act on these readings; the whole machine by default."""
        return (EVERYWHERE,)

    def label(self, place: Place, plan: AnyPlan, machine: Machine) -> str:
        """A place in words; empty for the whole machine."""
        return ""

    def to_read_again(self, plan: AnyPlan, place: Place) -> tuple[int, ...]:
        """Indices of the readings that taking again would correct; () if that corrects nothing."""
        return ()

    def share(self, place: Place) -> float:
        """Weight of a place; 1 at most places."""
        return 1.0

    def several(self, count: int) -> Self:
        """Errors of so many readings, each by itself, of one that hides a reading."""
        return self

    def unit_mm(self, place: Place) -> float:
        """The unit that was written down [mm]."""
        return 1.0

    def millimetres(self, machine: Machine) -> float:
        """One unit of its size in what its patterns are multiplied by."""
        return 1.0

    def patterns(self, plan: AnyPlan, places: tuple[Place, ...]) -> Patterns | None:
        """Readings added by one internal unit at each place, shape (n, places); None: not known."""
        return None

    def relabel(self, plan: AnyPlan, place: Place) -> tuple[Ints, Floats]:
        """Indices and signs, shape (n,): recorded = signs · true[indices]; its own inverse."""
        return np.arange(len(plan)), np.ones(len(plan))

    def reversible(self, plan: AnyPlan, place: Place) -> bool:
        """True if the data can express it: no reading was taken of something else than the plan."""
        return True

    def really_read(self, plan: AnyPlan, place: Place) -> AnyPlan:
        """The plan with each reading under the leg and direction that was really read."""
        return plan

    def prior_std(self, machine: Machine, choice: int = 0) -> Floats:
        """Plausible size (one standard deviation) of each parameter, in internal units.

        Shape (p,), the named parameters and then the nuisance ones; `choice` is among `shares`.
        """
        shares = self.shares[choice] if self.shares else (1.0,) * len(self.names)
        return np.asarray((*shares, *self.nuisance)) * self.scale * self.size(machine)

    def at(self, theta: Numbers, place: Place = EVERYWHERE) -> Effect:
        """The effect of parameters `theta`, shape (..., p) in internal units."""
        return Effect(self, np.asarray(theta), place)

    @property
    def absent(self) -> Effect:
        """The effect of parameters that are zero."""
        return self.at(np.zeros(self.unknowns))

    def estimated(self, estimates: Mapping[str, Estimate], correlation: Floats) -> Effect:
        """The effect of estimated parameters by name, in the unit; the others are zero and sure.

        `correlation` is in the order of `estimates`, shape (p, p).
        """
        rows = [self.names.index(name) for name in estimates]
        theta, covariance = np.zeros(self.unknowns), np.zeros((self.unknowns,) * 2)
        stds = np.array([estimate.std for estimate in estimates.values()])
        theta[rows] = [estimate.value * self.scale for estimate in estimates.values()]
        covariance[np.ix_(rows, rows)] = np.outer(stds, stds) * correlation
        return Effect(self, theta, covariance=covariance * self.scale**2)

    def correcting(self, machine: Machine, values: Mapping[str, float]) -> Effect:
        """Effect of a controller that corrects parameters of these values, in the unit, by the
        names that they have on this machine."""
        theta = np.zeros(self.unknowns)
        named = machine.named(self.names).values()
        theta[: len(self.names)] = [0.0 - values.get(name, 0.0) for name in named]
        return Effect(self, theta * self.scale, corrects=True)

    def transferred(self, theta: Floats, before: Machine, after: Machine) -> Floats:
        """The same parameters (p,) of the same machine, with other values in its controller."""
        return theta

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Rails and legs as they really are."""
        return geometry

    def motion(self, joints: Numbers, theta: Numbers, command: Command) -> Numbers:
        """True joint positions (..., n, 3) from those that the offsets alone would give [mm]."""
        return joints

    def correction(self, theta: Numbers, joints: Floats, home: float) -> Floats:
        """Joint corrections, moving + and moving -, that cancel it, shape (2, n, 3) [mm].

        At positions (n,) of each carriage, for one that acts by joint; `home` as in `Command`.
        """
        return np.zeros((2, len(joints), 3))

    def contact(
        self, readings: Numbers, effect: Effect, plan: AnyPlan, machine: Machine, where: Numbers
    ) -> Numbers:
        """Gauge positions (..., n) [mm]; `where` as in `GaugeResponse`."""
        return readings

    def inverted(self, readings: Floats, effect: Effect, plan: AnyPlan, machine: Machine) -> Floats:
        """Readings (n,) [mm] without a fault of contact or record, where that can be undone."""
        return readings

    def record(self, readings: Numbers, effect: Effect, plan: AnyPlan, machine: Machine) -> Numbers:
        """Values that were written down (..., n) [mm]."""
        return readings


@dataclass(frozen=True, eq=False)
class Effect(ReadOnly):
    """A cause with values for its parameters; leading axes broadcast with those of the offsets."""

    cause: Cause
    theta: Numbers  # its parameters, shape (..., p), in internal units
    place: Place = EVERYWHERE
    # Of theta, shape (p, p), internal units; None if it is known exactly.
    covariance: Floats | None = None
    date: str | None = None  # ISO date of its acceptance; None before
    data_sha256: str | None = None  # digest of the readings that it was accepted from
    corrects: bool = False  # it is what the controller does against the cause

    @property
    def std(self) -> Floats:
        """Standard deviations of theta, shape (p,), internal units."""
        if self.covariance is None:
            return np.zeros(self.theta.shape[-1])
        return np.sqrt(np.diag(self.covariance))

    def times(self, machine: Machine) -> float:
        """The largest of its named parameters, of theta (p,), in plausible sizes; 0 without one."""
        named = self.theta[: len(self.cause.names)]
        size = self.cause.scale * self.cause.size(machine)
        usual = size and not self.cause.any_size
        return float(np.abs(named).max(initial=0.0)) / size if usual else 0.0

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Each parameter, of theta (p,), of any size."""
        cause, scale = self.cause, self.cause.scale
        rows = zip(cause.names, self.theta.tolist(), self.std.tolist(), strict=False)
        return tuple(
            Estimate.model_construct(
                name=name, unit=cause.unit, value=cause.admissible(value) / scale, std=std / scale
            )
            for name, value, std in rows
        )

    @property
    def correlation(self) -> Floats:
        """Correlations of the named parameters, in their order, shape (p, p)."""
        named = len(self.cause.names)
        if self.covariance is None:
            return np.eye(named)
        size = np.outer(self.std[:named], self.std[:named])
        covariance = self.covariance[:named, :named]
        matrix = np.divide(covariance, size, out=np.eye(named), where=size > 0.0)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    def accepted(self, date: str, data_sha256: str) -> Effect:
        """The same as part of the machine from this day on, without nuisance parameters."""
        named = np.arange(self.theta.size) < len(self.cause.names)
        spread = None if self.covariance is None else self.covariance * np.outer(named, named)
        theta = np.array([self.cause.admissible(v) for v in self.theta.tolist()]) * named
        return replace(self, theta=theta, covariance=spread, date=date, data_sha256=data_sha256)

    def transferred(self, before: Machine, after: Machine) -> Effect:
        """`Cause.transferred` of this effect."""
        return replace(self, theta=self.cause.transferred(self.theta, before, after))

    @property
    def spread(self) -> Floats:
        """One standard deviation of theta (p,) along each independent uncertainty, (u, p)."""
        if self.covariance is None:
            return np.zeros((0, self.theta.size))
        size2, directions = np.linalg.eigh(self.covariance)
        steps = (directions * np.sqrt(np.maximum(size2, 0.0))).T
        return np.asarray(steps[steps.any(axis=1)])


@dataclass(frozen=True, eq=False)
class Model:
    """A machine and its accepted causes."""

    machine: Machine  # nominal; the controller computes its commands from it
    accepted: tuple[Effect, ...] = ()  # what it leaves out, applied in this order in each stage
    ruled_out: tuple[str, ...] = ()  # ids of causes that were looked at by hand and are not there

    def extended(self, effects: Iterable[Effect]) -> Model:
        """The model with more causes, after those that it has."""
        return replace(self, accepted=(*self.accepted, *effects))

    def holding(self, active: Sequence[float], corrected: Corrections | None = None) -> Model:
        """`Machine.holding`; other corrections, too, where they are given."""
        held = replace(self, machine=self.machine.holding(active))
        return held if corrected is None else held.correcting(corrected)

    def correcting(self, corrected: Corrections) -> Model:
        """The model with these corrections in force in the controller of its machine.

        They act with opposite sign on accepted causes, and are taken to remove any other.
        """
        accepted = [effect for effect in self.accepted if not effect.corrects]
        known = {effect.cause.id: effect.cause for effect in accepted}
        ids = (id for id in known if id in corrected)
        accepted += [known[id].correcting(self.machine, corrected[id]) for id in ids]
        machine = self.machine.changed(corrected=corrected)
        return replace(self, machine=machine, accepted=tuple(accepted))

    def total(self, effect: Effect) -> Floats:
        """Parameters (p,) with what the controller corrects, of which readings show the rest."""
        cause, corrected = effect.cause, self.machine.corrected
        if cause.id not in corrected or cause.id in {other.cause.id for other in self.accepted}:
            return effect.theta
        return effect.theta - cause.correcting(self.machine, corrected[cause.id]).theta

    def remaining(self) -> tuple[Effect, ...]:
        """The accepted causes, less what the controller corrects of them; one effect each."""
        left: dict[str, Effect] = {}
        for effect in self.accepted:
            first = left.setdefault(effect.cause.id, effect)
            if first is not effect:
                left[effect.cause.id] = replace(first, theta=first.theta + effect.theta)
        return tuple(left.values())

    def judging(self, then: Model) -> Model:
        """`Machine.judging`, with the causes that are known now."""
        machine = self.machine.judging(then.machine)
        accepted = tuple(effect.transferred(self.machine, machine) for effect in self.accepted)
        return replace(self, machine=machine, accepted=accepted)

    def called(self, effect: Effect) -> tuple[Estimate, ...]:
        """Parameters of an effect with the names that they have on this kind of machine."""
        names = self.machine.named(effect.cause.names)
        return tuple(one.changed(name=names[one.name]) for one in effect.estimates)

    @cached_property
    def repeats(self) -> bool:
        """True if readings that differ in nothing but set-up and time are predicted equal."""
        return all(effect.cause.repeats for effect in self.accepted)

    @cached_property
    def real(self) -> RealMachine:
        """Its rails and the motions of its carriages, as they really are."""
        geometry = self.machine.nominal_rails
        for effect in self.accepted:
            geometry = effect.cause.geometry(geometry, effect.theta)
        motions = tuple(partial(e.cause.motion, theta=e.theta) for e in self.accepted)
        still = all(effect.cause.stage is not Stage.MOTION for effect in self.accepted)
        return RealMachine(geometry, motions, still)


# Step of complex-step derivatives: its square vanishes against 1, so they are exact.
STEP = 1e-30
# So many readings, of all machines together, are simulated at a time.
AT_ONCE = 1 << 16


def simulate(model: Model, offsets: Numbers, plan: Plan) -> Numbers:
    """Predicted readings, (..., n) [mm], for joint offsets Δρ, (..., 3) [mm] (Table 2, errata).

    Leading axes of the parameters of the model's causes broadcast with those of the offsets: many
    machines in one call. Raises PostureError: this machine cannot take a posture.
    """
    return _simulate(model, np.asarray(offsets), plan, strict=True)[0]


def synthetic_session(
    model: Model,
    plan: Plan,
    offsets: Floats,
    rng: np.random.Generator,
    gauge: Instrument | None = None,
) -> Readings:
    """Readings of this plan that a known machine would give.

    Args:
        offsets: what each real value exceeds the controller's by, shape (p,) [mm, deg].
        rng: source of noise, of gauge zeros and of a bed's local shape.
        gauge: the machine's own if None; its repeatability is the noise, a resolution of 0 means
            no rounding.

    Raises PostureError: this machine cannot take a posture.
    """
    machine, predict = model.machine, partial(simulate, model, offsets)
    return machine.synthetic(plan, predict, rng, gauge or machine.instrument)


def differentiate(
    model: Model, offsets: Floats, plan: Plan, effects: Sequence[Effect] = (), strict: bool = True
) -> tuple[Floats, Floats]:
    """Readings (..., n) [mm], and their exact derivatives by offsets and parameters, (..., n, q).

    At offsets Δρ (..., 3) [mm]; the parameters are those of `effects`, each of theta (p,), further
    ones than those of the model. In closed form where only the motion of the carriages depends on
    them, else by complex steps. Unless it is `strict`, readings of what is unreachable are NaN.
    """
    known, jacobian = model.extended(effects) if effects else model, None
    if all(effect.cause.stage is Stage.MOTION for effect in effects):
        readings, jacobian = _simulate(known, offsets, plan, strict)
        if jacobian is not None and known.real.still:
            return readings, jacobian(None)
    ends = np.cumsum([offsets.shape[-1], *(effect.theta.size for effect in effects)])
    many = [offsets, *(effect.theta for effect in (*effects, *model.accepted))]
    batch = max(values.ndim for values in many) - 1
    steps = 1j * STEP * np.eye(ends[-1] + 1, ends[-1], k=-1)
    steps = steps.reshape(-1, *[1] * batch, ends[-1])

    def stepped(some: Numbers) -> tuple[Model, Numbers]:
        by_offsets, *by_effect = np.split(some, ends[:-1], axis=-1)
        pairs = zip(effects, by_effect, strict=True)
        moved = [effect.cause.at(effect.theta + step, effect.place) for effect, step in pairs]
        return model.extended(moved), offsets + by_offsets

    if jacobian is not None:
        moving, at = stepped(steps[1:])
        real = moving.real
        return readings, jacobian(
            lambda sent: np.moveaxis(real.joints(sent, at).imag / STEP, 0, -1)
        )
    some = max(AT_ONCE * offsets.shape[-1] // max(offsets.size * len(plan), 1), 1)
    every = []
    for start in range(0, len(steps), some):
        with np.errstate(invalid="ignore"):  # real NaN divides in silence, complex NaN does not
            moving, at = stepped(steps[start : start + some])
            every.append(_simulate(moving, at, plan, strict)[0])
    readings = np.concatenate(every)
    return readings[0].real, np.moveaxis(readings[1:].imag / STEP, 0, -1)


def differentiate_absent(
    model: Model, offsets: Floats, plan: Plan, causes: Sequence[Cause]
) -> tuple[Floats, list[Floats]]:
    """Readings (..., n) [mm], and their derivatives where `causes` are not there.

    By offsets Δρ (..., 3) [mm], (..., n, 3), then by the p parameters of each cause, (..., n, p).
    """
    slopes: dict[Cause, Floats] = {}
    # Without those that move the carriages, readings at one posture are equal.
    for moving in (True, False):
        some = [cause for cause in causes if (cause.stage is Stage.MOTION) == moving]
        if some or not moving:
            absent = [cause.absent for cause in some]
            readings, together = differentiate(model, offsets, plan, absent)
            ends = np.cumsum([offsets.shape[-1], *(cause.unknowns for cause in some)])
            by_offsets, *jacobians = np.split(together, ends[:-1], axis=-1)
            slopes |= zip(some, jacobians, strict=True)
    return readings, [by_offsets, *(slopes[cause] for cause in causes)]


def _simulate(
    model: Model, parameters: Numbers, plan: Plan, strict: bool
) -> tuple[Numbers, Derivative | None]:
    """Readings, and what works out their derivative by the parameters, if it is known."""
    machine = model.machine
    if model.repeats:
        plan = plan.steps
    readings, where, jacobian = machine.sensed(model.real, parameters, plan, strict)
    for effect in model.accepted:
        readings = effect.cause.contact(readings, effect, plan, machine, where)
    for effect in model.accepted:
        readings = effect.cause.record(readings, effect, plan, machine)
    as_touched = all(effect.cause.in_machine for effect in model.accepted)
    return readings, jacobian if as_touched else None
