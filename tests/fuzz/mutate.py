"""Small damage to texts: what slips of fingers, editors, disks and spreadsheets do to a file."""

import re
from collections.abc import Callable, Sequence

import numpy as np

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
HOSTILE = (
    "nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "1e39", "0", "-0", "", "1e5", "-1e5",
    "99999", "−1", "1,5", "1_000", "012", "0x10", "1:30", "true", "null", "~", "x", "iso", "max",
    "-7", "1.5", "[]", "{}", "[1, 2]", "&a", "*a", "!!x", "'", '"', "\x00", "\x1b[2J", "\ufeff",
    "\u202e", "é", "|", "9" * 400, "- " * 30, "#", ": ", "\t", "\r", "orthoglide", "2025-13-45",
    "true: true",
)  # fmt: skip

Rng = np.random.Generator


def _slice(text: str, rng: Rng, longest: int = 40) -> tuple[int, int]:
    start = int(rng.integers(0, len(text) + 1))
    return start, min(len(text), start + int(rng.integers(0, longest)))


def _number(text: str, rng: Rng) -> str:
    """Another number in the place of one."""
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    one = found[int(rng.integers(len(found)))]
    other = str(rng.choice(HOSTILE)) if rng.random() < 0.7 else f"{rng.normal(scale=100.0):.4g}"
    return text[: one.start()] + other + text[one.end() :]


def _cut(text: str, rng: Rng) -> str:
    return text[: int(rng.integers(0, len(text) + 1))]


def _piece(text: str, rng: Rng) -> str:
    """A piece is lost, or stands twice."""
    start, end = _slice(text, rng)
    return text[:start] + text[start:end] * int(rng.choice((0, 2))) + text[end:]


def _insert(text: str, rng: Rng) -> str:
    start, _ = _slice(text, rng)
    return text[:start] + str(rng.choice(HOSTILE)) + text[start:]


def _line(text: str, rng: Rng) -> str:
    """A line is lost, stands twice, or two change places."""
    lines = text.split("\n")
    one, other = (int(k) for k in rng.integers(0, len(lines), 2))
    match int(rng.integers(3)):
        case 0:
            del lines[one]
        case 1:
            lines.insert(other, lines[one])
        case _:
            lines[one], lines[other] = lines[other], lines[one]
    return "\n".join(lines)


def _word(text: str, rng: Rng) -> str:
    """A word of the file in the place of another."""
    words = list(re.finditer(r"\w+", text))
    if not words:
        return text
    one, other = (words[int(k)] for k in rng.integers(0, len(words), 2))
    return text[: one.start()] + other[0] + text[one.end() :]


MUTATIONS: Sequence[Callable[[str, Rng], str]] = (
    *(_number,) * 3, _cut, *(_piece,) * 2, _insert, *(_word,) * 2, *(_line,) * 3,
)  # fmt: skip


def mutant(text: str, rng: Rng) -> str:
    """The text with one to four damages."""
    for _ in range(int(rng.integers(1, 5))):
        text = MUTATIONS[int(rng.integers(len(MUTATIONS)))](text, rng)
    return text
