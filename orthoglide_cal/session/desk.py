"""Where questions are put and answered: keyboard and gauge together, behind one `ask`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from orthoglide_cal.session.gauges.source import Gauge, GaugeLost, Heard
from orthoglide_cal.session.steps import Step

# How long the keyboard is awaited before the gauge is looked at again [s].
POLL_S = 0.05
RECONNECT_S = 0.5
# A person needs longer than this for a reading; the second of two presses comes sooner [s].
HASTE_S = 0.3


class Keyboard(Protocol):
    """Lines of text from whoever answers."""

    live: bool
    """True for a terminal: what is typed before a prompt appears does not belong to it."""

    def read(self, timeout_s: float | None) -> str | None:
        """A line without its end; None after the time-out. Raises EOFError at the end."""

    def flush(self) -> None:
        """Forget what was typed so far (terminals only)."""


class Show(Protocol):
    """Shows text; `style` is "title", "dim", "good", "bad", "question", "prompt" or ""."""

    def __call__(self, text: str, style: str = "", end: str = "\n") -> None: ...


@dataclass(frozen=True)
class Typed:
    """An answer from the keyboard.

    Attributes:
        text: without blanks around it.
        hasty: it repeats the previous answer at once, and that one had come at leisure.
    """

    text: str
    hasty: bool = False


class Desk:
    """One technician, one keyboard, perhaps one gauge."""

    def __init__(
        self,
        keyboard: Keyboard,
        show: Show,
        gauge: Gauge | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._keyboard = keyboard
        self._show = show
        self._gauge = gauge
        self._clock = clock
        self._last = ""
        self._last_waited = 0.0
        self._lost_since: float | None = None

    @property
    def hint(self) -> str:
        """What to do for a reading besides typing it."""
        return self._gauge.hint if self._gauge else ""

    def ask(self, prompt: str, step: Step | None = None, takes: int = 0) -> Typed | Heard:
        """Show a prompt and wait for the answer.

        Args:
            prompt: the question.
            step: the reading wanted; None if only words are.
            takes: readings of this step that arrived earlier.

        Raises:
            EOFError: nobody will ever answer.
        """
        gauge = self._gauge if step is not None else None
        self._keyboard.flush()
        if gauge is not None and step is not None:
            gauge.begin(step, takes)
        self._show(prompt, "prompt", end="")
        since = self._clock()
        while True:
            line = self._keyboard.read(None if gauge is None else POLL_S)
            if line is not None and (line.strip() or gauge is None):
                waited = self._clock() - since
                if not self._keyboard.live:
                    self._show(_printable(line.strip()))  # a terminal has shown it itself
                return self._typed(line.strip(), waited)
            if gauge is None:
                continue
            heard = self._listen(gauge, asked=line is not None, prompt=prompt)
            if heard is not None:
                return heard

    def _typed(self, text: str, waited: float) -> Typed:
        numeric = any(c.isdigit() for c in text)
        again = self._keyboard.live and numeric and text == self._last
        # Where every answer comes at once, a machine is typing: then haste says nothing.
        hasty = again and waited < HASTE_S <= self._last_waited
        self._last, self._last_waited = text, waited
        return Typed(text, hasty)

    def _listen(self, gauge: Gauge, asked: bool, prompt: str) -> Heard | None:
        """One look at the gauge; messages interrupt the prompt and show it again."""
        if self._lost_since is not None and not self._is_back(gauge, prompt):
            return None
        try:
            if asked:
                gauge.request()
            heard = gauge.poll()
        except GaugeLost as lost:
            self._lost_since = self._clock()
            self._show("")
            self._show(f"{lost.what}", "bad")
            self._show("Plug it in again and the session goes on; or type the reading, or q.")
            self._show(prompt, "prompt", end="")
            return None
        for item in heard:
            if item.token.value is not None and not item.elsewhere:
                if not (asked and self._keyboard.live):
                    self._show("")  # nobody pressed Return in the line of the prompt
                return item
            self._show("")
            said = _printable(item.token.raw)
            why = item.elsewhere or "That is no reading: nothing is recorded."
            self._show(f"The gauge says '{said}'. {why}", "bad")
            self._show(prompt, "prompt", end="")
        return None

    def _is_back(self, gauge: Gauge, prompt: str) -> bool:
        now = self._clock()
        if self._lost_since is None or now - self._lost_since < RECONNECT_S:
            return False
        if not gauge.reconnect():
            self._lost_since = now
            return False
        self._lost_since = None
        self._show("")
        self._show("The gauge is back.", "good")
        self._show(prompt, "prompt", end="")
        return True


def _printable(text: str) -> str:
    """Text as it may be shown: short, without control characters."""
    return "".join(c if c.isprintable() else "?" for c in text)[:40]
