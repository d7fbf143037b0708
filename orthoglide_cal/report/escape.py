"""HTML and SVG: made with `tag`, `in_html` and `join`, which escape all but their own."""

from collections.abc import Iterable
from html import escape

from orthoglide_cal.errors import visible


class Html(str):
    """Markup; made by `tag`, `in_html` and `join`, or of constants; never of text from outside."""

    __slots__ = ()


Child = str | Html | None


def in_html(content: str) -> Html:
    """Plain text as markup; markup stays as it is."""
    if isinstance(content, Html):
        return content
    return Html(escape(visible(content)))


def join(parts: Iterable[Child], between: str = "") -> Html:
    """Parts one after the other; plain strings among them are escaped, None is left out."""
    return Html(between.join(in_html(part) for part in parts if part is not None))


def tag(name: str, /, *children: Child, **attributes: str | float | None) -> Html:
    """An element.

    Args:
        name: of the element.
        children: markup, or plain text that is escaped; None is left out.
        attributes: a trailing "_" is dropped and others become "-" ("stroke_width", "class_");
            None is left out.
    """
    written = ""
    for key, value in attributes.items():
        if value is not None:
            number = isinstance(value, float)
            content = f"{value:.2f}".rstrip("0").rstrip(".") if number else str(value)
            written += f' {key.rstrip("_").replace("_", "-")}="{in_html(content)}"'
    return Html(f"<{name}{written}>{join(children)}</{name}>")
