"""Live checks: every blunder is questioned at the very reading where it happens."""

import re
from dataclasses import replace

import pytest

from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.session.checks import check_number, check_reading, check_repeats
from orthoglide_cal.session.events import Answered, Doubt, Taken
from orthoglide_cal.session.readings import NextReading
from orthoglide_cal.session.state import advance
from orthoglide_cal.words import Unit
from tests.machines import PROTOTYPE

from .virtual import AT, SINGLE, compared, play, questioned, readings_of, state_of, steps_of, taken

SEEDS = (1, 3)


def first_question(values: list[float], steps: tuple[SessionStep, ...]) -> tuple[int, Doubt, str]:
    asked = play(values, steps, questions=1)
    assert asked, "no question at all"
    number, question = asked[0]
    return number, question.doubt, question.text


def index_of(
    steps: tuple[SessionStep, ...], leg: int, direction: int, posture: str, cycle: int
) -> int:
    wanted = (leg, direction, posture, cycle)
    found = [s.number for s in steps if (s.leg, s.direction, s.posture, s.cycle) == wanted]
    return found[0] - 1


@pytest.mark.parametrize("seed", [3])
@pytest.mark.parametrize("turns", [-2, 1])
@pytest.mark.parametrize("cell", [(0, 1, "max", 2), (1, 2, "min", 3), (2, 0, "iso", 4)])
def test_a_miscounted_revolution(seed: int, turns: int, cell: tuple[int, int, str, int]) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    at = index_of(steps, *cell)
    values[at] += turns
    number, doubt, text = first_question(values, steps)
    assert (number, doubt) == (at + 1, Doubt.REVOLUTION)
    assert "revolution" in text
    assert text.startswith(f"{abs(values[at] - values[at - 6]):.2f}"[:3])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("at", [43, 44, 45, 46])
def test_a_miscounted_revolution_in_the_first_cycle_of_the_last_leg(seed: int, at: int) -> None:
    """Nothing was read there before: the model's prediction from the other legs finds it."""
    steps = steps_of()
    values = readings_of(steps, seed)
    values[at - 1] += 1.0
    number, doubt, text = first_question(values, steps)
    assert (number, doubt) == (at, Doubt.REVOLUTION)
    assert "expected" in text


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("at", [10, 29, 47, 57])
def test_one_reading_with_the_opposite_sign(seed: int, at: int) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    if abs(values[at - 1]) < 0.05:
        pytest.skip("almost zero: both signs are the same")
    values[at - 1] *= -1.0
    number, doubt, text = first_question(values, steps)
    assert number == at
    assert "opposite sign" in text
    assert doubt in (Doubt.SIGN, Doubt.EXCHANGED, Doubt.REVOLUTION)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_opposite_sign_from_the_second_cycle_on(seed: int) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    at = index_of(steps, 1, 0, "iso", 2)
    flipped = [-v if i >= at and steps[i].series == (1, 0) else v for i, v in enumerate(values)]
    number, _, text = first_question(flipped, steps)
    assert number == at + 1
    assert "opposite sign" in text


@pytest.mark.parametrize("seed", [1, 3])
def test_a_gauge_with_the_opposite_sign_for_a_whole_leg(seed: int) -> None:
    """It can only show once the offsets are known and a second posture is read."""
    steps = steps_of()
    values = readings_of(steps, seed)
    flipped = [-v if steps[i].series == (2, 0) else v for i, v in enumerate(values)]
    number, doubt, text = first_question(flipped, steps)
    assert number in (43, 45)
    assert doubt is Doubt.SIGN
    assert "gauge X with the opposite sign since step 41" in text


@pytest.mark.parametrize("seed", [3])
@pytest.mark.parametrize("leg", [0, 1, 2])
@pytest.mark.parametrize("cycle", [2, 3])
def test_gauges_exchanged_at_a_posture(seed: int, leg: int, cycle: int) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    first, second = (d for d in range(3) if d != leg)
    a, b = (index_of(steps, leg, d, "max", cycle) for d in (first, second))
    values[a], values[b] = values[b], values[a]
    if abs(values[a] - values[b]) < 0.1:
        pytest.skip("both gauges read nearly the same here")
    asked = play(values, steps, questions=2)
    assert [number for number, _ in asked] == [a + 1, b + 1]
    assert all("are the two gauges exchanged" in question.text for _, question in asked)


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_gauges_exchanged_for_a_whole_leg(seed: int) -> None:
    """From its first reading on; the readings of the first cycle together show it.

    Where both gauges of a leg read nearly the same all the time, as with seed 2, nothing can.
    """
    steps = steps_of()
    values = readings_of(steps, seed)
    for at in range(40, 60, 2):
        values[at], values[at + 1] = values[at + 1], values[at]
    number, doubt, text = first_question(values, steps)
    assert 43 <= number <= 46
    assert doubt is Doubt.EXCHANGED
    assert "are the two gauges exchanged since step 41" in text


@pytest.mark.parametrize("seed", [3])
@pytest.mark.parametrize("size", [0.1, -0.6])
@pytest.mark.parametrize("cell", [(0, 2, "iso", 2), (1, 0, "min", 2), (2, 1, "max", 3)])
def test_a_knocked_stand(seed: int, size: float, cell: tuple[int, int, str, int]) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    at = index_of(steps, *cell)
    series = steps[at].series
    for i in range(at, 60):
        if steps[i].series == series:
            values[i] += size
    number, _, text = first_question(values, steps)
    assert number == at + 1
    last = [s.number for s in steps[:at] if s.series == series][-1]
    assert f"the stand seems to have moved since step {last}" in text or (
        f"has the stand moved since step {last}" in text
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_decimal_point_in_the_wrong_place(seed: int) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    at = next(i for i in range(6, 60) if steps[i].cycle > 1 and abs(values[i]) > 0.3)
    values[at] *= 10.0
    number, doubt, text = first_question(values, steps)
    assert (number, doubt) == (at + 1, Doubt.POINT)
    assert "decimal point" in text


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("blunder", ["revolution", "stand"])
def test_blunders_in_the_single_posture_protocol(seed: int, blunder: str) -> None:
    steps = steps_of(SINGLE)
    values = readings_of(steps, seed)
    at = 9  # leg x, max, cycle 2, tool end
    if blunder == "revolution":
        values[at] += 1.0
    else:
        values = [v + 0.12 if i >= at and steps[i].leg == 0 else v for i, v in enumerate(values)]
    number, _, text = first_question(values, steps)
    assert number == at + 1
    assert ("one revolution" if blunder == "revolution" else "stand") in text


@pytest.mark.parametrize("seed", SEEDS)
def test_a_kept_blunder_is_not_asked_about_again(seed: int) -> None:
    """One question for the slip, none for the good readings of that gauge that follow it."""
    steps = steps_of()
    values = readings_of(steps, seed)
    at = index_of(steps, 0, 1, "max", 2)
    values[at] += 1.0
    assert [number for number, _ in play(values, steps)] == [at + 1]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_kept_knock_is_asked_about_once(seed: int) -> None:
    steps = steps_of()
    values = readings_of(steps, seed)
    at = index_of(steps, 1, 0, "max", 2)
    knocked = [
        v + 0.2 if i >= at and steps[i].series == (1, 0) else v for i, v in enumerate(values)
    ]
    assert [number for number, _ in play(knocked, steps)] == [at + 1]


def test_after_a_stand_was_declared_moved_the_same_shape_is_expected_with_a_new_zero() -> None:
    steps = steps_of()
    values = readings_of(steps)
    at = index_of(steps, 0, 1, "iso", 2)
    state = state_of([taken(k + 1, values[k], 0.2 * k) for k in range(at)])
    moved = questioned(taken(at + 1, values[at] + 2.0, 0.2 * at), Doubt.STAND, "stand?")
    state = advance(advance(state, moved), Answered(at=AT, keep=True, moved=True))
    index = at + 2  # max of cycle 2, by the same gauge
    past = compared(state, steps, index, 0.2 * index)
    prediction = past.forecast.predict(past.so_far.value[past.past], past.past, len(past.steps) - 1)
    assert float(prediction.std) < 0.03
    assert check_reading(past, values[index] + 2.0, PROTOTYPE.gauge) is None


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
    past = replace(compared(state, steps_of(), 0, 0.0), unit=unit)
    question = check_number(past, value, PROTOTYPE.gauge)
    assert (question.doubt if question else None) == doubt


@pytest.mark.parametrize("unit", Unit)
def test_every_question_speaks_in_the_unit_of_the_reading(unit: Unit) -> None:
    """In inches, with mm in brackets behind; the reading itself is the same one."""
    steps = steps_of()
    values = readings_of(steps, 3)
    steady = [taken(step.number, 0.0, step.number / 5.0) for step in steps[:39]]

    def coming(taken_before: list[Taken], index: int) -> NextReading:
        return replace(compared(state_of(taken_before), steps, index, index / 5.0), unit=unit)

    read = [taken(n, value, n / 5.0) for n, value in enumerate(values, start=1)]
    gauge = PROTOTYPE.gauge
    asked = [
        check_number(coming([], 0), 12.7, gauge),
        check_number(coming(read[:2], 2), 12.7, gauge),
        check_number(coming([], 0), 0.0137, gauge.changed(resolution_mm=0.0254)),
        check_reading(coming(read[:9], 9), values[9] + 0.3, gauge),
        check_reading(coming(read[:50], 50), values[50] + 1.0, gauge),
        check_repeats(coming(steady, 39), 0.001, gauge),
    ]
    texts = [question.text for question in asked if question]
    assert len(texts) == len(asked)
    for text in texts:
        bare = re.sub(r" in \([^()]* mm\)", "", text)
        assert ("mm" in bare) == (unit is Unit.MM), text
    shown = {Unit.MM: "+12.7 mm is beyond", Unit.INCH: "+0.5 in (+12.7 mm) is beyond"}
    assert shown[unit] in texts[0]


def test_a_finer_scale_that_was_confirmed_once_is_believed() -> None:
    fine = questioned(taken(1, 0.125), Doubt.GRID, "mistyped?")
    state = state_of([fine, Answered(at=AT, keep=True)])
    past = compared(state, steps_of(), 1, 0.2)
    assert check_number(past, 0.345, PROTOTYPE.gauge) is None


def test_a_preset_that_was_confirmed_once_moves_the_range_with_it() -> None:
    preset = questioned(taken(1, 100.0), Doubt.RANGE, "mistyped?")
    state = state_of([preset, Answered(at=AT, keep=True)])
    past = compared(state, steps_of(), 2, 0.4)
    assert check_number(past, 100.4, PROTOTYPE.gauge) is None
    far = check_number(past, 0.4, PROTOTYPE.gauge)
    assert far is not None
    assert far.doubt is Doubt.RANGE


@pytest.mark.parametrize("seed", SEEDS)
def test_a_gauge_that_always_shows_the_same(seed: int) -> None:
    """Asked once, then believed; each of its numbers alone is a possible one."""
    steps = steps_of()
    values = readings_of(steps, seed)
    first: dict[object, float] = {}
    held = [first.setdefault(step.cell, value) for step, value in zip(steps, values, strict=True)]
    asked = [question for _, question in play(held, steps)]
    assert [question.doubt for question in asked] == [Doubt.DEAD]
    assert "never differ" in asked[0].text


@pytest.mark.parametrize("seed", SEEDS)
def test_inches_typed_as_mm(seed: int) -> None:
    """Each number is questioned until one is kept; then it is their scatter, once."""
    steps = steps_of()
    inches = [round(value / 25.4, 4) for value in readings_of(steps, seed)]
    doubts = [question.doubt for _, question in play(inches, steps)]
    assert doubts == [Doubt.GRID, Doubt.SCATTER]
