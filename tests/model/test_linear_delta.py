"""The linear delta against an independent one: kinematics, readings, and plans of touches."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import eval_jacobi

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.solution import zero_free
from orthoglide_cal.model.linear_delta import GRAIN_MM
from orthoglide_cal.model.model import Effect, Model, simulate
from orthoglide_cal.model.plan import Floats
from tests.model.test_plan import groups
from tests.printers import (
    PRINTER,
    UNEVEN,
    both,
    printed,
    printer,
    standard_plan,
    touched,
    true_values,
    truth_with,
)
from tests.truth.delta import (
    KOSSEL,
    V400,
    Delta,
    Layout,
    Surface,
    Truth,
    distances,
    places_of,
    touches,
)
from tests.truth.plan import frozen

NANOMETRE = 1e-6
VALUES = np.array([0.7, -0.4, 0.3, 0.6, 0.2, -0.15])
LEANS = np.array([[3.0, -2.0], [-1.5, 4.0], [2.5, 1.0]])
RADII = np.array([0.3, -0.5, 0.2])
ARMS = np.array([0.4, -0.3, 0.2])
SCALES = np.array([1.2, -0.8, 0.5])
NONE = np.zeros(6)
every_machine = pytest.mark.parametrize("machine", [V400, KOSSEL, UNEVEN], ids=lambda m: m.name)


def of_leans(leans: Floats) -> Effect:
    return CAUSES["tower_lean"].at(1e-3 * leans.T.reshape(6))


def terms_of(names: tuple[str, ...], sizes: Floats) -> dict[tuple[int, int], float]:
    """Powers of x and y by the names of a surface's terms: "xxy" is x² y."""
    return {
        (name.count("x"), name.count("y")): float(size)
        for name, size in zip(names, sizes, strict=True)
    }


def missed(machine: Delta, truth: Truth, values: Floats, effects: Sequence[Effect] = ()) -> float:
    """How far the program's readings are from those of the truth, at most [mm].

    On three heights, over 1.5 hours.
    """
    at = np.tile(places_of(Layout(places=41), machine.bed), (3, 1))
    blocks, clock = np.repeat([0.0, 15.0, 60.0], 41), np.linspace(0.0, 1.5, len(at))
    z = touches(machine, truth, at[:, 0], at[:, 1], blocks, clock)
    plan, read = touched(np.column_stack((at, z)), blocks, clock), z - blocks
    assert np.abs(read).max() > 0.01
    found = simulate(Model(printer(machine), tuple(effects)), values, plan)
    return float(np.abs(found - read).max())


@pytest.mark.parametrize("number", [7, 11, 24])
def test_finer_terms_of_a_bed_are_zernike_polynomials(number: int) -> None:
    """By Jacobi polynomials, less height and slope in the middle, which are the endstops'."""
    bed = CAUSES["bed_shape"]
    n, m = map(int, bed.names[number][1:].split("_"))

    def height(x: Floats, y: Floats) -> Floats:
        away, turn, half = np.hypot(x, y), abs(m) * np.arctan2(y, x), (n - abs(m)) // 2
        radial = (-1) ** half * away ** abs(m) * eval_jacobi(half, abs(m), 0, 1.0 - 2.0 * away**2)
        return radial * (np.cos(turn) if m >= 0 else np.sin(turn))

    plan = standard_plan()
    _, at, _ = PRINTER.sensed(Model(PRINTER).real, NONE, plan, strict=True)
    found = bed.contact(np.zeros(len(plan)), bed.at(np.eye(25)[number]), plan, PRINTER, at)
    x, y = at[:75, :2].T
    near = 1e-4 * np.eye(2)
    slope = [(height(*(one[:, None])) - height(*(-one[:, None])))[0] / 2e-4 for one in near]
    middle = height(np.zeros(1), np.zeros(1))[0]
    expected = height(x, y) - middle - slope[0] * x - slope[1] * y
    assert np.abs(expected).max() > 0.1
    assert found[:75] == pytest.approx(expected, abs=1e-6)
    assert np.all(found[75:] == 0.0)


# --- readings against the truth ---------------------------------------------------------------


@every_machine
def test_readings_are_those_of_the_truth(machine: Delta) -> None:
    """With each parameter, each lean and each other cause alone, and with everything at once."""
    bed, tilt, rates = CAUSES["bed_shape"], CAUSES["probe_tilt"], np.array([0.1, -0.05, 0.2])
    sizes, lower = np.linspace(-0.2, 0.3, 7), np.array([0.11, -0.07, 0.05])
    flat = truth_with(machine, VALUES)
    bent = replace(flat, bed=Surface(machine.bed, terms_of(bed.names[:7], sizes)))
    # What hangs lower triggers earlier.
    hanging = replace(flat, tilt=Surface(machine.bed, terms_of(tilt.names, -lower)))
    several = truth_with(machine, VALUES, LEANS, RADII, scales=SCALES)
    own = Truth(endstops=frozen([0.7, -0.4, 0.3]), radius=0.6, angles=frozen([0.2, -0.15, 0.0]))
    leans = 2.5 * np.eye(6).reshape(6, 3, 2)
    radius, arms = CAUSES["tower_radius"].at(RADII), CAUSES["leg_length"].at(ARMS)
    scale, drift = CAUSES["encoder_scale"].at(1e-3 * SCALES), CAUSES["probe_drift"].at([-0.3])
    cases = [
        *((truth_with(machine, one), one, ()) for one in np.diag(VALUES)),
        *((truth_with(machine, NONE, leans=one), NONE, (of_leans(one),)) for one in leans),
        (own, true_values(machine, own), ()),
        (truth_with(machine, NONE, radii=RADII), NONE, (radius,)),
        (truth_with(machine, NONE, arms=ARMS), NONE, (arms,)),
        (truth_with(machine, NONE, scales=SCALES), NONE, (scale,)),
        (bent, VALUES, (bed.at(sizes),)),
        (hanging, VALUES, (tilt.at(lower),)),
        (replace(flat, drift=-0.3), VALUES, (drift,)),
        (replace(flat, rates=frozen(rates)), VALUES, (CAUSES["thermal_drift"].at(rates),)),
        (
            replace(several, bed=bent.bed, drift=-0.3),
            VALUES,
            (of_leans(LEANS), radius, scale, bed.at(sizes), drift),
        ),
    ]
    found = [missed(machine, *case) for case in cases]
    assert max(found) < NANOMETRE, found


@every_machine
def test_a_calliper_reads_the_distance_of_true_places(machine: Delta) -> None:
    turn = np.radians(60.0 * np.arange(6))
    first = 0.7 * machine.bed * np.stack((np.cos(turn), np.sin(turn), 0.1 * turn), axis=1)
    second = np.roll(first, 2, axis=0)
    truth = truth_with(machine, VALUES, LEANS, scales=SCALES)
    effects = (of_leans(LEANS), CAUSES["encoder_scale"].at(1e-3 * SCALES))
    excess = distances(machine, truth, first, second) - np.linalg.norm(first - second, axis=1)
    found = simulate(Model(printer(machine), effects), VALUES, printed(first, second))
    assert np.abs(excess).max() > 0.1
    assert found == pytest.approx(excess, abs=NANOMETRE)
    # A bed, and a probe, have no part in it.
    bed = CAUSES["bed_shape"].at(np.full(7, 0.5))
    drift = CAUSES["probe_drift"].at(np.array([0.5]))
    more = Model(printer(machine), (*effects, bed, drift))
    later = replace(printed(first, second), hours=np.full(6, 0.5))
    assert simulate(more, VALUES, later) == pytest.approx(found, abs=0.0)


def test_from_which_side_a_place_is_come_to_does_not_hang_on_what_is_read_there() -> None:
    """Along a circle about a tower its carriage moves by less than the bed is rough."""
    machine, layout = printer(V400), Layout(places=400)
    at = places_of(layout, V400.bed)
    rough = np.random.default_rng(1).normal(scale=0.05, size=len(at))
    still = np.zeros(len(at))
    level, read = (
        machine.command(touched(np.column_stack((at, z)), still, still)).approach[:400]
        for z in (still, rough)
    )
    np.testing.assert_array_equal(read, level)


# --- plans ------------------------------------------------------------------------------------


def test_touches_have_no_unknown_zero_and_distances_share_nothing() -> None:
    plan = standard_plan()
    assert (plan.setups, plan.zeros.shape) == (0, (len(plan), 0))
    assert groups(plan.shared) == [[*range(75)], *([k] for k in range(75, 81))]
    assert plan.precision.tolist() == [1.0] * 75 + [0.4] * 6


def test_no_contrast_of_dates_together_holds_parameters_of_another_date() -> None:
    """Also where distances are less precise than touches."""
    plan = standard_plan()
    slope = np.random.default_rng(2).normal(size=(len(plan), 6)) * (np.arange(81) < 40)[:, None]
    joint = replace(plan, slope=slope, date=np.arange(81) // 40)
    assert joint.setups == 6
    assert zero_free(joint) @ joint.zeros == pytest.approx(np.zeros((75, 6)), abs=1e-12)


def test_touches_of_one_spot_repeat_each_other() -> None:
    """Wherever the controller stopped; not on a block, nor in another sitting."""
    place = np.array([[10.0, 5.0, z] for z in (0.1, 0.13, 30.1, 30.2, 0.09)])
    place = np.vstack((place, [[10.5, 5.0, 0.1]]))
    plan = replace(
        touched(place, np.array([0, 0, 30, 30, 0, 0])), part=np.array([0, 0, 0, 0, 1, 0])
    )
    assert groups(plan.repeats) == [[0, 1], [2, 3], [4], [5]]
    ends = np.array([[9.0, 0, 0], [9, 0, 0], [0, 9, 0]])
    assert groups(printed(0.0 * ends, ends).repeats) == [[0, 1], [2]]


def test_cells_are_patches_of_the_bed() -> None:
    """Neighbours share what the bed has there; what is left out together is no single touch."""
    at = places_of(Layout(places=400), UNEVEN.bed)
    plan = touched(np.column_stack((at, np.zeros(400))))
    cells = plan.cells
    assert 20 < len(set(cells.tolist())) < 60
    side = np.abs(at).max() / 3.0
    for cell in set(cells.tolist()):
        assert np.ptp(at[cells == cell], axis=0).max() <= side
    mixed = both(plan, printed(plan.place[:3], plan.place[3:6]))
    assert len(set(mixed.cells[-3:].tolist())) == 3
    assert not set(mixed.cells[-3:].tolist()) & set(mixed.cells[:-3].tolist())


def test_a_reading_in_words_has_its_place_and_number() -> None:
    plan = standard_plan()
    x, y = plan.place[11, :2].round(2)
    assert PRINTER.reading_words(plan, 11) == f"x {x:g}, y {y:g} mm (touch 12)"
    assert PRINTER.reading_words(plan, 80).endswith("mm (distance 81)")


def test_local_shape_is_shared_by_neighbours() -> None:
    places = np.array([[0.0, 0.0, 5.0], [GRAIN_MM, 0.0, 2.0], [0.0, 3.0 * GRAIN_MM, 0.0]])
    plan = standard_plan().subset([0, 1, 80, 2])
    places = np.insert(places, 2, plan.place[2], axis=0)
    shape = replace(plan, place=places).texture
    assert not shape[2].any()  # of a distance
    shape = shape[[0, 1, 3]]
    expected = np.exp([[0.0, -1.0, -3.0], [-1.0, 0.0, -np.sqrt(10.0)], [-3.0, -np.sqrt(10.0), 0.0]])
    assert shape @ shape.T == pytest.approx(expected, abs=1e-12)
