"""A page for a terminal, as something that rich prints.

Everything is wrapped to the terminal's width but commands and listings: those stay on their lines,
so that they can be copied. Print it with `crop=False`, which keeps what is wider.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest

from rich.console import Console, ConsoleOptions
from rich.text import Text

from orthoglide_cal.errors import visible
from orthoglide_cal.report import document as doc

_COLOURS = {"good": "green", "warn": "yellow", "bad": "red", "info": "blue"}
_BLANK = "_" * 12
_GAP = "  "
_LONGEST_NAME = 30
_NARROWEST = 12  # columns of words are not squeezed below this


class TerminalPage:
    """The lines of a page, as wide as the console on which they are printed."""

    def __init__(self, page: doc.Page) -> None:
        self._page = page

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        self._console, self._width = console, options.max_width
        for line in self._lines(self._page):
            line.rstrip()
            line.no_wrap, line.overflow = True, "ignore"
            yield line

    def _lines(self, page: doc.Page) -> Iterator[Text]:
        headed = page.title is not None
        if headed:
            yield from self._flow(doc.Strong(f"{page.kind}: {page.title}"))
        if page.facts is not None:
            yield from self._facts(page.facts)
        if page.notice is not None:
            yield from self._notice(page.notice)
        for section in page.in_characters:
            if headed:
                yield Text()
            if section.title is not None:
                yield from self._flow(doc.Strong(section.title))
            for number, block in enumerate(section.in_characters):
                if number and isinstance(block, doc.Grid | doc.Figure):
                    yield Text()
                yield from self._block(block)
        if page.signatures:
            yield Text()
        yield from (Text(f"{role}, date: {_BLANK}") for role in page.signatures)
        if headed:
            yield Text()

    def _block(self, block: doc.Block) -> Iterator[Text]:
        match block:
            case doc.Paragraph():
                yield from self._flow(block.content, style="dim" if block.small else "")
            case doc.Notice():
                yield from self._notice(block)
            case doc.Facts():
                yield from self._facts(block, _GAP)
            case doc.Grid():
                yield from self._grid(block)
            case doc.Figure():
                if block.in_words:
                    yield from self._flow(block.in_words)
                yield from (Text(_GAP + visible(row)) for row in block.sketch)
            case doc.Listing():
                yield from (Text(visible(line)) for line in block.lines)
            case doc.Instructions():
                for number, item in enumerate(block.items, start=1):
                    first = f"{number}. "
                    rest = " " * len(first)
                    yield from _hung(self._flow(item.content, len(first)), first, rest)
                    if item.command:
                        yield Text(rest).append(visible(item.command), style="bold")

    def _flow(self, content: doc.Blank, taken: int = 0, style: str = "") -> list[Text]:
        """A line of the page on as many lines as it takes; its command stays whole.

        Args:
            content: text, or None for a line to write on.
            taken: columns of the console's width that stand in front.
            style: of rich, for all of it.
        """
        if content is None:
            return [_cell(None)]
        parts = doc.parts_of(content)
        end = next((k for k, part in enumerate(parts) if isinstance(part, doc.Typed)), len(parts))
        sentence, command = _text(parts[:end], style), _text(parts[end:], style)
        lines = self._wrapped(sentence, self._width - taken)
        if command:
            # Wrapping took the blank between the two away.
            space = " " if sentence.plain.endswith(" ") else ""
            lines[-1] = Text.assemble(lines[-1], space, command)
        return lines

    def _wrapped(self, text: Text, width: int) -> list[Text]:
        lines = [text.copy()]
        if text.cell_len > width or "\n" in text.plain or "\t" in text.plain:
            lines = list(text.wrap(self._console, max(width, 1), overflow="fold")) or [Text()]
        for line in lines:
            line.rstrip()
        return lines

    def _notice(self, notice: doc.Notice) -> Iterator[Text]:
        colour = _COLOURS[notice.tone]
        sign, bar = Text(f"{notice.tone.sign} ", f"bold {colour}"), Text("│ ", colour)
        yield from _hung(self._flow(notice.title, len(sign), f"bold {colour}"), sign, _GAP)
        for line in notice.lines:
            yield from _hung(self._flow(line, len(bar)), bar, bar)

    def _facts(self, facts: doc.Facts, indent: str = "") -> Iterator[Text]:
        names = [Text(visible(name), style="dim") for name, _ in facts.rows]
        room = min(max((name.cell_len for name in names), default=0), _LONGEST_NAME)
        for name, (_, value) in zip(names, facts.rows, strict=True):
            lines = self._flow(value, len(indent) + room + len(_GAP))
            row = _row([self._wrapped(name, room), lines], (room, 0), (0, 1))
            yield from _hung(row, indent, indent)

    def _grid(self, grid: doc.Grid) -> Iterator[Text]:
        """As many tables below each other as the width asks for, each with the first column."""
        rows = [[Text(visible(title), style="dim") for title in grid.head]]
        rows += [[_cell(cell) for cell in row] for row in grid.rows]
        widths = [max(cell.cell_len for cell in column) for column in zip(*rows, strict=True)]
        room = self._width - len(_GAP)
        over = _total(widths) - room
        for k in sorted(grid.words, key=lambda k: -widths[k]):
            given = min(max(over, 0), max(widths[k] - _NARROWEST, 0))
            widths[k] -= given
            over -= given
        for chosen in _packed(widths, room):
            own = [widths[k] for k in chosen]
            left = [place for place, k in enumerate(chosen) if k in grid.words]
            for row in rows:
                cells = [self._wrapped(row[k], widths[k]) for k in chosen]
                yield from _hung(_row(cells, own, left), _GAP, _GAP)
        if grid.caption:
            yield from _hung(self._flow(grid.caption, len(_GAP), "dim"), _GAP, _GAP)


def _text(parts: Iterable[doc.Inline], style: str = "") -> Text:
    text = Text(style=style)
    for part in parts:
        bold = isinstance(part, doc.Strong | doc.Code | doc.Typed)
        content = part if isinstance(part, str) else part.text
        shown = content if content.isprintable() else visible(content)
        text.append(shown, style="bold" if bold else "")
    return text


def _cell(content: doc.Blank) -> Text:
    return Text(_BLANK, style="dim") if content is None else _text(doc.parts_of(content))


def _hung(lines: Iterable[Text], first: str | Text, rest: str | Text) -> Iterator[Text]:
    """Lines behind a beginning."""
    for number, line in enumerate(lines):
        yield Text.assemble(rest if number else first, line)


def _row(cells: Sequence[list[Text]], widths: Sequence[int], left: Sequence[int]) -> Iterator[Text]:
    """Cells of several lines each, beside each other."""
    for line in zip_longest(*cells, fillvalue=Text()):
        row = Text()
        for k, (cell, width) in enumerate(zip(line, widths, strict=True)):
            space = " " * (width - cell.cell_len)
            parts = (cell, space) if k in left else (space, cell)
            row = Text.assemble(row, _GAP if k else "", *parts)
        yield row


def _total(widths: Sequence[int]) -> int:
    """Width of columns beside each other."""
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _packed(widths: Sequence[int], room: int) -> Iterator[list[int]]:
    """Columns in order, the first one in every group, as many to a group as fit."""
    chosen = [0]
    for k in range(1, len(widths)):
        if len(chosen) > 1 and _total([widths[c] for c in (*chosen, k)]) > room:
            yield chosen
            chosen = [0]
        chosen.append(k)
    yield chosen
