"""A page as one HTML file that needs nothing else: style and pictures are inside."""

import re
from collections.abc import Iterable, Iterator
from importlib.resources import files

from orthoglide_cal.report import document as doc
from orthoglide_cal.report.document import Html, join, tag

_COLUMNS = {0: "half", 2: "two", 3: "three"}
MOST_NARROW = 4  # columns that a telephone has room for: of more each cell stands below its title
# What must not break: a date, a coordinate behind its sign, a value behind its name and before its
# uncertainty.
_U = r"± \d[\d.]*(?: (?:mm|µm|mrad)(?:/\w+)?\b)?"
_VALUE = rf"(?:(?<!\S)\w+ )?(?<![\w.])(?:[A-Z]?[-+−]\d[\d.]*(?: {_U})?|\d[\d.]* {_U})"
_CHANCE = r"\b[pk] [=<>] \d[\d.]*"
_WHOLE = re.compile(rf"(\d{{4}}-\d\d-\d\d|(?:[<>] )?\d[\d.]* %|{_CHANCE}|{_VALUE}|{_U})")


def html(page: doc.Page) -> str:
    """The file's text."""
    # Every printed page carries the report's number, whatever it is made of, and its own.
    number = "".join(c for c in page.name if c.isalnum() or c in "- ")
    style = files("orthoglide_cal.report").joinpath("style.css").read_text(encoding="utf-8")
    head = Html(
        '<meta charset="utf-8"><link rel="icon" href="data:,">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<style>{style.replace('NUMBER', number)}</style>"
    )
    name = tag("title", ": ".join(filter(None, (page.name, page.title))))
    title = tag("h1", tag("bdi", page.title)) if page.title is not None else None
    top = (_block(block) for block in (page.facts, page.notice) if block is not None)
    signatures = [tag("div", f"{role}, date") for role in page.signatures]
    main = tag(
        "main",
        tag("div", *_sections(page.sheet), class_="sheet"),
        tag("div", *signatures, class_="sign") if signatures else None,
        tag("div", *_sections(page.sections), class_="evidence"),
    )
    stamp = []
    if page.stamp:
        across = tag("div", class_="stamp", data_word=page.stamp.split(":")[0], aria_hidden="true")
        stamp = [across, tag("p", page.stamp, class_="kind")]
    header = tag("header", tag("p", page.kind, class_="kind"), title, *top)
    footer = tag("footer", *(tag("p", line) for line in page.closing)) if page.closing else None
    body = tag("body", *stamp, header, main, footer)
    return f"<!DOCTYPE html>\n{tag('html', tag('head', head, name), body, lang='en')}\n{doc.MARK}"


def _sections(sections: Iterable[doc.Section]) -> Iterator[Html]:
    for section in sections:
        title = tag("h2", section.title) if section.title is not None else None
        if section.blocks:
            yield tag("section", title, *map(_block, section.blocks))


def _block(block: doc.Block) -> Html:
    match block:
        case doc.Marked("small"):
            return tag("p", _line(block), class_="small")
        case doc.Notice():
            title = tag("h2", tag("span", block.tone.sign, aria_hidden="true"), _line(block.title))
            lines = (tag("p", _line(line)) for line in block.lines)
            return tag("div", title, *lines, class_=f"notice {block.tone}")
        case doc.Facts():
            rows = (join((tag("dt", name), tag("dd", _line(value)))) for name, value in block.rows)
            return tag("dl", *rows)
        case doc.Grid():
            # Beside what scrolls: a wide table on a narrow page does not take its caption along.
            caption = tag("p", block.caption, class_="small") if block.caption else None
            whole = "whole" if len(block.rows) < 25 and not block.tiles else None
            return tag("div", _table(block), caption, class_=whole)
        case doc.Figure():
            return tag(
                "figure",
                tag("figcaption", tag("strong", block.title)) if block.title else None,
                tag("div", *block.panels, class_=f"panels {_COLUMNS[block.columns]}"),
                tag("p", block.key, class_="small") if block.key else None,
                class_="beside" if block.columns == 0 else None,
            )
        case doc.Listing():
            return tag("pre", join(block.lines, "\n"), class_="scroll", tabindex="0")
        case doc.Instructions():
            return tag("ol", *(tag("li", _line(item)) for item in block.items), class_="steps")
        case _:
            return tag("p", _line(block))


def _table(grid: doc.Grid) -> Html:
    kinds = ["words" if k in grid.words else None for k in range(len(grid.head))]
    heads = [
        tag("th", title, scope="col", class_=kind) if title else tag("td")
        for title, kind in zip(grid.head, kinds, strict=True)
    ]
    head = tag("thead", tag("tr", *heads)) if any(grid.head) else None
    stacked = (len(kinds) > MOST_NARROW or head is None) and not grid.tiles
    rows = []
    for first, *others in grid.rows:
        name, scope = ("th", "row") if first and 0 in grid.words else ("td", None)
        cells = (
            tag("td", _line(cell), class_=kind, data_head=title or None)
            for cell, kind, title in zip(others, kinds[1:], grid.head[1:], strict=True)
        )
        rows.append(tag("tr", tag(name, _line(first), scope=scope, class_=kinds[0]), *cells))
    return tag(
        "div",
        tag("table", head, tag("tbody", *rows), class_="many" if stacked else None),
        class_="tiles" if grid.tiles else "scroll",
        tabindex="0",
        role="region",
        aria_label=grid.caption or " ".join(grid.head).strip() or "table",
    )


def _line(content: doc.Blank) -> Html:
    return join(_inline(part) for part in doc.parts_of(content))


def _inline(part: doc.Marked) -> Html:
    if part.style == "blank":
        return tag("span", class_="blank", role="img", aria_label="not given")
    if part.style in ("code", "typed"):
        return tag("code", part.text, class_="typed" if part.style == "typed" else None)
    if part.style == "command":  # on a narrow page it breaks between words, not at an option's dash
        spans = (tag("span", word) for word in part.text.split(" "))
        return tag("code", join(spans, " "), class_="command")
    if part.style == "doubtful":
        return tag("strong", tag("bdi", part.text), class_="doubt")
    if part.style in ("strong", "given"):
        return tag("strong" if part.style == "strong" else "bdi", part.text)
    pieces = enumerate(_WHOLE.split(part.text))
    return join(tag("span", piece, class_="nb") if k % 2 else piece for k, piece in pieces)
