"""Compensation table: what to add to the nominal joint values so that the tool gets there.

For an extended geometry (accepted causes in the machine file) no set of three offsets puts the
tool right everywhere. At each point p of a grid

    correction = ρ* − ρ_nominal(p),   ρ*: indicated joints that really put the tool at p

with the offsets entered in the controller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, machine_effects
from orthoglide_cal.errors import UsageError
from orthoglide_cal.kinematics import inverse
from orthoglide_cal.machine import Machine
from orthoglide_cal.outcome.workspace import reachable_cube, required_joints

POINTS = 7  # along each edge of the cube by default
MOST_POINTS = 51


@dataclass(frozen=True, eq=False)
class Compensation:
    """Joint corrections over the workspace.

    Attributes:
        causes: ids that are compensated.
        left_out: ids of accepted causes that no table can compensate.
        points_mm: tool positions, shape (n, 3).
        corrections_mm: to be added to the nominal joint values, shape (n, 3).
    """

    causes: tuple[str, ...]
    left_out: tuple[str, ...]
    points_mm: Floats
    corrections_mm: Floats


def compensation(machine: Machine, points: int = POINTS) -> Compensation:
    """The table for the causes accepted in the machine file.

    Args:
        points: grid points along each edge of the cube inside the joint limits.

    Raises:
        UsageError: no accepted cause can be compensated, or the grid has a useless size.
    """
    if not 2 <= points <= MOST_POINTS:
        raise UsageError(
            f"A table has 2 to {MOST_POINTS} points along each edge, not {points}.",
            "Choose --points 7.",
        )
    found = [cause.id for cause in machine.identified]
    chosen = tuple(name for name in found if CAUSES[name].compensable)
    if not chosen:
        raise UsageError(
            "The machine file holds no accepted cause that a table could compensate.",
            "Accept one first: orthocal diagnose FILE --accept CAUSE",
        )
    effects = [effect for effect in machine_effects(machine) if effect.cause.id in chosen]
    axis = np.linspace(*reachable_cube(machine), points)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    grid = np.stack((x, y, z), axis=-1).reshape(-1, 3)
    corrections = required_joints(machine, grid, effects) - inverse(grid, machine.leg_length_mm)
    return Compensation(
        causes=chosen,
        left_out=tuple(name for name in found if name not in chosen),
        points_mm=grid,
        corrections_mm=corrections,
    )
