"""Settings and stored touches in the files of a linear delta's firmware, whichever it is."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Self

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.readings import BEYOND
from orthoglide_cal.files.text import FileText
from orthoglide_cal.files.tree import Content
from orthoglide_cal.model.linear_delta import Endstops, LinearDelta, Probe, touching
from orthoglide_cal.model.measured import Excerpt, Readings, Source
from orthoglide_cal.model.plan import Floats, Ints, ReadOnly
from orthoglide_cal.schema import Reason, parse_number
from orthoglide_cal.words import counted

# Heights are known to tenths: what is farther off was not stored with the settings in force now.
_FAR_MM = 10.0
ARMS = "leg_length"  # how far the real ones can be from those that the firmware has
# Where the towers a, b, c of all firmwares stand before any correction, counter-clockwise from x.
USUAL_ANGLES_DEG = (210.0, 330.0, 90.0)
REPEATABILITY_MM = 0.012  # of a probe; no firmware states it
LARGEST_MM = 10_000.0
_PROBING = {  # firmware → what probes; G29 else
    "klipper": "DELTA_CALIBRATE or BED_MESH_CALIBRATE, and SAVE_CONFIG",
    "marlin": "G33 V0 or G29 V4",
    "text": "G33",
}


def stored_mesh(
    source: Source, touches: Floats, trigger: float, order: Ints | None = None
) -> Readings:
    """A mesh from line, x, y and height of its touches, shape (n, 4); in their order if None.

    Heights are those of the nozzle over where it is when the probe triggers, `trigger` [mm].
    """
    line, x, y, height = touches.T
    plan = touching(np.column_stack((x, y, height + trigger)), np.full(len(line), trigger), order)
    return Readings(plan, height, line.astype(int), False, source)


def heights_in(
    faults: Content,
    rows: Mapping[int, Sequence[str]],
    shape: tuple[int, int],
    again: str,
    unprobed: str | None = None,
    column: str | None = None,
) -> Floats:
    """Heights of a mesh of this shape [mm], NaN where a text is `unprobed`; of line → cells.

    What is wrong is noted, with `again` as the remedy; `column` says where the rows stand.
    """
    heights = np.full((len(rows), shape[1]), math.nan)
    if len(rows) != shape[0]:
        fault = f"The mesh has {len(rows)} rows instead of {shape[0]}."
        faults.add(fault, f"Was it cut off? {again}", max(rows, default=None), column)
    for row, (line, cells) in enumerate(rows.items()):
        if len(cells) != shape[1]:
            fault = f"The row of the mesh has {len(cells)} heights instead of {shape[1]}."
            faults.add(fault, again, line, column, ",".join(cells))
            continue
        for place, cell in enumerate(map(str.strip, cells)):
            with faults.noting(line, column, cell):
                heights[row, place] = math.nan if cell == unprobed else within(cell)
    return heights


def stored_grid(
    source: Source, x: Floats, y: Floats, height: Floats, line: Sequence[int], offset: Floats
) -> Readings:
    """A mesh from rows of heights (m, n), NaN where nothing was probed, at x (n,), y (m,) [mm].

    These are places of the probe, whose offset from the nozzle is of shape (3,) [mm]. The first
    row was probed in the direction of +x, the second of -x, and so on; `line` is of each row.
    """
    probed = np.isfinite(height)
    turn = np.arange(probed.size).reshape(probed.shape)
    turn[1::2] = turn[1::2, ::-1].copy()
    across, along = (place[probed] for place in np.meshgrid(x, y))
    lines = np.repeat(line, len(x)).reshape(probed.shape)[probed]
    touches = np.column_stack((lines, across - offset[0], along - offset[1], height[probed]))
    return stored_mesh(source, touches, offset[2], np.argsort(np.argsort(turn[probed])))


@dataclass(frozen=True)
class PrinterFile(ReadOnly):
    """Settings and data of a linear delta in the files of its firmware."""

    machine: LinearDelta  # with the parameters in force, and what is usual else
    # Where the probe is from the nozzle, x, y, and the nozzle's height when it triggers, shape (3,)
    # [mm]; NaN where it is not known.
    probe: Floats
    source: Source
    # What it stores, the first taken where nobody says: "calibration" (heights, with the distances
    # behind them) and "mesh".
    data: dict[str, Readings] = field(default_factory=dict)
    remarks: tuple[Reason, ...] = ()  # those on its mesh excluded
    firmware: str = "klipper"  # as an export names it
    unknown: str = ""  # why the settings in force are not known, in a sentence
    started: str | None = None  # ISO 8601; None where the file does not say
    steps: str = ""  # that a calibration was reckoned from, as stored

    def on_bed(self, radius: float) -> Self:
        """The machine with a radius of the bed [mm] where its file does not state it."""
        stated = not math.isnan(self.machine.bed_radius_mm)
        return self if stated else replace(self, machine=self.machine.changed(bed_radius_mm=radius))

    def known_as(self, known: LinearDelta, sure: bool) -> tuple[LinearDelta, tuple[Reason, ...]]:
        """A known machine with the parameters in force in its firmware, and a remark on its arms.

        How far the firmware's arms are from the known ones adds to how far they can be from the
        real ones, unless one is sure of these. Raises UsageError: not one machine.
        """
        in_force = (*known.geometry_keys, "bed_radius_mm")
        machine = known.changed(**{key: getattr(self.machine, key) for key in in_force})
        known.check_same(machine)
        arms = np.array((known.arm_length_mm, machine.arm_length_mm))
        apart, size = float(np.abs(np.diff(arms, axis=0)).max()), CAUSES[ARMS].size(known)
        if sure or apart <= size:
            return machine, ()
        stated, used = arms.tolist()
        remark = Reason.of("arms_differ", stated=stated, used=used, apart_mm=apart)
        sizes = {**known.tolerances, ARMS: round(math.hypot(size, apart), 3)}
        return machine.changed(tolerances=sizes), (remark,)

    def readings(self, chosen: str, machine: LinearDelta) -> Readings:
        """Readings that it stores, at places meant by the parameters of a machine: "calibration" or
        "mesh". Raises InputError: it does not store that."""
        if chosen not in self.data:
            fault, run = f"The file stores no {chosen}.", "Leave out --data, or run"
            if not self.data:
                fault, run = "The file stores neither probed heights nor a mesh.", "Run"
            remedy = f"{run} {_PROBING.get(self.firmware, 'G29')}."
            raise InputError(fault, remedy, file=self.source.path)
        readings, mesh = self.data[chosen], chosen == "mesh"
        _check_stored(readings, machine, reckoned=self.firmware == "klipper" and not mesh)
        touches, n = readings.plan.touches, int(readings.plan.touches.sum())
        words = f"{n} points of a mesh" if mesh else counted(n, "height")
        words += f" and {counted(len(touches) - n, 'distance')}" if n < len(touches) else ""
        ratio = machine.probe.noise_mm / machine.probe.calliper_mm
        excerpt = Excerpt(chosen, words, self.firmware, self.unknown, "" if mesh else self.steps)
        return replace(
            readings,
            plan=replace(readings.plan, precision=np.where(touches, 1.0, ratio)),
            source=replace(self.source, excerpt=excerpt),
            remarks=(*self.remarks, *readings.remarks),
        )


def delta_of(document: FileText, bed: float) -> LinearDelta:
    """A machine with the name of its file, and what no firmware states; without a size yet."""
    return LinearDelta.model_construct(
        name=PurePath(document.path).name,
        arm_length_mm=(0.0, 0.0, 0.0),
        delta_radius_mm=0.0,
        tower_angles_deg=USUAL_ANGLES_DEG,
        endstops_mm=Endstops(0.0, 0.0, 0.0),
        bed_radius_mm=bed,
        probe=Probe(resolution_mm=0.0, repeatability_mm=REPEATABILITY_MM),
    )


def within(text: str, low: float = -LARGEST_MM, high: float = LARGEST_MM) -> float:
    """The number that a text writes, between the two. Raises InputError without a place."""
    value = parse_number(text)
    if not low < value < high:
        raise InputError(f"The number is outside {low:g} … {high:g}.", "Check it.", value=text)
    return value


def _check_stored(readings: Readings, machine: LinearDelta, *, reckoned: bool) -> None:
    """Raise InputError for readings that cannot belong to the settings in force; they may be
    `reckoned` from steps by DELTA_CALIBRATE."""
    n, value, away = len(readings), readings.value, np.hypot(*readings.plan.spots.T[:2])
    far = ~(np.abs(value) < _FAR_MM)
    if n > 1 and np.ptp(value) == 0.0 and not reckoned:
        index, remedy = 0, "Probe the bed, and save the mesh."
        fault = f"All {n} heights are {value[0]:g}: a placeholder, not a measurement."
    elif far.any():
        index = int(np.argmax(far))
        fault, remedy = "The height", "Check it, and probe the bed again."
        if not readings.plan.touches[index]:
            fault = "The stored distance"
            remedy = "Measure it again on the printed object, and give it to DELTA_ANALYZE."
        elif reckoned:
            remedy = (
                "Were rotation_distance, microsteps, position_endstop, delta_radius or arm_length"
                " changed after DELTA_CALIBRATE? Change them back, or run it and SAVE_CONFIG again."
            )
        size = abs(float(value[index]))
        off = "out of reach" if math.isnan(size) else f"{size:.0f} mm off"
        fault = f"{fault} is {off} with the settings in force."
    elif away.max() > BEYOND * machine.bed_radius_mm and not reckoned:
        index = int(np.argmax(away))
        fault = f"The place is {away.max():.0f} mm from the middle of the bed."
        remedy = (
            f"Check it, and the radius of the bed ({machine.bed_radius_mm:g} mm): print_radius of"
            " [printer], else its delta_radius; or B of M665."
        )
    else:
        return
    raise InputError(fault, remedy, file=readings.source.path, line=int(readings.line[index]))
