"""One prompt, answered by keyboard or gauge; with a clock that only the test moves on."""

import re
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.session.asking import (
    AFTER_A_DRIVE_S,
    ANSWER_S,
    BETWEEN_GAUGES_S,
    BY_HAND_S,
    POLL_S,
    STREAM,
    Asker,
    DeadTime,
    Line,
    Style,
    Unasked,
)
from orthoglide_cal.session.gauges import GaugeLost, LiveGauge, Token

from .terminal import PROGRAM, Terminal
from .virtual import Screen, answered, steps_of, values

STEP = steps_of()[0]
PROMPT = "1. Gauge Y > "
PLACE = "Drive to X 1.000"
ASKED = f"{PLACE}\n{PROMPT}"
WORDS = "Why? > "
READ = Token("-0.64", -0.64, source="plain:x")
ERROR = Token("ERR6\x1b", source="plain:x")


class Scene:
    """Keyboard, gauge and clock in one; what happens at each look is prepared.

    An entry of `looks` is (seconds gone, line or None, what the gauge then says): a list of
    messages, or None if it does not answer. Once they are used up, the input ends.
    """

    def __init__(
        self, looks: Iterable[tuple[float, str | None, list[Token] | None]], live: bool = True
    ) -> None:
        self.live = live
        self.now = 100.0
        self.log: list[str] = []
        self.returns: list[bool] = []
        self.before: list[str] = []  # typed before the next prompt
        self.columns, self.partial, self.resized = 80, "", False
        self._looks = iter(looks)
        self._said: list[Token] | None = []

    def clock(self) -> float:
        return self.now

    def disturbed(self) -> bool:
        resized, self.resized = self.resized, False
        return resized

    def read(self, timeout_s: float | None) -> Line | None:
        if timeout_s == 0.0:
            return Line(self.before.pop()) if self.before else None
        self.log.append(f"read {timeout_s}")
        try:
            gone, line, self._said = next(self._looks)
        except StopIteration:
            raise EOFError from None
        self.now += gone
        return None if line is None else Line(line, self.now, self.now)

    def said(self) -> list[Token] | None:
        said, self._said = self._said, self._said and []
        return said


class Gauge(LiveGauge):
    hint = "press it"
    silence = "Is it on?"

    def __init__(self, scene: Scene, reads_itself: bool = False) -> None:
        self.scene = scene
        self.reads_itself = reads_itself

    def begin(self, step: SessionStep, takes: int) -> None:
        self.scene.log.append(f"begin {step.number} {takes}")

    def poll(self, asked: bool) -> list[Token]:
        self.scene.returns.append(asked)
        said = self.scene.said()
        if said is None:
            raise GaugeLost("It is gone.")
        return said


def at(
    *looks: tuple[float, str | None, list[Token] | None], live: bool = True, gauge: bool = True
) -> tuple[Asker, Screen, Scene]:
    scene, screen = Scene(looks, live), Screen()
    return Asker(scene, screen, Gauge(scene) if gauge else None, scene.clock), screen, scene


def test_the_prompt_alone_is_shown_and_the_keyboard_looked_at_in_turn() -> None:
    asker, screen, scene = at((1.0, None, []), (1.0, "-0.64 ", []))
    assert asker.ask(ASKED, STEP, 2) == "-0.64"
    assert scene.log == ["begin 1 2", f"read {POLL_S}", f"read {POLL_S}"]
    assert screen.shown == [(PROMPT, Style.PROMPT)]


def test_where_words_are_asked_the_gauge_is_not_heard() -> None:
    asker, _, scene = at((9.0, None, [READ]), (1.0, "", [READ]))
    assert asker.ask(WORDS) == ""
    assert scene.returns == [False]  # only to forget what it said before


def test_a_reading_is_shown_in_the_line_of_the_prompt() -> None:
    asker, screen, _ = at((0.1, None, []), (1.0, None, [READ]))
    assert asker.ask(ASKED, STEP) == READ
    assert screen.text == f"{PROMPT}-0.64\n"


@pytest.mark.parametrize(
    "message", [ERROR, Token("0.41", 0.41, source="plain:y", elsewhere="That was gauge 2.")]
)
def test_what_is_no_reading_is_told_and_asked_again(message: Token) -> None:
    asker, screen, _ = at((0.1, None, [message]), (0.1, None, [message, READ]))
    assert asker.ask(ASKED, STEP) == READ
    styles = [style for _, style in screen.shown if style is not Style.PLAIN]
    assert styles == [Style.PROMPT, Style.BAD, Style.PROMPT, Style.BAD, Style.PROMPT]
    assert screen.text.count(f"\n{PLACE}\n{PROMPT}") == 2
    assert message.raw[:4] in screen.text
    assert "\x1b" not in screen.text


def test_of_several_readings_at_once_one_is_taken() -> None:
    asker, _, _ = at((0.1, None, [READ, READ, READ]))
    assert asker.ask(ASKED, STEP) == READ
    with pytest.raises(EOFError):
        asker.ask(ASKED, STEP)


def test_a_lost_gauge_is_looked_for_until_it_is_back() -> None:
    asker, screen, _ = at(*[(0.1, None, None)] * 3, (0.1, None, []), (0.1, None, [READ]))
    assert asker.ask(ASKED, STEP) == READ
    styles = [style for _, style in screen.shown]
    assert styles.count(Style.BAD) == styles.count(Style.GOOD) == 1


def test_keys_work_while_the_gauge_is_lost() -> None:
    asker, screen, _ = at((0.1, None, None), (0.1, "", None), (0.1, "q", None))
    assert asker.ask(ASKED, STEP) == "q"
    assert screen.text.count("It is gone.") == 1


# ---- too soon to be meant


def test_what_a_gauge_said_before_the_prompt_is_ignored_and_the_place_shown_again() -> None:
    asker, screen, scene = at((1.0, "0.5", []))
    scene._said = [READ]
    assert asker.ask(ASKED, STEP) == "0.5"
    ignored = "ignored: -0.64 came before the prompt; if intended, give it again"
    assert screen.text == f"{ignored}\n{PLACE}\n{PROMPT}"


@pytest.mark.parametrize("driving", [False, True])
@pytest.mark.parametrize("second", ["-0.64", "0.41", "k", ""])
def test_a_line_in_the_dead_time_is_said_and_not_taken(driving: bool, second: str) -> None:
    dead = AFTER_A_DRIVE_S if driving else BETWEEN_GAUGES_S
    looks = ((9.0, "-0.64", []), (0.97 * dead, second, []), (1.03 * BETWEEN_GAUGES_S, "0.5", []))
    asker, screen, _ = at(*looks, gauge=False)
    assert asker.ask(ASKED, STEP) == "-0.64"
    asker.rest(driving)
    assert asker.ask(ASKED, STEP) == "0.5"
    said = [text for text, style in screen.shown if style is Style.ASIDE]
    when = f"{0.97 * dead:.2f} s after the one before"
    assert said == [f"ignored: {second or 'Return'} came {when}; if intended, give it again"]
    assert screen.text.endswith(f"{PLACE}\n{PROMPT}")  # shown again


def test_an_answer_that_was_no_reading_begins_no_dead_time() -> None:
    asker, _, _ = at((9.0, "t", []), (0.1, "-0.64", []), gauge=False)
    asker.ask(ASKED, STEP)
    assert asker.ask(ASKED, STEP) == "-0.64"


def test_a_simulated_gauge_is_never_too_soon_nor_a_stream_and_lines_before_it_are_counted() -> None:
    scene, screen = Scene([(2.0, "", [READ])] * 12), Screen()
    asker = Asker(scene, screen, Gauge(scene, reads_itself=True), scene.clock)
    for _ in range(12):
        assert asker.ask(ASKED, STEP) == READ
        asker.rest(driving=True)
        scene.before = ["0.1", "0.2"]
    assert screen.text.count("ignored: 2 lines typed before the prompt") == 11


def test_a_gauge_in_the_dead_time_of_a_typed_reading_is_not_heard() -> None:
    late = (1.1 * AFTER_A_DRIVE_S, None, [READ])
    asker, screen, _ = at((9.0, "0.41", []), (0.5, None, [READ]), late)
    asker.ask(ASKED, STEP)
    asker.rest(driving=True)
    assert asker.ask(ASKED, STEP) == READ
    assert screen.text.count("ignored: -0.64 came 0.50 s after") == 1


def taken_until_it_is_recognised(asker: Asker) -> int:
    """How many messages of a gauge that sends by itself are taken, all of which are taken back."""
    taken = 0
    while not isinstance(answer := asker.ask(ASKED, STEP), Unasked):
        taken += 1
        asker.rest(driving=False)
    assert taken == answer.readings
    with pytest.raises(EOFError):  # from now on in silence
        asker.ask(ASKED, STEP)
    return taken


@pytest.mark.parametrize(("period", "sent"), [(0.02, 1), (0.1, 8), (0.3, 5), (0.6, 1), (1.1, 2)])
@pytest.mark.parametrize("typed", [True, False])
def test_a_gauge_that_sends_by_itself_is_recognised(period: float, sent: int, typed: bool) -> None:
    """However the first message is taken, the next ones are not, and it is taken back."""
    look = (period, "0.41", []) if typed else (period, None, [READ] * sent)
    asker, _, _ = at((9.0, None, []), *[look] * 60, gauge=not typed)
    assert taken_until_it_is_recognised(asker) == 1


@pytest.mark.parametrize("period", [1.5, 2.5, 6.0])
@pytest.mark.parametrize("typed", [True, False])
def test_a_slow_stream_is_recognised_by_its_even_pace(period: float, typed: bool) -> None:
    """What it had sent before is taken back, and nothing of it is heard from then on."""
    look = (period, "0.41", []) if typed else (period, None, [READ])
    asker, _, _ = at((9.0, None, []), *[look] * 13, gauge=not typed)
    assert taken_until_it_is_recognised(asker) == STREAM - 1


def test_a_fast_stream_is_recognised_without_an_even_pace() -> None:
    looks = [(period, None, [READ]) for period in (9.0, 0.3, 0.9, 0.2, 1.0, 0.4, 0.8)]
    assert taken_until_it_is_recognised(at((9.0, None, []), *looks)[0]) == 1


def test_presses_at_a_persons_pace_are_heard() -> None:
    pauses = (2.5, 3.1, 2.4, 4.0, 2.6, 3.3)
    asker, _, _ = at((9.0, None, []), *((pause, None, [READ]) for pause in pauses))
    for _ in range(6):
        assert asker.ask(ASKED, STEP) == READ
        asker.rest(driving=False)


def test_a_gauge_that_is_quiet_again_is_heard() -> None:
    flood = [(0.1, None, [READ])] * 12
    quiet = (1.1 * AFTER_A_DRIVE_S, None, [])
    asker, screen, _ = at((9.0, None, []), *flood, quiet, (9.0, None, [READ]))
    assert asker.ask(ASKED, STEP) == READ
    asker.rest(driving=False)
    assert asker.ask(ASKED, STEP) == Unasked(1)
    assert asker.ask(ASKED, STEP) == READ
    assert "The gauge is quiet now." in screen.text


def test_return_on_a_silent_gauge_says_what_to_check() -> None:
    soon = 0.6 * ANSWER_S
    asker, screen, _ = at((9.0, "", []), (soon, None, []), (soon, None, []), (soon, "q", []))
    assert asker.ask(ASKED, STEP) == "q"
    assert screen.text.count("Is it on?") == 1
    asker, screen, _ = at((9.0, "", []), (soon, None, [READ]))
    assert asker.ask(ASKED, STEP) == READ
    assert "Is it on?" not in screen.text


def test_a_screen_that_changed_shows_the_place_and_what_was_typed_again() -> None:
    asker, screen, scene = at((0.1, None, []), (0.1, "-0.64", []), gauge=False)
    scene.resized, scene.partial = True, "-0.6"
    asker.ask(ASKED, STEP)
    assert screen.text == f"{PROMPT}\n{PLACE}\n{PROMPT}-0.6"


@pytest.mark.parametrize(("live", "itself"), [(True, True), (False, False), (True, False)])
def test_the_end_of_input_is_the_end(live: bool, itself: bool) -> None:
    scene = Scene([], live)
    with pytest.raises(EOFError):
        Asker(scene, Screen(), Gauge(scene, itself), scene.clock).ask(ASKED, STEP)


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
    assert values(answered(tmp_path / "s.journal", [])[0]) == {1: -0.64}


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
    assert dead.ignore(dead.opens) is None


@pytest.mark.parametrize(
    ("shown", "seconds", "begun", "taken"),
    [
        (100.1, 1.1, 100.4, True),
        (100.1, 0.9, 100.4, False),
        (100.1, 1.1, 100.2, False),
        (100.5, 1.1, 100.4, False),
    ],
)
def test_a_hand_is_told_from_a_gauge_by_its_pace(
    shown: float, seconds: float, begun: float, taken: bool
) -> None:
    """It is not back at the keys at once, and what it began before the prompt is no answer."""
    asker, _, _ = at(gauge=False)
    asker._shown = shown
    asker._keys.begin(100.0, driving=True, mine=True)
    line = Line("-0.64", begun, begun + 5 * seconds * BY_HAND_S)
    assert asker._is_meant(line, asker._keys) == taken


def test_what_a_hand_types_evenly_is_no_stream() -> None:
    asker, _, _ = at(gauge=False)
    asker._shown = 0.0
    for begun in (100.0, 103.0, 106.0, 109.0, 112.0):
        assert asker._is_meant(Line("-0.12", begun, begun + 0.6), asker._keys)
        asker._answered = begun, asker._keys
        asker.rest(driving=True)
