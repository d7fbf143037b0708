"""Reasons, cautions, notes and remedies in words, which stand in `sentences.toml`.

That says what a sentence is made of. Where its grammar depends on the data it has a format here.
"""

import math
import string
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from itertools import chain
from typing import Any

import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.inference.result import FoundCause, FoundPattern
from orthoglide_cal.model.kinds import MACHINES
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    capitalized,
    chance,
    counted,
    listed,
    number,
    percent,
    plain,
    signed,
    together,
    two_figures,
    uncapitalized,
    unit_words,
    with_uncertainty,
)

_TEXTS = tomllib.loads(files("orthoglide_cal.report").joinpath("sentences.toml").read_text("utf-8"))
# Source of uncertainty, or "cause" → its name, and what would reduce it.
SOURCES: Mapping[str, Mapping[str, str]] = _TEXTS["sources"]
# Method of a solution → how it solves.
METHODS: Mapping[str, str] = _TEXTS["methods"]
# How a machine responded → that in a sentence, and what to do where it is wrong.
RESPONSES: Mapping[str, Mapping[str, str]] = _TEXTS["responses"]
# Format of an export → where its lines go, and what they lack; what begins a comment there.
FIRMWARES: Mapping[str, Mapping[str, str]] = _TEXTS["firmwares"]
# How readings deviate → what gauges do, {s} with one; the effect in one noun; what to do.
_PATTERNS: Mapping[str, Mapping[str, str]] = _TEXTS["patterns"]
# Readings that a gauge can hardly have shown → why, and what to do.
_DOUBTS: Mapping[str, Mapping[str, str]] = _TEXTS["doubts"]
_SENTENCES: Mapping[str, str] = {
    **_TEXTS["sentences"],
    **{code: " ".join(texts.values()) for code, texts in _DOUBTS.items()},
}
_OF_CAUSES = {"title", "check", "advice", "no_setting"}
# After so many time constants what settles has come to rest: 2 % are left.
RESTING = 4.0


@cache
def _cause(id: str, kind: str) -> Mapping[str, str]:
    """Words of a cause on a kind of machine: the title of its page, and what stands above that.

    Raises InputError: a key there is neither such a word nor a kind of machine.
    """
    path = f"guide/causes/{id}.md"
    _, above, below = (files("orthoglide_cal") / path).read_text("utf-8").split("---\n", 2)
    title, texts = below.strip().partition("\n")[0].partition(": ")[2], yaml.safe_load(above)
    of_kinds = {name: texts.pop(name, {}) for name in MACHINES}
    for name in {*texts}.union(*of_kinds.values()) - _OF_CAUSES:
        known = ", ".join(sorted({*_OF_CAUSES, *MACHINES}))
        raise InputError("The key is not known.", f"Known: {known}.", file=path, column=name)
    return {"title": title, **_TEXTS["causes"], **texts, **of_kinds[kind]}


def cause_title(machine: Machine, cause: FoundCause) -> str:
    """Name of a cause that was found; of wrong readings, with a parameter each, how many."""
    if CAUSES[cause.id].hides_reading and len(cause.parameters) > 1:
        return f"{len(cause.parameters)} readings are wrong"
    return cause_words(cause.id, machine)["title"]


def cause_words(id: str, machine: Machine, where: str = "") -> Mapping[str, str]:
    """Words of a cause at a place of such a machine: title, check, advice, no_setting."""
    return {name: text.format(where=where) for name, text in _cause(id, machine.kind).items()}


def where_words(machine: Machine, pattern: FoundPattern) -> str:
    """The gauges, or readings, that deviate."""
    where = pattern.where
    if "region" in where:
        return f"the touches at the {where['region']} of the bed"
    if "posture" in where:
        return f"the readings at {where['posture']}"
    if not where:
        return machine.vocabulary.everywhere
    place = f" of leg {where['leg']}" if "leg" in where else ""
    place += f" along {where['direction']}" if "direction" in where else ""
    return f"the gauge{'s' * (len(where) < 2)}{place}"


def pattern_words(machine: Machine, pattern: FoundPattern) -> str:
    """A pattern in words: the gauges that deviate, how, and by how much."""
    subject = where_words(machine, pattern)
    single = len(pattern.where) in (0, 2)
    verb = _PATTERNS[pattern.how]["verb"].format(s="s" * single)
    numbers = [f"{with_uncertainty(pattern.size_mm, pattern.expanded_mm).lstrip('+')} mm"]
    largest = {
        size.unit: two_figures(abs(size.value))
        for size in sorted(pattern.parameters, key=lambda size: abs(size.value))
        if size.name == "time_constant" or size.unit == "mm/K"
    }
    numbers += [f"{value} {unit}" for unit, value in largest.items()]
    if pattern.how == "steps" and pattern.from_minutes is not None:
        numbers.append(f"at {plain(pattern.from_minutes, 1)} min")
    return f"{subject} {verb} ({', '.join(numbers)})"


def pattern_name(pattern: FoundPattern) -> str:
    """The effect in one noun."""
    return _PATTERNS[pattern.how]["noun"].removeprefix("a ")


def label_words(part: str) -> str:
    """A pattern, or cause, of a label of explanations: of "steps leg x" a step at leg x."""
    how, _, where = part.partition(" ")
    return f"{_PATTERNS[how]['noun']}{f' at {where}' * bool(where)}" if how in _PATTERNS else part


def pattern_remedy(machine: Machine, pattern: FoundPattern) -> str:
    """Remedy of a pattern."""
    known = {size.name: size.value for size in pattern.parameters}
    rest = math.ceil(RESTING * known.get("time_constant", 0.0))
    text, between = _PATTERNS[pattern.how]["remedy"], "two readings"
    if len(pattern.between) > 1:
        first, last = pattern.between
        place = ", ".join(f"{name} {value}" for name, value in first.items() if name != "order")
        place = f" ({place})" * bool(place)
        between = f"readings {first['order']}{place} and {last['order']}"
    moment, where = pattern.from_minutes or 0.0, where_words(machine, pattern)
    there = " there" * bool(pattern.where)
    return text.format(where=where, there=there, rest=rest, moment=moment, between=between)


# In addition to Python's formats.
_FORMATS: Mapping[str, Callable[..., str]] = {
    "capital": capitalized,
    "names": ", ".join,
    "listed": listed,
    "lengths": lambda values: ", ".join(number(value) for value in dict.fromkeys(values)),
    "series": lambda at: f" of leg {at['leg']}, direction {at['direction']}" if at else "",
    "and": " and ".join,
    "lines": lambda numbers: f"Line{'s' * (len(numbers) > 1)} {listed(numbers)}",
    "with": lambda ids: together([*map(label_words, chain(*(id.split(", ") for id in ids)))]),
    "too": lambda titles: "".join(f" and {title}" for title in titles),
    "far": lambda causes: " or ".join(f"{e.id} at {e.times:.0f} times its size" for e in causes),
    # A set of causes, or those that look the same.
    "alike": lambda rows: " or ".join(
        f"{' and '.join(ids)}{',' * (len(rows) < 2)} {percent(share, 1)}"
        for ids, share in rows.items()
    ),
    "causes": lambda ids: " and ".join(ids) or "this",
    # The first two answers of several, and how many others there are.
    "either": lambda answers: ", ".join(
        [together(ids, "a cause") for ids in answers[:2]]
        + [counted(len(answers) - 2, "other")] * (len(answers) > 2)
    ),
    "two": two_figures,
    "p": chance,
    "whole_percent": lambda share: percent(share or 0.0),
    "percent": lambda share: percent(share, 1),
    "sizes": lambda rows: ", ".join(
        f"{name} {signed(size, 3)} {unit_words(unit)}" for name, size, unit in rows
    ),
    "amounts": lambda largest: " or ".join(
        f"{two_figures(size)} {unit_words(unit)}" for unit, size in largest.items()
    ),
    "freed": lambda arms: ", ".join(
        f"{arm.name} {with_uncertainty(arm.value, arm.expanded)}" for arm in arms
    ),
    "in_force": lambda names: f" (other {', '.join(names)} in force)" * bool(names),
    "µm": lambda length_mm: f"{1e3 * length_mm:.0f} µm",
    "tenth_µm": lambda length_mm: f"{1e3 * length_mm:.1f} µm",
    "cycles": lambda count: {1: "one cycle", 5: "five cycles"}.get(count, f"{count} cycles"),
    "sessions": lambda count: counted(count, "simulated session"),
    "half_way": lambda other: ", with the gauges half-way" * other,
    "short": lambda by: f"{abs(by):g} mm {'short' if by > 0.0 else 'too far'}",
    "place": lambda where: f" ({where})" if where else "",
    # Steps that were kept: few of them with the reason why they were questioned.
    "steps": lambda kept: ", ".join(
        f"r {step} ({why})" if len(kept) <= 3 else f"r {step}" for step, why in kept
    ),
    # Is something wrong, or nothing?
    "is": lambda sound: "may be" if sound else "is",
    "from": lambda sound: " from each other or from a sound machine" * sound,
}
# The same in the words of a kind of machine.
_MACHINE_FORMATS: Mapping[str, Callable[[Machine, Any], str]] = {
    "lower": lambda machine, reason: uncapitalized(sentence(reason, machine)),
    "titles": lambda machine, causes: capitalized(
        " and ".join(cause_title(machine, cause) for cause in causes)
    ),
    "beyond": lambda machine, limits: machine.vocabulary.beyond.format(
        limit=", ".join(dict.fromkeys(f"{most:g} {unit}" for most, unit in limits))
    ),
    "patterns": lambda machine, patterns: "; ".join(
        pattern_words(machine, pattern) for pattern in patterns
    ),
    "advice": pattern_remedy,
}


class _Formatter(string.Formatter):
    def __init__(self, machine: Machine | None) -> None:
        self._machine = machine

    def format_field(self, value: object, format_spec: str) -> str:
        if self._machine and format_spec in _MACHINE_FORMATS:
            return _MACHINE_FORMATS[format_spec](self._machine, value)
        if isinstance(value, Reason):
            part = _DOUBTS.get(value.code, {}).get(format_spec)
            return self.vformat(part, (), value.data) if part else sentence(value, self._machine)
        words = _FORMATS.get(format_spec)
        return words(value) if words else str(super().format_field(value, format_spec))


def sentence(reason: Reason, machine: Machine | None = None) -> str:
    """The sentence for a reason, in the words of a kind of machine; a file's remark needs none."""
    words, known = _SENTENCES[reason.code], {**_TEXTS["parts"], **reason.data}
    of_file = f"{known.pop('of_file')}: " if "of_file" in known else ""
    if machine:
        known["words"] = machine.vocabulary
        if "{cause[" in words:
            known["cause"] = cause_words(str(known["id"]), machine, str(known.get("where", "")))
    return of_file + _Formatter(machine).vformat(words, (), known)
