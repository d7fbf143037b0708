"""A controller's own file: the values of a calibration found where they stand, changed, restored.

LinuxCNC's INI has `HOME_OFFSET` in `[JOINT_0..2]`, in its `LINEAR_UNITS`; Klipper's printer.cfg has
the parameters of a delta in the block that SAVE_CONFIG wrote. Only these values change: every other
byte stays, and so do line ends, encoding, file mode and links. The file is a path, or the address
of a Moonraker server.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files import moonraker
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.printer_settings import SAVED, Settings
from orthoglide_cal.files.text import document_from_bytes, read_bytes, write_bytes
from orthoglide_cal.model import AXES
from orthoglide_cal.model.machine import Written, WrittenValue
from orthoglide_cal.words import MM_PER_INCH, plain

_SECTION = re.compile(r"\s*\[([^\]]*)\]")
# Key, value, and the first character of what follows it if that is no remark.
_ENTRY = re.compile(r"\s*([A-Za-z_0-9]+)\s*=\s*(\S*)\s*([^#;\s]?)")
_UNITS = {"mm": 1.0, "metric": 1.0, "in": MM_PER_INCH, "inch": MM_PER_INCH, "imperial": MM_PER_INCH}
_OPTION = re.compile(r"(?:#\*#)?\s*[^:=]+?\s*[:=]\s*")
_NUMBER = re.compile(r"[-+]?([0-9]{1,6}(\.[0-9]{0,12})?|\.[0-9]{1,12})")
# What a delta's calibration determines, and its arms → section and option of printer.cfg.
_KLIPPER = {
    "radius": ("printer", "delta_radius"),
    **{f"angle_{tower}": (f"stepper_{tower}", "angle") for tower in "abc"},
    **{f"arm_{tower}": (f"stepper_{tower}", "arm_length") for tower in "abc"},
    **{tower: (f"stepper_{tower}", "position_endstop") for tower in "abc"},
}
_JOINTS = {f"JOINT_{number}": axis for number, axis in enumerate(AXES)}
_ROUNDED = 1e-4  # of a value in the file [mm, deg]
_HEADER = """
#*# <---------------------- SAVE_CONFIG ---------------------->
#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.
#*#
"""
_SAVE = (
    "Run DELTA_CALIBRATE and SAVE_CONFIG once: Klipper then keeps it in its block. If it is in"
    " both places, delete the upper line."
)


@dataclass(frozen=True)
class StoredValue:
    """One value in a controller's file.

    Attributes:
        key: where a person finds it, such as "[JOINT_0] HOME_OFFSET".
        line: counted from 1.
        start: of the value, bytes from the beginning of the file.
        text: the value as it stands there.
        own: whether it may be written; not above the block that Klipper writes.
    """

    key: str
    line: int
    start: int
    text: str
    own: bool = True


@dataclass(frozen=True)
class ControllerFile:
    """What stands in a controller's file.

    Attributes:
        target: its path or address, the same whichever way it was named.
        data: its bytes.
        settings: parameter → where it stands.
        unit_mm: length of the unit of its values [mm].
        adds: whether a change is added to what stands there; otherwise the value replaces it.
        remarks: what to know before it is written.
    """

    target: str
    data: bytes
    settings: Mapping[str, StoredValue]
    unit_mm: float = 1.0
    adds: bool = False
    remarks: tuple[str, ...] = ()

    @property
    def sha256(self) -> str:
        """Hex digest of the bytes."""
        return hashlib.sha256(self.data).hexdigest()

    def changed(self, amounts: Mapping[str, float], decimals: int) -> tuple[Written, bytes]:
        """The file with other values.

        Args:
            amounts: parameter → what is added, where the file adds [mm]; otherwise what is to stand
                there [mm, deg].
            decimals: of them.

        Returns:
            What is replaced, for the record, and the bytes.

        Raises:
            InvalidFileError: a value is not where it can be changed; each with its line.
        """
        replaced, faults = [], Faults(self.target)
        decimals += 2 if self.unit_mm > 1.0 else 0
        for name, amount in amounts.items():
            setting = self.settings.get(name)
            if setting is None:
                section, option = _KLIPPER[name]
                faults.add("The option is missing.", _SAVE, column=f"{option} of [{section}]")
                continue
            line, key, before = setting.line, setting.key, setting.text
            new = float(before) + amount / self.unit_mm if self.adds else amount
            if abs(new - float(before)) < 0.5 * 10.0**-decimals:
                continue
            if not setting.own:
                what = "This is above the SAVE_CONFIG block, so Klipper uses it first."
                faults.add(what, _SAVE, line=line, column=key, value=before)
            after = plain(new, max(decimals, len(before.partition(".")[2])))
            replaced.append(WrittenValue(line=line, key=key, before=before, after=after))
        faults.check()
        data = self.with_values({each.key: each.after for each in replaced})
        digests = {"sha256_before": self.sha256, "sha256_after": hashlib.sha256(data).hexdigest()}
        return Written(target=self.target, **digests, values=tuple(replaced)), data

    def restored(self, written: Written) -> bytes:
        """The file as it was before it was written, to the last byte.

        Raises:
            UsageError: it is not what was written any more; with what differs.
        """
        data = self.with_values({each.key: each.before for each in written.values})
        digests = self.sha256, hashlib.sha256(data).hexdigest()
        if digests == (written.sha256_after, written.sha256_before):
            return data
        now = {each.key: each.text for each in self.settings.values()}
        lines = [
            f"{each.key} holds {now.get(each.key, 'nothing')}; {each.after} was written."
            for each in written.values
            if now.get(each.key) != each.after
        ]
        raise UsageError(
            f"{self.target} was changed since it was written. "
            + (" ".join(lines) or "The values are the same; something else in it was changed."),
            "Nothing was changed. Restore these values by hand: "
            + ", ".join(f"{each.key} = {each.before}" for each in written.values),
        )

    def check(self, expected: Mapping[str, float], since: str) -> None:
        """The file holds these values.

        Args:
            expected: parameter, or key there → value.
            since: what the values are known from, such as "this was measured with".

        Raises:
            UsageError: it does not: what was measured is about other values.
        """
        known = {**self.settings, **{each.key: each for each in self.settings.values()}}
        for name, value in expected.items():
            setting = known.get(name)
            if setting is None or abs(float(setting.text) - value) > _ROUNDED:
                held = f"{setting.key} holds {setting.text}" if setting else f"{name} is missing"
                raise UsageError(
                    f"{self.target}: {held}; {since} {value:g}. Somebody changed it since.",
                    "Restore it, or measure again with the present values.",
                )

    def with_values(self, values: Mapping[str, str]) -> bytes:
        """The bytes with other texts of some values, each by its key."""
        data = self.data
        for setting in sorted(self.settings.values(), key=lambda each: -each.start):
            if setting.key in values:
                end = setting.start + len(setting.text)
                data = data[: setting.start] + values[setting.key].encode() + data[end:]
        return data


def controller_file(target: str) -> ControllerFile:
    """What stands in a controller's file.

    Args:
        target: path, or address of a Moonraker server.

    Raises:
        InvalidFileError: values are missing, or there twice; each with its line.
        InputError: it cannot be read, or is the file of no controller that is known here.
    """
    data, server = read_bytes(target), moonraker.is_address(target)
    target = moonraker.base(target) if server else str(Path(target).resolve())
    if re.search(rb"(?m)^\s*\[(JOINT_0|EMCMOT|TRAJ)\]", data):
        return _ini(target, data)
    if re.search(rb"(?m)^\[printer\]", data):
        return _printer(target, data)
    raise InputError(
        "This is not the file of a known controller.",
        "Name LinuxCNC's INI with [JOINT_0], or Klipper's printer.cfg with [printer].",
        file=target,
    )


def write_controller_file(before: ControllerFile, data: bytes) -> None:
    """Write it if it still is what was read.

    Raises:
        UsageError: it was changed meanwhile, or the printer prints.
        InputError: it cannot be written.
    """
    if controller_file(before.target).sha256 != before.sha256:
        raise UsageError(f"{before.target} was changed meanwhile.", "Give the command again.")
    if moonraker.is_address(before.target):
        moonraker.upload(before.target, data)
    else:
        write_bytes(Path(before.target), data, overwrite=True)


def _ini(target: str, data: bytes) -> ControllerFile:
    """LinuxCNC's INI; one byte is one character, whatever its encoding."""
    faults, section, units, start = Faults(target), "", set[float](), 0
    found: dict[str, StoredValue] = {}
    text = data.decode("latin-1")
    for number, line in enumerate(io.StringIO(text, newline=""), start=1):
        head, entry = _SECTION.match(line), _ENTRY.match(line)
        key, value = (entry[1], "" if entry[3] else entry[2]) if entry else ("", "")
        if head:
            section = head[1]
        elif (section, key) == ("TRAJ", "LINEAR_UNITS"):
            units.add(_UNITS.get(value.lower(), 0.0))
            if 0.0 in units or len(units) > 1:
                what = "This unit is unknown." if 0.0 in units else "The unit is given twice."
                faults.add(what, "Write mm or inch, once.", line=number, value=line.strip())
        elif entry and key == "HOME_OFFSET" and section in _JOINTS:
            setting = StoredValue(f"[{section}] {key}", number, start + entry.start(2), value)
            first = found.setdefault(_JOINTS[section], setting)
            if first is not setting or not _NUMBER.fullmatch(value):
                twice = f"This is given twice: also in line {first.line}."
                what = "This is not a number." if first is setting else twice
                remedy, said = "Write one decimal number, once.", line.strip()
                faults.add(what, remedy, line=number, column=setting.key, value=said)
        start += len(line)
    for section in (each for each, name in _JOINTS.items() if name not in found):
        remedy = f"Add HOME_OFFSET = 0 to [{section}]; values in included files are not read."
        faults.add("The value is missing.", remedy, column=f"[{section}] HOME_OFFSET")
    if not units:
        remedy = "Add LINEAR_UNITS = mm, or inch."
        faults.add("The unit is missing.", remedy, column="[TRAJ] LINEAR_UNITS")
    faults.check()
    return ControllerFile(
        target, data, {axis: found[axis] for axis in AXES}, units.pop(), adds=True
    )


def _printer(target: str, data: bytes) -> ControllerFile:
    """Klipper's printer.cfg."""
    document = document_from_bytes(data, target)
    settings = Settings(document, lambda name: False)
    above, header, block = document.text.partition(_HEADER)
    heading = (above + header).count("\n")
    for number, line in enumerate(block.rstrip().split("\n"), start=heading + 1):
        if header and not (line == SAVED or line.startswith(f"{SAVED} ")):
            what = "Because of this line below its heading Klipper ignores what SAVE_CONFIG wrote."
            raise InputError(what, "Move it above the block.", file=target, line=number, value=line)
    lines = list(io.StringIO(data.decode("latin-1"), newline=""))
    found = {}
    for name, (section, option) in _KLIPPER.items():
        value = settings.options.get((section, option))
        before = value and _OPTION.match(lines[value.line - 1])
        if value and before and _NUMBER.fullmatch(value.text) and value.texts[0][0] == value.line:
            start = sum(map(len, lines[: value.line - 1])) + before.end()
            own = bool(header) and value.line > heading
            found[name] = StoredValue(f"[{section}] {option}", value.line, start, value.text, own)
    included = "The file includes others. A value that is also in one of them is the one in force."
    return ControllerFile(target, data, found, remarks=(included,) if settings.included else ())
