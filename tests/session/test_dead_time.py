"""Second presses and gauges that never stop, in a real terminal: only what was asked for is kept.

Presses come 0.05 to 1 s apart, with equal and with other values, at prompts and at questions,
within a posture and across two, from gauges that type and from serial ones.
"""

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from orthoglide_cal.session.asking import AFTER_A_DRIVE_S, BETWEEN_GAUGES_S, BY_HAND_S, DeadTime
from orthoglide_cal.session.events import State, replay
from orthoglide_cal.session.journal import decode

from .terminal import PROGRAM, PROMPT, QUESTION, SerialLine, Terminal

FIRST = ("-0.64", "0.41", "-0.95", "0.43")  # of the first steps, as a healthy machine reads
Press = Callable[[str], None]


@pytest.fixture
def at_the_machine(
    request: pytest.FixtureRequest, tmp_path: Path, line: SerialLine
) -> Iterator[tuple[Terminal, Press]]:
    """The program as it is shipped, and a press of the gauge's button."""
    serial = request.param == "serial"
    options = ("--gauge", f"plain:{line.path}") if serial else ()
    with Terminal(tmp_path, "s.yaml", *options, program=PROGRAM) as terminal:

        def press(value: str) -> None:
            if serial:
                line.send(f"{value}\r".encode())
            else:
                terminal.type(value)

        yield terminal, press


def state_in(folder: Path) -> State:
    path = folder / "s.journal"
    return replay(decode(path.read_bytes(), str(path)).events)


def kept(folder: Path) -> dict[int, float]:
    return {number: item.take.value_mm for number, item in state_in(folder).accepted.items()}


# Of the next gauge of the same posture, or of the next posture.
@pytest.mark.parametrize(
    ("at_the_machine", "apart", "before"),
    [("wedge", 0.12, 0), ("serial", 1.0, 1)],
    indirect=["at_the_machine"],
)
def test_a_second_press_is_no_reading(
    tmp_path: Path, at_the_machine: tuple[Terminal, Press], apart: float, before: int
) -> None:
    terminal, press = at_the_machine
    for number in range(before + 1):
        assert terminal.step() == number + 1
        time.sleep(AFTER_A_DRIVE_S + 0.3 if number else 0.3)
        press(FIRST[number])
    time.sleep(apart)
    press(f"{float(FIRST[before]) + 0.01 * before:.2f}")
    terminal.expect(r"ignored: \S+ arrived \d\.\d\d s after the last one")
    terminal.expect("Drive to")
    assert terminal.step() == before + 2
    assert kept(tmp_path) == {n + 1: float(v) for n, v in enumerate(FIRST[: before + 1])}
    time.sleep(AFTER_A_DRIVE_S + 0.2)
    press(FIRST[before + 1])
    terminal.expect("saved")
    assert list(kept(tmp_path)) == list(range(1, before + 3))


@pytest.mark.parametrize(("apart", "second"), [(0.12, "55.5"), (1.0, "k")])
def test_a_second_press_answers_no_question(tmp_path: Path, apart: float, second: str) -> None:
    with Terminal(tmp_path, "s.yaml", program=PROGRAM) as terminal:
        assert terminal.step() == 1
        terminal.type("55.5")  # beyond the gauge's travel
        time.sleep(apart)
        terminal.type(second)
        terminal.expect("ignored: ")
        terminal.expect(QUESTION)
        assert state_in(tmp_path).pending is not None
        assert kept(tmp_path) == {}
        time.sleep(BETWEEN_GAUGES_S + 0.2)
        terminal.type("k")
        terminal.expect("saved")


@pytest.mark.parametrize(
    ("at_the_machine", "period"), [("wedge", 0.03), ("serial", 0.9)], indirect=["at_the_machine"]
)
def test_a_gauge_in_continuous_output_stores_nothing(
    tmp_path: Path, at_the_machine: tuple[Terminal, Press], period: float
) -> None:
    terminal, press = at_the_machine
    assert terminal.step() == 1
    until = time.monotonic() + max(2.5, 5.5 * period)
    while time.monotonic() < until:
        press("0.41")
        time.sleep(period)
    terminal.expect(r"Switch off its\s+continuous output")
    assert terminal.seen.count("ignored: ") <= 8
    assert kept(tmp_path) == {}
    terminal.expect("The gauge is quiet now")
    terminal.expect(PROMPT)
    assert kept(tmp_path) == {}
    press("-0.64")
    terminal.expect("saved -0.640")
    assert list(kept(tmp_path)) == [1]


def test_a_number_begun_before_its_prompt_is_not_taken_for_its_end(tmp_path: Path) -> None:
    """ "-0.4" before the prompt and "1" after it are not the reading 1."""
    with Terminal(tmp_path, "s.yaml", program=PROGRAM) as terminal:
        assert terminal.step() == 1
        terminal.type("-0.64\r0.4", end="")
        assert terminal.step() == 2
        time.sleep(BETWEEN_GAUGES_S + 0.2)
        terminal.type("1")
        terminal.expect("ignored: 0.41 arrived before it was asked for")
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
    assert re.fullmatch(r"ignored: -0\.64 arrived \d\.\d\d s after the last one", said)


# ---- the rule itself


def test_each_message_too_soon_begins_the_dead_time_anew() -> None:
    dead = DeadTime()
    dead.begin(100.0, driving=False, mine=True)
    for count in range(1, 5):
        at = 100.0 + count * 0.9 * BETWEEN_GAUGES_S
        assert dead.is_early(at, at, 0, shown=0.0)
        assert dead.ignore(at) == pytest.approx(0.9 * BETWEEN_GAUGES_S)
        assert (dead.unasked, dead.after_reading) == (count, True)
    at += 1.01 * BETWEEN_GAUGES_S
    assert at >= dead.opens
    assert not dead.is_early(at, at, 0, shown=0.0)
    assert dead.ignore(at) is None  # it came before its prompt
    assert (dead.unasked, dead.after_reading) == (1, False)


def test_a_hand_is_told_from_a_gauge_by_its_pace() -> None:
    dead = DeadTime()
    dead.begin(100.0, driving=True, mine=True)
    slow, fast = 5 * 1.1 * BY_HAND_S, 5 * 0.9 * BY_HAND_S
    assert not dead.is_early(100.4, 100.4 + slow, 5, shown=100.1)
    assert dead.is_early(100.4, 100.4 + fast, 5, shown=100.1)
    assert dead.is_early(100.2, 100.2 + slow, 5, shown=100.1)  # no hand is back so soon
    assert dead.is_early(100.4, 100.4 + slow, 5, shown=100.5)  # before its prompt
