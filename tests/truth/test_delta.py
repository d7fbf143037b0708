"""The truth of a linear delta must itself be true: towers, rails, touches, draws and files.

Its kinematics are compared with the program's in `tests/model/test_linear_delta.py`.
"""

from dataclasses import replace

import numpy as np
import pytest

from .delta import V400, Layout, Surface, Truth, grain, make_delta_session, touches, ways_between
from .plan import frozen


def test_lost_motion_leaves_a_carriage_behind() -> None:
    """Along x and back: what a and b lost shows with the way, most where their arms are steep."""
    x = np.array([0.0, -60.0, 0.0, 60.0, 0.0])
    ways = ways_between(V400, x, np.zeros(5))
    assert ways.tolist() == [[-1, -1, -1], [1, -1, -1], [-1, 1, 1], [-1, 1, -1], [1, -1, 1]]
    common = touches(V400, Truth(lost=frozen([0.04] * 3)), x[:1], *np.zeros((3, 1)))
    np.testing.assert_allclose(common, [-0.02], atol=1e-9)
    z = touches(V400, Truth(lost=frozen([0.0, 0.04, 0.0])), x, *np.zeros((3, 5)))
    up, down = (
        touches(V400, Truth(endstops=frozen([0.0, shift, 0.0])), x, *np.zeros((3, 5)))
        for shift in (-0.02, 0.02)
    )
    np.testing.assert_allclose(z, np.where(ways[:, 1] > 0, up, down), atol=1e-9)
    assert np.abs(up - down).min() > 0.004
    # In two hours an endstop gains twice what it does in one.
    warm = Truth(rates=frozen([0.0, 0.01, 0.0]))
    later = touches(V400, warm, x, np.zeros(5), np.zeros(5), np.full(5, 2.0))
    np.testing.assert_allclose(later, down, atol=1e-9)


@pytest.mark.parametrize("places", [7, 41])
@pytest.mark.parametrize("heights", [(0.0,), (0.0, 20.0, 40.0)])
def test_layouts(places: int, heights: tuple[float, ...]) -> None:
    session = make_delta_session(1, V400, (), Layout(places, heights, cycles=2))
    assert len(session.readings) == places * len(heights) * 2
    assert np.hypot(session.x, session.y).max() <= 0.95 * V400.bed + 0.01
    distinct = {*zip(session.x, session.y, session.block, session.cycle, strict=True)}
    assert len(distinct) == len(session.x)
    assert session.minutes[0] == 0.0
    assert (np.diff(session.minutes) > 0.0).all()
    assert np.abs(session.clean - session.block).max() < 10.0


def test_noise_and_rounding_of_a_touch() -> None:
    """400 touches: the standard deviation is known to 3.5 %; five of these are allowed."""
    session = make_delta_session(2, V400, (), Layout(400))
    noise = session.readings - session.clean
    assert np.std(noise) == pytest.approx(0.013, rel=0.18)
    rough = make_delta_session(2, replace(V400, resolution=0.0125, noise=0.001), (), Layout(41))
    steps = rough.readings / 0.0125
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)


def test_a_bed_is_forgotten_over_its_length() -> None:
    """The correlation of 400 drawn beds at distances of half, one and two lengths."""
    rng, length = np.random.default_rng(21), 20.0
    away = np.array([0.0, 10.0, 20.0, 40.0])
    beds = [Surface(150.0, {}, grain(rng, 0.02, length)) for _ in range(400)]
    heights = np.array([bed.height(30.0 + away, 0.0 * away) for bed in beds])
    found = heights.T @ heights[:, 0] / len(beds) / 0.02**2
    np.testing.assert_allclose(found, np.exp(-away / length), atol=0.2)
