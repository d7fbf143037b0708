"""The terminal of any operating system, as the program wants it."""

import os
from contextlib import suppress
from typing import Protocol

# Where nobody says how wide the screen is.
COLUMNS = 80
END_OF_INPUT = "\x04"  # Ctrl-D; what other systems use instead is read as this


class Terminal(Protocol):
    """The terminal of standard input: each key as it is pressed, and nothing shown of it."""

    screens: tuple[int, ...]  # descriptors that know how wide the screen is

    def read(self, timeout_s: float) -> str:
        """The keys pressed since the last call; "" after the time-out.

        Raises:
            EOFError: the terminal was closed.
            KeyboardInterrupt: Ctrl-C.
        """

    def write(self, text: str) -> None:
        """Show what was typed."""

    def columns(self) -> int:
        """The width of the screen, in characters."""
        for descriptor in self.screens:
            with suppress(OSError):
                return os.get_terminal_size(descriptor).columns or COLUMNS
        return COLUMNS

    def disturbed(self) -> bool:
        """True once after the program was stopped and continued."""
        return False

    def close(self) -> None:
        """Leave the terminal as it was."""
