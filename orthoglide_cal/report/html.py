"""A document as one HTML page that needs nothing else: style and pictures are inside.

No scripts; the Content-Security-Policy allows this page's own style and nothing more, so that
even markup that slipped through could neither run nor fetch anything.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files

from orthoglide_cal.report.blocks import (
    Block,
    Code,
    Document,
    Facts,
    Figure,
    Given,
    Inline,
    Line,
    Notice,
    Paragraph,
    Section,
    Steps,
    Strong,
    Table,
)
from orthoglide_cal.report.markup import Html, join, tag, text

SIGNS = {"good": "✔", "warn": "!", "bad": "✘", "info": "i"}
_COLUMNS = {1: "one", 2: "two", 3: "three"}


def page(document: Document) -> str:
    """The page's text."""
    style = _style(document)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:;"
        " base-uri 'none'; form-action 'none'"
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", name="referrer", content="no-referrer"),
        tag("link", rel="icon", href="data:,"),
        tag("title", f"{document.kind} {document.number}: {document.title}"),
        Html(f"<style>{style}</style>"),
    )
    body = tag("body", _header(document), _main(document), _footer(document))
    return f"<!DOCTYPE html>\n{tag('html', head, body, lang='en')}\n"


def _style(document: Document) -> str:
    """The style sheet; every printed page carries the report's number and its own."""
    sheet = files("orthoglide_cal.report").joinpath("style.css").read_text(encoding="utf-8")
    # Letters, digits and "-" only, whatever the number is made of.
    number = "".join(c for c in document.number if c.isalnum() or c == "-")
    corner = "font: 8pt sans-serif; color: #444444; vertical-align: top; padding-top: 3mm;"
    return sheet + (
        f'@page {{ @bottom-left {{ content: "{document.kind} {number}"; {corner} }}'
        ' @bottom-right { content: "Page " counter(page) " of " counter(pages);'
        f" {corner} }} }}\n"
    )


def _header(document: Document) -> Html:
    return tag(
        "header",
        tag("p", document.kind, class_="kind"),
        tag("h1", tag("bdi", document.title)),
        _block(document.facts),
        _notice(document.notice),
    )


def _main(document: Document) -> Html:
    signatures = [tag("div", f"{role}, date") for role in document.signatures]
    return tag(
        "main",
        *_sections(document.sheet),
        tag("div", *signatures, class_="sign") if signatures else None,
        tag("div", *_sections(document.sections), class_="evidence"),
    )


def _footer(document: Document) -> Html:
    return tag("footer", f"{document.kind} {document.number}")


def _sections(sections: tuple[Section, ...]) -> list[Html]:
    parts: list[Html] = []
    waiting: list[Html] = []
    for section in sections:
        waiting.append(_section(section))
        if not section.beside:
            parts.append(tag("div", *waiting, class_="beside") if len(waiting) > 1 else waiting[0])
            waiting = []
    return parts + waiting


def _section(section: Section) -> Html:
    return tag("section", tag("h2", section.title), *(_block(b) for b in section.blocks))


def _block(block: Block) -> Html:
    match block:
        case Paragraph():
            return tag("p", _line(block.content), class_="small" if block.small else None)
        case Notice():
            return _notice(block)
        case Facts():
            rows = (join((tag("dt", name), tag("dd", _cell(value)))) for name, value in block.rows)
            return tag("dl", *rows)
        case Table():
            return _table(block)
        case Figure():
            return _figure(block)
        case Steps():
            items = (
                tag(
                    "li",
                    _line(step.content),
                    tag("code", step.code, class_="command") if step.code else None,
                )
                for step in block.items
            )
            return tag("ol", *items, class_="steps")


def _notice(notice: Notice) -> Html:
    sign = tag("span", f"{SIGNS[notice.tone]} ", aria_hidden="true")
    return tag(
        "div",
        tag("h2", sign, notice.title),
        *(tag("p", _line(line)) for line in notice.lines),
        class_=f"notice {notice.tone}",
    )


def _table(table: Table) -> Html:
    def kind(column: int) -> str | None:
        return "words" if column in table.words else None

    head = tag("tr", *(tag("th", t, scope="col", class_=kind(k)) for k, t in enumerate(table.head)))
    last = len(table.rows) - 1 if table.last_is_total else -1
    rows = (
        tag(
            "tr",
            *(tag("td", _cell(cell), class_=kind(k)) for k, cell in enumerate(row)),
            class_="total" if n == last else None,
        )
        for n, row in enumerate(table.rows)
    )
    return tag(
        "div",
        tag(
            "table",
            tag("caption", table.caption) if table.caption else None,
            tag("thead", head),
            tag("tbody", *rows),
        ),
        class_="scroll whole" if len(table.rows) < 25 else "scroll",
        tabindex="0",
        role="region",
        aria_label=table.caption or " ".join(table.head).strip() or "table",
    )


def _figure(figure: Figure) -> Html:
    layout = "pairs" if figure.pairs else _COLUMNS[figure.columns]
    return tag(
        "figure",
        tag("figcaption", tag("strong", figure.title) if figure.title else None, figure.finding),
        tag("div", *figure.panels, class_=f"panels {layout}"),
        tag("div", figure.legend, class_="legend") if figure.legend else None,
        tag("p", figure.key, class_="small") if figure.key else None,
    )


def _cell(content: Line | None) -> Html:
    if content is None:
        return tag("span", class_="blank", role="img", aria_label="not given")
    return _line(content)


def _line(content: Line) -> Html:
    parts = content if isinstance(content, tuple) else (content,)
    return join(_inline(part) for part in parts)


def _inline(part: Inline) -> Html:
    match part:
        case Code():
            return tag("code", part.text)
        case Strong():
            return tag("strong", part.text)
        case Given():
            return tag("bdi", part.text)
        case _:
            return text(part)
