"""What Marlin prints of G33 and G29, by the settings that M503 prints or a machine file has.

    G33 V0 or V3   seven heights on a circle, and the settings at that moment
    G29 V4         "Bed X: … Y: … Z: …" for each touch; so does G30
    G29, M420 V    "Bilinear Leveling Grid:", whose places are not printed

All heights are counted from the trigger height, places are the probe's; lines may have anything in
front of them. G33 changes the settings: what was probed before is counted from those after it, with
the carriages where they were. Sources: Marlin's documents of G29 (bilinear), G33, M420 and M503.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.errors import InputError, UnreachableError
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.printer_file import (
    LARGEST_MM,
    USUAL_ANGLES_DEG,
    PrinterFile,
    Stored,
    within,
)
from orthoglide_cal.files.text import FileText
from orthoglide_cal.model.linear_delta import Endstops, LinearDelta, counter_clockwise

MARLIN_OUTPUT = re.compile(
    "Bed X:|Bilinear Leveling Grid:|G33 Auto Calibrate|Bed Topography Report|Measured points:"
)
_BED = re.compile(r"Bed X: ?(\S+) Y: ?(\S+) Z: ?(\S+)")
_GRID = re.compile(r"(?<!Subdivided )(?<!ROM )Bilinear Leveling Grid:")
_ROW = re.compile(r"(?:^|[\s>])[0-9]{1,3}((?:\s+(?:[-+][0-9.]+|nan|=+))+)\s*$")
_CALIBRATES = "G33 Auto Calibrate"
_AT_RADIUS = re.compile(r"Checking\.\.\. AC at radius: ?([0-9.]+)")
_SETTING = re.compile(r"\b(Height|Radius|[ET][xyz]): ?([-+]?[0-9.]+)")
_RESULTS = re.compile(r"(?:^|[\s>:])\.\s+((?:c|yz) ?:.*)$")
_RESULT = re.compile(r"\b(c|x|y|z|yz|zx|xy) ?: ?([-+]?[0-9.]+)")
# Where G33 probes: at the towers x, y, z and opposite of them [deg].
_PLACES = (*USUAL_ANGLES_DEG, 30.0, 150.0, 270.0)
_TURNS = dict(zip(("x", "y", "z", "yz", "zx", "xy"), _PLACES, strict=True))
# So far from the edge the probe stays unless Marlin was compiled otherwise [mm].
_MARGIN_MM = 10.0
_ROUNDED = 0.0051  # mm, deg, to which G33 prints its settings


class _Reader:
    """Takes the lines in turn.

    Attributes:
        now: the machine with the settings in force.
        probed: G33 or G29 → the machine at that time, and line, x, y and height of each touch;
            places of G33 are on a circle of radius 1.
        grid: the machine at that time, and line → heights.
        radius: of G33's circle [mm]; None where it was not printed.
        changed: line at which the settings changed; 0 if they did not.
    """

    def __init__(self, settings: PrinterFile) -> None:
        self.now = settings.machine
        self.offset = np.nan_to_num(settings.probe)
        self.reach = self.now.bed_radius_mm - _MARGIN_MM
        self.probed: dict[str, tuple[LinearDelta, list[Sequence[float]]]] = {}
        self.grid: tuple[LinearDelta, dict[int, list[str]]] = self.now, {}
        self.radius: float | None = None
        self.changed = 0
        self._calibrating = self._in_grid = False

    def take(self, number: int, line: str) -> None:
        """Raises InputError, without a place, for what is no number."""
        row = _ROW.search(line) if self._in_grid else None
        if _GRID.search(line):
            self.grid, self._in_grid = (self.now, {}), True
        elif row:
            self.grid[1][number] = row[1].split()
        elif self.grid[1]:
            self._in_grid = False
        if match := _BED.search(line):
            x, y, height = (within(text, -LARGEST_MM) for text in match.groups())
            self._add("G29", [(number, x - self.offset[0], y - self.offset[1], height)])
        self._calibrating |= _CALIBRATES in line
        if not self._calibrating:
            return
        if match := _AT_RADIUS.search(line):
            self.radius = within(match[1], 0.0)
        if match := _RESULTS.search(line):
            touches: list[Sequence[float]] = []
            for name, text in _RESULT.findall(match[1]):
                turn, away = math.radians(_TURNS.get(name, 0.0)), float(name != "c")
                at = away * math.cos(turn), away * math.sin(turn)
                touches.append((number, *at, within(text, -LARGEST_MM)))
                if name == "c":
                    self.probed.pop("G33", None)
            if touches:
                self._add("G33", touches)
        elif said := dict(_SETTING.findall(line)):
            self._set({name: within(text, -LARGEST_MM) for name, text in said.items()}, number)

    def _set(self, said: dict[str, float], number: int) -> None:
        """Settings as G33 prints them, rounded, in one line or in two. Raises InputError."""
        endstops = np.array(self.now.endstops_mm)
        if "Height" in said:
            below = zip("xyz", endstops.min() - endstops, strict=True)
            adjusted = np.array([said.get(f"E{axis}", known) for axis, known in below])
            endstops = said["Height"] + self.offset[2] - adjusted
        usual = zip("xyz", USUAL_ANGLES_DEG, self.now.tower_angles_deg, strict=True)
        angles = [known if f"T{a}" not in said else at + said[f"T{a}"] for a, at, known in usual]
        radius = said.get("Radius", self.now.delta_radius_mm)
        if not (0.0 < radius < min(self.now.arm_length_mm) and counter_clockwise(angles)):
            remedy = "Check them, and the arms (M665 L)."
            raise InputError("No delta can have these settings.", remedy)
        known = (*self.now.endstops_mm, self.now.delta_radius_mm, *self.now.tower_angles_deg)
        if np.allclose((*endstops, radius, *angles), known, rtol=0.0, atol=_ROUNDED):
            return
        values = {
            "endstops_mm": Endstops(*endstops.tolist()),
            "delta_radius_mm": radius,
            "tower_angles_deg": tuple(angles),
        }
        self.now, self.changed = self.now.model_copy(update=values), number

    def _add(self, name: str, touches: Iterable[Sequence[float]]) -> None:
        """Touches behind those before them with the same settings."""
        if name not in self.probed or self.probed[name][0] is not self.now:
            self.probed[name] = self.now, []
        self.probed[name][1].extend(touches)

    def take_grid(self) -> None:
        """The points of the grid within reach as those of G29: Marlin makes up the others."""
        lines = list(self.grid[1])
        rows = [
            [math.nan if "=" in text else within(text, -LARGEST_MM) for text in row]
            for row in self.grid[1].values()
        ]
        if len({len(row) for row in rows}) != 1:
            raise InputError("The rows of the grid are not equally long.", "Send M420 V again.")
        heights = np.array(rows)
        x, y = (np.linspace(-self.reach, self.reach, count) for count in heights.shape[::-1])
        heights[np.hypot(*np.meshgrid(x, y)) > self.reach + _ROUNDED] = math.nan
        mesh = Stored.of_grid("", x, y, heights, lines, self.offset)
        points = np.column_stack((mesh.line, mesh.plan.place[:, :2], mesh.value))
        if len(points):
            self.probed["G29"] = self.grid[0], points[mesh.plan.in_time].tolist()


def read_marlin(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings after all that was printed, with G33's heights, and what else was probed.

    The radius of the bed is NaN where the settings before it do not have it.

    Raises:
        InvalidFileError: everything that is wrong.
        InputError: it holds no heights, or not their places.
    """
    faults, reader, remarks = Faults(document.path), _Reader(settings), []
    for number, line in enumerate(document.text.split("\n"), start=1):
        with faults.noting(number, line.strip()):
            reader.take(number, line)
    faults.check()
    if math.isnan(settings.probe[2]):
        remarks.append("M851 is not known and is taken as 0: do not add it to H again.")

    def needs_reach(name: str) -> None:
        if not reader.reach > 0.0:
            what = f"{name} does not print where it probed."
            remedy = (
                "Send G29 V4, which does; or give the machine file, with bed_radius_mm: --machine"
            )
            raise InputError(what, remedy, file=document.path)
        remarks.append(
            f"{name} does not print where it probed: as Marlin usually does, to {reader.reach:g} mm"
            f" from the middle ({_MARGIN_MM:g} mm from the edge), is assumed."
        )

    def stored(name: str, radius: float = 1.0) -> Stored | None:
        if name not in reader.probed:
            return None
        then, touches = reader.probed[name]
        placed = np.array(touches) * (1.0, radius, radius, 1.0)
        mesh = Stored.of_touches(name, placed, reader.offset[2])
        if then is reader.now:
            return mesh
        remarks.append(
            f"The heights of {name} were probed before G33 changed the settings (line"
            f" {reader.changed}); they are counted from those in force after it."
        )
        try:
            place = reader.now.believed(then, mesh.plan.place)
        except UnreachableError as error:
            what = f"The arms cannot reach a place of {name}."
            remedy = "Check the settings (M503, or the machine file)."
            raise InputError(what, remedy, file=document.path, line=int(mesh.line[0])) from error
        plan = replace(mesh.plan, place=place, other=place)
        return replace(mesh, plan=plan, value=place[:, 2] - reader.offset[2])

    if "G33" in reader.probed:
        if reader.radius is None:
            needs_reach("G33")
        remarks.append("G33 with P4 to P10 prints averages around seven places: take P3.")
    heights = stored("G33", reader.reach if reader.radius is None else reader.radius)
    if "G29" not in reader.probed and reader.grid[1]:
        needs_reach("G29")
        reader.take_grid()
    mesh = stored("G29")
    if heights is None and mesh is None:
        what, remedy = "holds no probed heights with their places", "Send G29 V4"
        if _CALIBRATES in document.text:
            what, remedy = "has no heights: G33 was not told to print them", "Send G33 V0 or V3"
        remedy += ", and give all the lines that it prints."
        raise InputError(f"Marlin's output {what}.", remedy, file=document.path)
    return replace(
        settings,
        machine=reader.now,
        probe=reader.offset,
        heights=heights,
        mesh=mesh,
        source=document.source,
        firmware="marlin",
        remarks=(*settings.remarks, *remarks),
    )
