"""The sequences of steps: every cell, in the right order, with the right targets."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from orthoglide_cal.model.orthoglide import PlannedReading
from orthoglide_cal.model.readings import Contact
from orthoglide_cal.planning.steps import (
    MINUTES_PER_TURN,
    GuidedSession,
    MeasuringProtocol,
    Order,
    SessionStep,
    clock,
    gauge_moves,
    steps_of,
)
from tests.machines import PROTOTYPE
from tests.session.virtual import DOUBLE, SINGLE, both_protocols


def usual(
    protocol: MeasuringProtocol, cycles: int, order: Order = Order.PAPER, stands: int = 2
) -> tuple[SessionStep, ...]:
    return GuidedSession(protocol=protocol, cycles=cycles, order=order, stands=stands).steps(
        PROTOTYPE
    )


def test_the_double_posture_session_is_that_of_section_4_1() -> None:
    steps = usual(DOUBLE, 3)
    assert [s.number for s in steps] == list(range(1, 61))
    visited = [s.posture for s in steps[:20:2]]
    assert visited == ["iso", "max", "min"] * 3 + ["iso"]
    assert [s.leg for s in steps] == [0] * 20 + [1] * 20 + [2] * 20
    assert [(s.leg, s.direction) for s in steps[18:22]] == [(0, 1), (0, 2), (1, 0), (1, 2)]
    assert {s.setup for s in steps} == {1, 2, 3}
    assert [s.stand for s in steps[:4]] == [0, 1, 0, 1]
    assert [s.cycle for s in steps[18:20]] == [4, 4]
    assert all(s.cell.contact is Contact.FIXED for s in steps)


@both_protocols
@pytest.mark.parametrize("order", list(Order))
@pytest.mark.parametrize("stands", [1, 2])
@pytest.mark.parametrize("cycles", [1, 3])
def test_orders_hold_the_same_readings(
    protocol: MeasuringProtocol, order: Order, stands: int, cycles: int
) -> None:
    paper, steps = usual(protocol, cycles), usual(protocol, cycles, order, stands)
    assert Counter((*s.cell, s.cycle) for s in steps) == Counter((*s.cell, s.cycle) for s in paper)
    assert [s.number for s in steps] == list(range(1, len(steps) + 1))
    for cell in {s.cell for s in steps}:
        repeats = [s.cycle for s in steps if s.cell == cell]
        assert repeats == sorted(repeats)
    # What a journal holds of a plan gives the same steps again.
    plan = PlannedReading.planned([s.cell for s in steps])
    assert plan.in_time.tolist() == list(range(len(steps)))
    assert steps_of(plan, PROTOTYPE, order, stands) == steps
    # Every drive has its block, in the order of the steps.
    driven = [(s.setup, s.leg, s.posture, s.cycle) for s in steps]
    changes = np.cumsum([0, *(one != other for one, other in pairwise(driven))])
    assert [s.block for s in steps] == (10 * (changes + 1)).tolist()


def test_fewest_moves_moves_the_gauge_less() -> None:
    paper = usual(SINGLE, 3, Order.PAPER, 1)
    fewest = usual(SINGLE, 3, Order.FEWEST_MOVES, 1)
    assert gauge_moves(paper) == 39
    assert gauge_moves(fewest) == 3
    # Two gauges stay at their places for a whole leg anyway; one gauge has six places.
    assert gauge_moves(usual(DOUBLE, 3)) == 4
    assert gauge_moves(usual(DOUBLE, 3, stands=1)) == 5


def of_readings(
    *readings: PlannedReading, order: Order = Order.PAPER, stands: int = 2
) -> tuple[SessionStep, ...]:
    return steps_of(PlannedReading.planned(readings), PROTOTYPE, order, stands)


def both(leg: int, displacement: float, **other: object) -> list[PlannedReading]:
    """A leg's two readings at a posture."""
    return [
        PlannedReading(leg, direction, displacement, Contact.FIXED, **other)  # type: ignore[arg-type]
        for direction in range(3)
        if direction != leg
    ]


def test_steps_of_any_plan_carry_what_is_read() -> None:
    readings = [
        *both(0, 30.0, gauge_at=0.3),
        *both(0, -100.0, gauge_at=0.3),
        *both(0, 30.0, gauge_at=0.3, entered=(0.5, 0.0, 0.0)),
        *both(0, 30.0, gauge_at=0.7),
        *both(1, 0.0, part=1, turned=True),
        *both(0, 30.0, gauge_at=0.3, part=1),
    ]
    steps = of_readings(*readings)
    assert [s.cell for s in steps] == readings
    assert [s.posture for s in steps[::2]] == ["30", "min", "30", "30", "iso", "30"]
    # Another place along the leg, and another part, are new set-ups; what is entered is not.
    assert [s.setup for s in steps[::2]] == [1, 1, 1, 2, 3, 4]
    assert {s.cycle for s in steps} == {1}
    assert [s.block for s in steps] == [10, 10, 20, 20, 30, 30, 40, 40, 50, 50, 60, 60]
    assert steps[0].name == "leg X, +30 mm, cycle 1, gauge Y"
    # Turn one bar; three moves to another set-up. What is commanded short takes no time.
    assert clock(steps)[-1] == pytest.approx(6 * 0.4 + 3 * 4.0 + MINUTES_PER_TURN)


def test_one_gauge_takes_each_set_up_of_any_plan_alone() -> None:
    readings = [*both(0, 30.0), *both(0, 0.0), *both(0, 30.0, part=1), *both(0, 0.0, part=1)]
    steps = of_readings(*readings, stands=1)
    assert [(s.cell.part, s.direction) for s in steps[::2]] == [(0, 1), (0, 2), (1, 1), (1, 2)]
    assert [s.setup for s in steps] == [1, 1, 2, 2, 3, 3, 4, 4]
    again = of_readings(*(s.cell for s in steps), stands=1)
    assert again == steps
