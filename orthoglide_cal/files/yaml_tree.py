"""YAML to a tree of dicts, lists and texts with the line of each; and plain values to YAML.

Hostile text is refused. Scalars stay text (None for null): what is a number is decided by the
schema that wants one, not by YAML's guesses (`1e-3` a text, `012` ten, `1:30` ninety, `on` true).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count
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


def load_tree(file: FileText) -> Tree:
    """Parse a file without resolving anything.

    Work and memory are bounded by the size limit: aliases, anchors and tags are refused, as are
    more than 20 levels or 60,000 nodes, before what follows them is looked at.

    Raises:
        InputError: not YAML, or something refused, with its line.
    """
    check_size(file.size, file.path, YAML_LIMIT)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    events: Iterator[Any] = yaml.parse(file.text, Loader=loader)
    tree, nodes, documents = Tree(file, Faults(file.path)), count(1), 0

    def check(event: Any, path: Steps) -> None:
        tag, value = getattr(event, "tag", None), None
        if value := event.anchor:
            what, remedy = "Anchors and aliases are not accepted.", "Write the value out."
        elif tag and tag != "!":
            what, remedy, value = "Tags are not accepted.", "Remove the tag.", tag
        elif has_control(text := getattr(event, "value", "")):
            what, remedy, value = "The text holds a control character.", "Remove it.", text
        elif next(nodes) > _NODES:
            what, remedy = f"More than {_NODES} values.", "Give a smaller file."
        elif len(path) > _DEPTH:
            what, remedy = f"Nested deeper than {_DEPTH} levels.", "Give a simpler file."
        else:
            return
        line, column = event.start_mark.line + 1, dotted(path) or None
        raise InputError(what, remedy, file=file.path, line=line, column=column, value=value)

    def read(tree: Tree, event: Any, path: Steps, line: int) -> Any:
        """The value of the node that begins with an event; what is found goes to a tree."""
        check(event, path)
        tree.lines[path] = line
        if isinstance(event, yaml.ScalarEvent):
            return None if not event.style and event.value in _NULLS else event.value
        content: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
        for each in events:
            line = each.start_mark.line + 1
            if isinstance(each, yaml.CollectionEndEvent):
                break
            if isinstance(content, list):
                content.append(read(tree, each, (*path, len(content)), line))
                continue
            key = (*path, getattr(each, "value", ""))
            check(each, path)
            if not isinstance(each, yaml.ScalarEvent) or (not each.style and each.value in _NULLS):
                what, remedy = "A key must be a word.", "Write `name: value`."
                raise InputError(what, remedy, file=file.path, line=line)
            if each.value not in content:
                content[each.value] = read(tree, next(events), key, line)
                continue
            value = read(Tree(file, Faults(file.path)), next(events), key, line)
            what = f"The key is given twice (first in line {tree.lines[key]})."
            text = value if isinstance(value, str) else None
            tree.faults.at(FaultPlace(line, dotted(key), text), what, "Remove one of them.")
        return content

    try:
        for event in events:
            line = event.start_mark.line + 1
            documents += isinstance(event, yaml.DocumentStartEvent)
            if documents > 1:
                what = "The file holds several documents."
                raise InputError(what, "Remove the `---`.", file=file.path, line=line)
            if isinstance(event, yaml.NodeEvent):
                tree.value = read(tree, event, (), line)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        problem = getattr(error, "problem", None)
        remedy = "Check indentation, colons and quotes."
        if problem is None:
            problem, remedy = "a character is not allowed", "Save it as plain UTF-8 text."
        elif "\\t" in problem:
            remedy = "Indent with spaces, not tabs."
        line, what = mark.line + 1 if mark else None, f"This is not valid YAML: {problem}."
        raise InputError(what, remedy, file=file.path, line=line) from error
    return tree


def yaml_text(value: object) -> str:
    """YAML of plain values, in the order given, as `load_tree` reads it back."""
    style: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "width": 1000}
    written: str = yaml.dump(value, Dumper=_Dumper, default_flow_style=None, **style)
    return written


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes a value that occurs twice twice; `load_tree` refuses aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True
