"""Under which conditions a result holds, and what is said of them beside the verdict."""

import re
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.readings import Conditions, GaugeIdentity
from orthoglide_cal.model.machine import Details, OwnGauge
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.reports import verification_document
from orthoglide_cal.report.figures import shims
from orthoglide_cal.report.html import html
from orthoglide_cal.report.markdown import markdown
from orthoglide_cal.results.making import validity
from orthoglide_cal.results.verification import compare_reservations, verify
from tests.machines import NOMINAL
from tests.report.cases import changed, report_of
from tests.results import cases
from tests.results.cases import COMPLETE, case_of
from tests.results.sessions import FINE, TRUE, given, session
from tests.sentences import sentences

READINGS = session(TRUE, 3)


def said(conditions: Conditions, model=NOMINAL) -> tuple[str, ...]:
    return tuple(sentences(validity(given(READINGS, model, conditions)).reservations))


def practised(readings: Readings) -> Readings:
    return replace(readings, source=replace(readings.source, simulated=True))


def warmer(start: float, end: float) -> Conditions:
    return COMPLETE.changed(temperature_c=(start, end))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"finished": "2027-02-01T08:00:00+01:00"}, ("no. 41 is overdue", "no. 42 is overdue")),
        ({"finished": "2027-01-31T23:00:00+01:00"}, ()),
        ({"temperature_c": (19.4, 21.3)}, ()),
        ({"temperature_c": (19.2, 21.3)}, ("changed by 2.1 K",)),
        ({"environment": {"temperature_end_c": "23.1"}}, ("changed by 2.4 K",)),
        ({"operator": None, "gauges": ()}, ("Not recorded: operator, gauges.",)),
        ({"started": None, "finished": None}, ("Not recorded: date.",)),
        ({"temperature_c": ()}, ("Not recorded: temperature.",)),
    ],
)
def test_what_a_reader_has_to_know(changes: dict[str, object], words: tuple[str, ...]) -> None:
    found = said(COMPLETE.changed(**changes))
    assert len(found) == len(words)
    for sentence, wanted in zip(found, words, strict=True):
        assert wanted in sentence


def test_the_machine_file_says_what_the_session_does_not() -> None:
    bare = COMPLETE.changed(gauges=(GaugeIdentity(id="no. 41"),))
    missing = "Not recorded: certificate of gauge no. 41, due date of gauge no. 41."
    assert said(bare) == (missing,)
    own = OwnGauge(id="no. 41", certificate="2026-0117", due="2026-01-31")
    (overdue,) = said(bare, changed(NOMINAL, gauges=(own,)))
    assert overdue == "Gauge no. 41 is overdue: its calibration was due on 2026-01-31."
    # Of another certificate than the session's it says nothing.
    other = bare.changed(gauges=(GaugeIdentity(id="no. 41", certificate="2025-0003"),))
    assert said(other, changed(NOMINAL, gauges=(own,))) == (
        "Not recorded: due date of gauge no. 41.",
    )


def test_what_is_written_later_completes_the_copy_in_a_session() -> None:
    first = OwnGauge(id="a", certificate="1"), OwnGauge(id="b", certificate="2")
    copy = NOMINAL.machine.changed(gauges=first, report=Details(place="hall 3"))
    later = OwnGauge(id="a", certificate="1", expanded_mm=0.002), OwnGauge(id="b", certificate="3")
    owner = copy.changed(gauges=later, report=Details(place="hall 4", address="Mill Lane"))
    made = copy.with_papers(owner)
    assert made.report == Details(place="hall 3", address="Mill Lane")
    assert made.gauges == (later[0], first[1])
    assert copy.with_papers(owner.changed(name="another")) == copy


def test_two_sessions_are_compared() -> None:
    def between(second: Conditions) -> tuple[str, ...]:
        both = (validity(given(READINGS, NOMINAL, each)) for each in (COMPLETE, second))
        return tuple(sentences(compare_reservations(*both)))

    assert between(COMPLETE) == ()
    assert between(warmer(22.9, 23.1)) == ()  # 1.9 K warmer
    (warm,) = between(warmer(23.1, 23.3))
    assert "21.1 °C before, 23.2 °C after" in warm
    (other,) = between(COMPLETE.changed(gauges=(*COMPLETE.gauges[:1], COMPLETE.gauges[1].changed(
        id="no. 77"))))  # fmt: skip
    assert other == "Other gauges were used: no. 41, no. 42 before, no. 41, no. 77 after."
    assert between(COMPLETE.changed(operator=None)) == ("After, not recorded: operator.",)


def test_it_stands_beside_the_verdict_of_report_and_verify_and_in_json() -> None:
    late = COMPLETE.changed(finished="2027-02-01T08:00:00+01:00")
    before, after = given(READINGS, NOMINAL, late), given(session(TRUE - TRUE, 5), NOMINAL, late)
    found = verify(before, after, TRUE.tolist())
    verified = verification_document(found)
    reported = report_of(case_of(before))
    for document, where, verdict in (
        (verified, (), "The correction worked as predicted, with a reservation."),
        (reported, ("answer", "validity"), "The offsets may be entered, with care."),
    ):
        notice, data = document.page().notice, document.data()
        for key in where:
            data = data[key]
        assert notice.tone is doc.Tone.WARN
        first, second = data["reservations"]
        # What would make it worthless stands first, and the verdict below.
        assert (f"{notice.title}.", notice.lines[0]) == (first, verdict)
        assert second in str(notice.lines)
    assert verified.data()["before"]["validity"]["gauges"][0]["overdue"] is True
    assert "overdue: " in html(reported.page())


def test_a_simulated_session_is_no_certificate() -> None:
    stamp, readings = "SIMULATED: no machine was measured.", practised(READINGS)
    case = case_of(given(readings, NOMINAL, COMPLETE))
    assert report_of(case).data()["simulated"] is True
    page = report_of(case).page()
    whole = html(page)
    assert markdown(page).startswith(f"**{stamp}**")
    assert re.sub("<[^>]*>", "", whole.partition("<body")[2]).strip(">").startswith(stamp)
    # It is judged as if it had been measured.
    assert (page.stamp, page.kind, page.notice.tone) == (stamp, "Practice report", doc.Tone.GOOD)
    assert 'class="stamp" data-word="SIMULATED"' in whole
    assert '@bottom-left { content: "Practice report OC-' in whole
    one_is_enough = given(practised(session(0.0 * TRUE, 5)), NOMINAL, COMPLETE)
    found = verify(given(READINGS, NOMINAL, COMPLETE), one_is_enough, TRUE.tolist())
    assert found.simulated
    verified = verification_document(found).page()
    assert (verified.stamp, verified.kind) == (stamp, "Verification")
    sound = html(report_of(cases.healthy()).page())
    assert "SIMULATED" not in sound
    assert "Practice" not in sound


def test_the_shims_make_the_rails_meet() -> None:
    """Distances between pairs of lines, from their points alone, before and after shimming."""
    case = cases.named_in_machine()
    found = next(cause for cause in case.answer.causes if cause.id == "axis_gap")
    values = np.array([each.value for each in found.parameters])
    assert values == pytest.approx(cases.GAP, abs=0.05)
    rails = CAUSES["axis_gap"].geometry(FINE.machine.nominal_rails, values)
    points, ways = np.array(rails.points), np.array(rails.directions)

    def gaps() -> list[float]:
        return [
            float(np.cross(ways[i], ways[j]) @ (points[i] - points[j]))
            for i, j in ((0, 1), (1, 2), (2, 0))
        ]

    assert gaps() == pytest.approx(values.tolist())
    for rail, mm, along in shims("axis_gap", found.parameters):
        points["xyz".index(rail), "xyz".index(along[1])] += float(f"{along[0]}{mm}")
    assert gaps() == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    page = report_of(case).page()
    assert "axis_gap" in page.notice.title
    assert "Adjusted by" not in page.signatures
    assert "Adjusted by" in report_of(cases.healthy()).page().signatures
