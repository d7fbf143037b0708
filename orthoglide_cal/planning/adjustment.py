"""Adjustment of a named cause: which posture and gauge show it best, and what the gauge must read.

While an axis is loose the drives are off and the gauge stays where it is, with an unknown zero. So
what counts is by how much its reading changes, at one posture, until a parameter θ is gone:

    Δ = h(0) − h(θ),    U² = (k ∂h/∂θ u(θ))² + 2 (k σ)²

of the model's readings h, with k for 95 %. Afterwards the difference between two postures, in
which the gauge's zero has no part, shows whether the part moved as it was meant to.
"""

from itertools import product

import numpy as np
from pydantic import Field

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError, UsageError, command
from orthoglide_cal.estimation.accuracy import half_width
from orthoglide_cal.inference import Diagnosis, Verdict
from orthoglide_cal.inference.prediction import expect
from orthoglide_cal.model.cause import Cause, Effect
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model, differentiate, simulate
from orthoglide_cal.model.orthoglide import POSTURES, Orthoglide, PlannedReading, plan_of
from orthoglide_cal.model.plan import Floats, Numbers
from orthoglide_cal.model.readings import Contact, GaugePlan, other_axes
from orthoglide_cal.schema import Schema

_HALF_WAY = 0.5  # along the leg


class Adjustment(Schema):
    """One parameter of a cause, and how it is corrected; lengths are readings of one gauge."""

    parameter: str
    unit: str
    value: float
    expanded: float = Field(description="U of the value")
    loosen: str = Field(description="what is loosened")
    move: str = Field(description="what is pushed then; the gauge reads more if it goes to +")
    leg: int = Field(description="0, 1, 2 for x, y, z: the gauge is on its bar")
    direction: int = Field(description="along which the gauge reads")
    gauge_at: float = Field(description="place along the leg at the isotropic posture")
    here_mm: float = Field(description="displacement of its carriage while it is adjusted")
    there_mm: float = Field(description="and for the check afterwards")
    sensitivity: float = Field(description="change of the reading, mm per unit of the parameter")
    change_mm: float = Field(description="of the reading, until the parameter is zero")
    expanded_mm: float = Field(description="U of that change")
    check_mm: float = Field(description="reading there less reading here, afterwards")
    check_expanded_mm: float

    @property
    def cells(self) -> tuple[PlannedReading, PlannedReading]:
        """The reading while it is adjusted, and that of the check."""
        here, there = (
            PlannedReading(self.leg, self.direction, at, Contact.FIXED, gauge_at=self.gauge_at)
            for at in (self.here_mm, self.there_mm)
        )
        return here, there


class MovedAlone(Cause):
    """A change of another cause's parameters that one rail makes alone, or what is on its leg.

    A cause shares a parameter evenly among the rails that it moves: the frame stays between them.
    Who adjusts one leaves the others, and the gauge's stand, where they are.
    """

    def __init__(self, cause: Cause, leg: int, nominal: Geometry, parameter: int) -> None:
        self.id, self.stage, self.names, self._cause = cause.id, cause.stage, cause.names, cause
        self._own = (np.arange(3) == leg)[:, None]
        unit = cause.scale * np.eye(cause.unknowns)[parameter]
        moved = cause.geometry(nominal, unit)
        shifted = (moved.points != nominal.points) | (moved.directions != nominal.directions)
        self._sharing = max(int(shifted.any(axis=1).sum()), 1)

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Move one rail by what all that share the change would; theta (..., p)."""
        moved = self._cause.geometry(geometry, self._sharing * theta)
        points = np.where(self._own, moved.points, geometry.points)
        return Geometry(
            points, np.where(self._own, moved.directions, geometry.directions), geometry.lengths
        )

    def contact(
        self, heights: Numbers, effect: Effect, where: Numbers, plan: GaugePlan, machine: Machine
    ) -> Numbers:
        return self._cause.contact(heights, effect, where, plan, machine)


def choose_adjustments(diagnosis: Diagnosis, id: str | None) -> tuple[str, tuple[Adjustment, ...]]:
    """Choose the named cause that is corrected, the first if none is asked for, and how.

    Raises UsageError: there is no such cause, or no screw for it; UnusableResultError: it is not
    named, nothing that is named has a screw, or it is within its U.
    """
    having = [id for id, cause in CAUSES.items() if any(map(cause.adjustment, cause.names))]
    if id is not None and id not in having:
        what = f"No screw or shim corrects {id!r}."
        raise UsageError(what, f"Choose one of {', '.join(having)}.")
    named = diagnosis.causes if diagnosis.verdict is Verdict.NAMED else ()
    chosen = next((c.id for c in named if c.id in having and id in (None, c.id)), None)
    path = diagnosis.measured.source.path
    see = f"See what it says, and what to do: {command('diagnose', path)}"
    if chosen is None:
        what = f"{path} does not name {id or 'anything that a screw corrects'}."
        raise UnusableResultError(what, see)
    if not (made := adjustments(diagnosis, chosen)):
        raise UnusableResultError(f"Of {chosen} nothing is larger than its U.", see)
    return chosen, made


def adjustments(diagnosis: Diagnosis, id: str) -> tuple[Adjustment, ...]:
    """How to correct a named cause: each parameter beyond its U, the largest first.

    So what is left is least, wherever one stops. Raises UsageError: the machine is not read with
    gauges.
    """
    model, fit = diagnosis.model, diagnosis.left_open[0][1]
    machine, k = model.orthoglide, half_width(np.inf)
    effect = next(effect for effect in diagnosis.effects if effect.cause.id == id)
    cause = effect.cause
    lasting = [effect for effect in diagnosis.effects if effect.cause.lasting]
    now = model.extended(lasting)
    made: list[Adjustment] = []
    order = np.argsort(-np.abs(effect.theta[: len(cause.names)]))
    for parameter, name in ((j, cause.names[j]) for j in order.tolist()):
        screw, size = cause.adjustment(name), effect.estimates[name]
        if screw is None or abs(size.value) <= k * size.std:
            continue
        alone = MovedAlone(cause, screw.leg, machine.nominal_rails, parameter)
        correction = alone.at(-effect.theta * (np.arange(effect.theta.size) == parameter))
        readings = _readings(machine, screw.leg)
        plan = plan_of(readings)
        nothing = alone.at(np.zeros(cause.unknowns))
        slopes = differentiate(now, fit.offsets, plan, [nothing])[1]
        slope: Floats = slopes[:, len(fit.offsets) + parameter]
        here = int(np.argmax(np.abs(slope)))
        same = [i for i, cell in enumerate(readings) if _stands_as(cell, readings[here])]
        there = max(same, key=lambda i: abs(slope[i] - slope[here]))
        corrected = now.extended([correction])
        change = simulate(corrected, fit.offsets, plan) - simulate(now, fit.offsets, plan)
        expanded = k * np.hypot(slope[here] * size.std * cause.scale, np.sqrt(2.0) * fit.sigma)
        check, check_expanded = _check(diagnosis, now, corrected, plan, here, there)
        # The check is also off by how far the adjustment may stop from its aim.
        apart = abs((slope[there] - slope[here]) / slope[here]) * expanded
        cell = readings[here]
        made.append(
            Adjustment(
                parameter=name, unit=size.unit, value=size.value, expanded=k * size.std,
                loosen=screw.loosen, move=screw.move, leg=cell.leg, direction=cell.direction,
                gauge_at=cell.gauge_at, here_mm=cell.displacement,
                there_mm=readings[there].displacement,
                sensitivity=float(slope[here] * cause.scale), change_mm=float(change[here]),
                expanded_mm=float(expanded), check_mm=check,
                check_expanded_mm=float(np.hypot(check_expanded, apart)),
            )
        )  # fmt: skip
        now = corrected
    return tuple(made)


def _readings(machine: Orthoglide, leg: int) -> list[PlannedReading]:
    """All that a gauge on this leg can read where its plunger stays on the bar."""
    places = dict.fromkeys((_HALF_WAY, *machine.gauge_places))
    postures = [machine.displacement_mm(posture) for posture in POSTURES]
    return [
        PlannedReading(leg, direction, moved, Contact.FIXED, gauge_at=at)
        for at, direction, moved in product(places, other_axes(leg), postures)
        if machine.reach_mm(at)[0] <= moved <= machine.reach_mm(at)[1]
    ]


def _stands_as(one: PlannedReading, other: PlannedReading) -> bool:
    """True if two readings are of one gauge at one place."""
    return (one.direction, one.gauge_at) == (other.direction, other.gauge_at)


def _check(
    diagnosis: Diagnosis, now: Model, corrected: Model, plan: GaugePlan, here: int, there: int
) -> tuple[float, float]:
    """Difference between two readings of a plan after a correction, and its U [mm]."""
    fit = diagnosis.left_open[0][1]
    _, root = expect(fit, diagnosis.model, plan, None)
    after = simulate(corrected, fit.offsets, plan)
    spread = np.append(root[there] - root[here], np.sqrt(2.0) * fit.sigma)
    return float(after[there] - after[here]), float(half_width(np.inf) * np.linalg.norm(spread))
