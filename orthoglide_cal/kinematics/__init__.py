"""Kinematics: the nominal Orthoglide (eqs. 1–9) and three rails in general position."""

from orthoglide_cal.kinematics.direct import direct
from orthoglide_cal.kinematics.inverse import WORKING_MODES, inverse
from orthoglide_cal.kinematics.jacobian import (
    displaced_jacobian,
    inverse_jacobian,
    isotropic_jacobian,
    jacobian,
    leg_angle,
)
from orthoglide_cal.kinematics.rails import (
    Geometry,
    rail_position,
    tool_derivative,
    trilaterate,
)

__all__ = [
    "WORKING_MODES",
    "Geometry",
    "direct",
    "displaced_jacobian",
    "inverse",
    "inverse_jacobian",
    "isotropic_jacobian",
    "jacobian",
    "leg_angle",
    "rail_position",
    "tool_derivative",
    "trilaterate",
]
