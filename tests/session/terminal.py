"""The real program in a real pseudo-terminal of 80 × 24 characters, and gauges on other ones."""

import contextlib
import os
import re
import subprocess
import sys
import time
import traceback
import tty
from collections.abc import Callable, Sequence
from pathlib import Path

import pexpect

from tests.cli import program

from .virtual import answered

PROGRAM = "from orthoglide_cal.cli import main; main()"
# The same without dead times, for tests of something else that answer at once.
AT_ONCE = (
    "from orthoglide_cal.session import asking;"
    "asking.BETWEEN_GAUGES_S = asking.AFTER_A_DRIVE_S = 0.0; asking.STREAM = 1000;" + PROGRAM
)
# The last thing on the screen, perhaps followed by the end of a colour.
PROMPT = re.compile(r"(\d+)\. Gauge [XYZ][^\r\n]* > (?:\x1b\[0m)?$")
QUESTION = re.compile(r"(\d+)\. (?:k keep|Read again)[^\r\n]* > (?:\x1b\[0m)?$")
# The end of any prompt; what is typed sooner is not taken for an answer.
ASKED = re.compile(r"(?:>|\]:) (?:\x1b\[[0-9;]*m)*$")

# Much longer than anything takes, also on a machine that has other things to do [s].
PATIENCE_S = 300


def forked(
    program: str, arguments: Sequence[str], environ: dict[str, str], before: Callable[[], None]
) -> Callable[[], None]:
    """What a new process does instead of starting Python anew, which takes a second.

    It is a copy of this one, with the descriptors 0, 1 and 2 of a process that was started.
    """

    def run() -> None:
        code: object = 1
        try:
            os.closerange(3, 1024)
            os.environ.clear()
            os.environ.update(environ)
            before()
            sys.argv = ["orthocal", *arguments]
            sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
            sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            exec(program, {})
            code = 0
            sys.stdout.flush()
        except SystemExit as end:
            code = end.code or 0
            sys.stdout.flush()
        except BaseException:
            traceback.print_exc(file=sys.stderr)
        finally:
            sys.stderr.flush()
            os._exit(code if isinstance(code, int) else 1)

    return run


class Terminal(contextlib.AbstractContextManager["Terminal"]):
    """One run of a command.

    Of `measure`, `agreed`: nothing is asked before the first reading.
    """

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        command: tuple[str, ...] = ("measure",),
        colour: bool = False,
        agreed: bool = True,
        program: str = AT_ONCE,
    ) -> None:
        here = dict(os.environ)
        for name in ("COLUMNS", "LINES", "NO_COLOR"):
            here.pop(name, None)
        here |= {"TERM": "xterm-256color", **({} if colour else {"NO_COLOR": "1"})}
        words = [*command, *arguments, *(("--yes",) if agreed else ())]
        self.child = pexpect.spawn(
            sys.executable,
            ["-c", program, *words],
            cwd=str(folder),
            env=here,
            dimensions=(24, 80),
            encoding="utf-8",
            timeout=PATIENCE_S,
            preexec_fn=forked(program, words, here, lambda: None),
        )
        self.child.delaybeforesend = None
        self.seen = ""
        self._waits = program is AT_ONCE
        self._typed = 0  # so much was on the screen when the last answer was typed

    def __exit__(self, *_: object) -> None:
        self.child.close(force=True)

    def expect(self, pattern: re.Pattern[str] | str) -> re.Match[str]:
        """Wait for the pattern; everything shown is kept in `seen`."""
        compiled = re.compile(pattern) if isinstance(pattern, str) else pattern
        self.child.expect(compiled)
        self.seen += (self.child.before or "") + (self.child.after or "")
        return self.child.match

    def step(self) -> int:
        """Wait for the prompt of a step; its number."""
        return int(self.expect(PROMPT).group(1))

    def type(self, text: str, end: str = "\r") -> None:
        """Answer; without dead times only once it was asked for, as a person does."""
        if self._waits:
            until = time.monotonic() + PATIENCE_S
            while not ASKED.search((self.seen + self.child.buffer)[self._typed :]):
                assert time.monotonic() < until, "nothing was asked"
                with contextlib.suppress(pexpect.TIMEOUT):
                    self.child.buffer += self.child.read_nonblocking(4096, timeout=0.05)
        self._typed = len(self.seen + self.child.buffer)
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
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self.path.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        self.path.unlink()
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1

    def send(self, data: bytes) -> None:
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
    command: str = "measure",
) -> subprocess.CompletedProcess[str]:
    """`orthocal measure` without a terminal; `before` runs in the new process."""
    # On a full disk Python would keep a module's code cut off, for all runs after this one.
    here = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable],
        cwd=folder,
        input=stdin,
        capture_output=True,
        restore_signals=False,
        text=True,
        timeout=PATIENCE_S,
        preexec_fn=forked(PROGRAM, (command, *arguments), here, before or (lambda: None)),
        check=False,
    )


def refused(code: int, folder: Path, *arguments: str) -> str:
    """What `orthocal measure` says where it ends before the first prompt."""
    with contextlib.chdir(folder):
        done = program.run("measure", *arguments)
    assert done.exit_code == code, done.output
    return program.words(done.output)


def finished(folder: Path, *arguments: str, stdin: str = "") -> str:
    """Standard output of a session that ends well."""
    done = run_program(folder, *arguments, stdin=stdin)
    assert done.returncode == 0, done.stderr
    return done.stdout


def begun(folder: Path) -> bytes:
    """A session with two readings, interrupted; its journal's bytes."""
    answered(folder / "s.journal", ["-0.64", "0.41"])
    return (folder / "s.journal").read_bytes()
