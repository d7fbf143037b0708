"""A cause: a fault of readings; and an effect: a cause with values for its parameters.

A cause acts in exactly one of the four stages of a reading (`model.model`). Bound to values it is
an `Effect`, from the fit that finds it to the machine file that keeps it and back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from statistics import NormalDist
from types import MappingProxyType
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, computed_field

from orthoglide_cal.model.kinematics import Command, Geometry
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import AnyPlan, Floats, Ints, Numbers, Patterns, ReadOnly
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


PER_HOUR = "mm/h"  # unit of rates


class Cause:
    """Base of all causes; overrides exactly one of geometry, motion, contact and record."""

    id: str  # cause id of the contract; its words stand in its page of the guide
    stage: Stage  # that whose method it overrides
    unit: str  # of its parameters and of its size in the machine file
    # Kind of machine → plausible size of a parameter (one standard deviation, in `unit`) where the
    # machine file gives none; of another kind its class says it, or it does not happen there.
    sizes: Mapping[type[Machine], float] = MappingProxyType({})
    scale: float = 1.0  # one unit in internal units (mm, rad, mm/h, 1)
    names: tuple[str, ...] = ()  # of its parameters
    # Plausible sizes of further parameters, not reported, behind the named ones.
    nuisance: tuple[float, ...] = ()
    # Plausible sizes of the named parameters, in sizes of the cause; a fit chooses one of these.
    shares: tuple[tuple[float, ...], ...] = ()
    # Sizes that it can take where they are whole numbers → how plausible each is; empty for a size
    # of any value.
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

    def usual(self, kind: type[Machine]) -> float | None:
        """Its plausible size on a kind of machine, in `unit`; None where it does not happen."""
        return self.sizes.get(kind, kind.usual_sizes.get(self.id))

    def stated(self, machine: Machine) -> float:
        """Plausible size of a parameter (one standard deviation), in `unit`; 0 rules it out."""
        return machine.tolerances.get(self.id, self.usual(type(machine)) or 0.0)

    def size(self, machine: Machine) -> float:
        """The same, wider where the controller's own values are doubted."""
        stated = self.stated(machine)
        return math.hypot(stated, machine.doubted.get(self.id, 0.0)) if stated > 0.0 else stated

    def assumed(self, machine: Machine) -> bool:
        """True if that size is the default of its kind: the machine file gives none."""
        return self.usual(type(machine)) is not None and self.id not in machine.tolerances

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
        """The nearest value that a parameter can have: a width is not negative."""
        return max(value, 0.0) if self.positive else value

    @property
    def in_machine(self) -> bool:
        """True if the machine itself is wrong, not the contact or the record."""
        return self.stage in (Stage.GEOMETRY, Stage.MOTION)

    @property
    def fix_order(self) -> tuple[bool, bool]:
        """Sort key of what to fix first: the record, then the contact, then the machine."""
        return self.stage is not Stage.RECORD, self.in_machine

    @property
    def repeats(self) -> bool:
        """True if readings that differ in nothing but set-up and time stay equal under it."""
        return self.lasting and not self.timed

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
        """The same without those that are smaller than the first."""
        return self.shares[0].count(1.0) if self.shares else self.unknowns

    def places(self, plan: AnyPlan, machine: Machine) -> tuple[Place, ...]:
        """Where it may act on these readings; the whole machine by default."""
        return (EVERYWHERE,)

    def label(self, place: Place, plan: AnyPlan, machine: Machine) -> str:
        """A place in words; empty for the whole machine."""
        return ""

    def to_read_again(self, plan: AnyPlan, place: Place) -> tuple[int, ...]:
        """Indices of the readings that taking again would correct; () if that corrects nothing."""
        return ()

    def share(self, place: Place) -> float:
        """How likely it is at a place; 1 at most places."""
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

        `correlation` is that of the parameters in the order of `estimates`, shape (p, p).
        """
        rows = [self.names.index(name) for name in estimates]
        theta, covariance = np.zeros(self.unknowns), np.zeros((self.unknowns,) * 2)
        stds = np.array([estimate.std for estimate in estimates.values()])
        theta[rows] = [estimate.value * self.scale for estimate in estimates.values()]
        covariance[np.ix_(rows, rows)] = np.outer(stds, stds) * correlation
        return Effect(self, theta, covariance=covariance * self.scale**2)

    def correcting(self, machine: Machine, values: Mapping[str, float]) -> Effect:
        """Effect of a controller that corrects parameters of these values, in the unit.

        By the names that they have on this machine.
        """
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

        At positions (n,) of each carriage, for one that acts by joint; `home` is the joint position
        from which travel counts.
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
        """The largest of its named parameters, of theta (p,), by its plausible size.

        0 where no size is usual.
        """
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
        """The same, as part of the machine from this day on; where it started is forgotten."""
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
