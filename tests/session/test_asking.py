"""One prompt, answered by keyboard or gauge; with a clock that only the test moves on."""

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import pytest

from orthoglide_cal.session.asking import (
    HASTE_S,
    POLL_S,
    RECONNECT_S,
    Asker,
    GaugeLost,
    Heard,
    LiveGauge,
    Style,
    Typed,
)
from orthoglide_cal.session.events import Doubt, Questioned
from orthoglide_cal.session.gauges.formats import Token
from orthoglide_cal.session.steps import SessionStep

from .virtual import Screen, a_dialogue, steps_of

STEP = steps_of()[0]
PROMPT = "1. Gauge Y > "
READ = Heard(Token("-0.64", -0.64), "plain:x")
ERROR = Heard(Token("ERR6\x1b"), "plain:x")


class Scene:
    """Keyboard, gauge and clock in one; what happens at each look is prepared.

    An entry of `looks` is (seconds gone, line or None, what the gauge then says): a list of
    messages, or None if it does not answer. Once they are used up, the input ends.
    """

    def __init__(
        self, looks: Iterable[tuple[float, str | None, list[Heard] | None]], live: bool = True
    ) -> None:
        self.live = live
        self.now = 100.0
        self.log: list[str] = []
        self.returns: list[bool] = []
        self._looks = iter(looks)
        self._said: list[Heard] | None = []

    def clock(self) -> float:
        return self.now

    def flush(self) -> None:
        self.log.append("flush")

    def read(self, timeout_s: float | None) -> str | None:
        self.log.append(f"read {timeout_s}")
        try:
            gone, line, self._said = next(self._looks)
        except StopIteration:
            raise EOFError from None
        self.now += gone
        return line


class Gauge(LiveGauge):
    """The scene's gauge."""

    hint = "press it"

    def __init__(self, scene: Scene, reads_itself: bool = False) -> None:
        self.scene = scene
        self.reads_itself = reads_itself
        self.attempts = 0

    def begin(self, step: SessionStep, takes: int) -> None:
        self.scene.log.append(f"begin {step.number} {takes}")

    def poll(self, asked: bool) -> list[Heard]:
        self.scene.returns.append(asked)
        if self.scene._said is None:
            raise GaugeLost("It is gone.")
        return self.scene._said

    def reconnect(self) -> bool:
        self.attempts += 1
        return self.attempts >= 3


def at(
    *looks: tuple[float, str | None, list[Heard] | None], live: bool = True, gauge: bool = True
) -> tuple[Asker, Screen, Scene]:
    scene, screen = Scene(looks, live), Screen()
    return Asker(scene, screen, Gauge(scene) if gauge else None, scene.clock), screen, scene


def test_what_was_said_before_is_forgotten_then_the_prompt_is_shown() -> None:
    asker, screen, scene = at((1.0, None, []), (1.0, "-0.64 ", []))
    assert asker.ask(PROMPT, STEP, 2) == Typed("-0.64")
    assert scene.log == ["begin 1 2", "flush", f"read {POLL_S}", f"read {POLL_S}"]
    assert screen.shown == [(PROMPT, Style.PROMPT)]


def test_where_words_are_asked_the_gauge_is_not_heard() -> None:
    asker, _, scene = at((9.0, None, [READ]), (1.0, "", [READ]))
    assert asker.ask("Why? > ") == Typed("")
    assert scene.log == ["flush", "read None", "read None"]
    assert scene.returns == []


@pytest.mark.parametrize(
    ("live", "line", "shown"), [(True, "", 0), (True, None, 1), (False, "", 1), (False, None, 1)]
)
def test_a_reading_begins_a_line_of_its_own(live: bool, line: str | None, shown: int) -> None:
    """A terminal has moved on where somebody pressed Return; otherwise the program does."""
    asker, screen, scene = at((0.1, line, []), (1.0, None, [READ]), live=live)
    assert asker.ask(PROMPT, STEP) == READ
    assert screen.text == PROMPT + "\n" * shown
    assert scene.returns == [line == "", False]


def test_a_typed_line_from_a_pipe_is_shown_without_control_characters() -> None:
    asker, screen, _ = at((0.1, "-0.6\x1b[A", []), live=False)
    asker.ask(PROMPT, STEP)
    assert screen.text == f"{PROMPT}-0.6⟨U+001B⟩[A\n"


@pytest.mark.parametrize(
    "message", [ERROR, Heard(Token("0.41", 0.41), "plain:y", "That was gauge 2.")]
)
def test_what_is_no_reading_is_told_and_asked_again(message: Heard) -> None:
    asker, screen, _ = at((0.1, None, [message]), (0.1, None, [message, READ]))
    assert asker.ask(PROMPT, STEP) == READ
    assert [style for _, style in screen.shown] == [
        *(Style.PROMPT, Style.BAD, Style.PROMPT, Style.BAD, Style.PROMPT, Style.PLAIN)
    ]
    assert message.token.raw[:4] in screen.text
    assert "\x1b" not in screen.text


def test_of_several_readings_at_once_one_is_taken() -> None:
    asker, _, _ = at((0.1, None, [READ, READ, READ]))
    assert asker.ask(PROMPT, STEP) == READ
    with pytest.raises(EOFError):
        asker.ask(PROMPT, STEP)


def test_a_lost_gauge_is_tried_again_now_and_then_until_it_is_back() -> None:
    soon = 0.6 * RECONNECT_S
    looks = [(0.1, None, None), *[(soon, None, [READ])] * 6]
    asker, screen, scene = at(*looks)
    assert asker.ask(PROMPT, STEP) == READ
    gauge = asker.gauge
    assert isinstance(gauge, Gauge)
    # At every second look it is time for another attempt; the third one succeeds.
    assert gauge.attempts == 3
    assert scene.log.count(f"read {POLL_S}") == 7
    assert len(scene.returns) == 2
    styles = [style for _, style in screen.shown]
    assert styles.count(Style.BAD) == styles.count(Style.GOOD) == 1


def test_keys_work_while_the_gauge_is_lost() -> None:
    asker, _, scene = at((0.1, None, None), (0.1, "", None), (0.1, "q", None))
    assert asker.ask(PROMPT, STEP) == Typed("q")
    assert scene.returns == [False]


@pytest.mark.parametrize(
    ("waits", "lines", "live", "hasty"),
    [
        ((2.0, 0.9 * HASTE_S), ("-0.95", "-0.95"), True, True),
        ((2.0, 1.1 * HASTE_S), ("-0.95", "-0.95"), True, False),  # a person can do that
        ((2.0, 0.9 * HASTE_S), ("-0.95", "-0.94"), True, False),
        ((2.0, 0.9 * HASTE_S), ("k", "k"), True, False),  # a key, not a reading
        ((0.1, 0.1), ("-0.95", "-0.95"), True, False),  # a machine is typing
        ((2.0, 0.1), ("-0.95", "-0.95"), False, False),  # a pipe
    ],
)
def test_the_same_number_again_at_once_is_hasty(
    waits: tuple[float, float], lines: tuple[str, str], live: bool, hasty: bool
) -> None:
    looks = [(wait, line, []) for wait, line in zip(waits, lines, strict=True)]
    asker, _, _ = at(*looks, live=live, gauge=False)
    assert asker.ask(PROMPT, STEP) == Typed(lines[0])
    assert asker.ask(PROMPT, STEP) == Typed(lines[1], hasty)


def test_a_second_press_is_asked_about_and_the_next_reading_replaces_it(tmp_path: Path) -> None:
    waits = ((2.0, "-0.64"), (2.0, "0.41"), (0.9 * HASTE_S, "0.41"), (2.0, "-0.95"))
    scene = Scene([(wait, line, []) for wait, line in waits])
    dialogue, _, journal = a_dialogue(tmp_path / "s.journal", [])
    dialogue.asker.keyboard, dialogue.asker.clock = scene, scene.clock
    with closing(journal), pytest.raises(EOFError):
        dialogue.run()
    assert [item.take.value_mm for item in dialogue.state.accepted.values()] == [-0.64, 0.41, -0.95]
    (old,) = dialogue.state.replaced
    assert isinstance(old.take, Questioned)
    assert (old.take.step, old.take.value_mm, old.take.doubt) == (3, 0.41, Doubt.DOUBLE)


@pytest.mark.parametrize(("live", "itself"), [(True, True), (False, False), (True, False)])
def test_the_end_of_input_is_the_end(live: bool, itself: bool) -> None:
    scene = Scene([], live)
    with pytest.raises(EOFError):
        Asker(scene, Screen(), Gauge(scene, itself), scene.clock).ask(PROMPT, STEP)


def test_a_gauge_that_reads_itself_goes_on_behind_the_end_of_a_pipe() -> None:
    scene = Scene([], live=False)
    scene._said = [READ]
    asker = Asker(scene, Screen(), Gauge(scene, reads_itself=True), scene.clock)
    assert asker.ask(PROMPT, STEP) == READ
    assert asker.ask("Why? > ") == Typed("")
    assert scene.returns == [True]
