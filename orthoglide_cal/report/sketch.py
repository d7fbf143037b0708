"""Pictures in characters, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

WIDTH = 44


def interval_lines(
    names: Sequence[str],
    values: Sequence[float],
    halves: Sequence[float],
    width: int = WIDTH,
    zero: bool = True,
) -> tuple[str, ...]:
    """One line per value: its interval on a common scale, with zero marked if it is wanted.

    >>> print(interval_lines(["x"], [1.0], [0.5], 13)[0])
    x  │   ├───●───┤
    """
    ends = [v + s * h for v, h in zip(values, halves, strict=True) for s in (-1.0, 1.0)]
    if zero:
        ends.append(0.0)
    low, high = min(ends), max(ends)
    span = (high - low) or 1.0

    def place(value: float) -> int:
        return round((value - low) / span * (width - 1))

    lines = []
    for name, value, half in zip(names, values, halves, strict=True):
        cells = [" "] * width
        if zero:
            cells[place(0.0)] = "│"
        left, middle, right = place(value - half), place(value), place(value + half)
        for k in range(left, right + 1):
            cells[k] = "─"
        if right > left:
            cells[left], cells[right] = "├", "┤"
        cells[middle] = "●"
        lines.append(f"{name}  {''.join(cells)}".rstrip())
    return tuple(lines)


def bar_lines(
    names: Sequence[str], values: Sequence[float], texts: Sequence[str], width: int = WIDTH
) -> tuple[str, ...]:
    """One line per size: a bar on a common scale and its number.

    >>> print("\\n".join(bar_lines(["a", "bc"], [1.0, 0.5], ["1 mm", "0.5 mm"], 4)))
    a   ████  1 mm
    bc  ██    0.5 mm
    """
    largest = max([*values, 0.0]) or 1.0
    room = max((len(name) for name in names), default=0)
    return tuple(
        f"{name:<{room}}  {_bar(value / largest * width):<{width}}  {text}"
        for name, value, text in zip(names, values, texts, strict=True)
    )


def _bar(length: float) -> str:
    """Whole and half cells; what is not zero shows at least the thinnest cell."""
    whole, rest = divmod(length, 1.0)
    cells = "█" * int(whole) + ("▌" if rest >= 0.5 else "")
    return cells or ("▏" if length > 0.0 else "")
