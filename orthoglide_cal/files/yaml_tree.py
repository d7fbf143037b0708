"""YAML to a tree of dicts, lists and texts with the line of each; and plain values to YAML.

Hostile text is refused. Scalars stay text (None for null): what is a number is decided by the
schema that wants one, not by YAML's guesses (`1e-3` a text, `012` ten, `1:30` ninety, `on` true).

A file that people keep is edited, never dumped again: comments, order and blanks stay as they are.
Whoever edits one reads the result back, because YAML has forms that nobody writes.
"""

import json
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any

import yaml

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Content, Steps, dotted
from orthoglide_cal.files.text import CONTROL, FileText, check_size

YAML_LIMIT = 5_000_000  # bytes; a session of an hour has 20,000
_DEPTH = 20
_TOO_DEEP = f"Nested deeper than {_DEPTH} levels.", "Give a simpler file."
_NODES = 60_000  # 2,500 readings with every field; read in half a second
_NULLS = ("", "~", "null", "Null", "NULL")


def load_tree(file: FileText) -> Content:
    """Parse a file without resolving anything.

    Work and memory are bounded by the size limit: aliases, anchors and tags are refused, as are
    more than 20 levels or 60,000 nodes, before what follows them is looked at. Raises InputError:
    not YAML, or something refused, with its line.
    """
    check_size(len(file.data), file.path, YAML_LIMIT)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    events: Iterator[Any] = yaml.parse(file.text, Loader=loader)
    tree, nodes, documents = Content(file), count(1), 0

    def check(event: yaml.NodeEvent, path: Steps, line: int) -> None:
        tag, text = getattr(event, "tag", None), getattr(event, "value", "")
        refused = (
            (event.anchor, "Anchors and aliases are not accepted.", "Write the value out."),
            (tag != "!" and tag, "Tags are not accepted.", "Remove the tag."),
            (CONTROL.search(text) and text, "The text holds a control character.", "Remove it."),
            (next(nodes) > _NODES, f"More than {_NODES} values.", "Give a smaller file."),
            (len(path) > _DEPTH, *_TOO_DEEP),
        )
        for wrong, fault, remedy in refused:
            if wrong:
                value, column = wrong if isinstance(wrong, str) else None, dotted(path) or None
                raise InputError(
                    fault, remedy, file=file.path, line=line, column=column, value=value
                )

    def read(event: yaml.NodeEvent, path: Steps, line: int) -> object:
        """The value of the node that begins with an event."""
        check(event, path, line)
        tree.lines[path] = line
        if isinstance(event, yaml.ScalarEvent):
            return None if not event.style and event.value in _NULLS else event.value
        items: list[object] = []
        group: dict[str, object] = {}
        for inner in events:
            line = inner.start_mark.line + 1
            if isinstance(inner, yaml.CollectionEndEvent):
                break
            if isinstance(event, yaml.SequenceStartEvent):
                items.append(read(inner, (*path, len(items)), line))
                continue
            check(inner, path, line)
            if not isinstance(inner, yaml.ScalarEvent) or (
                not inner.style and inner.value in _NULLS
            ):
                fault, remedy = "A key must be a word.", "Write `name: value`."
                raise InputError(fault, remedy, file=file.path, line=line)
            key = (*path, inner.value)
            first, value = tree.lines.get(key), read(next(events), key, line)
            if inner.value in group:
                fault = f"The key is given twice (first in line {first})."
                text = value if isinstance(value, str) else None
                tree.add(fault, "Remove one of them.", line, dotted(key), text)
            group.setdefault(inner.value, value)
        return items if isinstance(event, yaml.SequenceStartEvent) else group

    try:
        for event in events:
            line = event.start_mark.line + 1
            documents += isinstance(event, yaml.DocumentStartEvent)
            if documents > 1:
                fault = "The file holds several documents."
                raise InputError(fault, "Remove the `---`.", file=file.path, line=line)
            if isinstance(event, yaml.NodeEvent):
                tree.value = read(event, (), line)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        problem = getattr(error, "problem", None)
        remedy = "Check indentation, colons and quotes."
        if problem is None:
            problem, remedy = "a character is not allowed", "Save it as plain UTF-8 text."
        line = mark.line + 1 if mark else None
        blanks = "".join(file.text.splitlines()[line - 1 : line]) if line else ""
        if "\t" in blanks[: len(blanks) - len(blanks.lstrip())]:
            problem, remedy = "a tab in the indentation", "Indent with spaces, not tabs."
        fault = f"This is not valid YAML: {problem}."
        if "nesting depth" in problem:  # a limit of the parser, which looks ahead
            fault, remedy = _TOO_DEEP
        raise InputError(fault, remedy, file=file.path, line=line) from error
    return tree


def yaml_text(value: object, width: int = 1000) -> str:
    """YAML of plain values, in the order given, as `load_tree` reads it back.

    Groups of numbers go on in the next line behind `width` characters.
    """
    # What occurs twice becomes two values: YAML would write an alias, which `load_tree` refuses.
    apart = json.loads(json.dumps(value))
    written: str = yaml.dump(
        apart,
        Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper),
        default_flow_style=None,
        sort_keys=False,
        allow_unicode=True,
        width=width,
    )
    return written


class Verbatim(str):
    """A value as it stands in a file, where 0 and 0.0 are not the same."""


def edited(text: str, changes: Mapping[Steps, object], remark: str = "") -> str:
    """The text of a YAML file with other values at some paths; every other byte stays.

    `edited("a: 1  # one\\n", {("a",): 2, ("b",): []})` is `"a: 2  # one\\nb: []\\n"`.

    Args:
        text: of a file that `load_tree` reads, with a group at its top.
        changes: path → plain value, or `Verbatim`; None takes an entry out. A value takes the place
            of the old one as a whole. A new entry comes last, but for `complete`.
        remark: behind the first line of a new entry.
    """
    for path, value in changes.items():
        text = _changed(text, path, value, remark)
    return text


def _changed(text: str, path: Steps, value: object, remark: str) -> str:
    holder: yaml.Node | None = None  # key of the group
    group = yaml.compose(text, Loader=yaml.SafeLoader)
    for step in path[:-1]:
        holder, group = _entries(group)[step]
    assert group is not None
    entries, step = _entries(group), path[-1]
    entry = {step: value} if isinstance(step, str) else [value]
    if step in entries and value is not None:
        return _replaced(text, *entries[step], value)
    if holder and len(entries) == (step in entries):
        return _replaced(text, holder, group, [] if entries else entry)
    if step in entries:
        key, node = entries[step]
        start, end = key.start_mark.index, _end(node)
        if _is_block(group):  # with the line end before it: the last line may have none
            return text[: text.rfind("\n", 0, start)] + text[_line_end(text, end) :]
        return text[: text.rfind(",", 0, start)] + text[end:]
    end = _end([node for name, (_, node) in entries.items() if name != "complete"][-1])
    if not _is_block(group):
        return f"{text[:end]}, {json.dumps(entry)[1:-1]}{text[end:]}"
    lines = f"{step}:{_written(value)}" if isinstance(step, str) else yaml_text(entry)
    end, (line, *more) = _line_end(text, end), lines.splitlines()
    margin = "\n" + " " * group.start_mark.column
    return margin.join((text[:end], line + remark, *more)) + text[end:]


def _replaced(text: str, key: yaml.Node, node: yaml.Node, value: object) -> str:
    """With another value behind a key, or on the lines below it, whatever its form was."""
    new = _written(value).replace("\n", "\n" + " " * key.start_mark.column)
    colon, start, end = text.index(":", key.end_mark.index) + 1, node.start_mark.index, _end(node)
    behind = text[end : _line_end(text, end)]  # a remark
    if _is_block(node):
        behind, start = text[colon : _line_end(text, colon)], colon
    rest = text[_line_end(text, end) :]
    if new.startswith("\n"):
        return text[:colon] + behind + new + rest
    return text[:colon] + (text[colon:start] or " ") + new.removeprefix(" ") + behind + rest


def _entries(node: yaml.Node | None) -> dict[str | int, tuple[yaml.Node, yaml.Node]]:
    """Key and value of each entry of a group; an item of a list stands for both."""
    if isinstance(node, yaml.MappingNode):
        return {key.value: (key, value) for key, value in node.value}
    items = node.value if isinstance(node, yaml.SequenceNode) else ()
    return {index: (item, item) for index, item in enumerate(items)}


def _is_block(node: yaml.Node) -> bool:
    return isinstance(node, yaml.CollectionNode) and not node.flow_style


def _end(node: yaml.Node) -> int:
    """Where the node's own text ends; the parser counts what follows a block to it."""
    if not _is_block(node):
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(last, tuple) else last)


def _line_end(text: str, at: int) -> int:
    """Where the line ends, without its line end."""
    end = text.find("\n", at)
    return len(text) if end < 0 else end


def _written(value: object) -> str:
    """A value as it stands behind `key:`, or on the lines below."""
    if isinstance(value, Verbatim):
        return f" {value}"
    # The list keeps the dumper from writing a group of nothing but scalars in braces.
    return yaml_text({"_": value, "__": []}).removeprefix("_:").removesuffix("\n__: []\n")
