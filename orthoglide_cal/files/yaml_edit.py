"""Values of a YAML file changed where they stand: comments, order and blanks stay as they are.

A file that people keep is edited, never dumped again. Whoever edits one reads the result back,
because YAML has forms that nobody writes and this does not know.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import yaml

from orthoglide_cal.files.yaml_tree import yaml_text

# Characters [start, end) of a text, and what takes their place.
_Change = tuple[int, int, str]


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
        if before.endswith(":") and not new.startswith("\n"):
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
        if isinstance(value, Mapping) and all(_entry(node, inner)[1] for inner in value):
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
