"""HTML and SVG that cannot be injected into: text is escaped unless it was made here."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape as _escape

from orthoglide_cal.report.shown import visible

_VOID = frozenset(("br", "hr", "img", "link", "meta"))
Attribute = str | float | int | bool | None


class Html(str):
    """Markup; made by `tag`, `text` and `join` only."""

    __slots__ = ()


Child = str | Html | None


def text(content: str) -> Html:
    """Plain text as markup; control characters become visible."""
    return content if isinstance(content, Html) else Html(_escape(visible(content), quote=True))


def join(parts: Iterable[Child], between: str = "") -> Html:
    """Parts one after the other; plain strings among them are escaped."""
    return Html(between.join(text(part) for part in parts if part is not None))


def tag(name: str, /, *children: Child, **attributes: Attribute) -> Html:
    """An element.

    Args:
        name: of the element.
        children: markup, or plain text that is escaped; None is left out.
        attributes: a trailing "_" is dropped and others become "-" ("stroke_width", "class_");
            None and False are left out, True stands without a value.
    """
    written = "".join(_attribute(key, value) for key, value in attributes.items())
    if name in _VOID:
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(children)}</{name}>")


def _attribute(key: str, value: Attribute) -> str:
    if value is None or value is False:
        return ""
    name = key.rstrip("_").replace("_", "-")
    if value is True:
        return f" {name}"
    content = f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)
    return f' {name}="{_escape(visible(content), quote=True)}"'
