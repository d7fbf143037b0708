"""Linux, macOS and the like."""

import codecs
import fcntl
import os
import select
import signal
import termios
from contextlib import suppress


class PosixTerminal:
    """A terminal that hands over each key at once (not canonical) and shows none (no echo)."""

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
            ready, _, _ = select.select([self._input], [], [], timeout_s)
            if not ready:
                return ""
            data = os.read(self._input, 4096)
        except OSError as error:  # the terminal was closed
            raise EOFError from error
        if not data:
            raise EOFError
        return self._decoder.decode(data)

    def disturbed(self) -> bool:
        """True once after the program was stopped and continued."""
        # Whoever had the terminal meanwhile has set it differently.
        if not self._disturbed:
            return False
        self._disturbed = False
        with suppress(termios.error):
            self._take()
        return True

    def close(self) -> None:
        """Leave it as it was; what was typed for nobody does not reach the shell."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._give_back(termios.TCSAFLUSH)


Terminal = PosixTerminal


def lock(descriptor: int) -> None:
    """Lock a file until it is closed or the process ends, however. Raises OSError if it is."""
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
