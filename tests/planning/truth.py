"""Readings of any plan by the independent truth, also with postures that it does not know."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan
from tests import truth
from tests.truth.effects import Effect, state_with
from tests.truth.forward import carriages_and_tool, signals
from tests.truth.plan import plan_of


def like(machine: Machine) -> truth.Machine:
    """A machine of the truth with legs as long; nothing else of it shows in readings."""
    return replace(truth.PROTOTYPE, leg=machine.leg_length_mm)


def true_readings(
    plan: GaugePlan, machine: Machine, offsets: Floats, effects: tuple[Effect, ...] = ()
) -> Floats:
    """What perfect gauges read, shape (n,) [mm], of a plan of one part; offsets (3,) [mm]."""
    columns = {
        name: getattr(plan, name) for name in ("leg", "direction", "displacement", "gauge_at")
    }
    real, state = like(machine), state_with(offsets, effects)[None]
    there = plan_of(real, **columns, minutes=60.0 * plan.hours)
    if plan.fixed:
        return np.asarray(signals(there, real, state)[0])
    carriages, tool = carriages_and_tool(there, real, state, np.zeros((len(plan), 3)))
    rows = np.arange(len(plan))
    at_joint = carriages[plan.leg, plan.direction, 0, rows]
    at_tool = tool[plan.direction, 0, rows]
    return np.asarray(np.where(plan.contact == Contact.TOOL, at_tool, at_joint))
