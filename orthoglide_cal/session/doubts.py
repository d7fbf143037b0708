"""Kinds of doubt about a reading, and the question that is put to the technician."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Doubt(StrEnum):
    """What may be wrong with a reading."""

    RANGE = "range"  # beyond the gauge's travel
    GRID = "resolution"  # finer than the gauge can show
    LAYOUT = "keyboard"  # typed through a wrong keyboard layout
    DOUBLE = "double"  # the same key stroke twice
    REVOLUTION = "revolution"  # whole turns of the dial
    SIGN = "sign"  # read with the opposite sign
    EXCHANGED = "exchanged"  # the two gauges of a leg taken for each other
    POINT = "point"  # decimal point in the wrong place
    STAND = "stand"  # the stand was knocked
    UNEXPECTED = "unexpected"  # none of these explains it


# Doubts that come from comparing a reading with others. If such a reading is kept, the readings
# of its gauge are compared among themselves from there on.
MODEL_DOUBTS = frozenset(
    {
        Doubt.REVOLUTION,
        Doubt.SIGN,
        Doubt.EXCHANGED,
        Doubt.POINT,
        Doubt.STAND,
        Doubt.UNEXPECTED,
    }
)


@dataclass(frozen=True)
class Question:
    """A doubt in one sentence; `about` as in `events.Questioned`."""

    doubt: Doubt
    text: str
    about: int = 0
