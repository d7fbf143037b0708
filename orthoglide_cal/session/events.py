"""What can happen in a session: one small record each. The journal is a list of these.

A session's state is nothing but these records, one after the other (`state.replay`), so that a
session that was interrupted anywhere continues as if it had not been. On the disk a record is of
the kind that its class is called, in lower case, and has the class's fields in their order.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from datetime import datetime
from enum import IntEnum, StrEnum
from functools import cache
from types import MappingProxyType, NoneType
from typing import Any, get_args, get_origin, get_type_hints

from orthoglide_cal.files import FileText
from orthoglide_cal.model import Model
from orthoglide_cal.model.kinds import PlannedReading
from orthoglide_cal.planning.steps import MeasuringProtocol, Order

VERSION = 1
PLANNED_VERSION = 2  # of a journal whose second record says what is read
# How a record writes None where it is not null.
_AS_TEXT = MappingProxyType({"none": ""})


class Doubt(StrEnum):
    """What may be wrong with a reading."""

    RANGE = "range"  # beyond the gauge's travel
    GRID = "resolution"  # finer than the gauge can show
    DEAD = "dead"  # its repeats never differ
    SCATTER = "scatter"  # its repeats differ far less than the gauge does
    LAYOUT = "keyboard"  # typed through a wrong keyboard layout
    DOUBLE = "double"  # the same key stroke twice; asked by earlier versions
    REVOLUTION = "revolution"  # whole turns of the dial
    SIGN = "sign"  # read with the opposite sign
    EXCHANGED = "exchanged"  # the two gauges of a leg taken for each other
    POINT = "point"  # decimal point in the wrong place
    STAND = "stand"  # the stand was knocked
    UNEXPECTED = "unexpected"  # none of these explains it

    @property
    def compares(self) -> bool:
        """Whether the reading does not fit the others; not that the gauge can hardly show it."""
        alone = (Doubt.RANGE, Doubt.GRID, Doubt.DEAD, Doubt.SCATTER, Doubt.LAYOUT, Doubt.DOUBLE)
        return self not in alone


@dataclass(frozen=True)
class GaugeLabel:
    """A gauge as the operator named it."""

    id: str
    certificate: str | None = field(default=None, metadata=_AS_TEXT)


@dataclass(frozen=True)
class Event:
    """Base of all records; `at` is the time of day, ISO 8601 with the offset from UTC."""

    at: str


@dataclass(frozen=True)
class Opened(Event):
    """The session's first record: everything that must not change while it lasts."""

    version: int  # of this record format
    machine: str  # text of the machine file that the session is measured with
    protocol: MeasuringProtocol
    cycles: int
    order: Order
    stands: int  # number of gauges that are read side by side, 1 or 2
    source: tuple[str, ...]  # where readings come from, as given to --gauge
    seed: int | None  # of the simulated gauge; None for a real one
    operator: str | None = field(metadata=_AS_TEXT)
    temperature_c: float | None
    gauges: tuple[GaugeLabel, ...]

    def gauge_id(self, stand: int) -> str | None:
        """What the gauge on this stand is called; None if nobody said."""
        return self.gauges[stand].id if stand < len(self.gauges) else None


@dataclass(frozen=True)
class Following:
    """What a session goes on from."""

    data: FileText  # the file of the first readings, whole
    what: str  # the instruction that is carried out
    minutes: float  # that it takes
    continues: bool  # the stands stand where the last of the first readings was taken
    entered: tuple[float, float, float]  # in the controller since the first of them, mm

    @property
    def words(self) -> str:
        """One sentence with its minutes."""
        return f"Next, about {max(self.minutes, 1.0):.0f} min: {self.what}"

    def held(self, model: Model) -> Model:
        """The machine of the first reading, with what its controller holds now."""
        now = (round(a + b, 9) for a, b in zip(model.machine.offsets_mm, self.entered, strict=True))
        x, y, z = now
        return model.holding((x, y, z))


@dataclass(frozen=True)
class Planned(Event):
    """What is read, in this order, where no protocol says it; it stands behind `Opened`."""

    readings: tuple[PlannedReading, ...]
    following: Following | None  # None for a session that stands for itself


@dataclass(frozen=True)
class Reopened(Event):
    """The session was resumed, perhaps after its end; readings come from `source` from now on."""

    source: tuple[str, ...]


@dataclass(frozen=True)
class Taken(Event):
    """A reading was accepted."""

    step: int  # its number, from 1
    minutes: float  # since the session began
    value_mm: float
    raw: str  # the characters that arrived
    source: str  # the gauge, or "typed"
    remark: str = field(default="", kw_only=True)  # always empty; the format has it

    @property
    def file_minutes(self) -> float:
        """The time as it stands in the session file, to 6 ms."""
        return round(self.minutes, 4)


@dataclass(frozen=True)
class Questioned(Taken):
    """A reading arrived that looks wrong; it is on disk, but not accepted yet."""

    doubt: Doubt
    question: str  # the sentence shown
    # Step from which on something may be wrong; None if it is this reading alone.
    about: int | None = field(default=None, metadata={"none": 0})


@dataclass(frozen=True)
class Answered(Event):
    """The open question was answered: the reading is kept, or will be read again.

    It is kept as `moved` because the stand did move: from here on the gauge has a new zero.
    """

    keep: bool
    moved: bool = False


class Undone(Event):
    """The last accepted reading, skip or retake was taken back."""


@dataclass(frozen=True)
class Retake(Event):
    """These steps are to be measured again; their readings count as replaced."""

    steps: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Skipped(Event):
    """A step is left out."""

    step: int
    reason: str


@dataclass(frozen=True)
class Noted(Event):
    """A remark of the operator at a step."""

    step: int
    text: str


class Paused(Event):
    """The operator paused."""


class Continued(Event):
    """The operator went on after a pause."""


@dataclass(frozen=True)
class Shortened(Event):
    """The offsets are known well enough: these steps need not be measured any more."""

    drop: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Ended(Event):
    """The session is complete; nothing follows unless it is reopened."""

    reason: str


_ALL = (
    Opened, Planned, Reopened, Taken, Questioned, Answered, Undone, Retake, Skipped, Noted, Paused,
    Continued, Shortened, Ended,
)  # fmt: skip
_KINDS: Mapping[str, type[Event]] = {event.__name__.lower(): event for event in _ALL}


def to_dict(event: Event) -> dict[str, Any]:
    """The record as plain values, its kind first."""
    return {"kind": type(event).__name__.lower(), **_plain(event)}


def from_dict(record: Any) -> Event:
    """The event that a record describes.

    Raises:
        ValueError: not a record of a known kind with exactly its fields and a time with zone.
    """
    kind = _KINDS.get(str(record.get("kind"))) if isinstance(record, dict) else None
    if kind is None:
        raise ValueError("not a record of a known kind")
    event: Event = _made(kind, {name: record[name] for name in record if name != "kind"})
    if datetime.fromisoformat(event.at).tzinfo is None:
        raise ValueError(f"{event.at!r} says no zone")
    return event


def _plain(value: Any, none: Any = None) -> Any:
    if value is None:
        return none
    if _is_record(type(value)):
        return {name: _plain(getattr(value, name), blank) for name, blank in _parts(type(value))}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


_types = cache(get_type_hints)


def _is_record(kind: Any) -> bool:
    """Whether a type has named parts."""
    return is_dataclass(kind) or hasattr(kind, "_fields")


def _parts(kind: Any) -> list[tuple[str, Any]]:
    """Names of the parts of a type, in their order, with how each writes None."""
    if is_dataclass(kind):
        return [(item.name, item.metadata.get("none")) for item in fields(kind)]
    return [(name, None) for name in kind._fields]


def _made(kind: Any, values: Any) -> Any:
    """A record or a part of one from plain values. Raises ValueError."""
    types = _types(kind)
    if not isinstance(values, dict) or set(values) != set(types):
        raise ValueError(f"{kind.__name__} has the fields {sorted(types)}")
    return kind(**{name: _value(values[name], types[name], blank) for name, blank in _parts(kind)})


def _value(value: Any, wanted: Any, none: Any = None) -> Any:
    """A value from JSON as the type of an event's field. Raises ValueError."""
    choice, *others = get_args(wanted) or (wanted,)
    if get_origin(wanted) is tuple:
        if isinstance(value, list) and (... in others or len(value) == len(others) + 1):
            return tuple(_value(item, choice) for item in value)
    elif NoneType in others and value == none and type(value) is type(none):
        return None
    elif _is_record(choice):
        return _made(choice, value)
    elif issubclass(choice, StrEnum | IntEnum) and type(value) in (str, int):
        return choice(value)
    elif choice is float and type(value) in (int, float) and abs(value) <= sys.float_info.max:
        return float(value)
    elif choice is not float and type(value) is choice:
        return value
    raise ValueError(f"{value!r} is no {wanted}")
