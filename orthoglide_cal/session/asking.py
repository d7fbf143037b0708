"""Where questions are put and answered: keyboard and gauge together, behind one `ask`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol

from orthoglide_cal.errors import OrthocalError, visible
from orthoglide_cal.session.gauges.formats import Token
from orthoglide_cal.session.steps import SessionStep

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


class Style(StrEnum):
    """What a text is, for whoever shows it."""

    PLAIN = "plain"
    TITLE = "title"
    DIM = "dim"
    GOOD = "good"
    BAD = "bad"
    QUESTION = "question"
    PROMPT = "prompt"


class Show(Protocol):
    """Shows text, of one or more lines."""

    def __call__(self, text: str, style: Style = Style.PLAIN, end: str = "\n") -> None: ...


class GaugeLost(OrthocalError):
    """The gauge does not answer any more: unplugged, switched off, or the port is in use."""

    exit_code = 3


class Heard(NamedTuple):
    """Something that a gauge said at a prompt; `source` is its name for the records.

    `elsewhere` is a sentence if it was not the gauge that is asked: its value is not used.
    """

    token: Token
    source: str
    elsewhere: str | None = None


class Typed(NamedTuple):
    """An answer from the keyboard; hasty if it repeats the previous one without a pause."""

    text: str
    hasty: bool = False


class LiveGauge(Protocol):
    """A gauge that the program listens to, besides the keyboard."""

    hint: str
    """What to do for a reading, e.g. "press its button"."""

    reads_itself: bool = False
    """True if nobody need be there: where input from a pipe ends, Return is pressed for ever."""

    def begin(self, step: SessionStep, takes: int) -> None:
        """A prompt for this step, which was read `takes` times: forget what was said before."""

    def poll(self, asked: bool) -> list[Heard]:
        """What was said since the last call; `asked`: Return was pressed. Raises GaugeLost."""

    def reconnect(self) -> bool:
        """After GaugeLost: try again; True if it is back."""
        return True

    def close(self) -> None:
        """Let go of the port, if it has one."""
        return


@dataclass(eq=False)
class Asker:
    """Asks one technician, who has one keyboard and perhaps one gauge."""

    keyboard: Keyboard
    show: Show
    gauge: LiveGauge | None = None
    clock: Callable[[], float] = time.monotonic
    _last: str = ""
    _last_waited: float = 0.0
    _lost_since: float | None = None
    _line_is_open: bool = False

    @property
    def hint(self) -> str | None:
        """What to do for a reading besides typing it."""
        return self.gauge.hint if self.gauge else None

    def ask(self, prompt: str, step: SessionStep | None = None, takes: int = 0) -> Typed | Heard:
        """Show a prompt and wait for the answer.

        Args:
            prompt: the question.
            step: the reading wanted, the first or after `takes` others; None if words are.

        Raises:
            EOFError: nobody will ever answer.
        """
        gauge = self.gauge if step is not None else None
        if gauge is not None and step is not None:
            gauge.begin(step, takes)
        self.keyboard.flush()
        self.show(prompt, Style.PROMPT, "")
        self._line_is_open, since = True, self.clock()
        while True:
            try:
                line = self.keyboard.read(None if gauge is None else POLL_S)
            except EOFError:
                if self.keyboard.live or self.gauge is None or not self.gauge.reads_itself:
                    raise
                line = ""
            if line is not None and (line.strip() or gauge is None):
                return self._typed(line.strip(), self.clock() - since)
            if gauge is None:
                continue
            if line is not None:
                self._line_is_open = False
                if not self.keyboard.live:
                    self.show("")  # a terminal has moved on to the next line itself
            heard = self._listen(gauge, line is not None, prompt)
            if heard is not None:
                if self._line_is_open:
                    self.show("")  # nobody pressed Return in the line of the prompt
                return heard

    def _typed(self, text: str, waited: float) -> Typed:
        if not self.keyboard.live:
            self.show(visible(text)[:40])  # a terminal has shown it itself
        again = self.keyboard.live and text == self._last and any(c.isdigit() for c in text)
        # Where every answer comes at once, a machine is typing: then haste says nothing.
        hasty = again and waited < HASTE_S <= self._last_waited
        self._last, self._last_waited = text, waited
        return Typed(text, hasty)

    def _listen(self, gauge: LiveGauge, asked: bool, prompt: str) -> Heard | None:
        """One look at the gauge."""
        now = self.clock()
        if self._lost_since is not None:
            if now - self._lost_since < RECONNECT_S:
                return None
            self._lost_since = None if gauge.reconnect() else now
            if self._lost_since is not None:
                return None
            self._break_in("The gauge is back.", Style.GOOD, prompt)
        try:
            heard = gauge.poll(asked)
        except GaugeLost as lost:
            self._lost_since = now
            more = "Plug it in again and the session goes on; or type the reading, or q."
            self._break_in(lost.what, Style.BAD, prompt, more)
            return None
        for item in heard:
            if item.token.value is not None and item.elsewhere is None:
                return item
            why = item.elsewhere or "That is no reading: nothing is recorded."
            said = f"The gauge says '{visible(item.token.raw)[:40]}'. {why}"
            self._break_in(said, Style.BAD, prompt)
        return None

    def _break_in(self, text: str, style: Style, prompt: str, more: str | None = None) -> None:
        """A message in the line of the prompt, which is then shown again."""
        self.show(f"\n{text}", style)
        if more is not None:
            self.show(more)
        self.show(prompt, Style.PROMPT, "")
        self._line_is_open = True
