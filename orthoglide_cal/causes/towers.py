"""What can be wrong with where the towers of a linear delta stand."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.cause import Cause, Stage
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.plan import Numbers

MIDDLE = np.zeros(3)  # of the bed, where the tool is put


def _outwards(geometry: Geometry) -> Numbers:
    """Unit vectors from the middle to each tower, (..., 3, 3), level, at its carriage's height.

    There a lean moves nothing, so that a radius found together with it goes the same way.
    """
    carriages = geometry.carriages(geometry.joints_for(MIDDLE))
    away = carriages * [1.0, 1.0, 0.0]
    return np.asarray(away / np.sqrt((away**2).sum(axis=-1, keepdims=True)))


class TowerLean(Cause):
    """Leans of the rails: away from the middle, then in the sense of growing angles.

    A rail leans about the height at which its carriage stands with the tool in the middle of the
    bed: farther down or up it is a lean, there it is nothing.
    """

    id = "tower_lean"
    title = "a tower leans"
    stage = Stage.GEOMETRY
    unit = "mrad"
    sizes = MappingProxyType({LinearDelta: 2.0})
    size_reason = "1 mm over a frame of 500 mm, put together with a square"
    scale = 1e-3
    names = ("a_out", "b_out", "c_out", "a_side", "b_side", "c_side")
    lasting = True
    instrument = "a rule between the rails, at the bottom and at the top"
    advice = (
        "Square the frame: measure the distances between the rails at the bottom and at the top,"
        " and shim or loosen and re-tighten the corners. No firmware has a setting for it."
    )

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lean the rails; theta (..., 6) [rad]."""
        out = _outwards(geometry)
        up = np.array([0.0, 0.0, 1.0])
        side = np.cross(up, out)
        lean = theta[..., :3, None] * out + theta[..., 3:, None] * side
        leaning = geometry.directions + lean
        directions = leaning / np.sqrt((leaning**2).sum(axis=-1, keepdims=True))
        height = geometry.joints_for(MIDDLE)[..., None]
        moved = geometry.points - height * (directions - geometry.directions)
        return Geometry(moved, directions, geometry.lengths)


class TowerRadius(Cause):
    """Excess of each tower's distance from the middle over the delta radius."""

    id = "tower_radius"
    title = "the towers are not equally far from the middle"
    stage = Stage.GEOMETRY
    unit = "mm"
    sizes = MappingProxyType({LinearDelta: 0.3})
    size_reason = "printed or moulded corners, bolted by hand"
    names = ("a", "b", "c")
    lasting = True
    instrument = "a rule from the middle of the bed to each rail"
    number = MappingProxyType({LinearDelta: "delta_radius_mm"})
    advice = (
        "Measure the corners of the frame; where the firmware has a radius for each tower, enter"
        " them there."
    )

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Move the towers outwards; theta (..., 3) [mm]."""
        shift = theta[..., :, None] * _outwards(geometry)
        return Geometry(geometry.points + shift, geometry.directions, geometry.lengths)


CAUSES = (TowerLean(), TowerRadius())
