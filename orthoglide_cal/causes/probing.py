"""What can be wrong with the bed of a linear delta, and with the probe that touches it."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.cause import Cause, Effect, Stage
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.plan import Numbers, Plan
from orthoglide_cal.model.probe_plan import ProbePlan


class _Surface(Cause):
    """What rises and falls smoothly over the bed; one unit of each term at its edge.

    A term's name is its formula: "xxy" is x²y.
    """

    stage = Stage.CONTACT
    unit = "mm"
    lasting = True

    def contact(
        self, heights: Numbers, effect: Effect, where: Numbers, plan: Plan, machine: Machine
    ) -> Numbers:
        """Reading of a touch += height of the surface; theta (..., terms) [mm at the edge]."""
        x, y, _ = np.moveaxis(where / LinearDelta.require(machine).bed_radius_mm, -1, 0)
        terms = (
            effect.theta[..., k, None] * x ** name.count("x") * y ** name.count("y")
            for k, name in enumerate(self.names)
        )
        return np.asarray(heights + ~ProbePlan.require(plan).distance * sum(terms))


class BedShape(_Surface):
    """A smooth surface, of second and third degree; tilt and height are the endstops'."""

    id = "bed_shape"
    title = "the bed is not flat"
    sizes = MappingProxyType({LinearDelta: 0.1})
    size_reason = "glass and spring steel on a printed frame bend by a tenth towards the edge"
    names = ("xx", "xy", "yy", "xxx", "xxy", "xyy", "yyy")
    instrument = "a straight edge and feeler gauges on the bed"
    advice = (
        "Lay a straight edge on the bed, or turn the plate by a third and probe again: what turns"
        " with it is its own shape. A bed mesh follows it; it is no error of the machine's motion."
    )


class ProbeTilt(_Surface):
    """The effector tilts as it moves, and a probe beside the nozzle rises or falls with it."""

    id = "probe_tilt"
    title = "the probe tilts with the effector"
    sizes = MappingProxyType({LinearDelta: 0.05})
    size_reason = "arms of a pair that differ by 0.1 mm, a probe 20 mm from the nozzle"
    names = ("xx", "xy", "yy")
    instrument = "the same touches with the nozzle itself"
    advice = (
        "Probe with the nozzle itself, or turn the probe to the other side of the effector and"
        " probe again: what changes sign is its tilt. Compare the two arms of each pair."
    )


class ProbeDrift(Cause):
    """The height at which the probe triggers drifts while it warms up or cools."""

    id = "probe_drift"
    title = "the probe drifts"
    stage = Stage.CONTACT
    unit = "mm/h"
    sizes = MappingProxyType({LinearDelta: 0.05})
    size_reason = "an inductive probe or its mount cooling by some degrees"
    names = ("rate",)
    timed = True
    same_remedy_as = "thermal_drift"
    instrument = "the same touch again after ten minutes"
    advice = "Let bed and probe reach their temperature, wait ten minutes, and probe again."

    def contact(
        self, heights: Numbers, effect: Effect, where: Numbers, plan: Plan, machine: Machine
    ) -> Numbers:
        """Reading += rate · hours; theta (..., 1) [mm/h]."""
        return heights + ~ProbePlan.require(plan).distance * effect.theta * plan.hours


CAUSES = (BedShape(), ProbeTilt(), ProbeDrift())
