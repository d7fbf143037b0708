"""A carriage moves more or less than the controller indicates."""

from __future__ import annotations

from orthoglide_cal.axes import Numbers
from orthoglide_cal.causes.base import Cause, Step
from orthoglide_cal.effects import Commanded


class EncoderScale(Cause):
    """Excess of the true over the indicated travel, counted from the isotropic posture."""

    id = "encoder_scale"
    title = "a carriage moves more or less than indicated"
    step = Step.MOTION
    unit = "1e-3"
    scale = 1e-3
    names = ("x", "y", "z")
    lasting = True
    compensable = True
    advice = "Check the travel of the carriage against gauge blocks and correct the axis scale."

    def motion(self, joints: Numbers, theta: Numbers, commanded: Commanded) -> Numbers:
        """q = L + (1 + k)(ρ − L) + Δρ; theta (..., 3)."""
        travel = commanded.joints - commanded.machine.leg_length_mm
        return joints + theta[..., None, :] * travel


CAUSE = EncoderScale()
