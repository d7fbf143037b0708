"""Three rails in any position: both kinematics, their derivative, and what cannot be reached."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.errors import PostureError
from orthoglide_cal.model.kinematics import Points, trilaterate
from orthoglide_cal.model.machine import Machine
from tests.machines import NOMINAL, PROTOTYPE, both_machines
from tests.model.geometries import bent_rails, tool_positions

POINT = np.array([31.0, -47.0, 12.0])
L = PROTOTYPE.leg_length_mm


@both_machines
def test_bent_rails_keep_the_legs_as_long_as_they_are(machine: Machine) -> None:
    rails, tool = bent_rails(machine), tool_positions(machine)
    joints = rails.joints_for(tool)
    carriages = rails.points + joints[..., None] * rails.directions
    lengths = np.linalg.norm(tool[:, None, :] - carriages, axis=-1)
    assert np.abs(lengths - rails.lengths).max() < 1e-10
    # The carriages stand ahead of the tool, as the prototype's do.
    assert np.all(joints > ((tool[:, None] - rails.points) * rails.directions).sum(axis=-1))
    # Direct undoes inverse, and inverse direct.
    assert np.abs(rails.tool_for(joints) - tool).max() < 1e-9
    assert np.abs(rails.joints_for(rails.tool_for(joints + 0.37)) - joints - 0.37).max() < 1e-9


def test_legs_that_do_not_reach_say_by_how_much() -> None:
    """The middle of the three centres is √6·200 = 489.9 mm from each: 379.1 = √(489.9² − L²)."""
    centres = np.diag([600.0, 600.0, 600.0])
    with pytest.raises(PostureError, match=r"do not reach .* miss by 379 mm") as caught:
        trilaterate(centres, np.full(3, L))
    assert "limits" in caught.value.remedy


@pytest.mark.parametrize(
    ("point", "leg"),
    [((10.0, 250.0, -200.0), "x"), ((250.0, 10.0, -200.0), "y"), ((-200.0, 250.0, 10.0), "z")],
)
def test_a_leg_too_short_is_named(point: tuple[float, float, float], leg: str) -> None:
    at = r"\({:.3f}, {:.3f}, {:.3f}\)".format(*point)
    with pytest.raises(PostureError, match=f"Leg {leg} is too short .* {at}") as caught:
        NOMINAL.machine.nominal_rails.joints_for(np.array([POINT, point]))
    assert "workspace" in caught.value.remedy
    longer = PROTOTYPE.changed(leg_length_mm=400.0)
    assert np.isfinite(longer.nominal_rails.joints_for(np.array([POINT, point]))).all()


def test_legs_in_one_plane_are_singular() -> None:
    """All three legs perpendicular to (1, 1, 1): p = (s, s, s), q = 3 s on each rail.

    Also where rounding leaves some volume, on rails turned by any angle, and in a batch.
    """
    turn = np.linalg.qr(np.random.default_rng(4).normal(0.0, 1.0, (3, 3)))[0]
    turned = replace(PROTOTYPE.nominal_rails, directions=turn)
    for rails in (PROTOTYPE.nominal_rails, turned):
        tool = np.array([[20.0, 30.0, 50.0], [50.0, 50.0, 50.0]]) @ rails.directions
        points = Points.of(rails, np.full((2, 3), 150.0), strict=True)._replace(tool=tool.T)
        fine = np.isfinite(points.tool_derivative)
        assert fine[..., 0].all()
        assert not fine[..., 1].any()


@pytest.mark.parametrize("moved", [L, -L, 400.0])
def test_a_leg_displaced_by_its_length_is_named(moved: float) -> None:
    with pytest.raises(PostureError, match=f"Leg z cannot be displaced by {moved:g} mm"):
        NOMINAL.machine.joints_at(np.array([0, 2]), np.array([60.0, moved]))
