"""YAML text to plain dicts, lists and strings, with the line of everything; hostile text refused.

Scalars stay text (None for null): what is a number is decided by the field that wants one, not by
YAML's guesses (`1e-3` a text, `012` ten, `1:30` ninety, `on` true).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from orthoglide_cal.data.document import YAML_LIMIT, Document, check_size, has_control
from orthoglide_cal.data.faults import Faults
from orthoglide_cal.errors import InputError

Path = tuple[str | int, ...]

_DEPTH = 20
_NODES = 60_000  # 2,500 readings with every field; read in half a second
_NULLS = ("", "~", "null", "Null", "NULL")
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Tree:
    """One YAML document.

    Attributes:
        value: dict, list, str or None, nested.
        lines: path of each node → its line, from 1.
        document: where it came from.
        faults: duplicate keys found so far.
    """

    value: Any
    lines: Mapping[Path, int]
    document: Document
    faults: Faults = field(repr=False)

    def line(self, path: Path) -> int:
        """Line of the node at `path`, or of its closest parent."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)


def dotted(path: Path) -> str:
    """`("identified", 0, "cause")` as `identified[0].cause`."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.lstrip(".")


def load_tree(document: Document) -> Tree:
    """Parse a document without resolving anything.

    Work and memory are bounded by the size limit: aliases, anchors and tags are refused, as are
    more than 20 levels or 60,000 nodes.

    Raises:
        InputError: not YAML, or something refused, with its line.
    """
    check_size(document.size, document.path, YAML_LIMIT)
    builder = _Builder(document)
    try:
        for event in yaml.parse(document.text, Loader=_LOADER):
            builder.take(event)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        tab = "\\t" in (error.problem or "")
        raise InputError(
            f"This is not valid YAML: {error.problem}.",
            "Indent with spaces, not tabs." if tab else "Check indentation, colons and quotes.",
            file=document.path,
            line=mark.line + 1 if mark else None,
        ) from error
    except yaml.YAMLError as error:
        raise InputError(
            "This is not valid YAML: it holds characters that YAML does not allow.",
            "Save it as plain UTF-8 text.",
            file=document.path,
        ) from error
    return Tree(builder.root, builder.lines, document, builder.faults)


@dataclass
class _Open:
    """A list or mapping whose end has not come yet; `key` awaits its value."""

    path: Path
    content: Any
    key: str | None = None
    key_line: int = 0
    skip: bool = False  # the value belongs to a duplicate key


class _Builder:
    """Builds the tree from parser events; no recursion, so depth cannot exhaust the stack."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.faults = Faults(document.path)
        self.root: Any = None
        self.lines: dict[Path, int] = {}
        self.stack: list[_Open] = []
        self.nodes = 0
        self.documents = 0

    def take(self, event: Any) -> None:
        self.refuse(event)
        if isinstance(event, yaml.ScalarEvent):
            plain = not event.style and event.value in _NULLS
            self.place(event, None if plain else event.value)
        elif isinstance(event, yaml.SequenceStartEvent):
            self.open(event, [])
        elif isinstance(event, yaml.MappingStartEvent):
            self.open(event, {})
        elif isinstance(event, yaml.CollectionEndEvent):
            self.stack.pop()

    def refuse(self, event: Any) -> None:
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise self.error(
                event, "Anchors and aliases are not accepted.", "Write the value out.", event.anchor
            )
        if getattr(event, "tag", None) and event.tag != "!":
            raise self.error(event, "Tags are not accepted.", "Remove the tag.", event.tag)
        if isinstance(event, yaml.ScalarEvent) and has_control(event.value):
            raise self.error(
                event, "The text holds a control character.", "Remove it.", event.value
            )
        if isinstance(event, yaml.DocumentStartEvent):
            self.documents += 1
            if self.documents > 1:
                raise self.error(event, "The file holds several documents.", "Remove the `---`.")

    def open(self, event: Any, content: Any) -> None:
        path, skip = self.place(event, content)
        if len(self.stack) >= _DEPTH:
            raise self.error(event, f"Nested deeper than {_DEPTH} levels.", "Give a simpler file.")
        self.stack.append(_Open(path, content, skip=skip))

    def place(self, event: Any, value: Any) -> tuple[Path, bool]:
        """Put a node where it belongs; returns its path and whether it is a duplicate's."""
        self.nodes += 1
        if self.nodes > _NODES:
            raise self.error(event, f"More than {_NODES} values.", "Give a smaller file.")
        line = event.start_mark.line + 1
        if not self.stack:
            self.root = value
            self.lines[()] = line
            return (), False
        top = self.stack[-1]
        if isinstance(top.content, list):
            path = (*top.path, len(top.content))
            top.content.append(value)
        elif top.key is None:
            if not isinstance(value, str):
                raise self.error(event, "A key must be a word.", "Write `name: value`.")
            top.key, top.key_line = value, line
            return (*top.path, value), False
        else:
            path, line = (*top.path, top.key), top.key_line
            if top.key in top.content:
                self.faults.add(
                    f"The key stands twice (first in line {self.lines[path]}).",
                    "Remove one of them.",
                    line=line,
                    column=dotted(path),
                    value=value if isinstance(value, str) else None,
                )
                top.key = None
                return path, True
            top.content[top.key] = value
            top.key = None
        if not top.skip:
            self.lines[path] = line
        return path, top.skip

    def error(self, event: Any, what: str, remedy: str, value: str | None = None) -> InputError:
        return InputError(
            what,
            remedy,
            file=self.document.path,
            line=event.start_mark.line + 1,
            column=dotted(self.stack[-1].path) or None if self.stack else None,
            value=value,
        )
