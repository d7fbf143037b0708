"""Lines from the terminal or from a pipe, one at a time, with the moment when each was begun."""

import codecs
import os
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import NamedTuple, TextIO

from orthoglide_cal.errors import visible
from orthoglide_cal.system import SYSTEM

# Some gauges end their number with TAB.
_ENDS = "\r\n\t"
_ERASE, _ERASE_ALL = "\x7f\b", "\x15"
_END_OF_INPUT = "\x04\x1a"  # Ctrl-D; on Windows Ctrl-Z, which elsewhere is no key but a signal
_COLUMNS = 80  # where nobody says how wide the screen is
_LONGEST = 4096  # no one types more
_FOREVER_S = 3600.0


class Line(NamedTuple):
    """A line from the keyboard, without its end; when it began and ended, monotonic [s]."""

    text: str
    begun: float = 0.0
    ended: float = 0.0


class Keyboard:
    """Standard input, opened when it is first needed. In a terminal the line can be corrected.

    What is typed is shown on `output`, where the prompts are.
    """

    def __init__(self, output: TextIO) -> None:
        self._output = output
        self._terminal: SYSTEM.Terminal | None = None
        self._pipe: SimpleQueue[str] | None = None
        self._lines: deque[Line | None] = deque()  # None: the end of input
        self._typed = ""
        self._begun = 0.0
        self._after_return = False

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    @property
    def live(self) -> bool:
        """True if it is a terminal, where what is typed before a prompt is no answer to it."""
        return sys.stdin is not None and sys.stdin.isatty()

    @property
    def columns(self) -> int:
        """Width of the screen; of a usual one where there is none."""
        for descriptor in (0, 1, 2) if self.live else ():
            with suppress(OSError):  # Windows knows the size of what is written to only
                return os.get_terminal_size(descriptor).columns or _COLUMNS
        return _COLUMNS

    @property
    def partial(self) -> str:
        """The beginning that was typed of a line that has not ended."""
        return visible(self._typed)

    def disturbed(self) -> bool:
        """True once after the program was stopped and continued."""
        return self.live and self._screen().disturbed()

    def read(self, timeout_s: float | None) -> Line | None:
        """A line; None after the time-out. Raises EOFError at the end.

        Without time it takes in what was typed up to now, and a terminal does not show it.
        """
        until = time.monotonic() + (_FOREVER_S if timeout_s is None else timeout_s)
        while not self._lines:
            left = max(until - time.monotonic(), 0.0)
            if self.live:
                self._edit(self._screen().read(left), shown=timeout_s != 0.0)
            else:
                self._append(left)
            if left == 0.0 and not self._lines:
                return None
        line = self._lines.popleft()
        if line is None:
            # In a terminal the end of input is a key like others; a pipe stays at its end.
            self._lines.extend(() if self.live else (None,))
            raise EOFError
        return line

    def _screen(self) -> SYSTEM.Terminal:
        if self._terminal is None:
            self._terminal = SYSTEM.Terminal(sys.stdin.fileno())
        return self._terminal

    def _edit(self, keys: str, shown: bool) -> None:
        """Let keys change the line; those typed for a prompt are `shown`."""
        answer = ""
        for key in keys:
            now = time.monotonic()
            if key == "\n" and self._after_return:
                pass  # the LF of a CR LF
            elif key in _ENDS:
                answer += "\n"
                self._lines.append(Line(self._typed, self._begun if self._typed else now, now))
                self._typed = ""
            elif key in _ERASE:
                answer += "\b \b" * len(visible(self._typed[-1:]))
                self._typed = self._typed[:-1]
            elif key == _ERASE_ALL:
                answer += "\b \b" * len(self.partial)
                self._typed = ""
            elif key in _END_OF_INPUT:
                self._lines.extend(() if self._typed else (None,))
            elif len(self._typed) < _LONGEST:
                answer += visible(key)
                self._begun = self._begun if self._typed else now
                self._typed += key
            self._after_return = key == "\r"
        if answer and shown:
            self._output.write(answer)
            self._output.flush()

    def _append(self, timeout_s: float) -> None:
        """Wait for more from a pipe."""
        if self._pipe is None:
            self._pipe = SimpleQueue()
            source = (sys.stdin.fileno() if sys.stdin else 0, self._pipe)
            threading.Thread(target=_listen, args=source, daemon=True).start()
        with suppress(Empty):
            text = self._pipe.get(timeout=timeout_s)
            self._edit(text or "\n" * bool(self._typed), shown=False)
            self._lines.extend(() if text else (None,))


def _listen(descriptor: int, heard: SimpleQueue[str]) -> None:
    """Pass on what comes from a pipe, "" at its end: not every system can wait for a pipe."""
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    data = b"-"
    while data:
        try:
            data = os.read(descriptor, 4096)
        except OSError:  # whoever wrote to it has gone
            data = b""
        if text := decoder.decode(data, final=not data):
            heard.put(text)
    heard.put("")
