"""The real program in a real pseudo-terminal of 80 × 24 characters, and gauges on other ones."""

import contextlib
import os
import re
import subprocess
import sys
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import pexpect
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app

from .virtual import a_run

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


def run_program(
    folder: Path,
    *arguments: str,
    stdin: str = "",
    before: Callable[[], None] | None = None,
) -> subprocess.CompletedProcess[str]:
    """`orthocal measure` without a terminal; `before` runs in the new process."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, "measure", *arguments],
        cwd=folder,
        input=stdin,
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        preexec_fn=before,
        check=False,
    )


def refused(folder: Path, *arguments: str) -> tuple[int, str]:
    """`orthocal measure` in this process, for what ends before the first prompt.

    Returns:
        Exit code and everything it said, with single blanks.
    """
    with contextlib.chdir(folder):
        done = CliRunner().invoke(app, ["measure", *arguments])
    return done.exit_code, " ".join(done.output.split())


def begun(folder: Path) -> bytes:
    """A session with two readings, interrupted; its journal's bytes."""
    run, _, journal = a_run(folder / "s.journal", ["-0.64", "0.41"])
    with journal, contextlib.suppress(EOFError):
        run.run()
    return (folder / "s.journal").read_bytes()
