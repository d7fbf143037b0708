"""The legs differ from their nominal length."""

from __future__ import annotations

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step
from orthoglide_cal.kinematics import Geometry


class LegLength(Cause):
    """Excess of each leg over L; the indicated isotropic joint value stays the nominal L.

    A longer leg looks almost exactly like a smaller offset of its carriage.
    """

    id = "leg_length"
    title = "the legs differ from the nominal length"
    step = Step.GEOMETRY
    unit = "mm"
    names = ("x", "y", "z")
    lasting = True
    compensable = True
    advice = "Measure the legs between their joint centres and enter the mean in the machine file."

    def geometry(self, geometry: Geometry, theta: Numbers) -> Geometry:
        """Lengthen the legs; theta (..., 3) [mm]."""
        return Geometry(geometry.points, geometry.directions, geometry.lengths + theta)


CAUSE = LegLength()
