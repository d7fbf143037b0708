"""A running LinuxCNC: where its joints stand, and the offsets that it homes by.

`linuxcncrsh` answers one line for each line over TCP, `halcmd` reads and sets pins on this computer
(their manual pages). Nothing here can move a machine.
"""

import re
import socket
import subprocess
from contextlib import suppress
from pathlib import Path, PurePath
from typing import NamedTuple

import numpy as np

from orthoglide_cal.errors import UsageError, system_words
from orthoglide_cal.files.controller_file import ControllerFile, LinuxCnc
from orthoglide_cal.files.moonraker import in_time
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.words import MM_PER_INCH

PORT = 5007
NEAR_MM = 0.05  # farther from the posture, a reading is questioned
_TIMEOUT_S = 2.0
_ADDRESS = re.compile(r"linuxcnc(?::([^:\[\]\s]+|\[[^\]\s]+\])(?::([0-9]{1,5}))?)?")
_JOINT = re.compile(r"\[JOINT_([0-9])\].*")
_UNITS = {"MM": 1.0, "INCH": MM_PER_INCH, "CM": 10.0}


class Stood(NamedTuple):
    """How far a machine stood from a posture (the largest difference of a joint), and where."""

    away_mm: float = 0.0
    words: str = ""  # none where nobody knows


class Standing:
    """The joints of a running controller at `linuxcnc[:HOST[:PORT]]`, of linuxcncrsh.

    Raises UsageError: there is no LinuxCNC, or one that cannot be followed.
    """

    def __init__(self, address: str) -> None:
        parts = _ADDRESS.fullmatch(address)
        port = int(parts[2] or PORT) if parts else 0
        if parts is None or not 0 < port < 65536:
            raise UsageError(f"{address!r} cannot be followed.", "Write linuxcnc[:HOST[:PORT]].")
        host = (parts[1] or "localhost").strip("[]")
        try:
            with socket.create_connection((host, port), _TIMEOUT_S) as connection:
                self._line = connection.makefile("rwb", buffering=0)  # open until this closes
            self.close = self._line.close
            self._ask("hello EMC orthocal 1.0", "HELLO ACK")
            (unit,) = self._ask("get user_linear_units", "USER_LINEAR_UNITS")
            self._unit_mm = _UNITS[unit]
            # Identity: its joints are the axes of the tool, in the order of its `coordinates`.
            self._identity = self._ask("get kinematics_type", "KINEMATICS_TYPE") == ["1"]
        except (OSError, KeyError, ValueError) as error:
            raise UsageError(
                f"No LinuxCNC can be followed at {host}:{port}: {system_words(error)}.",
                "Start linuxcncrsh on that computer, with its usual password (man linuxcncrsh); or"
                " measure without --follow.",
            ) from error
        if not self._homed():
            self.close()
            problem = f"The LinuxCNC at {host}:{port} is not homed: nobody knows where it stands."
            raise UsageError(problem, "Home all joints, then give the command again.")

    def at(self, joints: Floats, tool: Floats, home_mm: float) -> Stood:
        """Where the machine stands; wanted are these joints and this tool, shape (3,) [mm].

        A controller without kinematics is driven to either, and may count from the joint value of
        the isotropic posture. Raises OSError, ValueError: nothing answers any more, or no place.
        """
        if not self._homed():
            raise ConnectionError("it is not homed any more")
        place = "abs_act_pos" if self._identity else "joint_pos"
        answer = self._ask(f"get {place}", place.upper())[: len(AXES)]
        stands = self._unit_mm * np.array(answer, dtype=float)
        wanted = np.stack([joints, joints - home_mm, *([tool] if self._identity else [])])
        away = float(np.abs(wanted - stands).max(axis=1).min())
        axes = zip(AXES, stands.tolist(), strict=True)
        place = " ".join(f"{axis.upper()} {value:.3f}" for axis, value in axes)
        return Stood(away, f"the controller stood at {place}")

    def _homed(self) -> bool:
        """True if all joints are homed: before, their positions are arbitrary. Raises OSError."""
        joints = self._ask("get joint_homed", "JOINT_HOMED")[: len(AXES)]
        return joints == ["YES"] * len(AXES)

    def _ask(self, question: str, answer: str) -> list[str]:
        """The words of an answer behind its name. Raises OSError."""
        self._line.write(question.encode() + b"\n")
        for _ in range(2):  # what was sent is echoed first
            read = in_time(lambda: self._line.readline(400), _TIMEOUT_S)
            line = read.decode("ascii", "replace").strip().upper()
            if line.startswith(answer):
                return line.removeprefix(answer).split()
            if not line.startswith(question.upper()):
                raise ConnectionError(f"the answer is {line!r}" if line else "it has closed")
        raise ConnectionError("no answer")


def running(ini: ControllerFile) -> str | None:
    """None if no LinuxCNC runs on this computer, or the file is of another controller; "" if one
    has this INI and the offsets it holds. Else why nothing is set there, in a sentence."""
    if is_live(ini):
        return ""
    if (path := running_ini()) is None or not isinstance(ini, LinuxCnc):
        return None
    other = "home offsets than its INI" if str(path) == ini.target else f"settings, {path}"
    return f"A LinuxCNC runs on this computer with other {other}: nothing is set there."


def running_ini() -> Path | None:
    """The INI of the LinuxCNC that runs on this computer; None if none runs, or nobody can tell."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError, IndexError):
            words = (process / "cmdline").read_bytes().decode().split("\0")
            if PurePath(words[0]).name == "linuxcncsvr":
                path = process / "cwd" / words[words.index("-ini") + 1]
                return Path(str(path.resolve()).removesuffix(".expanded"))
    return None


def is_live(ini: ControllerFile, *, anew: bool = False) -> bool:
    """True if a LinuxCNC on this computer has this INI and these home offsets, by `halcmd`.

    With `anew` they are set before; they are in force at the next homing.
    """
    if str(running_ini()) != ini.target:  # nor one whose INI nobody can tell
        return False
    held = [ini.settings[axis] for axis in AXES]
    pins = [_JOINT.sub(r"ini.\1.home_offset", value.key) for value in held]
    values = [float(value.before) for value in held]
    lines = [f"setp {pin} {v.before}\n" for pin, v in zip(pins, held, strict=True) if anew]
    lines += [f"getp {pin}\n" for pin in pins]
    try:
        run = subprocess.run(
            ["halcmd", "-f"],
            input="".join(lines), capture_output=True, text=True, check=True, timeout=5.0,
        )  # fmt: skip
        return np.allclose(np.array(run.stdout.split(), float), values, rtol=1e-6, atol=1e-6)
    except (OSError, subprocess.SubprocessError, ValueError):
        return False
