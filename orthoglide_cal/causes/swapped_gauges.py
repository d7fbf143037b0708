"""The two gauges of one leg were exchanged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.causes.base import RelabelCause, Step, Where
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


class SwappedGauges(RelabelCause):
    """Each reading of one direction was written under the other direction of the same leg."""

    id = "swapped_gauges"
    title = "the two gauges of one leg were exchanged"
    step = Step.RECORD
    advice = "Check the cables or columns of the two gauges of this leg and exchange them back."

    def places(self, plan: Plan, machine: Machine) -> tuple[Where, ...]:
        """Every leg that was read in two directions."""
        return tuple(
            Where((leg,))
            for leg in range(3)
            if np.unique(plan.direction[plan.leg == leg]).size == 2
        )

    def label(self, where: Where, plan: Plan, machine: Machine) -> str:
        """The leg."""
        return f"leg {AXES[where.index[0]]}"

    def relabel(self, plan: Plan, where: Where) -> tuple[np.ndarray, Floats]:
        """Exchange the readings of the two directions of the leg, where they pair up."""
        index = np.arange(len(plan))
        pairs = partners(plan, where.index[0])
        if pairs is not None:
            index[pairs[0]], index[pairs[1]] = pairs[1], pairs[0]
        return index, np.ones(len(plan))

    def reversible(self, plan: Plan, where: Where) -> bool:
        """Whether every reading has its partner."""
        return partners(plan, where.index[0]) is not None

    def reread(self, plan: Plan, where: Where) -> Plan:
        """The leg's two directions exchanged."""
        own = plan.leg == where.index[0]
        total = np.unique(plan.direction[own]).sum()
        return replace(plan, direction=np.where(own, total - plan.direction, plan.direction))


def partners(plan: Plan, leg: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Readings of the leg's two directions, paired in time; None if they do not pair up."""
    directions = np.unique(plan.direction[plan.leg == leg])
    if directions.size != 2:
        return None
    first, second = (
        plan.in_time[(plan.leg[plan.in_time] == leg) & (plan.direction[plan.in_time] == k)]
        for k in directions
    )
    if first.size != second.size or np.any(plan.displacement[first] != plan.displacement[second]):
        return None
    return first, second


CAUSE = SwappedGauges()
