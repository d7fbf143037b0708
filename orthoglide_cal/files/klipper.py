"""Klipper's printer.cfg and klippy.log, and the lines that its console prints while probing.

Of a linear delta only: sections [printer], [stepper_a … c], [probe], [delta_calibrate] and
[bed_mesh]; others may hold anything. Included files are not opened. A value goes on in lines that
are indented more than its option. "#" begins a remark anywhere, ";" after a blank. The file's own
lines win over those that SAVE_CONFIG wrote ("#*# …").

The log holds the configuration in force, and what each DELTA_CALIBRATE reckoned with. The console
has a line for each touch, with anything in front of it:

    probe at x,y is z=…                     the nozzle's place when the probe triggered
    probe: at x,y bed will contact at z=…   since 2025: the probe's, less its z offset

Options, units, defaults and messages: Klipper's documents "Configuration reference", "Delta
calibration" and "Bed Mesh".
"""

import itertools
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from orthoglide_cal.errors import InputError
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
from orthoglide_cal.files.tree import Content, Place, Steps
from orthoglide_cal.model.linear_delta import TOWERS_TURN, LinearDelta, counter_clockwise, touching
from orthoglide_cal.model.measured import NOZZLE, Readings
from orthoglide_cal.model.plan import Bools, Floats
from orthoglide_cal.schema import Reason, parse_count

T = TypeVar("T")
Entry = tuple[int, str]  # an option's line and text
Options = defaultdict[str, dict[str, Entry]]  # section → option → entry

_SAVED = "#*#"
_HEADING = """
#*# <---------------------- SAVE_CONFIG ---------------------->
#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.
#*#
"""
_SECTION = re.compile(r"\[(.+)\]")  # what follows the bracket is passed over
_OPTION = re.compile(r"([^:=]+?)\s*[:=]\s*(.*)")
_COMMENT = re.compile(r"#.*$|(?:^|(?<=\s));.*$")
_MOST = 1000  # steps of a turn, points of a mesh along one axis
_TOWERS = ("stepper_a", "stepper_b", "stepper_c")
# Probes that read while they move.
_SCANNING = re.compile("scanner|cartographer|beacon|idm|probe_eddy_current .+")
# Klipper's own, those of its descendants, and scanners that come with a module of their own.
_PROBE = re.compile(
    f"probe|bltouch|smart_effector|load_cell_probe|dockable_probe|{_SCANNING.pattern}"
)
_CALIBRATION = "delta_calibrate"
_DISTANCES = "distance"
# What is stored → the ends of the options with the stepper positions of it.
_POSITIONS = {"height": ("_pos",), "manual_height": ("_pos",), _DISTANCES: ("_pos1", "_pos2")}
_STORED = re.compile(rf"({'|'.join(_POSITIONS)})([0-9]{{1,6}})(|_pos[12]?)")
_PROFILE = "bed_mesh "
_MATTERS = re.compile(
    rf"printer|{'|'.join(_TOWERS)}|{_CALIBRATION}|bed_mesh|{_PROFILE}.*|{_PROBE.pattern}"
)
# Of [bed_mesh]: where the height of the mesh is set to zero.
_ZEROS = ("zero_reference_position", "relative_reference_index")
_AGAIN = "Probe the bed and save the mesh again."
_TRIMMED_MM = 0.02  # DELTA_CALIBRATE leaves stored heights right on the mean
_ROUNDED = 0.01  # mm, to which the spacing of a mesh is rounded down
_CONFIG = re.compile(r"=+ Config file =+\s*")
_CALCULATING = "Calculating delta_calibrate with:"
KLIPPY_LOG = re.compile(rf"^({_CONFIG.pattern}|{_CALCULATING}\s*)$", re.MULTILINE)
_ENDS = re.compile("={10,}")
_LOGGED = re.compile(r"(manual_)?height[0-9]+\s*[:=]")
_STEPS = r", \(([^,()]+, [^,()]+, [^,()]+)\)"
_LEVEL_MM = 0.5  # a nozzle that touches the bed itself stands this low when it does
PROBED = re.compile(r"probe(:?) at (\S+?), ?(\S+) (?:is|bed will contact at) z=(\S+)")


class Settings(Content):
    """The options in force; what is wrong with one is noted, never raised."""

    def __init__(self, document: FileText) -> None:
        super().__init__(document)
        lines = list(enumerate(document.text.rstrip().split("\n"), start=1))
        self.sections = dict[str, int]()  # name → line
        self.options = Options(dict)  # the text is in as many lines as there
        for saved in (True, False):
            part = ((line, text) for line, text in lines if text.startswith(_SAVED) == saved)
            self._parse((line, text.removeprefix(_SAVED)) for line, text in part)
        # Whether it includes other files, which are not read.
        self.included = any(name.startswith("include ") for name in self.sections)
        before, heading, _ = f"\n{document.text}".partition(_HEADING)
        self.heading = (before + heading).count("\n") - 1 if heading else 0  # its last line
        self.dropped = list(self._dropped(lines))
        self.remarks = list[Reason]()
        for first in self.dropped[:1]:
            same = [str(fault.line) for fault in self.dropped if fault.what == first.what]
            dropped = Reason.of("dropped", lines=same, what=first.what, remedy=first.remedy)
            self.remarks.append(dropped)

    def _dropped(self, lines: Iterable[Entry]) -> Iterator[InputError]:
        """Faults that keep Klipper from reading the file, or what SAVE_CONFIG wrote there."""
        if self.document.marked:
            fault = "The file begins with a byte order mark: Klipper does not read it."
            yield InputError(fault, "Save it as UTF-8 without it.", file=self.file, line=1)
        first = self.heading - _HEADING.count("\n") + 2  # line of the heading
        begun = False  # blank lines before what was saved do no harm
        for line, text in lines if self.heading else ():
            begun = begun or (line > self.heading and bool(text.strip()))
            stray = 1 < line < first and text.startswith("#*# ")
            if stray or (begun and not re.match(r"#\*#( |$)", text)):
                where = "above" if stray else "below"
                remedy = "Move it above the block." if text.strip() and begun else "Delete it."
                fault = f"Klipper drops SAVE_CONFIG's block: something stands {where} its heading."
                yield InputError(fault, remedy, file=self.file, line=line, value=text)

    def _parse(self, lines: Iterable[Entry]) -> None:
        """Take sections and options from lines; they win over those that were taken before."""
        sections = dict[str, int]()
        section, option, indented = "", "", 0  # no option where none can go on
        for line, raw in lines:
            text = _COMMENT.sub("", raw).rstrip()
            plain = text.lstrip()
            indent = len(text) - len(plain)
            if not plain:
                continue
            if option and indent > indented:
                start, value = self.options[section][option]
                goes_on = "\n" * (line - start - value.count("\n"))
                self.options[section][option] = start, value + goes_on + plain
                continue
            option, indented = "", indent
            if header := _SECTION.match(plain):
                section = header[1].strip()
                sections.setdefault(section, line)
            elif plain.startswith("["):
                section = ""
                fault = "The section's name has no closing bracket."
                self.add(fault, "Write [name].", line=line, value=plain)
            elif setting := _OPTION.match(plain):
                option = setting[1].lower()
                self.options[section][option] = line, setting[2]
            elif _MATTERS.fullmatch(section):
                fault = f"The line in [{section}] is not an option."
                remedy = "Write “option: value”, or “#” in front of a remark."
                self.add(fault, remedy, line=line, value=plain)
        self.sections |= sections

    def place(self, path: Steps) -> Place:
        """Place of an option, or of its section."""
        section, option = map(str, path)
        line, text = self.options[section].get(option, (self.sections.get(section), ""))
        return line, f"{option} of [{section}]", " ".join(text.split()) or None

    def missing(self, section: str, option: str, line: int | None = None) -> None:
        """The fault that an option is not there."""
        remedy = f"Add “{option}: …” to [{section}]."
        if self.included:
            remedy = f"Copy [{section}] from the included file into this one."
        there, column, _ = self.place((section, option))
        self.add("The option is missing.", remedy, line=line or there, column=column)

    def read(
        self, section: str, option: str, rule: Callable[[str], T], default: T | float | None = None
    ) -> T | float:
        """Value that a rule makes of an option; NaN if it is wrong: the rule raises InputError.

        The default is for one that is not there; None if it must be.
        """
        if entry := self.options[section].get(option):
            with self.noting(*self.place((section, option))):
                return rule(entry[1])
        elif default is None:
            self.missing(section, option)
        else:
            return default
        return math.nan

    def number(
        self, section: str, option: str, default: float | None = None, low: float = -LARGEST_MM
    ) -> float:
        """A number above `low`; NaN if it is wrong."""
        return self.read(section, option, lambda text: within(text, low), default)


def read_printer_file(
    document: FileText, calibration: dict[str, Entry] | None = None
) -> PrinterFile:
    """Content of a printer.cfg; `calibration` replaces its [delta_calibrate]: option → line, text.

    Raises InputError with everything that is wrong in the lines that matter here.
    """
    settings = Settings(document)
    settings.check()  # what follows from a broken line is no fault of its own
    if calibration is not None:
        settings.options[_CALIBRATION] = calibration
    kind = settings.options["printer"].get("kinematics", (0, ""))[1].strip()
    if kind and kind.lower() != "delta":
        fault = "The machine is not a linear delta."
        settings.note(("printer", "kinematics"), fault, "Give a delta's file.")
        raise settings.error()
    if not kind and not {"printer", *_TOWERS} & set(settings.sections):
        fault = "This is a part of a Klipper configuration: it has no [printer] and no [stepper_a]."
        remedy = "Give the printer.cfg of a delta."
        if settings.included:
            remedy = "Copy [printer] and [stepper_a … c] from the included files into this one."
        raise InputError(fault, remedy, file=settings.file)
    if not kind:
        settings.missing("printer", "kinematics")
    radius = settings.number("printer", "delta_radius", low=1.0)
    arms = _of_towers(settings, "arm_length", 0.0 if math.isnan(radius) else radius)
    endstops = _of_towers(settings, "position_endstop", -LARGEST_MM)
    angles = [
        settings.number(tower, "angle", default, low=-720.0)
        for tower, default in zip(_TOWERS, USUAL_ANGLES_DEG, strict=True)
    ]
    # The arms reach downwards only if the towers follow each other in one sense.
    if not any(map(math.isnan, angles)) and not counter_clockwise(angles):
        remedy = "Check the angles of the towers; they are usually near 210, 330 and 90."
        settings.note((_TOWERS[-1], "angle"), TOWERS_TURN, remedy)
    print_radius = settings.number("printer", "print_radius", radius, low=1.0)
    sensor = next(filter(_PROBE.fullmatch, settings.sections), "probe")
    probe = np.array([settings.number(sensor, f"{axis}_offset", 0.0) for axis in "xyz"])
    machine = delta_of(document, print_radius).having(arms, radius, np.array(angles), endstops)
    scanning = _SCANNING.fullmatch(sensor) is not None
    machine = machine.changed(probe=machine.probe.changed(scanning=scanning))
    both = {"calibration": _calibration(settings, machine), "mesh": _mesh(settings, sensor, probe)}
    settings.check()
    data = {name: readings for name, readings in both.items() if readings is not None}
    known = sorted(settings.options[_CALIBRATION].items())
    steps = " ".join(text for option, (_, text) in known if _STORED.match(option))
    return PrinterFile(machine, probe, document.source, data, tuple(settings.remarks), steps=steps)


def settings_beside(document: FileText) -> PrinterFile | None:
    """Settings of the printer.cfg in the same folder, without its data; None if there is none."""
    if (file := document.beside("printer.cfg")) is None:
        return None
    remark = Reason.of("settings_beside", names=["printer.cfg"])
    return replace(read_printer_file(file), data={}, remarks=(remark,))


def read_klippy_log(document: FileText) -> PrinterFile:
    """The last configuration of a log, with its calibration or what was probed. Raises InputError
    with everything that is wrong in the lines that matter here."""
    lines = document.text.split("\n")
    starts = [number for number, line in enumerate(lines, start=1) if _CONFIG.fullmatch(line)]
    if not starts:
        fault = "The log does not hold the configuration: its beginning is missing."
        remedy = "Give the whole klippy.log, or the printer.cfg."
        raise InputError(fault, remedy, file=document.path)
    start = starts[-1]
    inside = itertools.takewhile(lambda line: not _ENDS.fullmatch(line.strip()), lines[start:])
    kept = [""] * start + [*inside]
    calibrations = [number for number, line in enumerate(lines) if line.startswith(_CALCULATING)]
    unsaved = bool(calibrations) and calibrations[-1] > start
    calculated = None
    if calibrations and (unsaved or not any(map(_LOGGED.match, kept))):
        calculated = _calculated(document, lines, calibrations[-1])
    file = read_printer_file(replace(document, text="\n".join(kept)), calculated)
    if unsaved:
        remark = Reason.of("unsaved_calibration", line=calibrations[-1] + 1)
        file = replace(file, remarks=(*file.remarks, remark))
    if not file.data and PROBED.search(document.text):
        return read_probed(document, file)
    return file


def _calculated(document: FileText, lines: Sequence[str], at: int) -> dict[str, Entry]:
    """Heights and distances that a calibration reckoned with, as [delta_calibrate] stores them."""
    stored = {}
    for number, name in ((at + 1, "height"), (at + 2, _DISTANCES)):
        text = lines[number].strip() if number < len(lines) else ""
        entry = rf"\(([^,()]+){len(_POSITIONS[name]) * _STEPS}\)"
        if not re.fullmatch(rf"\[(?:{entry}(?:, |(?=\])))*\]", text):
            fault = f"This is not a list of {name}s with stepper positions."
            remedy = "Was the log cut off or changed? Give it as Klipper wrote it."
            raise InputError(fault, remedy, file=document.path, line=number + 1, value=text or None)
        for index, parts in enumerate(re.findall(entry, text)):
            for end, part in zip(("", *_POSITIONS[name]), parts, strict=True):
                stored[f"{name}{index}{end}"] = number + 1, part
    return stored


def read_probed(document: FileText, settings: PrinterFile) -> PrinterFile:
    """The settings, and the touches that Klipper printed as their mesh. Raises InputError."""
    faults, rows = Content(document), []
    for number, line in enumerate(document.text.split("\n"), start=1):
        for match in PROBED.finditer(line):
            with faults.noting(number, value=match[0]):
                rows.append((number, *map(within, match.group(2, 3, 4)), match[1] == ":"))
    faults.check()
    touches = np.array(rows)
    at, less = touches[:, 1:4], touches[:, 4] > 0.0  # whose z is less the offset
    offset, remarks = np.nan_to_num(settings.probe), settings.remarks
    usual = 0.0 if less.all() else float(np.median(at[~less, 2]))
    if offset[2] == 0.0 and abs(usual) > _LEVEL_MM:
        offset[2] = usual
        remarks += (Reason.of("probe_z_unknown"),)
    at[less, :2] -= offset[:2]
    at[~less, 2] -= offset[2]
    mesh = stored_mesh(document.source, touches[:, :4], offset[2])
    return replace(settings, probe=offset, data={"mesh": mesh}, remarks=remarks)


def _of_towers(settings: Settings, option: str, low: float) -> Floats:
    """A number of each tower, of the first where others have none."""
    first = settings.number(_TOWERS[0], option, low=low)
    others = (settings.number(tower, option, first, low) for tower in _TOWERS[1:])
    return np.array((first, *others))


def _step(settings: Settings, tower: str) -> float:
    """Way of a carriage with one step [mm]."""
    turn, old = "rotation_distance", "step_distance"  # the latter until 2021
    options = settings.options[tower]
    if turn not in options and old in options:
        return settings.number(tower, old, low=0.0)
    way = settings.number(tower, turn, low=0.0)
    steps = settings.read(tower, "full_steps_per_rotation", _count, 200)
    steps *= settings.read(tower, "microsteps", _count)
    return way / (steps * settings.read(tower, "gear_ratio", _gears, 1.0))


def _calibration(settings: Settings, machine: LinearDelta) -> Readings | None:
    """Probed heights, those entered by hand, and distances, at the places where the settings in
    force put the nozzle; None without heights, or after noting what is wrong."""
    options, starts = settings.options[_CALIBRATION], dict[tuple[bool, str, int], int]()
    for option, (line, _) in options.items():
        match = _STORED.fullmatch(option)
        if match and match[3] in ("", *_POSITIONS[match[1]]):
            starts.setdefault((match[1] == _DISTANCES, match[1], int(match[2])), line)
    if not starts:  # such a file need not say how long a step is
        return None
    step, stated, counts = [_step(settings, tower) for tower in _TOWERS], list[float](), []
    for (apart, name, number), line in sorted(starts.items()):
        stem, low = f"{name}{number}", 0.0 if apart else -LARGEST_MM
        stated.append(settings.number(_CALIBRATION, stem, math.nan, low))
        if stem not in options:
            settings.missing(_CALIBRATION, stem, line)
        ends = []
        for end in _POSITIONS[name]:
            if stem in options and stem + end not in options:
                fault = f"{stem} has no stepper positions: {stem}{end} is missing."
                remedy = "Run DELTA_CALIBRATE and SAVE_CONFIG again, or remove the line."
                settings.note((_CALIBRATION, stem), fault, remedy)
            ends.append(settings.read(_CALIBRATION, stem + end, _three, math.nan))
        counts.append([ends[0], ends[-1]])  # the same twice of a height
    distance = np.array([apart for apart, _, _ in sorted(starts)])
    if settings.problems or distance.all():
        return None
    joints = machine.endstop_carriages_mm - np.array(counts) * step  # at both ends, (n, 2, 3)
    place, other = machine.nominal_rails.tool_for(joints.swapaxes(0, 1), strict=False)
    value = np.array(stated)
    plan = touching(place, np.where(distance, 0.0, value), other=other, distance=distance)
    value = np.where(distance, value - plan.wanted, place[:, 2] - value)
    trimmed = float(np.mean(value[~distance]))
    # What the settings in force take for higher is reached lower down.
    moved = Reason.of(NOZZLE[trimmed < 0.0], mm=abs(trimmed))
    remarks = (moved,) if abs(trimmed) > _TRIMMED_MM else ()
    lines = np.array([line for _, line in sorted(starts.items())])
    return Readings(plan, value, lines, False, settings.document.source, remarks=remarks)


def _mesh(settings: Settings, sensor: str, probe: Floats) -> Readings | None:
    """The default mesh, else the first one; None without one, or after noting what is wrong."""
    profiles, options = [n for n in settings.sections if n.startswith(_PROFILE)], settings.options
    if not profiles:
        return None
    section = f"{_PROFILE}default" if f"{_PROFILE}default" in profiles else profiles[0]
    profile, remarks = section.removeprefix(_PROFILE).strip(), list[Reason]()
    # SAVE_CONFIG moves what DELTA_CALIBRATE found to the end; a mesh keeps its place.
    saved, _ = options[section].get("points", (math.inf, ""))
    calibration = options[_CALIBRATION].items()
    first = min((line for option, (line, _) in calibration if _STORED.match(option)), default=0)
    if first > saved:
        order = Reason.of("stale_by_line", calibration=first, mesh=saved)
        remarks.append(Reason.of("stale_mesh", order=order))
    unstated = [axis for axis in ("x_offset", "y_offset") if axis not in options[sensor]]
    if settings.included and unstated:
        remarks.append(Reason.of("offset_not_stated", options=unstated, sensor=sensor))
    for option, (line, _) in options["bed_mesh"].items():
        if option in _ZEROS:
            remarks.append(Reason.of("mesh_zero", line=line, option=option))
    x, y = (_grid(settings, section, axis) for axis in "xy")
    stated = settings.number("bed_mesh", "mesh_radius", 0.0, low=0.0)
    if "points" not in options[section]:
        settings.missing(section, "points")
    if settings.problems:
        return None
    start, points = options[section]["points"]
    texts = enumerate(points.split("\n"), start)
    rows = {line: text.split(",") for line, text in texts if text.strip()}
    stored = heights_in(settings, rows, (len(y), len(x)), _AGAIN, column=f"points of [{section}]")
    if settings.problems:
        return None
    probed = _probed(*np.meshgrid(x, y), stored, stated)
    # Old versions stored the offsets with the mesh, and the places of the nozzle.
    offset = probe * (0.0, 0.0, 1.0) if "x_offset" in options[section] else probe
    if padded := int(np.sum(~probed)):
        remarks.append(Reason.of("padded", count=padded, mesh=profile))
    heights = np.where(probed, stored, math.nan)
    mesh = stored_grid(settings.document.source, x, y, heights, [*rows], offset)
    return replace(mesh, remarks=tuple(remarks))


def _grid(settings: Settings, section: str, axis: str) -> Floats:
    """Places of a mesh along an axis [mm]; empty if they cannot be read."""
    low, high = (settings.number(section, f"{end}_{axis}") for end in ("min", "max"))
    count = settings.read(section, f"{axis}_count", _count)
    if low >= high:
        settings.note((section, f"max_{axis}"), "The mesh ends before it begins.", _AGAIN)
    return np.linspace(low, high, int(np.nan_to_num(count)))


def _probed(x: Floats, y: Floats, height: Floats, stated: float) -> Bools:
    """True for the points of a mesh that were probed, shape as the others.

    On a round bed they are those within the mesh radius; the rest of each row repeats its outermost
    one. Where the radius that is stated now does not fit the mesh, its own width decides, and
    whether the values repeat.
    """
    away = np.hypot(x - x.mean(), y - y.mean())
    width = np.ptp(x) / 2.0
    fits = -_ROUNDED <= stated - width <= _ROUNDED * x.shape[1]
    inside = away <= (stated if fits else width) + _ROUNDED

    def repeats(row: Floats, kept: Bools) -> bool:
        at, places = np.arange(len(row)), np.flatnonzero(kept)
        return places.size > 0 and np.array_equal(row, row[at.clip(places[0], places[-1])])

    return inside if fits or all(map(repeats, height, inside)) else np.ones_like(inside)


def _three(text: str) -> list[float]:
    """Stepper positions of the towers."""
    parts = text.split(",")
    if len(parts) != len(_TOWERS):
        raise InputError("These are not three stepper positions.", "Write a,b,c: one per tower.")
    return [within(part, -1e8, 1e8) for part in parts]


def _gears(text: str) -> float:
    """Turns of the motor for one of the pulley: "5:1, 80:16" is 25."""
    teeth = [pair.split(":") for pair in text.split(",")]
    if any(len(pair) != 2 for pair in teeth):
        raise InputError("This is not a gear ratio.", "Write 5:1, or 5:1, 80:16.")
    return math.prod(within(driven, 0.0) / within(driving, 0.0) for driven, driving in teeth)


def _count(text: str) -> int:
    value = parse_count(text, 1)
    if value > _MOST:
        raise InputError(f"The number is larger than {_MOST}.", "Check it.")
    return value
