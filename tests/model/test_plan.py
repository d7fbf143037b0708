"""Plans: set-ups, time order, the paper's sessions and differences, where carriages come from."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Difference
from orthoglide_cal.model.orthoglide import (
    PlannedReading,
    double_posture,
    reduction,
    single_posture,
)
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan, Posture, Series, number_setups
from tests.machines import NOMINAL, PROTOTYPE, both_machines


def groups(kind: np.ndarray) -> list[list[int]]:
    """Indices of what is of one kind."""
    return sorted(np.flatnonzero(kind == each).tolist() for each in np.unique(kind))


def approach(plan: GaugePlan) -> Floats:
    """Sign of each carriage's last motion before each reading."""
    return NOMINAL.machine.command(plan).approach


def test_a_wrong_shape_names_the_array() -> None:
    with pytest.raises(ValueError, match="hours has shape"):
        replace(double_posture(PROTOTYPE), hours=[0.0])


def test_stands_stay_where_they_were_used_last() -> None:
    plan = double_posture(PROTOTYPE)
    assert plan.standing.tolist() == (plan.leg == 2).tolist()
    # The order in time counts, the part does, and a gauge at an end of the leg moves with it.
    backwards = replace(plan, order=-plan.order)
    assert backwards.standing.tolist() == (plan.leg == 0).tolist()
    parted = replace(plan, part=(plan.order >= len(plan) - 6).astype(int))
    assert parted.standing.tolist() == (plan.order >= len(plan) - 6).tolist()
    assert not single_posture(PROTOTYPE).standing.any()


def test_readings_alike_share_their_cell_and_their_moment() -> None:
    """A cell is where and how is read; a moment where the carriages stand; iso is one for all."""
    ends = [(0, 1, 0.0), (0, 1, 60.0), (0, 2, 60.0), (1, 2, 0.0), (1, 2, 60.0), (1, 2, 60.0)]
    plan = PlannedReading.planned([PlannedReading(*end, Contact.FIXED) for end in [*ends, ends[1]]])
    contact, gauge_at = [Contact.FIXED] * 7, [0.5] * 6 + [0.3]
    contact[5] = Contact.TOOL
    plan = replace(plan, gauge_at=gauge_at, contact=contact)
    assert groups(plan.cells) == [[0], [1, 6], [2], [3], [4], [5]]
    assert groups(plan.repeats) == [[0], [1], [2], [3], [4], [5], [6]]
    assert groups(plan.moments[1]) == [[0, 3], [1, 2, 6], [4, 5]]
    first, kind = plan.moments
    assert kind[first].tolist() == list(range(len(first)))


# --- the paper's sessions ---------------------------------------------------------------------


@both_machines
def test_the_papers_sessions(machine: Machine) -> None:
    """Isotropic → max → min, three times and once more isotropic, leg after leg (sec. 4.1)."""
    plan = double_posture(machine)
    low, high = machine.joint_limits_mm
    assert len(plan) == 60
    assert plan.leg.tolist() == sorted(plan.leg.tolist())
    per_leg = plan.displacement[plan.leg == 1][::2].tolist()
    assert per_leg == [0.0, high, low] * 3 + [0.0]
    assert plan.direction[plan.leg == 1].tolist() == [0, 2] * 10
    assert plan.setups == 6
    assert plan.fixed
    assert set(plan.gauge_at.tolist()) == {0.5}
    # Both gauges of a leg are read at once, 0.4 min per posture; moving the stands takes 4.
    minutes = 60.0 * plan.hours[::2]
    assert np.array_equal(plan.hours[::2], plan.hours[1::2])
    assert np.diff(minutes) == pytest.approx([*[0.4] * 9, 4.4, *[0.4] * 9, 4.4, *[0.4] * 9])
    # Of chosen postures.
    chosen = double_posture(machine, 2, False, (Posture.MIN, Posture.MAX), 0.3)
    assert chosen.displacement[chosen.leg == 2][::2].tolist() == [low, high] * 2
    assert set(chosen.gauge_at.tolist()) == {0.3}
    # Of one posture: both ends of two legs along z; the one gauge is moved in 4 min.
    single = single_posture(machine, cycles=2)
    assert single.leg.tolist() == [0] * 12 + [1] * 12
    assert set(single.direction.tolist()) == {2}
    assert single.displacement[:12:2].tolist() == [0.0, high, low] * 2
    assert single.contact.tolist() == [Contact.JOINT, Contact.TOOL] * 12
    assert (single.setups, single.fixed) == (2, False)
    assert np.diff(60.0 * single.hours) == pytest.approx([*[0.4] * 11, 4.4, *[0.4] * 11])


def test_approach_follows_time_not_the_order_of_the_rows() -> None:
    plan = double_posture(PROTOTYPE)
    mixed = np.random.default_rng(3).permutation(len(plan))
    assert np.array_equal(approach(plan.subset(mixed)), approach(plan)[mixed])


@pytest.mark.parametrize(
    ("places", "gauges", "ordered", "setups"),
    [
        ("aabab", ["", "", "", "", ""], True, [0, 0, 1, 0, 1]),
        ("aaab", ["1", "2", "1", "1"], True, [0, 1, 0, 2]),
        # A gauge that returns has a new zero; a second one in between does not matter.
        ("aabba", ["1"] * 5, True, [0, 0, 1, 1, 2]),
        ("aabba", ["1"] * 5, False, [0, 0, 1, 1, 0]),
        ("ababab", ["1", "2"] * 3, True, [0, 1, 0, 1, 0, 1]),
    ],
)
def test_a_place_and_a_label_make_a_setup(places, gauges, ordered, setups):
    found = number_setups(places, gauges, range(len(places)), ordered=ordered)
    assert found.tolist() == setups


# --- several parts ----------------------------------------------------------------------------


def test_readings_that_differ_in_their_part_are_no_repeats() -> None:
    plan = PlannedReading.planned(
        [
            PlannedReading(
                0, 1, d, Contact.FIXED, part=part, turned=part == 1, entered=(step, 0.0, 0.0)
            )
            for part, step in ((0, 0.0), (1, 0.0), (2, 0.5))
            for d in (0.0, 60.0)
        ]
    )
    assert plan.setup.tolist() == [0, 0, 1, 1, 2, 2]
    assert plan.parts == 3
    assert len(set(plan.cells.tolist())) == 6
    assert len(plan.moments[0]) == 4
    plain = replace(plan, turned=False, entered=0.0)
    assert len(set(plain.cells.tolist())) == 2
    assert plain.cycles.tolist() == [1] * 6


NAMES = {
    DataKind.SIX: "dx_y dx_z dy_x dy_z dz_x dz_y",
    DataKind.TWELVE: "dx_y+ dx_y- dx_z+ dx_z- dy_x+ dy_x- dy_z+ dy_z- dz_x+ dz_x- dz_y+ dz_y-",
    DataKind.SINGLE: "dz_x0 dz_y0 dz_x+ dz_x- dz_y+ dz_y-",
}


@pytest.mark.parametrize("kind", NAMES)
def test_differences_are_named_as_the_paper_prints_them(kind: DataKind) -> None:
    """Direction first, leg second, in the order of Table 4."""
    assert [difference.name for difference in DIFFERENCES[kind]] == NAMES[kind].split()


def test_readings_of_different_set_ups_are_never_subtracted() -> None:
    """Max in one set-up, min in another: no difference; both in some: their mean."""
    plan = double_posture(PROTOTYPE, cycles=3, closing=False, postures=(Posture.MAX, Posture.MIN))
    apart = replace(plan, setup=np.arange(len(plan)))
    wanted = DIFFERENCES[DataKind.SIX]
    assert not reduction(DataKind.SIX, wanted, PROTOTYPE, apart).any()
    # The gauge along y on leg x is set up three times: for max alone, for both, for both.
    mine = np.flatnonzero(plan.of(Series(0, 1)))
    setup = plan.setup.copy()
    setup[mine] = [6, 7, 7, 7, 8, 8]
    values = np.random.default_rng(6).normal(0.0, 1.0, len(plan))
    values[mine] = [100.0, -5.0, 3.0, -7.0, 4.0, -2.0]
    again = GaugePlan(**{**vars(plan), "setup": np.unique(setup, return_inverse=True)[1]})
    row = reduction(DataKind.SIX, (Difference(Series(0, 1)),), PROTOTYPE, again)[0]
    assert row @ values == pytest.approx(((3.0 - (-6.0)) + (4.0 - (-2.0))) / 2.0)
