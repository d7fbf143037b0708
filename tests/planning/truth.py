"""Readings of any plan by the independent truth, also with postures that it does not know."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import Contact, GaugePlan
from tests import truth
from tests.truth.effects import Effect, state_with
from tests.truth.forward import carriages_and_tool, signals
from tests.truth.plan import SETUPS, joints_at


def like(machine: Machine) -> truth.Machine:
    """A machine of the truth with legs as long; nothing else of it shows in readings."""
    return replace(truth.PROTOTYPE, leg=machine.leg_length_mm)


def standing(
    gauge: Ints, along: Floats, joints: Floats, gauge_at: Floats, hours: Floats | None = None
) -> truth.Plan:
    """The truth's form of n readings, each gauge set up at the isotropic posture.

    Args:
        gauge: index into `SETUPS`, shape (n,).
        along: displacement of the tool along the touched leg, shape (n,) [mm].
        joints: indicated joints, shape (n, 3) [mm].
        gauge_at: place of the gauge along the leg, shape (n,).
        hours: when; all at once if None, shape (n,) [h].
    """
    leg, direction = np.array(SETUPS)[gauge].T
    nothing = np.zeros(len(gauge))
    return truth.Plan.of(
        leg=leg, direction=direction, posture=("",) * len(gauge), displacement=along,
        cycle=nothing + 1, minutes=nothing if hours is None else 60.0 * hours, indicated=joints,
        approach=np.zeros((len(gauge), 3)), setup=gauge, zero=gauge, gauge_at=gauge_at,
        stand=[gauge.tolist().index(own) for own in gauge.tolist()],
    )  # fmt: skip


def true_readings(
    plan: GaugePlan, machine: Machine, offsets: Floats, effects: tuple[Effect, ...] = ()
) -> Floats:
    """What perfect gauges read, shape (n,) [mm], of a plan of one part; offsets (3,) [mm]."""
    pairs = zip(plan.leg.tolist(), plan.displacement.tolist(), strict=True)
    joints = np.array([joints_at(machine.leg_length_mm, leg, moved) for leg, moved in pairs])
    gauge = np.array([SETUPS.index(tuple(series)) for series in plan.series])
    there = standing(gauge, plan.displacement, joints, plan.gauge_at, plan.hours)
    real, state = like(machine), state_with(offsets, effects)[None]
    if plan.fixed:
        return np.asarray(signals(there, real, state)[0])
    carriages, tool = carriages_and_tool(there, real, state, np.zeros((len(plan), 3)))
    rows = np.arange(len(plan))
    at_joint = carriages[plan.leg, plan.direction, 0, rows]
    at_tool = tool[plan.direction, 0, rows]
    return np.asarray(np.where(plan.contact == Contact.TOOL, at_tool, at_joint))
