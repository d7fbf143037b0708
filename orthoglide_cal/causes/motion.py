"""Faults of the motion of the carriages."""

from types import MappingProxyType

import numpy as np

from orthoglide_cal.model.kinematics import Command
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.model import Cause, Screw
from orthoglide_cal.model.orthoglide import OFFSET_MM, Orthoglide
from orthoglide_cal.model.plan import Floats, Numbers
from orthoglide_cal.model.readings import AXES


class EncoderScale(Cause):
    """Excess of the true over the indicated travel, counted from the isotropic posture."""

    id = "encoder_scale"
    unit = "1e-3"
    # Belt or screw lead error, or a scale entered with few digits.
    sizes = MappingProxyType({Orthoglide: 1.0, LinearDelta: 1.0})
    by_joint = with_travel = True
    scale = 1e-3
    names = ("x", "y", "z")
    lasting = True
    compensable = True

    def motion(self, joints: Numbers, theta: Numbers, command: Command) -> Numbers:
        """q = L + (1 + k)(ρ − L) + Δρ; theta (..., 3)."""
        return joints + theta[..., None, :] * (command.joints - command.home)

    def correction(self, theta: Numbers, joints: Floats, home: float) -> Floats:
        """ρ − q = −k/(1 + k) · (q − L), however it moves."""
        added = -theta / (1.0 + theta) * (joints[:, None] - home)
        return np.stack([added, added])


class Backlash(Cause):
    """Full width of the lost motion of each carriage; it stands half of it behind its motion.

    Before its first motion in the session a carriage stands anywhere within the lost motion:
    the three nuisance parameters.
    """

    id = "backlash"
    unit = "mm"
    # A worn but serviceable screw and nut.
    sizes = MappingProxyType({Orthoglide: 0.02, LinearDelta: 0.05})
    by_joint = True
    names = ("x", "y", "z")
    nuisance = (0.3, 0.3, 0.3)
    positive = True
    lasting = True
    timed = True
    settles = True

    def motion(self, joints: Numbers, theta: Numbers, command: Command) -> Numbers:
        """q −= w/2 · sign of the last motion; theta (..., 6) [mm]: widths, first positions."""
        approach = command.approach
        lag = -0.5 * theta[..., None, :3] * approach
        start = theta[..., None, 3:] * np.asarray(approach == 0.0, dtype=np.float64)
        return np.asarray(joints + lag + start)

    def correction(self, theta: Numbers, joints: Floats, home: float) -> Floats:
        """ρ − q = w/2 · sign of the motion."""
        half = np.tile(0.5 * theta[:3], (len(joints), 1))
        return np.stack([half, -half])


class ThermalDrift(Cause):
    """Rate of each actuator zero; the offsets are those at the first reading."""

    id = "thermal_drift"
    unit = "mm/h"
    # 300 mm of steel and aluminium warming by a few degrees an hour.
    sizes = MappingProxyType({Orthoglide: 0.05, LinearDelta: 0.05})
    names = ("x", "y", "z")
    lasting = True
    timed = True

    def motion(self, joints: Numbers, theta: Numbers, command: Command) -> Numbers:
        """q += r·t; theta (..., 3) [mm/h]."""
        return joints + theta[..., None, :] * command.hours[:, None]


class HomeSwitch(Cause):
    """Joint offsets, as switches that stand at the wrong place: for `adjust`, never suspected."""

    id = "home_switch"
    unit = "mm"
    sizes = MappingProxyType({Orthoglide: OFFSET_MM})  # a printer's endstops are numbers
    names = ("x", "y", "z")
    lasting = True

    def adjustment(self, name: str) -> Screw:
        """The tool follows a carriage: it is read on the bar of the next leg."""
        leg, switch = (AXES.index(name) + 1) % 3, f"the home switch of axis {name.upper()}"
        return Screw(leg, switch, "the switch", homed=True)

    def motion(self, joints: Numbers, theta: Numbers, command: Command) -> Numbers:
        """q += Δρ; theta (..., 3) [mm]."""
        return joints + theta[..., None, :]


HOME_SWITCH = HomeSwitch()
CAUSES = (EncoderScale(), Backlash(), ThermalDrift())
