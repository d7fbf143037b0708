"""YAML to a tree of dicts, lists and strings, to values by groups of checked keys; and back.

Hostile text is refused. Scalars stay text (None for null): what is a number is decided by the
field that wants one, not by YAML's guesses (`1e-3` a text, `012` ten, `1:30` ninety, `on` true).
Each key is asked for with the rule that its value must obey. A rule makes a value, or raises
InputError with what is wrong and the remedy; that is noted with line and dotted path, and reading
goes on, so that all faults of a file are found at once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import yaml

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import (
    YAML_LIMIT,
    Document,
    Faults,
    check_size,
    has_control,
    nearest,
    parse_count,
    parse_yaml_number,
)

T = TypeVar("T")
Path = tuple[str | int, ...]

_DEPTH = 20
_NODES = 60_000  # 2,500 readings with every field; read in half a second
_NULLS = ("", "~", "null", "Null", "NULL")
_MISSING: Any = object()
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
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).lstrip(".")


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


class Group:
    """The keys at one place of a YAML file.

    What is wrong is noted in the tree's faults, never raised; what cannot be read becomes None.
    So nothing may be made of the values unless the group is `sound` in the end.

    Args:
        tree: the file.
        path: place of the group.
        content: what stands there; anything but a group is a fault.

    Attributes:
        content: key → value as `Tree` has it; empty if there is no group.
    """

    def __init__(self, tree: Tree, path: Path, content: Any) -> None:
        self.tree = tree
        self.path = path
        self.content: dict[str, Any] = content if isinstance(content, dict) else {}
        self._there = isinstance(content, dict)
        self._asked: dict[str, None] = {}
        self._before = tree.faults.count
        if not self._there and content is not _MISSING:
            what = "A group of keys is wanted here."
            self._note(path, what, "Write `name: value` lines, indented.", content)

    @property
    def sound(self) -> bool:
        """Whether there is a group and nothing wrong was found since it was opened."""
        return self._there and self.tree.faults.count == self._before

    def take(self, key: str, rule: Callable[[Any], Any], default: Any = _MISSING) -> Any:
        """The value that a rule makes of a key's.

        Args:
            key: name; known from now on.
            rule: from what stands there to a value.
            default: for a missing key, which is a fault without it. Where it is None the key may
                be null, too.
        """
        value = self._ask(key, required=default is _MISSING)
        if value is _MISSING:
            return None if default is _MISSING else default
        if value is None and default is None:
            return None
        return self._read((*self.path, key), value, rule)

    def group(self, key: str, *, required: bool = True) -> Group:
        """The group under a key; an empty one for none, which is a fault if it is required."""
        value = self._ask(key, required)
        if not required and (value is None or value is _MISSING):
            value = {}
        return Group(self.tree, (*self.path, key), value)

    def groups(self, key: str) -> Iterator[Group]:
        """The groups in the list under a key, one after the other; none for missing or null."""
        value, path = self._ask(key, required=False), (*self.path, key)
        items = [] if value is None or value is _MISSING else self._list(path, value)
        for index, item in enumerate(items):
            yield Group(self.tree, (*path, index), item)

    def numbers(self, key: str, wanted: int) -> tuple[float, ...] | None:
        """The numbers in the list under a key; None unless there are as many as wanted."""
        value, path = self._ask(key, required=True), (*self.path, key)
        if value is _MISSING:
            return None
        found = self._numbers(path, value)
        if isinstance(value, list) and len(value) > wanted:
            self._note(path, "The list has too many entries.", "Remove some.")
        elif isinstance(value, list) and len(value) < wanted:
            self._note((*path, len(value)), "The list is too short.", "Add an entry.")
        return found if len(found) == wanted else None

    def rows(self, key: str) -> tuple[tuple[float, ...], ...]:
        """The lists of numbers in the list under a key; none where it is missing."""
        value, path = self._ask(key, required=False), (*self.path, key)
        if value is _MISSING:
            return ()
        lists = enumerate(self._list(path, value))
        return tuple(self._numbers((*path, k), item) for k, item in lists)

    def names(self, rule: Callable[[Any], str]) -> list[str]:
        """The group's keys, where the file chooses them; those that break the rule are faults."""
        self._asked |= dict.fromkeys(self.content)
        read = (self._read((*self.path, key), key, rule) for key in self.content)
        return [name for name in read if name is not None]

    def refuse_unknown(self) -> None:
        """Note the keys that nobody has asked for."""
        known = f"Known here: {', '.join(self._asked)}."
        for key in self.content:
            if key not in self._asked:
                self.note("The key is not known.", nearest(key, self._asked) + known, key)

    def note(self, what: str, remedy: str, *inner: str | int) -> None:
        """Note a fault at `inner`, a path inside the group, with the value there."""
        value: Any = self.content
        for part in inner:
            value = value[part]
        self._note((*self.path, *inner), what, remedy, value)

    def _ask(self, key: str, required: bool) -> Any:
        self._asked[key] = None
        if required and self._there and key not in self.content:
            self._note((*self.path, key), "The key is missing.", f"Add a line `{key}: …`.")
        return self.content.get(key, _MISSING)

    def _list(self, path: Path, value: Any) -> list[Any]:
        if isinstance(value, list):
            return value
        what, remedy = "A list is wanted here.", "Write [first, second] or `- …` lines."
        self._note(path, what, remedy, value)
        return []

    def _numbers(self, path: Path, value: Any) -> tuple[float, ...]:
        items = enumerate(self._list(path, value))
        read = (self._read((*path, k), item, number) for k, item in items)
        return tuple(item for item in read if item is not None)

    def _read(self, path: Path, value: Any, rule: Callable[[Any], T]) -> T | None:
        try:
            return rule(value)
        except InputError as error:
            self._note(path, error.what, error.remedy, value)
            return None

    def _note(self, path: Path, what: str, remedy: str, value: Any = None) -> None:
        shown = value if isinstance(value, str) else None
        line = self.tree.line(path)
        self.tree.faults.add(what, remedy, line=line, column=dotted(path), value=shown)


def number(value: Any) -> float:
    """A plain number."""
    if not isinstance(value, str):
        raise InputError("A number is wanted here.", "Write a plain number such as 310.25.")
    return parse_yaml_number(value)


def positive(value: Any) -> float:
    """A number above zero."""
    size = number(value)
    if size <= 0.0:
        raise InputError("The number must be greater than zero.", "Give its size.")
    return size


def not_negative(value: Any) -> float:
    """A number from zero."""
    size = number(value)
    if size < 0.0:
        raise InputError("The number must not be negative.", "Give zero or more.")
    return size


def between(
    least: float, most: float, rule: Callable[[Any], float] = number
) -> Callable[[Any], float]:
    """The rule for a number that makes sense: another one is a slip, or in the wrong unit."""

    def sensible(value: Any) -> float:
        size = rule(value)
        if not least <= size <= most:
            raise InputError(
                f"The number must be from {least:g} to {most:g}.",
                "Check its digits and its unit; lengths are in mm.",
            )
        return size

    return sensible


def count(value: Any) -> int:
    """A whole number from 1."""
    return parse_count(value if isinstance(value, str) else "", 1)


def text(value: Any) -> str:
    """Any text, also none."""
    if not isinstance(value, str):
        raise InputError("A text is wanted here.", "Write a word or put the text in quotes.")
    return value


def word(value: Any) -> str:
    """A text that says something."""
    if not text(value).strip():
        raise InputError("The text is empty.", "Write a word or put the text in quotes.")
    return text(value)


def one_of(known: Collection[str], what: str) -> Callable[[Any], str]:
    """The rule for one of the known words; `what` is wrong with any other."""

    def rule(value: Any) -> str:
        if text(value) not in known:
            raise InputError(what, f"{nearest(value, known)}Known: {', '.join(known)}.")
        return text(value)

    return rule


def version(value: Any) -> int:
    """The version of the file format."""
    if value != "1":
        raise InputError(
            "This version of the file format is not known.",
            "Write 1, or use the orthocal that wrote the file.",
        )
    return 1


def yaml_text(value: Any) -> str:
    """YAML of plain values, in the order given, as `load_tree` reads it back."""
    options: dict[str, Any] = {"allow_unicode": True, "width": 1000, "default_flow_style": None}
    written: str = yaml.dump(value, Dumper=_Dumper, sort_keys=False, **options)
    return written


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
                top.key = None
                if not top.skip:
                    what = f"The key stands twice (first in line {self.lines[path]})."
                    at, given = dotted(path), value if isinstance(value, str) else None
                    self.faults.add(what, "Remove one of them.", line=line, column=at, value=given)
                return path, True
            top.content[top.key] = value
            top.key = None
        if not top.skip:
            self.lines[path] = line
        return path, top.skip

    def error(self, event: Any, what: str, remedy: str, value: str | None = None) -> InputError:
        line, column = event.start_mark.line + 1, dotted(self.stack[-1].path) if self.stack else ""
        file = self.document.path
        return InputError(what, remedy, file=file, line=line, column=column or None, value=value)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes a value that occurs twice twice; `load_tree` refuses aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True
