"""The gauge that people read and type, or that types by itself like a keyboard."""

from __future__ import annotations

import re

from orthoglide_cal.errors import visible
from orthoglide_cal.session.gauges.interface import Token

_NUMBER = re.compile(
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
    raw = text.strip()
    plain = raw.replace("\u2212", "-")
    match = _NUMBER.fullmatch(plain)
    if match is not None:
        token = Token.of(match, raw)
        if token.value is not None:
            return token, None
    for layout, (digits, marks) in _LAYOUTS.items():
        # Where the layout moves the digits, none of them can have come through unharmed.
        if match is not None or (digits and any(c.isdigit() for c in plain)):
            continue
        table = str.maketrans(digits + marks[0::2], "1234567890"[: len(digits)] + marks[1::2])
        clear = plain.translate(table)
        meant = _NUMBER.fullmatch(clear)
        if meant and clear != plain and re.search(r"\d[.,]|[.,]\d", clear):
            token = Token.of(meant, raw)
            if token.value is not None:
                return token, layout
    clean = visible(plain)
    shown = f"'{clean if len(clean) <= 24 else clean[:23] + '~'}'"
    if match is not None or re.search(r"err|^\d\s+to\b", plain, flags=re.IGNORECASE):
        raise NotAReading(f"{shown} is an error message of the gauge, not a reading.")
    if re.fullmatch(r"[+-]?[\d.,\s]+", plain) and len(re.findall(r"[.,]", plain)) > 1:
        raise NotAReading(f"{shown}: two numbers in one? Type one, such as -0.12.")
    raise NotAReading(f"{shown} is not a reading. Type a number such as -0.12, or ? for help.")
