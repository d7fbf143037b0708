"""Second presses and gauges that never stop, in a real terminal: nothing unasked is kept."""

import re
import time
from pathlib import Path

import pytest

from orthoglide_cal.session.asking import BETWEEN_GAUGES_S, BY_HAND_S, DeadTime
from orthoglide_cal.session.events import replay

from .going_on import events_of
from .terminal import PROGRAM, Terminal


def kept(folder: Path) -> dict[int, float]:
    return {
        number: item.take.value_mm
        for number, item in replay(events_of(folder / "s.journal")).accepted.items()
    }


def test_a_number_begun_before_its_prompt_is_not_taken_for_its_end(tmp_path: Path) -> None:
    """ "-0.4" before the prompt and "1" after it are not the reading 1."""
    with Terminal(tmp_path, "s.yaml", program=PROGRAM) as terminal:
        assert terminal.step() == 1
        terminal.type("-0.64\r0.4", end="")
        assert terminal.step() == 2
        time.sleep(BETWEEN_GAUGES_S + 0.2)
        terminal.type("1")
        terminal.expect("ignored: 0.41 came before the prompt")
        assert terminal.step() == 2
    assert kept(tmp_path) == {1: -0.64}


def test_what_is_ignored_is_said_on_standard_error(tmp_path: Path) -> None:
    program = f"import sys; sys.stderr = open('e', 'w'); {PROGRAM}"
    with Terminal(tmp_path, "s.yaml", program=program) as terminal:
        assert terminal.step() == 1
        terminal.type("-0.64\r-0.64")
        assert terminal.step() == 2
    assert "ignored" not in terminal.seen
    said = (tmp_path / "e").read_text().splitlines()[0]
    assert re.fullmatch(r"ignored: -0\.64 came \d\.\d\d s after the one before; .+", said)


def test_what_came_before_its_prompt_follows_no_reading() -> None:
    dead = DeadTime()
    dead.begin(100.0, driving=False, mine=True)
    assert dead.ignore(100.9) == pytest.approx(0.9)
    assert (dead.unasked, dead.after_reading) == (1, True)
    assert dead.ignore(dead.opens) is None
    assert (dead.unasked, dead.after_reading) == (1, False)


def test_a_hand_is_told_from_a_gauge_by_its_pace() -> None:
    dead = DeadTime()
    dead.begin(100.0, driving=True, mine=True)
    slow, fast = 5 * 1.1 * BY_HAND_S, 5 * 0.9 * BY_HAND_S
    assert not dead.is_early(100.4, 100.4 + slow, 5, shown=100.1)
    assert dead.is_early(100.4, 100.4 + fast, 5, shown=100.1)
    assert dead.is_early(100.2, 100.2 + slow, 5, shown=100.1)  # no hand is back so soon
    assert dead.is_early(100.4, 100.4 + slow, 5, shown=100.5)  # before its prompt
