"""A table of separations as a picture: the darker a cell, the less can the two be told apart.

Each cell also holds its number, so that the picture can be read without its shades.
"""

from __future__ import annotations

import math
import string
from collections.abc import Sequence

from orthoglide_cal.model import Floats
from orthoglide_cal.report.canvas import rectangle, svg, words
from orthoglide_cal.report.escape import Html, tag

# Below so many σ two causes: cannot, can hardly, can mostly be told apart; above: surely.
CLASSES = ((1.0, "█", "h5"), (2.0, "▓", "h3"), (4.0, "▒", "h1"), (math.inf, " ", "h0"))
MOST = 99  # σ beyond which the number says nothing more
NOTHING = "–"
KEY = (
    "In standard deviations. Below 1 (dark) the two cannot be told apart, below 2 they hardly can,"
    f" below 4 they mostly can, from 4 on surely; {MOST}: or more. First column: from nothing"
    " wrong at all."
)
LEGEND = (
    "Told apart? █ below 1 σ: no; ▓ below 2: hardly; ▒ below 4: mostly; else: yes",
    f"{NOTHING}: from nothing wrong at all; {MOST}: or more",
)
CELL, ROW, NAMES, HEAD = 30.0, 20.0, 158.0, 22.0  # of the picture
WIDE = 400.0  # a picture from here on is scrolled on a telephone: shrunk it cannot be read


def _shown(sigma: float) -> tuple[str, str, str]:
    """Number, character and class of a cell."""
    number = "<1" if sigma < 1.0 else str(min(int(sigma), MOST))
    _, character, class_ = next(each for each in CLASSES if sigma < each[0])
    return number, character, class_


def _rows(names: Sequence[str], sigma: Floats, trace: Floats) -> list[tuple[str, list[float]]]:
    """Each name with its trace, then its separation from the names above it."""
    return [(name, [float(trace[k]), *sigma[k, :k].tolist()]) for k, name in enumerate(names)]


def separation_lines(names: Sequence[str], sigma: Floats, trace: Floats) -> tuple[str, ...]:
    """The lower half of the table in characters.

    Args:
        names: of c causes, at most 26.
        sigma: between each pair, shape (c, c).
        trace: of each from nothing wrong, shape (c,).

    >>> import numpy as np
    >>> print("\\n".join(separation_lines(["a", "bc"], np.array([[0, 3.2], [3.2, 0]]), np.ones(2))))
            –   A
    A a   ▓ 1
    B bc  ▓ 1 ▒ 3
    Told apart? █ below 1 σ: no; ▓ below 2: hardly; ▒ below 4: mostly; else: yes
    –: from nothing wrong at all; 99: or more
    """
    room = max(map(len, names), default=0)
    letters = string.ascii_uppercase[: len(names)]
    head = "".join(f"  {letter} " for letter in (NOTHING, *letters[:-1]))
    lines = [f"{'':{room + 4}}{head}".rstrip()]
    for letter, (name, row) in zip(letters, _rows(names, sigma, trace), strict=True):
        cells = "".join(f"{character}{number:>2} " for number, character, _ in map(_shown, row))
        lines.append(f"{letter} {name:<{room}}  {cells}".rstrip())
    return (*lines, *LEGEND)


def separation_panel(names: Sequence[str], sigma: Floats, trace: Floats, finding: str) -> Html:
    """The same as a picture; `finding` says what one sees in it."""
    letters = string.ascii_uppercase[: len(names)]
    parts = [
        words(NAMES + (k + 0.5) * CELL, HEAD - 6, letter, "middle", "strong")
        for k, letter in enumerate((NOTHING, *letters[:-1]))
    ]
    for k, (name, row) in enumerate(_rows(names, sigma, trace)):
        top = HEAD + k * ROW
        parts.append(words(0, top + 14, f"{letters[k]}  {name}"))
        for column, cell in enumerate(row):
            number, _, class_ = _shown(cell)
            left = NAMES + column * CELL
            parts.append(rectangle(left, top, CELL - 1, ROW - 1, f"heat {class_}"))
            ink = "on-dark" if class_ == "h5" else None
            parts.append(words(left + CELL / 2, top + 14, number, "middle", ink))
    body = tag("g", *parts, class_="before")
    width, height = NAMES + len(names) * CELL, HEAD + len(names) * ROW
    title = "Separation of each pair of causes"
    picture = svg("separation", width, height, title, finding, body)
    if width < WIDE:
        return picture
    return tag("div", picture, class_="scroll", tabindex="0", role="region", aria_label=title)
