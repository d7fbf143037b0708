"""How sure a verdict is: large faults, one answer for one remedy, patterns that no cause makes."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, diagnose
from orthoglide_cal.model.cause import Place
from tests import truth
from tests.diagnosis.sessions import known
from tests.truth.effects import Effect

SEEDS = range(4)


def measured(
    *effects: Effect, seed: int, gauge: truth.Gauge = truth.MICRON, cycles: int = 3
) -> truth.Session:
    rng = np.random.default_rng([seed, 7])
    plan = truth.standard_plan(truth.PROTOTYPE, rng, cycles=cycles)
    offsets = rng.normal(0.0, 0.5, 3)
    return truth.measure(truth.PROTOTYPE, gauge, plan, offsets, effects, rng)


def ids(found: Diagnosis) -> set[str]:
    return {cause.id for cause in found.causes}


@pytest.mark.parametrize("gauge", [truth.MICRON, truth.DIAL], ids=lambda gauge: gauge.name)
def test_bars_skewed_by_three_tolerances_are_skewed_bars(gauge: truth.Gauge) -> None:
    """Not a smaller skew beside an exchange that did not happen."""
    slopes = (3.0, -2.0, 2.0, 1.0, -3.0, 2.0)
    for seed in SEEDS:
        found = diagnose(*known(measured(Effect("bar_skew", "", slopes), seed=seed, gauge=gauge)))
        assert ids(found) == {"bar_skew"}
        estimates = found.causes[0].parameters
        for true, estimate in zip(slopes, estimates, strict=True):
            assert abs(estimate.value - true) < 4.5 * estimate.std < 2.0


def test_an_exchange_beside_skewed_bars_is_never_passed_over() -> None:
    for seed in range(700, 712):
        hidden = ("bar_skew", "swapped_gauges")
        session = truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, hidden)
        found = diagnose(*known(session))
        assert "bar_skew" in ids(found)
        told = {*ids(found), *found.ambiguous_with, *(fault.id for fault in found.unshown)}
        assert "swapped_gauges" in told


def test_a_miscounted_turn_is_named_although_the_reading_may_just_be_wrong() -> None:
    """A reading one turn off, where a misreading of that size is only three tolerances."""
    for row in (17, 11, 23, 31):
        session = measured(Effect("gauge_slip", "", (1.0,), row=row), seed=row, gauge=truth.DIAL)
        readings, model = known(session)
        tolerances = {**model.machine.tolerances, "misread": 0.3}
        wide = replace(model, machine=model.machine.changed(tolerances=tolerances))
        found = diagnose(readings, wide)
        assert (found.verdict, ids(found)) == ("named", {"gauge_slip"})
        assert found.causes[0].aliases in ((), ("misread",))
        assert f"reading {row + 1})" in found.causes[0].where


def test_readings_to_take_again() -> None:
    """A wrong reading is taken again; a stand that moved is not corrected by that.

    Unless it left one reading before it or, the stand being gone, one after it: nothing that is
    read later can tell such a knock from one wrong reading.
    """
    plan = known(measured(seed=1))[0].plan
    setup = np.flatnonzero(plan.setup == plan.setup[13])
    later = tuple(i for i in setup.tolist() if plan.order[i] >= plan.order[13])
    again = {id: cause.to_read_again for id, cause in CAUSES.items()}
    assert again["misread"](plan, Place((13,))) == (13,)
    assert again["gauge_slip"](plan, Place((13, 0))) == (13,)
    assert again["gauge_slip"](plan, Place((13, 1))) == later
    assert len(later) > 3
    assert again["stand_shift"](plan, Place((13,))) == ()
    rows = setup.tolist()
    assert plan.leg[rows[0]] == 0
    assert again["stand_shift"](plan, Place((rows[1],))) == (rows[0],)
    assert again["gauge_slip"](plan, Place((rows[1], 1))) == (rows[0],)
    assert again["stand_shift"](plan, Place((rows[2],))) == ()
    assert again["stand_shift"](plan, Place((rows[-2],))) == ()
    assert again["stand_shift"](plan, Place((rows[-1],))) == (rows[-1],)
    # On the leg that was read last the next reading will show it; not what was at its start.
    rows = np.flatnonzero(plan.setup == plan.setup[plan.in_time[-1]]).tolist()
    assert again["stand_shift"](plan, Place((rows[-1],))) == ()
    assert again["stand_shift"](plan, Place((rows[1],))) == (rows[0],)
    assert again["bar_skew"](plan, Place()) == ()


def test_a_screw_error_is_never_two_causes() -> None:
    """Its deviation returns with each posture, as nine parameters of two causes can make it.

    Of these sessions four were named bars and squareness, or backlash and a knock.
    """
    verdicts: Counter[str] = Counter()
    for machine, gauge, seed in SCREWS:
        session = truth.make_session(
            seed, machine, gauge, outside="screw_period", scale=(1.0, 1.5, 2.5)[seed % 3]
        )
        found = diagnose(*known(session))
        assert len(ids(found)) < 2
        verdicts[found.verdict] += 1
        if found.verdict == "unexplained":
            assert any("same deviation whenever a posture returns" in n for n in found.notes)
    assert verdicts["named"] == 0
    assert verdicts["unexplained"] >= len(SCREWS) - 2


SCREWS = [
    *((truth.LARGE, truth.MICRON, seed) for seed in (9010, 9013, 9033, 9034)),
    *((truth.LARGE, truth.DIAL, seed) for seed in (9003, 9015, 9024, 9033)),
    *((truth.PROTOTYPE, truth.MICRON, seed) for seed in (9007, 9014, 9023)),
]


def test_two_real_causes_are_still_named_together() -> None:
    """Nine parameters of a skew and a lean that are there, for the check that refuses a screw."""
    session = truth.make_session(5, truth.PROTOTYPE, truth.MICRON, ("bar_skew", "axis_squareness"))
    assert ids(diagnose(*known(session))) == {"bar_skew", "axis_squareness"}
