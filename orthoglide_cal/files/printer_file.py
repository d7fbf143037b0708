"""What files of a printer's firmware, whichever it is, say of a linear delta."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import FileText
from orthoglide_cal.model.linear_delta import Endstops, LinearDelta, Probe, ProbePlan, touching
from orthoglide_cal.model.measured import Source
from orthoglide_cal.model.plan import Floats, Ints, ReadOnly
from orthoglide_cal.schema import parse_number

# Where the towers a, b, c of all firmwares stand before any correction, counter-clockwise from x.
USUAL_ANGLES_DEG = (210.0, 330.0, 90.0)
# What no firmware states: a probe repeats within a hundredth.
REPEATABILITY_MM = 0.012
ZERO_UNKNOWN = (
    "it cannot show the common height of the three endstops. Set the height of the nozzle again"
    " after entering them."
)
LARGEST_MM = 10_000.0


@dataclass(frozen=True)
class Stored(ReadOnly):
    """Touches, and distances on a printed object, that a file stores; n readings."""

    plan: ProbePlan  # with the places where the controller believes the nozzle to be
    value: Floats  # as of `Readings`, shape (n,) [mm]; NaN where no arms reach
    line: Ints  # in the file, shape (n,)
    mesh: str | None = None  # its name; None for heights stored with positions of the carriages
    remarks: tuple[str, ...] = ()  # what to know about it

    @classmethod
    def of_touches(cls, mesh: str, touches: Floats, trigger: float) -> Stored:
        """From line, x, y and height of each, in the order of time, shape (n, 4).

        Heights are those of the nozzle over where it is when the probe triggers, `trigger` [mm].
        """
        line, x, y, height = touches.T
        place = np.column_stack((x, y, height + trigger))
        plan = touching(place, np.full(len(line), trigger), np.arange(len(line)))
        return cls(plan, height, line.astype(int), mesh)

    @classmethod
    def of_grid(
        cls, mesh: str, x: Floats, y: Floats, height: Floats, line: Sequence[int], offset: Floats
    ) -> Stored:
        """From rows of heights, shape (m, n) [mm]; NaN where nothing was probed.

        The first row was probed in the direction of +x, the second of -x, and so on.

        Args:
            x, y: places of the probe, shapes (n,) and (m,) [mm].
            height, line: of each row.
            offset: of the probe from the nozzle, shape (3,) [mm].
        """
        probed = np.isfinite(height)
        turn = np.arange(probed.size).reshape(probed.shape)
        turn[1::2] = turn[1::2, ::-1].copy()
        at, along = (place[probed] for place in np.meshgrid(x, y))
        order = np.argsort(np.argsort(turn[probed]))
        lines = np.repeat(line, len(x)).reshape(probed.shape)[probed]
        place = np.column_stack((at - offset[0], along - offset[1], height[probed] + offset[2]))
        plan = touching(place, np.full(len(place), offset[2]), order)
        return cls(plan, height[probed], lines, mesh)


@dataclass(frozen=True)
class PrinterFile(ReadOnly):
    """What files of a firmware state and store of a linear delta."""

    machine: LinearDelta  # with the parameters in force, and what is usual else
    # What is added to the nozzle's place to have the probe's, shape (3,) [mm]; x, y, and the
    # nozzle's height when the probe triggers. NaN where it is not known.
    probe: Floats
    source: Source
    heights: Stored | None = None  # with the distances behind them; None where nothing is stored
    mesh: Stored | None = None
    remarks: tuple[str, ...] = ()  # what to know about it, but for its mesh
    firmware: str = "klipper"  # as an export names it


def delta_of(
    document: FileText,
    arms: Floats,
    radius: float,
    angles: Floats,
    endstops: Floats,
    bed: float,
    scanning: bool = False,
) -> LinearDelta:
    """A machine with these parameters in force, [mm, deg]; arrays are of shape (3,).

    It has the name of its file; what a file says is checked by whoever reads it.
    """
    return LinearDelta.model_construct(
        name=PurePath(document.path).name,
        arm_length_mm=tuple(arms.tolist()),
        delta_radius_mm=radius,
        tower_angles_deg=tuple(angles.tolist()),
        endstops_mm=Endstops(*endstops.tolist()),
        bed_radius_mm=bed,
        probe=Probe(resolution_mm=0.0, repeatability_mm=REPEATABILITY_MM, scanning=scanning),
    )


def within(text: str, low: float, high: float = LARGEST_MM) -> float:
    """The number that a text writes, between the two. Raises InputError without a place."""
    value = parse_number(text)
    if not low < value < high:
        raise InputError(f"The number is outside {low:g} … {high:g}.", "Check it.", value=text)
    return value
