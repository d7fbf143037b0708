"""A real machine: its rails as they are, and where its carriages stand on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from orthoglide_cal.model.kinematics import Geometry
from orthoglide_cal.model.plan import Floats, Ints, Numbers, read_only


@dataclass(frozen=True, eq=False)
class Command:
    """Where the controller sends the carriages, for n readings or positions."""

    joints: Floats  # indicated joint positions ρ, shape (n, 3) [mm]
    home: float  # joint position from which travel counts [mm]
    hours: Floats  # since the session began, shape (n,) [h]
    # Indices from first to last of those that follow each other, shape (m,); None for carriages
    # without a past.
    in_time: Ints | None
    entered: Floats  # offsets entered in the controller since the first of them, (n, 3) [mm]
    along: Floats | None = None  # joints between which they travelled, (n, 3) [mm]; None for `sent`

    @classmethod
    def standing(cls, joints: Floats, home: float) -> Command:
        """Carriages that stand at `joints` (n, 3) [mm], without a past and at time zero."""
        nothing = read_only(np.zeros(joints.shape))
        return cls(read_only(joints), home, nothing[:, 0], None, nothing)

    @cached_property
    def sent(self) -> Floats:
        """Where the joints would indicate to be had nothing been entered, shape (n, 3) [mm]."""
        return read_only(self.joints - self.entered)

    @cached_property
    def approach(self) -> Floats:
        """Sign of each carriage's last motion, shape (n, 3); 0 before its first, or without."""
        if self.in_time is None:
            return read_only(np.zeros_like(self.joints))
        along = self.sent if self.along is None else self.along
        approach, moves = np.zeros_like(self.joints), np.zeros((len(self.in_time), 3))
        moves[1:] = np.sign(np.diff(along[self.in_time], axis=0))
        moments = np.arange(len(moves))[:, None]
        last = np.maximum.accumulate(np.where(moves != 0.0, moments, 0), axis=0)
        approach[self.in_time] = np.take_along_axis(moves, last, axis=0)
        return read_only(approach)


class GaugeResponse(NamedTuple):
    """What n gauges or probes are pushed to, on a machine of any kind.

    Attributes:
        readings: shape (..., n) [mm].
        where: what they touch then, as the kind of machine has it: the place along the leg, from
            carriage joint (0) to tool (1), shape (..., n); or the tool, shape (..., n, 3) [mm].
        jacobian: derivative by the parameters, shape (..., n, p); None where it was not computed.
    """

    readings: Numbers
    where: Numbers
    jacobian: Floats | None


@dataclass(frozen=True, eq=False)
class RealMachine:
    """A machine with its accepted causes, as rails and joints.

    Attributes:
        geometry: rails and legs as they really are.
        motions: what moves the carriages away from where the offsets alone put them, in order:
            (joints (..., n, 3), command) → joints [mm].
        still: True if only rails and legs are wrong: the offsets alone then move the carriages.
    """

    geometry: Geometry
    motions: tuple[Callable[[Numbers, Command], Numbers], ...]
    still: bool

    def joints(self, command: Command, offsets: Numbers) -> Numbers:
        """Where the carriages really stand, shape (..., n, 3) [mm].

        Args:
            command: where the controller sends them.
            offsets: Δρ, shape (..., 3) [mm]; true joint position = indicated + Δρ − entered.
        """
        joints: Numbers = command.sent + offsets[..., None, :]
        for motion in self.motions:
            joints = motion(joints, command)
        return joints
