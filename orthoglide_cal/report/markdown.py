"""A document as Markdown (tables as GitHub writes them); pictures become their findings."""

from __future__ import annotations

from orthoglide_cal.report.blocks import (
    Block,
    Code,
    Document,
    Facts,
    Figure,
    Inline,
    Line,
    Notice,
    Paragraph,
    Steps,
    Strong,
    Table,
)
from orthoglide_cal.report.shown import in_markdown, visible

_BLANK = "\\_\\_\\_\\_\\_\\_\\_\\_"


def markdown(document: Document) -> str:
    """The document's text."""
    parts = [
        f"# {in_markdown(document.kind)}: {in_markdown(document.title)}",
        _block(document.facts),
        _block(document.notice),
    ]
    for section in (*document.sheet, *document.sections):
        parts.append(f"## {in_markdown(section.title)}")
        parts += [_block(block) for block in section.blocks]
    parts += [f"{in_markdown(role)}, date: {_BLANK}" for role in document.signatures]
    return "\n\n".join(parts) + "\n"


def _block(block: Block) -> str:
    match block:
        case Paragraph():
            return _line(block.content)
        case Notice():
            lines = [f"**{in_markdown(block.title)}**", *(_line(line) for line in block.lines)]
            return "\n>\n".join(f"> {line}" for line in lines)
        case Facts():
            return "\n".join(f"- {in_markdown(name)}: {_cell(value)}" for name, value in block.rows)
        case Table():
            return _table(block)
        case Figure():
            key = f" {in_markdown(block.key)}" if block.key and not block.sketch else ""
            name = f"*{in_markdown(block.title)}.* " if block.title else ""
            title = f"{name}{in_markdown(block.finding)}{key}"
            sketch = "\n".join(visible(row) for row in block.sketch)
            return f"{title}\n\n```text\n{sketch}\n```" if sketch else title
        case Steps():
            return "\n".join(
                f"{n}. {_line(step.content)}" + (f" {_code(step.code)}" if step.code else "")
                for n, step in enumerate(block.items, start=1)
            )


def _table(table: Table) -> str:
    head = "| " + " | ".join(in_markdown(title) or " " for title in table.head) + " |"
    rule = (
        "|" + "|".join("---" if k in table.words else "---:" for k in range(len(table.head))) + "|"
    )
    rows = ["| " + " | ".join(_cell(cell) for cell in row) + " |" for row in table.rows]
    caption = [f"\n{in_markdown(table.caption)}"] if table.caption else []
    return "\n".join([head, rule, *rows, *caption])


def _cell(content: Line | None) -> str:
    return _BLANK if content is None else _line(content)


def _line(content: Line) -> str:
    parts = content if isinstance(content, tuple) else (content,)
    return "".join(_inline(part) for part in parts)


def _inline(part: Inline) -> str:
    match part:
        case Code():
            return _code(part.text)
        case Strong():
            return f"**{in_markdown(part.text)}**"
        case str():
            return in_markdown(part)
        case _:
            return in_markdown(part.text)


def _code(content: str) -> str:
    """A code span that a backtick, or a table's bar, inside the text cannot end."""
    shown = visible(content).replace("|", "\\|")
    fence = "`"
    while fence in shown:
        fence += "`"
    pad = " " if "`" in shown else ""
    return f"{fence}{pad}{shown}{pad}{fence}"
