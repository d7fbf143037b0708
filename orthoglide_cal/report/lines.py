"""Plain lines of text for a terminal of 80 columns: wrapped, indented, in columns."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from orthoglide_cal.report.shown import visible

WIDTH = 80


def wrapped(text: str, indent: int = 0, name: str = "", room: int = 0) -> list[str]:
    """A sentence on as many lines as it takes; later lines begin where the first one does.

    Args:
        text: from anywhere; control characters are shown, not obeyed.
        indent: blanks in front.
        name: stands in front of the first line.
        room: columns for the name.
    """
    first = " " * indent + name.ljust(room)
    return textwrap.wrap(
        visible(text),
        WIDTH,
        initial_indent=first,
        subsequent_indent=" " * len(first),
        break_on_hyphens=False,
    )


def facts(rows: Sequence[tuple[str, str]], indent: int) -> list[str]:
    """Names and what they say, each wrapped in its own column."""
    room = max((len(name) for name, _ in rows), default=0) + 2
    return [line for name, text in rows for line in wrapped(text, indent, name, room)]


def columns(
    rows: Sequence[Sequence[str]], indent: int = 2, left: Sequence[int] = (0,)
) -> list[str]:
    """Cells below each other, to the right but for the columns named in `left`."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = (
            cell.ljust(width) if k in left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append((" " * indent + "  ".join(cells)).rstrip())
    return lines
