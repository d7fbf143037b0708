"""Lines of Klipper's printer.cfg to the options in force, each with its line.

A value goes on in lines that are indented more than its option. "#" begins a remark anywhere, ";"
after a blank. The file's own lines win over those that SAVE_CONFIG wrote ("#*# …"), as in Klipper.
Sections that do not matter may hold anything; nothing in them is interpreted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Faults
from orthoglide_cal.files.text import FileText
from orthoglide_cal.schema import parse_count, parse_number, shortened

T = TypeVar("T")

SAVED = "#*#"
_SECTION = re.compile(r"\[(.+)\]")  # what follows the bracket is passed over
_OPTION = re.compile(r"([^:=]+?)\s*[:=]\s*(.*)")
_COMMENT = re.compile(r"#.*$|(?:^|(?<=\s));.*$")

_MOST = 1000  # steps of a turn, points of a mesh along one axis
LARGEST_MM = 10_000.0


@dataclass(frozen=True)
class Value:
    """The value of an option: (line in the file, text), without empty lines."""

    line: int
    texts: tuple[tuple[int, str], ...]

    @property
    def text(self) -> str:
        return " ".join(text for _, text in self.texts)


class Settings:
    """The options in force; what is wrong with one is noted, never raised.

    Args:
        document: the file.
        matters: gives something true for the name of a section that is needed.

    Attributes:
        sections: name → line.
        options: (section, option) → value.
        included: whether it includes other files, which are not read.
        remarks: options that SAVE_CONFIG wrote in vain.
    """

    def __init__(self, document: FileText, matters: Callable[[str], object]) -> None:
        self.faults = Faults(document.path)
        lines = list(enumerate(document.text.split("\n"), start=1))
        written = [(line, text[len(SAVED) :]) for line, text in lines if text.startswith(SAVED)]
        typed = [(line, text) for line, text in lines if not text.startswith(SAVED)]
        own_sections, own = self._parsed(typed, matters)
        saved_sections, saved = self._parsed(written, matters)
        self.sections: Mapping[str, int] = {**saved_sections, **own_sections}
        self.options: Mapping[tuple[str, str], Value] = {**saved, **own}
        self.included = any(name.startswith("include ") for name in own_sections)
        self._cut_off = not saved_sections
        self.remarks = [
            f"Line {value.line}, {key[1]} of [{key[0]}], which SAVE_CONFIG wrote, is not in"
            f" force: line {own[key].line} says otherwise, and Klipper obeys that one."
            " Delete one of the two."
            for key, value in saved.items()
            if key in own and own[key].text != value.text and matters(key[0])
        ]

    def _parsed(
        self, lines: Iterable[tuple[int, str]], matters: Callable[[str], object]
    ) -> tuple[dict[str, int], dict[tuple[str, str], Value]]:
        """Sections and options of the file's own lines, or of those that SAVE_CONFIG wrote."""
        sections: dict[str, int] = {}
        options: dict[tuple[str, str], Value] = {}
        section, option, indented = "", "", 0  # no option where none can go on
        for line, raw in lines:
            text = _COMMENT.sub("", raw).rstrip()
            plain = text.lstrip()
            indent = len(text) - len(plain)
            if not plain:
                continue
            if option and indent > indented:
                value = options[section, option]
                options[section, option] = Value(value.line, (*value.texts, (line, plain)))
                continue
            option, indented = "", indent
            if header := _SECTION.match(plain):
                section = header[1].strip()
                sections.setdefault(section, line)
            elif plain.startswith("["):
                section = ""
                what = "The section's name has no closing bracket."
                self.faults.add(what, "Write [name].", line=line, value=shortened(plain))
            elif setting := _OPTION.match(plain):
                option = setting[1].lower()
                texts = ((line, setting[2]),) if setting[2] else ()
                options[section, option] = Value(line, texts)
            elif matters(section):
                what = f"The line in [{section}] is not an option."
                remedy = "Write “option: value”, or “#” in front of a remark."
                self.faults.add(what, remedy, line=line, value=shortened(plain))
        return sections, options

    def options_of(self, section: str) -> dict[str, Value]:
        """Option → value of one section."""
        return {option: value for (name, option), value in self.options.items() if name == section}

    def note(
        self, section: str, option: str, what: str, remedy: str, line: int = 0, text: str = ""
    ) -> None:
        """A fault in the value of an option, or in the text in one of its lines."""
        value = self.options[section, option]
        said = shortened(text if line else value.text) or None
        column = f"{option} of [{section}]"
        self.faults.add(what, remedy, line=line or value.line, column=column, value=said)

    def missing(self, section: str, option: str, line: int | None = None) -> None:
        """The fault that an option is not there."""
        remedy = f"Add “{option}: …” to [{section}]."
        if self.included:
            remedy = f"Copy [{section}] from the included file into this one."
        if self._cut_off:
            remedy += " Or was the file cut off? The block that SAVE_CONFIG writes is missing."
        column = f"{option} of [{section}]"
        line = line or self.sections.get(section)
        self.faults.add("The option is missing.", remedy, line=line, column=column)

    def read(
        self, section: str, option: str, rule: Callable[[str], T], fault: T, default: T | None
    ) -> T:
        """What a rule makes of an option.

        Args:
            rule: text to value; raises InputError.
            fault: for an option that breaks the rule.
            default: for one that is not there; None if it must be.
        """
        value = self.options.get((section, option))
        if value is None:
            if default is not None:
                return default
            self.missing(section, option)
            return fault
        try:
            return rule(value.text)
        except InputError as error:
            self.note(section, option, error.what, error.remedy)
            return fault

    def number(
        self, section: str, option: str, default: float | None = None, low: float = -LARGEST_MM
    ) -> float:
        """A number above `low`; NaN if it is wrong."""
        return self.read(section, option, lambda text: within(text, low), math.nan, default)

    def count(self, section: str, option: str, default: int | None = None) -> int:
        """A whole number from 1; 0 if it is wrong."""
        return self.read(section, option, _count, 0, default)


def within(text: str, low: float, high: float = LARGEST_MM) -> float:
    """The number that a text writes, between the two. Raises InputError without a place."""
    value = parse_number(text)
    if not low < value < high:
        raise InputError(f"The number is outside {low:g} … {high:g}.", "Check it.", value=text)
    return value


def _count(text: str) -> int:
    value = parse_count(text, 1)
    if value > _MOST:
        raise InputError(f"The number is larger than {_MOST}.", "Check it.")
    return value
