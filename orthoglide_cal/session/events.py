"""Events of a session, the journal that keeps them, and the state that follows from them.

The state is a pure fold over the events (`replay`). The journal is an append-only file of one
record per line, `{"crc32":"…","record":{…}}`. The checksum runs over all records up to this one: a
record that was cut, altered, removed or moved is noticed. A record counts once its bytes are on the
disk (fsync); what a power loss left of an unfinished last record is ignored and reported.
"""

import json
import os
import re
import zlib
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from functools import cached_property, reduce
from io import BytesIO, FileIO
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from orthoglide_cal.errors import InputError, UsageError, command
from orthoglide_cal.files.text import FileText, write_text
from orthoglide_cal.model.linear_delta import PlannedTouch
from orthoglide_cal.model.machine import Named
from orthoglide_cal.model.orthoglide import PlannedReading
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    NOTHING_ENTERED,
    GuidedSession,
    MeasuringProtocol,
    Order,
)
from orthoglide_cal.schema import Schema, text_that
from orthoglide_cal.system import lock


class Doubt(StrEnum):
    """Possible fault of a reading."""

    RANGE = "range"  # beyond the gauge's travel
    GRID = "resolution"  # finer than the gauge can show
    DEAD = "dead"  # its repeats never differ
    SCATTER = "scatter"  # its repeats differ far less than the gauge does
    LAYOUT = "keyboard"  # typed through another keyboard layout; asked by earlier versions
    DOUBLE = "double"  # the same key stroke twice; asked by earlier versions
    REVOLUTION = "revolution"  # whole turns of the dial
    SIGN = "sign"  # read with the opposite sign
    EXCHANGED = "exchanged"  # the two gauges of a leg taken for each other
    POINT = "point"  # decimal point in the wrong place
    STAND = "stand"  # the stand was knocked
    PLACE = "place"  # the machine stands elsewhere
    UNEXPECTED = "unexpected"  # none of these explains it

    @property
    def compares(self) -> bool:
        """True if the reading does not fit the others; not that the gauge can hardly show it."""
        blunders = (Doubt.REVOLUTION, Doubt.SIGN, Doubt.EXCHANGED, Doubt.POINT)
        return self in (*blunders, Doubt.STAND, Doubt.UNEXPECTED)


# Exactly these types. Named tuples would not be held to it if the schema were built later.
_STRICT = ConfigDict(strict=True, defer_build=False)


class GaugeLabel(Schema):
    """A gauge as the operator named it."""

    id: str
    certificate: str = ""


class Following(Schema):
    """Way in which a session continues earlier readings."""

    model_config = _STRICT

    data: FileText  # the file of the first readings, whole
    what: str  # the instruction that is carried out
    minutes: float = 0.0  # that it takes
    continues: bool = False  # the stands stand where the last of the first readings was taken
    entered: tuple[float, float, float] = NOTHING_ENTERED  # since the first of them, mm

    @property
    def words(self) -> str:
        """One sentence with its minutes."""
        return f"Next, about {max(self.minutes, 1.0):.0f} min: {self.what}"


class Event(Schema):
    """Base of all records; `at` is the time of day, ISO 8601 with the offset from UTC."""

    model_config = _STRICT

    kind: str
    at: Annotated[str, text_that(lambda at: datetime.fromisoformat(at).tzinfo, "No zone.", "")]


class Opened(Event):
    """The session's first record: everything that must not change while it lasts."""

    kind: Literal["opened"] = "opened"
    version: Literal[1, 2]  # of this record format; 2 where the second record says what is read
    machine: str  # text of the machine file that the session is measured with
    protocol: MeasuringProtocol = MeasuringProtocol.DOUBLE
    cycles: Annotated[int, Field(ge=1, le=MOST_CYCLES)] = 1
    order: Order = Order.PAPER
    stands: Annotated[int, Field(ge=1, le=2)] = 1  # gauges that are read side by side
    source: tuple[str, ...]  # where readings come from, as given to --gauge
    seed: int | None = None  # of the simulated gauge; None for a real one
    operator: str = ""
    temperature_c: float | None = None
    gauges: tuple[GaugeLabel, ...] = ()

    @property
    def session(self) -> GuidedSession:
        """The session that is measured where no record behind this one says it."""
        return GuidedSession.model_validate(self, from_attributes=True)

    def gauge_id(self, stand: int) -> str | None:
        """Name of the gauge on this stand; None if nobody gave one."""
        return self.gauges[stand].id if stand < len(self.gauges) else None


class Planned(Event):
    """The readings to take, in this order, where no protocol says it; behind `Opened`."""

    kind: Literal["planned"] = "planned"
    readings: tuple[Named[PlannedReading | PlannedTouch], ...]
    following: Following | None  # None for a session that stands for itself


class Reopened(Event):
    """The session was resumed, perhaps after its end; readings come from `source` from now on."""

    kind: Literal["reopened"] = "reopened"
    source: tuple[str, ...]


class Arrived(Event):
    """Base of `Taken` and `Questioned`: a reading arrived."""

    step: int  # its number, from 1
    minutes: float  # since the session began
    value_mm: float
    raw: str  # the characters that arrived
    source: str  # the gauge, or "typed"
    remark: str = ""  # where the machine stood, if it was followed


class Taken(Arrived):
    """A reading was accepted."""

    kind: Literal["taken"] = "taken"


class Questioned(Arrived):
    """A reading arrived that looks wrong; it is on disk, but not accepted yet."""

    kind: Literal["questioned"] = "questioned"
    doubt: Doubt
    question: str  # the sentence shown
    about: int = 0  # of earlier versions: step since which a gauge may be wrong


class Answered(Event):
    """The open question was answered: the reading is kept, or will be read again."""

    kind: Literal["answered"] = "answered"
    keep: bool
    moved: bool = False  # the stand did move: from here on the gauge has a new zero


class Undone(Event):
    """The last accepted reading, skip or retake was taken back."""

    kind: Literal["undone"] = "undone"


class Retake(Event):
    """These steps are to be measured again; their readings count as replaced."""

    kind: Literal["retake"] = "retake"
    steps: tuple[int, ...]
    reason: str


class Skipped(Event):
    """A step is left out."""

    kind: Literal["skipped"] = "skipped"
    step: int
    reason: str


class Noted(Event):
    """A remark of the operator at a step."""

    kind: Literal["noted"] = "noted"
    step: int
    text: str


class Paused(Event):
    """The operator paused, or went on; written by earlier versions."""

    kind: Literal["paused", "continued"]


class Shortened(Event):
    """The offsets are known well enough: these steps need not be measured any more."""

    kind: Literal["shortened"] = "shortened"
    drop: tuple[int, ...]
    reason: str


class Ended(Event):
    """The session is complete; nothing follows unless it is reopened."""

    kind: Literal["ended"] = "ended"
    reason: str


RECORD: TypeAdapter[Event] = TypeAdapter(
    Annotated[
        Opened | Planned | Reopened | Taken | Questioned | Answered | Undone | Retake | Skipped
        | Noted | Paused | Shortened | Ended,
        Field(discriminator="kind"),
    ]
)  # fmt: skip


class Accepted(NamedTuple):
    """A reading that counts; `rank` is the number of the record that accepted it."""

    take: Arrived
    rank: int


@dataclass(frozen=True)
class State:
    """State of a session."""

    opened: Opened
    planned: Planned | None = None  # what is read, where no protocol says it
    accepted: Mapping[int, Accepted] = field(default_factory=dict)  # by step, from first to last
    skipped: Mapping[int, str] = field(default_factory=dict)  # step number → reason
    dropped: Mapping[int, str] = field(default_factory=dict)  # step no longer needed → reason
    replaced: tuple[tuple[Arrived, str], ...] = ()  # (reading that no longer counts, reason)
    notes: tuple[tuple[int, str], ...] = ()  # (step number, text)
    moved: tuple[tuple[int, int], ...] = ()  # (step, rank) of readings since which a stand moved
    pending: Questioned | None = None  # a questioned reading that waits for an answer
    ended: Ended | None = None  # the last record, once the session is complete
    source: tuple[str, ...] = ()  # where readings come from now
    count: int = 1  # of records
    before: "State | None" = field(default=None, repr=False, compare=False)  # to undo

    def is_open(self, step: int) -> bool:
        """True if this step still has to be measured."""
        return not (step in self.accepted or step in self.skipped or step in self.dropped)

    def takes(self, step: int) -> int:
        """Number of readings that arrived for a step so far, whatever became of them."""
        old = sum(take.step == step for take, _ in self.replaced)
        waiting = self.pending is not None and self.pending.step == step
        return old + (step in self.accepted) + waiting


def replay(records: Iterable[Event]) -> State:
    """The state after these records; the first must be `Opened`."""
    opened, *rest = records
    if not isinstance(opened, Opened):
        raise ValueError("a session begins with its opened record")
    return reduce(advance, rest, State(opened, source=opened.source))


def advance(state: State, event: Event) -> State:
    """The state after one more record."""
    pending = state.pending
    state = replace(state, count=state.count + 1)
    if pending and isinstance(event, Arrived | Answered | Undone | Retake | Skipped):
        state = replace(state, pending=None)
        if not (isinstance(event, Answered) and event.keep):
            old = (pending, f"read again: {pending.question}")
            state = replace(state, replaced=(*state.replaced, old))
    match event:
        case Planned():
            return replace(state, planned=event)
        case Questioned():
            return replace(state, pending=event)
        case Taken():
            return _accept(state, event)
        case Answered(keep=True) if pending:
            moved = ((pending.step, state.count),) if event.moved else ()
            return replace(_accept(state, pending), moved=(*state.moved, *moved))
        case Undone() if then := state.before:  # what was added since counts as replaced
            restored = {id(item.take) for item in then.accepted.values()}
            taken = [(item.take, "taken back") for item in state.accepted.values()]
            gone = tuple(one for one in (*state.replaced, *taken) if id(one[0]) not in restored)
            then = replace(then, notes=state.notes, source=state.source, count=state.count)
            return replace(then, replaced=gone)
        case Retake():
            again = set(event.steps)
            accepted = state.accepted.items()
            replaced = ((item.take, event.reason) for n, item in accepted if n in again)
            return replace(
                state,
                accepted={n: item for n, item in accepted if n not in again},
                skipped={n: why for n, why in state.skipped.items() if n not in again},
                dropped={n: why for n, why in state.dropped.items() if n not in again},
                replaced=(*state.replaced, *replaced),
                before=state,
            )
        case Skipped():
            return replace(state, skipped={**state.skipped, event.step: event.reason}, before=state)
        case Noted():
            return replace(state, notes=(*state.notes, (event.step, event.text)))
        case Shortened():
            dropped = dict.fromkeys(event.drop, event.reason)
            return replace(state, dropped={**state.dropped, **dropped})
        case Ended():
            return replace(state, ended=event)
        case Reopened():
            return replace(state, source=event.source, ended=None)
        case _:
            return state


def _accept(state: State, take: Arrived) -> State:
    accepted, skipped = dict(state.accepted), dict(state.skipped)
    accepted.pop(take.step, None)  # a reading that came again is the last one
    skipped.pop(take.step, None)
    accepted[take.step] = Accepted(take, state.count)
    return replace(state, accepted=accepted, skipped=skipped, before=state)


# ---- the journal

_BEGIN = b'{"crc32":"'
_LINE = re.compile(_BEGIN + rb'(.*?)","record":(.*)\}', re.DOTALL)


def encode(event: Event, checksum: int = 0) -> tuple[bytes, int]:
    """One line for `event` after records with this running checksum; and the new checksum."""
    body = json.dumps(event.model_dump(), ensure_ascii=True, separators=(",", ":")).encode()
    checksum = zlib.crc32(body, checksum)
    return b'{"crc32":"%08x","record":%s}\n' % (checksum, body), checksum


@dataclass(eq=False)
class Journal:
    """A journal as it was read; `resume` opens and locks it against every other session."""

    path: Path
    events: tuple[Event, ...]  # that were read, the first one `Opened`
    lost: int  # number of bytes after them that were no complete record
    _checksum: int  # of the records on the disk
    _size: int  # length of their bytes on the disk
    _file_size: int  # with what a power loss left behind them
    _end: bytes  # that the last record lacks
    _descriptor: int = -1

    @cached_property
    def state(self) -> State:
        """The state after all records, also those that are appended."""
        return replay(self.events)

    @staticmethod
    def create(path: Path, *events: Event) -> None:
        """Write a journal of these records, all or none. Raises UsageError if the file exists."""
        data, checksum = b"", 0
        for event in events:
            line, checksum = encode(event, checksum)
            data += line
        write_text(path, data)

    @classmethod
    def decode(cls, data: bytes, path: str | Path) -> "Journal":
        """The journal that these bytes are, not to be continued. Raises InputError: damaged."""
        events: list[Event] = []
        checksum, size = 0, 0
        for number, line in enumerate(BytesIO(data), start=1):
            try:
                event, after = _decode_line(line.rstrip(b"\n"), checksum)
            except InputError as error:
                rest = data[size + len(line) :].strip(b"\0\n")
                if number > 1 and not rest and line.count(_BEGIN) <= 1:
                    break
                if number == 1 and not isinstance(error.__cause__, ValidationError):
                    error.what = "This is not the journal of a session."
                    error.remedy = "Restore the file from a copy, or begin a new session."
                error.file, error.line = str(path), number
                raise
            events.append(event)
            checksum, size = after, size + len(line)
        if not events or not isinstance(events[0], Opened):
            raise InputError("The journal is empty.", "Begin a new session.", file=str(path))
        end = b"" if data[:size].endswith(b"\n") else b"\n"
        return cls(Path(path), tuple(events), len(data) - size, checksum, size, len(data), end)

    @classmethod
    def resume(cls, path: Path, opened: ExitStack) -> "Journal":
        """The journal in `path`, to be continued; its lock ends with what is `opened`.

        Raises UsageError: there is none, or it is in use; InputError: it cannot be read.
        """
        try:
            file = opened.enter_context(FileIO(path, "r+"))
        except FileNotFoundError as error:
            fault = f"There is no unfinished session in {path}."
            raise UsageError(fault, "Leave out --resume to begin one.") from error
        except OSError as error:
            fault = f"The journal cannot be opened: {error.strerror}."
            remedy = "Check the folder and its permissions."
            raise InputError(fault, remedy, file=str(path)) from error
        try:  # the system releases it when the process ends, however
            lock(file.fileno())
        except OSError as error:
            fault = f"{path} is in use by another session that is still running."
            remedy = "Continue there (fg, if it was stopped with Ctrl-Z), or end it there with q."
            raise UsageError(fault, remedy) from error
        return replace(cls.decode(file.read(), path), _descriptor=file.fileno())

    def append(self, event: Event) -> None:
        """Put a record on the disk; once it is safe, let it count.

        Raises InputError if the disk is full or the file is gone; nothing of the record remains.
        """
        line, checksum = encode(event, self._checksum)
        line = self._end + line
        try:
            mine = os.fstat(self._descriptor)
            if not os.path.samestat(mine, os.stat(self.path)):
                raise OSError("another file has its name now")
            if mine.st_size != self._file_size:
                raise OSError("another program changed it")
            os.ftruncate(self._descriptor, self._size)
            self._file_size = self._size
            os.lseek(self._descriptor, self._size, os.SEEK_SET)
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            os.fsync(self._descriptor)
        except OSError as error:
            # Remove what was written of it; if even that fails, the next resume ignores it.
            with suppress(OSError):
                if os.fstat(self._descriptor).st_size > self._size == self._file_size:
                    os.ftruncate(self._descriptor, self._size)
                    os.fsync(self._descriptor)
            fault = f"The last entry could not be saved: {error.strerror or error}."
            again = command("measure", str(self.path.with_suffix(".yaml")), options="--resume")
            remedy = "The readings so far are safe. Free some space, or plug the drive in again;"
            raise InputError(fault, f"{remedy} then: {again}", file=str(self.path)) from error
        self._size = self._file_size = self._size + len(line)
        self._checksum, self._end = checksum, b""
        self.state = advance(self.state, event)


def _decode_line(line: bytes, checksum: int) -> tuple[Event, int]:
    match, step = _LINE.fullmatch(line), re.search(rb'"step":([0-9]{1,9})', line)
    entry = f"the entry of step {int(step[1])}" if step else "an entry"
    fault = "The journal is damaged here:"
    remedy = "Restore the file from a copy; or resume a copy of the lines above this one."
    if match is None:
        raise InputError(f"{fault} {entry} is cut off or altered.", remedy)
    after = zlib.crc32(match[2], checksum)
    if match[1] != b"%08x" % after:
        raise InputError(f"{fault} {entry} does not match its checksum.", remedy)
    try:
        return RECORD.validate_json(match[2]), after
    except ValidationError as error:
        fault += f" {'.'.join(map(str, error.errors()[0]['loc'])) or entry}"
        remedy = "Use the orthocal that wrote it, or restore the file from a copy."
        raise InputError(f"{fault} is not as this version writes it.", remedy) from error
