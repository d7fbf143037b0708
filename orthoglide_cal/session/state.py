"""The state of a session: a pure fold over its records.

The same records always give the same state, so a session is resumed by replaying its journal.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from types import MappingProxyType
from typing import NamedTuple, TypeVar

from orthoglide_cal.session import events
from orthoglide_cal.session.events import Arrived, Event, Opened, Questioned

Value = TypeVar("Value")


class Replaced(NamedTuple):
    """A reading that does not count any more, and why."""

    take: Arrived
    reason: str


class Accepted(NamedTuple):
    """A reading that counts; `rank` is the number of the record that accepted it."""

    take: Arrived
    rank: int


@dataclass(frozen=True)
class State:
    """Where a session stands."""

    opened: Opened
    planned: events.Planned | None = None  # what is read, where no protocol says it
    accepted: Mapping[int, Accepted] = field(default_factory=dict)  # by step, from first to last
    skipped: Mapping[int, str] = field(default_factory=dict)  # step number → reason
    dropped: frozenset[int] = frozenset()  # steps that are no longer needed
    replaced: tuple[Replaced, ...] = ()  # readings that no longer count
    notes: tuple[tuple[int, str], ...] = ()  # (step number, text)
    # (step number, rank) of readings from which on a stand stood elsewhere.
    moved: tuple[tuple[int, int], ...] = ()
    pending: Questioned | None = None  # a questioned reading that waits for an answer
    shortened: events.Shortened | None = None  # the record that dropped steps
    ended: events.Ended | None = None  # the last record, once the session is complete
    # The state at the end before this session was reopened.
    reopened: State | None = field(default=None, repr=False, compare=False)
    source: tuple[str, ...] = ()  # where readings come from now
    count: int = 1  # of records
    # The state to which an undo returns.
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


def replay(events: Iterable[Event]) -> State:
    """The state after these records; the first must be `Opened`."""
    rest = iter(events)
    opened = next(rest)
    if not isinstance(opened, Opened):
        raise ValueError("a session begins with its opened record")
    return reduce(advance, rest, State(opened, source=opened.source))


def advance(state: State, event: Event) -> State:
    """The state after one more record."""
    state = replace(state, count=state.count + 1)
    match event:
        case events.Planned():
            return replace(state, planned=event)
        case Questioned():
            return replace(_give_up(state), pending=event)
        case events.Taken():
            return _accept(_give_up(state), event)
        case events.Answered(keep=False):
            return _give_up(state)
        case events.Answered() if state.pending is not None:
            kept = _accept(replace(state, pending=None), state.pending)
            moved = ((state.pending.step, state.count),) if event.moved else ()
            return replace(kept, moved=(*kept.moved, *moved))
        case events.Undone():
            return _undo(_give_up(state))
        case events.Retake():
            return _retake(_give_up(state), event)
        case events.Skipped():
            now = _give_up(state)
            return replace(now, skipped={**now.skipped, event.step: event.reason}, before=state)
        case events.Noted():
            return replace(state, notes=(*state.notes, (event.step, event.text)))
        case events.Shortened():
            unmeasured = frozenset(event.drop) | state.dropped
            return replace(state, dropped=unmeasured, shortened=event)
        case events.Ended():
            return replace(state, ended=event)
        case events.Reopened():
            ended = state if state.ended else state.reopened
            return replace(state, source=event.source, ended=None, reopened=ended)
        case _:
            return state


def _without(steps: Mapping[int, Value], gone: Collection[int]) -> dict[int, Value]:
    return {step: value for step, value in steps.items() if step not in gone}


def _accept(state: State, take: Arrived) -> State:
    accepted = _without(state.accepted, {take.step})
    accepted[take.step] = Accepted(take, state.count)
    skipped = _without(state.skipped, {take.step})
    return replace(state, accepted=accepted, skipped=skipped, before=state)


def _give_up(state: State) -> State:
    """A questioned reading that nobody kept is replaced by what comes next."""
    if state.pending is None:
        return state
    old = Replaced(state.pending, f"read again: {state.pending.question}")
    return replace(state, pending=None, replaced=(*state.replaced, old))


def _retake(state: State, event: events.Retake) -> State:
    again = set(event.steps)
    dropped = state.dropped - again
    old = (Replaced(item.take, event.reason) for n, item in state.accepted.items() if n in again)
    return replace(
        state,
        accepted=_without(state.accepted, again),
        skipped=_without(state.skipped, again),
        dropped=dropped,
        shortened=state.shortened if dropped else None,
        replaced=(*state.replaced, *old),
        before=state,
    )


def _undo(state: State) -> State:
    """Back to before the last acceptance, skip or retake; what it added counts as replaced."""
    then = state.before
    if then is None:
        return state
    taken_back = (
        Replaced(item.take, "taken back")
        for step, item in state.accepted.items()
        if then.accepted.get(step) != item
    )
    restored = {id(item.take) for item in then.accepted.values()}
    kept = (item for item in state.replaced if id(item.take) not in restored)
    return replace(
        state,
        accepted=then.accepted,
        skipped=then.skipped,
        dropped=then.dropped,
        moved=then.moved,
        shortened=then.shortened,
        replaced=(*kept, *taken_back),
        before=then.before,
    )
