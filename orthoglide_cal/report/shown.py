"""Text from outside (names, notes) made harmless and visible, for every place it is shown in."""

from __future__ import annotations

import re

# Control characters, halves of pairs, private ones, and those that change the direction of what
# follows: U+202E turns "exe.csv" around.
_HIDDEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\uf8ff\ufeff"
    "\U000e0000-\U0010ffff]"
)
# What Markdown obeys anywhere in a line; other signs matter only at its beginning, where no text
# from outside stands. Addresses become links by themselves unless they are written so.
_MARKDOWN = re.compile(r"([\\`*_\[\]<|~&$])")
_ADDRESS = (("://", ":&#47;&#47;"), ("www.", "www&#46;"), ("@", "&#64;"))
_FORMULA = "=+-@\t\r\n"


def visible(text: str) -> str:
    """The text on one line, with control and direction characters as codes: "⟨U+202E⟩"."""
    return _HIDDEN.sub(_code, text)


def _code(found: re.Match[str]) -> str:
    character = found[0]
    return " " if character in "\n\t\r" else f"⟨U+{ord(character):04X}⟩"


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
