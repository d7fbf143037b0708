"""Faults of the measurement, each at one of many places: where, how large, and what they add."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.estimation.solution import zero_free
from orthoglide_cal.model.model import Cause, Model, Place, simulate
from orthoglide_cal.model.orthoglide import PlannedReading, double_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan
from tests import truth
from tests.causes.test_forward import MACHINES, as_plan, standard
from tests.machines import NOMINAL, PROTOTYPE
from tests.truth.effects import Effect, contact_shift, state_with, write_down

PLAN = double_posture(PROTOTYPE)
MIXED = PLAN.subset(np.random.default_rng(2).permutation(len(PLAN)))
RELABELS = [cause for cause in CAUSES.values() if cause.exchanges]
PATTERNS = [cause for cause in CAUSES.values() if cause.placed and not cause.exchanges]
every_relabel = pytest.mark.parametrize("cause", RELABELS, ids=[c.id for c in RELABELS])


def written(
    cause: Cause, size: float | None, place: Place, plan: GaugePlan, values: Floats
) -> Floats:
    """What stands in the record of gauges that would show `values` without the cause."""
    effect = cause.at(np.zeros(0) if size is None else np.array([size]), place)
    heights = cause.contact(values, effect, plan, PROTOTYPE, np.full(len(plan), 0.5))
    return cause.record(heights, effect, plan, PROTOTYPE)


# --- against the independent simulator --------------------------------------------------------

FAULTS = {
    "gauge_drift": (Effect("gauge_drift", parameters=(0.17,), setup=4), Place((2, 0, 0)), 0.17),
    "stand_shift": (Effect("stand_shift", parameters=(-0.13,), setup=1, row=9), Place((9,)), -0.13),
    "gauge_slip": (Effect("gauge_slip", parameters=(-2.0,), setup=2, row=27), Place((27, 0)), -2.0),
    "misread": (Effect("misread", parameters=(0.31,), setup=3, row=29), Place((29,)), 0.31),
    "sign_flip": (Effect("sign_flip", setup=5), Place((2, 1, 0)), None),
    "swapped_gauges": (Effect("swapped_gauges", leg=1), Place((1, 0)), None),
}


@pytest.mark.parametrize(("model", "hidden"), MACHINES.values(), ids=list(MACHINES))
@pytest.mark.parametrize("id", FAULTS)
def test_faults_of_the_measurement_are_those_of_the_truth(
    model: Model, hidden: truth.Machine, id: str
) -> None:
    """At the same place and size, behind arbitrary zeros, and at no other reading."""
    plan = standard(hidden)
    effect, place, size = FAULTS[id]
    offsets = np.array([0.75, 1.6, -1.9])
    zeros = np.random.default_rng(5).uniform(-3.0, 3.0, 6)[plan.setup]
    surface = truth.signals(plan, hidden, state_with(offsets, ())[None])[0] + zeros
    true = write_down(plan, truth.DIAL, surface + contact_shift(plan, (effect,)), (effect,))
    mine = as_plan(plan)
    record = written(CAUSES[id], size, place, mine, simulate(model, offsets, mine) + zeros)
    assert np.abs(record - true).max() < 1e-9
    if not (cause := CAUSES[id]).exchanges:
        spoiled = cause.patterns(mine, (place,)).columns(slice(None)).any(axis=1)
        assert spoiled.tolist() == (np.abs(true - surface) > 1e-9).tolist()
    assert np.abs(record - surface).max() > 0.05


# --- what they add ----------------------------------------------------------------------------


def test_each_pattern_is_what_the_cause_says() -> None:
    """In time, whatever the order of the rows; in one set-up alone."""
    at = 17
    same = MIXED.setup == MIXED.setup[at]
    later = same & (MIXED.order >= MIXED.order[at])
    series = MIXED.series[at]
    expected = {
        ("misread", (at,)): np.arange(60) == at,
        ("gauge_slip", (at, 0)): np.arange(60) == at,
        ("gauge_slip", (at, 1)): later,
        ("stand_shift", (at,)): later,
        ("gauge_drift", (*series, 0)): same * MIXED.hours,
    }
    assert 1 < later.sum() < same.sum() == 10
    for (id, index), pattern in expected.items():
        cause = CAUSES[id]
        columns = cause.patterns(MIXED, (Place(index),)).columns(slice(None))
        assert np.array_equal(columns[:, 0], pattern), id


def test_turns_are_those_of_the_dial_and_counted_in_whole_numbers() -> None:
    slip = CAUSES["gauge_slip"]
    inch = PROTOTYPE.changed(gauge=PROTOTYPE.gauge.changed(revolution_mm=2.54))
    missed = slip.at(np.array([-1.0]), Place((3, 0)))
    change = simulate(Model(inch, (missed,)), np.zeros(3), PLAN)
    assert change[3] == pytest.approx(-2.54)
    assert np.count_nonzero(np.abs(change) > 1e-9) == 1
    plain = PROTOTYPE.changed(gauge=PROTOTYPE.gauge.changed(revolution_mm=None))
    assert slip.possible(PROTOTYPE)
    assert not slip.possible(plain)
    assert not slip.possible(PROTOTYPE.changed(tolerances={"gauge_slip": 0.0}))
    assert CAUSES["misread"].possible(plain)
    (turns,) = (cause.counts for cause in PATTERNS if cause.counts)
    assert turns == slip.counts == {-size: weight for size, weight in turns.items()}
    assert sum(turns.values()) == pytest.approx(1.0)
    assert 0 not in turns
    assert {cause.id for cause in PATTERNS if cause.hides_reading} == {"misread"}


# --- where they may act -----------------------------------------------------------------------


def test_places_are_counted_from_the_plan() -> None:
    count = {id: len(cause.places(PLAN, PROTOTYPE)) for id, cause in CAUSES.items()}
    wide = {id for id, cause in CAUSES.items() if not cause.placed}
    # The shares of all others count in the evidence of `tests.inference.test_hypothesis`.
    assert {count[id] for id in wide} == {1}
    assert (count["exchanged_columns"], count["wrong_unit"]) == (1, 4)
    half = PLAN.subset(np.flatnonzero((PLAN.leg != 1) & (PLAN.direction != 2)))
    assert len(CAUSES["sign_flip"].places(half, PROTOTYPE)) == 3 + 1
    assert [*CAUSES["swapped_gauges"].places(half, PROTOTYPE)] == [(2, 0)]


def test_no_stand_is_knocked_before_its_first_reading() -> None:
    """First in time, not in the file; turns that last to the end are more than the last reading."""
    first, last = (
        {
            int(pick([i for i in range(60) if MIXED.setup[i] == s], key=lambda i: MIXED.order[i]))
            for s in range(6)
        }
        for pick in (min, max)
    )
    knocked = {place[0] for place in CAUSES["stand_shift"].places(MIXED, PROTOTYPE)}
    assert knocked == set(range(60)) - first
    slips = [*CAUSES["gauge_slip"].places(MIXED, PROTOTYPE)]
    assert {i for i, onward in slips if onward} == set(range(60)) - first - last
    assert {i for i, onward in slips if not onward} == set(range(60))


def test_labels_lead_a_technician_to_the_reading() -> None:
    """Those of one gauge, leg or table are told in `tests.inference`."""
    for id, index in (("stand_shift", (2,)), ("gauge_slip", (2, 1))):
        label = CAUSES[id].label(Place(index), PLAN, PROTOTYPE)
        assert label == "from leg x, direction y, max, cycle 1 (reading 3) on"
    misread = CAUSES["misread"].label(Place((30,)), PLAN, PROTOTYPE)
    assert misread == "leg y, direction x, min, cycle 2 (reading 31)"


def test_labels_count_in_time_and_name_any_displacement() -> None:
    plan = PlannedReading.planned(
        [PlannedReading(1, 0, d, Contact.FIXED) for d in (30.0, 0.0, 30.0, 0.0)]
    )
    late_first = GaugePlan(**{**vars(plan), "order": [3, 2, 1, 0]})
    assert late_first.cycles.tolist() == [2, 2, 1, 1]
    assert [PROTOTYPE.reading_words(late_first, k) for k in range(4)] == [
        "leg y, direction x, 30 mm, cycle 2 (reading 4)",
        "leg y, direction x, iso, cycle 2 (reading 3)",
        "leg y, direction x, 30 mm, cycle 1 (reading 2)",
        "leg y, direction x, iso, cycle 1 (reading 1)",
    ]


# --- readings under another sign or label -----------------------------------------------------


@every_relabel
@pytest.mark.parametrize("plan", [PLAN, MIXED], ids=["in time", "mixed"])
def test_twice_is_not_at_all_whatever_the_gauge_zeros(cause: Cause, plan: GaugePlan) -> None:
    """On contrasts W of the record it acts as W T Wᵀ: zeros of any size have no part in it."""
    rng, contrasts = np.random.default_rng(6), zero_free(plan)
    clean = simulate(NOMINAL, np.array([0.6, -0.9, 0.3]), plan) + rng.normal(0.0, 0.1, len(plan))
    for place in cause.places(plan, PROTOTYPE):
        assert cause.reversible(plan, place)
        once = written(cause, None, place, plan, clean)
        assert np.abs(once - clean).max() > 0.1
        twice = written(cause, None, place, plan, once)
        assert twice * cause.unit_mm(place) ** 2 == pytest.approx(clean, rel=1e-12)
        zeros = rng.uniform(-4.0, 4.0, 6)[plan.setup]
        data = contrasts @ written(cause, None, place, plan, clean + zeros)
        undone = contrasts @ written(cause, None, place, plan, contrasts.T @ data)
        undone *= cause.unit_mm(place) ** 2
        assert undone == pytest.approx(contrasts @ clean, abs=1e-12)
        assert np.abs(data - contrasts @ clean).max() > 0.1


def test_gauges_of_which_one_was_not_read_are_not_exchanged() -> None:
    """Of those that do not pair up otherwise, see `tests/inference/test_replanned.py`."""
    for kept in (PLAN.direction != 2, PLAN.leg != 0):
        assert not CAUSES["swapped_gauges"].reversible(PLAN.subset(kept), Place((0, 0)))
