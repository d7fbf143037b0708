"""Events of a session, one small record each, and the state that follows from them.

The journal is a list of these records. The state is a pure fold over them (`replay`): a session
that was interrupted anywhere continues as if it had not been.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from functools import reduce
from typing import Annotated, Literal, NamedTuple

from pydantic import ConfigDict, Field, TypeAdapter

from orthoglide_cal.files.text import FileText
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
        alone = (Doubt.RANGE, Doubt.GRID, Doubt.DEAD, Doubt.SCATTER, Doubt.LAYOUT, Doubt.DOUBLE)
        return self not in (*alone, Doubt.PLACE)


# Exactly these types. Named tuples would not be held to it if the schema were built later.
_STRICT = ConfigDict(strict=True, defer_build=False)


class GaugeLabel(Schema):
    """A gauge as the operator named it."""

    id: str
    certificate: str = ""


class Following(Schema):
    """How a session continues earlier readings."""

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
        fields = {name: getattr(self, name) for name in GuidedSession.model_fields}
        return GuidedSession().changed(**fields)

    def gauge_id(self, stand: int) -> str | None:
        """Name of the gauge on this stand; None if nobody gave one."""
        return self.gauges[stand].id if stand < len(self.gauges) else None


class Planned(Event):
    """The readings to take, in this order, where no protocol says it; it stands behind `Opened`."""

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
    about: int = 0  # step from which on something may be wrong; 0 if it is this one alone


class Answered(Event):
    """The open question was answered: the reading is kept, or will be read again.

    It is kept as `moved` because the stand did move: from here on the gauge has a new zero.
    """

    kind: Literal["answered"] = "answered"
    keep: bool
    moved: bool = False


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
    # (step number, rank) of readings from which on a stand stood elsewhere.
    moved: tuple[tuple[int, int], ...] = ()
    pending: Questioned | None = None  # a questioned reading that waits for an answer
    ended: Ended | None = None  # the last record, once the session is complete
    source: tuple[str, ...] = ()  # where readings come from now
    count: int = 1  # of records
    # The state to which an undo returns.
    before: "State | None" = field(default=None, repr=False, compare=False)

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
            obsolete = tuple(one for one in (*state.replaced, *taken) if id(one[0]) not in restored)
            back = replace(then, notes=state.notes, source=state.source, count=state.count)
            return replace(back, replaced=obsolete)
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
