"""What a person or a keyboard-wedge gauge types at a prompt, as a reading in mm."""

from __future__ import annotations

import re
from dataclasses import dataclass

from orthoglide_cal.session.gauges.token import Token, is_error_code, unit_name

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


@dataclass(frozen=True)
class Refused:
    """Typed text that is no reading, and the sentence to show."""

    why: str


@dataclass(frozen=True)
class Garbled:
    """Typed text that would be `token` if the keyboard's layout was the wrong one."""

    token: Token
    layout: str


def parse_typed(text: str) -> Token | Garbled | Refused:
    """A typed reading.

    Accepts a sign (also U+2212), decimal point or comma, and a unit; nothing else. Exponents,
    digit groups and error codes are not readings.
    """
    plain = text.strip().replace("\u2212", "-")
    token = _number(plain, text)
    if token is not None:
        if token.value is None:
            return Refused(f"{_shown(plain)} is an error message of the gauge, not a reading.")
        return token
    garbled = _ungarble(plain, text)
    if garbled is not None:
        return garbled
    if re.search(r"err|^\d\s+to\b", plain, flags=re.IGNORECASE):
        return Refused(f"{_shown(plain)} is an error message of the gauge, not a reading.")
    if re.fullmatch(r"[+-]?[\d.,\s]+", plain) and len(re.findall(r"[.,]", plain)) > 1:
        return Refused(f"{_shown(plain)}: two numbers in one? Type one, such as -0.12.")
    return Refused(f"{_shown(plain)} is not a reading. Type a number such as -0.12, or ? for help.")


def _number(plain: str, raw: str) -> Token | None:
    match = _NUMBER.fullmatch(plain)
    if match is None:
        return None
    digits = match["value"].replace(" ", "").replace(",", ".")
    unit = unit_name((match["unit"] or "").lower())
    return Token(None if is_error_code(digits) else float(digits), unit, "", raw.strip())


def _ungarble(plain: str, raw: str) -> Garbled | None:
    """The reading that one wrong keyboard layout explains, if it leaves no doubt."""
    for layout, (digits, marks) in _LAYOUTS.items():
        # Where the layout moves the digits, none of them can have come through unharmed.
        if digits and any(c.isdigit() for c in plain):
            continue
        table = str.maketrans(digits + marks[0::2], "1234567890"[: len(digits)] + marks[1::2])
        clear = plain.translate(table)
        guess = _number(clear, raw)
        whole = re.search(r"\d[.,]|[.,]\d", clear) is not None
        if clear != plain and whole and guess is not None and guess.value is not None:
            return Garbled(guess, layout)
    return None


def _shown(text: str) -> str:
    """The text as it may be printed: short, and without control characters."""
    clean = "".join(c if c.isprintable() else "?" for c in text)
    return f"'{clean if len(clean) <= 24 else clean[:23] + '~'}'"
