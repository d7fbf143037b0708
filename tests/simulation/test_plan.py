"""Plans: frozen arrays, set-ups, time order, and where the carriages came from."""

import numpy as np
import pytest

from orthoglide_cal.effects import Commanded
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols import double_posture
from tests.machines import PROTOTYPE


def small_plan() -> Plan:
    """Four readings, given out of their order in time."""
    return Plan(
        leg=[0, 0, 1, 0],
        direction=[1, 1, 2, 2],
        displacement=[60.0, 0.0, -100.0, 60.0],
        contact=[Contact.FIXED] * 4,
        gauge_at=[0.5, 0.5, 0.4, 0.5],
        setup=[0, 0, 2, 1],
        order=[1, 0, 3, 2],
        hours=[0.1, 0.0, 0.3, 0.1],
    )


def test_arrays_are_read_only_copies() -> None:
    hours = np.zeros(4)
    plan = Plan(**{**{n: getattr(small_plan(), n) for n in Plan.__annotations__}, "hours": hours})
    hours[0] = 9.0
    assert plan.hours[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        plan.hours[0] = 1.0


def test_a_wrong_shape_names_the_array() -> None:
    parts = {name: getattr(small_plan(), name) for name in Plan.__annotations__}
    with pytest.raises(ValueError, match="hours has shape"):
        Plan(**{**parts, "hours": [0.0]})


def test_order_in_time_and_set_ups() -> None:
    plan = small_plan()
    assert plan.in_time.tolist() == [1, 0, 3, 2]
    assert plan.setups == 3
    assert plan.zeros.tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, 1], [0, 1, 0]]
    assert [plan.series_name(i) for i in range(4)] == ["y_x", "y_x", "z_y", "z_x"]
    assert plan.series().tolist() == [1, 1, 5, 2]


def test_a_subset_renumbers_its_set_ups() -> None:
    part = small_plan().subset(np.array([2, 3]))
    assert part.setup.tolist() == [1, 0]
    assert part.gauge_at.tolist() == [0.4, 0.5]
    assert part.setups == 2


def test_carriages_remember_their_last_motion() -> None:
    """Iso → max: x forward, y and z back; max → min: x back, y and z pass iso and end lower."""
    plan = double_posture(PROTOTYPE, cycles=1)
    approach = Commanded(PROTOTYPE, plan).approach
    assert approach[0:2].tolist() == [[0, 0, 0]] * 2
    assert approach[2:4].tolist() == [[1, -1, -1]] * 2
    assert approach[4:6].tolist() == [[-1, -1, -1]] * 2
    assert approach[6:8].tolist() == [[1, 1, 1]] * 2
    # The y-leg's first isotropic posture is where the x-leg's last one was: nothing moves.
    assert approach[8:10].tolist() == [[1, 1, 1]] * 2


def test_commanded_joints_put_the_nominal_tool_on_the_axis() -> None:
    plan = small_plan()
    joints = Commanded(PROTOTYPE, plan).joints
    length = PROTOTYPE.leg_length_mm
    assert joints[1].tolist() == [length] * 3
    assert joints[2] == pytest.approx(
        [np.sqrt(length**2 - 1e4), length - 100.0, np.sqrt(length**2 - 1e4)], abs=1e-12
    )
