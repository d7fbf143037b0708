"""Measuring protocols: which leg, posture and direction, in which order, and the differences."""

from orthoglide_cal.protocols.differences import (
    NAMES,
    SINGLE,
    SIX,
    TWELVE,
    cell_contrasts,
    ideal_plan,
    reduction,
    without_zeros,
    zero_free,
)
from orthoglide_cal.protocols.double_posture import double_posture
from orthoglide_cal.protocols.postures import other_axes
from orthoglide_cal.protocols.single_posture import single_posture
from orthoglide_cal.protocols.synthetic import synthetic_session, written_down

__all__ = [
    "NAMES",
    "SINGLE",
    "SIX",
    "TWELVE",
    "cell_contrasts",
    "double_posture",
    "ideal_plan",
    "other_axes",
    "reduction",
    "single_posture",
    "synthetic_session",
    "without_zeros",
    "written_down",
    "zero_free",
]
