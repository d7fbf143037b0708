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
from orthoglide_cal.files.text import CONTROL, YAML_LIMIT, FileText, check_size

_DEPTH = 20
_TOO_DEEP = f"Nested deeper than {_DEPTH} levels.", "Give a simpler file."
_NODES = 60_000  # 2,500 readings with every field; read in half a second
_NULLS = ("", "~", "null", "Null", "NULL")
# Characters [start, end) of a text, and what takes their place.
_Change = tuple[int, int, str]


def load_tree(file: FileText) -> Content:
    """Parse a file without resolving anything.

    Work and memory are bounded by the size limit: aliases, anchors and tags are refused, as are
    more than 20 levels or 60,000 nodes, before what follows them is looked at. Raises InputError:
    not YAML, or something refused, with its line.
    """
    check_size(file.size, file.path, YAML_LIMIT)
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
        for wrong, what, remedy in refused:
            if wrong:
                value, column = wrong if isinstance(wrong, str) else None, dotted(path) or None
                raise InputError(
                    what, remedy, file=file.path, line=line, column=column, value=value
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
                what, remedy = "A key must be a word.", "Write `name: value`."
                raise InputError(what, remedy, file=file.path, line=line)
            key = (*path, inner.value)
            first, value = tree.lines.get(key), read(next(events), key, line)
            if inner.value in group:
                what = f"The key is given twice (first in line {first})."
                text = value if isinstance(value, str) else None
                tree.add(what, "Remove one of them.", line, dotted(key), text)
            group.setdefault(inner.value, value)
        return items if isinstance(event, yaml.SequenceStartEvent) else group

    try:
        for event in events:
            line = event.start_mark.line + 1
            documents += isinstance(event, yaml.DocumentStartEvent)
            if documents > 1:
                what = "The file holds several documents."
                raise InputError(what, "Remove the `---`.", file=file.path, line=line)
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
        what = f"This is not valid YAML: {problem}."
        if "nesting depth" in problem:  # a limit of the parser, which looks ahead
            what, remedy = _TOO_DEEP
        raise InputError(what, remedy, file=file.path, line=line) from error
    return tree


def yaml_text(value: object) -> str:
    """YAML of plain values, in the order given, as `load_tree` reads it back."""
    # What occurs twice becomes two values: YAML would write an alias, which `load_tree` refuses.
    apart = json.loads(json.dumps(value))
    written: str = yaml.dump(
        apart,
        Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper),
        default_flow_style=None,
        sort_keys=False,
        allow_unicode=True,
        width=1000,
    )
    return written


def edited(text: str, values: Mapping[str, object]) -> str:
    """The text of a YAML file with other values.

    `edited("a: 1  # one\\n", {"a": 2, "b": []})` is `"a: 2  # one\\nb: []\\n"`.

    Args:
        text: of a file that `load_tree` reads, with a group at its top.
        values: key → plain value. A group whose keys are all there is changed key by key; any
            other value takes the place of the old one as a whole; a new key comes last.
    """
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    missing = {key: value for key, value in values.items() if _entry(root, key)[1] is None}
    for start, end, new in sorted(_changes(root, values, text), reverse=True):
        before, rest = text[:start], text[end:]
        if new.startswith("\n"):
            before = before.rstrip(" ")
        elif new and before.endswith(":"):
            new = f" {new}"
        blanks = len(rest) - len(rest.lstrip(" "))
        if rest[blanks : blanks + 1] == "#" and "\n" not in new:
            # A comment behind it stays in its column.
            longer = len(new) - (end - start)
            rest = " " * max(1, blanks - longer) + rest[blanks:]
        text = before + new + rest
    if not missing:
        return text
    return text.rstrip("\n") + "\n" + yaml_text(missing)


def _changes(group: yaml.Node | None, values: Mapping[str, object], text: str) -> Iterator[_Change]:
    for key, value in values.items():
        name, node = _entry(group, key)
        if name is None or node is None:
            continue
        start = node.start_mark.index
        line = text.rfind("\n", 0, start)
        if isinstance(value, Mapping) and value and all(_entry(node, inner)[1] for inner in value):
            yield from _changes(node, value, text)
        elif _is_block(node) and not text[line:start].strip(" \n"):
            # A block below its key: the new value stands behind the key, whatever its form.
            colon = text.index(":", name.end_mark.index) + 1
            yield colon, colon, _written(value)
            yield line, _end(node), ""
        else:
            yield start, _end(node), _written(value)


def _entry(group: yaml.Node | None, key: str) -> tuple[yaml.Node, yaml.Node] | tuple[None, None]:
    """The nodes of a key and its value; None where there is none."""
    entries = group.value if isinstance(group, yaml.MappingNode) else ()
    return next((entry for entry in entries if entry[0].value == key), (None, None))


def _is_block(node: yaml.Node) -> bool:
    return isinstance(node, yaml.CollectionNode) and not node.flow_style


def _end(node: yaml.Node) -> int:
    """Where the node's own text ends; the parser counts what follows a block to it."""
    if not _is_block(node):
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(last, tuple) else last)


def _written(value: object) -> str:
    """A value as it stands behind `key: `, or on the lines below."""
    # The list keeps the dumper from writing a group of nothing but scalars in braces.
    lines = yaml_text({"_": value, "__": []}).removeprefix("_:").removesuffix("\n__: []\n")
    return lines.removeprefix(" ")
