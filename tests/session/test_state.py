"""Laws of the fold, over random records: no reading vanishes, and undo goes back."""

import pytest

from orthoglide_cal.session.events import (
    Answered,
    Arrived,
    Retake,
    Skipped,
    State,
    Taken,
    Undone,
    advance,
    replay,
)

from .virtual import opened, random_events

seeds = pytest.mark.parametrize("seed", range(8))


@seeds
def test_no_reading_ever_vanishes(seed: int) -> None:
    """Every value that arrived is accepted, replaced or waiting for an answer, exactly once."""
    state = replay([opened()])
    arrived: list[Arrived] = []
    for event in random_events(seed + 100, 80):
        state = advance(state, event)
        arrived += [event] if isinstance(event, Arrived) else []
        held = [item.take for item in state.accepted.values()]
        held += [take for take, _ in state.replaced]
        held += [state.pending] if state.pending else []
        assert sorted(map(id, held)) == sorted(map(id, arrived))
        for step in range(1, 9):
            assert state.takes(step) == sum(take.step == step for take in arrived)


@seeds
def test_undo_goes_back_one_thing_at_a_time(seed: int) -> None:
    """Before the last reading, retake or skip; what was dropped since comes back with it."""
    state, before = replay([opened()]), []
    for event in random_events(seed, 80):
        kept = isinstance(event, Answered) and event.keep and state.pending
        if kept or isinstance(event, Taken | Retake | Skipped):
            before.append(what_counts(state))
        moved, state = state.moved, advance(state, event)
        if kept and event.moved:
            assert [step for step, _ in state.moved[len(moved) :]] == [kept.step]
        if isinstance(event, Undone) and before:
            assert what_counts(state) == before.pop()


def what_counts(state: State) -> tuple[object, ...]:
    return state.accepted, state.skipped, state.dropped, state.moved
