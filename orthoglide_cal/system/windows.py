"""Windows: the console and locks of its C library, the module `msvcrt`."""

import os
import time
from pathlib import Path
from typing import Protocol

from orthoglide_cal.system.interface import END_OF_INPUT, System, Terminal

_LOOK_S = 0.01  # how often the console is asked for a pressed key [s]; it cannot wait for one
# Windows keeps others from reading locked bytes: lock one far behind the end of any journal.
_LOCKED_BYTE = 1 << 30
# An arrow or function key is announced by one of these; its code follows at once.
_PREFIXES = "\x00\xe0"
_INTERRUPT, _END = "\x03", "\x1a"  # Ctrl-C, Ctrl-Z


class Msvcrt(Protocol):
    """What is used of the module `msvcrt`."""

    LK_NBLCK: int

    def kbhit(self) -> bool: ...
    def getwch(self) -> str: ...
    def putwch(self, unicode_char: str, /) -> None: ...
    def locking(self, fd: int, mode: int, nbytes: int, /) -> None: ...


class WindowsTerminal(Terminal):
    """The console; no program is stopped in it."""

    screens = (1, 2)  # Windows knows the size of what is written to only

    def __init__(self, msvcrt: Msvcrt) -> None:
        self._msvcrt = msvcrt

    def read(self, timeout_s: float) -> str:
        until = time.monotonic() + timeout_s
        while not self._msvcrt.kbhit():
            if time.monotonic() >= until:
                return ""
            time.sleep(_LOOK_S)
        keys = ""
        while self._msvcrt.kbhit():
            key = self._msvcrt.getwch()
            if key in _PREFIXES and self._msvcrt.kbhit():
                self._msvcrt.getwch()
            elif key == _INTERRUPT:
                raise KeyboardInterrupt
            else:
                keys += END_OF_INPUT if key == _END else key
        return keys

    def write(self, text: str) -> None:
        for character in text.replace("\n", "\r\n"):
            self._msvcrt.putwch(character)

    def close(self) -> None:
        """The console's mode was never changed; what was typed for nobody is dropped."""
        while self._msvcrt.kbhit():
            self._msvcrt.getwch()


class Windows(System):
    """Windows, through its C library."""

    def __init__(self, msvcrt: Msvcrt) -> None:
        self._msvcrt = msvcrt

    def terminal(self, descriptor: int) -> WindowsTerminal:
        # A program has one console only.
        return WindowsTerminal(self._msvcrt)

    def lock(self, descriptor: int) -> None:
        place = os.lseek(descriptor, 0, os.SEEK_CUR)
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            self._msvcrt.locking(descriptor, self._msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(descriptor, place, os.SEEK_SET)

    def publish(self, temporary: Path, path: Path) -> None:
        """Here a rename fails where another file has the name."""
        temporary.rename(path)

    def sync_folder(self, folder: Path) -> None:
        """A folder cannot be opened here; its file system keeps a journal of names itself."""
