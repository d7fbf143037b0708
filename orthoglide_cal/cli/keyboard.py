"""Lines from the terminal or from a pipe, one at a time."""

from __future__ import annotations

import os
import select
import sys
from contextlib import suppress
from types import TracebackType
from typing import Any, NoReturn

from orthoglide_cal.errors import UsageError

if sys.platform != "win32":
    import termios


class StandardInput:
    """Standard input. In a terminal the line stays editable, and TAB ends it as Return does."""

    def __init__(self) -> None:
        self.live = False
        self._file = -1
        self._rest = b""
        self._ended = False
        self._before: list[Any] | None = None

    def __enter__(self) -> StandardInput:
        if sys.platform == "win32":
            raise UsageError(
                "`measure` needs a POSIX terminal.", "Run it under Linux, macOS or WSL."
            )
        self._file = sys.stdin.fileno()
        self.live = os.isatty(self._file)
        if self.live:
            self._before = termios.tcgetattr(self._file)
            mode = termios.tcgetattr(self._file)
            # Some gauges end their number with TAB: let the terminal take that for an end, too.
            mode[6][termios.VEOL] = b"\t"
            termios.tcsetattr(self._file, termios.TCSADRAIN, mode)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._before is not None:
            with suppress(termios.error):  # the terminal was closed
                termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def flush(self) -> None:
        """Forget what was typed before this prompt (terminals only)."""
        if self.live:
            self._rest = b""
            try:
                termios.tcflush(self._file, termios.TCIFLUSH)
            except termios.error as error:
                raise EOFError from error

    def read(self, timeout_s: float | None) -> str | None:
        """A line without its end; None after the time-out. Raises EOFError."""
        line = self._take_line()
        if line is not None:
            return line
        if self._ended:
            self._end()
        ready, _, _ = select.select([self._file], [], [], timeout_s)
        if not ready:
            return None
        try:
            data = os.read(self._file, 4096)
        except OSError as error:  # the terminal was closed
            raise EOFError from error
        if not data:
            self._ended = True
            if self._rest:
                data, self._rest = self._rest, b""
                return _text(data)
            self._end()
        self._rest += data
        if self.live and data.endswith(b"\t"):
            sys.stdout.write("\n")
        if len(self._rest) > 65536:  # no one types that
            self._rest = self._rest[-1:]
        return self._take_line()

    def _end(self) -> NoReturn:
        # In a terminal the end of input is a key like others: what follows it can be read again.
        self._ended = not self.live
        raise EOFError

    def _take_line(self) -> str | None:
        ends = [at for end in (b"\n", b"\r", b"\t") if (at := self._rest.find(end)) >= 0]
        if not ends:
            return None
        end = min(ends)
        line, mark, rest = self._rest[:end], self._rest[end : end + 1], self._rest[end + 1 :]
        self._rest = rest[1:] if mark == b"\r" and rest.startswith(b"\n") else rest
        return _text(line)


def _text(data: bytes) -> str:
    return data.decode("utf-8", errors="replace")
