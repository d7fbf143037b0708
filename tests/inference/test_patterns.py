"""What no listed cause makes is described: how, where, how large, and what it gains."""

from typing import Any

import numpy as np
import pytest

from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.diagnosis import headline
from orthoglide_cal.results import answer_to
from orthoglide_cal.schema import Reason
from tests import truth
from tests.inference.sessions import given
from tests.truth.bed import distinguish_bed, draw_bed
from tests.truth.beyond import draw_beyond

# Clear sessions: 4 σ from every other claim.
CLEAR = [
    ("settles", "leg", 3), ("repeats", "leg", 3), ("steps", "leg", 1),
]  # fmt: skip


IN_BEDS = [
    ("steps", "half", 3), *(
        pytest.param(how, kind, seed, marks=pytest.mark.slow) for how, kind, seed in (
            ("settles", "quarter", 1), ("drifts", "ring", 1), ("scatters", "half", 1),
            # 90 times the noise, and steady in part.
            ("drifts", "everything", 900_000),
        )
    ),
]  # fmt: skip


def _code(reason: Reason) -> str:
    return reason.code


@pytest.mark.parametrize(("how", "kind", "seed"), CLEAR)
def test_a_pattern_is_described(how: str, kind: str, seed: int) -> None:
    hidden = draw_beyond(seed, truth.PROTOTYPE, truth.DIAL, how, kind)
    answer = answer_to(given(hidden.session), details=True)
    said: dict[str, Any] = answer.model_dump(mode="json", context=_code)
    assert said["verdict"] == "unexplained"
    best = said["patterns"][0]
    assert (best["how"], best["where"], best["accepted"]) == (how, hidden.where.names, True)
    # Nothing foretells the moment of a step from before it: it came in the last cycle.
    assert how == "steps" or best["heldout_after_mm"] < 0.5 * best["heldout_before_mm"]
    late = best["last_third_after_mm"], best["last_third_before_mm"]
    assert (late[0] < 0.5 * late[1]) if how == "settles" else (None in late) == (how != "steps")
    assert best["heldout_ratio"] == best["heldout_after_mm"] / best["heldout_before_mm"]
    assert best["rms_after_mm"] < 1.2 * truth.DIAL.sigma < best["rms_before_mm"]
    contact = hidden.session.disturbance.contact
    size = max(np.ptp(contact[hidden.seen.plan.zero == k]) for k in range(6))
    # Four standard deviations: one false failure in 10,000.
    assert abs(best["size_mm"] - size) < 2.0 * best["expanded_mm"]
    rows = answer.residuals
    left = np.array([row.measured_mm - (row.with_causes_mm or 0.0) for row in rows])
    assert np.sqrt(np.mean(left**2)) == pytest.approx(best["rms_after_mm"], rel=0.05)
    if how == "steps":
        first, last = (rows[int(at["order"]) - 1] for at in best["between"])
        assert (first.minutes or 0.0) < hidden.shape <= (last.minutes or 0.0)
        assert {first.leg, last.leg} == {best["where"]["leg"]}
    # What is drawn is the true effect, but for the zeros of the gauges.
    drawn, reach = np.array([(*row.pattern_mm, *row.pattern_expanded_mm) for row in rows]).T
    error = drawn - contact
    for gauge in range(6):
        own = hidden.seen.plan.zero == gauge
        assert np.abs(error[own] - error[own].mean()).max() < 2.0 * reach[own].max() + 1e-9
    for found, true in zip(answer.parameters, hidden.session.offsets, strict=True):
        assert abs(found.found - true) < 4.0 * found.std
    # What returns with its posture is never entered.
    assert answer.release.usable == (how != "repeats")
    assert ("beyond_list" in said["release"]["codes"]) == (how != "repeats")


@pytest.mark.parametrize(("how", "kind", "seed"), IN_BEDS)
def test_a_pattern_of_a_bed_acts_in_its_region(how: str, kind: str, seed: int) -> None:
    hidden = draw_bed(seed, how, kind)
    assert distinguish_bed(hidden).clear
    answer = answer_to(given(hidden.session))
    best = answer.patterns[0]
    assert (answer.verdict, best.how, best.where) == ("unexplained", how, hidden.where.names)
    contact = hidden.session.contact
    size = np.std(contact[contact != 0.0]) if how == "scatters" else np.ptp(contact)
    # Four standard deviations: one false failure in 10,000.
    assert abs(best.size_mm - size) < 2.0 * best.expanded_mm
    name = hidden.where.name
    place = f"the touches at the {name} of the bed" if name else "the probe drifts"
    assert place in headline(Case(given(hidden.session), answer))


def test_what_a_listed_cause_makes_is_no_pattern() -> None:
    hidden = truth.make_session(3, truth.PROTOTYPE, truth.DIAL, ("axis_gap",))
    assert answer_to(given(hidden)).patterns == ()


def test_a_wrong_reading_in_addition_is_said_and_holds_the_release() -> None:
    """A cause that moves no parameter by more than U does not."""
    for seed, cause, usable in ((114, "misread", False), (4, "backlash", True)):
        hidden = draw_beyond(seed, truth.LARGE, truth.MICRON, "drifts", "everything", True)
        assert hidden.session.causes == (cause,)
        answer = answer_to(given(hidden.session))
        assert [note.data["id"] for note in answer.notes if note.code == "acts_too"] == [cause]
        assert answer.release.usable == usable


def test_wrong_readings_do_not_stand_for_a_step_beside_a_cause() -> None:
    """With misread beside backlash noise is left, too; backlash and the step are e^49 as likely."""
    hidden = draw_beyond(1_100_024, truth.PROTOTYPE, truth.MICRON, "steps", "leg", True)
    answer = answer_to(given(hidden.session))
    best = answer.patterns[0]
    assert (answer.verdict, best.how, best.where) == ("unexplained", "steps", hidden.where.names)
