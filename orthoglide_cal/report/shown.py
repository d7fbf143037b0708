"""Text from outside (names, notes) made harmless and visible, for every place it is shown in."""

from __future__ import annotations

import re
import unicodedata

# Characters that change the direction of what follows: U+202E turns "exe.csv" around.
_DIRECTION = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
# What Markdown obeys anywhere in a line; other signs matter only at its beginning, where no text
# from outside stands. Addresses become links by themselves unless they are written so.
_MARKDOWN = re.compile(r"([\\`*_\[\]<|~&$])")
_ADDRESS = (("://", ":&#47;&#47;"), ("www.", "www&#46;"), ("@", "&#64;"))
_FORMULA = "=+-@\t\r\n"


def visible(text: str, *, lines: bool = False) -> str:
    """The text with control and direction characters replaced by their code, as "⟨U+202E⟩".

    Args:
        text: any.
        lines: keep line breaks; otherwise they become blanks.
    """
    return "".join(_visible(character, lines) for character in text)


def _visible(character: str, lines: bool) -> str:
    if character == "\n" and lines:
        return character
    if character in "\n\t\r":
        return " "
    if unicodedata.category(character) in ("Cc", "Cs", "Co", "Cn") or character in _DIRECTION:
        return f"⟨U+{ord(character):04X}⟩"
    return character


def in_markdown(text: str) -> str:
    """The text so that Markdown shows it as it stands, on one line."""
    escaped = _MARKDOWN.sub(r"\\\1", visible(text))
    for plain, written in _ADDRESS:
        escaped = escaped.replace(plain, written)
    return escaped


def in_csv(text: str) -> str:
    """The text for a cell of a CSV; one that a spreadsheet would calculate gets a "'" in front.

    Numbers are not passed through this function, so that "-0.53" stays a number.
    """
    dangerous = text.startswith(tuple(_FORMULA)) or text.lstrip().startswith(("=", "+", "-", "@"))
    return ("'" if dangerous else "") + visible(text)


def in_comment(text: str) -> str:
    """The text for a comment line of a configuration file: it cannot end the line."""
    return visible(text)
