"""The actuator axes are not mutually orthogonal."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step
from orthoglide_cal.kinematics import Geometry

# Lean of rail i towards axis j per unit of angle: each rail of a pair takes half of it. This
# symmetry fixes the orientation of the frame: turning the whole machine changes no reading.
_LEAN = np.zeros((3, 3, 3))
for _k, (_first, _second) in enumerate(((0, 1), (1, 2), (2, 0))):
    _LEAN[_k, _first, _second] = _LEAN[_k, _second, _first] = 0.5
_LEAN.setflags(write=False)


class AxisSquareness(Cause):
    """How far the angles between pairs of axes fall short of 90°; the axes still meet."""

    id = "axis_squareness"
    title = "the actuator axes are not square to each other"
    step = Step.GEOMETRY
    unit = "mrad"
    scale = 1e-3
    names = ("xy", "yz", "zx")
    lasting = True
    compensable = True
    advice = (
        "Check the squareness of the linear drives with a master square and re-align them, or"
        " accept the angles as part of the model and compensate them in the controller."
    )

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lean the rails towards each other; theta (..., 3) [rad]."""
        leaning = geometry.directions + np.tensordot(theta, _LEAN, axes=1)
        size = np.sqrt((leaning**2).sum(axis=-1, keepdims=True))
        return Geometry(geometry.points, leaning / size, geometry.lengths)


CAUSE = AxisSquareness()
