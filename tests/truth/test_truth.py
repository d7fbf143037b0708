"""The truth must itself be true: its noise, clock, draws and files, and the distances it judges by.

Its geometry and its effects are compared with the program's, which stand on other legs, in
`tests/causes`, `tests/estimation` and `tests/model`.
"""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from . import (
    DIAL,
    LARGE,
    MICRON,
    PROTOTYPE,
    Session,
    again,
    continue_session,
    expected_heldout,
    make_session,
    measure,
    readings_csv,
    second_session,
    separation,
    signals,
    standard_plan,
)
from .delta import V400, Layout, Surface, Truth, grain, make_delta_session, touches, ways_between
from .effects import Effect, state_with, swapped_rows
from .forward import PARTS, prior_sd
from .plan import Floats, frozen
from .separation import Neighbourhood
from .session import SITTING, Setting

OFFSETS = frozen([0.43, -0.71, 0.28])


def test_legs_places_and_scale_act_as_drawn() -> None:
    """Ten thousand times too large, so that noise and rounding do not matter."""
    rng = np.random.default_rng(6)
    plan = standard_plan(PROTOTYPE, np.random.default_rng(5))
    wild = Setting(frozen([1.1, -0.6, 0.4]), frozen(np.linspace(-20.0, 30.0, 6)), 0.02)
    session = measure(PROTOTYPE, MICRON, plan, OFFSETS, (), rng, setting=wild)
    state = state_with(OFFSETS, ())
    state[PARTS["leg_length"]] = wild.legs
    surface = signals(plan, PROTOTYPE, state[None], None, wild.misplaced)[0]
    expected = 1.02 * (surface + session.zeros[plan.setup])
    assert np.abs(session.readings - expected).max() < 6.0 * MICRON.sigma
    assert np.abs(session.readings - session.clean).max() > 0.1


def test_settings_have_the_stated_sizes() -> None:
    """400 of them: standard deviations within 20 %, 5.6 of their own at least."""
    rng = np.random.default_rng(1)
    drawn = [Setting.draw(rng) for _ in range(400)]
    for part, sd in (("legs", 0.01), ("misplaced", 1.0), ("scale", 0.001)):
        assert np.std([getattr(each, part) for each in drawn]) == pytest.approx(sd, rel=0.2)
    # The machine and the gauge stay; the stands are put there again.
    first = make_session(3, PROTOTYPE, DIAL)
    later = second_session(first, 3).setting
    assert np.array_equal(later.legs, first.setting.legs)
    assert later.scale == first.setting.scale
    assert not np.any(later.misplaced == first.setting.misplaced)
    exact = make_session(3, PROTOTYPE, DIAL, exact=True)
    assert not exact.setting.misplaced.any()
    assert not second_session(exact, 3).setting.misplaced.any()


def test_next_day_keeps_the_machine_and_forgets_the_blunders() -> None:
    first = make_session(3, PROTOTYPE, MICRON, ("backlash", "gauge_slip"))
    later = second_session(first, 8)
    assert later.causes == ("backlash",)
    assert later.effects[0].parameters[:3] == first.effects[0].parameters[:3]
    assert later.effects[0].parameters[3:] != first.effects[0].parameters[3:]
    assert np.array_equal(later.offsets, first.offsets)
    assert not np.allclose(later.zeros, first.zeros)


def test_the_file_is_the_contracts_and_tells_nothing() -> None:
    session = make_session(1, PROTOTYPE, DIAL, ("swapped_gauges",))
    rows = list(csv.DictReader(io.StringIO(readings_csv(session))))
    assert [float(row["reading_mm"]) for row in rows] == session.readings.tolist()
    assert [int(row["seq"]) for row in rows] == list(range(1, 61))
    assert {row["leg"] + row["direction"] for row in rows} == {"xy", "xz", "yx", "yz", "zx", "zy"}
    assert all(len(row["reading_mm"].split(".")[1]) == 2 for row in rows)
    assert "swap" not in readings_csv(session)
    assert swapped_rows(session.plan, 1)[20:24].tolist() == [21, 20, 23, 22]


def test_the_truth_does_not_know_the_program() -> None:
    for path in Path(__file__).parent.glob("*.py"):
        names = re.findall(r"^\s*(?:from|import) (\S+)", path.read_text("utf-8"), re.MULTILINE)
        assert not [name for name in names if name.startswith(("orthoglide_cal", "tests"))], path


# --- more readings at the same machine ---------------------------------------------------------


def about_zeros(session: Session, values: np.ndarray) -> np.ndarray:
    """Values less those at the first reading of their set-up."""
    return np.asarray(values - values[session.plan.stand])


def drawn(*hidden: str, seed: int = 3, exact: bool = True) -> Session:
    return make_session(seed, PROTOTYPE, MICRON, hidden, exact=exact)


def test_the_first_readings_stay_and_the_new_ones_have_their_own_zeros() -> None:
    first = drawn(exact=False)
    both = again(first)
    assert both.readings[:60].tolist() == first.readings.tolist()
    assert both.plan.zero.tolist() == [k + one for k in range(0, 12, 2) for one in (0, 1) * 10]
    assert both.zeros[:6].tolist() == first.zeros.tolist()
    assert np.abs(both.zeros[6:] - first.zeros).min() > 1e-3
    assert both.setting.misplaced.shape == (12,)
    clean = about_zeros(both, both.clean)
    assert clean[60:] == pytest.approx(clean[:60], abs=1e-12)
    left = both.readings - both.clean
    assert np.abs(left).max() > 0.0
    exact = again(drawn())
    assert (exact.readings - exact.clean)[60:].std() == pytest.approx(MICRON.sigma, rel=0.3)


@pytest.mark.parametrize("cause", ["sign_flip", "swapped_gauges", "gauge_drift", "stand_shift"])
def test_what_happened_to_a_gauge_ends_with_its_part(cause: str) -> None:
    """In the same part it goes on; in the next one it is over."""
    first = drawn(cause)
    healthy = signals(first.plan, PROTOTYPE, state_with(first.offsets, ())[None])[0]
    usual = healthy - healthy[first.plan.stand]
    after, on = again(first), again(first, part=0)
    assert about_zeros(after, after.clean)[60:] == pytest.approx(usual, abs=1e-9)
    going_on = about_zeros(on, on.clean)
    assert np.abs(going_on[60:] - usual).max() > 0.02
    if cause in ("sign_flip", "swapped_gauges"):
        assert on.clean[60:] == pytest.approx(first.clean, abs=1e-9)
    elif cause == "stand_shift":
        (effect,) = first.effects
        knocked = first.plan.setup == effect.setup
        assert (going_on[60:] - usual) == pytest.approx(knocked * effect.parameters[0], abs=1e-9)


def test_a_set_up_may_lack_the_isotropic_posture() -> None:
    first = drawn("axis_squareness", "encoder_scale")
    whole = again(first, gauge_at=0.25)
    away = first.plan.displacement != 0.0
    arrays = {name: getattr(whole.plan, name)[60:][away] for name in (*SITTING, "hours")}
    some = continue_session(first, 1, order=np.arange(away.sum()), **arrays)
    expected = whole.clean[60:][away] - whole.zeros[whole.plan.zero[60:][away]]
    assert some.clean[60:] - some.zeros[some.plan.zero[60:]] == pytest.approx(expected, abs=1e-9)


def _brute_distance(session: Session, cause: str) -> float:
    """Distance to a machine cause by a fit of everything, sizes in tolerances."""
    plan, tolerances = session.plan, prior_sd(cause)

    def misfit(values: Floats) -> Floats:
        zeros, offsets, sizes = np.split(values, [6, 9])
        acting = Effect(cause, parameters=tuple(sizes * tolerances))
        surface = signals(plan, session.machine, state_with(offsets, (acting,))[None])[0]
        weighted = (session.clean - surface - zeros[plan.setup]) / session.gauge.sigma
        return np.concatenate((weighted, sizes))

    fit = least_squares(misfit, np.zeros(9 + tolerances.size), x_scale="jac")
    return float(np.sqrt(2.0 * fit.cost))


@pytest.mark.parametrize("cause", ["axis_gap", "encoder_scale", "bar_skew", "thermal_drift"])
def test_distances_equal_a_full_nonlinear_fit(cause: str) -> None:
    for hidden in ("sign_flip", "axis_squareness"):
        session = make_session(6, LARGE, MICRON, (hidden,))
        exact = _brute_distance(session, cause)
        assert separation(session).distances[cause] == pytest.approx(exact, rel=1e-3)


def test_a_shift_is_as_far_as_a_fit_at_every_place_says() -> None:
    session = make_session(11, PROTOTYPE, DIAL, ("gauge_slip",))
    near = Neighbourhood(session)
    residual = (session.clean - near.centre) / DIAL.sigma
    costs = []
    for column in near.places["stand_shift"].T:
        matrix = np.block([[near.free, column[:, None]], [np.zeros((1, 9)), np.eye(1)]])
        target = np.append(residual, 0.0)
        fit = np.linalg.lstsq(matrix, target, rcond=None)[0]
        costs.append(np.sum((target - matrix @ fit) ** 2))
    assert len(costs) == 54
    # At its offsets the slip stands where the model was linearised: no curvature to speak of.
    distance = separation(session).distances["stand_shift"]
    assert distance == pytest.approx(np.sqrt(min(costs)), rel=1e-3)


def test_expected_heldout_is_what_leaving_out_gives() -> None:
    """Linear refits of 120 noisy records: 120 x 60 errors, ratio within 6 %, 4 sigma."""
    session = make_session(7, PROTOTYPE, MICRON)
    near = Neighbourhood(session)
    rng = np.random.default_rng(8)
    noise = rng.normal(scale=MICRON.sigma, size=(60, 120))
    cells = [f"{s}{p}" for s, p in zip(session.plan.setup, session.plan.posture, strict=True)]
    errors = np.zeros_like(noise)
    for cell in set(cells):
        out = np.array([name == cell for name in cells])
        fit = np.linalg.lstsq(near.free[~out], noise[~out], rcond=None)[0]
        errors[out] = noise[out] - near.free[out] @ fit
    measured = np.sqrt(np.mean(errors**2))
    assert len(set(cells)) == 18
    assert expected_heldout(session) == pytest.approx(measured, rel=0.06)


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
