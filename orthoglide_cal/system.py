"""Differences between systems: a terminal that hands over keys unseen, and the lock of a file."""

import codecs
import os
import select
import signal
import sys
import time
from contextlib import suppress
from importlib import import_module

WINDOWS = sys.platform == "win32"
if sys.platform != "win32":
    import fcntl
    import termios

_LOOK_S = 0.01  # how often the console is asked for a pressed key [s]; it cannot wait for one
# Windows keeps others from reading locked bytes: lock one far behind the end of any journal.
_LOCKED_BYTE = 1 << 30
# An arrow or function key is announced by one of these; its code follows at once.
_PREFIXES = "\x00\xe0"
_INTERRUPT = "\x03"  # Ctrl-C


class PosixTerminal:
    """On Linux, macOS and the like: not canonical, no echo."""

    def __init__(self, descriptor: int) -> None:
        self._input = descriptor
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._disturbed = False
        self._before = termios.tcgetattr(descriptor)
        self._handlers = {
            number: signal.signal(number, self._on_signal)
            for number in (signal.SIGCONT, signal.SIGTSTP)
            if signal.getsignal(number) != signal.SIG_IGN
        }
        self._take()

    def _take(self) -> None:
        mode = termios.tcgetattr(self._input)
        # A line ends with CR, LF or both, as the gauge pleases: they must arrive as they are.
        mode[0] &= ~termios.ICRNL
        mode[3] &= ~(termios.ICANON | termios.ECHO | termios.IEXTEN)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._input, termios.TCSADRAIN, mode)

    def _give_back(self, when: int) -> None:
        with suppress(termios.error):  # the terminal was closed
            termios.tcsetattr(self._input, when, self._before)

    def _on_signal(self, number: int, frame: object) -> None:
        self._disturbed = True
        if number == signal.SIGTSTP:
            self._give_back(termios.TCSADRAIN)
            signal.signal(signal.SIGTSTP, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGTSTP)
            # From here on it is continued.
            signal.signal(signal.SIGTSTP, self._on_signal)

    def read(self, timeout_s: float) -> str:
        """The keys pressed since the last call; "" after the time-out.

        Raises EOFError: the terminal was closed; KeyboardInterrupt: Ctrl-C.
        """
        try:
            if not any(select.select([self._input], [], [], timeout_s)):
                return ""
            data = os.read(self._input, 4096)
        except OSError as error:  # the terminal was closed
            raise EOFError from error
        if not data:
            raise EOFError
        return self._decoder.decode(data)

    def disturbed(self) -> bool:
        """True once after the program was stopped and continued."""
        disturbed, self._disturbed = self._disturbed, False
        if disturbed:  # whoever had the terminal meanwhile has set it differently
            with suppress(termios.error):
                self._take()
        return disturbed

    def close(self) -> None:
        """Leave it as it was; what was typed for nobody does not reach the shell."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._give_back(termios.TCSAFLUSH)


class WindowsTerminal:
    """The console of Windows, by its C library."""

    def __init__(self, descriptor: int) -> None:
        self._console = import_module("msvcrt")  # a program has one, whatever the descriptor

    def read(self, timeout_s: float) -> str:
        """Keys pressed since the last call; "" after the time-out. Raises KeyboardInterrupt."""
        until = time.monotonic() + timeout_s
        while not self._console.kbhit():
            if time.monotonic() >= until:
                return ""
            time.sleep(_LOOK_S)
        keys = ""
        while self._console.kbhit():
            key = self._console.getwch()
            if key in _PREFIXES and self._console.kbhit():
                self._console.getwch()
            elif key == _INTERRUPT:
                raise KeyboardInterrupt
            else:
                keys += key
        return keys

    def disturbed(self) -> bool:
        """False: no program is stopped in it."""
        return False

    def close(self) -> None:
        """The console's mode was never changed; what was typed for nobody is dropped."""
        while self._console.kbhit():
            self._console.getwch()


Terminal = PosixTerminal | WindowsTerminal


def terminal(descriptor: int) -> Terminal:
    """The terminal of this system, from now on; `close` leaves it as it was."""
    return WindowsTerminal(descriptor) if WINDOWS else PosixTerminal(descriptor)


def lock(descriptor: int) -> None:
    """Lock a file until it is closed or the process ends, however. Raises OSError if it is."""
    if not WINDOWS:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return
    msvcrt, place = import_module("msvcrt"), os.lseek(descriptor, 0, os.SEEK_CUR)
    os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    finally:
        os.lseek(descriptor, place, os.SEEK_SET)
