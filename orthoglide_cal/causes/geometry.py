"""Faults of the places of rails and legs."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.linear_delta import TOWERS, LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Cause, Screw
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Floats, Numbers
from orthoglide_cal.model.readings import AXES

# Shift of rail i in direction j per unit of gap: rails x and y are g_xy apart along z, y and z
# are g_yz apart along x, z and x are g_zx apart along y. Each rail of a pair takes half of it: this
# fixes the origin of the frame, for moving the whole machine changes no reading.
_SHIFT = np.zeros((3, 3, 3))
# Lean of rail i towards axis j per unit of angle; half of it each fixes the frame's orientation.
_LEAN = np.zeros((3, 3, 3))
for _k, (_first, _second) in enumerate(((0, 1), (1, 2), (2, 0))):
    _along = 3 - _first - _second
    _SHIFT[_k, (_first, _second), _along] = 0.5, -0.5
    _LEAN[_k, (_first, _second), (_second, _first)] = 0.5
_SHIFT.setflags(write=False)
_LEAN.setflags(write=False)


def _unit(vectors: Numbers) -> Numbers:
    """The same directions, of length 1, (..., 3)."""
    return np.asarray(vectors / np.sqrt((vectors**2).sum(axis=-1, keepdims=True)))


class AxisGap(Cause):
    """Distances between pairs of axes; rail x lies above rail y where g_xy > 0, and so on."""

    id = "axis_gap"
    unit = "mm"
    # Usual assembly leaves ±0.5 mm, as for the joint offsets (sec. 2.2).
    sizes = MappingProxyType({Orthoglide: 0.5})
    names = ("xy", "yz", "zx")
    lasting = True
    compensable = True

    def adjustment(self, name: str) -> Screw:
        """Rail x lies g_xy above rail y, along z: rail y rises by that, and so on."""
        rail, along = f"rail {name[1].upper()}", next(axis for axis in AXES if axis not in name)
        return Screw(AXES.index(name[1]), f"both feet of {rail}", rail, along=along)

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Move the rails apart; theta (..., 3) [mm]."""
        return replace(geometry, points=geometry.points + np.tensordot(theta, _SHIFT, axes=1))


class AxisSquareness(Cause):
    """Angles by which those between pairs of axes fall short of 90°; the axes still meet."""

    id = "axis_squareness"
    unit = "mrad"
    sizes = MappingProxyType({Orthoglide: 1.0})  # 0.2 mm over a 200 mm square, the same alignment
    scale = 1e-3
    names = ("xy", "yz", "zx")
    lasting = True
    compensable = True

    def adjustment(self, name: str) -> Screw:
        """The second rail of a pair is turned."""
        feet = f"both feet of rail {name[1].upper()}: it turns about the point where the axes meet"
        return Screw(AXES.index(name[1]), feet, "its outer end")

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lean the rails towards each other; theta (..., 3) [rad]."""
        leaning = geometry.directions + np.tensordot(theta, _LEAN, axes=1)
        return replace(geometry, directions=_unit(leaning))


class LegLength(Cause):
    """Excess of each leg over L; the indicated isotropic joint value stays the nominal L.

    A longer leg looks almost exactly like a smaller offset of its carriage.
    """

    id = "leg_length"
    unit = "mm"
    # The paper states ±0.01 mm for machined links and joints.
    sizes = MappingProxyType({Orthoglide: 0.01, LinearDelta: 0.3})
    names = ("x", "y", "z")
    lasting = True
    compensable = True
    number = MappingProxyType({Orthoglide: "leg_length_mm", LinearDelta: "arm_length_mm"})

    def transferred(self, theta: Floats, before: Machine, after: Machine) -> Floats:
        """Excess over the other lengths."""
        stored = before.nominal_rails.lengths - after.nominal_rails.lengths
        return np.asarray(theta + stored)

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lengthen the legs; theta (..., 3) [mm]."""
        return replace(geometry, lengths=geometry.lengths + theta)


MIDDLE = np.zeros(3)  # of the bed, where the tool is put


def _outwards(geometry: Geometry) -> Numbers:
    """Level unit vectors from the middle to each tower at its carriage's height, (..., 3, 3): there
    a lean moves nothing."""
    carriages = geometry.points + geometry.joints_for(MIDDLE)[..., None] * geometry.directions
    return _unit(carriages * [1.0, 1.0, 0.0])


class TowerLean(Cause):
    """Leans of the rails: away from the middle, then in the sense of growing angles.

    A rail leans about the place of its carriage with the tool in the middle of the bed.
    """

    id = "tower_lean"
    unit = "mrad"
    # 1 mm over a frame of 500 mm, put together with a square.
    sizes = MappingProxyType({LinearDelta: 2.0})
    scale = 1e-3
    names = ("a_out", "b_out", "c_out", "a_side", "b_side", "c_side")
    lasting = True

    def adjustment(self, name: str) -> Screw:
        """The top of one tower is pushed; touches show by how much if its foot stays."""
        tower, way = name.split("_")
        sideways = "counter-clockwise", "clockwise"
        return Screw(
            leg=TOWERS.index(tower),
            loosen=f"the upper corner of tower {tower.upper()}; its foot stays bolted.\n"
            "Ways are seen from above; 0.1 mm per 100 mm of the tower's height is 1 mrad",
            move="its top",
            homed=True,
            ways=("outwards", "inwards") if way == "out" else sideways,
            about_foot=True,
        )

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lean the rails; theta (..., 6) [rad]."""
        out = _outwards(geometry)
        side = np.cross([0.0, 0.0, 1.0], out)
        lean = theta[..., :3, None] * out + theta[..., 3:, None] * side
        directions = _unit(geometry.directions + lean)
        height = geometry.joints_for(MIDDLE)[..., None]
        moved = geometry.points - height * (directions - geometry.directions)
        return Geometry(moved, directions, geometry.lengths)


class TowerRadius(Cause):
    """Excess of each tower's distance from the middle over the delta radius."""

    id = "tower_radius"
    unit = "mm"
    sizes = MappingProxyType({LinearDelta: 0.3})  # printed or moulded corners, bolted by hand
    names = ("a", "b", "c")
    lasting = True
    number = MappingProxyType({LinearDelta: "delta_radius_mm"})

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Move the towers outwards; theta (..., 3) [mm]."""
        shift = theta[..., :, None] * _outwards(geometry)
        return replace(geometry, points=geometry.points + shift)


CAUSES = (AxisGap(), AxisSquareness(), LegLength(), TowerLean(), TowerRadius())
