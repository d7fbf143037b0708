"""What every gauge is for the dialogue, and what it or a person says."""

from __future__ import annotations

import re
from typing import NamedTuple, Protocol

from orthoglide_cal.errors import OrthocalError, visible
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.words import MM_PER_INCH, Unit

# Error messages that look like numbers: they must never become one.
_ERROR_CODES = re.compile(r"[+-]?9{5,}(?:\.9+)?|9[0-9]{2}")
_TYPED = re.compile(
    r"(?P<value>[+-]?\s?(?:\d{1,6}(?:[.,]\d{0,6})?|[.,]\d{1,6}))\s*(?P<unit>mm|inch|in|\")?",
    flags=re.ASCII | re.IGNORECASE,
)
_UNITS = {"m": Unit.MM, "mm": Unit.MM} | dict.fromkeys(("i", "in", "inch", '"'), Unit.INCH)


class GaugeLost(OrthocalError):
    """The gauge does not answer any more: unplugged, switched off, or the port is in use."""

    exit_code = 3


class Token(NamedTuple):
    """One message of a gauge or one typed number, understood."""

    raw: str  # the characters that arrived
    value: float | None = None  # as shown by the gauge, in `unit`; None for an error message
    unit: Unit | None = None  # None where the gauge does not say
    channel: str | None = None  # of a multiplexer
    source: str = "typed"  # the gauge's name for the records
    elsewhere: str | None = None  # a sentence if not this gauge was asked: its value is not used

    @classmethod
    def of(cls, match: re.Match[str], raw: str) -> Token:
        """From a match with the group `value` and optionally `unit` and `channel`."""
        found = match.groupdict()
        digits = match["value"].replace(" ", "").replace(",", ".")
        channel = found.get("channel") or None
        unit = found.get("unit")
        if _ERROR_CODES.fullmatch(digits):
            return cls(raw, channel=channel)
        return cls(raw, float(digits), _UNITS[unit.lower()] if unit else None, channel)

    def mm(self, default: Unit) -> float | None:
        """The value in mm; `default` is its unit where the gauge gave none."""
        if self.value is None or (self.unit or default) is Unit.MM:
            return self.value
        # A gauge never shows more than a nanometre: drop the dust of the multiplication.
        return round(self.value * MM_PER_INCH, 6)


class NotAReading(Exception):
    """Typed text that is no reading; the message is the sentence to show."""


def parse_typed(text: str) -> Token:
    """What a person or a keyboard-wedge gauge types at a prompt.

    Accepts a sign (also U+2212), decimal point or comma, and a unit; nothing else. Exponents,
    digit groups and error codes are not readings. Raises NotAReading.
    """
    plain = text.strip().replace("\u2212", "-")
    match = _TYPED.fullmatch(plain)
    token = Token.of(match, text.strip()) if match else None
    if token is not None and token.value is not None:
        return token
    clean = visible(plain)
    shown = f"'{clean if len(clean) <= 24 else clean[:23] + '~'}'"
    if token is not None or re.search(r"err|^\d\s+to\b", plain, flags=re.IGNORECASE):
        raise NotAReading(f"{shown} is an error message of the gauge, not a reading.")
    if re.fullmatch(r"[+-]?[\d.,\s]+", plain) and len(re.findall(r"[.,]", plain)) > 1:
        raise NotAReading(f"{shown}: two numbers in one? Type one, such as -0.12.")
    raise NotAReading(f"{shown} is not a reading. Type a number such as -0.12, or ? for help.")


class LiveGauge(Protocol):
    """A gauge that the program listens to, in addition to the keyboard."""

    hint: str  # what to do for a reading, e.g. "press its button"
    silence: str = ""  # what to check where Return was pressed and nothing came
    # True if nobody need be there: where input from a pipe ends, Return is pressed for ever, and
    # no press of a button can come too soon.
    reads_itself: bool = False

    def begin(self, step: SessionStep, takes: int) -> None:
        """A prompt for this step, which was read `takes` times: forget what was said before."""

    def poll(self, asked: bool) -> list[Token]:
        """What was said since the last call; `asked`: Return was pressed. Raises GaugeLost."""

    def reconnect(self) -> bool:
        """After GaugeLost: try again; True if it is back."""
        return True

    def close(self) -> None:
        """Let go of the port, if it has one."""
        return
