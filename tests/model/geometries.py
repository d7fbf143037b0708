"""Rails and legs given directly, plans of every kind of reading, points of the workspace."""

from dataclasses import replace

import numpy as np

from orthoglide_cal.model.cause import Cause, Stage
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture
from orthoglide_cal.model.plan import Floats, Numbers
from orthoglide_cal.model.readings import Contact, GaugePlan


class GivenRails(Cause):
    """Rails and legs as they are given, whatever the nominal ones are."""

    id = "given_rails"
    title = "rails and legs are as given"
    stage = Stage.GEOMETRY
    lasting = True

    def __init__(self, rails: Geometry) -> None:
        self.rails = rails

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        return self.rails


def on_rails(machine: Machine, rails: Geometry) -> Model:
    """The machine with these rails and legs."""
    return Model(machine, (GivenRails(rails).at(np.zeros(0)),))


def bent_rails(machine: Machine) -> Geometry:
    """Rails that neither meet nor are orthogonal, unequal legs: degrees and millimetres."""
    rng = np.random.default_rng(8)
    directions = np.eye(3) + rng.normal(0.0, 0.05, (3, 3))
    return Geometry(
        points=rng.normal(0.0, 5.0, (3, 3)),
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        lengths=machine.leg_length_mm + rng.normal(0.0, 3.0, 3),
    )


def tool_positions(machine: Machine, count: int = 400) -> Floats:
    """Random points of the workspace, shape (count, 3) [mm]."""
    return np.random.default_rng(3).uniform(*machine.joint_limits_mm, (count, 3))


def mixed_plan(machine: Machine) -> GaugePlan:
    """Gauges at a different place for every reading, a third of them at the ends of the legs."""
    plan = double_posture(machine, cycles=2)
    n, rng = len(plan), np.random.default_rng(11)
    contact = rng.choice([Contact.FIXED] * 4 + [Contact.JOINT, Contact.TOOL], n)
    return replace(plan, gauge_at=rng.uniform(0.1, 0.9, n), contact=contact)
