"""Questions about readings: read again, keep, declare the stand moved."""

from pathlib import Path

import numpy as np
import pytest

from .sittings import offsets, typed, until_the_lines_end
from .virtual import a_run, readings_of, steps_of


def with_slip(at: int = 9) -> list[str]:
    """Typed readings up to step `at`, whose dial was read one revolution off."""
    values = readings_of(steps_of(), 1)
    return [*typed(values)[: at - 1], f"{values[at - 1] + 1.0:.2f}"]


def test_a_slip_is_questioned_and_can_be_read_again(tmp_path: Path) -> None:
    good = f"{readings_of(steps_of(), 1)[8]:.2f}"
    run, text = until_the_lines_end(tmp_path / "s.journal", [*with_slip(), good])
    assert "from the last cycle: one revolution?" in text
    assert run.state.accepted[9].take.value_mm == float(good)
    assert "read again: 0.990 mm from the last cycle" in run.record().retaken[0].reason


def test_a_second_doubtful_reading_replaces_the_first(tmp_path: Path) -> None:
    worse = f"{float(with_slip()[-1]) + 1.0:.2f}"
    run, text = until_the_lines_end(tmp_path / "s.journal", [*with_slip(), worse, "k"])
    assert "two revolutions?" in text
    assert run.state.accepted[9].take.value_mm == float(worse)
    assert [r.reading_mm for r in run.record().retaken] == [float(with_slip()[-1])]


def test_a_slip_can_be_kept_with_a_note(tmp_path: Path) -> None:
    run, _ = until_the_lines_end(tmp_path / "s.journal", [*with_slip(), "k"])
    assert run.state.pending is None
    note = run.record().readings[8].note
    assert note.startswith("kept although questioned: 0.990 mm")
    assert run.record().readings[8].reading_mm == float(with_slip()[-1])


def test_the_same_reading_again_is_kept_without_a_second_question(tmp_path: Path) -> None:
    lines = with_slip()
    run, text = until_the_lines_end(tmp_path / "s.journal", [*lines, lines[-1]])
    assert "Read again, and the same" in text
    assert text.count("one revolution?") == 1
    assert run.state.accepted[9].take.value_mm == float(lines[-1])


@pytest.mark.parametrize("line", ["u", "t", "?", "n what", "hello", ""])
def test_keys_work_at_a_question(tmp_path: Path, line: str) -> None:
    run, _ = until_the_lines_end(tmp_path / "s.journal", [*with_slip(), line])
    assert (run.state.pending is None) == (line == "u")
    assert sorted(run.state.accepted) == list(range(1, 9))


def test_a_question_is_put_again_after_a_crash(tmp_path: Path) -> None:
    path = tmp_path / "s.journal"
    until_the_lines_end(path, with_slip())
    run, text = until_the_lines_end(path, ["k"])
    assert "one revolution?" in text
    assert 9 in run.state.accepted


def test_a_moved_stand_gets_a_new_zero_and_the_offsets_stay_right(tmp_path: Path) -> None:
    values = readings_of(steps_of(), 1)
    steps = steps_of()
    knocked = [
        v + 0.5 if s.number >= 29 and s.series == (1, 0) else v
        for s, v in zip(steps, values, strict=True)
    ]
    lines = typed(knocked)
    lines.insert(29, "m")
    run, screen, journal = a_run(tmp_path / "s.journal", lines)
    with journal:
        run.run()
    assert "the stand seems to have moved since step 27" in screen.text
    labels = {r.gauge for r in run.record().readings if (r.leg, r.direction) == ("y", "x")}
    assert labels == {"", "(moved at step 29)"}
    healthy, _, journal = a_run(tmp_path / "h.journal", typed(values))
    with journal:
        healthy.run()
    assert np.abs(offsets(run) - offsets(healthy)).max() < 0.01


def test_a_keyboard_layout_is_asked_about_and_never_guessed(tmp_path: Path) -> None:
    run, text = until_the_lines_end(tmp_path / "s.journal", ["ß0.64", "k"])
    assert "-0.640 mm typed on a German keyboard layout: is it?" in text
    assert run.state.accepted[1].take.value_mm == -0.64
    assert "ß0.64" in run.state.accepted[1].take.raw


def test_inches(tmp_path: Path) -> None:
    run, _ = until_the_lines_end(tmp_path / "s.journal", ["0.005", "1.27 mm"], unit="in")
    assert run.state.accepted[1].take.value_mm == 0.127
    assert run.state.accepted[2].take.value_mm == 1.27
