"""The template of a posture program: what its owner wrote for their controller.

Lines that are a comment beginning with "orthocal" are settings, notes, or the marker that says
where the blocks go; all others are copied as they stand.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import Document, Faults, nearest, parse_number

_OURS = re.compile(r"\s*(?:\(\s*orthocal\b([^()]*)\)|;\s*orthocal\b(.*))\s*", re.IGNORECASE)
_AXIS = re.compile(r"[UVWABCXYZ]|[A-Z][A-Z0-9_]*=")
_PAUSE = re.compile(r"M0?[01]|M60|G0?4( [A-Z][0-9]+(\.[0-9]+)?)+")
_COMMENT = re.compile(r"\([^)]*\)?|;.*")
_NUMBER = re.compile(r"\s*/?\s*N0*([0-9]+)", re.IGNORECASE)
_CODE = re.compile(r"G0*([0-9]+)(?![0-9.])", re.IGNORECASE)
_MARKER = "blocks"
_NOTE = "note"
_PRINT = "orthocal template gcode shows one that is complete."
# Codes that exclude each other: those that the blocks are written for, and what others mean.
_MODES: tuple[tuple[tuple[str, ...], Mapping[str, str]], ...] = (
    (("21", "71", "710"), dict.fromkeys(("20", "70", "700"), "inches")),
    (("90",), {"91": "distances from the last point"}),
    (("94",), {"93": "feeds as inverse times", "95": "feeds per turn"}),
)


class Values(StrEnum):
    """What the numbers behind the axis words are."""

    JOINTS = "joints"
    DISPLACEMENTS = "displacements"
    TOOL = "tool"


@dataclass(frozen=True)
class Template:
    """A template as read.

    Attributes:
        before, after: lines around the blocks.
        semicolon: comments are written "; …" instead of "(…)", as the marker is.
        axes: axis words.
        values: what the numbers behind them are.
        pause: code that waits at each posture.
        feed, slow: speed between postures, and on arrival [mm/min].
    """

    before: tuple[str, ...]
    after: tuple[str, ...]
    semicolon: bool
    axes: tuple[str, ...] = ("X", "Y", "Z")
    values: Values = Values.JOINTS
    pause: str = "M0"
    feed: float = 1000.0
    slow: float = 100.0


def gcode_template(document: Document, numbers: Iterable[int]) -> Template:
    """The template that a file holds.

    Args:
        document: as read.
        numbers: of the blocks to be written; no line of the template may have one of them.

    Raises:
        InvalidFileError: no marker or two, a setting that cannot be used, a number that a block
            has, or a mode (inches, relative) in which the blocks would drive elsewhere.
    """
    faults, taken = Faults(document.path), set(numbers)
    parts: tuple[list[str], list[str]] = ([], [])
    settings: dict[str, Any] = {}
    markers: list[bool] = []
    modes: dict[int, tuple[int, str]] = {}
    for line, text in enumerate(document.text.rstrip("\n").split("\n"), start=1):
        ours = _OURS.fullmatch(text)
        if ours:
            key, colon, value = (ours[1] or ours[2] or "").partition(":")
            name = key.strip().lower()
            if name == _MARKER and not colon:
                markers.append(ours[1] is None)
                if len(markers) > 1:
                    faults.add("This is a second place for the blocks.", "Take one out.", line=line)
            elif name in settings:
                faults.add("This setting stands here twice.", "Take one out.", line=line, value=key)
            elif name in _SETTINGS:
                try:
                    settings[name] = _SETTINGS[name](" ".join(value.split()))
                except InputError as error:
                    faults.add(error.what, error.remedy, line=line, value=value.strip())
            elif name != _NOTE:
                near = nearest(name, (*_SETTINGS, _NOTE, _MARKER))
                faults.add("This is no setting.", f"{near}{_PRINT}", line=line, value=name)
            continue
        parts[bool(markers)].append(text)
        code = _COMMENT.sub("", text)
        number = _NUMBER.match(code)
        if number and int(number[1]) in taken:
            faults.add(
                "A posture has this block number.",
                "Number your own lines otherwise, or not at all.",
                line=line,
                value=f"N{number[1]}",
            )
        if not markers:
            for found in _CODE.findall(code):
                modes |= {k: (line, found) for k, (ok, no) in enumerate(_MODES)
                          if found in ok or found in no}  # fmt: skip
    for k, (line, found) in modes.items():
        right, wrong = _MODES[k]
        if found in wrong:
            faults.add(
                f"The blocks are not written for this code ({wrong[found]}).",
                f"Write G{right[0]} before the blocks.",
                line=line,
                value=f"G{found}",
            )
    if not markers:
        faults.add(
            "The template does not say where the blocks go.",
            f"Put a line (orthocal {_MARKER}) there. {_PRINT}",
        )
    faults.check()
    return Template(tuple(parts[0]), tuple(parts[1]), markers[0], **settings)


def _axes(value: str) -> tuple[str, ...]:
    words = tuple(value.upper().split())
    if len(set(words)) != 3 or len(words) != 3 or not all(map(_AXIS.fullmatch, words)):
        raise InputError("These are not three axis words.", "Write X Y Z, or X1= Y1= Z1=.")
    return words


def _values(value: str) -> Values:
    try:
        return Values(value.lower())
    except ValueError as error:
        raise InputError("This is not known.", f"Write one of {', '.join(Values)}.") from error


def _pause(value: str) -> str:
    code = value.upper()
    if not _PAUSE.fullmatch(code):
        raise InputError("This is no code that waits.", "Write M0, M1, or G4 P20 for 20 s.")
    return code


def _speed(value: str) -> float:
    speed = parse_number(value)
    if speed <= 0.0:
        raise InputError("A feed is greater than 0.", "Write mm per minute, such as 100.")
    return speed


_SETTINGS: Mapping[str, Callable[[str], Any]] = {
    "axes": _axes,
    "values": _values,
    "pause": _pause,
    "feed": _speed,
    "slow": _speed,
}
