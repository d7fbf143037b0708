"""What `orthocal diagnose` says to a person."""

import shlex
from dataclasses import replace
from pathlib import Path

from orthoglide_cal.diagnosis import Diagnosis
from orthoglide_cal.diagnosis import diagnose as analysed
from orthoglide_cal.files.input import read_input
from orthoglide_cal.results import answer_to
from tests import truth
from tests.diagnosis.command import GAP, SECOND, diagnose, shown, written
from tests.diagnosis.sessions import known
from tests.results.sessions import given


def sound_with(diagnosis: Diagnosis, share: float) -> Diagnosis:
    """The same, but for the probability that nothing is wrong."""
    explanations = (
        each.changed(probability=share) if each.sound else each for each in diagnosis.explanations
    )
    return replace(diagnosis, explanations=tuple(explanations))


class TestText:
    def test_wrapped_lines_keep_their_place(self) -> None:
        lines = shown(SECOND, "--details").splitlines()
        start = next(k for k, line in enumerate(lines) if line.lstrip().startswith("1."))
        column = lines[start].index("1.") + 3
        assert lines[start + 1].startswith(" " * column)
        assert lines[start + 1][column] != " "

    def test_it_says_what_to_do(self) -> None:
        text = " ".join(shown(GAP).split())
        assert "Cause found: the actuator axes do not meet in one point (axis_gap, 91.1 %)" in text
        assert "xy +0.3" in text
        assert f"orthocal diagnose {shlex.quote(str(GAP))} --accept axis_gap" in text
        assert "left out of the fit" in text
        assert "tolerances" not in text
        assert "Stable when tolerances are halved" in " ".join(shown(GAP, "--details").split())
        assert "type in" not in text
        assert "−0.189" in text

    def test_an_open_answer_offers_no_compensation(self) -> None:
        text = " ".join(shown(SECOND).split())
        assert "? Undecided: " in text
        assert "orthocal measure" in text
        assert "--accept" not in text

    def test_a_fault_of_the_measurement_offers_none_either(self, tmp_path: Path) -> None:
        session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("misread",))
        readings, machine = written(tmp_path, session)
        ran = diagnose(readings, "--machine", machine)
        text = " ".join(ran.out.split())
        assert "Cause found: one reading is wrong (misread," in text
        assert "Take this reading again" in text
        assert "--accept" not in text

    def test_a_faint_cause_leaves_room_for_nothing(self) -> None:
        """Beside a cause that hardly shows stands how likely it is that nothing is wrong."""
        from orthoglide_cal.report.case import Case
        from orthoglide_cal.report.documents.diagnosis import diagnosis_document
        from orthoglide_cal.report.markdown import markdown

        readings, model = known(truth.make_session(1, truth.PROTOTYPE, truth.DIAL, ("misread",)))
        read = given(readings, model)
        diagnosis = analysed(readings, model)
        for found, told in (diagnosis, False), (sound_with(diagnosis, 0.217), True):
            case = Case(read, answer_to(read, diagnosed=found))
            text = markdown(diagnosis_document(case).page())
            assert ("21.7 % that nothing is wrong at all" in text) is told
            assert ("nothing is wrong at all" in text) is told

    def test_what_is_less_likely_than_nothing_is_not_called_likeliest(self) -> None:
        """The sound machine is one of the open answers, and then nothing must be wrong."""
        from orthoglide_cal.report.case import Case
        from orthoglide_cal.report.documents.diagnosis import headline

        read = read_input(str(SECOND))
        diagnosis = analysed(read.measured, read.model)
        faint = sound_with(diagnosis, 1.01 * diagnosis.causes[0].probability)
        first, second = (Case(read, answer_to(read, diagnosed=each)) for each in (diagnosis, faint))
        assert headline(first)[1].endswith("leave open what is wrong.")
        assert headline(second)[1].endswith("what is wrong, or whether anything is.")
        (before,), (after,) = (each.answer.release.reasons for each in (first, second))
        assert before.startswith("Something is wrong")
        assert after.startswith("Something may be wrong")
        assert after.endswith("nor from a sound machine.")
