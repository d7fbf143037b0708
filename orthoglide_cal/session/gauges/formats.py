"""What gauges send and people type, as readings; above all, what never becomes one."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

from orthoglide_cal.errors import UsageError, visible
from orthoglide_cal.words import MM_PER_INCH, Unit

# Error messages that look like numbers: they must never become one.
_ERROR_CODES = re.compile(r"[+-]?9{5,}(?:\.9+)?|9[0-9]{2}")


_UNITS = {"m": Unit.MM, "mm": Unit.MM} | dict.fromkeys(("i", "in", "inch", '"'), Unit.INCH)


class Token(NamedTuple):
    """One message of a gauge or one typed number, understood."""

    raw: str  # the characters that arrived
    value: float | None = None  # as shown by the gauge, in `unit`; None for an error message
    unit: Unit | None = None  # None where the gauge does not say
    channel: str | None = None  # of a multiplexer

    @classmethod
    def of(cls, match: re.Match[str], raw: str) -> Token:
        """From a match with the group `value` and optionally `unit` and `channel`."""
        found = {"unit": None, "channel": None, **match.groupdict()}
        digits = match["value"].replace(" ", "").replace(",", ".")
        channel = found["channel"] or None
        if _ERROR_CODES.fullmatch(digits):
            return cls(raw, channel=channel)
        unit = _UNITS[found["unit"].lower()] if found["unit"] else None
        return cls(raw, float(digits), unit, channel)

    def mm(self, default: Unit) -> float | None:
        """The value in mm; `default` is its unit where the gauge gave none."""
        if self.value is None or (self.unit or default) is Unit.MM:
            return self.value
        # A gauge never shows more than a nanometre: drop the dust of the multiplication.
        return round(self.value * MM_PER_INCH, 6)


@dataclass(frozen=True)
class SerialFormat:
    """How one family of gauges talks over a serial line."""

    name: str  # as in --gauge NAME:PORT
    pattern: str  # of a whole token; groups `value` and optionally `unit`, `channel`
    baud: int = 9600
    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1
    request: bytes | None = None  # asks for a reading; None if only its button sends one

    def parse(self, raw: str) -> Token:
        """What a token says; its value is None unless every character is as expected."""
        match = re.fullmatch(self.pattern, raw, flags=re.ASCII | re.IGNORECASE)
        return Token(raw) if match is None else Token.of(match, raw)


# A new gauge is one more entry here, and its name in the help of `orthocal measure --gauge`.
SERIAL_FORMATS = {
    item.name: item
    for item in (
        # Chicago Dial Indicator, Starrett: "+ 2.1380, MM", with blanks between the digits.
        SerialFormat(
            "cdi",
            r"(?P<value>[+-][ 0-9]{1,9}\.[ 0-9]{1,8}?)\s*,\s*(?P<unit>MM|IN)\s*",
            request=b"R\r",
        ),
        # Mahr MarCator, MarConnect RS232: "  12.345 mm".
        SerialFormat("mahr", r"\s*(?P<value>[+-]?\s*\d{1,4}\.\d{1,6})\s+(?P<unit>mm|inch|in)\s*"),
        # Mitutoyo MUX-10, QM-Height, USB input tools: "01A+0000.123", the gauge sets the unit.
        SerialFormat("mitutoyo", r"(?P<channel>\d\d?)A(?P<value>[+-]\d{1,6}\.\d{1,6})"),
        # Multiplexers MUX 2, MUX 4: "1 MW+003.4665 inch"; "3 TO 999999.99 mm" is an error.
        SerialFormat(
            "mux", r"(?P<channel>\d) MW\s?(?P<value>[+-]\d{1,6}\.\d{1,6}) (?P<unit>mm|inch)\s*"
        ),
        # Any gauge that sends only a number with a decimal mark: "-1.23", "0,456 mm".
        SerialFormat(
            "plain", r"\s*(?P<value>[+-]?\s?\d{0,4}[.,]\d{1,6})\s*(?P<unit>mm|inch|in|\")?\s*"
        ),
        # Sylvac, Tesa, Diatest over an opto cable: "+12.345" after "?".
        SerialFormat(
            "sylvac", r"(?P<value>[+-]\d{1,4}\.\d{1,6})",
            baud=4800, data_bits=7, parity="E", stop_bits=2, request=b"?\r",
        ),
        # Mitutoyo U-WAVE radio receiver: "DT10001+0000.123M", group and channel, M or I.
        SerialFormat(
            "uwave",
            r"DT1(?P<channel>\d{0,6})(?P<value>[+-]\d{1,6}\.\d{1,6})(?P<unit>[MI])",
            baud=57600,
        ),
    )
}  # fmt: skip


def serial_format(name: str) -> SerialFormat:
    """The format of this name. Raises UsageError if there is none."""
    if name not in SERIAL_FORMATS:
        raise UsageError(
            f"There is no gauge format {name!r}.",
            f"Choose typed, simulated, or FORMAT:PORT with one of {', '.join(SERIAL_FORMATS)}.",
        )
    return SERIAL_FORMATS[name]


_TYPED = re.compile(
    r"(?P<value>[+-]?\s?(?:\d{1,6}(?:[.,]\d{0,6})?|[.,]\d{1,6}))\s*(?P<unit>mm|inch|in|\")?",
    flags=re.ASCII | re.IGNORECASE,
)
# What a gauge's keystrokes become when it and the computer disagree about the keyboard:
# computer's layout → (what the keys 1 … 9, 0 give, other marks and what was meant).
_LAYOUTS = {
    "French": ("&é\"'(-è_çà", ":.)-;,"),
    "US, with a French gauge,": ("!@#$%^&*()", "<.m,"),
    "German": ("", "ß-"),
    "US, with a German gauge,": ("", "/-]+"),
}


class NotAReading(Exception):
    """Typed text that is no reading; the message is the sentence to show."""


def parse_typed(text: str) -> tuple[Token, str | None]:
    """What a person or a keyboard-wedge gauge types at a prompt.

    Accepts a sign (also U+2212), decimal point or comma, and a unit; nothing else. Exponents,
    digit groups and error codes are not readings.

    Returns:
        The reading; and the keyboard layout if only a wrong one explains it, else None.

    Raises:
        NotAReading: says why.
    """
    plain = text.strip().replace("\u2212", "-")
    match = _TYPED.fullmatch(plain)
    if match is not None:
        token = Token.of(match, text.strip())
        if token.value is not None:
            return token, None
    elif (garbled := _ungarbled(plain, text.strip())) is not None:
        return garbled
    if match is not None or re.search(r"err|^\d\s+to\b", plain, flags=re.IGNORECASE):
        raise NotAReading(f"{_shown(plain)} is an error message of the gauge, not a reading.")
    if re.fullmatch(r"[+-]?[\d.,\s]+", plain) and len(re.findall(r"[.,]", plain)) > 1:
        raise NotAReading(f"{_shown(plain)}: two numbers in one? Type one, such as -0.12.")
    raise NotAReading(
        f"{_shown(plain)} is not a reading. Type a number such as -0.12, or ? for help."
    )


def is_reading(text: str) -> bool:
    """Whether a person or a gauge may have typed this as a reading."""
    try:
        parse_typed(text)
    except NotAReading:
        return False
    return True


def _ungarbled(plain: str, raw: str) -> tuple[Token, str] | None:
    """The reading that one wrong keyboard layout explains, if it leaves no doubt."""
    for layout, (digits, marks) in _LAYOUTS.items():
        # Where the layout moves the digits, none of them can have come through unharmed.
        if digits and any(c.isdigit() for c in plain):
            continue
        table = str.maketrans(digits + marks[0::2], "1234567890"[: len(digits)] + marks[1::2])
        clear = plain.translate(table)
        match = _TYPED.fullmatch(clear)
        whole = re.search(r"\d[.,]|[.,]\d", clear) is not None
        if clear != plain and whole and match is not None:
            token = Token.of(match, raw)
            if token.value is not None:
                return token, layout
    return None


def _shown(text: str) -> str:
    """The text as it may be printed: short, and without control characters."""
    clean = visible(text)
    return f"'{clean if len(clean) <= 24 else clean[:23] + '~'}'"
