"""A page as Markdown (tables as GitHub writes them); of pictures, what characters can show."""

import re
from collections.abc import Iterable

from orthoglide_cal.errors import visible
from orthoglide_cal.report import document as doc

# What Markdown obeys anywhere in a line; other signs matter only at its beginning, where no text
# from outside stands. Addresses become links by themselves unless they are written so.
_SIGNS = re.compile(r"([\\`*_\[\]<|~&$])")
_ADDRESS = (("://", ":&#47;&#47;"), ("www.", "www&#46;"), ("@", "&#64;"))


def markdown(page: doc.Page) -> str:
    """The page's text."""
    title = f": {in_markdown(page.title)}" if page.title is not None else ""
    parts = [f"**{in_markdown(page.stamp)}**"] if page.stamp else []
    parts += [f"# {in_markdown(page.kind)}{title}"]
    parts += [_block(block) for block in (page.facts, page.notice) if block is not None]
    for section in page.in_characters:
        if section.title is not None:
            parts.append(f"## {in_markdown(section.title)}")
        parts += [_block(block) for block in section.blocks]
    parts += [in_markdown(f"{role}, date: {doc.BLANK}") for role in page.signatures]
    parts += map(in_markdown, page.closing)
    return "\n\n".join([*parts, doc.MARK])


def _block(block: doc.Block) -> str:
    match block:
        case doc.Notice():
            title = in_markdown(block.title)
            lines = [f"**{block.tone.sign}{title}**", *(_line(line) for line in block.lines)]
            return "\n>\n".join(f"> {line}" for line in lines)
        case doc.Facts():
            return "\n".join(f"- {in_markdown(name)}: {_line(value)}" for name, value in block.rows)
        case doc.Grid():
            titles = (in_markdown(title) or " " for title in block.head)
            rules = ("---" if k in block.words else "---:" for k in range(len(block.head)))
            rows = ["| " + " | ".join(map(_line, row)) + " |" for row in block.rows]
            caption = [f"\n{in_markdown(block.caption)}"] if block.caption else []
            return "\n".join([f"| {' | '.join(titles)} |", f"|{'|'.join(rules)}|", *rows, *caption])
        case doc.Figure():
            return "\n\n".join(map(_block, block.plain))
        case doc.Listing():
            shown = [visible(line) for line in block.lines]
            fence = _fence(shown, 3)
            return "\n".join([f"{fence}text", *shown, fence])
        case doc.Instructions():
            return "\n".join(f"{n}. {_line(item)}" for n, item in enumerate(block.items, start=1))
        case _:
            return _line(block)


def _line(content: doc.Blank) -> str:
    return "".join(_inline(part) for part in doc.parts_of(content))


def _inline(part: doc.Marked) -> str:
    if part.style in ("code", "typed", "command"):
        return " " * (part.style == "command") + _code(part.text)
    text = in_markdown(part.text)
    return f"**{text}**" if part.style in ("strong", "doubtful") else text


def in_markdown(text: str) -> str:
    """The text so that Markdown shows it as it stands, on one line."""
    escaped = _SIGNS.sub(r"\\\1", visible(text))
    for plain, written in _ADDRESS:
        escaped = escaped.replace(plain, written)
    return escaped


def _code(content: str) -> str:
    """A code span that a backtick, or a table's bar, inside the text cannot end."""
    shown = visible(content).replace("|", "\\|")
    fence = _fence((shown,), 1)
    pad = " " if "`" in shown else ""
    return f"{fence}{pad}{shown}{pad}{fence}"


def _fence(lines: Iterable[str], least: int) -> str:
    """Backticks, more than the texts have in a row."""
    runs = (len(run) for line in lines for run in re.findall("`+", line))
    return "`" * max([least - 1, *runs], default=0) + "`"
