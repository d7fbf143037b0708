"""LinuxCNC's table of a joint: with it a carriage goes where the controller says, however homed."""

from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.files.controller_file import ControllerFile, controller_file
from orthoglide_cal.files.machine_file import default_machine

INI = """\
[TRAJ]
LINEAR_UNITS = {unit}
[JOINT_0]
MIN_LIMIT = {low}
MAX_LIMIT = {high}
HOME_SEARCH_VEL = {search}
HOME_LATCH_VEL = {latch}
HOME_OFFSET = {home}
{more}
[JOINT_1]
HOME_OFFSET = 0
[JOINT_2]
HOME_OFFSET = 0
"""
WIDTH, EXCESS = 0.05, 0.3e-3  # lost motion, scale
HOME, SWITCH = 95.0, 95.4  # where the controller believes the switch to be, and where it is [mm]
STANDS = {
    "nothing": ("", ""),
    "backlash": ("BACKLASH = 0.02", ""),
    "type 1": ("COMP_FILE = own.comp\nCOMP_FILE_TYPE = 1", "-50 0.01 -0.01\n60 0.02 0\n"),
    "type 0": ("COMP_FILE = own.comp", "-50 -50.01 -49.99\n60 59.98 60\n"),
}


class Joint:
    """What LinuxCNC and a carriage with lost motion and a wrong scale do, as measured with 2.9."""

    def __init__(self, path: Path, unit: float) -> None:
        lines = (line.partition("=") for line in path.read_text().split("[JOINT_1]")[0].split("\n"))
        read = {key.strip(): value.strip() for key, _, value in lines}
        self.home = float(read["HOME_OFFSET"]) * unit
        half = float(read.get("BACKLASH", 0.0)) / 2.0
        self.table = np.array([[0.0, half, -half]]) * unit
        if "COMP_FILE" in read:
            lines = (path.parent / read["COMP_FILE"]).read_text().splitlines()
            self.table = np.array([line.split() for line in lines], dtype=float) * unit
            assert np.all(np.diff(self.table[:, 0]) > 0.0)
            assert len(self.table) <= 256
            if read.get("COMP_FILE_TYPE", "0") == "0":
                self.table[:, 1:] = self.table[:, :1] - self.table[:, 1:]
        self.latch = float(read["HOME_LATCH_VEL"])
        # The motor at the switch, or where it is at the start: at once, it is at 0.
        way = 1.0 if self.latch >= 0.0 else -1.0
        at_switch = SWITCH / (1.0 + EXCESS) + way * WIDTH / 2.0 if self.latch else SWITCH
        counted = self.adds(self.home, way) if self.latch else 0.0
        self.offset = at_switch - self.home - counted

    def adds(self, position: float, way: float) -> float:
        return float(np.interp(position, self.table[:, 0], self.table[:, 1 if way > 0.0 else 2]))

    def truly(self, position: float, way: float) -> float:
        """Where the carriage is, when it was moved this way to what the controller says [mm]."""
        motor = position + self.adds(position, way) + self.offset
        return (1.0 + EXCESS) * (motor - way * WIDTH / 2.0)


def corrected(path: Path, unit: float) -> ControllerFile:
    """Its file with table, as what was measured at its joint makes it; it is written."""
    before, joint = controller_file(str(path)), Joint(path, unit)
    at = np.array([-40.0, 0.0, 40.0])
    (up, down) = ([joint.truly(p, way) - p for p in at] for way in (1.0, -1.0))
    # What a measurement finds: mean offset at the isotropic posture, where the joint says 0, slope,
    # width.
    slope, offset = np.polyfit(at, (np.array(up) + down) / 2.0, 1)
    width = float(np.mean(np.subtract(down, up)))
    made = {"encoder_scale": {"x": 1e3 * float(slope)}, "backlash": {"x": width}}
    written, data = before.changed(default_machine(), {"x": float(offset)}, made, 6)
    for table in written.tables:
        Path(table.path).write_text(table.text)
    path.write_bytes(data)
    now = controller_file(str(path))
    assert now.restored(written)[1] == before.data
    return now


@pytest.mark.parametrize("stands", STANDS)
@pytest.mark.parametrize("latch", [0.0, 1.0, -1.0])
@pytest.mark.parametrize("unit", [1.0, 25.4])
def test_the_carriage_goes_where_the_controller_says(
    tmp_path: Path, stands: str, latch: float, unit: float
) -> None:
    more, own = STANDS[stands]
    path, table = tmp_path / "mill.ini", tmp_path / "own.comp"
    sizes = {
        "low": round(-100 / unit, 9),
        "high": round(100 / unit, 9),
        "home": round(HOME / unit, 7),
    }
    word = "mm" if unit == 1.0 else "inch"
    path.write_text(INI.format(unit=word, search=20 * latch, latch=latch, more=more, **sizes))
    table.write_text(own)
    before = [Joint(path, unit).truly(p, way) - p for p in (-60.0, 70.0) for way in (1.0, -1.0)]
    assert np.abs(before).max() > 0.2
    corrected(path, unit)
    joint = Joint(path, unit)
    # Within the table that stands there; what it adds is scaled by 1.0003, too.
    for position in (-45.0, -40.0, 0.0, 40.0, 55.0):
        for way in (1.0, -1.0):
            assert joint.truly(position, way) == pytest.approx(position, abs=2e-4)
    # Zero at the home offset, in the direction in which it is latched.
    assert joint.adds(joint.home, latch or 1.0) == pytest.approx(0.0, abs=1e-6)
    assert table.read_text() == own  # what somebody made is left alone
    assert "BACKLASH = 0\n" in path.read_text() or stands != "backlash"
