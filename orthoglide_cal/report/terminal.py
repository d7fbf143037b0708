"""A page as text for a terminal.

Everything is wrapped to its width but commands and listings, so that they can be copied: print with
`soft_wrap=True`. The rows of a table that is too wide become sentences.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import zip_longest

from rich.console import Console
from rich.text import Text

from orthoglide_cal.errors import visible
from orthoglide_cal.report import document as doc

_COLOURS = {"good": "green", "warn": "yellow", "bad": "red", "open": "yellow", "info": "blue"}
_STYLES = {
    **dict.fromkeys(("typed", "command"), "bold cyan"),
    **dict.fromkeys(("code", "strong", "doubtful"), "bold"),
    **dict.fromkeys(("small", "blank"), "dim"),
}
_TYPED_AT = 46  # column at which what is to be typed begins where there is room
_GAP = "  "
# A number keeps its name and unit on its line: their blank is none while lines are broken.
_HELD, _BLANK_HELD = re.compile(r" (?=[=%σ±]|[+−]\d|[mµ]m\b)|(?<=[=±<>]) "), "\ue000"
_NARROWEST = 12  # columns of words are not squeezed below this
# Parts of a page that may give way.
Spare = list[str] | list[int] | list[doc.Block] | list[doc.Line] | list[list[doc.Block]]
_ANY = Console()  # to wrap text by: what it asks is the same of all


@lru_cache(maxsize=1)  # a page is measured, then printed
def terminal(page: doc.Page, width: int) -> Text:
    """The page's text, so many columns wide."""
    lines = [*_Lines(width).of(page)]
    for line in lines:
        line.plain = line.plain.replace(_BLANK_HELD, " ")
        line.rstrip()
    return Text("\n").join(lines)


def fitting(make: Callable[[], doc.Page], *spare: Spare, lines: int = 24) -> doc.Page:
    """The page as it is made once so many lines of 80 columns hold it.

    The last entries of the first list of `spare` go first, then those of the next one.
    """
    while terminal(page := make(), 80).plain.count("\n") >= lines and any(spare):
        next(part for part in spare if part).pop()
    return page


class _Lines:
    def __init__(self, width: int) -> None:
        self._width = width

    def of(self, page: doc.Page) -> Iterator[Text]:
        headed, begun = page.title is not None, page.notice is not None
        title = doc.strong(f"{page.kind}: {page.title}") if headed else None
        for top in (page.stamp and doc.doubtful(page.stamp), title, page.facts, page.notice):
            if top is not None:
                yield from self._block(top)
        for section in page.in_characters:
            if headed or begun:
                yield Text()
            begun = True
            if section.title is not None:
                yield from self._paragraph(doc.strong(section.title))
            close = section.title is None and not headed
            for number, block in enumerate(section.blocks):
                if number and isinstance(block, doc.Grid | doc.Facts | doc.Figure) and not close:
                    yield Text()
                yield from self._block(block, _GAP if close else "")
        if page.signatures:
            yield Text()
        yield from (Text(f"{role}, date: {doc.BLANK}") for role in page.signatures)
        if headed:
            yield Text()

    def _block(self, block: doc.Block, indent: str = "") -> Iterator[Text]:
        match block:
            case doc.Notice():
                yield from self._notice(block)
            case doc.Facts():
                rows = [(doc.small(name), value) for name, value in block.rows]
                yield from self._grid(doc.Grid(("", ""), rows, words=(0, 1)))
            case doc.Grid():
                yield from self._grid(block)
            case doc.Figure():
                for part in block.plain:
                    yield from self._block(part)
            case doc.Listing():
                yield from (Text(visible(line)) for line in block.lines)
            case doc.Instructions():
                for number, item in enumerate(block.items, start=1):
                    yield from self._step(item, f"{_GAP}{number}. ")
            case _:
                yield from self._paragraph(block, indent, indent)

    def _step(self, item: doc.Line, first: str) -> Iterator[Text]:
        """A step; its command stands behind it where both fit on one line."""
        rest, parts = " " * len(first), doc.parts_of(item)
        sentence = tuple(part for part in parts if part.style != "command")
        *lines, last = self._paragraph(sentence, first, rest)
        typed = _text(parts[len(sentence) :])
        free = self._width - typed.cell_len - last.cell_len
        if typed and not lines and free >= len(_GAP):
            space = min(max(_TYPED_AT - last.cell_len, len(_GAP)), free)
            yield Text.assemble(last, " " * space, typed)
        else:
            yield from (*lines, last, *[Text.assemble(rest, typed)] * bool(typed))

    def _paragraph(
        self, content: doc.Blank, first: str | Text = "", rest: str = "", style: str = ""
    ) -> Iterator[Text]:
        """A line of the page behind `first` and `rest`; its command stays whole."""
        parts = doc.parts_of(content)
        whole = (k for k, part in enumerate(parts) if part.style in ("typed", "blank"))
        end = next(whole, len(parts))
        sentence, command = _text(parts[:end], style), _text(parts[end:], style)
        *lines, last = _wrapped(sentence, self._width - len(first))
        # Wrapping took the blank between the two away.
        space = " " * (bool(command) and sentence.plain.endswith(" "))
        return _hung([*lines, Text.assemble(last, space, command)], first, rest)

    def _notice(self, notice: doc.Notice) -> Iterator[Text]:
        sign = Text(notice.tone.sign, f"bold {_COLOURS[notice.tone]}")
        *above, last = self._paragraph(notice.title, sign, _GAP, "bold")
        aside, lines = _text(notice.aside), notice.lines
        space = self._width - last.cell_len - aside.cell_len
        if space >= len(_GAP):
            last = Text.assemble(last, " " * space, aside)
        elif aside:
            lines = (notice.aside, *lines)
        yield from (*above, last)
        for line in lines:
            yield from self._paragraph(line, _GAP, _GAP)

    def _grid(self, grid: doc.Grid) -> Iterator[Text]:
        """The table, its columns of words squeezed; its rows as sentences where it is too wide."""
        head = [_text(title, "dim") for title in grid.head]
        rows = [[_text(cell) for cell in row] for row in grid.rows]
        widths = [max(cell.cell_len for cell in column) for column in zip(head, *rows, strict=True)]
        over = sum(widths) + len(_GAP) * len(widths) - self._width
        for k in sorted(grid.words, key=lambda k: -widths[k]):
            less = min(max(over, 0), max(widths[k] - _NARROWEST, 0))
            widths[k] -= less
            over -= less
        if over > 0:
            for name, *cells in rows:
                named = (pair for pair in zip(head[1:], cells, strict=True) if pair[1])
                values = (Text.assemble(title, " " * bool(title), cell) for title, cell in named)
                whole = Text.assemble(name, ": ", Text(", ").join(values))
                yield from _hung(_wrapped(whole, self._width - 2 * len(_GAP)), _GAP, 2 * _GAP)
        else:
            for row in [head, *rows] if any(grid.head) else rows:
                texts = [_wrapped(cell, width) for cell, width in zip(row, widths, strict=True)]
                for line in zip_longest(*texts, fillvalue=Text()):
                    parts: list[str | Text] = []
                    for k, (cell, width) in enumerate(zip(line, widths, strict=True)):
                        space = " " * (width - cell.cell_len)
                        parts += (_GAP, *((cell, space) if k in grid.words else (space, cell)))
                    yield Text.assemble(*parts)
        if grid.caption:
            yield from self._paragraph(grid.caption, _GAP, _GAP, "dim")


def _text(content: doc.Blank, style: str = "") -> Text:
    text = Text(style=style)
    for part in doc.parts_of(content):
        text.append(visible(part.text), _STYLES.get(part.style, ""))
    text.plain = _HELD.sub(_BLANK_HELD, text.plain)
    return text


def _wrapped(text: Text, width: int) -> list[Text]:
    lines = [text.copy()]  # most fit, and wrapping takes its time
    if text.cell_len > width:
        lines = [*text.wrap(_ANY, max(width, 1), overflow="fold")]
    for line in lines:
        line.rstrip()
    return lines


def _hung(lines: Iterable[Text], first: str | Text, rest: str | Text) -> Iterator[Text]:
    for number, line in enumerate(lines):
        yield Text.assemble(rest if number else first, line)
