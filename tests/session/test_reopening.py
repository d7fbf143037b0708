"""Ending a session before its end, and reading after all what was left out."""

from contextlib import closing
from pathlib import Path

import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.session.asking import Style
from orthoglide_cal.session.dialogue import Dialogue
from orthoglide_cal.session.events import Retake

from .going_on import events_of
from .virtual import a_dialogue, answered, opened, readings_of, steps_of, typed, values

RIGHT, SHORT = (typed(readings_of(steps_of(cycles=cycles))) for cycles in (3, 1))
ENDED = "the session was ended"


@pytest.mark.parametrize("answer", ["yes", "n", "0.41", "why"])
def test_s_all_ends_the_session_only_after_yes(tmp_path: Path, answer: str) -> None:
    dialogue, screen = answered(tmp_path / "s.journal", ["-0.64", "s all", answer, "0.41"])
    assert "59 readings are missing." in screen.text
    assert ("End the session here? y/n > ", Style.PROMPT) in screen.shown
    ends = answer.startswith("y")
    assert (dialogue.state.ended is not None) == ends
    assert dialogue.state.skipped == dict.fromkeys(range(2, 61) if ends else (), ENDED)
    assert values(dialogue) == ({1: -0.64} if ends else {1: -0.64, 2: 0.41})


def reopened(path: Path, lines: list[str], agreed: bool = True) -> Dialogue:
    dialogue, _, journal = a_dialogue(path, lines, first=opened(cycles=1))
    with closing(journal):
        dialogue.offer_again(agreed)
        dialogue.run()
        dialogue.publish()
    return dialogue


@pytest.fixture
def ended(tmp_path: Path) -> Path:
    """The journal of a session that was ended after 18 of 24 readings."""
    reopened(tmp_path / "s.journal", [*SHORT[:18], "s all power cut"])
    return tmp_path / "s.journal"


def test_an_ended_session_goes_on_where_it_was_ended(ended: Path) -> None:
    file = ended.with_suffix(".yaml")
    early = file.read_bytes()
    assert len(values(reopened(ended, [], agreed=False))) == 18  # nobody is asked there
    again = reopened(ended, SHORT[18:])
    assert values(again) == dict(enumerate(map(float, SHORT), start=1))
    assert again.state.ended is not None
    assert again.state.skipped == {}
    assert file.read_bytes() != early
    assert reopened(ended, []).state.ended is not None  # nothing is missing: nothing is asked


def test_a_session_file_that_somebody_changed_is_not_replaced(ended: Path) -> None:
    file = ended.with_suffix(".yaml")
    file.write_bytes(file.read_bytes() + b"# mine\n")
    before = file.read_bytes()
    with pytest.raises(UsageError, match="not overwritten"):
        reopened(ended, SHORT[18:])
    assert file.read_bytes() == before


def test_skipped_steps_of_another_set_up_bring_its_readings_with_them(tmp_path: Path) -> None:
    """The stands were moved since: leg X again, and leg Y, to which they come back."""
    path = tmp_path / "s.journal"
    answered(path, [*RIGHT[:9], "s cable", *RIGHT[10:25]])
    dialogue, screen, journal = a_dialogue(path, [])
    with closing(journal):
        dialogue.offer_again(agreed=True)
    (retake,) = [e for e in events_of(path) if isinstance(e, Retake)]
    assert retake.steps == tuple(range(1, 26))
    assert "24 earlier readings are taken again" in " ".join(screen.text.split())
    first, _ = answered(tmp_path / "t.journal", [*RIGHT[:9], "s cable", *RIGHT[10:25], "r 10", "y"])
    assert values(first) == {}  # the key r does the same
