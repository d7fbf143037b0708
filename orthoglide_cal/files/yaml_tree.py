"""YAML to a tree of dicts, lists and texts with the line of each; and plain values to YAML.

Hostile text is refused. Scalars stay text (None for null): what is a number is decided by the
schema that wants one, not by YAML's guesses (`1e-3` a text, `012` ten, `1:30` ninety, `on` true).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import yaml

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import FaultPlace, Faults, Steps, dotted
from orthoglide_cal.files.text import YAML_LIMIT, FileText, check_size, has_control

_DEPTH = 20
_NODES = 60_000  # 2,500 readings with every field; read in half a second
_NULLS = ("", "~", "null", "Null", "NULL")


@dataclass
class Tree:
    """One YAML file.

    Attributes:
        file: where it came from.
        faults: duplicate keys found so far.
        value: dict, list, str or None, nested.
        lines: path of each node → its line, from 1.
    """

    file: FileText
    faults: Faults
    value: Any = None
    lines: dict[Steps, int] = field(default_factory=dict, repr=False)

    def place(self, path: Steps) -> FaultPlace:
        """Where the node at `path` stands; of one that is missing, where its parent does."""
        value, there = self.value, path
        while there and there not in self.lines:
            there = there[:-1]
        for step in there:
            value = value[step]
        text = value if there == path and isinstance(value, str) else None
        return FaultPlace(self.lines.get(there, 1), dotted(path), text)


@dataclass
class _Open:
    """A list or mapping whose end has not come yet.

    Attributes:
        path: where it stands; None inside what is left out, the value of a duplicate key.
        content: so far.
        key, line: what awaits its value.
    """

    path: Steps | None
    content: Any
    key: str | None = None
    line: int = 0


def load_tree(file: FileText) -> Tree:
    """Parse a file without resolving anything.

    Work and memory are bounded by the size limit: aliases, anchors and tags are refused, as are
    more than 20 levels or 60,000 nodes. The parser's events are taken one by one: no recursion, so
    depth cannot exhaust the stack.

    Raises:
        InputError: not YAML, or something refused, with its line.
    """
    check_size(file.size, file.path, YAML_LIMIT)
    tree, stack, nodes, files = Tree(file, Faults(file.path)), list[_Open](), 0, 0
    try:
        for event in yaml.parse(file.text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            nodes += isinstance(event, yaml.NodeEvent)
            files += isinstance(event, yaml.DocumentStartEvent)
            refusal = _refusal(event, nodes, len(stack), files)
            if refusal:
                what, remedy, value = refusal
                raise InputError(
                    what,
                    remedy,
                    file=file.path,
                    line=event.start_mark.line + 1 if event.start_mark else None,
                    column=(dotted(stack[-1].path or ()) if stack else "") or None,
                    value=value,
                )
            if isinstance(event, yaml.ScalarEvent):
                null = not event.style and event.value in _NULLS
                _put(tree, stack, event, None if null else event.value)
            elif isinstance(event, yaml.CollectionStartEvent):
                content: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
                stack.append(_Open(_put(tree, stack, event, content), content))
            elif isinstance(event, yaml.CollectionEndEvent):
                stack.pop()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        tab = "\\t" in (error.problem or "")
        raise InputError(
            f"This is not valid YAML: {error.problem}.",
            "Indent with spaces, not tabs." if tab else "Check indentation, colons and quotes.",
            file=file.path,
            line=mark.line + 1 if mark else None,
        ) from error
    except yaml.YAMLError as error:
        raise InputError(
            "This is not valid YAML: it holds characters that YAML does not allow.",
            "Save it as plain UTF-8 text.",
            file=file.path,
        ) from error
    return tree


def _refusal(event: Any, nodes: int, depth: int, files: int) -> tuple[str, str, str | None] | None:
    """What is wrong with an event, the remedy, and the text there; None where it is accepted."""
    tag, scalar = getattr(event, "tag", None), isinstance(event, yaml.ScalarEvent)
    if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
        return "Anchors and aliases are not accepted.", "Write the value out.", event.anchor
    if tag and tag != "!":
        return "Tags are not accepted.", "Remove the tag.", tag
    if scalar and has_control(event.value):
        return "The text holds a control character.", "Remove it.", event.value
    if files > 1:
        return "The file holds several documents.", "Remove the `---`.", None
    if nodes > _NODES:
        return f"More than {_NODES} values.", "Give a smaller file.", None
    if depth >= _DEPTH and isinstance(event, yaml.CollectionStartEvent):
        return f"Nested deeper than {_DEPTH} levels.", "Give a simpler file.", None
    return None


def _put(tree: Tree, stack: list[_Open], event: Any, value: object) -> Steps | None:
    """Put a node where it belongs; returns its path, None in what is left out."""
    line = event.start_mark.line + 1
    step: str | int
    if not stack:
        tree.value, tree.lines[()] = value, line
        return ()
    top = stack[-1]
    if isinstance(top.content, list):
        step = len(top.content)
        top.content.append(value)
    elif top.key is None and isinstance(value, str):
        top.key, top.line = value, line
        return top.path
    elif top.key is None:
        what = "A key must be a word."
        raise InputError(what, "Write `name: value`.", file=tree.file.path, line=line)
    else:
        step, line, top.key = top.key, top.line, None
        if step in top.content:
            if top.path is not None:
                path = (*top.path, step)
                tree.faults.add(
                    f"The key stands twice (first in line {tree.lines[path]}).",
                    "Remove one of them.",
                    line=line,
                    column=dotted(path),
                    value=value if isinstance(value, str) else None,
                )
            return None
        top.content[step] = value
    if top.path is None:
        return None
    path = (*top.path, step)
    tree.lines[path] = line
    return path


def yaml_text(value: object) -> str:
    """YAML of plain values, in the order given, as `load_tree` reads it back."""
    written: str = yaml.dump(
        value,
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=1000,
        default_flow_style=None,
    )
    return written


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes a value that occurs twice twice; `load_tree` refuses aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True
