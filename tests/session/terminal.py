"""The real program in a real pseudo-terminal of 80 × 24 characters, and gauges on other ones."""

import os
import re
import sys
import tty
from pathlib import Path
from types import TracebackType

import pexpect

PROGRAM = "from orthoglide_cal.cli import main; main()"
# The last thing on the screen, perhaps followed by the end of a colour.
PROMPT = re.compile(r"(\d+)\. Gauge [XYZ][^\r\n]* > (?:\x1b\[0m)?$")
QUESTION = re.compile(r"(\d+)\. k keep it[^\r\n]* > (?:\x1b\[0m)?$")


class Terminal:
    """One run of `orthocal measure`."""

    def __init__(
        self, folder: Path, *arguments: str, colour: bool = False, columns: int = 80
    ) -> None:
        environment = {
            name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")
        }
        environment |= {"TERM": "xterm-256color", "OMP_NUM_THREADS": "1"}
        environment.pop("NO_COLOR", None)
        if not colour:
            environment["NO_COLOR"] = "1"
        self.child = pexpect.spawn(
            sys.executable,
            ["-c", PROGRAM, "measure", *arguments],
            cwd=str(folder),
            env=environment,
            dimensions=(24, columns),
            encoding="utf-8",
            timeout=30,
        )
        self.child.delaybeforesend = None
        self.seen = ""

    def __enter__(self) -> "Terminal":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.child.close(force=True)

    def expect(self, pattern: re.Pattern[str] | str) -> re.Match[str]:
        """Wait for the pattern; everything shown is kept in `seen`."""
        compiled = re.compile(pattern) if isinstance(pattern, str) else pattern
        self.child.expect(compiled)
        self.seen += (self.child.before or "") + (self.child.after or "")
        match = self.child.match
        assert isinstance(match, re.Match)
        return match

    def step(self) -> int:
        """Wait for the prompt of a step; its number."""
        return int(self.expect(PROMPT).group(1))

    def type(self, text: str, end: str = "\r") -> None:
        """Type something."""
        self.child.send(text + end)

    def finish(self) -> int:
        """Wait for the end; the exit code (negative for a signal)."""
        self.child.expect(pexpect.EOF)
        self.seen += self.child.before or ""
        self.child.close()
        if self.child.exitstatus is None:
            return -int(self.child.signalstatus or 0)
        return int(self.child.exitstatus)


class SerialLine:
    """A gauge on a pseudo-terminal; `path` stays the same when it is plugged in again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._master = self._slave = -1
        self.plug_in()

    def plug_in(self) -> None:
        """Make the device appear."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self.path.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Make the device vanish."""
        self.path.unlink()
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1

    def send(self, data: bytes) -> None:
        """The gauge sends."""
        os.write(self._master, data)

    def received(self) -> bytes:
        """What the gauge was sent; waits for it."""
        return os.read(self._master, 100)

    def close(self) -> None:
        """Take the gauge away at the end of a test."""
        if self._master >= 0:
            self.unplug()
