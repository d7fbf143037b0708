"""A controller's file: three values change, every other byte stays, and all of it comes back."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import InputError, InvalidFileError, OrthocalError, UsageError
from orthoglide_cal.files.controller_file import controller_file, replace_file
from orthoglide_cal.files.linuxcnc import is_live
from tests.fuzz.run import mutant

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
    path = tmp_path / "mill.ini"
    path.write_text("[JOINT_".join((head, *reversed(joints))), encoding="utf-8")
    texts = [each.before for each in controller_file(str(path)).settings.values()]
    assert texts == ["0.500", "-12.25", "0"]


def test_what_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "mill.ini"
    path.write_text(INI.replace("-12.25", "999999"), encoding="utf-8")
    with pytest.raises(UsageError, match=r"HOME_OFFSET would become 1000000\.361"):
        controller_file(str(path)).changed({"y": 1.361}, 3)


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


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5\nHOME_OFFSET = 0.6", "twice"),
        ("HOME_OFFSET = 0.500", "HOME_OFFSET : 0.6\nHOME_OFFSET = 0.5", "not a number"),
        ("HOME_OFFSET = 0.500", "HOME = 1", "missing"),
        ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0,5", "not a number"),
        ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5 mm", "not a number"),
        # LinuxCNC 2.9 does not start with either.
        ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5 # mm", "not a number"),
        ("HOME_OFFSET = 0.500", "HOME_OFFSET = 0.5\nMAX_LIMIT = 9 ; mm", "not a number"),
        ("LINEAR_UNITS = mm", "LINEAR_UNITS = furlong", "unknown"),
        ("LINEAR_UNITS = mm", "", "LINEAR_UNITS: The value is missing"),
        ("LINEAR_UNITS = mm", "LINEAR_UNITS = mm\nLINEAR_UNITS = inch", "twice"),
    ],
)
def test_what_is_not_clear_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    path = tmp_path / "mill.ini"
    path.write_text(INI.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidFileError, match=said) as caught:
        controller_file(str(path))
    fault = caught.value.problems[0]
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
    path = tmp_path / "mill.ini"
    path.write_text(f"{INI}[KINS]\n{kinematics}\n", encoding="utf-8")
    settings = controller_file(str(path)).settings
    assert tuple(settings[axis].line for axis in "xyz") == lines


@pytest.mark.parametrize(
    ("kinematics", "problem"),
    [(f"trivkins coordinates={letters}", "each of X, Y and Z one joint")
     for letters in ("XYYZ", "XZ", "XYA")] + [("lineardeltakins", "drives a delta")],
)  # fmt: skip
def test_axes_without_a_joint_of_their_own_are_refused(
    tmp_path: Path, kinematics: str, problem: str
) -> None:
    path = tmp_path / "mill.ini"
    path.write_text(f"{INI}[KINS]\nKINEMATICS = {kinematics}\n", "utf-8")
    with pytest.raises(InputError, match=rf"line 21.*{problem}"):
        controller_file(str(path))


def test_only_the_first_section_of_a_name_is_read(tmp_path: Path) -> None:
    """As LinuxCNC's own inivar does."""
    path = tmp_path / "mill.ini"
    path.write_text(INI.replace("[SPINDLE_0]", "[JOINT_0]"), encoding="utf-8")
    assert controller_file(str(path)).settings["x"].line == 11
    second = "[JOINT_0]\nHOME = 0.0\n[EMC]\n[JOINT_0]\n"
    path.write_text(INI.replace("[JOINT_0]\nHOME = 0.0\n", second), encoding="utf-8")
    with pytest.raises(InvalidFileError, match="missing"):
        controller_file(str(path))


@pytest.mark.parametrize(
    ("included", "fine"),
    [("PID = 3\n", True), ("HOME_OFFSET = 7\n", False), ("[X]\nA = 1\n", False), (None, False)],
)
def test_what_an_included_file_may_say_is_not_written_over(
    tmp_path: Path, included: str | None, fine: bool
) -> None:
    path = tmp_path / "mill.ini"
    path.write_text(INI.replace("HOME = 0.0\n", "#INCLUDE joint.inc\n", 1), encoding="utf-8")
    if included is not None:
        (tmp_path / "joint.inc").write_text(included, encoding="utf-8")
    if fine:
        assert controller_file(str(path)).settings["x"].before == "0.500"
        return
    with pytest.raises(InputError, match=r"line 10.*may read a value from this included file"):
        controller_file(str(path))


def test_a_printer_changes_in_its_block(tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(CFG, encoding="utf-8")
    before = controller_file(str(path))
    written, data = before.changed(VALUES, 4)
    assert [(each.line, each.before, each.after) for each in written.values] == [
        (10, "140.100000", "140.200000"),
        (15, "300.100000", "300.500000"),
        (23, "300.300000", "299.900000"),
    ]
    replace_file(before.target, before.sha256, data)
    after = controller_file(str(path))
    assert after.restored(written) == CFG.encode()


def test_a_block_that_klipper_ignores_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(CFG + "[fan]\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 24.*ignores"):
        controller_file(str(path))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (CFG.replace("homing_speed: 50\n", "#*# an old line\n"), r"line 4.*drops what SAVE_CONFIG"),
        ("\ufeff" + CFG, r"line 1.*byte order mark"),
    ],
)
def test_what_klipper_drops_or_refuses_is_not_written(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        controller_file(str(path))


@pytest.mark.parametrize("line", ["delta_radius: 140.3", "delta_radius = 140.3 # 140.100000"])
def test_a_printer_s_own_line_is_never_overruled(tmp_path: Path, line: str) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(CFG.replace("[printer]\n", f"[printer]\n{line}\n", 1), encoding="utf-8")
    with pytest.raises(InvalidFileError, match="line 2"):
        controller_file(str(path))
    alone = CFG.replace("#*# delta_radius = 140.100000\n", "")
    path.write_text(alone.replace("[printer]\n", f"[printer]\n{line}\n", 1), encoding="utf-8")
    with pytest.raises(InvalidFileError, match=r"line 2.*above.*140\.3"):
        controller_file(str(path))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [("0.921", "0.922", r"\[JOINT_0\] HOME_OFFSET holds 0.922"), ("mill7", "mill8", "something")],
)
def test_what_was_changed_since_is_not_restored(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    path = tmp_path / "mill.ini"
    path.write_text(INI, encoding="utf-8")
    before = controller_file(str(path))
    written, data = before.changed(CHANGES, 3)
    path.write_bytes(data.replace(old.encode(), new.encode()))
    after = controller_file(str(path))
    with pytest.raises(UsageError, match=said):
        after.restored(written)
    with pytest.raises(UsageError, match="changed meanwhile"):
        replace_file(before.target, before.sha256, data)


def test_a_read_only_file_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "mill.ini"
    path.write_text(INI, encoding="utf-8")
    before = controller_file(str(path))
    path.chmod(0o444)
    with pytest.raises(InputError, match="read-only"):
        replace_file(before.target, before.sha256, b"nothing")
    assert path.read_text(encoding="utf-8") == INI
    assert [each.name for each in tmp_path.iterdir()] == ["mill.ini"]


@pytest.mark.parametrize(
    ("offset", "by", "same"),
    [
        ("310.25041", "mill.ini", True),
        ("310.2514", "mill.ini", False),
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
    path = tmp_path / "mill.ini"
    path.write_text(INI.replace("0.500\n", f"{offset}\n"), encoding="utf-8")
    runs = by and tmp_path / by
    monkeypatch.setattr("orthoglide_cal.files.linuxcnc.running_ini", lambda: runs)
    assert is_live(controller_file(str(path))) is same


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
