"""Beside data that no readings can be joined to: what a session of its own then says.

The independent truth measures the first data, and the session that is recommended.
"""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.estimation import solve
from orthoglide_cal.inference import NextMeasurement, Verdict, diagnose
from orthoglide_cal.model.measured import DataKind, Readings
from orthoglide_cal.planning import best_next, rank_measurements
from tests import truth
from tests.bench.ambiguous import continued
from tests.inference.sessions import known, readings_of, reduced
from tests.readings import some


def measured(session: truth.Session, option: NextMeasurement, seed: int) -> Readings:
    """The recommended session on the same machine, a day later, without the first one."""
    first, plan = readings_of(session).plan, option.plan
    later = replace(
        plan,
        setup=plan.setup + first.setups,
        part=plan.part + 1,
        order=plan.order + len(first),
        hours=plan.hours + float(first.hours.max()) + 24.0,
    )
    both = readings_of(continued(session, option.changed(plan=later), seed))
    return some(both, np.arange(len(first), len(both)))


@pytest.mark.parametrize("cause", ["axis_gap", "bar_skew"])
@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))]
)
def test_a_gap_and_a_skewed_bar_are_told_apart_afterwards(cause: str, seed: int) -> None:
    """A chance of 0.96 or more for each of 24 sessions: all of them are named rightly."""
    (rival,) = {"axis_gap", "bar_skew"} - {cause}
    session = truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, (cause,))
    readings, model = known(session)
    found = diagnose(reduced(DataKind.SIX, readings, model), model)
    assert found.verdict is Verdict.AMBIGUOUS
    following = best_next(found)
    assert following.session is not None
    assert following.between
    assert following.chance > 0.96
    assert following.minutes < 25.0
    for again in range(3):
        after = diagnose(measured(session, following, again), model)
        assert [each.id for each in after.causes] == [cause]
        assert rival not in after.ambiguous_with


def test_u_is_that_of_the_session_alone() -> None:
    """On average over sessions of it, whatever the differences knew before."""
    session = truth.make_session(5, truth.PROTOTYPE, truth.MICRON)
    readings, model = known(session)
    for following in rank_measurements(diagnose(reduced(DataKind.SIX, readings, model), model)):
        sessions = [measured(session, following, seed) for seed in range(6)]
        reach = [solve(readings, model).expanded_mm.max() for readings in sessions]
        assert following.expanded.max() == pytest.approx(np.mean(reach), rel=0.1)


def test_readings_along_the_leg_are_not_gone_on_with_either() -> None:
    """Only what `measure` takes as a session is ranked, and each names its options."""
    session = truth.make_session(5, truth.PROTOTYPE, truth.DIAL)
    readings, model = known(session)
    assert {each.session for each in rank_measurements(diagnose(readings, model))} == {None}
    found = rank_measurements(diagnose(reduced(DataKind.SIX, readings, model), model))
    told = {each.session for each in found}
    assert told == {"--cycles 1", "--cycles 2", "", "--cycles 5"}
    assert not any(each.continues for each in found)
