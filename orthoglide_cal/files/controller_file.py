"""A controller's own file: the values of a calibration found where they stand, changed, restored.

LinuxCNC's INI has `HOME_OFFSET` in `[JOINT_0..2]`, in its `LINEAR_UNITS`; which axis a joint is
follows from the `coordinates` of its `KINEMATICS`. Of a section or an option that is given twice it
reads the first, and what `#INCLUDE` puts there. Klipper's printer.cfg has the parameters of a delta
in the block that SAVE_CONFIG wrote. Only these values change: every other byte stays, and so do
line ends, encoding, file mode and links. The file is a path, or the address of a Moonraker server.
"""

import codecs
import hashlib
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files import moonraker
from orthoglide_cal.files.comp_table import FILE as COMP_FILE
from orthoglide_cal.files.comp_table import OPTIONS, Added, JointTable
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.klipper import Options, Settings
from orthoglide_cal.files.text import document_from_bytes, read_bytes, write_text
from orthoglide_cal.model.cause import Cause
from orthoglide_cal.model.machine import Machine, Written, WrittenTable, WrittenValue
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import MM_PER_INCH, plain

_SECTION = re.compile(r"\s*\[([^\]]*)\]")
_ENTRY = re.compile(r"\s*(\w+)\s*(?:=|(?=:))\s*(.*?)\s*", re.ASCII)
_NUMBER = re.compile(r"[-+]?([0-9]{1,6}(\.[0-9]{0,12})?|\.[0-9]{1,12})")
_ANY_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)(e[-+]?[0-9]{1,2})?", re.IGNORECASE)
_UNITS = {"mm": 1.0, "metric": 1.0, "in": MM_PER_INCH, "inch": MM_PER_INCH, "imperial": MM_PER_INCH}
# What is read of a file → its section and option.
_UNIT = "unit"
_LINEAR_UNITS = ("TRAJ", "LINEAR_UNITS")
_COORDINATES = re.compile(r"\bcoordinates\s*=\s*[\"']?(\w+)", re.IGNORECASE)
# An included file with a section changes what the lines behind it belong to.
_INCLUDED = re.compile(
    r"^\s*(\[|#INCLUDE|(KINEMATICS|LINEAR_UNITS|HOME_OFFSET|HOME_\w+_VEL|(MIN|MAX)_LIMIT|BACKLASH"
    r"|COMP_FILE(_TYPE)?)\b)",
    re.MULTILINE,
)
_KLIPPER = {
    "radius": ("printer", "delta_radius"),
    **{f"angle_{tower}": (f"stepper_{tower}", "angle") for tower in "abc"},
    **{f"arm_{tower}": (f"stepper_{tower}", "arm_length") for tower in "abc"},
    **{tower: (f"stepper_{tower}", "position_endstop") for tower in "abc"},
}
_PITCHES = {f"pitch_{tower}": (f"stepper_{tower}", "rotation_distance") for tower in "abc"}
_HEADER = """
#*# <---------------------- SAVE_CONFIG ---------------------->
#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.
#*#
"""
_ADD = "Write {1} = {2} once in [{0}], no comment behind it; included files are not read."
_SAVE = (
    "Run DELTA_CALIBRATE and SAVE_CONFIG once: Klipper then keeps it in its block. If it is in"
    " both places, delete the upper line."
)


def _from_above(value: WrittenValue) -> tuple[int, bool]:
    """Order in a file: a line put above another comes before it."""
    return value.line, bool(value.before)


def _alike(one: str, other: str) -> bool:
    """Whether two values are the same, as numbers to 0.1 µm: printers round there."""
    with suppress(ValueError):
        return abs(float(one) - float(other)) <= 1e-4
    return one == other


@dataclass(frozen=True)
class ControllerFile:
    """What stands in a controller's file."""

    target: str  # its path or address, the same whichever way it was named
    data: bytes
    settings: Mapping[str, WrittenValue]  # by parameter; as they stand
    tables: Mapping[str, JointTable] = field(default_factory=dict)  # of LinuxCNC, by parameter
    unit_mm: float = 1.0  # length of the unit of its values [mm]
    format: str = "klipper"  # whose the file is, as an export names it
    remarks: tuple[Reason, ...] = ()  # what to know before it is written

    @property
    def adds(self) -> bool:
        """Whether a change is added to what stands there; otherwise the value replaces it."""
        return self.format == "linuxcnc"

    def hindrance(self, cause: Cause, machine: Machine) -> Literal["", "no_place", "no_origin"]:
        """Why it cannot take a cause away; "" where it has a place for what does.

        LinuxCNC's tables have one for what acts by joint; a correction that changes with the
        position needs to know where the isotropic posture is. Klipper has the arms, and
        rotation_distance for what grows with the travel alone.
        """
        if not cause.by_joint:
            known = not self.adds and cause.id in machine.fixed_parameters
            return "" if known else "no_place"
        up, down = cause.correction(np.ones(cause.unknowns), np.arange(3.0), 0.0)
        if not self.adds:
            grows = np.all(up == down) and np.all(up[0] == 0.0)
            known = f"pitch_{machine.parameter_names[0]}" in self.settings
            return "" if known and grows else "no_place"
        even = np.all((up == up[0]) & (down == down[0]))
        known = all(t.origin_mm(machine.home_mm) is not None for t in self.tables.values())
        return "" if known or even else "no_origin"

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    def changed(
        self,
        amounts: Mapping[str, float],
        decimals: int,
        added: Mapping[str, Added] = MappingProxyType({}),
    ) -> tuple[Written, bytes]:
        """What is replaced, for the record, and the bytes then.

        The amounts, with so many decimals, are what is added to each parameter, where the file adds
        [mm]; otherwise what is to stand there [mm, deg]. `added` is what a table adds to a joint.
        """
        values: list[WrittenValue] = []
        tables: list[WrittenTable] = []
        decimals += 2 if self.unit_mm > 1.0 else 0
        for name, amount in amounts.items():
            stands = self.settings[name]
            shown = max(decimals, len(stands.before.partition(".")[2]))
            if name in added:
                lines, table = self.tables[name].changed(added[name], amount, shown)
                values += lines
                tables.append(table)
                continue
            before = float(stands.before)
            new = before + amount / self.unit_mm if self.adds else amount
            if abs(new - before) >= 0.5 * 10.0**-decimals:
                after = plain(new, shown)
                if not _NUMBER.fullmatch(after):  # it could not be read again, nor restored
                    problem = f"{self.target}: {stands.key} would become {after}."
                    raise UsageError(problem, f"Check the value there, {stands.before}.")
                values.append(stands.changed(after=after))
        written, data = self._replaced(values)
        return written.changed(tables=tuple(tables)), data

    def restored(self, written: Written) -> bytes:
        """The bytes as they were before they were written, to the last one.

        Raises UsageError, with what differs, if the file is not what was written any more.
        """
        back, inserted = list[WrittenValue](), 0
        for value in sorted(written.values, key=_from_above):
            line = value.line + inserted
            back.append(value.changed(line=line, before=value.after, after=value.before))
            inserted += not value.before
        then, data = self._replaced(back)
        if (self.sha256, then.sha256_after) == (written.sha256_after, written.sha256_before):
            return data
        other = "The values are the same; something else in it was changed."
        differs = self.differing({value.key: value.after for value in written.values}) or other
        by_hand = ", ".join(f"{v.key} = {v.before or '(no line)'}" for v in written.values)
        problem = f"{self.target} was changed since it was written. {differs}"
        raise UsageError(problem, f"Nothing was changed. Restore these values by hand: {by_hand}")

    def differing(self, expected: Mapping[str, str]) -> str:
        """Which values, by their keys there, are others than these, in words; "" for none."""
        lines = (line for table in self.tables.values() for line in table.options.values())
        held = {value.key: value.before for value in (*self.settings.values(), *lines)}
        return " ".join(
            f"{key} holds {held.get(key, 'nothing')} instead of {value}."
            for key, value in expected.items()
            if not _alike(held.get(key, ""), value)
        )

    def _replaced(self, values: Sequence[WrittenValue]) -> tuple[Written, bytes]:
        """What is written with other values in some lines, for the record, and the bytes then."""
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
        then = replace(self, data=b"".join(lines))
        digests = {"sha256_before": self.sha256, "sha256_after": then.sha256}
        return Written(target=self.target, **digests, values=tuple(values)), then.data


def controller_file(target: str) -> ControllerFile:
    """What stands in a controller's file, of a path or of the address of a Moonraker server.

    Raises:
        InputError: it cannot be read, or is the file of no controller that is known here; or
            values are not where they can be changed, each with its line.
    """
    data = read_bytes(target)
    target = moonraker.server(target) or str(Path(target).resolve())
    text = "\n" + re.sub("\r\n?", "\n", data.decode("latin-1"))  # a byte is a character
    if re.search(r"\n\s*\[(JOINT_0|EMCMOT|TRAJ)\]", text):
        _check_included(target, text)
        entries = _entries(text)
        sections = {axis: f"JOINT_{joint}" for axis, joint in _joints(target, entries).items()}
        wanted = {axis: (section, "HOME_OFFSET") for axis, section in sections.items()}
        more = {f"{axis} {o}": (section, o) for axis, section in sections.items() for o in OPTIONS}
        values = _values(target, entries, {**wanted, _UNIT: _LINEAR_UNITS, **more}, 0, more)
        unit_mm = _UNITS[values[_UNIT].before.lower()]
        settings, tables = {axis: values[axis] for axis in sections}, {}
        for axis, home in settings.items():
            options = {o: values[key] for o in OPTIONS if (key := f"{axis} {o}") in values}
            tables[axis] = JointTable(target, home, options, unit_mm)
        return ControllerFile(target, data, settings, tables, unit_mm, "linuxcnc")
    if "\n[printer]" not in text.replace("\xef\xbb\xbf", "", 1):
        raise InputError(
            "This is not the file of a known controller.",
            "Name LinuxCNC's INI with [JOINT_0], or Klipper's printer.cfg with [printer].",
            file=target,
        )
    if data.startswith(codecs.BOM_UTF8):
        problem = "The file begins with a byte order mark: Klipper does not read it."
        raise InputError(problem, "Save it as UTF-8 without it.", file=target, line=1)
    above, header, _ = text.partition(_HEADER)
    heading = (above + header).count("\n") - 1 if header else len(text)
    for number, line in enumerate(text.rstrip().split("\n")):
        vain = "Because of this line {} its heading Klipper {} what SAVE_CONFIG wrote."
        if number <= above.count("\n") and line.startswith("#*#"):
            problem, remedy = vain.format("above", "drops"), "Delete it."
        elif number > heading and not re.match(r"#\*#( |$)", line):
            problem, remedy = vain.format("below", "ignores"), "Move it above the block."
        else:
            continue
        raise InputError(problem, remedy, file=target, line=number, value=line)
    printer = Settings(document_from_bytes(data, target))
    printer.check()
    values = _values(target, printer.options, _KLIPPER | _PITCHES, heading, _PITCHES)
    remarks = (Reason.of("includes"),) * printer.included
    return ControllerFile(target, data, values, remarks=remarks)


def _check_included(target: str, text: str) -> None:
    """Raise InputError for an included file that has what is looked for, or cannot be read."""
    for number, line in enumerate(text.split("\n")):
        if line.startswith("#INCLUDE"):
            path = Path(target).parent / Path(line.removeprefix("#INCLUDE").strip()).expanduser()
            inside = read_bytes(str(path)).decode("latin-1") if path.is_file() else None
            if inside is None or _INCLUDED.search(inside):
                problem = "LinuxCNC may read a value from this included file."
                remedy = "Put what stands in that file in the place of this line."
                raise InputError(problem, remedy, file=target, line=number, value=line.strip())


def _joints(target: str, entries: Options) -> dict[str, int]:
    """The joint of each axis. Raises InputError for axes of none or of several, and of a delta."""
    number, value = entries["KINS"].get("KINEMATICS", (0, ""))
    if "deltakins" in value.lower():
        problem, remedy = "This LinuxCNC drives a delta.", "Name the INI of this machine."
        raise InputError(problem, remedy, file=target, line=number, value=value)
    kins = _COORDINATES.search(value)
    letters = kins[1].lower() if kins else "".join(AXES)
    if any(letters.count(axis) != 1 for axis in AXES):
        problem = "These coordinates do not give each of X, Y and Z one joint."
        remedy = "Enter the offsets by hand: orthocal export --format linuxcnc"
        raise InputError(problem, remedy, file=target, line=number, value=value)
    return {axis: letters.index(axis) for axis in AXES}


def replace_file(target: str, before: str, data: bytes) -> None:
    """Write a file, or the printer.cfg of a server, if it still has this digest, or is new.

    Raises UsageError: it was changed meanwhile, or the printer prints; InputError as `write_text`.
    """
    server = moonraker.server(target)
    if (server or Path(target).exists()) and hashlib.sha256(
        read_bytes(target)
    ).hexdigest() != before:
        raise UsageError(f"{target} was changed meanwhile.", "Give the command again.")
    if server:
        moonraker.upload(server, data)
    else:
        write_text(Path(target).resolve(), data, overwrite=True)


def holds(target: str, sha256: str) -> bool:
    """Whether a file, or the printer.cfg of a server, has this digest; not if it cannot be read."""
    with suppress(InputError):
        return hashlib.sha256(read_bytes(target)).hexdigest() == sha256
    return False


def _entries(text: str) -> Options:
    """Section → option → line and value, as LinuxCNC reads them in a text after an empty line.

    To LinuxCNC a comment behind a value is a part of it: with such a number it does not start.
    Behind a colon it reads nothing, nor in the lines that follow.
    """
    section, entries = "", Options(dict)
    for number, line in enumerate(text.split("\n")):
        if head := _SECTION.match(line):
            section = "" if head[1] in entries else head[1]
            entries.setdefault(head[1], {})
        elif entry := _ENTRY.fullmatch(line):
            entries[section].setdefault(entry[1], (number, entry[2]))
    return entries


def _values(
    target: str,
    entries: Options,
    wanted: Mapping[str, tuple[str, str]],
    heading: int,
    optional: Collection[str] = (),
) -> dict[str, WrittenValue]:
    """The wanted values, below the heading of Klipper's block. Raises InputError."""
    faults, values = Faults(target), dict[str, WrittenValue]()
    for name, (section, option) in wanted.items():
        key, needed = f"[{section}] {option}", name not in optional
        number, value = entries[section].get(option, (None, ""))
        form, problem = _NUMBER if needed else _ANY_NUMBER, ""
        if number is None:
            problem = "The value is missing." if needed else ""
        elif number <= heading and needed:
            problem = "This is above the SAVE_CONFIG block, so Klipper uses it first."
        elif name == _UNIT and value.lower() not in _UNITS:
            problem = "This unit is unknown."
        elif name != _UNIT and option != COMP_FILE and not form.fullmatch(value):
            problem = "This is not a number."
        if problem:
            unit = "mm (or inch)" if name == _UNIT else "NUMBER"
            remedy = _SAVE if heading else _ADD.format(section, option, unit)
            faults.add(problem, remedy, line=number, column=key, value=value or None)
        elif number is not None:
            values[name] = WrittenValue(line=number, key=key, before=value, after=value)
    faults.check()
    return values
