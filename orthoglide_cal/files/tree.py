"""Content of a file as a tree with the line of each node; YAML to one; and all that is wrong in it.

Scalars stay text (None for null): what is a number is decided by the schema that wants one, not by
YAML's guesses (`1e-3` a text, `012` ten, `1:30` ninety, `on` true).
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from functools import partial
from itertools import chain, count
from typing import Any, get_args, get_type_hints

import yaml
from pydantic import BaseModel, ValidationError

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import CONTROL, FileText, check_size
from orthoglide_cal.schema import Reason, parse_number, yaml_number

Steps = tuple[str | int, ...]
# Where a fault is: line from 1, column header or dotted path, and the text there.
Place = tuple[int | None, str | None, str | None]
Words = Mapping[str, tuple[str, str]]  # kind of fault → what is wrong and the remedy
_MOST = 1000  # faults; a file of garbage has millions, and nobody reads them
_FIRST = "Correct the first ones and try again."
_NUMBER = "Check its digits and its unit{mm}."

# By the type of pydantic's error; {…} are its values, the last key of the path, and the words that
# are known there.
WORDS: Words = {
    "missing": ("The key is missing.", "Add a line `{key}: …`."),
    "too_short": ("The list is too short.", "Add an entry."),
    "too_long": ("The list has too many entries.", "Remove some."),
    "extra_forbidden": ("The key is not known.", "{near}Known here: {known}."),
    "model_type": ("This must be a group of keys.", "Write `name: value` lines, indented."),
    "list_type": ("This must be a list.", "Write [first, second] or `- …` lines."),
    "number_type": ("This must be a number.", "Write a plain number such as 310.25."),
    "string_type": ("This must be one value, as text.", "Write a word or put the text in quotes."),
    "literal_error": ("This {key} is not known.", "{near}Known: {known}."),
    "greater_than": ("The number must be greater than {gt:g}.", _NUMBER),
    "greater_than_zero": ("The number must be greater than zero.", "Give its size."),
    "greater_than_equal": ("The number must be at least {ge:g}.", _NUMBER),
    "not_negative": ("The number must not be negative.", "Give zero or more."),
    "less_than": ("The number must be less than {lt:g}.", _NUMBER),
    "less_than_equal": ("The number must be at most {le:g}.", _NUMBER),
}
_ALSO = {  # also said of
    "tuple_type": "list_type",
    "named_tuple_type": "model_type",
    "float_type": "number_type",
    "enum": "literal_error",
    "dict_type": "model_type",
    # Of named tuples, by pydantic before 2.14.
    "missing_argument": "missing",
    "unexpected_keyword_argument": "extra_forbidden",
    "arguments_type": "model_type",
}
_QUOTED = re.compile("'([^']*)'")
_STEP = re.compile(r"\[([0-9]+)\]|([^.\[\]]+)")


class Content:
    """The content of a file as dicts, lists and texts, with the lines of them, and its faults."""

    of_table = False

    def __init__(self, document: FileText) -> None:
        self.document, self.file = document, document.path
        self.problems: list[InputError] = []  # in the order found
        self.value: Any = None  # dict, list, str or None, nested
        self.lines: dict[Steps, int] = {}  # of each node, from 1

    def add(
        self,
        fault: str,
        remedy: str,
        line: int | None = None,
        column: str | None = None,
        value: str | None = None,
    ) -> None:
        """Note one fault at its place. Raises InputError if there are too many."""
        if len(self.problems) == _MOST:
            rest = InputError("There are more faults like these.", _FIRST, file=self.file)
            raise InputError.of((*self.error().problems, rest))
        problem = InputError(fault, remedy, file=self.file, line=line, column=column, value=value)
        problem.of_table = self.of_table
        self.problems.append(problem)

    @contextmanager
    def noting(
        self, line: int | None, column: str | None = None, value: str | None = None
    ) -> Iterator[None]:
        """Note what is raised inside about a text of a line."""
        try:
            yield
        except InputError as error:
            self.add(error.what, error.remedy, line, column, value or None)

    def error(self) -> InputError:
        """All faults, at least one, by line."""
        return InputError.of(sorted(self.problems, key=lambda fault: fault.line or 0))

    def check(self) -> None:
        """Raise `error()` if there are any faults."""
        if self.problems:
            raise self.error()

    def at(self, path: Steps) -> Any:
        """The node at `path`; None where there is none."""
        value = self.value
        with suppress(KeyError, IndexError, TypeError):
            for step in path:
                value = value[step]
            return value
        return None

    def place(self, path: Steps) -> Place:
        """Place where the node at `path` stands; of one that is missing, where its parent does."""
        there = path
        while there and there not in self.lines:
            there = there[:-1]
        text = self.at(path) if there == path else None
        return self.lines.get(there, 1), dotted(path), text if isinstance(text, str) else None

    def note(self, path: Steps, fault: str, remedy: str, value: str | None = None) -> None:
        """Note a fault of the node at `path`; `value` instead of the text there."""
        line, column, text = self.place(path)
        self.add(fault, remedy, line, column, value or text)

    def take(
        self,
        error: ValidationError,
        schema: object,
        at: Steps = (),
        words: Mapping[str, tuple[str, str]] = {},
    ) -> None:
        """Note all that pydantic found in what stands at a path, and was checked by a schema.

        `words`, by kind and key ("missing posture"), go before those for all files.
        """
        for finding in error.errors(include_url=False):
            path, given = finding["loc"], finding.get("ctx", {})
            if isinstance(cause := given.get("error"), InputError):
                for problem in cause.problems:
                    inner = _STEP.findall(problem.column or "")
                    steps = (int(index) if index else name for index, name in inner)
                    self.note((*at, *path, *steps), problem.what, problem.remedy, problem.value)
                continue
            kind, meant = _ALSO.get(finding["type"], finding["type"]), str(finding["input"])
            known = _QUOTED.findall(given.get("expected", ""))
            if kind == "extra_forbidden":
                meant, fields = str(path[-1]), _fields(schema)
                for step in path[:-1]:  # a place in a list has no name of its own
                    fields = _fields(fields[step]) if step in fields else fields
                known = list(fields)
            elif kind == "missing" and isinstance(path[-1], int):
                kind = "too_short"
            elif kind.startswith("greater_than") and (
                parse_number(meant, decimal_comma=True) <= 0.0 <= min(given.values())
            ):  # it has the wrong sign, or is zero
                kind = "not_negative" if given.get("ge") == 0 else "greater_than_zero"
            key = next((step for step in reversed(path) if isinstance(step, str)), "value")
            usual = WORDS.get(kind, (f"{finding['msg']}.", "Correct it."))
            mm = "; lengths are in mm" if key.endswith("_mm") else ""
            near, names = nearest(meant, known), ", ".join(known)
            data = {**given, "mm": mm, "key": key, "near": near, "known": names}
            fault, remedy = (text.format(**data) for text in words.get(f"{kind} {key}", usual))
            self.add(fault, remedy, *self.place((*at, *path)))

    def parse(self, text: str) -> float:
        """The number that a text of this file writes. Raises InputError without a place."""
        return yaml_number(text)


def dotted(path: Steps) -> str:
    """`("identified", 0, "cause")` as `identified[0].cause`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).lstrip(".")


def nearest(name: str, known: Iterable[str]) -> str:
    """The words "Did you mean …?" for the closest known name; empty if none is close."""
    close = get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"Did you mean {close[0]!r}? " if close else ""


def unused(kind: str, names: Iterable[str], known: Iterable[str]) -> list[Reason]:
    """A remark on names without a meaning and what they may stand for, if there are any."""
    given, words = [name for name in names if name], list(known)
    hints = "".join(nearest(name, words) for name in given[:10])
    return [Reason.of("unknown_names", kind=kind, names=given, hints=hints)] if given else []


def _fields(annotation: object) -> dict[str, object]:
    """Name → type of each field of the schemas and named tuples that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {name: field.annotation for name, field in annotation.model_fields.items()}
    if hasattr(annotation, "_fields"):
        return get_type_hints(annotation)
    return dict(chain.from_iterable(_fields(part).items() for part in get_args(annotation)))


# --- YAML ---------------------------------------------------------------------------------------

YAML_LIMIT = 5_000_000  # bytes; a session of an hour has 20,000
_DEPTH = 20
_TOO_DEEP = f"Nested deeper than {_DEPTH} levels.", "Give a simpler file."
_NODES = 60_000  # 2,500 readings with every field; read in half a second
_NULLS = ("", "~", "null", "Null", "NULL")


def load_tree(file: FileText) -> Content:
    """Parse a file without resolving anything.

    Aliases, anchors and tags are refused, as are more than 20 levels or 60,000 nodes, before what
    follows them is looked at. Raises InputError: not YAML, or something refused, with its line.
    """
    check_size(len(file.data), file.path, YAML_LIMIT)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    events: Iterator[Any] = yaml.parse(file.text, Loader=loader)
    tree, nodes = Content(file), count(1)

    def read(event: yaml.NodeEvent, path: Steps, line: int) -> object:
        """The value of the node that begins with an event; a key is at the path of its group."""
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
                value = wrong if isinstance(wrong, str) else None
                tree.add(fault, remedy, line, dotted(path) or None, value)
                raise tree.error()
        tree.lines.setdefault(path, line)
        if isinstance(event, yaml.ScalarEvent):
            return None if not event.style and event.value in _NULLS else event.value
        items, group = list[object](), dict[str, object]()
        for inner in events:
            line = inner.start_mark.line + 1
            if isinstance(inner, yaml.CollectionEndEvent):
                break
            if isinstance(event, yaml.SequenceStartEvent):
                items.append(read(inner, (*path, len(items)), line))
                continue
            collection = isinstance(inner, yaml.CollectionStartEvent)
            if collection or not isinstance(name := read(inner, path, line), str):
                tree.add("A key must be a word.", "Write `name: value`.", line)
                raise tree.error()
            node = read(next(events), key := (*path, name), line)
            if name in group:
                fault = f"The key is given twice (first in line {tree.lines[key]})."
                value = node if isinstance(node, str) else None
                tree.add(fault, "Remove one of them.", line, dotted(key), value)
            group.setdefault(name, node)
        return items if isinstance(event, yaml.SequenceStartEvent) else group

    try:
        for event in events:
            line = event.start_mark.line + 1
            if isinstance(event, yaml.DocumentStartEvent) and tree.lines:
                tree.add("The file holds several documents.", "Remove the `---`.", line)
                raise tree.error()
            if isinstance(event, yaml.NodeEvent):
                tree.value = read(event, (), line)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        problem = getattr(error, "problem", None)
        line = mark.line + 1 if mark else None
        remedy = "Check indentation, colons and quotes."
        if problem is None:
            problem, remedy = "a character is not allowed", "Save it as plain UTF-8 text."
        if line and re.match(r"\s*\t", "".join(file.text.splitlines()[line - 1 : line])):
            problem, remedy = "a tab in the indentation", "Indent with spaces, not tabs."
        fault = f"This is not valid YAML: {problem}."
        if "nesting depth" in problem:  # a limit of the parser, which looks ahead
            fault, remedy = _TOO_DEEP
        tree.add(fault, remedy, line)
        raise tree.error() from error
    return tree


def yaml_text(value: object, width: int = 1000) -> str:
    """YAML of plain values, as `load_tree` reads it; numbers go on in a next line after `width`."""
    # What occurs twice becomes two values: YAML would write an alias, which `load_tree` refuses.
    apart, dumper = json.loads(json.dumps(value)), getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    write = partial(yaml.dump, default_flow_style=None, sort_keys=False, allow_unicode=True)
    return str(write(apart, Dumper=dumper, width=width))
