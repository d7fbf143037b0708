"""Pictures of the gauge set-ups, in plain characters."""

from __future__ import annotations

from collections.abc import Collection
from textwrap import dedent

from orthoglide_cal.model import Contact

# Pictures of the gauge set-ups, x to the right, y away, z up: (row, column, text) of the machine's
# parts, and of each gauge with its plunger, for every leg.
_Marks = tuple[tuple[int, int, str], ...]

# fmt: off
_LEGS: tuple[_Marks, ...] = (
    ((4, 3, "tool o========*========(X)- - - rail X"), (5, 24, "carriage")),
    ((0, 24, "/ rail Y"), (1, 22, "(Y) carriage"), (2, 21, "/"), (3, 19, "/"), (4, 17, "*"),
     (5, 15, "/"), (6, 13, "/"), (7, 6, "tool o")),
    ((0, 17, "| rail Z"), (1, 16, "(Z) carriage"), (2, 17, "|"), (3, 17, "|"), (4, 17, "*"),
     (5, 17, "|"), (6, 17, "|"), (7, 12, "tool o")),
)
_GAUGES: dict[tuple[int, int], _Marks] = {
    (0, 1): ((2, 21, "[Y]"), (3, 19, "/")),
    (0, 2): ((1, 16, "[Z]"), (2, 17, "|"), (3, 17, "v")),
    (1, 0): ((4, 19, "<----[X]"),),
    (1, 2): ((1, 16, "[Z]"), (2, 17, "|"), (3, 17, "v")),
    (2, 0): ((4, 19, "<----[X]"),),
    (2, 1): ((2, 21, "[Y]"), (3, 19, "/")),
}
_SLIDING: tuple[_Marks, ...] = (
    ((1, 8, "[Z] tool end"), (2, 9, "|"), (3, 9, "v"), (1, 25, "[Z] joint end"), (2, 26, "|"),
     (3, 26, "v"), (4, 4, "tool o===============(X)- - - rail X")),
    ((0, 20, "[Z] joint end"), (1, 21, "|"), (2, 21, "v"), (3, 20, "(Y) carriage"),
     (4, 3, "tool end [Z]"), (4, 19, "/"), (5, 13, "|"), (5, 17, "/"), (6, 13, "v"),
     (6, 15, "/"), (7, 8, "tool o")),
)
_AXES: _Marks = (
    (2, 48, "+Z"), (3, 48, "|   +Y"), (4, 48, "|  /"), (5, 48, "| /"), (6, 48, "+------ +X"),
)
# fmt: on


def picture(leg: int, directions: Collection[int], contact: Contact, wide: bool) -> list[str]:
    """The gauges of a set-up, at most 72 columns wide; 38 if not `wide`.

    Fixed on stands half-way along the leg (double-posture), or one that slides on the xy-surface
    between the ends of the leg (single-posture).
    """
    marks = list(_LEGS[leg])
    if contact is not Contact.FIXED:
        marks = list(_SLIDING[leg])
        directions = ()
    for direction in directions:
        marks += _GAUGES[leg, direction]
    marks += _AXES if wide else ()
    canvas = [[" "] * 72 for _ in range(1 + max(row for row, _, _ in marks))]
    for row, column, text in marks:
        canvas[row][column : column + len(text)] = text
    lines = ["".join(line).rstrip() for line in canvas]
    lines = lines[next(index for index, line in enumerate(lines) if line) :]
    if wide:
        return lines
    return [*dedent("\n".join(lines)).split("\n"), "+X is to the right, +Y away, +Z up."]
