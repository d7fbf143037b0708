"""What may be wrong with a reading, as the forward model sees it, and when it is taken.

An effect changes exactly one of the four steps in which a reading is made: geometry, motion,
contact, record.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.axes import AXES, Floats, Numbers, read_only
from orthoglide_cal.errors import UnreachableError
from orthoglide_cal.kinematics.rails import Geometry
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Plan


@dataclass(frozen=True, eq=False)
class Commanded:
    """A plan on a machine: where the controller sends the carriages for each reading."""

    machine: Machine
    plan: Plan

    @cached_property
    def joints(self) -> Floats:
        """Indicated joint positions ρ at each reading, shape (n, 3) [mm].

        Leg i displaced by d: ρ_i = L + d and ρ_j = √(L² − d²) (sec. 2.5).

        Raises:
            UnreachableError: a displacement is not shorter than the legs.
        """
        length, moved = self.machine.leg_length_mm, self.plan.displacement
        if np.any(np.abs(moved) >= length):
            worst = int(np.argmax(np.abs(moved)))
            raise UnreachableError(
                f"Leg {AXES[self.plan.leg[worst]]} cannot be displaced by {moved[worst]:g} mm:"
                f" the legs are {length:g} mm long.",
                "Use a posture inside the joint limits.",
            )
        joints = np.repeat(np.sqrt(length**2 - moved**2)[:, None], 3, axis=1)
        joints[np.arange(len(self.plan)), self.plan.leg] = length + moved
        return read_only(joints, np.float64)

    @cached_property
    def approach(self) -> Floats:
        """Sign of each carriage's last commanded motion, shape (n, 3); 0 before its first one."""
        order = self.plan.in_time
        moves = np.zeros((len(self.plan), 3))
        moves[1:] = np.sign(np.diff(self.joints[order], axis=0))
        moments = np.arange(len(moves))[:, None]
        last = np.maximum.accumulate(np.where(moves != 0.0, moments, 0), axis=0)
        approach = np.empty_like(moves)
        approach[order] = np.take_along_axis(moves, last, axis=0)
        return read_only(approach, np.float64)


class Effect:
    """Something that the nominal model leaves out; a subclass overrides exactly one step.

    Leading axes of an effect's own parameters broadcast with those of the offsets.
    """

    @property
    def repeats(self) -> bool:
        """Whether readings that differ in nothing but set-up and time are predicted equal."""
        return False

    def geometry(self, geometry: Geometry) -> Geometry:
        """Rails and legs as they really are."""
        return geometry

    def motion(self, joints: Numbers, commanded: Commanded) -> Numbers:
        """True joint positions (..., n, 3) from those that the offsets alone would give [mm]."""
        return joints

    def contact(self, heights: Numbers, fraction: Numbers, commanded: Commanded) -> Numbers:
        """Gauge positions (..., n) [mm]; `fraction` is where on the leg the gauge touches."""
        return heights

    def record(self, readings: Numbers, commanded: Commanded) -> Numbers:
        """What was written down (..., n) [mm]."""
        return readings

    def doubts(self) -> tuple[Effect, ...]:
        """This effect, changed by each of its independent uncertainties once."""
        return ()
