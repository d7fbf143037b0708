"""What can happen in a session: one small record each. The journal is a list of these.

A session's state is nothing but these records, one after the other (`state.replay`), so that a
session that was interrupted anywhere continues as if it had not been.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar

VERSION = 1


@dataclass(frozen=True)
class Event:
    """Base of all records.

    Attributes:
        at: time of day, ISO 8601 with the offset from UTC.
    """

    kind: ClassVar[str] = ""

    at: str


@dataclass(frozen=True)
class Opened(Event):
    """The session's first record: everything that must not change while it lasts.

    Attributes:
        version: of this record format.
        machine: text of the machine file that the session is measured with.
        protocol: "double-posture" or "single-posture".
        cycles: repeats of each posture.
        order: "paper" or "fewest-moves".
        stands: number of gauges that are read side by side, 1 or 2.
        source: where readings come from, as given to --gauge ("typed", "simulated", …).
        seed: of the simulated gauge; None for a real one.
        operator, temperature_c, gauges: as given; empty or None where not given. One
            {"id", "certificate"} per gauge.
    """

    kind: ClassVar[str] = "opened"

    version: int
    machine: str
    protocol: str
    cycles: int
    order: str
    stands: int
    source: list[str]
    seed: int | None
    operator: str
    temperature_c: float | None
    gauges: list[dict[str, str]]


@dataclass(frozen=True)
class Reopened(Event):
    """The session was resumed; readings come from `source` from now on."""

    kind: ClassVar[str] = "reopened"

    source: list[str]


@dataclass(frozen=True)
class Taken(Event):
    """A reading was accepted.

    Attributes:
        step: number of the step, from 1.
        minutes: since the session began.
        value_mm: the reading [mm].
        raw: the characters that arrived.
        source: the gauge, or "typed".
        remark: what the user should find beside the reading later; often empty.
    """

    kind: ClassVar[str] = "taken"

    step: int
    minutes: float
    value_mm: float
    raw: str
    source: str
    remark: str = ""


@dataclass(frozen=True)
class Questioned(Taken):
    """A reading arrived that looks wrong; it is on disk, but not accepted yet.

    Attributes:
        doubt: kind of doubt (`doubts.Doubt`).
        question: the sentence shown.
        about: step from which on something may be wrong, if that is not this one; 0 if it is.
    """

    kind: ClassVar[str] = "questioned"

    doubt: str = ""
    question: str = ""
    about: int = 0


@dataclass(frozen=True)
class Answered(Event):
    """The open question was answered.

    Attributes:
        keep: the reading is kept; otherwise it will be read again.
        moved: it is kept because the stand did move: from here on the gauge has a new zero.
    """

    kind: ClassVar[str] = "answered"

    keep: bool
    moved: bool = False


@dataclass(frozen=True)
class Undone(Event):
    """The last accepted reading, skip or retake was taken back."""

    kind: ClassVar[str] = "undone"


@dataclass(frozen=True)
class Retake(Event):
    """These steps are to be measured again; their readings count as replaced."""

    kind: ClassVar[str] = "retake"

    steps: list[int]
    reason: str


@dataclass(frozen=True)
class Skipped(Event):
    """A step is left out."""

    kind: ClassVar[str] = "skipped"

    step: int
    reason: str


@dataclass(frozen=True)
class Noted(Event):
    """A remark of the operator at a step."""

    kind: ClassVar[str] = "noted"

    step: int
    text: str


@dataclass(frozen=True)
class Paused(Event):
    """The operator paused."""

    kind: ClassVar[str] = "paused"


@dataclass(frozen=True)
class Continued(Event):
    """The operator went on after a pause."""

    kind: ClassVar[str] = "continued"


@dataclass(frozen=True)
class Shortened(Event):
    """The offsets are known well enough: these steps need not be measured any more."""

    kind: ClassVar[str] = "shortened"

    drop: list[int]
    reason: str


@dataclass(frozen=True)
class Ended(Event):
    """The session is complete; nothing follows."""

    kind: ClassVar[str] = "ended"

    reason: str


_KINDS: dict[str, type[Event]] = {
    event.kind: event
    for event in (
        Opened,
        Reopened,
        Taken,
        Questioned,
        Answered,
        Undone,
        Retake,
        Skipped,
        Noted,
        Paused,
        Continued,
        Shortened,
        Ended,
    )
}


def to_dict(event: Event) -> dict[str, Any]:
    """The record as plain values, its kind first."""
    return {"kind": event.kind, **asdict(event)}


def from_dict(record: Any) -> Event:
    """The event that a record describes.

    Raises:
        ValueError: not a record of a known kind with exactly its fields.
    """
    if not isinstance(record, dict):
        raise ValueError("not a record")
    values = dict(record)
    event = _KINDS.get(str(values.pop("kind", "")))
    if event is None:
        raise ValueError(f"unknown kind of record {record.get('kind')!r}")
    types = {item.name: str(item.type) for item in fields(event)}
    if set(values) != set(types):
        raise ValueError(f"a {event.kind!r} record has the fields {sorted(types)}")
    for name, value in values.items():
        if not _is(value, types[name]):
            raise ValueError(f"{name} of a {event.kind!r} record is no {types[name]}")
    return event(**values)


def _is(value: Any, wanted: str) -> bool:
    """Whether a value from JSON has the type of an event's field."""
    plain = {
        "str": isinstance(value, str),
        "bool": isinstance(value, bool),
        "int": isinstance(value, int) and not isinstance(value, bool),
        "float": isinstance(value, int | float) and math.isfinite(value),
        "None": value is None,
    }
    if wanted.startswith("list["):
        inner = wanted.removeprefix("list[").removesuffix("]")
        return isinstance(value, list) and all(_is(item, inner) for item in value)
    if wanted.startswith("dict["):
        return isinstance(value, dict) and all(isinstance(v, str) for v in value.values())
    return any(plain[name] for name in wanted.split(" | "))
