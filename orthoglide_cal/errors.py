"""Every error the package raises on purpose, and how messages write foreign text and commands.

An error carries its data as fields; only the command line turns it into text and an exit code.
"""

import re
import shlex
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar

from orthoglide_cal.words import listed, shortened

_INDEX, _NUMBER = re.compile(r"\[[0-9]+\]"), re.compile(r"[0-9]+")
# Kinds of faults that one screen has room for: a fault takes up to three lines.
_MOST_KINDS = 6

# Control characters, halves of pairs, private ones, and those that change the direction of what
# follows: U+202E turns "exe.csv" around.
_HIDDEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\uf8ff\ufeff"
    "\U000e0000-\U000e00ff\U000e01f0-\U0010ffff]"
)


def visible(text: str) -> str:
    """The text on one line, with control and direction characters as codes: "⟨U+202E⟩"."""
    if text.isprintable():
        return text
    return _HIDDEN.sub(lambda sign: f"⟨U+{ord(sign[0]):04X}⟩", re.sub(r"[\n\t\r]", " ", text))


def visible_lines(text: str) -> str:
    """The same of several lines, which stay lines."""
    return "\n".join(visible(line) for line in text.split("\n"))


def command(verb: str, *paths: str, options: str = "", **named: object) -> str:
    """A command to type, with the files as the user gave them.

    `options` are as they are typed; `named` ones have a file, numbers, or True; None, False: none.

    >>> command("diagnose", "my data.csv", options="--accept axis_gap", together=True)
    "orthocal diagnose 'my data.csv' --together --accept axis_gap"
    """
    given = [
        f"--{name}" if value is True else f"--{name} {_typed(value)}"
        for name, value in named.items()
        if value is not None and value is not False
    ]
    return " ".join(("orthocal", verb, *map(_typed, paths), *given, *filter(None, [options])))


def _typed(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_typed, value))
    if isinstance(value, float):
        return f"{value:g}"
    # Standard input has to be a file by then; a leading dash would be taken for an option.
    path = "FILE" if value == "-" else str(value)
    return shlex.quote(f"./{path}" if path.startswith("-") else path)


def file_words(path: str) -> str:
    """A file as a person calls it."""
    return "standard input" if path == "-" else path


def system_words(error: object) -> str:
    """Words of the system for an error, without its number."""
    return getattr(error, "strerror", None) or str(error)


@dataclass(eq=False, repr=False)
class OrthocalError(Exception):
    """Base of all errors."""

    what: str  # what is wrong, one sentence
    remedy: str = ""  # how to fix it, one sentence; empty when there is nothing to add

    exit_code: ClassVar[int] = 1  # the process's exit status for it

    def __str__(self) -> str:
        return f"{self.what} {self.remedy}".strip()


class UsageError(OrthocalError):
    """The command line asks for something that does not exist or does not go together."""

    exit_code = 2


@dataclass(eq=False, repr=False)
class InputError(OrthocalError, ValueError):
    """A file, or a value in it, cannot be used; the first fault of a file brings the others.

    It is a ValueError for pydantic, which adds the path of what a validator refuses.
    """

    _: KW_ONLY
    file: str | None = None  # path as the user gave it
    line: int | None = None  # in the file, from 1
    column: str | None = None  # header (CSV), dotted path (YAML), or section and option (INI)
    of_table: bool = False  # only a table's is called a column
    value: str | None = None  # the offending text, shortened
    problems: "tuple[InputError, ...]" = ()  # all faults of the file, this one as well

    exit_code = 3

    def __post_init__(self) -> None:
        self.value = shortened(self.value) if self.value else self.value
        self.problems = self.problems or (self,)

    @classmethod
    def of(cls, problems: "Sequence[InputError]") -> "InputError":
        """All of them, at least one, as one error."""
        error = replace(problems[0], problems=())
        error.problems = (error, *problems[1:])
        return error

    @property
    def place(self) -> str:
        """`line 7, column posture`, or `line 12, [JOINT_0] HOME_OFFSET`; empty if unknown."""
        line = f"line {self.line}" if self.line is not None else ""
        column = f"{'column ' * self.of_table}{self.column}" if self.column is not None else ""
        return ", ".join(filter(None, (line, column)))

    @property
    def where(self) -> str:
        """The same behind the file."""
        file = file_words(self.file) if self.file is not None else ""
        return ", ".join(filter(None, (file, self.place)))

    @property
    def alone(self) -> str:
        """The fault without the others of its file."""
        value = f" ({self.value!r})" if self.value is not None else ""
        where = f"{self.where}: " if self.where else ""
        return f"{where}{self.what}{value} {self.remedy}".strip()

    def __str__(self) -> str:
        kinds, others = fault_kinds(self.problems)
        return "\n".join((*(f"{fault.alone} {often}".strip() for fault, often in kinds), *others))


def fault_kinds(faults: Sequence[InputError]) -> tuple[list[tuple[InputError, str]], list[str]]:
    """The first fault of each kind with how many there are; then, how many are left out.

    Those of one kind differ in numbers only.
    """
    kinds: dict[str, list[InputError]] = {}
    for fault in faults:
        kinds.setdefault(_NUMBER.sub("", f"{fault.what} {fault.remedy}"), []).append(fault)
    shown = []
    for first, *more in list(kinds.values())[:_MOST_KINDS]:
        places = dict.fromkeys(_INDEX.sub("[]", fault.column or "") for fault in (first, *more))
        also = f"; also in {listed([*places][1:])}" if len(places) > 1 else ""
        often = f"The first of {len(more) + 1} such faults{also}." if more else ""
        shown.append((first, often))
    others = sum(map(len, list(kinds.values())[_MOST_KINDS:]))
    return shown, [f"And {others} other faults: correct these first."] * bool(others)


class PostureError(InputError):
    """A posture that the machine cannot take, or where it is singular."""


class UnusableResultError(OrthocalError):
    """A result that must not be used; there is no number to print."""

    exit_code = 4
