"""Live checks: blunders are questioned at the very reading, healthy sessions are left alone."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import PlannedReading
from orthoglide_cal.planning.steps import MeasuringProtocol, SessionStep
from orthoglide_cal.session.events import Answered, Doubt, Event, Taken, advance
from orthoglide_cal.session.readings import (
    RARE,
    ReadingsSoFar,
    check,
    check_divisions,
    check_range,
    check_reading,
    check_repeats,
)
from orthoglide_cal.words import Unit
from tests import truth
from tests.inference.sessions import model_of
from tests.machines import PROTOTYPE

from .virtual import (
    AT,
    DOUBLE,
    SINGLE,
    both_protocols,
    play,
    questioned,
    read_next,
    readings_of,
    state_of,
    steps_of,
    taken,
)


def right(protocol: MeasuringProtocol = DOUBLE) -> tuple[tuple[SessionStep, ...], list[float]]:
    """The steps of a session and its readings, none of which is questioned."""
    steps = steps_of(protocol)
    return steps, readings_of(steps, 3)


@both_protocols
def test_right_readings_are_not_questioned(protocol: MeasuringProtocol) -> None:
    steps, values = right(protocol)
    assert play(values, steps) == []


def slip(turns: int) -> Callable[[float], float]:
    return lambda value: value + turns


def turned(value: float) -> float:
    return -value


def tenfold(value: float) -> float:
    return 10.0 * value


@pytest.mark.parametrize(
    ("protocol", "at", "wrong", "doubts", "words"),
    [
        # A cell that was read before: leg x, y, z at max, min, iso.
        *((DOUBLE, at, slip(turns), {Doubt.REVOLUTION}, f"revolution{'s' * (turns < -1)}?")
          for at in (8, 33, 58) for turns in (-2, 1)),
        # In the last leg's first cycle nothing was: the prediction from the other legs finds it.
        *((DOUBLE, at, slip(1), {Doubt.REVOLUTION}, "expected") for at in (42, 43, 44, 45)),
        *((DOUBLE, at, turned, {Doubt.SIGN, Doubt.EXCHANGED, Doubt.REVOLUTION}, "opposite sign")
          for at in (9, 28, 46, 56)),
        (DOUBLE, 7, tenfold, {Doubt.POINT}, "decimal point"),
        # Whatever else it contradicts.
        (DOUBLE, 8, slip(45), {Doubt.RANGE}, "than the gauge's travel of 10 mm"),
        (SINGLE, 9, slip(1), {Doubt.REVOLUTION}, "one revolution"),
    ],
)  # fmt: skip
def test_one_wrong_reading(
    protocol: MeasuringProtocol,
    at: int,
    wrong: Callable[[float], float],
    doubts: set[Doubt],
    words: str,
) -> None:
    steps, values = right(protocol)
    # Of a reading that is almost zero right and wrong would be the same.
    assert wrong not in (turned, tenfold) or abs(values[at]) >= 0.05
    values[at] = wrong(values[at])
    ((number, question),) = play(values, steps, questions=1, begin=at)
    assert number == at + 1
    assert question.doubt in doubts
    assert words in question.text


@pytest.mark.parametrize(
    ("seed", "at", "wrong", "words"),
    [(48, 31, slip(1), "one revolution?"), (62, 22, tenfold, "decimal point misplaced?")],
)
def test_an_explanation_that_fits_far_worse_is_not_named(
    seed: int, at: int, wrong: Callable[[float], float], words: str
) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    values[at] = wrong(values[at])
    ((_, question),) = play(values, steps, questions=1, begin=at)
    assert question.text.partition(": ")[2] == words


@pytest.mark.parametrize("at", [8, 14, 28, 34, 48, 54])
def test_gauges_exchanged_at_a_posture(at: int) -> None:
    """The upper limit of each leg, in the second and the third cycle."""
    steps, values = right()
    values[at], values[at + 1] = values[at + 1], values[at]
    assert abs(values[at] - values[at + 1]) >= 0.1  # else nobody could tell
    asked = play(values, steps, questions=2, begin=at)
    assert [number for number, _ in asked] == [at + 1, at + 2]
    assert all("are the two gauges exchanged" in question.text for _, question in asked)


@pytest.mark.parametrize(
    ("protocol", "at", "size"),
    [*((DOUBLE, at, size) for at in (7, 29, 53) for size in (0.1, -0.6)), (SINGLE, 9, 0.12)],
)
def test_a_knocked_stand(protocol: MeasuringProtocol, at: int, size: float) -> None:
    steps, values = right(protocol)
    series = steps[at].cell.series
    knocked = [
        v + size if i >= at and steps[i].cell.series == series else v for i, v in enumerate(values)
    ]
    ((number, question),) = play(knocked, steps, questions=1, begin=at)
    assert number == at + 1
    last = [s.number for s in steps[:at] if s.cell.series == series][-1]
    assert re.search(f"the stand (seems to have )?moved since step {last}", question.text)


@pytest.mark.parametrize(("at", "slip_mm", "knock_mm"), [(8, 1.0, 0.0), (28, 0.0, 0.2)])
def test_a_kept_blunder_is_not_asked_about_again(at: int, slip_mm: float, knock_mm: float) -> None:
    """One question for a slip or a knock, none for the good readings that follow it."""
    steps, values = right()
    values[at] += slip_mm
    for index in range(at, len(steps)):
        values[index] += knock_mm * (steps[index].cell.series == steps[at].cell.series)
    assert [number for number, _ in play(values, steps, begin=at)] == [at + 1]


@pytest.mark.parametrize(
    ("value", "inches", "doubt"),
    [
        (0.12, False, None), (-9.99, False, None), (0.0, False, None), (10.01, False, Doubt.RANGE),
        (-310.0, False, Doubt.RANGE), (0.123, False, Doubt.GRID), (0.125, False, Doubt.GRID),
        (0.0127, True, None), (0.1, True, None),
    ],
)  # fmt: skip
def test_numbers_that_the_gauge_cannot_show(
    value: float, inches: bool, doubt: Doubt | None
) -> None:
    state = state_of([])
    unit = Unit.INCH if inches else Unit.MM
    question = check(read_next(state, steps_of(), 0, 0.0, value), unit)
    assert (question.doubt if question else None) == doubt


@pytest.mark.parametrize("unit", Unit)
def test_every_question_speaks_in_the_unit_of_the_reading(unit: Unit) -> None:
    """In inches, with mm in brackets behind; the reading itself is the same one."""
    steps, values = right()
    steady = [taken(step.number, 0.0, step.number / 5.0) for step in steps[:49]]

    inches = PROTOTYPE.changed(gauge=PROTOTYPE.gauge.changed(resolution_mm=0.0254))

    def coming(
        before: list[Taken], index: int, value: float, machine: Machine = PROTOTYPE
    ) -> ReadingsSoFar:
        return read_next(state_of(before), steps, index, index / 5.0, value, machine)

    read = [taken(n, value, n / 5.0) for n, value in enumerate(values, start=1)]
    asked = [
        check_range(coming([], 0, 12.7), unit),
        check_range(coming(read[:2], 2, 12.7), unit),
        check_divisions(coming([], 0, 0.0137, inches), unit),
        check_reading(coming(read[:9], 9, values[9] + 0.3), unit),
        check_reading(coming(read[:50], 50, values[50] + 1.0), unit),
        check_repeats(coming(steady, 49, 0.001), unit),
    ]
    texts = [question.text for question in asked if question]
    assert len(texts) == len(asked)
    for text in texts:
        bare = re.sub(r" in \([^()]* mm\)", "", text)
        assert ("mm" in bare) == (unit is Unit.MM), text
    shown = {Unit.MM: "+12.7 mm is beyond", Unit.INCH: "+0.5 in (+12.7 mm) is beyond"}
    assert shown[unit] in texts[0]


@pytest.mark.parametrize(
    ("before", "index", "near", "far"),
    [
        # A preset that was confirmed once moves the range with it.
        (
            [questioned(taken(1, 100.0), Doubt.RANGE, "?"), Answered(at=AT, keep=True)],
            2,
            100.4,
            0.4,
        ),
        # No further than the travel of 10 mm from any reading; from the last one it would not be.
        ([taken(1, 6.0), taken(3, 0.0)], 4, -3.5, -4.5),
    ],
)
def test_the_range_is_that_of_the_readings_before(
    before: list[Event], index: int, near: float, far: float
) -> None:
    fine, doubtful = (
        check_range(read_next(state_of(before), steps_of(), index, 0.8, value), Unit.MM)
        for value in (near, far)
    )
    assert fine is None
    assert doubtful.doubt is Doubt.RANGE


def test_a_gauge_that_always_shows_the_same() -> None:
    """Asked once, then believed; each of its numbers alone is a possible one."""
    steps, values = right()
    first: dict[object, float] = {}
    held = [first.setdefault(step.cell, value) for step, value in zip(steps, values, strict=True)]
    asked = [question for _, question in play(held, steps)]
    assert [question.doubt for question in asked] == [Doubt.DEAD]
    assert "never differ" in asked[0].text


def test_inches_typed_as_mm() -> None:
    """Each number is questioned until one is kept; then it is their scatter, once."""
    steps, values = right()
    inches = [round(value / 25.4, 4) for value in values]
    doubts = [question.doubt for _, question in play(inches, steps)]
    assert doubts == [Doubt.GRID, Doubt.SCATTER]


def healthy_values(
    steps: tuple[SessionStep, ...], sessions: int, machine: Machine, seed: int
) -> np.ndarray:
    """Readings of healthy sessions at the gauge's stated repeatability, (sessions, steps)."""
    rng = np.random.default_rng(seed)
    plan = PlannedReading.planned([s.cell for s in steps])
    offsets = rng.normal(0.0, 1.0, (sessions, 3))
    zeros = rng.uniform(-2.5, 2.5, (sessions, 3, 3))
    exact = simulate(Model(machine), offsets, plan) + zeros[:, plan.leg, plan.direction]
    gauge = machine.gauge
    noisy = exact + rng.normal(0.0, gauge.repeatability_mm, exact.shape)
    return np.round(noisy / gauge.resolution_mm) * gauge.resolution_mm


@pytest.mark.parametrize(("protocol", "gauge"), [(DOUBLE, truth.DIAL), (SINGLE, truth.MICRON)])
def test_fewer_than_one_healthy_session_in_a_hundred_is_ever_questioned(
    protocol: MeasuringProtocol, gauge: truth.Gauge
) -> None:
    """1,000 healthy sessions through the very decision of `check_reading`, all at once.

    By construction about one session in a thousand has a false question; if it were one in 400,
    this test would fail by chance once in 40,000 runs.
    """
    machine = model_of(truth.PROTOTYPE, gauge).machine
    steps = steps_of(protocol)
    values = healthy_values(steps, 1000, machine, seed=11)
    state = state_of([])
    false = np.zeros(len(values), dtype=bool)
    for index, step in enumerate(steps):
        minutes = 0.2 * index + 4.0 * (step.setup - 1)
        now = read_next(state, steps, index, minutes, 0.0, machine)
        assert now.sigma_mm == machine.gauge.noise_mm
        if now.series:
            false |= now.prediction(values[:, now.past].T).tail(values[None, :, index])[0] < RARE
        for value in values[:20, index].tolist():
            now = read_next(state, steps, index, minutes, value, machine)
            assert check_range(now, Unit.MM) is check_divisions(now, Unit.MM) is None
        state = advance(state, taken(step.number, 0.0, minutes))
    assert false.sum() < 10


@pytest.mark.parametrize(
    ("machine", "gauge", "hidden"),
    [
        (truth.PROTOTYPE, truth.DIAL, ()),
        (truth.LARGE, truth.MICRON, ("axis_gap",)),
        (truth.PROTOTYPE, truth.DIAL, ("bar_skew",)),
        (truth.LARGE, truth.MICRON, ("backlash",)),
    ],
)
def test_sessions_of_an_independent_truth_are_left_alone(
    gauge: truth.Gauge, machine: truth.Machine, hidden: tuple[str, ...]
) -> None:
    """Also on machines that are imperfect within their tolerances, with times of a real pace."""
    session = truth.make_session(0, machine, gauge, hidden, offset_sd=1.0)
    asked = play(
        session.readings.tolist(),
        steps_of(),
        model_of(machine, gauge).machine,
        session.plan.minutes.tolist(),
    )
    assert asked == []
