"""Klipper's klippy.log, and the lines that its console prints while probing.

The log holds the configuration in force, also what is included and stored, and what each
DELTA_CALIBRATE reckoned with. The console has a line for each touch, with anything in front of it:

    probe at x,y is z=…                     the nozzle's place when the probe triggered
    probe: at x,y bed will contact at z=…   since 2025: the probe's, less its z offset

Sources: Klipper's documents "Delta calibration" and "Bed Mesh", and its messages.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.klipper_file import Value, read_printer_file
from orthoglide_cal.files.printer_file import (
    LARGEST_MM,
    ZERO_UNKNOWN,
    PrinterFile,
    Stored,
    within,
)
from orthoglide_cal.files.text import FileText
from orthoglide_cal.schema import shortened

_CONFIG = re.compile(r"=+ Config file =+\s*")
_CALCULATING = "Calculating delta_calibrate with:"
KLIPPY_LOG = re.compile(rf"^({_CONFIG.pattern}|{_CALCULATING}\s*)$", re.MULTILINE)
_ENDS = re.compile("={10,}")
_STORED = re.compile(r"(manual_)?height[0-9]+\s*[:=]")
_STEPS = r"\(([^,()]+, [^,()]+, [^,()]+)\)"
_HEIGHT, _DISTANCE = rf"\(([^,()]+), {_STEPS}\)", rf"\(([^,()]+), {_STEPS}, {_STEPS}\)"
# A nozzle that touches the bed itself stands this low when it does.
_LEVEL_MM = 0.5
PROBED = re.compile(r"probe(:?) at (\S+?), ?(\S+) (?:is|bed will contact at) z=(\S+)")


def read_klippy_log(document: FileText) -> PrinterFile:
    """The last configuration of a log, with the last calibration and else what was probed.

    Raises InvalidFileError with everything that is wrong in the lines that matter here.
    """
    lines = document.text.split("\n")
    starts = [number for number, line in enumerate(lines) if _CONFIG.fullmatch(line)]
    if not starts:
        what = "The log does not hold the configuration: its beginning is missing."
        raise InputError(what, "Give the whole klippy.log, or the printer.cfg.", file=document.path)
    start = starts[-1] + 1
    inside = itertools.takewhile(lambda line: not _ENDS.fullmatch(line.strip()), lines[start:])
    kept = [""] * start + list(inside)
    found = [number for number, line in enumerate(lines) if line.startswith(_CALCULATING)]
    unsaved = bool(found) and found[-1] > start
    calculated = None
    if found and (unsaved or not any(map(_STORED.match, kept))):
        calculated = _calculated(document, lines, found[-1])
    file = read_printer_file(replace(document, text="\n".join(kept)), calculated)
    if unsaved:
        remark = (
            f"SAVE_CONFIG does not follow the calibration of line {found[-1] + 1}: the settings"
            " before it are in force and are used."
        )
        file = replace(file, remarks=(*file.remarks, remark))
    if file.heights is None and file.mesh is None and PROBED.search(document.text):
        return read_probed(document, file)
    return file


def _calculated(document: FileText, lines: Sequence[str], at: int) -> Mapping[str, Value]:
    """Heights and distances that a calibration reckoned with, as [delta_calibrate] stores them."""
    stored = {}
    for number, name, each in ((at + 1, "height", _HEIGHT), (at + 2, "distance", _DISTANCE)):
        text = lines[number].strip() if number < len(lines) else ""
        if not re.fullmatch(rf"\[(?:{each}(?:, |(?=\])))*\]", text):
            what = f"This is not a list of {name}s with stepper positions."
            remedy = "Was the log cut off or changed? Give it as Klipper wrote it."
            line, value = number + 1, shortened(text) or None
            raise InputError(what, remedy, file=document.path, line=line, value=value)
        for index, parts in enumerate(re.findall(each, text)):
            ends = ("", "_pos") if len(parts) == 2 else ("", "_pos1", "_pos2")
            for end, part in zip(ends, parts, strict=True):
                stored[f"{name}{index}{end}"] = Value(number + 1, ((number + 1, part),))
    return stored


def read_probed(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings, and the touches that Klipper printed as their mesh. Raises InvalidFileError."""
    faults, rows = Faults(document.path), []
    for number, line in enumerate(document.text.split("\n"), start=1):
        for match in PROBED.finditer(line):
            with faults.noting(number, match[0]):
                place = [within(match[group], -LARGEST_MM) for group in (2, 3, 4)]
                rows.append((number, *place, match[1] == ":"))
    faults.check()
    touches = np.array(rows)
    at, less = touches[:, 1:4], touches[:, 4] > 0.0  # the probe's offset
    offset, remarks = np.nan_to_num(settings.probe), settings.remarks
    usual = 0.0 if less.all() else float(np.median(at[~less, 2]))
    if offset[2] == 0.0 and abs(usual) > _LEVEL_MM:
        offset[2] = usual
        remarks += (f"The probe's z offset is not known: {ZERO_UNKNOWN}",)
    at[less, :2] -= offset[:2]
    at[~less, 2] -= offset[2]
    mesh = Stored.of_touches("console", touches[:, :4], offset[2])
    source = document.source
    return replace(settings, probe=offset, mesh=mesh, source=source, remarks=remarks)
