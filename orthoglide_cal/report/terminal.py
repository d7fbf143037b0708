"""A document for a terminal of 80 columns, as something that rich prints."""

from __future__ import annotations

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table as Grid
from rich.text import Text

from orthoglide_cal.report.blocks import (
    Block,
    Code,
    Document,
    Facts,
    Figure,
    Line,
    Notice,
    Paragraph,
    Step,
    Steps,
    Strong,
    Table,
)
from orthoglide_cal.report.html import SIGNS
from orthoglide_cal.report.shown import visible

_COLOURS = {"good": "green", "warn": "yellow", "bad": "red", "info": "blue"}
_BLANK = "_" * 12


def renderable(document: Document) -> RenderableType:
    """The document; text from outside is shown, never obeyed."""
    parts: list[RenderableType] = [
        Text(visible(f"{document.kind}: {document.title}"), style="bold"),
        _block(document.facts),
        _block(document.notice),
    ]
    for section in (*document.sheet, *document.sections):
        parts.append(Text())
        parts.append(Text(visible(section.title), style="bold underline"))
        for number, block in enumerate(section.blocks):
            if number and isinstance(block, Table | Figure | Facts):
                parts.append(Text())
            parts.append(_block(block))
    if document.signatures:
        parts.append(Text())
        parts += [Text(f"{role}, date: {_BLANK}") for role in document.signatures]
    return Group(*parts)


def _block(block: Block) -> RenderableType:
    match block:
        case Paragraph():
            text = _line(block.content)
            if block.small:
                text.stylize("dim")
            return text
        case Notice():
            lines = Group(*(_line(line) for line in block.lines))
            colour = _COLOURS[block.tone]
            title = Text(f"{SIGNS[block.tone]} {visible(block.title)}", style=f"bold {colour}")
            content: RenderableType = lines if block.lines else Text()
            return Panel(content, title=title, title_align="left", border_style=colour)
        case Facts():
            grid = Grid.grid(padding=(0, 2, 0, 0))
            grid.add_column(style="dim", no_wrap=True, max_width=30)
            grid.add_column(overflow="fold")
            for name, value in block.rows:
                grid.add_row(Text(visible(name)), _cell(value))
            return grid
        case Table():
            return _table(block)
        case Figure():
            return _figure(block)
        case Steps():
            return Group(*(_step(n, step) for n, step in enumerate(block.items, start=1)))


def _step(number: int, step: Step) -> RenderableType:
    grid = Grid.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=2, justify="right")
    grid.add_column(overflow="fold")
    grid.add_row(Text(f"{number}."), _line(step.content))
    if step.code:
        grid.add_row("", Text(visible(step.code), style="bold"))
    return grid


def _table(table: Table) -> RenderableType:
    grid = Grid(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, header_style="dim")
    for k, title in enumerate(table.head):
        words = k in table.words
        grid.add_column(
            Text(visible(title)),
            justify="left" if words else "right",
            overflow="fold",
            no_wrap=not words,
        )
    for n, row in enumerate(table.rows):
        if table.last_is_total and n == len(table.rows) - 1:
            grid.add_section()
        grid.add_row(*(_cell(cell) for cell in row))
    if not table.caption:
        return grid
    return Group(grid, Text(visible(table.caption), style="dim"))


def _figure(figure: Figure) -> RenderableType:
    name = f"{visible(figure.title)}. " if figure.title else ""
    parts: list[RenderableType] = [Text(f"{name}{visible(figure.finding)}")]
    if figure.sketch:
        rows = Text("\n".join(visible(row) for row in figure.sketch), no_wrap=True)
        parts.append(Padding(rows, (0, 0, 0, 2)))
    return Group(*parts)


def _cell(content: Line | None) -> Text:
    return Text(_BLANK, style="dim") if content is None else _line(content)


def _line(content: Line) -> Text:
    parts = content if isinstance(content, tuple) else (content,)
    text = Text(overflow="fold")
    for part in parts:
        shown = visible(part if isinstance(part, str) else part.text)
        text.append(shown, style="bold" if isinstance(part, Strong | Code) else "")
    return text
