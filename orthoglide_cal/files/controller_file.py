"""A controller's own file: the values of a calibration found where they stand, changed, restored.

LinuxCNC's INI has `HOME_OFFSET` in `[JOINT_0..2]`, in its `LINEAR_UNITS`; which axis a joint is
follows from the `coordinates` of its `KINEMATICS`. Of a section or an option that is given twice it
reads the first, and what `#INCLUDE` puts there.

A joint may have a table, `COMP_FILE`: what is added to the motor, over position and direction. Type
1: lines of three numbers, ascending: position, what is added moving +, and moving -. Between lines
it is linear, beyond the first and last it stays. With a table `BACKLASH` is ignored. A joint with a
switch counts from what the table adds there, a joint homed at once does not: a table that is zero
at HOME_OFFSET, in the direction in which the switch is latched, means the same to both.

Klipper's printer.cfg has the parameters of a delta in the block that SAVE_CONFIG wrote;
position_endstop is the height of the nozzle, in the middle, at which it triggers.

Only these values change: every other byte stays, and so do line ends, encoding, file mode and
links. `halcmd` (its manual page) sets the home offsets of a LinuxCNC that runs on this computer;
nothing here can move a machine.
"""

import hashlib
import math
import re
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePath
from typing import ClassVar, Literal

import numpy as np

from orthoglide_cal.causes import CAUSES, correcting
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files import moonraker
from orthoglide_cal.files.klipper import Options, Settings
from orthoglide_cal.files.text import FileText, document_from_bytes, read_bytes, write_text
from orthoglide_cal.files.tree import Content
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Corrections, Machine, Written, WrittenTable, WrittenValue
from orthoglide_cal.model.model import Cause, Effect, Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import MM_PER_INCH, plain

Sizes = Mapping[str, float]
Places = Mapping[str, tuple[str, str]]  # name of a setting → its section and option
# Lines that are replaced, and all of a change: what is recorded of it, and the bytes then.
Lines = Sequence[WrittenValue]
Change = tuple[Written, bytes]

_SECTION = re.compile(r"\s*\[([^\]]*)\]")
_ENTRY = re.compile(r"\s*(\w+)\s*(?:=|(?=:))\s*(.*?)\s*", re.ASCII)
_NUMBER = re.compile(r"[-+]?([0-9]{1,6}(\.[0-9]{0,12})?|\.[0-9]{1,12})")
# Of more digits it may be infinite.
_ANY_NUMBER = re.compile(r"[-+]?([0-9]{1,20}(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]{1,2})?")
_UNITS = {"mm": 1.0, "metric": 1.0, "in": MM_PER_INCH, "inch": MM_PER_INCH, "imperial": MM_PER_INCH}
_JOINT = re.compile(r"\[JOINT_([0-9])\].*")
_COORDINATES = re.compile(r"\bcoordinates\s*=\s*[\"']?(\w+)", re.IGNORECASE)
# Kinematics whose joints are no three rails that cross.
_OTHERS = re.compile(
    "(delta|corexy|scara|puma|penta|tripod|genhex|genser|rose|rotate|max|5axis)kins", re.IGNORECASE
)
# An included file with a section changes what the lines behind it belong to.
_INCLUDED = re.compile(
    r"^\s*(\[|#INCLUDE|(KINEMATICS|LINEAR_UNITS|HOME_OFFSET|HOME_\w+_VEL|(MIN|MAX)_LIMIT|BACKLASH"
    r"|COMP_FILE(_TYPE)?)\b)",
    re.MULTILINE,
)
_ADD = "Write {1} = {2} once in [{0}], no comment behind it; included files are not read."
# What is read of a [JOINT_n] besides its home offset; what is not there counts as 0.
_FILE, _TYPE, _BACKLASH = "COMP_FILE", "COMP_FILE_TYPE", "BACKLASH"
_LATCH, _SEARCH = "HOME_LATCH_VEL", "HOME_SEARCH_VEL"
_OPTIONS = (_FILE, _TYPE, _BACKLASH, _SEARCH, _LATCH, "MIN_LIMIT", "MAX_LIMIT")
_MOST_LINES = 256  # of a table
_FARTHEST_MM = 1e5
_BEYOND_MM = 1000.0  # half the length of a table where no limits are given
SAVED = {"radius": ("printer", "delta_radius")}
for _tower, _section in ((tower, f"stepper_{tower}") for tower in "abc"):
    SAVED |= {f"angle_{_tower}": (_section, "angle"), f"arm_{_tower}": (_section, "arm_length")}
    SAVED[_tower] = _section, "position_endstop"
_PITCHES = {f"pitch_{tower}": (f"stepper_{tower}", "rotation_distance") for tower in "abc"}
_NEEDED = {*AXES, *SAVED}
_SAVE = (
    "Run DELTA_CALIBRATE and SAVE_CONFIG once: Klipper then keeps it in its block. If it is in"
    " both places, delete the upper line."
)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _from_above(value: WrittenValue) -> tuple[int, bool]:
    """Order in a file: a line put above another comes before it."""
    return value.line, bool(value.before)


def _alike(one: str, other: str) -> bool:
    """True if two values are the same, as numbers to 0.1 µm: printers round there."""
    with suppress(ValueError):
        return abs(float(one) - float(other)) <= 1e-4
    return one == other


@dataclass(frozen=True)
class ControllerFile(ABC):
    """Content of a controller's file."""

    target: str  # its path or address, the same whichever way it was named
    data: bytes
    settings: Mapping[str, WrittenValue]  # by parameter; of a joint also "x BACKLASH" and others
    remarks: tuple[Reason, ...] = ()  # what to know before it is written
    format: ClassVar[str]  # whose the file is, as an export names it

    @abstractmethod
    def hindrance(self, cause: Cause, machine: Machine) -> Literal["", "no_place", "no_origin"]:
        """Why it cannot take a cause away; "" where it has a place for what does."""

    @abstractmethod
    def changed(self, model: Model, changes: Sizes, causes: Corrections, digits: int) -> Change:
        """Enter changes of the calibrated parameters [mm, deg], and correct causes of these sizes.

        Raises InputError, UsageError: the file would not be as its controller reads it.
        """

    def corrects(self, machine: Machine) -> list[str]:
        """Ids of the causes that it can take away."""
        return [id for id, cause in CAUSES.items() if not self.hindrance(cause, machine)]

    def running(self) -> str | None:
        """None if no LinuxCNC runs on this computer, or the file is of another controller; "" if
        one has this INI and the offsets it holds. Else why nothing is set there, in a sentence."""
        return None

    @property
    def sha256(self) -> str:
        return _digest(self.data)

    def restored(self, written: Written) -> Change:
        """The way back: the bytes as they were before it was written, to the last one.

        Raises UsageError, with what differs, if the file is not what was written any more.
        """
        back, inserted = list[WrittenValue](), 0
        for value in sorted(written.values, key=_from_above):
            line = value.line + inserted
            back.append(value.changed(line=line, before=value.after, after=value.before))
            inserted += not value.before
        then, data = self._replaced(back, written.tables)
        if (self.sha256, then.sha256_after) == (written.sha256_after, written.sha256_before):
            return then, data
        other = "The values are the same; something else in it was changed."
        differs = self.differing({value.key: value.after for value in written.values}) or other
        by_hand = ", ".join(f"{v.key} = {v.before or '(no line)'}" for v in written.values)
        problem = f"{self.target} was changed since it was written. {differs}"
        raise UsageError(problem, f"Nothing was changed. Restore these values by hand: {by_hand}")

    def differing(self, expected: Mapping[str, str]) -> str:
        """Values, by their keys there, that are others than these, in words; "" for none."""
        held = {value.key: value.before for value in self.settings.values()}
        return " ".join(
            f"{key} holds {held.get(key, 'nothing')} instead of {value}."
            for key, value in expected.items()
            if not _alike(held.get(key, ""), value)
        )

    def _entered(self, name: str, new: float, decimals: int) -> Lines:
        """The line of a setting with another value; none where it stays."""
        stands = self.settings[name]
        if abs(new - float(stands.before)) < 0.5 * 10.0**-decimals:
            return []
        return [self._line(name, new, max(decimals, len(stands.before.partition(".")[2])))]

    def _line(self, name: str, new: float, decimals: int) -> WrittenValue:
        """The line of a setting with a new value. Raises UsageError: it could not be read again."""
        stands, after = self.settings[name], plain(new, decimals)
        if not _NUMBER.fullmatch(after):
            problem = f"{self.target}: {stands.key} would become {after}."
            raise UsageError(problem, f"Check the value there, {stands.before}.")
        return stands.changed(after=after)

    def _replaced(self, values: Lines, tables: Sequence[WrittenTable] = ()) -> Change:
        """The change that puts other values into some lines."""
        lines = self.data.splitlines(keepends=True)
        for value in sorted(values, key=_from_above)[::-1]:
            index = value.line - 1
            if index >= len(lines):
                continue  # somebody removed it since
            if not value.before:
                end = lines[index - 1][len(lines[index - 1].rstrip(b"\r\n")) :]
                option = value.key.partition("] ")[2]
                lines.insert(index, f"{option} = {value.after}".encode() + end)
            elif not value.after:
                del lines[index]
            else:
                # Behind the sign: what stands before it may hold the same digits.
                key, *rest = re.split(rb"(?<=[:=])", lines[index], maxsplit=1)
                after = b"".join(rest).replace(value.before.encode(), value.after.encode(), 1)
                lines[index] = key + after
        data = b"".join(lines)
        digests = {"sha256_before": self.sha256, "sha256_after": _digest(data)}
        edits = {"values": tuple(values), "tables": tuple(tables)}
        return Written(target=self.target, **digests, **edits), data


@dataclass(frozen=True)
class LinuxCnc(ControllerFile):
    """An INI of LinuxCNC: a change is added to what stands there, a table takes a cause away."""

    unit_mm: float = 1.0  # length of the unit of its values [mm]
    format = "linuxcnc"

    def hindrance(self, cause: Cause, machine: Machine) -> Literal["", "no_place", "no_origin"]:
        """A table takes what acts by joint; a correction that changes with the position needs to
        know where the isotropic posture is."""
        if not cause.by_joint:
            return "no_place"
        known = all(self._origin_mm(axis, machine.home_mm) is not None for axis in AXES)
        return "no_origin" if cause.with_travel and not known else ""

    def changed(self, model: Model, changes: Sizes, causes: Corrections, digits: int) -> Change:
        effects = correcting(model.machine, causes)
        digits += 2 if self.unit_mm > 1.0 else 0
        values, tables = list[WrittenValue](), list[WrittenTable]()
        for axis, change in changes.items():
            if any(axis in sizes for sizes in causes.values()):
                lines, table = self._tabulated(axis, change, effects, model.machine, digits)
                values += lines
                tables.append(table)
            else:
                new = float(self.settings[axis].before) + change / self.unit_mm
                values += self._entered(axis, new, digits)
        return self._replaced(values, tables)

    def _number(self, axis: str, option: str) -> float:
        line = self.settings.get(f"{axis} {option}")
        return float(line.before) if line else 0.0

    def _limits_mm(self, axis: str) -> tuple[float, float] | None:
        """Lowest and highest position; None where there are none, such as 1e99."""
        low, high = (self.unit_mm * self._number(axis, f"{end}_LIMIT") for end in ("MIN", "MAX"))
        return (low, high) if -_FARTHEST_MM < low < high < _FARTHEST_MM else None

    def _origin_mm(self, axis: str, home_mm: float) -> float | None:
        """Machine's joint value where this joint says 0: it counts either from there, or from the
        isotropic posture. None where its limits do not tell which."""
        low, high = self._limits_mm(axis) or (0.0, 0.0)
        if (low < home_mm < high) == (low < 0.0 < high):
            return None
        return 0.0 if low < home_mm < high else home_mm

    def _existing(self, axis: str) -> Floats:
        """Rows of the table that stands there, or that stands for BACKLASH, (n, 3) [its unit]."""
        half, line = 0.5 * self._number(axis, _BACKLASH), self.settings.get(f"{axis} {_FILE}")
        if line is None:
            return np.array([[float(self.settings[axis].before), half, -half]])
        path, rows = str(Path(self.target).parent / line.before), list[list[float]]()
        for number, text in enumerate(read_bytes(path).decode("latin-1").splitlines(), 1):
            words = text.split()
            row = [float(word) for word in words if _ANY_NUMBER.fullmatch(word)]
            if not len(row) == len(words) == 3 or (rows and row[0] <= rows[-1][0]):
                problem = "LinuxCNC ignores it, or the rest: not 3 numbers, or not ascending."
                remedy = "Correct the table, or remove COMP_FILE from the INI."
                raise InputError(problem, remedy, file=path, line=number, value=text)
            rows.append(row)
        if not rows:
            raise InputError("The table is empty.", "Remove COMP_FILE.", file=path)
        table = np.array(rows)
        if self._number(axis, _TYPE) == 0.0:  # it has the positions that were reached
            table[:, 1:] = table[:, :1] - table[:, 1:]
        return table

    def _tabulated(
        self, axis: str, change_mm: float, effects: Iterable[Effect], machine: Machine, digits: int
    ) -> tuple[Lines, WrittenTable]:
        """Lines of the INI, and a new table beside it, that add corrections to what is there."""
        unit, table, line = self.unit_mm, self._existing(axis), self.settings[axis]
        old, latch = float(line.before), self._number(axis, _LATCH)
        way, home_mm = int(latch < 0.0), machine.home_mm
        origin = self._origin_mm(axis, home_mm) or 0.0

        def added(at: Floats) -> Floats:
            """Over positions of the joint (n,), moving + and moving -, shape (2, n) [mm]."""
            parts = [e.cause.correction(-e.theta, at + origin, home_mm) for e in effects]
            return np.asarray(np.sum(parts, axis=0)[..., AXES.index(axis)])

        def stands(at: Floats) -> Floats:
            return np.stack([np.interp(at, table[:, 0], table[:, k]) for k in (1, 2)])

        # True position at the switch, or where a joint without one is homed.
        here = np.array([old])
        home = old + (change_mm - float(added(here * unit)[way, 0])) / unit
        if latch == self._number(axis, _SEARCH) == 0.0:
            home -= float(stands(here)[way, 0])
        home = round(home, min(digits, 6))
        ends = self._limits_mm(axis) or (home * unit - _BEYOND_MM, home * unit + _BEYOND_MM)
        # What stands there belongs to the screw, which a new home offset counts otherwise.
        table[:, 0] += home - old
        at = np.unique(np.round([*table[:, 0], *(end / unit for end in ends), home, old], 6))
        values = stands(at) + added(at * unit) / unit
        values = np.round(values - values[way, at == home], 8) + 0.0  # no negative zero
        rows = np.column_stack([at, *values]).tolist()
        existing = self.settings.get(f"{axis} {_FILE}")
        if len(rows) > _MOST_LINES:
            problem = f"The table of this joint would have {len(rows)} lines; LinuxCNC takes 256."
            raise UsageError(problem, f"Shorten {existing.before if existing else _FILE}.")
        text = "".join("{:.6f} {:.8f} {:.8f}\n".format(*row) for row in rows)
        digest = _digest(text.encode())
        section = line.key.partition(" ")[0]
        name = f"{section[1:-1].lower()}-{digest[:8]}.comp"
        wanted = {_FILE: name, _TYPE: "1"}
        if f"{axis} {_BACKLASH}" in self.settings and not existing:
            wanted[_BACKLASH] = "0"
        lines = [self._line(axis, home, digits)]
        for option, after in wanted.items():
            # A new line stands above the home offset, where a line surely ends.
            above = WrittenValue(line=line.line, key=f"{section} {option}")
            stood = self.settings.get(f"{axis} {option}", above)
            if stood.before != after:
                lines.append(stood.changed(after=after))
        path = str(Path(self.target).parent / name)
        return lines, WrittenTable(path=path, sha256=digest, text=text)

    def running(self) -> str | None:
        if self.is_live():
            return ""
        if (path := running_ini()) is None:
            return None
        other = "home offsets than its INI" if str(path) == self.target else f"settings, {path}"
        return f"A LinuxCNC runs on this computer with other {other}: nothing is set there."

    def is_live(self, *, anew: bool = False) -> bool:
        """True if a LinuxCNC on this computer has this INI and these home offsets, by `halcmd`.

        With `anew` they are set before; they are in force at the next homing.
        """
        if str(running_ini()) != self.target:  # nor one whose INI nobody can tell
            return False
        held = [self.settings[axis] for axis in AXES]
        pins = {_JOINT.sub(r"ini.\1.home_offset", value.key): value.before for value in held}
        lines = [f"setp {pin} {offset}\n" for pin, offset in pins.items() if anew]
        lines += [f"getp {pin}\n" for pin in pins]
        try:
            run = subprocess.run(
                ["halcmd", "-f"],
                input="".join(lines), capture_output=True, text=True, check=True, timeout=5.0,
            )  # fmt: skip
            stands = np.array(run.stdout.split(), float)
            return np.allclose(stands, np.array([*pins.values()], float), rtol=1e-6, atol=1e-6)
        except (OSError, subprocess.SubprocessError, ValueError):
            return False


class Klipper(ControllerFile):
    """A printer.cfg: a new value stands in the place of the old one."""

    format = "klipper"

    def hindrance(self, cause: Cause, machine: Machine) -> Literal["", "no_place", "no_origin"]:
        """Arms have a place, and what grows with the travel alone: rotation_distance."""
        turned = cause.with_travel and _PITCHES.keys() <= self.settings.keys()
        return "" if turned or cause.id in machine.fixed_parameters else "no_place"

    def changed(self, model: Model, changes: Sizes, causes: Corrections, digits: int) -> Change:
        corrected = correcting(model.machine, causes)
        known = {effect.cause.id for effect in model.accepted}
        named = [e.cause.at(-e.theta) for e in corrected if e.cause.id not in known]
        new = firmware_machine(model.extended(named), [*changes.values()])
        values, home = printer_values(new), new.home_mm
        carriages = zip(_PITCHES, "abc", new.endstop_carriages_mm.tolist(), strict=True)
        for effect in (e for e in corrected if e.cause.with_travel):
            for share, (pitch, tower, stands) in zip(effect.theta.tolist(), carriages, strict=True):
                values[pitch] = (1.0 - share) * float(self.settings[pitch].before)
                # The carriage stands elsewhere at its endstop then.
                values[tower] -= share * (stands - home)
        lines = (self._entered(name, value, digits) for name, value in values.items())
        return self._replaced([*chain.from_iterable(lines)])


def firmware_machine(model: Model, changes: Sequence[float]) -> LinearDelta:
    """The machine as its firmware is to have it, with these changes of its calibrated parameters,
    (6,) [mm, deg], and arms that were accepted as longer."""
    machine = LinearDelta.require(model.machine)
    *endstops, radius, angle_a, angle_b = np.add(machine.active, changes).round(9).tolist()
    angles = np.array([angle_a, angle_b, machine.tower_angles_deg[2]])
    longer = [e.theta for e in model.accepted if e.cause.id in machine.fixed_parameters]
    arms = np.array(machine.arm_length_mm) + sum(longer)
    return machine.having(arms, radius, angles, np.array(endstops))


def printer_values(machine: LinearDelta) -> dict[str, float]:
    """Settings of its firmware, by the names in `SAVED`."""
    towers = zip(machine.tower_angles_deg, machine.arm_length_mm, machine.endstops_mm, strict=True)
    return dict(zip(SAVED, (machine.delta_radius_mm, *chain.from_iterable(towers)), strict=True))


def controller_file(target: str) -> ControllerFile:
    """Content of the file at a path, or at the address of a Moonraker server.

    Raises InputError: it cannot be read, or is the file of no controller that is known here; or
    values are not where they can be changed, each with its line.
    """
    data = read_bytes(target)
    target = moonraker.server(target) or str(Path(target).resolve())
    text = "\n" + re.sub("\r\n?", "\n", data.decode("latin-1"))  # a byte is a character
    if re.search(r"\n\s*\[(JOINT_0|EMCMOT|TRAJ)\]", text):
        return _linuxcnc(target, data, text)
    if "\n[printer]" not in text.replace("\xef\xbb\xbf", "", 1):
        remedy = "Name LinuxCNC's INI with [JOINT_0], or Klipper's printer.cfg with [printer]."
        raise InputError("This is not the file of a known controller.", remedy, file=target)
    printer = Settings(document_from_bytes(data, target))
    printer.problems += printer.dropped
    printer.check()
    heading = printer.heading or math.inf
    settings = _values(printer, printer.options, SAVED | _PITCHES, _SAVE, heading)
    return Klipper(target, data, settings, (Reason.of("includes"),) * printer.included)


def _linuxcnc(target: str, data: bytes, text: str) -> LinuxCnc:
    """An INI, of its text after an empty line: a value has the number of its line.

    To LinuxCNC a comment behind a value is a part of it: with such a number it does not start.
    Behind a colon it reads nothing, nor in the lines that follow.
    """
    section, entries = "", Options(dict)
    content = Content(FileText(target, text, False, _digest(data)))
    for number, line in enumerate(text.split("\n")):
        if line.startswith("#INCLUDE"):
            path = Path(target).parent / Path(line.removeprefix("#INCLUDE").strip()).expanduser()
            inside = read_bytes(str(path)).decode("latin-1") if path.is_file() else None
            if inside is None or _INCLUDED.search(inside):
                problem = "LinuxCNC may read a value from this included file."
                remedy = "Put what stands in that file in the place of this line."
                raise InputError(problem, remedy, file=target, line=number, value=line.strip())
        elif head := _SECTION.match(line):
            section = "" if head[1] in entries else head[1]
            entries.setdefault(head[1], {})
        elif entry := _ENTRY.fullmatch(line):
            entries[section].setdefault(entry[1], (number, entry[2]))
    at, kins = entries["KINS"].get("KINEMATICS", (0, ""))
    coordinates = _COORDINATES.search(kins)
    letters = coordinates[1].lower() if coordinates else "".join(AXES)
    problem = remedy = ""
    if _OTHERS.search(kins):
        problem = "This LinuxCNC drives a machine of another kind."
        remedy = "Name the INI of this machine. For a delta: orthocal export --format linuxcnc"
    elif any(letters.count(axis) != 1 for axis in AXES):
        problem = "These coordinates do not give each of X, Y and Z one joint."
        remedy = "Enter the offsets by hand: orthocal export --format linuxcnc"
    if problem:
        raise InputError(problem, remedy, file=target, line=at, value=kins)
    joints = {axis: f"JOINT_{letters.index(axis)}" for axis in AXES}
    more = {f"{axis} {o}": (joint, o) for axis, joint in joints.items() for o in _OPTIONS}
    wanted = {axis: (joint, "HOME_OFFSET") for axis, joint in joints.items()}
    at, unit = entries["TRAJ"].get("LINEAR_UNITS", (0, ""))
    if unit.lower() not in _UNITS:
        problem = "This unit is unknown." if unit else "The value is missing."
        remedy = _ADD.format("TRAJ", "LINEAR_UNITS", "mm (or inch)")
        content.add(problem, remedy, at or None, "[TRAJ] LINEAR_UNITS", unit or None)
    settings = _values(content, entries, wanted | more, _ADD)
    return LinuxCnc(target, data, settings, unit_mm=_UNITS[unit.lower()])


def _values(
    content: Content, entries: Options, wanted: Places, advice: str, heading: float = 0
) -> dict[str, WrittenValue]:
    """The wanted values, below the heading of Klipper's block. Raises InputError."""
    values = dict[str, WrittenValue]()
    for name, (section, option) in wanted.items():
        key, needed = f"[{section}] {option}", name in _NEEDED
        number, value = entries[section].get(option, (None, ""))
        problem = ""
        if number is None:
            problem = "The value is missing." if needed else ""
        elif number <= heading and needed:
            problem = "This is above the SAVE_CONFIG block, so Klipper uses it first."
        elif not (_NUMBER if needed else _ANY_NUMBER).fullmatch(value) and option != _FILE:
            problem = "This is not a number."
        if problem:
            remedy = advice.format(section, option, "NUMBER")
            content.add(problem, remedy, number, key, value or None)
        elif number is not None:
            values[name] = WrittenValue(line=number, key=key, before=value)
    content.check()
    return values


def holds(target: str, sha256: str) -> bool:
    """True if a file, or the printer.cfg of a server, can be read and has this digest."""
    with suppress(InputError):
        return _digest(read_bytes(target)) == sha256
    return False


def replace_file(target: str, before: str, data: bytes) -> None:
    """Write a file, or the printer.cfg of a server, if it still has this digest, or is new.

    Raises UsageError: it was changed meanwhile, or the printer prints; InputError as `write_text`.
    """
    server = moonraker.server(target)
    if (server or Path(target).exists()) and _digest(read_bytes(target)) != before:
        raise UsageError(f"{target} was changed meanwhile.", "Give the command again.")
    if server:
        moonraker.upload(server, data)
    else:
        write_text(Path(target).resolve(), data, overwrite=True)


def running_ini() -> Path | None:
    """The INI of the LinuxCNC that runs on this computer; None if none runs, or nobody can tell."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError, IndexError):
            words = (process / "cmdline").read_bytes().decode().split("\0")
            if PurePath(words[0]).name == "linuxcncsvr":
                path = process / "cwd" / words[words.index("-ini") + 1]
                return Path(str(path.resolve()).removesuffix(".expanded"))
    return None
