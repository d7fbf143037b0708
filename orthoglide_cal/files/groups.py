"""Values by groups of checked keys."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import Any, TypeVar

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Steps as Path
from orthoglide_cal.files.faults import dotted, nearest
from orthoglide_cal.files.yaml_tree import Tree
from orthoglide_cal.schema import parse_count, yaml_number

T = TypeVar("T")
_MISSING: Any = object()


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
        line = self.tree.place(path).line
        self.tree.faults.add(what, remedy, line=line, column=dotted(path), value=shown)


def number(value: Any) -> float:
    """A plain number."""
    return float(yaml_number(value))


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
