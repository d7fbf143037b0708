"""The loop, driven without a terminal: whole sessions, keys, questions, until, resume."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.data import default_machine, session_text
from orthoglide_cal.estimation import solve
from orthoglide_cal.session.gauges.simulated import SimulatedGauge
from orthoglide_cal.session.quit import Quit
from orthoglide_cal.session.record import readings
from orthoglide_cal.session.run import Run

from .virtual import a_run, opened, readings_of, steps_of


def typed(values: list[float], step: int = 0) -> list[str]:
    return [f"{value:.2f}" for value in values[step:]]


def offsets(run: Run) -> np.ndarray:
    machine = default_machine()
    return solve(readings(run.state, run.setting.steps, machine, ""), machine).offsets_mm


def until_the_lines_end(path: Path, lines: list[str], **options: object) -> tuple[Run, str]:
    run, screen, journal = a_run(path, lines, **options)  # type: ignore[arg-type]
    with journal, pytest.raises((EOFError, Quit)):
        run.run()
    return run, screen.text


@pytest.mark.parametrize("protocol", ["double-posture", "single-posture"])
def test_a_whole_session_typed(tmp_path: Path, protocol: str) -> None:
    steps = steps_of(protocol)
    values = readings_of(steps, 4)
    run, screen, journal = a_run(tmp_path / "s.journal", typed(values), first=opened(protocol))
    with journal:
        state = run.run()
    assert state.ended is not None
    assert state.ended.reason == "complete"
    assert [item.take.value_mm for _, item in state.in_time()] == values
    hidden = SimulatedGauge(default_machine(), steps, 4).offsets_mm
    assert np.abs(offsets(run) - hidden).max() < 0.08
    for number in (1, 7, len(steps)):
        assert f"{number}. Gauge" in screen.text
    assert "Offsets, 95 %" in screen.text
    assert max(len(line) for line in screen.text.splitlines()) < 80


def test_every_screenful_fits_24_lines(tmp_path: Path) -> None:
    """From the heading of a set-up to its first prompt, and the table and the help."""
    steps = steps_of()
    values = readings_of(steps)
    lines = [*typed(values)[:20], "t", "?", "q"]
    _, text = until_the_lines_end(tmp_path / "s.journal", lines)
    for screen in text.split("-- Set-up")[1:]:
        assert len(screen[: screen.index(" > ")].splitlines()) <= 23
    table = text[text.index("leg gauge posture") : text.index("replaced: 0")]
    assert len(table.splitlines()) <= 23
    help_text = text[text.index("Type the reading, e.g.") :]
    assert len(help_text[: help_text.index(" > ")].splitlines()) <= 23


def test_intervals_are_shown_once_determined_and_shrink(tmp_path: Path) -> None:
    values = readings_of(steps_of(), 2)
    run, screen, journal = a_run(tmp_path / "s.journal", typed(values))
    with journal:
        run.run()
    text = screen.text
    assert text.index("Offsets, 95 %") > text.index("6. Gauge Z")
    shown = [
        [float(part.split()[0]) for part in line.split("+/-")[1:]]
        for line in text.splitlines()
        if line.startswith("Offsets, 95 %")
    ]
    widths = np.array(shown)
    assert widths.shape == (28, 3)
    # At the end of each leg every interval is narrower than at the end of the leg before.
    ends = widths[[7, 17, 27]]
    assert np.all(np.diff(ends, axis=0) < 0.0)


@pytest.mark.parametrize(("until", "least"), [(0.04, 12), (0.0173, 2)])
def test_until_ends_early_with_the_closing_posture(
    tmp_path: Path, until: float, least: int
) -> None:
    values = readings_of(steps_of(), 2)
    lines = iter(typed(values))
    run, screen, journal = a_run(tmp_path / "s.journal", [], until=until)

    class Reader:
        live = False

        def read(self, timeout_s: float | None) -> str:
            step = run.next_step()
            assert step is not None
            return f"{values[step.number - 1]:.2f}"

        def flush(self) -> None:
            pass

    run.desk._keyboard = Reader()  # type: ignore[assignment]
    with journal:
        state = run.run()
    assert state.ended is not None
    assert f"known within {until:g} mm" in state.ended.reason
    assert len(state.dropped) >= least
    last, _ = state.in_time()[-1]
    assert run.setting.steps[last - 1].posture == "iso"
    assert "Saved: " in screen.text
    machine = default_machine()
    solution = solve(readings(state, run.setting.steps, machine, ""), machine)
    half = np.diff(solution.interval_mm, axis=1) / 2.0
    assert np.all(half <= 1.2 * until)  # the closing reading may widen it a little
    assert next(lines)


def test_until_never_leaves_a_leg_out(tmp_path: Path) -> None:
    """However generous, every leg, gauge and posture is measured once."""
    values = readings_of(steps_of(), 2)
    run, _, journal = a_run(tmp_path / "s.journal", typed(values), until=50.0)
    with journal:
        state = run.run()
    measured = {run.setting.steps[number - 1].cell for number in state.accepted}
    assert measured == {step.cell for step in run.setting.steps}


# ---- keys


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


# ---- questions


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


# ---- the record


def test_the_record_is_the_same_however_often_it_was_interrupted(tmp_path: Path) -> None:
    """The text of the session file, except for the times of day, after one or 20 sittings."""
    values = typed(readings_of(steps_of("single-posture"), 3))
    whole, _, journal = a_run(tmp_path / "a.journal", values, first=opened("single-posture"))
    with journal:
        whole.run()

    def sittings() -> Iterator[Run]:
        for at in range(0, len(values), 2):
            run, _, journal = a_run(
                tmp_path / "b.journal", values[at : at + 2], first=opened("single-posture")
            )
            with journal, contextlib.suppress(EOFError):
                run.run()
            yield run

    *_, last = sittings()
    assert last.state.ended is not None

    def without_times(run: Run) -> str:
        text = session_text(run.record())
        return re.sub(r"(minutes|timestamp|finished|started): [^,}\n]+", r"\1: -", text)

    assert without_times(last) == without_times(whole)
    assert offsets(last).tolist() == offsets(whole).tolist()
