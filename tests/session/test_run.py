"""The loop, driven without a terminal: whole sessions, screens, until, resume."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.data import default_machine, session_text
from orthoglide_cal.estimation import solve
from orthoglide_cal.session.gauges.simulated import SimulatedGauge
from orthoglide_cal.session.record import readings
from orthoglide_cal.session.run import Run

from .sittings import offsets, typed, until_the_lines_end
from .virtual import a_run, opened, readings_of, steps_of


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
