"""Adjustment of a named cause: which posture and gauge show it best, and what the gauge must read.

While an axis is loose the drives are off and the gauge stays where it is, with an unknown zero. So
what counts is by how much its reading changes, at one posture, until a parameter θ is gone:

    Δ = h(0) − h(θ),    U² = (k ∂h/∂θ u(θ))² + 2 (k σ)²

of the model's readings h, with k for 95 %. Afterwards the difference between two postures, in
which the gauge's zero has no part, shows whether the part moved as it was meant to.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from orthoglide_cal.causes import CAUSES, HOME_SWITCH
from orthoglide_cal.errors import UnusableResultError, UsageError, command
from orthoglide_cal.inference.diagnose import Diagnosis
from orthoglide_cal.inference.prediction import expect
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.machine import Named
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import (
    NORMAL_K,
    Cause,
    Effect,
    Estimate,
    Model,
    Screw,
    Stage,
    differentiate,
    simulate,
)
from orthoglide_cal.model.plan import AnyCell, Floats, Numbers, Plan

# What screws took away: id of a cause, or home_switch for joint offsets, and by how much.
Removed = Sequence[tuple[str, Estimate]]


class Adjustment(Estimate):
    """Correction of a parameter of a cause."""

    loosen: str  # what is loosened
    move: str  # what is pushed then
    ways: tuple[str, str]  # in which it goes for more, and for less on the gauge, in words
    homed: bool  # the gauge shows a push only after homing
    here: Named[AnyCell]  # what is read while it is adjusted
    there: Named[AnyCell]  # and at the second posture, for the check
    sensitivity: float  # change of the reading, mm per unit of the parameter
    change_mm: float  # of the reading, until the parameter is zero
    expanded_mm: float  # U of that change
    removes: Removed  # causes, or home_switch for offsets, and how much of them
    check_mm: float  # reading there less reading here, afterwards
    check_expanded_mm: float


class MovedAlone(Cause):
    """A change of another cause's parameter, which that shares among rails, by one rail alone."""

    def __init__(self, cause: Cause, screw: Screw, nominal: Geometry, parameter: int) -> None:
        self.id, self.names, self._cause = cause.id, cause.names, cause
        self._mine = (np.arange(3) == screw.leg)[:, None]
        self._shifts = self._mine & (not screw.about_foot)
        moved = cause.geometry(nominal, cause.scale * np.eye(cause.unknowns)[parameter])
        shifted = (moved.points != nominal.points) | (moved.directions != nominal.directions)
        self._sharing = max(int(shifted.any(axis=1).sum()), 1)

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        moved = self._cause.geometry(geometry, self._sharing * theta)
        points = np.where(self._shifts, moved.points, geometry.points)
        directions = np.where(self._mine, moved.directions, geometry.directions)
        return Geometry(points, directions, geometry.lengths)


def choose_adjustments(
    diagnosis: Diagnosis, id: str | None, machine_file: Path | None = None
) -> tuple[str, tuple[Adjustment, ...]]:
    """Choose the named cause to be corrected, the first or the one asked for, and how.

    `home_switch` are the offsets themselves. Each parameter beyond its U, the largest first. Raises
    UsageError: no screw corrects this cause, or these are no readings; UnusableResultError: it is
    not named, or nothing of it is beyond its U.
    """
    path = diagnosis.measured.source.path
    if not isinstance(diagnosis.measured, Readings):
        remedy = "Give the file of the raw readings, if you have it."
        raise UsageError(f"{path} holds differences, no readings.", remedy)
    named = diagnosis.effects if diagnosis.verdict is Verdict.NAMED else ()
    if id == HOME_SWITCH.id:
        offsets = HOME_SWITCH.at(diagnosis.offsets_mm)
        named = (replace(offsets, covariance=diagnosis.covariance_mm2),)
    asked = [effect for effect in named if id in (None, effect.cause.id)]
    effect = next((effect for effect in asked if effect.cause.adjustable), None)
    if effect and (made := tuple(_adjustments(diagnosis, diagnosis.measured.plan, effect))):
        return effect.cause.id, made
    cause = CAUSES.get(id) if id else next((e.cause for e in asked if effect is None), None)
    if cause and not cause.adjustable:
        problem = f"No screw or shim corrects {cause.id!r}."
        remedy = f"See what helps: {command('guide', cause.id)}"
        raise (UsageError if id else UnusableResultError)(problem, remedy)
    machine, every = diagnosis.model.machine, (*CAUSES.values(), HOME_SWITCH)
    having = [other.id for other in every if other.adjustable and other.usual(machine)]
    if id not in (None, *having):
        remedy = f"Choose one of: {', '.join(having)}."
        raise UsageError(f"There is no cause {id!r} at this machine.", remedy)
    problem = f"{path} does not name {id or 'anything that a screw corrects'} beyond its U."
    shown = command("diagnose", path, machine=machine_file)
    raise UnusableResultError(problem, f"See what it says: {shown}")


def _adjustments(diagnosis: Diagnosis, measured: Plan, effect: Effect) -> Iterator[Adjustment]:
    """Each with the gauge whose reading changes most, and the check at the posture most unlike."""
    cause, k, fit = effect.cause, NORMAL_K, diagnosis.left_open[0][1]
    machine, noise = diagnosis.model.machine, np.sqrt(2.0) * fit.sigma  # of a difference
    now = diagnosis.model.extended(e for e in diagnosis.effects if e.cause.lasting)
    for parameter in np.argsort(-np.abs(effect.theta)).tolist():
        name, std = cause.names[parameter], effect.std[parameter]
        size, screw = effect.estimates[parameter], cause.adjustment(name)
        cells = machine.adjusting_cells(screw.leg, measured) if screw else ()
        if not (screw and cells):
            continue
        plan, alone = cells[0].planned(cells), cause
        if cause.stage is Stage.GEOMETRY:
            alone = MovedAlone(cause, screw, machine.nominal_rails, parameter)
        readings, slopes = differentiate(now, fit.offsets, plan, [alone.absent])
        slope = slopes[:, fit.offsets.size + parameter]
        here = int(np.argmax(np.abs(slope)))
        same = [row for row, cell in enumerate(cells) if cell.place == cells[here].place]
        there = max(same, key=lambda row: abs(slope[row] - slope[here]))
        gone = alone.at(-effect.theta * (np.arange(effect.theta.size) == parameter))
        corrected = simulate(now.extended([gone]), fit.offsets, plan)
        change = float(corrected[here] - readings[here])
        expanded = k * np.hypot(slope[here] * std, noise)
        if abs(change) <= expanded:
            continue  # no reading shows that anything is to be pushed
        now = now.extended([gone])
        # As well as the gauge sees it: how well a parameter is known is not how far it is pushed.
        unsure = float(noise / abs(slope[here] * effect.theta[parameter]))
        sizes = [(cause.id, name, size.unit, size.value)] if cause.id in CAUSES else []
        whole = [cell for leg in range(3) for cell in machine.adjusting_cells(leg, measured)]
        moves = _moved(now, fit.offsets, cells[0].planned(whole), alone, cause, parameter)
        theta = float(effect.theta[parameter])
        sizes += [(HOME_SWITCH.id, at, unit, moved * theta) for at, unit, moved in moves]
        _, _, root = expect(fit, diagnosis.model, plan)
        # The adjustment may stop at U from its aim, which the check shows, too.
        stop = abs(slope[there] / slope[here] - 1.0) * expanded
        spread = np.array([*(k * (root[there] - root[here])), k * noise, stop])
        more, less = screw.ways[:: int(np.sign(slope[here]))] or cells[here].ways
        yield Adjustment(
            name=name, unit=size.unit, value=size.value, std=size.std,
            loosen=screw.loosen, move=screw.move, ways=(more, less), homed=screw.homed,
            here=cells[here], there=cells[there],
            sensitivity=float(slope[here] * cause.scale),
            change_mm=change, expanded_mm=float(expanded),
            removes=[
                (id, Estimate(name=at, unit=unit, value=by, std=abs(by) * unsure))
                for id, at, unit, by in sizes
            ],
            check_mm=float(corrected[there] - corrected[here]),
            check_expanded_mm=float(np.linalg.norm(spread)),
        )  # fmt: skip


def _moved(
    model: Model, offsets: Floats, plan: Plan, alone: Cause, cause: Cause, parameter: int
) -> Iterator[tuple[str, str, float]]:
    """Changes of what is calibrated, by a push besides that of the parameter: name, unit, size.

    A rail that moves alone takes the frame along; one that turns about its foot its carriage.
    """
    n = offsets.size
    _, slopes = differentiate(model, offsets, plan, [alone.absent, cause.absent])
    pushed, shared = slopes[:, n + parameter], slopes[:, n + parameter + cause.unknowns]
    left = pushed - (shared if cause.id in CAUSES else 0.0)
    moved = np.linalg.lstsq(np.hstack([slopes[:, :n], plan.zeros]), left)[0].tolist()
    least = 0.01 * np.abs(pushed).max()  # what a turned rail moves is of second order
    machine = model.machine
    for row in zip(machine.parameter_names, machine.parameter_units, moved, strict=False):
        if abs(row[2]) > least:
            yield row
