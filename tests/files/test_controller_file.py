"""A controller's file: three values change, every other byte stays, and all of it comes back."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import InputError, OrthocalError, UsageError
from orthoglide_cal.files.controller_file import ControllerFile, controller_file, replace_file
from orthoglide_cal.files.linuxcnc import is_live
from tests.fuzz.run import mutant

from .helpers import problems, saved

INI = """\
# Fräse 7; HOME_OFFSET = 9 in a remark
[EMC]
MACHINE = mill7
[HAL]
HALFILE = a.hal
HALFILE = b.hal
[TRAJ]
LINEAR_UNITS = mm
[JOINT_0]
HOME = 0.0
HOME_OFFSET = 0.500
HOME_OFFSET_EXTRA = 7
[JOINT_1]
HOME_OFFSET=-12.25
# the switch; 0.500 behind it
[JOINT_2]
  HOME_OFFSET = 0
[SPINDLE_0]
HOME_OFFSET = 3
"""
CHANGES = {"x": 0.421, "y": -0.296, "z": 0.861}
CFG = """\
[printer]
kinematics: delta
[stepper_a]
homing_speed: 50

#*# <---------------------- SAVE_CONFIG ---------------------->
#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.
#*#
#*# [printer]
#*# delta_radius = 140.100000
#*#
#*# [stepper_a]
#*# angle = 210.000000
#*# arm_length = 380.000000
#*# position_endstop = 300.100000
#*# [stepper_b]
#*# angle = 330.000000
#*# arm_length = 380.000000
#*# position_endstop = 300.200000
#*# [stepper_c]
#*# angle = 90.000000
#*# arm_length = 380.000000
#*# position_endstop = 300.300000
"""
VALUES = {"radius": 140.2, "a": 300.5, "b": 300.2, "c": 299.9}


def test_values_are_in_the_order_of_the_joints(tmp_path: Path) -> None:
    """As a running controller takes them, wherever their sections stand."""
    head, *joints = INI.split("[JOINT_")
    turned = of(tmp_path, "[JOINT_".join((head, *reversed(joints))))
    texts = [each.before for each in turned.settings.values()]
    assert texts == ["0.500", "-12.25", "0"]


def test_what_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"HOME_OFFSET would become 1000000\.361"):
        of(tmp_path, INI.replace("-12.25", "999999")).changed({"y": 1.361}, 3)


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
    written, new = before.changed(CHANGES, 3)
    replace_file(before.target, before.sha256, new)
    assert link.is_symlink()
    assert path.stat().st_mode & 0o777 == 0o640
    lines = zip(data.split(b"\n"), path.read_bytes().split(b"\n"), strict=True)
    differing = [number for number, (old, new) in enumerate(lines, start=1) if old != new]
    assert differing == [11, 14, 17] == [each.line for each in written.values]
    for each, old, name in zip(written.values, (0.5, -12.25, 0.0), "xyz", strict=True):
        rounding = 0.5e-3 if factor == 1.0 else 0.5e-5
        assert float(each.after) == pytest.approx(old + CHANGES[name] / factor, abs=rounding)
    assert b"# the switch; 0.500 behind it" in path.read_bytes()
    after = controller_file(str(path))
    replace_file(after.target, after.sha256, after.restored(written))
    assert path.read_bytes() == data


def of(folder: Path, text: str) -> ControllerFile:
    return controller_file(saved(folder, text, "file"))


UNCLEAR = [
    # replaced in the INI, by, words of the message
    ("HOME_OFFSET = 0.500", "HOME_OFFSET : 0.6\nHOME_OFFSET = 0.5", "not a number"),
    ("HOME_OFFSET = 0.500", "HOME = 1", "missing"),
    ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0,5", r", \[JOINT_0\] HOME_OFFSET: This is not a"),
    ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5 mm", "not a number"),
    # LinuxCNC 2.9 does not start with either.
    ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5 # mm", "not a number"),
    ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5\nMAX_LIMIT = 9 ; mm", "not a number"),
    # As LinuxCNC's own inivar does, only the first section of a name is read.
    ("HOME = 0.0\n", "HOME = 0.0\n[EMC]\n[JOINT_0]\n", "missing"),
    ("LINEAR_UNITS = mm", "LINEAR_UNITS = furlong", "unknown"),
    ("LINEAR_UNITS = mm", "", "LINEAR_UNITS: The value is missing"),
    *(("HOME_OFFSET = 3\n", f"[KINS]\nKINEMATICS = {kinematics}\n", rf"line 20.*{said}")
      for kinematics, said in (
        *((f"trivkins coordinates={letters}", "each of X, Y and Z one joint")
          for letters in ("XYYZ", "XZ", "XYA")),
        ("lineardeltakins", "drives a delta"),
    )),
]  # fmt: skip
LINE = "[printer]\ndelta_radius: 140.3\n"
UNCLEAR_PRINTERS = [
    ("300.300000\n", "300.300000\n[fan]\n", r"line 24.*ignores"),
    ("homing_speed: 50\n", "#*# an old line\n", r"line 4.*drops what SAVE_CONFIG"),
    ("[printer]\nkin", "\ufeff[printer]\nkin", r"line 1.*byte order mark"),
    # Its own line is never overruled, with a remark behind it or without the block's.
    ("[printer]\nkin", f"{LINE}kin", "line 2"),
    ("[printer]\nkin", f"{LINE[:-1]} # 140.100000\nkin", "line 2"),
]


@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [*((INI, *row) for row in UNCLEAR), *((CFG, *row) for row in UNCLEAR_PRINTERS),
     (CFG.replace("#*# delta_radius = 140.100000\n", ""), "[printer]\nkin", f"{LINE}kin",
      r"line 2.*above.*140\.3")],
)  # fmt: skip
def test_what_is_not_clear_is_refused_with_its_place(
    tmp_path: Path, text: str, old: str, new: str, said: str
) -> None:
    assert old in text
    with pytest.raises(InputError, match=said):
        of(tmp_path, text.replace(old, new, 1))
    fault = problems(of, tmp_path, text.replace(old, new, 1))[0]
    assert fault.remedy
    assert fault.line or fault.column


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
    written, data = before.changed(VALUES, 4)
    assert [(each.line, each.before, each.after) for each in written.values] == [
        (10, "140.100000", "140.200000"),
        (15, "300.100000", "300.500000"),
        (23, "300.300000", "299.900000"),
    ]
    replace_file(before.target, before.sha256, data)
    assert controller_file(before.target).restored(written) == CFG.encode()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [("0.921", "0.922", r"\[JOINT_0\] HOME_OFFSET holds 0.922"), ("mill7", "mill8", "something")],
)
def test_what_was_changed_since_is_not_restored(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    before = of(tmp_path, INI)
    written, data = before.changed(CHANGES, 3)
    Path(before.target).write_bytes(data.replace(old.encode(), new.encode()))
    with pytest.raises(UsageError, match=said):
        controller_file(before.target).restored(written)
    with pytest.raises(UsageError, match="changed meanwhile"):
        replace_file(before.target, before.sha256, data)


def test_a_read_only_file_is_left_alone(tmp_path: Path) -> None:
    before = of(tmp_path, INI)
    Path(before.target).chmod(0o444)
    with pytest.raises(InputError, match="read-only"):
        replace_file(before.target, before.sha256, b"nothing")
    (left,) = tmp_path.iterdir()
    assert left.read_text(encoding="utf-8") == INI


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
    monkeypatch.setattr("orthoglide_cal.files.linuxcnc.running_ini", lambda: runs)
    assert is_live(of(tmp_path, INI.replace("0.500\n", f"{offset}\n"))) is same


@pytest.mark.parametrize("count", [150, pytest.param(5000, marks=pytest.mark.slow)])
def test_mutants_change_and_come_back_or_are_refused(tmp_path: Path, count: int) -> None:
    rng, path = np.random.default_rng(7), tmp_path / "file"
    done = 0
    for number in range(count):
        data = mutant(INI if number % 2 else CFG, rng).encode("utf-8", "surrogatepass")
        path.write_bytes(data)
        with contextlib.suppress(OrthocalError):
            before = controller_file(str(path))
            written, new = before.changed(CHANGES if before.adds else VALUES, 3)
            replace_file(before.target, before.sha256, new)
            after = controller_file(str(path))
            assert after.restored(written) == data
            done += 1
    assert done > 0.15 * count
