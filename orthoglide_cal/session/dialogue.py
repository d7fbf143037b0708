"""The loop of a session: show a step, wait for an answer, check it, put it on the disk."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from orthoglide_cal.errors import visible
from orthoglide_cal.estimation import Solution
from orthoglide_cal.files import session_text, write_session
from orthoglide_cal.model import AXES
from orthoglide_cal.session import events, wording
from orthoglide_cal.session.asking import Asker, Heard, Style, Typed
from orthoglide_cal.session.checks import Question, judge
from orthoglide_cal.session.events import Doubt, Event, Questioned
from orthoglide_cal.session.gauges.formats import NotAReading, Token, Unit, parse_typed
from orthoglide_cal.session.gauges.simulated import SimulatedGauge
from orthoglide_cal.session.journal import Journal
from orthoglide_cal.session.readings import ReadingsSoFar, Setting
from orthoglide_cal.session.record import session_values
from orthoglide_cal.session.state import State, advance, replay
from orthoglide_cal.session.steps import SessionStep, minutes_left, step_name

_KEY = re.compile(r"(?P<key>[urnstpqURNSTPQ?])(?:\s+(?P<words>.+))?")


class Quit(Exception):
    """The operator leaves a session before its end: saved, to be resumed later."""


@dataclass(eq=False)
class Dialogue:
    """From where the journal ends to the end of the session, or to an interruption."""

    path: Path  # of the session file to be
    journal: Journal
    setting: Setting
    asker: Asker
    now: Callable[[], str]  # the time of day, ISO 8601
    unit: Unit = Unit.MM  # of readings without one
    until_mm: float | None = None  # end once every offset is known this well; else take them all
    state: State = field(init=False)
    _shown: tuple[int | None, object] = (None, None)  # set-up and visit

    def __post_init__(self) -> None:
        self.state = replay(self.journal.recovered.events)
        self._so_far = ReadingsSoFar(self.state, self.setting)

    @property
    def so_far(self) -> ReadingsSoFar:
        """The readings that count now."""
        if self._so_far.state is not self.state:
            self._so_far = ReadingsSoFar(self.state, self.setting)
        return self._so_far

    def write(self, event: Event) -> None:
        """Put a record on the disk, then let it count."""
        self.journal.append(event)
        self.state = advance(self.state, event)

    def greet(self) -> None:
        """Say what lies ahead, or what was there already."""
        recovered = self.journal.recovered
        lines = wording.opening_lines(self.state, self.setting, str(self.path))
        said = [("\n".join(lines), Style.PLAIN)]
        if recovered.lost:
            lost = (
                f"The interruption cut off the last entry ({recovered.lost} bytes): ignored. No"
                " reading that was shown as saved is missing."
            )
            said.append((lost, Style.BAD))
        if len(recovered.events) > 1:
            count = len(self.state.accepted)
            resumed = f"Resumed: {count} reading{'' if count == 1 else 's'} so far."
            said += [(resumed, Style.GOOD), *self._offsets()]
        self._say(*said)

    def run(self) -> State:
        """Lead through what is left, to the state at the end.

        Raises:
            Quit, EOFError, KeyboardInterrupt: left or interrupted; everything is saved.
            InputError: the journal cannot be written any more.
        """
        while self.state.ended is None:
            if self.state.pending is not None:
                self._ask_about(self.state.pending)
            elif (step := self.next_step()) is not None:
                self._announce(step)
                prompt = wording.prompt(step, self.asker.hint, self.unit)
                answer = self.asker.ask(prompt, step, self.state.takes(step.number))
                self._receive(answer, step)
            else:
                reason = self.state.shortened.reason if self.state.shortened else "complete"
                self.write(events.Ended(self.now(), reason))
        return self.state

    def publish(self) -> None:
        """Write the session file, and say so; a second time changes nothing.

        Raises:
            UsageError: another file has the name.
            InputError: it cannot be written.
        """
        values = session_values(self.so_far)
        if not self.path.exists() or self.path.read_bytes() != session_text(values).encode():
            write_session(values, self.path)
        lines = wording.closing_lines(self.state, str(self.path))
        self.asker.show("\n".join(lines), Style.GOOD)

    def reveal(self, solution: Solution) -> None:
        """After a simulated session, say what was hidden beside what was found."""
        gauge = self.asker.gauge
        if isinstance(gauge, SimulatedGauge):
            self.asker.show("\n".join(wording.truth_lines(solution, gauge.offsets_mm)))

    def close(self) -> None:
        """Let go of the gauge and the journal."""
        if self.asker.gauge is not None:
            self.asker.gauge.close()
        self.journal.close()

    def next_step(self) -> SessionStep | None:
        """The first step that still has to be measured."""
        return next((s for s in self.setting.steps if self.state.is_open(s.number)), None)

    def _say(self, *texts: str | tuple[str, Style]) -> None:
        styled = [(text, Style.PLAIN) if isinstance(text, str) else text for text in texts]
        for text, style in [(wording.wrapped(text), style) for text, style in styled]:
            self.asker.show(text, style)

    def _announce(self, step: SessionStep) -> None:
        setup, visit = self._shown
        if step.visit == visit:
            return
        self._shown = (step.setup, step.visit)
        said = []
        if step.setup != setup:
            begun = step.setup in {s.setup for s in self.so_far.steps}
            said += _headed(wording.setup_lines(self.setting, step.setup, begun))
        left = [s for s in self.setting.steps if self.state.is_open(s.number)]
        minutes = minutes_left(left, self.so_far.pace_min)
        self._say(*said, *_headed(wording.step_lines(step, self.state, self.setting, minutes)))

    def _ask_about(self, pending: Questioned) -> None:
        """Put the question about the pending reading; it may have been asked before a crash."""
        step = self.setting.steps[pending.step - 1]
        may_move = pending.doubt.compares and pending.about is None
        asked = f"Step {step.number}, {pending.value_mm:+.3f} mm:\n  {pending.question}"
        self._say((asked, Style.QUESTION))
        prompt = wording.question_prompt(pending, self.asker.hint, may_move)
        answer = self.asker.ask(prompt, step, self.state.takes(step.number))
        word = answer.text.lower() if isinstance(answer, Typed) else None
        if word in ("k", "y", "keep", "yes"):
            self._keep(pending)
        elif word == "m" and may_move:
            self._keep(pending, moved=True)
        elif word == "u":
            self.write(events.Answered(self.now(), keep=False))
        else:
            self._receive(answer, step)

    def _receive(self, answer: Typed | Heard, step: SessionStep) -> None:
        """Take an answer for a reading or a key."""
        if isinstance(answer, Heard):
            self._read(step, answer.token, answer.source)
            return
        if self._obey(answer.text, step):
            return
        if not answer.text:
            self._say("Type the reading, or ? for help.")
            return
        try:
            token, layout = parse_typed(answer.text)
        except NotAReading as refusal:
            self._say((str(refusal), Style.BAD))
            return
        doubt = None
        if layout is not None:
            value = token.mm(self.unit) or 0.0
            text = f"{token.raw!r} would be {value:+.3f} mm typed on a {layout} keyboard layout:"
            doubt = Question(Doubt.LAYOUT, f"{text} is it?")
        elif answer.hasty:
            text = "the same again at once: was the button pressed twice?"
            doubt = Question(Doubt.DOUBLE, text)
        self._read(step, token, "typed", doubt)

    def _read(
        self, step: SessionStep, token: Token, source: str, doubt: Question | None = None
    ) -> None:
        """A reading arrived: accept it, or put the question about it on the disk."""
        judged = judge(self.so_far, step, token, self.now(), source, self.unit, doubt)
        if judged is None:
            return
        reading, again = judged
        self.write(reading)
        if not isinstance(reading, Questioned):
            self._acknowledge(step, reading.value_mm)
        elif again:
            self._say("Read again, and the same: kept, with a note.")
            self._keep(reading)

    def _keep(self, reading: Questioned, moved: bool = False) -> None:
        self.write(events.Answered(self.now(), keep=True, moved=moved))
        self._acknowledge(self.setting.steps[reading.step - 1], reading.value_mm)

    def _acknowledge(self, step: SessionStep, value: float) -> None:
        """Say that it is saved; after the last gauge of a posture, the offsets so far."""
        saved = (f"   saved {value:+.3f} mm", Style.GOOD)
        following = self.next_step()
        if following is not None and following.visit == step.visit:
            self._say(saved)
            return
        self._say(saved, *self._offsets())
        if self.until_mm is not None and not self.state.shortened:
            self._shorten(self.until_mm)

    def _offsets(self) -> list[tuple[str, Style]]:
        solution = self.so_far.solution
        return [] if solution is None else [(wording.offsets_line(solution), Style.DIM)]

    def _shorten(self, until_mm: float) -> None:
        """Leave out what the offsets do not need any more, if they are known well enough."""
        so_far = self.so_far
        dropped = so_far.unneeded() if so_far.is_known(until_mm) else []
        if not dropped:
            return
        reason = f"ended early, every offset is known within {until_mm:g} mm"
        self.write(events.Shortened(self.now(), tuple(step.number for step in dropped), reason))
        minutes = minutes_left(dropped, so_far.pace_min)
        self._say((wording.saved_line(dropped, minutes, until_mm), Style.GOOD))
        if self.next_step() is not None:
            self._say("The closing isotropic posture is still read: it shows drift and knocks.")

    def _obey(self, text: str, step: SessionStep) -> bool:
        """Do what a key says, alone or with words after it; False if the text is none."""
        match = _KEY.fullmatch(text)
        if match is None:
            return False
        words = _clean(match["words"] or "")
        match match["key"].lower():
            case "u":
                self._undo()
            case "r":
                self._retake(words, step)
            case "n":
                self._note(words, step)
            case "s":
                self._skip(words, step)
            case "t":
                self._say("\n".join(wording.table_lines(self.state, self.setting.steps)))
            case "p":
                self.write(events.Paused(self.now()))
                self._words("Paused; everything is saved. Touch no stand. Return goes on > ")
                self.write(events.Continued(self.now()))
            case "q":
                raise Quit
            case _:
                self._say(wording.HELP)
        return True

    def _undo(self) -> None:
        if self.state.before is None:
            self._say("There is nothing to undo.")
            return
        self.write(events.Undone(self.now()))
        after = self.next_step()
        where = f" Back to step {after.number}." if after else ""
        self._say(f"Undone; the old value is kept as replaced.{where}")

    def _retake(self, given: str, step: SessionStep) -> None:
        words = given or self._words("Retake which step (number, or x, y, z for a leg)? > ")
        which, _, reason = words.partition(" ")
        chosen = self._chosen(which, step) if which else []
        if not chosen:
            return
        numbers = tuple(item.number for item in chosen)
        self.write(events.Retake(self.now(), numbers, reason or "retaken"))
        what = f"step {numbers[0]} ({step_name(chosen[0])})"
        if len(chosen) > 1:
            what = f"{len(chosen)} steps from step {numbers[0]} on"
        self._say(f"Retaking {what}; the old readings are kept as replaced.")

    def _chosen(self, which: str, step: SessionStep) -> list[SessionStep]:
        """The steps to retake; empty after saying why not."""
        state, steps = self.state, self.setting.steps
        if which.lower() in AXES:
            leg = AXES.index(which.lower())
            chosen = [s for s in steps if s.leg == leg and s.number in state.accepted]
            nothing = f"Leg {which.upper()} has no reading yet."
        else:
            number = int(which) if re.fullmatch("[0-9]{1,4}", which) else 0
            done = number in state.accepted or number in state.skipped
            chosen = [steps[number - 1]] if done else []
            nothing = f"There is no reading at step {which[:20]} yet. t shows what there is."
        if not chosen:
            self._say(nothing)
        if all(s.setup == step.setup for s in chosen):
            return chosen
        # Other set-ups, and the one in hand, whose stands have to move for them.
        setups = {step.setup, *(s.setup for s in chosen)}
        again = [s for s in steps if s.setup in setups and s.number in state.accepted]
        here = sum(s.setup == step.setup for s in again)
        of_this = f" and the {here} of this one" if here else ""
        self._say(
            "The stands have been moved since then, so the gauges' zeros are others: all"
            f" {len(again) - here} readings of that set-up{of_this} have to be taken again."
        )
        answer = self._words("Take them all again? y/n > ")
        return again if answer.lower() in ("y", "yes") else []

    def _note(self, given: str, step: SessionStep) -> None:
        text = given or self._words("Note > ")
        if text:
            self.write(events.Noted(self.now(), step.number, text))
            self._say(f"Noted at step {step.number}.")

    def _skip(self, given: str, step: SessionStep) -> None:
        first, _, reason = given.partition(" ")
        everything = first.lower() == "all"
        why = (reason if everything else given) or self._words("Why is it skipped? > ")
        if not why:
            self._say("Not skipped: a reason is needed.")
            return
        for item in self.setting.steps if everything else (step,):
            if item.number == step.number or self.state.is_open(item.number):
                self.write(events.Skipped(self.now(), item.number, why))
        self._say(f"Skipped: {why}")

    def _words(self, prompt: str) -> str:
        answer = self.asker.ask(prompt)
        text = _clean(answer.text) if isinstance(answer, Typed) else ""
        if text == "q":
            raise Quit
        if text == "?":
            self._say("Type a few words; Return alone goes back; q saves and quits.")
            return self._words(prompt)
        return text


def _headed(lines: Sequence[str]) -> list[tuple[str, Style]]:
    """A heading, with a blank line above it, and what belongs to it."""
    return [(f"\n{lines[0]}", Style.TITLE), ("\n".join(lines[1:]), Style.PLAIN)]


def _clean(text: str) -> str:
    """Words as they may be stored and shown."""
    return visible(text)[:200].strip()
