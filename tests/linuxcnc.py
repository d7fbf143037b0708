"""A real LinuxCNC with simulated axes, headless; `missing` says why it cannot be had.

It starts only where somebody allows it, never beside one that runs, and in a network of its own
where that can be had: nothing here reaches a controller that moves a machine.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import pwd
import re
import shutil
import socket
import struct
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path

# Its files; in that of the HAL half the lost motion and the scale of each carriage are filled in.
INI, HAL = (Path(__file__).with_name(f"mill.{end}").read_text() for end in ("ini", "hal"))
HOME = [float(offset) for offset in re.findall(r"HOME_OFFSET = (\S+)", INI)]  # at first [mm]
ALLOWED = "ORTHOCAL_TEST_LINUXCNC"
_OF_ONE = {"linuxcncsvr", "milltask", "rtapi_app", "linuxcncrsh"}
_NETWORK = 0x40000000  # CLONE_NEWNET
_UP, _SET_FLAGS = 0x1, 0x8914  # IFF_UP, SIOCSIFFLAGS


def runs() -> bool:
    """Whether a LinuxCNC runs on this computer, whoever started it."""
    for path in Path("/proc").glob("[0-9]*/comm"):
        with suppress(OSError):
            if path.read_text().strip() in _OF_ONE:
                return True
    return Path("/tmp/linuxcnc.lock").exists()


def missing() -> str | None:
    """Why it cannot run here; None if it can."""
    if os.environ.get(ALLOWED) != "1":
        return f"LinuxCNC is started only with {ALLOWED}=1"
    if runs():
        return "a LinuxCNC runs on this computer"
    wanted = ("linuxcnc", "linuxcncrsh", "halcmd", "milltask")
    without = [name for name in wanted if shutil.which(name) is None]
    if without:
        return f"LinuxCNC is not installed: no {', '.join(without)}"
    with socket.socket() as free:
        return "something else has port 5007" if free.connect_ex(("localhost", 5007)) == 0 else None


class Network:
    """A network of this thread's own, with nothing but its own localhost, until it is left."""

    def __init__(self) -> None:
        self.before, self.libc = os.open("/proc/self/ns/net", os.O_RDONLY), ctypes.CDLL(None)
        if self.libc.unshare(_NETWORK) == 0:
            with socket.socket() as any_socket:
                fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sh22x", b"lo", _UP))

    def leave(self) -> None:
        self.libc.setns(self.before, _NETWORK)
        os.close(self.before)


class LinuxCnc:
    """Started in a folder, homed; not as root, which it refuses."""

    def __init__(
        self,
        lost_mm: tuple[float, ...] = (0.0, 0.0, 0.0),
        excess: tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> None:
        """With carriages that have lost motion and a wrong scale behind their motors."""
        # There is one in a computer: other tests wait.
        self.alone = (Path(tempfile.gettempdir()) / "orthocal-linuxcnc.lock").open("w")
        fcntl.flock(self.alone, fcntl.LOCK_EX)
        end = time.monotonic() + 10.0
        while runs():  # that of the test before may still be ending
            assert time.monotonic() < end, "a LinuxCNC runs on this computer"
            time.sleep(0.2)
        self.network = Network()
        # No folder of pytest: it must be open to another user.
        self.folder = folder = Path(tempfile.mkdtemp(prefix="orthocal-"))
        folder.chmod(0o755)
        self.ini = folder / "mill.ini"
        self.ini.write_text(INI)
        half, gain = [width / 2 for width in lost_mm], [1.0 + more for more in excess]
        (folder / "mill.hal").write_text(HAL.format(half=half, gain=gain))
        for name in ("tool.tbl", "sim.var"):
            (folder / name).touch()
        self.user = "nobody" if os.geteuid() == 0 else None
        if self.user:
            owner = pwd.getpwnam(self.user)
            for path in (folder, *folder.iterdir()):
                os.chown(path, owner.pw_uid, owner.pw_gid)
        try:
            self.start()
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> LinuxCnc:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)
        self.network.leave()
        self.alone.close()

    def start(self) -> None:
        """Start it with what its INI says now, and home it."""
        environment = {**os.environ, "HOME": str(self.folder), "DISPLAY": ""}
        self.process = subprocess.Popen(
            ["linuxcnc", str(self.ini)],
            cwd=self.folder, env=environment, user=self.user, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        end = time.monotonic() + 40.0
        while True:  # a server that is about to end may still answer
            try:
                self.connection = socket.create_connection(("localhost", 5007), 30.0)
                self.tell("hello EMC test 1.0", "set echo off", "set enable EMCTOO")
                self.tell("set estop off", "set machine on", "set set_wait done")
                self.homed_by = self.home()
                return
            except (OSError, subprocess.CalledProcessError):
                assert time.monotonic() < end, "it did not start"
                time.sleep(0.5)

    def home(self) -> list[float]:
        """Home all joints, each where it is, and go to 0; how far the motors went [mm].

        Without a switch the place where homing begins counts as HOME_OFFSET, so that each motor
        goes back by it.
        """
        before = self.motors_mm()
        for joint in range(3):
            # A machine that is homed is in teleoperation again, in which no joint can be homed.
            self.tell("set mode manual", "set teleop_enable off", f"set home {joint}")
            time.sleep(0.2)
            while self.hal("getp", f"joint.{joint}.homing") == "TRUE" or not self.rests():
                pass
            assert self.hal("getp", f"joint.{joint}.homed") == "TRUE"
        return [b - a for a, b in zip(before, self.motors_mm(), strict=True)]

    def rests(self) -> bool:
        before = self.motors_mm()
        time.sleep(0.15)
        return before == self.motors_mm()

    def motors_mm(self) -> list[float]:
        """Where the motors are, whatever the controller calls that place [mm]."""
        return [round(float(self.hal("getp", f"joint.{n}.motor-pos-cmd")), 6) for n in range(3)]

    def carriages_mm(self) -> list[float]:
        """Where the carriages are [mm]."""
        return [float(self.hal("getp", f"scale.{n}.out")) for n in range(3)]

    def hal(self, *arguments: str) -> str:
        run = subprocess.run(
            ["halcmd", *arguments], capture_output=True, text=True, check=True, user=self.user
        )
        return run.stdout.strip()

    def drive(self, x: float, y: float, z: float) -> None:
        """Wait until it stands there: on a busy computer a move may begin late."""
        self.tell("set mode mdi", f"set mdi G53 G0 X{x} Y{y} Z{z}")
        end = time.monotonic() + 60.0
        while not (self.stands_at(x, y, z) and self.rests()):
            assert time.monotonic() < end, f"it does not go to {x} {y} {z}"

    def stands_at(self, *joints: float) -> bool:
        there = (float(self.hal("getp", f"joint.{n}.pos-cmd")) for n in range(3))
        return all(abs(a - b) < 1e-4 for a, b in zip(there, joints, strict=True))

    def tell(self, *lines: str) -> str:
        """Send lines; the last thing that was answered."""
        answer = b""
        for line in lines:
            self.connection.sendall(line.encode() + b"\n")
            time.sleep(0.1)
            if line.startswith(("get", "hello")):
                answer = self.connection.recv(4096)
        return answer.decode()

    def stop(self) -> None:
        try:
            self.tell("shutdown")
            self.connection.close()
            self.process.wait(20)
        except (AttributeError, OSError, subprocess.TimeoutExpired):
            os.killpg(self.process.pid, 9)
            self.process.wait()
