"""The state of a session: a pure fold over its records.

The same records always give the same state, so a session is resumed by replaying its journal.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from types import MappingProxyType

from orthoglide_cal.session.events import (
    Answered,
    Ended,
    Event,
    Noted,
    Opened,
    Questioned,
    Reopened,
    Retake,
    Shortened,
    Skipped,
    Taken,
    Undone,
)


@dataclass(frozen=True)
class Replaced:
    """A reading that does not count any more, and why."""

    take: Taken
    reason: str


@dataclass(frozen=True)
class Accepted:
    """A reading that counts.

    Attributes:
        take: the record that brought it.
        rank: number of the record that accepted it: order in time.
    """

    take: Taken
    rank: int


@dataclass(frozen=True)
class State:
    """Where a session stands.

    Attributes:
        opened: the session's first record.
        accepted: step number → reading that counts.
        skipped: step number → reason.
        dropped: steps that are no longer needed.
        replaced: readings that no longer count.
        notes: (step number, text).
        moved: (step number, rank) of readings from which on a stand stood elsewhere.
        pending: a questioned reading that waits for an answer.
        ended: the last record, once the session is complete.
        source: where readings come from now.
        last_at: time of the last record.
        count: number of records.
        before: the state to which an undo returns.
    """

    opened: Opened
    accepted: Mapping[int, Accepted] = field(default_factory=dict)
    skipped: Mapping[int, str] = field(default_factory=dict)
    dropped: frozenset[int] = frozenset()
    replaced: tuple[Replaced, ...] = ()
    notes: tuple[tuple[int, str], ...] = ()
    moved: tuple[tuple[int, int], ...] = ()
    pending: Questioned | None = None
    ended: Ended | None = None
    shortened: Shortened | None = None
    source: tuple[str, ...] = ()
    last_at: str = ""
    count: int = 1
    before: State | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("accepted", "skipped"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def is_open(self, step: int) -> bool:
        """True if this step still has to be measured."""
        return not (step in self.accepted or step in self.skipped or step in self.dropped)

    def takes(self, step: int) -> int:
        """How many readings arrived for a step so far, whatever became of them."""
        old = sum(item.take.step == step for item in self.replaced)
        waiting = self.pending is not None and self.pending.step == step
        return old + (step in self.accepted) + waiting

    def in_time(self) -> tuple[tuple[int, Accepted], ...]:
        """(step number, reading that counts), from first to last."""
        return tuple(sorted(self.accepted.items(), key=lambda item: item[1].rank))

    @property
    def last_step(self) -> int | None:
        """The step whose reading was accepted last."""
        return self.in_time()[-1][0] if self.accepted else None

    def refused(self, step: int) -> tuple[Questioned, ...]:
        """Questioned readings of this step that were given up for a new one."""
        return tuple(
            item.take
            for item in self.replaced
            if item.take.step == step and isinstance(item.take, Questioned)
        )


def replay(events: Iterable[Event]) -> State:
    """The state after these records; the first must be `Opened`."""
    rest = iter(events)
    opened = next(rest)
    if not isinstance(opened, Opened):
        raise ValueError("a session begins with its opened record")
    start = State(opened, source=tuple(opened.source), last_at=opened.at)
    return reduce(advance, rest, start)


def advance(state: State, event: Event) -> State:
    """The state after one more record."""
    state = replace(state, last_at=event.at, count=state.count + 1)
    match event:
        case Questioned():
            return replace(_give_up(state), pending=event)
        case Taken():
            return _accept(_give_up(state), event)
        case Answered():
            return _answer(state, event)
        case Undone():
            return _undo(state)
        case Retake():
            return _retake(state, event)
        case Skipped():
            now = _give_up(state)
            return replace(now, skipped={**now.skipped, event.step: event.reason}, before=state)
        case Noted():
            return replace(state, notes=(*state.notes, (event.step, event.text)))
        case Shortened():
            unmeasured = frozenset(event.drop) | state.dropped
            return replace(state, dropped=unmeasured, shortened=event)
        case Ended():
            return replace(state, ended=event)
        case Reopened():
            return replace(state, source=tuple(event.source))
        case _:
            return state


def _accept(state: State, take: Taken) -> State:
    skipped = {step: why for step, why in state.skipped.items() if step != take.step}
    accepted = {**state.accepted, take.step: Accepted(take, state.count)}
    return replace(state, accepted=accepted, skipped=skipped, before=state)


def _answer(state: State, event: Answered) -> State:
    if state.pending is None:
        return state
    if not event.keep:
        return _give_up(state)
    kept = _accept(replace(state, pending=None), state.pending)
    if event.moved:
        kept = replace(kept, moved=(*kept.moved, (state.pending.step, state.count)))
    return kept


def _give_up(state: State) -> State:
    """A questioned reading that nobody kept is replaced by what comes next."""
    if state.pending is None:
        return state
    old = Replaced(state.pending, f"read again: {state.pending.question}")
    return replace(state, pending=None, replaced=(*state.replaced, old))


def _retake(state: State, event: Retake) -> State:
    now = _give_up(state)
    again = set(event.steps)
    old = tuple(Replaced(item.take, event.reason) for step, item in now.in_time() if step in again)
    return replace(
        now,
        accepted={step: item for step, item in now.accepted.items() if step not in again},
        skipped={step: why for step, why in now.skipped.items() if step not in again},
        dropped=now.dropped - again,
        replaced=(*now.replaced, *old),
        before=now,
    )


def _undo(state: State) -> State:
    """Back to before the last acceptance, skip or retake; what it added counts as replaced."""
    now = _give_up(state)
    if now.before is None:
        return now
    then = now.before
    taken_back = tuple(
        Replaced(item.take, "taken back")
        for step, item in now.in_time()
        if then.accepted.get(step) != item
    )
    restored = {id(item.take) for item in then.accepted.values()}
    kept = tuple(item for item in now.replaced if id(item.take) not in restored)
    return replace(
        now,
        accepted=then.accepted,
        skipped=then.skipped,
        dropped=then.dropped,
        moved=then.moved,
        shortened=then.shortened,
        replaced=(*kept, *taken_back),
        before=then.before,
    )
