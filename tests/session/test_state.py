"""Laws of the fold: undo, retake, skip, questions, and that replaying is all there is."""

import numpy as np
import pytest

from orthoglide_cal.session.events import (
    Answered,
    Arrived,
    Doubt,
    Event,
    Questioned,
    Retake,
    Skipped,
    State,
    Taken,
    Undone,
    advance,
    replay,
)

from .virtual import AT, opened, questioned, random_events, state_of, taken


def after(*events: Event) -> State:
    return state_of(events)


def asked(step: int, value: float) -> Questioned:
    return questioned(taken(step, value), Doubt.STAND, "really?")


@pytest.mark.parametrize("seed", range(20))
def test_no_reading_ever_vanishes(seed: int) -> None:
    """Every value that arrived is accepted, replaced or waiting for an answer, exactly once."""
    events = random_events(np.random.default_rng(seed + 100), 80)
    state = replay([opened()])
    arrived: list[float] = []
    for event in events:
        if isinstance(event, Arrived):
            # A second reading of an accepted step is only possible after a retake or an undo.
            if not state.is_open(event.step):  # type: ignore[attr-defined]
                continue
            arrived.append(event.value_mm)  # type: ignore[attr-defined]
        state = advance(state, event)
        held = [item.take.value_mm for item in state.accepted.values()]
        held += [item.take.value_mm for item in state.replaced]
        held += [state.pending.value_mm] if state.pending else []
        assert sorted(held) == sorted(arrived)


@pytest.mark.parametrize("seed", range(20))
def test_undo_goes_back_one_thing_at_a_time(seed: int) -> None:
    """Before the last reading, retake or skip; what was dropped since comes back with it."""
    state, before = replay([opened()]), []
    for event in random_events(np.random.default_rng(seed), 80):
        if isinstance(event, Arrived) and not state.is_open(event.step):
            continue
        kept = isinstance(event, Answered) and event.keep and state.pending
        if kept or isinstance(event, Taken | Retake | Skipped):
            before.append(what_counts(state))
        moved, state = state.moved, advance(state, event)
        if kept and event.moved:
            assert [step for step, _ in state.moved[len(moved) :]] == [kept.step]
        if isinstance(event, Undone) and before:
            assert what_counts(state) == before.pop()


def what_counts(state: State) -> tuple[object, ...]:
    return state.accepted, state.skipped, state.dropped, state.moved, state.shortened


def test_takes_counts_every_reading_of_a_step_once() -> None:
    events = [
        asked(1, 0.1),
        Answered(at=AT, keep=False),
        taken(1, 0.2),
        Retake(at=AT, steps=(1,), reason="why"),
    ]
    assert [after(*events[:count]).takes(1) for count in range(5)] == [0, 1, 1, 2, 2]
    assert after(*events, Undone(at=AT)).takes(1) == 2
