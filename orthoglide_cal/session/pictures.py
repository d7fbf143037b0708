"""Small pictures of the gauge set-ups, in plain characters: x to the right, y away, z up."""

from __future__ import annotations

from collections.abc import Collection

from orthoglide_cal.axes import AXES

# (row, column, text): the machine's parts, and each gauge with its plunger, for every leg.
_Marks = tuple[tuple[int, int, str], ...]

_LEGS: tuple[_Marks, ...] = (
    ((4, 3, "tool o========*========(X)- - - rail X"), (5, 24, "carriage")),
    (
        (0, 24, "/ rail Y"),
        (1, 22, "(Y) carriage"),
        (2, 21, "/"),
        (3, 19, "/"),
        (4, 17, "*"),
        (5, 15, "/"),
        (6, 13, "/"),
        (7, 6, "tool o"),
    ),
    (
        (0, 17, "| rail Z"),
        (1, 16, "(Z) carriage"),
        (2, 17, "|"),
        (3, 17, "|"),
        (4, 17, "*"),
        (5, 17, "|"),
        (6, 17, "|"),
        (7, 12, "tool o"),
    ),
)
_GAUGES: dict[tuple[int, int], _Marks] = {
    (0, 1): ((2, 21, "[Y]"), (3, 19, "/")),
    (0, 2): ((1, 16, "[Z]"), (2, 17, "|"), (3, 17, "v")),
    (1, 0): ((4, 19, "<----[X]"),),
    (1, 2): ((1, 16, "[Z]"), (2, 17, "|"), (3, 17, "v")),
    (2, 0): ((4, 19, "<----[X]"),),
    (2, 1): ((2, 21, "[Y]"), (3, 19, "/")),
}
_SINGLE: tuple[_Marks, ...] = (
    (
        (1, 8, "[Z] tool end"),
        (2, 9, "|"),
        (3, 9, "v"),
        (1, 25, "[Z] joint end"),
        (2, 26, "|"),
        (3, 26, "v"),
        (4, 4, "tool o===============(X)- - - rail X"),
    ),
    (
        (0, 20, "[Z] joint end"),
        (1, 21, "|"),
        (2, 21, "v"),
        (3, 20, "(Y) carriage"),
        (4, 3, "tool end [Z]"),
        (4, 19, "/"),
        (5, 13, "|"),
        (5, 17, "/"),
        (6, 13, "v"),
        (6, 15, "/"),
        (7, 8, "tool o"),
    ),
)
_AXES: _Marks = (
    (2, 48, "+Z"),
    (3, 48, "|   +Y"),
    (4, 48, "|  /"),
    (5, 48, "| /"),
    (6, 48, "+------ +X"),
)


def fixed_gauges(leg: int, directions: Collection[int]) -> list[str]:
    """Gauges on fixed stands half-way along a leg (double-posture), at most 72 columns."""
    marks = list(_LEGS[leg] + _AXES)
    for direction in directions:
        marks += _GAUGES[leg, direction]
    return _drawn(marks)


def sliding_gauge(leg: int) -> list[str]:
    """One gauge that slides on the xy-surface between the ends of a leg (single-posture)."""
    return _drawn(list(_SINGLE[leg] + _AXES))


def _drawn(marks: list[tuple[int, int, str]]) -> list[str]:
    rows = max(row for row, _, _ in marks) + 1
    canvas = [[" "] * 72 for _ in range(rows)]
    for row, column, text in marks:
        canvas[row][column : column + len(text)] = text
    lines = ["".join(line).rstrip() for line in canvas]
    while not lines[0]:
        lines.pop(0)
    return lines


def side(direction: int) -> str:
    """Where a gauge stands so that its reading grows with the axis, e.g. "+Y side"."""
    return f"+{AXES[direction].upper()} side"
