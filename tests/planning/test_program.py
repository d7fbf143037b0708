"""The posture program, run by an independent controller and compared with an independent machine.

Where the carriages belong and where the tool then is comes from `tests.truth`.
"""

from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import PostureError, UsageError
from orthoglide_cal.model.model import Model
from orthoglide_cal.planning.program import posture_program
from orthoglide_cal.planning.steps import MeasuringProtocol, Order
from tests.machines import NOMINAL, both_models
from tests.planning.programs import SESSION, gcode, ran, steps_of, true_tool, visits_of
from tests.truth.plan import joints_at

MICROMETRE = 1e-3
NAN = float("nan")
WIDE = (-150.0, 100.0)  # travel with room behind every posture of both machines
protocols = pytest.mark.parametrize(
    ("protocol", "order", "stands"),
    [
        # Its postures need not begin at the isotropic one, where the gauges are put up.
        (MeasuringProtocol.BEST, Order.PAPER, 2),
        (MeasuringProtocol.DOUBLE, Order.PAPER, 2),
        (MeasuringProtocol.DOUBLE, Order.PAPER, 1),
        (MeasuringProtocol.SINGLE, Order.PAPER, 1),
        (MeasuringProtocol.SINGLE, Order.FEWEST_MOVES, 1),
    ],
)


@both_models
@protocols
def test_every_block_stops_at_its_posture(
    model: Model, protocol: MeasuringProtocol, order: Order, stands: int, tmp_path: Path
) -> None:
    steps = steps_of(model, protocol, order, stands)
    length = model.machine.leg_length_mm
    done = ran(gcode(tmp_path, model, steps), length)
    visits = visits_of(steps)
    assert [wait.block for wait in done.readings] == [10 * k + 10 for k in range(len(visits))]
    assert [step.block for step in visits] == [wait.block for wait in done.readings]
    for wait, step in zip(done.readings, visits, strict=True):
        wanted = joints_at(length, step.leg, step.cell.displacement)
        np.testing.assert_allclose(wait.at, wanted, rtol=0.0, atol=MICROMETRE)
        assert wait.seconds is None
    # The gauges are put up at the isotropic posture.
    assert len(done.set_ups) == len({step.setup for step in steps})
    for wait in done.set_ups:
        np.testing.assert_allclose(wait.at, length, rtol=0.0, atol=MICROMETRE)


@both_models
@pytest.mark.parametrize("distance", [0.5, 1.0, 3.0])
def test_carriages_arrive_slowly_from_below(model: Model, distance: float, tmp_path: Path) -> None:
    """All of them where the travel allows it; else all but the one at its lower limit."""
    length, low = model.machine.leg_length_mm, model.machine.joint_limits_mm[0]
    for travel in (None, WIDE):
        text = gcode(tmp_path, model, approach_mm=distance, travel_mm=travel)
        for wait in ran(text, length).readings:
            way = wait.arrival.end - wait.arrival.start
            at_limit = np.isclose(wait.at - length, low) if travel is None else np.zeros(3, bool)
            expected = np.where(at_limit, -distance, distance)
            np.testing.assert_allclose(way, expected, rtol=0.0, atol=MICROMETRE)
            assert wait.arrival.feed == 100.0
        assert ("above" in text) == (travel is None)
        fast = {move.feed for move in ran(text, length).moves}
        assert fast == {100.0, 1000.0}


@both_models
def test_the_leg_stays_under_the_plunger_on_the_way(model: Model, tmp_path: Path) -> None:
    """Joints that move evenly over the whole travel would take the tool 10 mm off the axis."""
    approach, length = 1.0, model.machine.leg_length_mm
    shares = np.linspace(0.0, 1.0, 9)[:, None]
    for move in ran(gcode(tmp_path, model, approach_mm=approach), length).moves:
        joints = move.start + shares * (move.end - move.start)
        tool = np.sort(np.abs(true_tool(length, joints)), axis=0)
        assert tool[1].max() < 0.25 + 1.5 * approach


ROOM = r"N10: carriage X has no room for an approach of 100"
OUTSIDE = r"N20: carriage X would be driven to \+60 mm"
LIMITS = r"LOW must be below HIGH, and 0 between them"


@pytest.mark.parametrize(
    ("error", "said", "approach", "travel"),
    [
        (PostureError, ROOM, 100.5, (-100.0, 60.0)),
        (PostureError, OUTSIDE, 1.0, (-100.0, 50.0)),
        *((UsageError, "approach", wrong, None) for wrong in (0.0, -1.0, NAN, float("inf"))),
        *(
            (UsageError, LIMITS, 1.0, wrong)
            for wrong in ((5.0, 3.0), (10.0, 60.0), (-100.0, -5.0), (0.0, 0.0), (NAN, 60.0))
        ),
    ],
)
def test_limits_that_are_too_narrow_are_named(
    error: type[Exception], said: str, approach: float, travel: tuple[float, float] | None
) -> None:
    with pytest.raises(error, match=said):
        posture_program(NOMINAL, steps_of(NOMINAL), SESSION, approach, travel)
