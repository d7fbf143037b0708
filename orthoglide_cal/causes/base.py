"""What a cause is: parameters with a unit and a plausible size, acting in one step of a reading.

A cause overrides exactly one of `geometry`, `motion`, `contact` and `record`; bound to values
of its parameters it is an `Effect` of the forward model, the same one that solves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Numbers
from orthoglide_cal.effects import Commanded, Effect
from orthoglide_cal.kinematics import Geometry
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


class Step(StrEnum):
    """The step of a reading in which a cause acts."""

    GEOMETRY = "geometry"
    MOTION = "motion"
    CONTACT = "contact"
    RECORD = "record"


@dataclass(frozen=True)
class Where:
    """A place at which a cause may act, as indices that the cause understands."""

    index: tuple[int, ...] = ()


MACHINE_WIDE = Where()


class Cause:
    """Base of all causes; one subclass and one instance in each file of this folder.

    Attributes:
        id: cause id of the contract.
        title: in words.
        step: where it acts.
        unit: of its parameters and of its tolerance in the machine file.
        scale: one unit in internal units (mm, rad, mm/h, 1).
        names: of its parameters.
        nuisance: further parameters, not reported, behind the named ones: name → plausible size
            in tolerances.
        positive: True if the parameters cannot be negative.
        lasting: True if the same machine still has it in the next session.
        compensable: True if a controller can compensate it.
        timed: True if it can only be seen in readings whose time order is known.
        advice: what a technician can do about it.
    """

    id: str
    title: str
    step: Step
    unit: str
    scale: float = 1.0
    names: tuple[str, ...] = ()
    nuisance: tuple[tuple[str, float], ...] = ()
    positive: bool = False
    lasting: bool = False
    compensable: bool = False
    timed: bool = False
    advice: str

    def possible(self, machine: Machine) -> bool:
        """Whether it can happen on this machine and its gauge."""
        return machine.tolerances.get(self.id, 0.0) > 0.0

    def admissible(self, value: float) -> float:
        """The nearest value that a parameter can have: a width is not negative."""
        return max(value, 0.0) if self.positive else value

    @property
    def in_machine(self) -> bool:
        """True if the machine itself is wrong, not the contact or the record."""
        return self.step in (Step.GEOMETRY, Step.MOTION)

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Where it may act on these readings; one machine-wide place by default."""
        return (MACHINE_WIDE,)

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """A place in words; empty for the whole machine."""
        return ""

    def prior_std(self, machine: Machine) -> Floats:
        """Plausible size (one standard deviation) of each parameter, in internal units.

        Shape (p,), the named parameters and then the nuisance ones.
        """
        sizes = [1.0] * len(self.names) + [size for _, size in self.nuisance]
        return np.asarray(sizes) * self.scale * machine.tolerances[self.id]

    def at(self, theta: Numbers, where: Where = MACHINE_WIDE) -> Acting:
        """The effect of parameters `theta`, shape (..., p) in internal units."""
        return Acting(self, np.asarray(theta), where)

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """See `Effect.geometry`."""
        return geometry

    def motion(self, joints: Numbers, theta: Numbers, commanded: Commanded) -> Numbers:
        """See `Effect.motion`."""
        return joints

    def contact(
        self,
        heights: Numbers,
        theta: Numbers,
        where: Where,
        fraction: Numbers,
        commanded: Commanded,
    ) -> Numbers:
        """See `Effect.contact`."""
        return heights

    def record(
        self, readings: Numbers, theta: Numbers, where: Where, commanded: Commanded
    ) -> Numbers:
        """See `Effect.record`."""
        return readings


class PatternCause(Cause):
    """A cause of one parameter that adds a known pattern of readings, at one of many places.

    Attributes:
        counts: sizes that it can take where they are whole numbers, with how plausible each is;
            empty for a size of any value.
        hides_reading: True if the reading at its place says nothing any more.
    """

    names = ("size",)
    counts: Mapping[int, float] = MappingProxyType({})
    hides_reading: bool = False

    def millimetres(self, machine: Machine) -> float:
        """One unit of its size in what the patterns are multiplied by."""
        return 1.0

    def patterns(self, plan: Plan, places: tuple[Where, ...]) -> Floats:
        """Readings added by one internal unit at each place, shape (n, places)."""
        raise NotImplementedError

    def added(self, theta: Numbers, where: Where, plan: Plan) -> Numbers:
        """Readings added by `theta` (..., 1) at one place, shape (..., n)."""
        return np.asarray(theta * self.patterns(plan, (where,))[:, 0])


class RelabelCause(Cause):
    """A cause without size: readings written down with another sign or under another label."""

    unit = ""

    def relabel(self, plan: Plan, where: Where) -> tuple[np.ndarray, Floats]:
        """Indices and signs, shape (n,): recorded = signs · true[indices]; its own inverse."""
        raise NotImplementedError

    def reversible(self, plan: Plan, where: Where) -> bool:
        """Whether `relabel` can express it: each reading was written down in place of another."""
        return True

    def reread(self, plan: Plan, where: Where) -> Plan:
        """The plan with each reading under the leg and direction that was really read."""
        return plan

    def record(
        self, readings: Numbers, theta: Numbers, where: Where, commanded: Commanded
    ) -> Numbers:
        """Readings as they were written down."""
        index, sign = self.relabel(commanded.plan, where)
        return np.asarray(sign * readings[..., index])


@dataclass(frozen=True, eq=False)
class Acting(Effect):
    """A cause with values for its parameters.

    Attributes:
        cause: the cause.
        theta: its parameters, shape (..., p), in internal units.
        where: its place.
        spread: how uncertain they are: independent changes of theta by one standard deviation
            each, shape (m, p).
    """

    cause: Cause
    theta: Numbers
    where: Where = MACHINE_WIDE
    spread: Floats | tuple[()] = ()

    @property
    def repeats(self) -> bool:
        """See `Effect.repeats`."""
        return self.cause.lasting and not self.cause.timed

    def doubts(self) -> tuple[Effect, ...]:
        """See `Effect.doubts`."""
        return tuple(Acting(self.cause, self.theta + step, self.where) for step in self.spread)

    def geometry(self, geometry: Geometry) -> Geometry:
        """Rails and legs as they really are."""
        return self.cause.geometry(geometry, self.theta)

    def motion(self, joints: Numbers, commanded: Commanded) -> Numbers:
        """True joint positions."""
        return self.cause.motion(joints, self.theta, commanded)

    def contact(self, heights: Numbers, fraction: Numbers, commanded: Commanded) -> Numbers:
        """What the gauges touch."""
        return self.cause.contact(heights, self.theta, self.where, fraction, commanded)

    def record(self, readings: Numbers, commanded: Commanded) -> Numbers:
        """What was written down."""
        return self.cause.record(readings, self.theta, self.where, commanded)


def series_label(leg: int, direction: int) -> str:
    """ "leg x, direction y"."""
    return f"leg {AXES[leg]}, direction {AXES[direction]}"


def reading_label(plan: Plan, machine: Machine, index: int) -> str:
    """One reading in words: "leg x, direction y, min, cycle 2 (reading 12)"."""
    low, high = machine.joint_limits_mm
    moved = float(plan.displacement[index])
    names = {0.0: "iso", high: "max", low: "min"}
    same = (plan.setup == plan.setup[index]) & (plan.displacement == moved)
    cycle = int(np.sum(same & (plan.order <= plan.order[index])))
    number = int(np.sum(plan.order <= plan.order[index]))
    series = series_label(int(plan.leg[index]), int(plan.direction[index]))
    return f"{series}, {names.get(moved, f'{moved:g} mm')}, cycle {cycle} (reading {number})"


def series_places(plan: Plan) -> tuple[Where, ...]:
    """One place for each (leg, direction) that was read."""
    return tuple(Where(divmod(series, 3)) for series in np.unique(plan.series()).tolist())


def in_series(plan: Plan, where: Where) -> np.ndarray:
    """Mask (n,) of the readings of the (leg, direction) of a place."""
    leg, direction = where.index[:2]
    return np.asarray((plan.leg == leg) & (plan.direction == direction))
