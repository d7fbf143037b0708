"""RepRapFirmware's config.g and heightmap.csv; and the settings that Marlin prints (M503).

M665, M666, G31 and M851:

    RepRapFirmware   endstop = H + M666; G31 has the nozzle's height when the probe triggers
    Marlin           endstop = H − M666 − Z of M851, which is minus that height

Both: L arms, R delta radius, X, Y, Z what is added to 210, 330 and 90 degrees. RepRapFirmware has
the radius of the bed, B, and one arm or three in L; Marlin has A, B, C, what each arm exceeds L by.

A height map has a title with the date, the names of the grid's numbers, the numbers, then a line
for each y from the lowest. A place that was not probed is a bare "0" (one that was probed has
decimals). Places are the probe's, heights are counted from the trigger height.

Sources: "GCode dictionary" and "Mesh bed compensation" of RepRapFirmware; Marlin's documents of
M503, M665, M666 and M851.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path, PurePath

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.printer_file import (
    LARGEST_MM,
    USUAL_ANGLES_DEG,
    ZERO_UNKNOWN,
    PrinterFile,
    Stored,
    delta_of,
    within,
)
from orthoglide_cal.files.text import FileText, read_document
from orthoglide_cal.model.linear_delta import TOWERS_TURN, counter_clockwise

_CODE = re.compile(r"\b(M665|M666|M851|G31)\b(.*?)(?=\b[GM][0-9]|$)")
_WORD = re.compile(r"([A-Z])(\{[^}]*\}|[^A-Z\s]*)")
_LETTERS = {"M665": "LRHXYZABC", "M666": "XYZ", "M851": "XYZ", "G31": "XYZK"}
# Only Marlin has, or says, these.
_MARLIN = re.compile(r"\becho:|\bM851\b|^\s*M500\b", re.MULTILINE)
SETTINGS = re.compile(
    r"^(?:recv:|echo:|[0-9:.,> \t])*M665\b[^;\n]*\sL", re.MULTILINE | re.IGNORECASE
)
_LOADS = re.compile(r"^\s*M501\b", re.MULTILINE | re.IGNORECASE)
_DATE = re.compile(r"\b20[0-9]{2}-[0-9]{2}-[0-9]{2} [0-9]{2}:[0-9]{2}")
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

Words = dict[str, tuple[float, ...]]


def read_codes(document: FileText, *overriding: FileText) -> PrinterFile:
    """The machine and the probe that these files state; the last of them wins.

    The radius of the bed is NaN where it is not stated. Raises InvalidFileError with everything
    that is wrong in one of them.
    """
    said: Words = {}
    for file in (document, *overriding):
        said |= _words(file)
    faults, marlin = Faults(document.path), _MARLIN.search(document.text) is not None

    def three(code: str, usual: float = 0.0) -> np.ndarray:
        return np.array([said.get(code + axis, (usual,))[0] for axis in "XYZ"])

    for letter in "LRH":
        if "M665" + letter not in said:
            remedy = f"Add it to the line M665, or give a file that has it: M665 … {letter}…"
            faults.add(f"M665 with {letter} is missing.", remedy)
    faults.check()
    arms, radius = np.array(said["M665L"]) * np.ones(3), said["M665R"][0]
    if marlin and "M665C" in said:
        arms += [said.get("M665" + tower, (0.0,))[0] for tower in "ABC"]
    angles = three("M665") + USUAL_ANGLES_DEG
    if not 0.0 < radius < arms.min():
        what = f"The delta radius R ({radius:g}) is not between 0 and the arms' length L."
        faults.add(what, "Check both in M665.")
    if not counter_clockwise(angles.tolist()):
        faults.add(TOWERS_TURN, "Check X, Y and Z of M665; they are usually below one degree.")
    faults.check()
    if marlin:
        probe = three("M851", math.nan) * (1.0, 1.0, -1.0)
        bed = math.nan
        endstops = said["M665H"][0] - three("M666") + np.nan_to_num(probe[2])
    else:
        probe = three("G31", math.nan)
        bed = said.get("M665B", (math.nan,))[0]
        endstops = said["M665H"][0] + three("M666")
    machine = delta_of(document, arms, radius, angles, endstops, bed)
    return PrinterFile(machine, probe, document.source)


def read_codes_in(folder: Path, measured: FileText | None = None) -> PrinterFile | None:
    """What config.g, and config-override.g if M501 loads it, state; None if there are no arms.

    The date of what was measured by these settings is compared with theirs.
    """
    paths = [folder / name for name in ("config.g", "config-override.g")]
    files = [read_document(str(path)) for path in paths if path.is_file()]
    if len(files) == len(paths) and not _LOADS.search(files[0].text):
        files.pop()
    if not any(SETTINGS.search(file.text) for file in files):
        return None
    names = " and ".join(PurePath(file.path).name for file in files)
    remarks = [f"The settings are those of {names} in the same folder."]
    both = (files[-1], measured) if measured else ()
    found = [_DATE.search(file.text.split("\n", 1)[0]) for file in both]
    dates = [date[0] for date in found if date]
    if len(dates) == 2 and dates[1] < dates[0]:
        remarks.append(
            f"The height map ({dates[1]}) is older than the calibration in force"
            f" ({PurePath(files[-1].path).name}, {dates[0]}): the result is wrong. Probe the"
            " bed again (G29)."
        )
    return replace(read_codes(*files), remarks=tuple(remarks))


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
    mesh, source = replace(grid, remarks=(remark,)), document.source
    return replace(settings, probe=offset, mesh=mesh, source=source, firmware="reprapfirmware")


def _words(file: FileText) -> Words:
    """Code and letter → numbers: {"M665L": (215.0,)}, by the last line that has it."""
    faults, found = Faults(file.path), Words()
    for number, line in enumerate(file.text.split("\n"), start=1):
        for code, rest in _CODE.findall(line.split(";")[0].upper()):
            own = Words()
            for letter, text in _WORD.findall(rest):
                if letter not in _LETTERS[code]:
                    continue
                word = code + letter
                low = 0.0 if word in ("M665L", "M665R") else -LARGEST_MM
                with faults.noting(number, letter + text, f"{letter} of {code}"):
                    own[word] = tuple(within(part, low) for part in text.split(":"))
                    if len(own[word]) not in ((1, 3) if word == "M665L" else (1,)):
                        remedy = "Write one, or L215:215:215."
                        raise InputError("The number of values is wrong.", remedy)
            if own.get("G31K", (0.0,)) == (0.0,):  # of several probes the first
                found |= own
    faults.check()
    return found
