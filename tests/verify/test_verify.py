"""`verify`: promised against measured, the machine's response, and the decision."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.data import default_machine, read_input
from orthoglide_cal.errors import UsageError
from orthoglide_cal.measured import Differences, Source
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import SIX, double_posture, ideal_plan, reduction, single_posture
from orthoglide_cal.simulation import simulate
from orthoglide_cal.verification import verify
from orthoglide_cal.verification.result import (
    AS_MODELLED,
    EXCHANGED,
    FAIL,
    NO_RESPONSE,
    OPPOSITE,
    OTHER_GAIN,
    PASS,
    UNDECIDED,
)
from tests.report.sessions import fine_gauge, session

SAMPLES = Path(__file__).parents[2] / "sample_data"
MACHINE = default_machine()
TRUE = np.array([-0.53, 0.59, -1.76])


def paper(number: int):
    return read_input(str(SAMPLES / f"experiment{number}.csv"))[0]


def after(applied, seed, **more):
    """A session of the machine whose offsets were TRUE before `applied` was entered."""
    return session(TRUE - np.array(applied), seed, **more)


def test_the_papers_experiments_two_and_three():
    """Promised 0.20, measured 0.21 (sec. 4.2), and the machine responds as the model says."""
    result = verify(paper(2), paper(3), MACHINE, (-0.53, 0.59, -1.76), limit_mm=0.40)
    assert round(result.rms_before_mm, 2) == 0.62
    assert round(result.rms_promised_mm, 2) == 0.20
    assert round(result.rms_after_mm, 2) == 0.21
    assert result.response.agrees
    assert result.response.low > 0.0
    assert all(axis.coefficient and axis.coefficient.agrees for axis in result.axes)
    assert result.answer == AS_MODELLED
    # The residuals of the paper are far above the gauge's noise, and so is their change.
    assert result.change.found
    assert result.decision is not None
    assert result.decision.outcome == PASS
    promised = {d.name: round(d.promised_mm, 2) for d in result.deviations}
    expected = dict(zip(SIX, (-0.28, 0.25, 0.21, -0.14, -0.13, 0.09), strict=True))
    assert promised == pytest.approx(expected, abs=0.0101)


def test_the_response_is_an_independent_regression():
    """β of the overall response against plain least squares on the six published changes."""
    result = verify(paper(2), paper(3), MACHINE, (-0.53, 0.59, -1.76))
    plan = ideal_plan("six", MACHINE)
    matrix = reduction("six", SIX, MACHINE, plan)
    fitted = TRUE  # the paper's own offsets; the response hardly depends on them
    change = np.asarray(paper(3).value) - np.asarray(paper(2).value)
    model = matrix @ (simulate(MACHINE, fitted * 0.0, plan) - simulate(MACHINE, fitted, plan))
    slope, *_ = np.linalg.lstsq(model[:, None], change, rcond=None)
    assert result.response.value == pytest.approx(float(slope[0]), abs=1e-3)


def test_intervals_cover_one_in_95_percent_of_healthy_pairs():
    """400 pairs; a binomial with p = 0.95 leaves 0.915 … 0.985 less than once in 1000 times."""
    rng = np.random.default_rng(7)
    inside = false_changes = false_answers = 0
    for k in range(400):
        applied = rng.uniform(-1.0, 1.0, 3)
        start = rng.uniform(-1.0, 1.0, 3)
        before, later = session(start, 2 * k), session(start - applied, 2 * k + 1)
        result = verify(before, later, MACHINE, applied)
        inside += result.response.agrees
        false_changes += result.change.found
        false_answers += result.answer != AS_MODELLED
    assert 0.915 <= inside / 400 <= 0.985
    # At one in 1000 each, five or more of 400 happen once in 16,000 times.
    assert false_changes <= 4
    assert false_answers <= 4


@pytest.mark.parametrize("plan", [double_posture(MACHINE), single_posture(MACHINE, cycles=3)])
def test_raw_sessions_of_both_protocols(plan: Plan):
    before = session(TRUE, 1, plan=plan)
    result = verify(before, after(TRUE, 2, plan=plan), MACHINE, TRUE)
    assert result.kind == "readings"
    assert result.answer == AS_MODELLED
    assert result.response.value == pytest.approx(1.0, abs=0.05)
    assert not result.change.found
    assert abs(result.rms_promised_mm - result.rms_after_mm) < 0.02


def test_unequal_sessions_share_what_both_determine():
    """Missing readings and other cycles: only common contrasts count, nothing fails."""
    few = double_posture(MACHINE, cycles=1, closing=False)
    before = session(TRUE, 3)
    later = after(TRUE, 4, plan=few.subset(np.arange(len(few)) != 5))
    result = verify(before, later, MACHINE, TRUE)
    assert result.count == 11
    assert result.answer == AS_MODELLED


def test_raw_readings_against_differences():
    before = session(TRUE, 5)
    result = verify(before, paper(3), MACHINE, TRUE)
    assert result.kind == "six"
    assert result.count == 6


@pytest.mark.parametrize(
    ("acted", "answer"),
    [
        (-TRUE, OPPOSITE),
        (TRUE[[1, 0, 2]], EXCHANGED),
        (TRUE[[2, 0, 1]], EXCHANGED),
        (TRUE * 0.0, NO_RESPONSE),
        (TRUE * 0.9, OTHER_GAIN),
    ],
)
def test_what_the_machine_did_instead_is_named(acted, answer):
    result = verify(session(TRUE, 8), after(acted, 9), MACHINE, TRUE)
    assert result.answer == answer
    if answer in (OPPOSITE, EXCHANGED):
        assert result.acted_as_mm == pytest.approx(acted)
    else:
        assert result.acted_as_mm is None


def test_a_gauge_with_another_gain_shows_in_the_coefficient():
    before = session(TRUE, 10, gain=0.95)
    result = verify(before, after(TRUE, 11, gain=0.95), MACHINE, TRUE)
    # Both sessions are read with it, so that the change comes out 5 % too small.
    assert result.response.high < 1.0
    assert result.response.value == pytest.approx(0.95, abs=0.01)


def test_a_change_of_the_machine_is_noticed():
    fine = fine_gauge(MACHINE)
    shim = CAUSES["axis_gap"].at(np.array([0.3, -0.2, 0.25]))
    before = session(TRUE, 12, machine=fine)
    result = verify(before, after(TRUE, 13, machine=fine, effects=(shim,)), fine, TRUE)
    assert result.change.found
    assert result.change.rms_mm > 3.0 * result.change.noise_mm
    still = verify(before, after(TRUE, 14, machine=fine), fine, TRUE)
    assert not still.change.found


def test_an_axis_that_was_not_touched_has_no_coefficient():
    applied = np.array([0.0, 0.59, -1.76])
    result = verify(session(TRUE, 15), after(applied, 16), MACHINE, applied)
    assert [axis.coefficient is None for axis in result.axes] == [True, False, False]
    assert result.axes[0].agrees


@pytest.mark.parametrize(
    ("limit", "outcome"), [(0.36, PASS), (0.34, UNDECIDED), (0.33, UNDECIDED), (0.30, FAIL)]
)
def test_decision_rule_with_guard_band(limit, outcome):
    """The largest deviation is 0.34 mm with U = 1.96·√2·noise = 0.018 mm."""
    result = verify(paper(2), paper(3), MACHINE, TRUE, limit_mm=limit)
    assert result.decision is not None
    assert result.decision.largest == "y_x"
    assert result.decision.largest_mm == pytest.approx(0.34)
    assert result.decision.expanded_mm == pytest.approx(
        1.95996 * 2**0.5 * MACHINE.gauge.noise_mm, rel=1e-4
    )
    assert result.decision.outcome == outcome


def test_usage_errors():
    single = Differences("single", ("z_x0",), np.array([0.1]), Source("s.csv", ""))
    with pytest.raises(UsageError, match="Nothing was applied"):
        verify(paper(2), paper(3), MACHINE, (0.0, 0.0, 0.0))
    with pytest.raises(UsageError, match="limit"):
        verify(paper(2), paper(3), MACHINE, TRUE, limit_mm=0.0)
    full = replace(
        single,
        names=("z_x0", "z_y0", "z_x+", "z_x-", "z_y+", "z_y-"),
        value=np.array([0.1, 0.2, 0.3, 0.1, 0.2, 0.4]),
    )
    with pytest.raises(UsageError, match="different things"):
        verify(paper(2), full, MACHINE, TRUE)
