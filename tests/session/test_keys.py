"""The keys u r n s t p q ? and hostile lines, driven without a terminal."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.session.quit import Quit

from .sittings import typed, until_the_lines_end
from .virtual import a_run, readings_of, steps_of


def test_undo_goes_back_and_keeps_the_old_value(tmp_path: Path) -> None:
    lines = ["-0.64", "0.40", "u", "0.41"]
    run, text = until_the_lines_end(tmp_path / "s.journal", lines)
    assert "Back to step 2" in text
    assert [run.state.accepted[n].take.value_mm for n in (1, 2)] == [-0.64, 0.41]
    record = run.record()
    assert [(r.reading_mm, r.reason) for r in record.retaken] == [(0.4, "taken back")]


def test_retake_asks_for_that_step_then_returns(tmp_path: Path) -> None:
    values = typed(readings_of(steps_of()))
    lines = [*values[:8], "r 7 dial not read straight", values[6], values[8]]
    run, text = until_the_lines_end(tmp_path / "s.journal", lines)
    assert "Retaking step 7 (leg X, ISO, cycle 2, gauge Y)" in text
    assert sorted(run.state.accepted) == list(range(1, 10))
    assert run.record().retaken[0].reason == "dial not read straight"
    assert [number for number, _ in run.state.in_time()][-2:] == [7, 9]


def test_retake_of_a_leg_whose_stand_has_moved_is_the_whole_set_up(tmp_path: Path) -> None:
    values = typed(readings_of(steps_of()))
    lines = [*values[:42], "r 3", "n", "r 3", "y"]
    run, text = until_the_lines_end(tmp_path / "s.journal", lines)
    assert "all 20 readings of that set-up and the 2 of this one" in " ".join(text.split())
    # Leg Y was complete and stays; the stands of leg Z have to be moved for leg X.
    assert sorted(run.state.accepted) == list(range(21, 41))
    assert len(run.state.replaced) == 22
    again, _ = until_the_lines_end(tmp_path / "t.journal", [*values[:22], "r x", "y"])
    assert dict(again.state.accepted) == {}


@pytest.mark.parametrize("line", ["r 99", "r 59", "r -1", "r abc", "r 1e3", "r 0", "r q"])
def test_retake_of_nothing(tmp_path: Path, line: str) -> None:
    run, text = until_the_lines_end(tmp_path / "s.journal", ["-0.64", line])
    assert "There is no reading" in text
    assert list(run.state.accepted) == [1]


def test_notes_stay_with_their_step(tmp_path: Path) -> None:
    lines = ["n door slammed", "-0.64", "n", "second note", "n"]
    run, _ = until_the_lines_end(tmp_path / "s.journal", lines)
    record = run.record()
    assert record.readings[0].note == "door slammed"
    assert record.environment is not None
    assert record.environment["notes"] == "step 2: second note"


def test_skip_needs_a_reason(tmp_path: Path) -> None:
    lines = ["-0.64", "s", "", "s cable in the way", "s", "still in the way"]
    run, text = until_the_lines_end(tmp_path / "s.journal", lines)
    assert "Not skipped" in text
    assert dict(run.state.skipped) == {2: "cable in the way", 3: "still in the way"}
    skipped = run.record().skipped
    assert [(s.leg, s.direction, s.posture) for s in skipped] == [
        ("x", "z", "iso"),
        ("x", "y", "max"),
    ]


def test_skip_all_ends_the_session(tmp_path: Path) -> None:
    values = typed(readings_of(steps_of()))
    run, _, journal = a_run(tmp_path / "s.journal", [*values[:30], "s all power cut"])
    with journal:
        state = run.run()
    assert state.ended is not None
    assert len(state.skipped) == 30


def test_table_help_and_pause(tmp_path: Path) -> None:
    lines = ["-0.64", "0.41", "t", "?", "p", "", "-0.95"]
    run, text = until_the_lines_end(tmp_path / "s.journal", lines)
    assert "-0.640" in text[text.index("leg gauge posture") :]
    assert "undo the last reading" in text
    assert "Paused" in text
    assert 3 in run.state.accepted


def test_quit_saves(tmp_path: Path) -> None:
    path = tmp_path / "s.journal"
    run, _, journal = a_run(path, ["-0.64", "q"])
    with journal, pytest.raises(Quit):
        run.run()
    again, screen, journal = a_run(path, [])
    with journal:
        again.greet()
    assert again.state.accepted == run.state.accepted
    assert "Resumed: 1 reading so far" in screen.text


def test_resuming_says_that_the_stands_are_in_place(tmp_path: Path) -> None:
    path = tmp_path / "s.journal"
    _, text = until_the_lines_end(path, ["-0.64", "q"])
    assert "Drive to the isotropic posture" in text
    _, text = until_the_lines_end(path, ["0.41", "r x", "-0.64"])
    assert "The stands are in place: do not touch them" in text


@pytest.mark.parametrize(
    "line", ["", "hello", "911", "1.2.3", "nan", "\x1b[A", "urr", "u1", "--", "k", "y", "m", "ü"]
)
def test_nothing_but_a_reading_is_a_reading(tmp_path: Path, line: str) -> None:
    run, text = until_the_lines_end(tmp_path / "s.journal", [line, line])
    assert dict(run.state.accepted) == {}
    assert "\x1b" not in text


def test_hostile_lines_at_every_kind_of_prompt(tmp_path: Path) -> None:
    """Random keys and rubbish for a long time: no crash, and the journal replays to the state."""
    rng = np.random.default_rng(8)
    words = [
        "u", "r 1", "r x", "r 3 why", "n hello", "n", "s all", "s no", "t", "p", "?", "k", "m",
        "y", "", "0.12", "-0.3", "1000000", "1e9", "ß0.3", "911", "\x00", "\u202e", "r",
        "s", "0.125", "12.3", "u u", "n " + "x" * 500, "−0,5 mm", "0.01 in", "z", "x",
    ]  # fmt: skip
    path = tmp_path / "s.journal"
    for _ in range(6):
        lines = [words[int(rng.integers(len(words)))] for _ in range(60)]
        run, screen, journal = a_run(path, lines)
        with journal:
            if run.state.ended is not None:
                break
            with contextlib.suppress(EOFError, Quit):
                run.run()
        again, _, journal = a_run(path, [])
        journal.close()
        assert again.state == run.state
        assert max(len(line) for line in screen.text.splitlines()) < 80
        assert all(c.isprintable() or c == "\n" for c in screen.text)
