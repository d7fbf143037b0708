"""Sessions of several parts before and after: the machine is compared as it was found."""

import numpy as np
import pytest

from orthoglide_cal.estimation.methods import pose_differences
from orthoglide_cal.model import DataKind, without_zeros
from orthoglide_cal.verification.comparison import compare
from tests import truth
from tests.diagnosis.sessions import known
from tests.truth import again

FIRST = truth.make_session(4, truth.PROTOTYPE, truth.MICRON, ("bar_skew",))
LATER = truth.second_session(FIRST, 5)
STEP = (0.8, 0.0, -0.4)


def test_what_was_read_with_a_step_entered_is_left_out() -> None:
    (alone, model), (after, _) = known(FIRST), known(LATER)
    usual = compare(alone, after, model)
    stepped, _ = known(again(FIRST, entered=STEP))
    found = compare(stepped, after, model)
    assert found.before == pytest.approx(usual.before, abs=1e-9)
    assert found.covariance == pytest.approx(usual.covariance, abs=1e-9)


def test_a_turned_bar_is_compared_with_a_turned_bar() -> None:
    (alone, model), (after, _) = known(FIRST), known(LATER)
    turned, _ = known(again(FIRST, turned=1))
    assert len(compare(turned, after, model)) == len(compare(alone, after, model))
    both = compare(turned, known(again(LATER, turned=1))[0], model)
    assert len(both) == 2 * len(compare(alone, after, model))
    assert len(both.problem.plan) == 36
    assert sum(both.problem.plan.turned) == 18


def test_the_papers_differences_are_those_of_the_machine_as_it_was_found() -> None:
    (alone, model), (stepped, _) = known(FIRST), known(again(FIRST, entered=STEP))
    usual, found = (
        pose_differences(each, model, DataKind.TWELVE).data for each in (alone, stepped)
    )
    assert found == pytest.approx(usual, abs=1e-12)
    # All of them would give something else.
    plan = stepped.plan
    effect = without_zeros(plan, stepped.value)
    gap = effect[60:] - effect[:60]
    assert np.abs(gap).max() > 0.05
