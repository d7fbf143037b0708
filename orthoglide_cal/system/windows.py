"""Windows: the console and locks of its C library, the module `msvcrt`."""

import os
import time
from importlib import import_module

msvcrt = import_module("msvcrt")  # other systems do not have it
_LOOK_S = 0.01  # how often the console is asked for a pressed key [s]; it cannot wait for one
# Windows keeps others from reading locked bytes: lock one far behind the end of any journal.
_LOCKED_BYTE = 1 << 30
# An arrow or function key is announced by one of these; its code follows at once.
_PREFIXES = "\x00\xe0"
_INTERRUPT = "\x03"  # Ctrl-C


class WindowsTerminal:
    """The console."""

    def __init__(self, descriptor: int) -> None:
        """A program has one console only, whatever the descriptor."""

    def read(self, timeout_s: float) -> str:
        """Keys pressed since the last call; "" after the time-out. Raises KeyboardInterrupt."""
        until = time.monotonic() + timeout_s
        while not msvcrt.kbhit():
            if time.monotonic() >= until:
                return ""
            time.sleep(_LOOK_S)
        keys = ""
        while msvcrt.kbhit():
            key = msvcrt.getwch()
            if key in _PREFIXES and msvcrt.kbhit():
                msvcrt.getwch()
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
        while msvcrt.kbhit():
            msvcrt.getwch()


Terminal = WindowsTerminal


def lock(descriptor: int) -> None:
    """Lock a file until it is closed or the process ends, however. Raises OSError if it is."""
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    finally:
        os.lseek(descriptor, place, os.SEEK_SET)
