"""Text to number and back, with one strict pattern.

`float()` would take nan, inf and 1_000 and refuse the typographic minus U+2212; YAML would read
012 as 10 and 1:30 as 90. Here a number is digits with at most one decimal mark and an exponent.
"""

from __future__ import annotations

import math
import re

from orthoglide_cal.errors import InputError

MM_PER_INCH = 25.4

_LONGEST = 40  # characters; a gauge shows ten
_POINT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_COMMA = re.compile(r"[+-]?(?:[0-9]+,[0-9]*|,[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_OCTAL = re.compile(r"[+-]?0[0-9]+")
_INTEGER = re.compile(r"\+?[0-9]{1,15}")
_EXAMPLE = "Write a plain number such as -0.123."


def parse_number(text: str, *, decimal_comma: bool = False) -> float:
    """The finite number that `text` writes.

    Args:
        text: digits with an optional sign (ASCII, or U+2212 as spreadsheets write it), decimal
            mark and exponent; blanks around it are ignored.
        decimal_comma: accept a comma as the decimal mark, too.

    Raises:
        InputError: anything else; carries what is wrong and the remedy, but no place.

    >>> parse_number("−0,25", decimal_comma=True)
    -0.25
    """
    plain = text.strip().replace("\u2212", "-")
    if len(plain) <= _LONGEST:
        if _POINT.fullmatch(plain):
            return _finite(float(plain), text)
        if _COMMA.fullmatch(plain):
            if decimal_comma:
                return _finite(float(plain.replace(",", ".")), text)
            raise InputError(
                "A decimal comma cannot be read here.",
                "Write a decimal point, or separate the columns with semicolons.",
                value=text,
            )
    raise InputError("This is not a number.", _EXAMPLE, value=_short(text))


def parse_yaml_number(text: str) -> float:
    """`parse_number` for YAML, where whole numbers with a leading zero mean octal to some."""
    if _OCTAL.fullmatch(text.strip()):
        raise InputError(
            "A whole number with a leading zero is ambiguous (YAML reads it as octal).",
            "Write it without the leading zero.",
            value=_short(text),
        )
    return parse_number(text)


def parse_count(text: str, least: int) -> int:
    """The whole number that `text` writes, at least `least`. Raises InputError without a place."""
    plain = text.strip()
    if not _INTEGER.fullmatch(plain) or int(plain) < least:
        raise InputError(
            f"This is not a whole number from {least}.",
            f"Write {least}, {least + 1}, {least + 2}, …",
            value=_short(text),
        )
    return int(plain)


def number_text(value: float) -> str:
    """The shortest text that reads back as exactly `value`: 60 for 60.0, 0.1 for 0.1."""
    return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(float(value))


def _finite(value: float, text: str) -> float:
    if not math.isfinite(value):
        raise InputError("This number is too large.", _EXAMPLE, value=text)
    return value


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
