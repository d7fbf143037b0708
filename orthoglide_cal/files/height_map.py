"""RepRapFirmware's heightmap.csv, by the settings of its config.g.

A title with the date, the names of the grid's numbers, the numbers, then a line for each y from the
lowest. A place that was not probed is a bare "0" (one that was probed has decimals). Places are the
probe's, heights are counted from the trigger height. Source: "Mesh bed compensation" and G29 in the
"GCode dictionary" of RepRapFirmware.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.printer_file import ZERO_UNKNOWN, PrinterFile, Stored
from orthoglide_cal.files.printer_settings import LARGEST_MM, within
from orthoglide_cal.files.text import FileText

HEIGHT_MAP = re.compile(r"\s*RepRapFirmware height map file")
# Later versions name the axes, and number what earlier ones call x and y.
_NAMES = {
    f"{name}{number}": axis + name
    for name in ("min", "max", "num", "spacing")
    for number, axis in enumerate("xy")
}
_UNPROBED = "0"
_AGAIN = "Probe the bed again: G29"
_FAR = 1000.0  # mm, and places along one axis


def read_height_map(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings, with the probed heights as their mesh. Raises InvalidFileError."""
    faults, lines = Faults(document.path), document.text.strip("\n").split("\n")
    if len(lines) < 3:
        what = "The height map has no numbers: it was cut off."
        raise InputError(what, _AGAIN, file=document.path, line=len(lines))
    names = [_NAMES.get(name.strip(), name.strip()) for name in lines[1].lower().split(",")]
    numbers = {}
    for name, text in zip(names, lines[2].split(","), strict=False):
        if name == "spacing" or name[1:] in ("num", "min", "spacing"):
            with faults.noting(3, text, name):
                numbers[name] = within(text.strip(), -_FAR, _FAR)
    faults.check()
    spacing = numbers.get("spacing", 0.0)  # the first version had one for both
    try:
        x, y = (
            numbers[f"{axis}min"]
            + numbers.get(f"{axis}spacing", spacing) * np.arange(numbers[f"{axis}num"])
            for axis in "xy"
        )
    except KeyError as error:
        what = f"The second line of the map has no {error}, or the third no number for it."
        raise InputError(what, _AGAIN, file=document.path, line=2) from error
    heights = np.full((len(y), len(x)), np.nan)
    rows = lines[3:]
    if len(rows) != len(y):
        what = f"The map has {len(rows)} lines of heights, its header says {len(y)}."
        faults.add(what, f"Was it cut off? {_AGAIN}", line=3 + len(rows))
        faults.check()
    for row, text in enumerate(rows):
        cells = [cell.strip() for cell in text.split(",")]
        if len(cells) != len(x):
            what = f"The line has {len(cells)} heights, the header says {len(x)}."
            faults.add(what, _AGAIN, line=4 + row)
            continue
        for column, cell in enumerate(cells):
            with faults.noting(4 + row, cell):
                if cell != _UNPROBED:
                    heights[row, column] = within(cell, -LARGEST_MM)
    if not faults and not np.isfinite(heights).any():
        what = "No place of the map was probed: a placeholder, not a measurement."
        faults.add(what, _AGAIN, line=4)
    faults.check()
    offset = np.nan_to_num(settings.probe)
    lines_of = range(4, 4 + len(y))
    grid = Stored.of_grid("heightmap", x, y, heights, lines_of, offset)
    remark = f"If G30 was sent before G29, the map counts from that place: {ZERO_UNKNOWN}"
    mesh = replace(grid, remarks=(remark,))
    return replace(
        settings,
        probe=offset,
        mesh=mesh,
        source=document.source,
        firmware="reprapfirmware",
    )
