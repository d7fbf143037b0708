"""Questions and their answers: the keyboard, and with a gauge together behind one `ask`."""

import codecs
import math
import os
import re
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from queue import Empty, SimpleQueue
from typing import NamedTuple, Protocol, TextIO

from orthoglide_cal.errors import visible
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.session.gauges import GaugeLost, LiveGauge, Token
from orthoglide_cal.system import Terminal, terminal
from orthoglide_cal.words import counted, wrapped

POLL_S = 0.05  # the keyboard is awaited so long before the gauge is looked at again [s]
ANSWER_S = 1.5  # a gauge that is asked answers sooner [s]
# A button pressed twice, or bouncing, is over by then; reading the other dial takes longer [s].
BETWEEN_GAUGES_S = 1.2
AFTER_A_DRIVE_S = 2.0  # no machine is driven to another posture sooner [s]
# So many messages, too soon or evenly spaced to within so much [s], are not pressed by anybody.
STREAM, EVEN_S = 4, 0.15
BY_HAND_S = 0.06  # a gauge, or one that acts as a keyboard, is faster [s per character]
BACK_AT_THE_KEYS_S = 0.3  # and a hand needs so long to come back to the keys [s]
_ENDS = "\r\n\t"  # some gauges end their number with TAB
_ERASE, _ERASE_ALL = "\x7f\b\x15", "\x15"
_END_OF_INPUT = "\x04\x1a"  # Ctrl-D; on Windows Ctrl-Z, which elsewhere is no key but a signal
_WIDEST = 80  # more is not easily read; taken where nobody says how wide the screen is
_LONGEST = 4096  # no one types more
_FOREVER_S = 3600.0


class Line(NamedTuple):
    """A line from the keyboard, without its end; when it began and ended, monotonic [s]."""

    text: str
    begun: float = 0.0
    ended: float = 0.0


class Keyboard:
    """Standard input; in a terminal what is typed is shown on `output`, and can be corrected."""

    def __init__(self, output: TextIO) -> None:
        self._output = output
        self._lines: deque[Line | None] = deque()  # None: the end of input
        self._typed, self._begun, self._after_return = "", 0.0, False

    def close(self) -> None:
        """Leave the terminal as it was."""
        if opened := self.__dict__.pop("_terminal", None):
            opened.close()

    @property
    def live(self) -> bool:
        """True if it is a terminal, where what is typed before a prompt is no answer to it."""
        return sys.stdin is not None and sys.stdin.isatty()

    @property
    def columns(self) -> int:
        """Width of what is shown."""
        for descriptor in (0, 1, 2) if self.live else ():
            with suppress(OSError):  # Windows knows the size of what is written to only
                return min(os.get_terminal_size(descriptor).columns or _WIDEST, _WIDEST)
        return _WIDEST

    @property
    def partial(self) -> str:
        """The beginning that was typed of a line that has not ended."""
        return visible(self._typed)

    def disturbed(self) -> bool:
        """True once after the program was stopped and continued."""
        return self.live and self._terminal.disturbed()

    def read(self, timeout_s: float | None) -> Line | None:
        """A line; None after the time-out. Raises EOFError at the end.

        Without time it takes in what was typed up to now, and a terminal does not show it.
        """
        until = time.monotonic() + (_FOREVER_S if timeout_s is None else timeout_s)
        while not self._lines:
            left = max(until - time.monotonic(), 0.0)
            if self.live:
                self._edit(self._terminal.read(left), shown=timeout_s != 0.0)
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

    @cached_property
    def _terminal(self) -> Terminal:
        return terminal(sys.stdin.fileno())

    @cached_property
    def _pipe(self) -> SimpleQueue[str]:
        pipe, descriptor = SimpleQueue[str](), sys.stdin.fileno() if sys.stdin else 0
        threading.Thread(target=_listen, args=(descriptor, pipe), daemon=True).start()
        return pipe

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
                erased = self._typed if key == _ERASE_ALL else self._typed[-1:]
                answer += "\b \b" * len(visible(erased))
                self._typed = self._typed.removesuffix(erased)
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


class Style(StrEnum):
    """Kind of a text; its look where colours are wanted, as terminals number looks."""

    PLAIN = ""
    TITLE = "1"  # bold
    DIM = "2"
    GOOD = "32"  # green
    BAD = "1;31"  # bold red
    QUESTION = "1;33"  # bold yellow
    PROMPT = "1;36"  # bold cyan
    ASIDE = "33"  # yellow; of what was not asked for
    ABOVE = "2F\x1b[J"  # plain, in the place of the two lines above


class Show(Protocol):
    """Shows text, of one or more lines."""

    def __call__(self, text: str, style: Style = Style.PLAIN, end: str = "\n") -> None: ...


class Unasked(NamedTuple):
    """No answer: a gauge sends by itself."""

    readings: int  # that some of its messages became


@dataclass(eq=False)
class DeadTime:
    """Guard against what from one source arrives too soon to be meant; all times are monotonic [s].

    After a reading each source (keyboard, gauges) is ignored for a while, for second presses; what
    arrives then starts it again. A gauge that sends by itself is known by its pace, and ignored
    until it is quiet.
    """

    opens: float = -math.inf  # from when on a message counts
    sends: bool = False  # by itself, until it is quiet
    _last: float = -math.inf  # the last reading or message
    # The last messages that no hand typed: when, and whether each was too soon, or a reading.
    _messages: tuple[tuple[float, bool, bool], ...] = ()

    def begin(self, at: float, driving: bool, mine: bool) -> None:
        """A reading arrived, from this source if `mine`; the machine may be driven now."""
        self._last = at
        self.opens = max(self.opens, at + (AFTER_A_DRIVE_S if driving else BETWEEN_GAUGES_S))
        if mine and self._messages:
            self._messages = *self._messages[:-1], (at, False, True)

    def is_early(self, begun: float, shown: float, by_hand: bool = False) -> bool:
        """True if a message cannot be meant for the question that stands there since `shown`."""
        opens = self._last + BACK_AT_THE_KEYS_S if by_hand else self.opens
        return begun < max(opens, shown)

    def ignore(self, at: float) -> float | None:
        """A message was too soon; the time since the last one [s], None if only its prompt was."""
        gone = at - self._last if at < self.opens else None
        self._last, self.opens = at, max(self.opens, at + BETWEEN_GAUGES_S)
        return gone

    def hear(self, at: float, early: bool, by_hand: bool) -> int | None:
        """A message came: how many of the last ones were readings, if no hand keeps their pace."""
        self._messages = () if by_hand else (*self._messages[1 - STREAM :], (at, early, False))
        gaps = [late[0] - before[0] for before, late in pairwise(self._messages)]
        if len(gaps) < STREAM - 1:
            return None
        even = max(gaps) - min(gaps) <= EVEN_S
        if not even and not all(early for _, early, _ in self._messages[1:]):
            return None
        readings = sum(read for _, _, read in self._messages)
        self._messages = tuple((then, True, False) for then, _, _ in self._messages)
        self.opens = max(self.opens, at + max(2.0 * max(gaps), BETWEEN_GAUGES_S))
        return readings

    def is_quiet(self, now: float) -> bool:
        """True once, when a source that sent by itself does not send any more."""
        quiet = self.sends and now >= self.opens
        if quiet:
            self.sends, self._messages = False, ()
        return quiet


@dataclass(eq=False)
class Asker:
    """Asks one technician, who has one keyboard and perhaps one gauge."""

    keyboard: Keyboard
    show: Show
    gauge: LiveGauge | None = None
    clock: Callable[[], float] = time.monotonic
    pushed: bool = False  # whether something has come between since the place was shown
    _keys: DeadTime = field(default_factory=DeadTime)
    _gauges: DeadTime = field(default_factory=DeadTime)
    _answered: tuple[float, DeadTime | None] = (0.0, None)  # when, and by which source
    _prompt: str = ""
    _shown: float = math.inf  # since when the prompt stands there
    _asked: float | None = None  # when Return asked the gauge, until it says something
    _unasked: Unasked | None = None  # to be answered next
    _lost: bool = False  # the gauge does not answer, which was said
    _line_is_open: bool = False

    @property
    def hint(self) -> str:
        """Advice how to read, behind the question for a reading; empty without a gauge."""
        return f" ({self.gauge.hint})" if self.gauge else ""

    @property
    def _strict(self) -> bool:
        """True if what comes too soon is a second press; a simulated gauge has no button."""
        return self.gauge is None or not self.gauge.reads_itself

    def say(self, text: str, style: Style = Style.PLAIN, *, pushes: bool = True) -> None:
        """Show text whose lines end where the screen does; if it `pushes`, the place moves up."""
        self.pushed = self.pushed or pushes
        self.show(wrapped(text, self.keyboard.columns), style)

    def rest(self, driving: bool) -> None:
        """The last answer was a reading: begin the dead time, longer if the machine is driven."""
        at, source = self._answered
        for dead in (self._keys, self._gauges) if self._strict else ():
            dead.begin(at, driving, dead is source)

    def ask(
        self, prompt: str, step: SessionStep | None = None, takes: int = 0
    ) -> str | Token | Unasked:
        """Wait for the reading of a step, after `takes` others, or for words without one.

        Of the prompt its last line is shown; those above it are on the screen already, and are
        shown again where something has come between. Raises EOFError: nobody will ever answer.
        """
        self._prompt, self._shown, self._asked = prompt, math.inf, None
        typed, heard, gauge = 0, list[Token](), self.gauge
        while self.keyboard.live and (line := self.keyboard.read(0.0)) is not None:
            self._is_meant(line, self._keys)
            typed += 1
        if typed and not self._strict:
            lines = f"{counted(typed, 'line')} typed before the prompt"
            self._break_in(f"ignored: {lines}", Style.ASIDE)
        if gauge:
            with suppress(GaugeLost):  # the next look reports it
                heard = gauge.poll(asked=False)
        for item in heard:
            self._is_meant(Line(item.raw, self.clock(), self.clock()), self._gauges)
        if step is None:
            gauge = None
        elif gauge:
            gauge.begin(step, takes)
        if typed or heard:
            self._redraw()
        else:
            self.show(prompt.rpartition("\n")[2], Style.PROMPT, "")
        self._line_is_open, self._shown = True, self.clock()
        while (answer := self._look(gauge)) is None:
            pass
        return answer

    def _look(self, gauge: LiveGauge | None) -> str | Token | Unasked | None:
        """One look at the keyboard, then at the gauge, if it is asked."""
        if unasked := self._unasked:
            self._unasked = None
            self._end_line()
            return unasked
        live = self.keyboard.live
        if self.keyboard.disturbed():
            self._end_line()
            self._redraw()
        try:
            line = self.keyboard.read(POLL_S if gauge or live else None)
        except EOFError:
            if live or self._strict:
                raise
            line = Line("")
        if line is not None:
            text = line.text.strip()
            self._line_is_open = False
            if not live:
                self.show(visible(text)[:40])  # a terminal has shown it itself
            elif not self._is_meant(line, self._keys):
                return None
            if text or not gauge:
                self._answered = line.ended, self._keys
                return text
            self._asked = self.clock()
        if any(source.is_quiet(self.clock()) for source in (self._keys, self._gauges)):
            self._break_in("The gauge is quiet now.", Style.GOOD)
        return self._listen(gauge, line is not None) if gauge else None

    def _listen(self, gauge: LiveGauge, asked: bool) -> Token | None:
        now = self.clock()
        try:
            heard = gauge.poll(asked)
        except GaugeLost as lost:
            if not self._lost:
                more = "Plug it in again to continue; or type the reading, or q."
                self._break_in(f"{lost.what}\n{more}", Style.BAD)
            self._lost = True
            return None
        if self._lost:
            self._break_in("The gauge is back.", Style.GOOD)
        self._lost = False
        if heard:
            self._asked = None
        elif self._asked is not None and now - self._asked >= ANSWER_S:
            self._asked = None
            self._break_in(gauge.silence, Style.BAD)
        for item in heard:
            if not self._is_meant(Line(item.raw, now, now), self._gauges):
                continue
            if item.value is not None and not item.elsewhere:
                if self.keyboard.live and self._strict:
                    self.show(visible(item.raw.strip())[:40], Style.PLAIN, "")
                    self._answered = now, self._gauges
                self._end_line()
                return item
            why = item.elsewhere or "That is not a reading: nothing is recorded."
            self._break_in(f"The gauge says '{visible(item.raw)[:40]}'. {why}", Style.BAD)
        return None

    def _is_meant(self, line: Line, source: DeadTime) -> bool:
        """True if a message can be an answer; else it is said, of a gauge that sends just once."""
        if not self._strict:
            return True
        text, at = line.text.strip(), line.ended
        by_hand = 0 < len(text) * BY_HAND_S <= at - line.begun
        early = source.is_early(line.begun, self._shown, by_hand)
        # A key is no message of a gauge.
        heard = early or source is self._gauges or re.search(r"\d", text)
        readings = source.hear(at, early, by_hand) if heard else None
        gone = source.ignore(at) if early else None
        if readings is not None:
            if readings or not source.sends:
                self._unasked = Unasked(readings)
            source.sends = True
        elif early and not source.sends:
            when = "before the prompt" if gone is None else f"{gone:.2f} s after the one before"
            name = visible(text)[:24] or "Return"
            self._break_in(f"ignored: {name} came {when}; if intended, give it again", Style.ASIDE)
        return not early and readings is None

    def _end_line(self) -> None:
        """Go on below the line of the prompt, if it is open."""
        if self._line_is_open:
            self.show("")
        self._line_is_open = False

    def _break_in(self, text: str, style: Style) -> None:
        """A message below the line of the prompt, which is then shown again with its place."""
        self._end_line()
        self.say(text, style)
        if self._shown < math.inf:
            self._redraw()

    def _redraw(self) -> None:
        """Show the prompt again, with what stands above it and what was typed."""
        self.pushed = False
        above, line, prompt = self._prompt.rpartition("\n")
        self.show(wrapped(above, self.keyboard.columns) + line, Style.PLAIN, "")
        self.show(prompt, Style.PROMPT, "")
        self.show(self.keyboard.partial, Style.PLAIN, "")
        self._line_is_open = True
