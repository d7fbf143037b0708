"""The truth of a linear delta must itself be true: both kinematics, every effect, the touch."""

import csv
import io
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import yaml

from .delta import (
    KOSSEL,
    TOLERANCES,
    V400,
    Delta,
    Layout,
    Surface,
    Truth,
    delta_csv,
    delta_yaml,
    distances,
    feet,
    grain,
    indicated,
    joints_for,
    make_delta_session,
    places_of,
    probe_bed,
    rails,
    texture,
    tool,
    touches,
    ways_between,
)
from .plan import Floats, frozen

UNEVEN = Delta("uneven", (300.0, 301.5, 299.25), 150.0, (209.0, 331.5, 90.0), (380.0, 381.0, 379.5))
MACHINES = (V400, KOSSEL, UNEVEN)
BENT = Truth(
    endstops=frozen([0.7, -0.4, 0.3]),
    radius=0.6,
    angles=frozen([0.2, -0.15, 0.0]),
    radii=frozen([0.3, -0.5, 0.2]),
    leans=frozen(np.array([[3.0, -2.0], [-1.5, 4.0], [2.5, 1.0]])),
    arms=frozen([0.4, -0.3, 0.2]),
    scales=frozen([1.2, -0.8, 0.5]),
)


def _places(machine: Delta, seed: int, count: int = 40) -> Floats:
    rng = np.random.default_rng(seed)
    turn, away = rng.uniform(0, 2 * np.pi, count), machine.bed * np.sqrt(rng.uniform(0, 1, count))
    return np.stack((away * np.cos(turn), away * np.sin(turn), rng.uniform(-1, 90, count)), axis=1)


def _closed_form(centres: Floats, lengths: Floats) -> Floats:
    """The lower common point of three spheres, shape (3, 3) and (3,), by planes and a line."""
    normals = 2.0 * (centres[1:] - centres[0])
    sums = (centres**2).sum(axis=1) - lengths**2
    line = np.cross(normals[0], normals[1])
    line /= np.linalg.norm(line)
    foot = np.linalg.lstsq(normals, sums[1:] - sums[0], rcond=None)[0]
    apart = foot - centres[0]
    along = apart @ line
    root = np.sqrt(along**2 - apart @ apart + lengths[0] ** 2)
    ends = foot + np.array([-along - root, -along + root])[:, None] * line
    return ends[np.argmin(ends[:, 2])]


@pytest.mark.parametrize("machine", MACHINES, ids=lambda m: m.name)
def test_a_perfect_machine_goes_where_it_is_told(machine: Delta) -> None:
    places = _places(machine, 1)
    np.testing.assert_allclose(
        tool(machine, Truth(), indicated(machine, places)), places, atol=1e-9
    )
    np.testing.assert_allclose(
        joints_for(machine, Truth(), places), indicated(machine, places), atol=1e-9
    )


@pytest.mark.parametrize("machine", MACHINES, ids=lambda m: m.name)
def test_direct_and_inverse_kinematics_of_a_bent_machine_undo_each_other(machine: Delta) -> None:
    places = _places(machine, 2)
    joints = joints_for(machine, BENT, places)
    np.testing.assert_allclose(tool(machine, BENT, joints), places, atol=1e-9)
    assert np.abs(joints - indicated(machine, places)).max() > 0.5


def test_the_tool_is_the_lower_point_that_trilateration_finds() -> None:
    joints = indicated(UNEVEN, _places(UNEVEN, 3))
    found = tool(UNEVEN, BENT, joints)
    home = np.array(UNEVEN.endstops) + np.sqrt(np.array(UNEVEN.arms) ** 2 - UNEVEN.radius**2)
    arms = np.array(UNEVEN.arms) + BENT.arms
    for place, joint in zip(found, joints, strict=True):
        height = joint + BENT.endstops - (home - joint) * 1e-3 * BENT.scales
        centres = feet(UNEVEN, BENT) + height[:, None] * rails(UNEVEN, BENT)
        np.testing.assert_allclose(place, _closed_form(centres, arms), atol=1e-8)


def test_where_the_towers_stand() -> None:
    truth = Truth(radius=0.5, angles=frozen([0.0, 0.0, 1.0]), radii=frozen([0.0, 0.25, 0.0]))
    found = feet(V400, truth)
    np.testing.assert_allclose(found[0], [162.3 * np.cos(np.pi * 7 / 6), -81.15, 0.0])
    np.testing.assert_allclose(np.hypot(*found[1, :2]), 162.55)
    np.testing.assert_allclose(np.degrees(np.arctan2(found[2, 1], found[2, 0])), 91.0)


def test_a_rail_leans_outwards_and_in_the_sense_of_its_angle() -> None:
    """Tower c stands at 90°: outwards is +y, growing angle is −x."""
    truth = Truth(leans=frozen(np.array([[0.0, 0.0], [0.0, 0.0], [3.0, 2.0]])))
    up = rails(V400, truth)
    np.testing.assert_allclose(up[2] / up[2, 2], [-2e-3, 3e-3, 1.0], atol=1e-12)
    np.testing.assert_allclose(up[:2], [[0, 0, 1], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ("part", "index", "step"),
    [("endstops", 0, 0.01), ("endstops", 2, 0.01), ("arms", 1, 0.01), ("scales", 0, 0.05),
     ("rates", 2, 0.01), ("lost", 1, 0.01), ("radii", 1, 0.01)],
)  # fmt: skip
def test_small_changes_move_the_tool_as_the_distances_demand(
    part: str, index: int, step: float
) -> None:
    """d(|P − B_i|²) / 2 = L_i dL_i: three linear equations for the tool's shift, solved here."""
    joints = indicated(V400, _places(V400, 4))
    change = np.zeros(3)
    change[index] = step
    truths = [Truth(**{part: frozen(sign * change)}) for sign in (-1.0, 1.0)]  # type: ignore[arg-type]
    ends = [tool(V400, truth, joints, 2.0, np.array([1.0, -1.0, 1.0])) for truth in truths]
    home = np.array(V400.endstops) + np.sqrt(np.array(V400.arms) ** 2 - V400.radius**2)
    for place, joint, low, high in zip(tool(V400, Truth(), joints), joints, *ends, strict=True):
        centres = feet(V400, Truth()) + joint[:, None] * np.array([0.0, 0.0, 1.0])
        spans, shift, longer = place - centres, np.zeros((3, 3)), np.zeros(3)
        if part == "arms":
            longer[index] = step
        elif part == "radii":
            shift[index, :2] = feet(V400, Truth())[index, :2] / V400.radius * step
        else:
            size = {"endstops": step, "rates": 2.0 * step, "lost": 0.5 * step}.get(
                part, -1e-3 * step * (home[index] - joint[index])
            )
            shift[index, 2] = size
        wanted = np.linalg.solve(spans, np.array(V400.arms) * longer + (spans * shift).sum(axis=1))
        np.testing.assert_allclose((high - low) / 2.0, wanted, atol=2e-6)


def test_a_radial_lean_is_a_radius_that_grows_with_height() -> None:
    joints = indicated(V400, _places(V400, 5, 1))
    lean = Truth(leans=frozen(np.array([[2.0, 0.0], [0.0, 0.0], [0.0, 0.0]])))
    wider = Truth(radii=frozen([2e-3 * float(joints[0, 0]), 0.0, 0.0]))
    np.testing.assert_allclose(tool(V400, lean, joints), tool(V400, wider, joints), atol=2e-3)
    assert np.abs(tool(V400, lean, joints) - tool(V400, Truth(), joints)).max() > 0.1


def test_a_touch_is_where_the_tip_meets_the_surface() -> None:
    rng = np.random.default_rng(6)
    bed = Surface(150.0, {(1, 0): 0.3, (0, 2): -0.4, (2, 1): 0.25}, texture(rng, 0.02, 25.0))
    tilt = Surface(150.0, {(1, 0): 0.1, (1, 1): -0.05})
    truth = replace(BENT, bed=bed, tilt=tilt, drift=0.3, rates=frozen([0.1, -0.2, 0.05]))
    at = places_of(Layout(41), V400.bed)
    x, y = at.T
    block, hours = np.repeat([0.0, 30.0], [20, 21]), np.linspace(0.0, 0.5, 41)
    z = touches(V400, truth, x, y, block, hours)
    joints = indicated(V400, np.stack((x, y, z), axis=1))
    touched = tool(V400, truth, joints, hours)
    tip = touched[:, 2] + tilt.height(touched[:, 0], touched[:, 1]) - 0.3 * hours
    np.testing.assert_allclose(tip, bed.height(touched[:, 0], touched[:, 1]) + block, atol=1e-9)
    assert np.abs(z - block).max() > 0.5


def test_a_perfect_machine_reads_the_bed_the_probe_and_the_clock() -> None:
    bed, tilt = Surface(150.0, {(1, 2): 0.2, (0, 0): 0.05}), Surface(150.0, {(2, 0): 0.07})
    x, y = places_of(Layout(25), V400.bed).T
    block, hours = np.full(25, 10.0), np.linspace(0.0, 1.0, 25)
    z = touches(V400, Truth(bed=bed, tilt=tilt, drift=0.11), x, y, block, hours)
    wanted = 10.0 + 0.05 + 0.2 * x * y**2 / 150.0**3 - 0.07 * x**2 / 150.0**2 + 0.11 * hours
    np.testing.assert_allclose(z, wanted, atol=1e-9)
    # Carriages that truly stand higher lift the tool: it has to go down further.
    z = touches(V400, Truth(endstops=frozen([0.3] * 3)), *np.zeros((4, 1)))
    np.testing.assert_allclose(z, [-0.3], atol=1e-9)


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


def test_distances_on_a_print() -> None:
    first, second = np.array([[5.0, 0.0, 0.0]]), np.array([[69.0, 48.0, 0.0]])
    np.testing.assert_allclose(distances(V400, Truth(), first, second), [80.0], atol=1e-9)
    arms = np.array(V400.arms) + BENT.arms
    still = replace(BENT, scales=frozen(np.zeros(3)))
    ends = []
    for joint in indicated(V400, np.concatenate((first, second))):
        height = (joint + BENT.endstops)[:, None]
        ends.append(_closed_form(feet(V400, still) + height * rails(V400, still), arms))
    apart = distances(V400, still, first, second)
    np.testing.assert_allclose(apart, [np.linalg.norm(ends[1] - ends[0])], atol=1e-8)
    assert abs(apart[0] - 80.0) > 0.05


@pytest.mark.parametrize("places", [7, 13, 25, 41, 121, 400])
@pytest.mark.parametrize("heights", [(0.0,), (0.0, 20.0, 40.0)])
def test_layouts(places: int, heights: tuple[float, ...]) -> None:
    session = make_delta_session(1, V400, (), Layout(places, heights, cycles=2))
    assert len(session.readings) == places * len(heights) * 2
    assert np.hypot(session.x, session.y).max() <= 0.95 * V400.bed + 0.01
    assert len({*zip(session.x, session.y, session.block, session.cycle, strict=True)}) == len(
        session.x
    )
    assert session.minutes[0] == 0.0
    assert (np.diff(session.minutes) > 0.0).all()
    assert np.abs(session.clean - session.block).max() < 10.0


def test_noise_and_rounding_of_a_touch() -> None:
    """400 touches: the standard deviation is known to 3.5 %; five of these are allowed."""
    session = make_delta_session(2, V400, (), Layout(400))
    noise = session.readings - session.clean
    assert np.std(noise) == pytest.approx(0.013, rel=0.18)
    rough = make_delta_session(2, replace(V400, resolution=0.0125, noise=0.001), (), Layout(41))
    np.testing.assert_allclose(
        rough.readings / 0.0125, np.round(rough.readings / 0.0125), atol=1e-4
    )


@pytest.mark.parametrize("cause", TOLERANCES)
def test_each_cause_shows_in_the_touches(cause: str) -> None:
    layout = Layout(41, (0.0, 40.0), pace=0.5)
    session = make_delta_session(5, V400, (cause,), layout)
    sound = replace(
        Truth(), endstops=session.truth.endstops, radius=session.truth.radius,
        angles=session.truth.angles,
    )  # fmt: skip
    args = session.x, session.y, session.block, session.minutes / 60.0
    apart = session.readings - touches(V400, sound, *args)
    if cause == "misread":
        (row,) = np.flatnonzero(session.contact)
        size = session.contact[row]
        assert apart[row] == pytest.approx(size, abs=0.08)
        assert np.abs(np.delete(apart, row)).max() < 0.08
    else:
        assert np.std(session.clean - touches(V400, sound, *args)) > 0.01
    assert session.label == cause


def test_sessions_come_from_their_arguments_alone() -> None:
    first, again = (make_delta_session(3, V400, ("tower_lean",)) for _ in range(2))
    np.testing.assert_array_equal(first.readings, again.readings)
    assert (first.readings != make_delta_session(4, V400, ("tower_lean",)).readings).all()
    with pytest.raises(KeyError, match="wobble"):
        make_delta_session(1, V400, ("wobble",))


def test_another_day_at_the_same_machine() -> None:
    session = make_delta_session(6, V400, ("bed_shape",), bumps=(0.02, 30.0))
    second = probe_bed(V400, session.truth, (), session.layout, np.random.default_rng(8))
    np.testing.assert_array_equal(second.clean, session.clean)
    assert (second.readings != session.readings).all()


def test_the_record_holds_the_touches_and_no_word_of_the_truth() -> None:
    session = make_delta_session(7, KOSSEL, ("tower_lean",), Layout(13, (0.0, 25.0)))
    rows = list(csv.DictReader(io.StringIO(delta_csv(session))))
    np.testing.assert_allclose([float(r["reading_mm"]) for r in rows], session.readings, atol=1e-6)
    np.testing.assert_allclose([float(r["z_mm"]) for r in rows], session.block)
    np.testing.assert_allclose([float(r["x_mm"]) for r in rows], session.x, atol=0.005)
    np.testing.assert_array_equal(np.round(session.x, 2), session.x)
    assert "lean" not in delta_csv(session)


def test_the_machine_file_states_the_machine() -> None:
    stated = yaml.safe_load(delta_yaml(KOSSEL))
    assert stated["kind"] == "linear_delta"
    assert stated["arm_length_mm"] == [265.0] * 3
    assert stated["endstops_mm"] == {"a": 290.0, "b": 290.0, "c": 290.0}
    assert stated["tolerances"] == TOLERANCES


@pytest.mark.parametrize(
    ("shape", "kept"),
    [(grain, lambda away: np.exp(-away)), (texture, lambda away: np.exp(-0.5 * away**2))],
    ids=["grain", "texture"],
)
def test_a_bed_is_forgotten_over_its_length(
    shape: Callable[..., Floats], kept: Callable[[Floats], Floats]
) -> None:
    """The correlation of 400 drawn beds at distances of half, one and two lengths."""
    rng, length = np.random.default_rng(21), 20.0
    away = np.array([0.0, 10.0, 20.0, 40.0])
    beds = [Surface(150.0, {}, shape(rng, 0.02, length)) for _ in range(400)]
    heights = np.array([bed.height(30.0 + away, 0.0 * away) for bed in beds])
    found = heights.T @ heights[:, 0] / len(beds) / 0.02**2
    np.testing.assert_allclose(found, kept(away / length), atol=0.2)
