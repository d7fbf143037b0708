"""What can be wrong with where the rails and legs are."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.cause import Cause, Stage
from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.plan import Floats, Numbers

# Shift of rail i in direction j per unit of gap: rails x and y are g_xy apart along z, y and z
# are g_yz apart along x, z and x are g_zx apart along y, half of it each. This symmetry fixes
# the origin of the frame: moving the whole machine changes no reading.
_SHIFT = np.zeros((3, 3, 3))
for _k, (_first, _second) in enumerate(((0, 1), (1, 2), (2, 0))):
    _along = 3 - _first - _second
    _SHIFT[_k, _first, _along] = 0.5
    _SHIFT[_k, _second, _along] = -0.5
_SHIFT.setflags(write=False)


class AxisGap(Cause):
    """Distances between pairs of axes; rail x lies above rail y where g_xy > 0, and so on."""

    id = "axis_gap"
    title = "the actuator axes do not meet in one point"
    stage = Stage.GEOMETRY
    unit = "mm"
    sizes = MappingProxyType({Orthoglide: 0.5})
    size_reason = "usual assembly leaves ±0.5 mm, as for the joint offsets (sec. 2.2)"
    names = ("xy", "yz", "zx")
    lasting = True
    compensable = True
    instrument = "a dial indicator carried along one rail, run against the next"
    advice = "Shim the rails until their axes meet in one point, then measure again."

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Move the rails apart; theta (..., 3) [mm]."""
        shift = np.tensordot(theta, _SHIFT, axes=1)
        return Geometry(geometry.points + shift, geometry.directions, geometry.lengths)


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
    stage = Stage.GEOMETRY
    unit = "mrad"
    sizes = MappingProxyType({Orthoglide: 1.0})
    size_reason = "0.2 mm over a 200 mm square, the same alignment"
    scale = 1e-3
    names = ("xy", "yz", "zx")
    lasting = True
    compensable = True
    instrument = "a master square with a dial indicator"
    advice = (
        "Check the squareness of the linear drives with a master square and re-align them, or"
        " accept the angles as part of the model and compensate them in the controller."
    )

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lean the rails towards each other; theta (..., 3) [rad]."""
        leaning = geometry.directions + np.tensordot(theta, _LEAN, axes=1)
        size = np.sqrt((leaning**2).sum(axis=-1, keepdims=True))
        return Geometry(geometry.points, leaning / size, geometry.lengths)


class LegLength(Cause):
    """Excess of each leg over L; the indicated isotropic joint value stays the nominal L.

    A longer leg looks almost exactly like a smaller offset of its carriage.
    """

    id = "leg_length"
    title = "the legs differ from the nominal length"
    stage = Stage.GEOMETRY
    unit = "mm"
    sizes = MappingProxyType({Orthoglide: 0.01, LinearDelta: 0.3})
    size_reason = "the paper states ±0.01 mm for machined links and joints"
    names = ("x", "y", "z")
    lasting = True
    compensable = True
    instrument = "a calliper on each leg, from joint centre to joint centre"
    number = MappingProxyType({Orthoglide: "leg_length_mm", LinearDelta: "arm_length_mm"})
    advice = "Measure the legs between their joint centres and enter the mean in the machine file."
    elsewhere = MappingProxyType(
        {
            LinearDelta: {
                "title": "the arms differ from the nominal length",
                "instrument": "a calliper on each arm, from joint centre to joint centre",
                "advice": "Measure the arms between their joint centres and enter each in"
                " printer.cfg (arm_length), or in your firmware and the machine file; then"
                " calibrate and probe again.",
            }
        }
    )

    def transferred(self, theta: Floats, before: Machine, after: Machine) -> Floats:
        """What was in excess of other lengths."""
        stored = before.nominal_rails.lengths - after.nominal_rails.lengths
        return np.asarray(theta + stored)

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lengthen the legs; theta (..., 3) [mm]."""
        return Geometry(geometry.points, geometry.directions, geometry.lengths + theta)


CAUSES = (AxisGap(), AxisSquareness(), LegLength())
