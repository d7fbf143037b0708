"""What no listed cause makes is described: how, where, how large, and what it gains."""

from typing import Any

import numpy as np
import pytest

from orthoglide_cal.inference.patterns import HOWS, Course
from orthoglide_cal.results import answer_to
from orthoglide_cal.schema import Reason
from tests import truth
from tests.inference.sessions import given
from tests.printers import UNEVEN, touched
from tests.truth.beyond import draw_beyond
from tests.truth.delta import Layout, places_of

# Clear sessions: 4 σ from every other claim.
CLEAR = [("settles", "leg", 3), ("temperature", "gauge", 2), ("repeats", "leg", 3)]


def _code(reason: Reason) -> str:
    return reason.code


@pytest.mark.parametrize(("how", "kind", "seed"), CLEAR)
def test_a_pattern_is_described(how: str, kind: str, seed: int) -> None:
    hidden = draw_beyond(seed, truth.PROTOTYPE, truth.DIAL, how, kind)
    answer = answer_to(given(hidden.session))
    said: dict[str, Any] = answer.model_dump(mode="json", context=_code)
    assert said["verdict"] == "unexplained"
    best = said["patterns"][0]
    assert (best["how"], best["where"], best["accepted"]) == (how, hidden.where.names, True)
    assert best["heldout_after_mm"] < 0.5 * best["heldout_before_mm"]
    assert best["heldout_ratio"] == best["heldout_after_mm"] / best["heldout_before_mm"]
    assert best["rms_after_mm"] < 1.2 * truth.DIAL.sigma < best["rms_before_mm"]
    assert hidden.session.disturbance is not None
    contact = hidden.session.disturbance.contact
    size = max(np.ptp(contact[hidden.seen.plan.zero == k]) for k in range(6))
    # Four standard deviations: one false failure in 10,000.
    assert abs(best["size_mm"] - size) < 2.0 * best["expanded_mm"]
    for found, true in zip(answer.parameters, hidden.session.offsets, strict=True):
        assert found.found is not None
        assert abs(found.found - true) < 4.0 * found.std
    # What returns with its posture is never entered.
    assert answer.release.usable == (how != "repeats")
    assert ("beyond_list" in said["release"]["codes"]) == (how != "repeats")


def test_what_a_listed_cause_makes_is_no_pattern() -> None:
    hidden = truth.make_session(3, truth.PROTOTYPE, truth.DIAL, ("axis_gap",))
    assert answer_to(given(hidden)).patterns == ()


def test_wrong_readings_do_not_stand_for_a_step_beside_a_cause() -> None:
    """With misread beside backlash noise is left, too; backlash and the step are e^49 as likely."""
    hidden = draw_beyond(1_100_024, truth.PROTOTYPE, truth.MICRON, "steps", "leg", True)
    answer = answer_to(given(hidden.session))
    best = answer.patterns[0]
    assert (answer.verdict, best.how, best.where) == ("unexplained", "steps", hidden.where.names)


def test_a_steady_drift_of_a_probe_is_no_pattern() -> None:
    at = places_of(Layout(places=25, cycles=3), UNEVEN.bed)
    hours, nothing = np.linspace(0.0, 0.5, len(at)), np.zeros(len(at))
    plan = touched(np.column_stack((at, nothing)), hours=hours)
    drifts = HOWS["drifts"](Course(plan, True, nothing, nothing)).columns
    steady = np.stack((np.ones(len(at)), hours), axis=1)
    assert np.abs(np.tensordot(steady, drifts, (0, 0))).max() < 1e-9
    assert np.abs(drifts).max() > 0.1
