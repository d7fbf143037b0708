"""Laws of the fold: undo, retake, skip, questions, and that replaying is all there is."""

import numpy as np
import pytest

from orthoglide_cal.session.events import (
    Answered,
    Arrived,
    Doubt,
    Event,
    Noted,
    Questioned,
    Reopened,
    Retake,
    Shortened,
    Skipped,
    State,
    Undone,
    advance,
    replay,
)

from .virtual import AT, opened, questioned, state_of, taken


def after(*events: Event) -> State:
    return state_of(events)


def asked(step: int, value: float) -> Questioned:
    return questioned(taken(step, value), Doubt.STAND, "really?")


def values(state: State) -> dict[int, float]:
    return {number: item.take.value_mm for number, item in state.accepted.items()}


def random_events(rng: np.random.Generator, count: int) -> list[Event]:
    """Records in any order, sensible or not."""
    events: list[Event] = []
    for _ in range(count):
        step = int(rng.integers(1, 9))
        value = round(float(rng.normal()), 2)
        events.append(
            [
                taken(step, value),
                asked(step, value),
                Answered(at=AT, keep=bool(rng.integers(2)), moved=bool(rng.integers(2))),
                Undone(at=AT),
                Retake(at=AT, steps=(step, step + 1), reason="why"),
                Skipped(at=AT, step=step, reason="why"),
                Noted(at=AT, step=step, text="note"),
                Reopened(at=AT, source=("simulated",)),
                Shortened(at=AT, drop=(step, 9), reason="known"),
            ][int(rng.choice(9, p=[0.4, 0.1, 0.1, 0.1, 0.1, 0.05, 0.05, 0.05, 0.05]))]
        )
    return events


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


def test_undo_after_a_retaken_reading_goes_back_one_thing_at_a_time() -> None:
    events = [taken(1, 0.1), taken(2, 0.2), Retake(at=AT, steps=(1,), reason="why"), taken(1, 0.15)]
    once = after(*events, Undone(at=AT))
    assert values(once) == {2: 0.2}
    assert {old.take.value_mm for old in once.replaced} == {0.1, 0.15}
    twice = after(*events, Undone(at=AT), Undone(at=AT))
    assert values(twice) == {1: 0.1, 2: 0.2}
    assert [old.take.value_mm for old in twice.replaced] == [0.15]


def test_a_moved_stand_is_remembered_and_undone_with_its_reading() -> None:
    state = after(taken(1, 0.1), asked(3, 0.9), Answered(at=AT, keep=True, moved=True))
    assert [step for step, _ in state.moved] == [3]
    assert advance(state, Undone(at=AT)).moved == ()


def test_takes_counts_every_reading_of_a_step_once() -> None:
    events = [
        asked(1, 0.1),
        Answered(at=AT, keep=False),
        taken(1, 0.2),
        Retake(at=AT, steps=(1,), reason="why"),
    ]
    assert [after(*events[:count]).takes(1) for count in range(5)] == [0, 1, 1, 2, 2]
    assert after(*events, Undone(at=AT)).takes(1) == 2


def test_undo_brings_dropped_steps_back() -> None:
    state = after(taken(1, 0.1), Shortened(at=AT, drop=(2, 3), reason="known"))
    assert not state.is_open(2)
    back = advance(state, Undone(at=AT))
    assert back.is_open(1)
    assert back.is_open(2)
    assert back.shortened is None
