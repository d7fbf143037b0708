"""What a gauge says, one token at a time, and what a format makes of it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from orthoglide_cal.data.numbers import MM_PER_INCH

# Error messages that look like numbers: they must never become one.
_ERROR_CODES = re.compile(r"[+-]?9{5,}(?:\.9+)?|9[0-9]{2}")


@dataclass(frozen=True)
class Token:
    """One message of a gauge, understood.

    Attributes:
        value: as shown by the gauge, in `unit`; None for an error message.
        unit: "mm", "in" or "" where the gauge does not say.
        channel: of a multiplexer; "" without one.
        raw: the characters that arrived.
    """

    value: float | None
    unit: str
    channel: str
    raw: str

    def mm(self, default_unit: str) -> float | None:
        """The value in mm; `default_unit` ("mm" or "in") where the gauge gave none."""
        if self.value is None:
            return None
        inches = (self.unit or default_unit) == "in"
        # A gauge never shows more than a nanometre: drop the dust of the multiplication.
        return round(self.value * MM_PER_INCH, 6) if inches else self.value


@dataclass(frozen=True)
class Format:
    """How one family of gauges talks over a serial line.

    Attributes:
        name: as in --gauge NAME:PORT.
        about: which gauges, in a few words.
        pattern: of a whole token with a value; groups `value` and optionally `unit`, `channel`.
        baud, data_bits, parity, stop_bits: of the line.
        request: bytes that ask for a reading; empty if only its button sends one.
    """

    name: str
    about: str
    pattern: str
    baud: int = 9600
    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1
    request: bytes = b""

    def parse(self, raw: str) -> Token:
        """What the token says; its value is None unless every character is as expected."""
        match = re.fullmatch(self.pattern, raw, flags=re.ASCII | re.IGNORECASE)
        if match is None:
            return Token(None, "", "", raw)
        found = match.groupdict()
        digits = found["value"].replace(" ", "").replace(",", ".")
        if is_error_code(digits):
            return Token(None, "", found.get("channel") or "", raw)
        unit = (found.get("unit") or "").lower()
        return Token(float(digits), unit_name(unit), found.get("channel") or "", raw)


def unit_name(text: str) -> str:
    """ "mm", "in" or "" from the ways in which gauges write units."""
    return {"m": "mm", "mm": "mm", "i": "in", "in": "in", "inch": "in", '"': "in", "": ""}[text]


def is_error_code(digits: str) -> bool:
    """True for 911, 999999.99 and the like: error messages in the shape of a number."""
    return _ERROR_CODES.fullmatch(digits) is not None
