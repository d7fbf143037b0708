"""RepRapFirmware's config.g and heightmap.csv; what Marlin prints of M503, G33 and G29.

M665, M666, G31 and M851:

    RepRapFirmware   endstop = H + M666; G31 has the nozzle's height when the probe triggers
    Marlin           endstop = H − M666 − Z of M851, which is minus that height

Both: L arms, R delta radius, X, Y, Z what is added to 210, 330 and 90 degrees. RepRapFirmware has
the radius of the bed, B, and one arm or three in L; Marlin has A, B, C, what each arm exceeds L by.

A height map has a title with the date, the names of the grid's numbers, the numbers, then a line
for each y from the lowest. A place that was not probed is a bare "0" (one that was probed has
decimals). Consoles print, with anything in front of it:

    Marlin, G33 V0 or V3   seven heights on a circle, and the settings at that moment
    Marlin, G29 V4         "Bed X: … Y: … Z: …" for each touch; so does G30
    RepRapFirmware         "G32 bed probe heights: …", at the places of G30 P… in bed.g
    Repetier, G33 L0       "G33 X… Y… Z…", whose common height nobody states

All heights are counted from the trigger height, places are the probe's. G33 changes the settings:
what was probed before is counted from those after it, with the carriages where they were.

Sources: "GCode dictionary" and "Mesh bed compensation" of RepRapFirmware; Marlin's documents of
G29 (bilinear), G33, M420, M503, M665, M666 and M851, its M665.cpp, M666.cpp (no adjustment above
zero is taken) and motion.cpp (after homing the nozzle is believed at H less Z of M851).
"""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from orthoglide_cal.errors import InputError, PostureError
from orthoglide_cal.files.printer_file import (
    LARGEST_MM,
    USUAL_ANGLES_DEG,
    PrinterFile,
    delta_of,
    heights_in,
    stored_grid,
    stored_mesh,
    within,
)
from orthoglide_cal.files.text import FileText
from orthoglide_cal.files.tree import Content
from orthoglide_cal.model.linear_delta import TOWERS_TURN, LinearDelta, counter_clockwise
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.schema import Reason

_CODE = re.compile(r"\b(M665|M666|M851|G31)\b(.*?)(?=\b[GM][0-9]|$)")
_WORD = re.compile(r"([A-Z])(\{[^}]*\}|[^A-Z\s]*)")
_LETTERS = {"M665": "LRHXYZABC", "M666": "XYZ", "M851": "XYZ", "G31": "XYZK"}
# Only Marlin has, or says, these.
_MARLIN = re.compile(r"\becho:|\bM851\b|^\s*M500\b", re.MULTILINE)
SETTINGS = re.compile(
    r"^(?:recv:|echo:|[0-9:.,> \t])*M665\b[^;\n]*\sL", re.MULTILINE | re.IGNORECASE
)
_LOADS = re.compile(r"^\s*M501\b", re.MULTILINE | re.IGNORECASE)
_KINEMATICS = re.compile(r"^\s*M66[79]\b[^;\n]*", re.MULTILINE | re.IGNORECASE)
_NAME = re.compile(r'^\s*M550\s+P"([^"\n]+)"', re.MULTILINE | re.IGNORECASE)
_DATE = re.compile(r"\b20[0-9]{2}-[0-9]{2}-[0-9]{2} [0-9]{2}:[0-9]{2}")
HEIGHT_MAP = re.compile(r"\A\s*RepRapFirmware height map file")
_UNPROBED = "0"
_AGAIN = "Probe the bed again: G29"
_FAR = 1000.0  # mm, and places along one axis
_UNKNOWN = (
    "The settings in force are not known: {} loads config-override.g (M501), which is not in its"
    " folder."
)

Words = dict[str, list[float]]  # code and letter → its numbers: {"M665L": [215.0]}


def read_codes(document: FileText, *overriding: FileText) -> PrinterFile:
    """The machine and the probe that these files state; the last of them wins.

    An unknown radius of the bed is NaN. Raises InputError: everything that is wrong in one of them.
    """
    words: Words = {}
    for file in (document, *overriding):
        words |= _words(file)
    faults, marlin = Content(document), _MARLIN.search(document.text) is not None
    for letter in "LRH":
        if "M665" + letter not in words:
            remedy = f"Add it to the line M665, or give a file that has it: M665 … {letter}…"
            faults.add(f"M665 with {letter} is missing.", remedy)
    faults.check()
    (bed,), probe = words.get("M665B", [math.nan]), _three(words, "G31", math.nan)
    if marlin:
        probe = _three(words, "M851", math.nan) * (1.0, 1.0, -1.0)
        # Where no arm is stated by B, it is the radius on which Marlin 1.1 probes.
        bed = math.nan if "M665C" in words else bed + _MARGIN_MM
    with faults.noting(None):
        machine = _stated(delta_of(document, bed), words, marlin, np.nan_to_num(probe[2]))
    faults.check()
    if named := _NAME.search(document.text):
        machine = machine.changed(name=named[1])
    unknown = "" if marlin or overriding or not _LOADS.search(document.text) else _UNKNOWN
    name = PurePath(document.path).name
    return PrinterFile(machine, probe, document.source, unknown=unknown.format(name))


def _stated(machine: LinearDelta, words: Words, marlin: bool, trigger: float) -> LinearDelta:
    """The machine with what M665 and M666 state; the nozzle's height when the probe triggers is
    what Marlin believes it lower by. Raises InputError without a place."""
    (radius,), (height,) = words["M665R"], words["M665H"]
    arms = np.array(words["M665L"]) * np.ones(3)
    if marlin and "M665C" in words:
        arms += _three(words, "M665", letters="ABC")
    angles, adjusted = _three(words, "M665") + USUAL_ANGLES_DEG, _three(words, "M666")
    if not 0.0 < radius < arms.min():
        fault = f"The delta radius R ({radius:g}) is not between 0 and the arms' length L."
        raise InputError(fault, "Check both in M665.")
    if not counter_clockwise(angles.tolist()):
        remedy = "Check X, Y and Z of M665; they are usually below one degree."
        raise InputError(TOWERS_TURN, remedy)
    adjusted = trigger - adjusted if marlin else adjusted
    return machine.having(arms, radius, angles, height + adjusted)


def words_of(machine: LinearDelta, marlin: bool, trigger: float = 0.0) -> Words:
    """The words of M665 and M666 that state this machine, in the order of their lines."""
    arms, endstops = np.array(machine.arm_length_mm), np.array(machine.endstops_mm)
    # Marlin adjusts no endstop upwards.
    height = float(endstops.min() if marlin else endstops.mean())
    turned = np.subtract(machine.tower_angles_deg, USUAL_ANGLES_DEG)
    words = {"L": [arms.mean()], "R": [machine.delta_radius_mm], "H": [height - trigger]}
    words |= {} if marlin else {"B": [machine.bed_radius_mm]}
    words |= {letter: [angle] for letter, angle in zip("XYZ", turned, strict=True)}
    if marlin and not machine.equal_arms:
        words |= {letter: [more] for letter, more in zip("ABC", arms - arms.mean(), strict=True)}
    elif not machine.equal_arms:
        words["L"] = arms.tolist()
    adjusted = height - endstops if marlin else endstops - height
    more = {f"M666{letter}": [by] for letter, by in zip("XYZ", adjusted, strict=True)}
    return {f"M665{letter}": values for letter, values in words.items()} | more


def _three(words: Words, code: str, usual: float = 0.0, letters: str = "XYZ") -> Floats:
    return np.array([words.get(code + letter, [usual])[0] for letter in letters])


def own_codes(document: FileText) -> PrinterFile | None:
    """Settings that a text holds itself, with what config.g loads; None if it has none."""
    if PurePath(document.path).name == "config.g":
        return codes_beside(document)
    return read_codes(document) if SETTINGS.search(document.text) else None


def codes_beside(measured: FileText) -> PrinterFile | None:
    """Settings of config.g, and of config-override.g if M501 loads it; None if there are no arms.

    The date of a height map that was measured by these settings is compared with theirs.
    """
    config, override = map(measured.beside, ("config.g", "config-override.g"))
    loaded = override if config is None or _LOADS.search(config.text) else None
    files = [file for file in (config, loaded) if file]
    if not any(SETTINGS.search(file.text) for file in files):
        return None
    names = [PurePath(file.path).name for file in files]
    remarks = [Reason.of("settings_beside", names=names)]
    set_on, probed = (_DATE.search(file.text.split("\n", 1)[0]) for file in (files[-1], measured))
    if set_on and probed and HEIGHT_MAP.search(measured.text) and probed[0] < set_on[0]:
        dates = {"date": probed[0], "settings": names[-1], "calibrated": set_on[0]}
        remarks.append(Reason.of("stale_mesh", order=Reason.of("stale_by_date", **dates)))
    return replace(read_codes(*files), remarks=tuple(remarks))


def check_delta(measured: FileText) -> None:
    """Raise InputError for what was probed beside a config.g that has no arms."""
    if (config := measured.beside("config.g")) is None:
        return
    if _LOADS.search(config.text):
        fault = _UNKNOWN.format("config.g")
        raise InputError(fault, "Copy it from the printer.", file=measured.path)
    stated = "".join(f" ({kind.strip()})" for kind in _KINEMATICS.findall(config.text)[:1])
    fault = f"This printer is not a delta: config.g in the same folder has no M665 with L{stated}."
    remedy = "Give the height map of a delta; or name its settings: --machine FILE"
    raise InputError(fault, remedy, file=measured.path)


def read_height_map(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings, with the probed heights as their mesh. Raises InputError."""
    faults, lines = Content(document), document.text.strip("\n").split("\n")
    head, values = [*lines[1:3], "", ""][:2]
    texts = dict(zip(map(str.strip, head.lower().split(",")), values.split(","), strict=False))

    def stated(name: str, axis: int) -> float:
        """A number of the grid; 0 if it is wrong, which is noted."""
        # Later versions number the axes; the first one had one spacing for both.
        called = (f"{'xy'[axis]}{name}", f"{name}{axis}", name)
        key = next((key for key in called if key in texts), None)
        if key is None:
            fault = f"The second line of the map has no {called[0]!r}, or the third no number"
            raise InputError(f"{fault} for it.", _AGAIN, file=document.path, line=2)
        with faults.noting(3, key, texts[key]):
            return within(texts[key].strip(), -_FAR, _FAR)
        return 0.0

    x, y = (stated("min", k) + stated("spacing", k) * np.arange(stated("num", k)) for k in (0, 1))
    faults.check()
    rows = {line: text.split(",") for line, text in enumerate(lines[3:], start=4)}
    heights = heights_in(faults, rows, (len(y), len(x)), _AGAIN, _UNPROBED)
    if not faults.problems and not np.isfinite(heights).any():
        fault = "No place of the map was probed: a placeholder, not a measurement."
        faults.add(fault, _AGAIN, line=4)
    faults.check()
    offset = np.nan_to_num(settings.probe)
    grid = stored_grid(document.source, x, y, heights, [*rows], offset)
    data = {"mesh": replace(grid, remarks=(Reason.of("map_from_place"),))}
    date = _DATE.search(lines[0])
    return replace(settings, probe=offset, data=data, started=date and date[0])


def _words(file: FileText) -> Words:
    """Words of the codes in a file; of one that stands twice the last counts."""
    faults, words = Content(file), Words()
    for number, line in enumerate(file.text.split("\n"), start=1):
        for code, rest in _CODE.findall(line.split(";")[0].upper()):
            new = Words()
            known = (match for match in _WORD.findall(rest) if match[0] in _LETTERS[code])
            for letter, text in known:
                word = code + letter
                low = 0.0 if word in ("M665L", "M665R") else -LARGEST_MM
                with faults.noting(number, f"{letter} of {code}", letter + text):
                    new[word] = [within(part, low) for part in text.split(":")]
                    if len(new[word]) not in ((1, 3) if word == "M665L" else (1,)):
                        remedy = "Write one, or L215:215:215."
                        raise InputError("The number of values is wrong.", remedy)
            if new.get("G31K", [0.0]) == [0.0]:  # of several probes the first
                words |= new
    faults.check()
    return words


# --- what Marlin prints while it probes ---------------------------------------------------------

MARLIN_OUTPUT = re.compile(
    "Bed X:|Bilinear Leveling Grid:|G33 Auto Calibrate|Bed Topography Report|Measured points:"
)
_BED = re.compile(r"Bed X: ?(\S+) Y: ?(\S+) Z: ?(\S+)")
_CALIBRATES = "G33 Auto Calibrate"
_AT_RADIUS = re.compile(r"Checking\.\.\. AC at radius: ?([0-9.]+)")
_SETTING = re.compile(r"\b(Height|Radius|[ET][xyz]): ?([-+]?[0-9.]+)")
_PRINTED = {"Height": "M665H", "Radius": "M665R", "Ex": "M666X", "Ey": "M666Y", "Ez": "M666Z"}
_PRINTED |= {"Tx": "M665X", "Ty": "M665Y", "Tz": "M665Z"}
_RESULTS = re.compile(r"(?:^|[\s>:])\.\s+((?:c|yz) ?:.*)$")
_RESULT = re.compile(r"\b(c|x|y|z|yz|zx|xy) ?: ?([-+]?[0-9.]+)")
# Where G33 probes: at the towers x, y, z and opposite of them [deg].
_TURNS = {"x": 210.0, "y": 330.0, "z": 90.0, "yz": 30.0, "zx": 150.0, "xy": 270.0}
_MARGIN_MM = 10.0  # between probe and edge, unless Marlin was compiled otherwise
_ROUNDED = 0.0051  # mm, deg, to which G33 prints its settings


def read_marlin(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings after all that was printed, with G33's heights, and what else was probed.

    Raises InputError: everything that is wrong; no heights, or not their places.
    """
    faults, offset = Content(document), np.nan_to_num(settings.probe)
    remarks, reach = [*settings.remarks], settings.machine.bed_radius_mm - _MARGIN_MM
    changes = [(0, settings.machine)]  # line, and the machine with the settings from there on
    # Line, x, y and height of each touch.
    circle, bed = list[Sequence[float]](), list[Sequence[float]]()
    calibrating, printed_radius = False, math.nan  # the radius of G33's circle [mm]
    for number, line in enumerate(document.text.split("\n"), start=1):
        calibrating |= _CALIBRATES in line
        with faults.noting(number, value=line.strip()):
            if match := _BED.search(line):
                x, y, height = map(within, match.groups())
                bed.append((number, x - offset[0], y - offset[1], height))
            if calibrating and (match := _AT_RADIUS.search(line)):
                printed_radius = within(match[1], 0.0)
            if calibrating and (match := _RESULTS.search(line)):
                radius = reach if math.isnan(printed_radius) else printed_radius
                for name, text in _RESULT.findall(match[1]):
                    turn, away = math.radians(_TURNS.get(name, 0.0)), radius * (name != "c")
                    at = away * math.cos(turn), away * math.sin(turn)
                    circle = [] if name == "c" else circle
                    circle.append((number, *at, within(text)))
            elif calibrating and (printed := _SETTING.findall(line)):
                before = changes[-1][1]
                words = words_of(before, True, offset[2])
                words |= {_PRINTED[name]: [within(text)] for name, text in printed}
                machine = _stated(before, words, True, offset[2])
                old, new = ((*m.active, *m.tower_angles_deg) for m in (before, machine))
                if not np.allclose(old, new, rtol=0.0, atol=_ROUNDED):
                    changes.append((number, machine))
    faults.check()
    end, now = changes[-1]
    if math.isnan(settings.probe[2]):
        remarks.append(Reason.of("m851_unknown"))
    if circle and math.isnan(printed_radius):
        if not reach > 0.0:
            fault, remedy = "G33 does not print where it probed.", "Name the machine file, with"
            raise InputError(fault, f"{remedy} bed_radius_mm: --machine", file=document.path)
        remarks.append(Reason.of("marlin_reach", reach_mm=reach, margin_mm=_MARGIN_MM))

    def stored(name: str, touches: Sequence[Sequence[float]]) -> Readings:
        """Touches with the settings of the last of them, counted from those at the end."""
        since, then = [change for change in changes if change[0] < touches[-1][0]][-1]
        placed = np.array([touch for touch in touches if touch[0] > since])
        mesh = stored_mesh(document.source, placed, offset[2])
        if then is now:
            return mesh
        remarks.append(Reason.of("converted", name=name, line=end))
        try:
            place = now.believed(then, mesh.plan.spots)
        except PostureError as error:
            fault = f"The arms cannot reach a place of {name}."
            remedy = "Check the settings (M503, or the machine file)."
            raise InputError(fault, remedy, file=document.path, line=int(mesh.line[0])) from error
        moved = np.column_stack((mesh.line, place - [0.0, 0.0, offset[2]]))
        return stored_mesh(document.source, moved, offset[2])

    probed = {"calibration": ("G33", circle), "mesh": ("G29", bed)}
    data = {kind: stored(name, touches) for kind, (name, touches) in probed.items() if touches}
    if not data:
        fault, remedy = "holds no probed heights with their places", "Send G29 V4"
        if calibrating:
            fault, remedy = "has no heights: G33 was not told to print them", "Send G33 V0 or V3"
        remedy += ", and give all the lines that it prints."
        raise InputError(f"Marlin's output {fault}.", remedy, file=document.path)
    return replace(settings, machine=now, probe=offset, data=data, remarks=tuple(remarks))


# --- heights in lines of other consoles ---------------------------------------------------------

REPETIER_MAP = re.compile(r"\bG33 X(\S+) Y(\S+) Z(\S+)")
PROBE_HEIGHTS = re.compile(r"\bbed probe heights:((?: +[-+]?[0-9.]+\b)+)", re.IGNORECASE)
_PLACE = re.compile(r"^[^;\n]*\bG30 P([0-9]+) X(\S+) Y(\S+)", re.MULTILINE | re.IGNORECASE)


def read_listed(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings, and what was printed as their mesh: Repetier's map, without its corners, which
    are made up; or the last heights of RepRapFirmware, at the places of G30 P….

    Raises InputError: no number, no place on the bed, or no places in the text and bed.g.
    """
    text, faults = document.text, Content(document)
    offset, remarks, reach = np.nan_to_num(settings.probe), settings.remarks, math.inf
    lines = [(text.count("\n", 0, m.start()) + 1, m.groups()) for m in REPETIER_MAP.finditer(text)]
    if lines:
        remarks += (Reason.of("map_height_unknown"),)
        reach = settings.machine.bed_radius_mm
    else:
        match = [*PROBE_HEIGHTS.finditer(text)][-1]
        line, heights = text.count("\n", 0, match.start()) + 1, match[1].split()
        bed = document.beside("bed.g")
        listed = _PLACE.findall(text + (bed.text if bed else ""))
        places = {int(number): place for number, *place in listed}
        if not places.keys() >= set(range(len(heights))):
            fault = f"RepRapFirmware's console prints {len(heights)} heights without their places."
            remedy = "Put bed.g, whose lines G30 P… have them, in the same folder."
            raise InputError(fault, remedy, file=document.path, line=line)
        lines = [(line, (*places[number], height)) for number, height in enumerate(heights)]
    rows = []
    for line, parts in lines:
        with faults.noting(line, value=" ".join(parts)):
            x, y, height = map(within, parts)
            if not math.hypot(x, y) > reach:
                rows.append((line, x - offset[0], y - offset[1], height))
    if not rows and not faults.problems:
        faults.add("No place of the map is on the bed.", "Check the radius of the bed.")
    faults.check()
    data = {"mesh": stored_mesh(document.source, np.array(rows), offset[2])}
    return replace(settings, probe=offset, data=data, remarks=remarks)
