"""The three actuator axes do not meet in one point: they pass each other at three distances."""

from __future__ import annotations

import numpy as np

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step
from orthoglide_cal.kinematics import Geometry

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
    step = Step.GEOMETRY
    unit = "mm"
    names = ("xy", "yz", "zx")
    lasting = True
    compensable = True
    advice = (
        "Shim the linear drives until their axes meet in one point, or accept the gap as part of"
        " the model and compensate it in the controller."
    )

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Move the rails apart; theta (..., 3) [mm]."""
        shift = np.tensordot(theta, _SHIFT, axes=1)
        return Geometry(geometry.points + shift, geometry.directions, geometry.lengths)


CAUSE = AxisGap()
