"""Reasons, cautions, notes and remedies in words, which stand in `sentences.toml`.

A sentence is a format string over the data of its reason, the `words` of the machine and those of
the `cause` that the reason names by its id. Where its grammar depends on the data it is a function.
"""

import math
import string
import tomllib
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference import FoundPattern
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    chance,
    counted,
    listed,
    percent,
    plain,
    signed,
    two_figures,
    unit_words,
    with_uncertainty,
)

Data = Mapping[str, Any]
_TEXTS = tomllib.loads(files("orthoglide_cal.report").joinpath("sentences.toml").read_text("utf-8"))
# Source of uncertainty that is no cause → its name, and what would reduce it.
SOURCES: Mapping[str, Mapping[str, str]] = _TEXTS["sources"]
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
# After so many time constants what settles has come to rest: 2 % are left.
RESTING = 4.0

# In addition to Python's formats.
_FORMATS: Mapping[str, Callable[..., str]] = {
    "names": ", ".join,
    "listed": listed,
    "lengths": lambda values: ", ".join(f"{value:g}" for value in dict.fromkeys(values)),
    "series": lambda at: f" of leg {at['leg']}, direction {at['direction']}" if at else "",
    "and": " and ".join,
    "with": " with ".join,
    "causes": lambda ids: " and ".join(ids) or "this",
    "two": two_figures,
    "p": chance,
    "changes": lambda values: ", ".join(f"{name} {signed(by, 3)}" for name, by in values.items()),
    "sizes": lambda rows: ", ".join(
        f"{name} {signed(size, 3)} {unit_words(unit)}" for name, size, unit in rows
    ),
    "in_force": lambda names: f" (other {', '.join(names)} in force)" * bool(names),
    "tenths": lambda value: plain(value, 1),
    "µm": lambda length_mm: f"{1e3 * length_mm:.0f} µm",
    "freed": lambda arms: ", ".join(
        f"{arm.name} {with_uncertainty(arm.value, arm.expanded)}" for arm in arms
    ),
    "stale": lambda order: _TEXTS["stale"]["by_date" if "date" in order else "by_line"].format(
        **order
    ),
    "cycles": lambda count: {1: "one cycle", 5: "five cycles"}.get(count, f"{count} cycles"),
    "half_way": lambda other: ", with the gauges half-way" * other,
    "short": lambda by: f"{abs(by):g} mm {'short' if by > 0.0 else 'too far'}",
    "place": lambda where: f" ({where})" if where else "",
    "moves": lambda rows: ", ".join(
        f"{name} by {two_figures(size)} {unit_words(unit)}" for name, size, unit in rows
    ),
}


class _Formatter(string.Formatter):
    def format_field(self, value: object, format_spec: str) -> str:
        if isinstance(value, Reason):
            return sentence(value)
        words = _FORMATS.get(format_spec)
        return words(value) if words else str(super().format_field(value, format_spec))


def sentence(reason: Reason, machine: Machine | None = None) -> str:
    """The sentence for a reason, in the words of a kind of machine; a file's remark needs none."""
    known = {**_TEXTS["parts"], **reason.data}
    of_file = f"{known.pop('of_file')}: " if "of_file" in known else ""
    if machine and reason.code in _COMPOSED:
        return _COMPOSED[reason.code](machine, known)
    words = _SENTENCES[reason.code]
    if machine:
        known["words"] = machine.vocabulary
        if "{cause." in words:
            known["cause"] = CAUSES[str(known["id"])].words(machine)
    return of_file + _Formatter().vformat(words, (), known)


def _implausible(machine: Machine, data: Data) -> str:
    names = ", ".join(f"{name} {value:+.1f} {unit}" for name, unit, value, _ in data["values"])
    limit = ", ".join(dict.fromkeys(f"{most:g} {unit}" for _, unit, _, most in data["values"]))
    vocabulary = machine.vocabulary
    return f"{vocabulary.one.capitalize()} {names}: {vocabulary.beyond.format(limit=limit)}"


def _undecided(machine: Machine, data: Data) -> str:
    rivals, sound = data["rivals"], data["sound"]
    names = [" with ".join(data["ids"]) or "a cause", *map(" with ".join, rivals[:1])]
    if len(rivals) > 1:
        names.append(counted(len(rivals) - 1, "other"))
    names.append("something that is not on the list")
    either = " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return (
        f"Something {'may be' if sound else 'is'} wrong besides the {machine.vocabulary.many}:"
        f" {either}. These data cannot distinguish them"
        f"{' from each other or from a sound machine' if sound else ''}."
    )


def _offsets_wrong(machine: Machine, data: Data) -> str:
    ids, titles = data["ids"], " and ".join(CAUSES[id].words(machine).title for id in data["ids"])
    return (
        f"{titles[0].upper()}{titles[1:]} ({' and '.join(ids)}, {percent(data['probability'], 1)}):"
        f" {machine.vocabulary.many} alone would be wrong by up to"
        f" {two_figures(data['change'])} {data['unit']}."
    )


def _other_data(_: Machine, data: Data) -> str:
    judged = {
        "named": f"shows {' and '.join(data['ids'])}, too",
        "ambiguous": "leaves open what is wrong",
        "unexplained": "shows something that no listed cause explains",
    }.get(data["verdict"], "must not be used")
    return f"The {data['data']} in the same file, judged alone, {judged}."


def _of_session(machine: Machine, data: Data) -> str:
    text = sentence(data["reason"], machine)
    return f"{data['when']}, {text[0].lower()}{text[1:]}"


def where_words(machine: Machine, pattern: FoundPattern) -> str:
    """The gauges, or readings, that deviate."""
    where = pattern.where
    if "region" in where:
        return f"the touches at the {where['region']} of the bed"
    if not machine.vocabulary.measure:
        return "the probe"
    if "posture" in where:
        return f"the readings at {where['posture']}"
    if not where:
        return "all gauges"
    place = f" of leg {where['leg']}" if "leg" in where else ""
    place += f" along {where['direction']}" if "direction" in where else ""
    return f"the gauge{'s' * (len(where) < 2)}{place}"


def pattern_words(machine: Machine, pattern: FoundPattern) -> str:
    """What deviates, how, and by how much."""
    subject = where_words(machine, pattern)
    single = len(pattern.where) == (2 if machine.vocabulary.measure else 0)
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
    return _PATTERNS[pattern.how]["noun"]


def pattern_remedy(machine: Machine, pattern: FoundPattern) -> str:
    """What to do about it."""
    known = {size.name: size.value for size in pattern.parameters}
    rest = math.ceil(RESTING * known.get("time_constant", 0.0))
    text = _PATTERNS[pattern.how]["remedy"]
    between = "two readings"
    if len(pattern.between) > 1:
        first, last = pattern.between
        place = ", ".join(f"{name} {value}" for name, value in first.items() if name != "order")
        place = f" ({place})" * bool(place)
        between = f"readings {first['order']}{place} and {last['order']}"
    moment, where = pattern.from_minutes or 0.0, where_words(machine, pattern)
    return text.format(where=where, rest=rest, moment=moment, between=between)


def _retake(_: Machine, data: Data) -> str:
    kept = data["kept"]
    few = len(kept) <= 3  # to say why
    steps = ", ".join(f"r {step} ({why})" if few else f"r {step}" for step, why in kept)
    return f"Retake what was questioned and kept: {steps}:"


def _doubt(doubt: Reason, part: str) -> str:
    """Why readings are doubted, or what to do."""
    return _Formatter().vformat(_DOUBTS[doubt.code][part], (), doubt.data)


# Those whose grammar depends on the data.
_COMPOSED: Mapping[str, Callable[[Machine, Data], str]] = {
    "implausible": _implausible,
    "gauge_doubt": lambda _, data: _doubt(data["doubt"], "why"),
    "check_gauge": lambda _, data: _doubt(data["doubt"], "remedy"),
    "undecided": _undecided,
    "offsets_wrong": _offsets_wrong,
    "beyond_list": lambda machine, data: (
        "The reason is not known: "
        f"{'; '.join(pattern_words(machine, one) for one in data['patterns'])}."
    ),
    "beyond_remedy": lambda machine, data: pattern_remedy(machine, data["pattern"]),
    "other_data": _other_data,
    "of_session": _of_session,
    "left_out": lambda _, data: f"Left out: {counted(data['count'], 'simulated session')}.",
    "retake": _retake,
}
