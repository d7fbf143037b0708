"""A controller's file: three values change, every other byte stays, and all of it comes back."""

import contextlib
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from orthoglide_cal.errors import InputError, OrthocalError, UsageError
from orthoglide_cal.files.controller_file import ControllerFile, controller_file, replace_file
from orthoglide_cal.files.klipper import read_printer_file
from orthoglide_cal.files.machine_file import default_machine
from orthoglide_cal.files.text import document_from_bytes
from orthoglide_cal.model.machine import Corrections, Written
from orthoglide_cal.model.model import Model
from tests.fuzz.run import mutant

from .helpers import saved

INI, CFG = (
    Path(__file__).with_name(name).read_text(encoding="utf-8")
    for name in ("mill.ini", "kossel.cfg")
)
GCODE = "  G1 X12.5 Y-3.25 F9000\n"
COMPENSATED = (
    INI.replace("HOME = 0.0\n", "COMP_FILE = own.comp\nCOMP_FILE_TYPE = 1\n", 1),
    "-50 0.01 -0.01\n60 0.02 0\n",
)
CHANGES = {"x": 0.421, "y": -0.296, "z": 0.861}
# Of the printer of CFG.
MORE = {"a": 0.4, "b": 0.0, "c": -0.4, "radius": 0.1, "angle_a": 0.0, "angle_b": 0.0}
LOST = {"backlash": {"x": 0.05}}


def changed(
    file: ControllerFile, made: Corrections = MappingProxyType({}), **changes: float
) -> tuple[Written, bytes]:
    """What is written of these changes, and the bytes then."""
    if file.format == "linuxcnc":
        return file.changed(default_machine(), changes or CHANGES, made, 3)
    printer = read_printer_file(document_from_bytes(CFG.encode(), "printer.cfg")).machine
    return file.changed(Model(printer), MORE, made, 4)


def test_what_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"HOME_OFFSET would become 1000000\.361"):
        changed(of(tmp_path, INI.replace("-12.25", "999999")), y=1.361)


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("inch", 25.4), ("Imperial", 25.4)])
def test_three_values_change_and_come_back(
    tmp_path: Path, ends: str, encoding: str, unit: str, factor: float
) -> None:
    data = INI.replace("= mm", f"= {unit}").replace("\n", ends).encode(encoding)
    path, link = tmp_path / "mill.ini", tmp_path / "link.ini"
    path.write_bytes(data)
    path.chmod(0o640)
    link.symlink_to(path)
    before = controller_file(str(link))
    written, new = changed(before)
    replace_file(before.target, before.sha256, new)
    assert link.is_symlink()
    assert path.stat().st_mode & 0o777 == 0o640
    lines = zip(data.split(b"\n"), path.read_bytes().split(b"\n"), strict=True)
    differing = [number for number, (old, new) in enumerate(lines, start=1) if old != new]
    assert differing == [11, 14, 17] == [value.line for value in written.values]
    for value, old, name in zip(written.values, (0.5, -12.25, 0.0), "xyz", strict=True):
        rounding = 0.5e-3 if factor == 1.0 else 0.5e-5
        assert float(value.after) == pytest.approx(old + CHANGES[name] / factor, abs=rounding)
    assert b"# the switch; 0.500 behind it" in path.read_bytes()
    after = controller_file(str(path))
    replace_file(after.target, after.sha256, after.restored(written)[1])
    assert path.read_bytes() == data


def of(folder: Path, text: str) -> ControllerFile:
    return controller_file(saved(folder, text, "file"))


@pytest.mark.parametrize(
    ("kinematics", "lines"),
    [
        ("KINEMATICS = trivkins coordinates=ZYX", (17, 14, 11)),
        ('KINEMATICS = trivkins coordinates="zyx"', (17, 14, 11)),
        ("KINEMATICS = trivkins coordinates=yxzA kinstype=BOTH", (14, 11, 17)),
        ("KINEMATICS = trivkins", (11, 14, 17)),
        ("KINEMATICS = orthoglidekins", (11, 14, 17)),
        ("# KINEMATICS = trivkins coordinates=ZYX", (11, 14, 17)),
    ],
)
def test_axes_are_written_to_their_joints(
    tmp_path: Path, kinematics: str, lines: tuple[int, ...]
) -> None:
    settings = of(tmp_path, f"{INI}[KINS]\n{kinematics}\n").settings
    assert tuple(settings[axis].line for axis in "xyz") == lines


@pytest.mark.parametrize(
    ("old", "new"),
    [("[SPINDLE_0]", "[JOINT_0]"), ("0.500\nHOME_", "0.500\nHOME_OFFSET = 0.6\nHOME_")],
)
def test_only_the_first_of_a_name_is_read(tmp_path: Path, old: str, new: str) -> None:
    assert of(tmp_path, INI.replace(old, new)).settings["x"].line == 11


@pytest.mark.parametrize(
    ("included", "fine"),
    [("PID = 3\n", True), ("HOME_OFFSET = 7\n", False), ("[X]\nA = 1\n", False), (None, False)],
)
def test_what_an_included_file_may_say_is_not_written_over(
    tmp_path: Path, included: str | None, fine: bool
) -> None:
    if included is not None:
        (tmp_path / "joint.inc").write_text(included, encoding="utf-8")
    text = INI.replace("HOME = 0.0\n", "#INCLUDE joint.inc\n", 1)
    if fine:
        assert of(tmp_path, text).settings["x"].before == "0.500"
        return
    with pytest.raises(InputError, match=r"line 10.*may read a value from this included file"):
        of(tmp_path, text)


def test_a_printer_changes_in_its_block(tmp_path: Path) -> None:
    before = of(tmp_path, CFG)
    written, data = changed(before)
    assert [(value.line, value.before, value.after) for value in written.values] == [
        (10, "140.100000", "140.200000"),
        (15, "300.100000", "300.500000"),
        (23, "300.300000", "299.900000"),
    ]
    replace_file(before.target, before.sha256, data)
    assert controller_file(before.target).restored(written)[1] == CFG.encode()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [("0.921", "0.922", r"\[JOINT_0\] HOME_OFFSET holds 0.922"), ("mill7", "mill8", "something")],
)
def test_what_was_changed_since_is_not_restored(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    before = of(tmp_path, INI)
    written, data = changed(before)
    Path(before.target).write_bytes(data.replace(old.encode(), new.encode()))
    with pytest.raises(UsageError, match=said):
        controller_file(before.target).restored(written)
    with pytest.raises(UsageError, match="changed meanwhile"):
        replace_file(before.target, before.sha256, data)


@pytest.mark.parametrize(
    ("offset", "by", "same"),
    [
        ("310.25041", "file", True),
        ("310.2514", "file", False),
        ("310.25041", "other.ini", False),
        ("310.25041", None, False),  # its pins answer, but nobody can tell its INI
    ],
)
def test_a_running_linuxcnc_of_this_ini_tells_seven_digits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offset: str, by: str | None, same: bool
) -> None:
    program = tmp_path / "halcmd"
    program.write_text("#!/bin/sh\nprintf '310.2504\\n-12.25\\n0\\n'\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    runs = by and tmp_path / by
    monkeypatch.setattr("orthoglide_cal.files.controller_file.running_ini", lambda: runs)
    assert (of(tmp_path, INI.replace("0.500\n", f"{offset}\n")).running() == "") is same


@pytest.mark.parametrize("count", [240, pytest.param(8000, marks=pytest.mark.slow)])
def test_mutants_change_and_come_back_or_are_refused(tmp_path: Path, count: int) -> None:
    """Of an INI, a printer.cfg, and an INI with the table that it names, of which either."""
    rng, path, table = np.random.default_rng(7), tmp_path / "file", tmp_path / "own.comp"
    done = [0, 0, 0, 0]
    for number in range(count):
        kind = number % 4
        texts = [
            (INI, ""),
            (f"[gcode_macro A]\ngcode:\n{20 * GCODE}{CFG}", ""),
            COMPENSATED,
            COMPENSATED,
        ][kind]
        data = [text.encode() for text in texts]
        data[kind == 3] = mutant(texts[kind == 3], rng).encode("utf-8", "surrogatepass")
        path.write_bytes(data[0])
        table.write_bytes(data[1])
        with contextlib.suppress(OrthocalError):
            before = controller_file(str(path))
            written, new = changed(before, LOST if kind > 1 else {})
            replace_file(before.target, before.sha256, new)
            after = controller_file(str(path))
            assert after.restored(written)[1] == data[0]
            assert table.read_bytes() == data[1]
            done[kind] += 1
    assert min(done) > 0.15 * count / 4
