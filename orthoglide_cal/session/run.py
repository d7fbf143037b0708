"""The loop of a session: show a step, wait for an answer, check it, put it on the disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from orthoglide_cal.data import SessionRecord
from orthoglide_cal.estimation import Solution
from orthoglide_cal.session import guide, live
from orthoglide_cal.session.commands import Commands
from orthoglide_cal.session.desk import Desk, Show, Typed
from orthoglide_cal.session.doubts import MODEL_DOUBTS, Question
from orthoglide_cal.session.events import (
    Answered,
    Ended,
    Event,
    Questioned,
    Shortened,
    Taken,
)
from orthoglide_cal.session.gauges.source import Heard
from orthoglide_cal.session.gauges.token import Token
from orthoglide_cal.session.gauges.typed import Refused
from orthoglide_cal.session.intake import Setting, understand, weigh
from orthoglide_cal.session.journal import Journal
from orthoglide_cal.session.record import session_record
from orthoglide_cal.session.state import State, advance, replay
from orthoglide_cal.session.steps import Step, minutes_left


class Run:
    """One sitting: from where the journal ends to the end of the session, or to an interruption."""

    def __init__(
        self, journal: Journal, setting: Setting, desk: Desk, show: Show, now: Callable[[], str]
    ) -> None:
        self.setting = setting
        self.state: State = replay(journal.recovered.events)
        self.desk = desk
        self.show = guide.wrapping(show)
        self._journal = journal
        self._now = now
        self._numbered = {step.number: step for step in setting.steps}
        self._commands = Commands(self)
        self._shown_setup = 0
        self._shown_visit: object = None

    def append(self, kind: type[Event], **values: object) -> None:
        """Put a record on the disk, then let it count."""
        event = kind(at=self._now(), **values)
        self._journal.append(event)
        self.state = advance(self.state, event)

    def run(self) -> State:
        """Lead through what is left.

        Returns:
            The state at the end; its `ended` is set.

        Raises:
            Quit: the operator wants to go on later.
            EOFError, KeyboardInterrupt: interrupted; everything is saved.
            InputError: the journal cannot be written any more.
        """
        while self.state.ended is None:
            if self.state.pending is not None:
                self._ask_again(self.state.pending)
                continue
            step = self.next_step()
            if step is None:
                reason = self.state.shortened.reason if self.state.shortened else "complete"
                self.append(Ended, reason=reason)
                break
            self._announce(step)
            self._ask(step)
        return self.state

    def greet(self, lost_bytes: int = 0) -> None:
        """Say what lies ahead, or what was there already.

        Args:
            lost_bytes: of an unfinished record that an interruption left in the journal.
        """
        setting, state = self.setting, self.state
        minutes = minutes_left(setting.steps)
        for line in guide.opening(setting.machine, setting.steps, state, setting.name, minutes):
            self.show(line)
        if lost_bytes:
            self.show(
                f"The interruption cut off the last entry ({lost_bytes} bytes): ignored. No"
                " reading that was shown as saved is missing.",
                "bad",
            )
        if len(self._journal.recovered.events) > 1:
            count = len(state.accepted)
            self.show(f"Resumed: {count} reading{'' if count == 1 else 's'} so far.", "good")
            solution = self._solution()
            if solution is not None:
                self.show(guide.offsets_line(solution), "dim")

    def record(self) -> SessionRecord:
        """The session file's content as it stands."""
        return session_record(self.state, self.setting.steps, self.setting.machine)

    def next_step(self) -> Step | None:
        """The first step that still has to be measured."""
        return next((s for s in self.setting.steps if self.state.is_open(s.number)), None)

    def step(self, number: int) -> Step | None:
        """The step with this number."""
        return self._numbered.get(number)

    def _announce(self, step: Step) -> None:
        if step.setup != self._shown_setup:
            self._shown_setup, self._shown_visit = step.setup, None
            self.show("")
            steps = self.setting.steps
            begun = any(s.setup == step.setup and s.number in self.state.accepted for s in steps)
            lines = guide.setup_lines(steps, step.setup, self.setting.machine, begun)
            self.show(lines[0], "title")
            for line in lines[1:]:
                self.show(line)
        if step.visit != self._shown_visit:
            self._shown_visit = step.visit
            left = [s for s in self.setting.steps if self.state.is_open(s.number)]
            pace = live.pace_min(self.state, self.setting.steps)
            lines = guide.step_lines(
                step,
                len(self.setting.steps),
                self.state.opened.cycles,
                self.setting.machine,
                minutes_left(left, pace),
            )
            self.show("")
            self.show(lines[0], "title")
            for line in lines[1:]:
                self.show(line)

    def _ask(self, step: Step) -> None:
        prompt = guide.prompt(step, self.desk.hint, self.setting.unit)
        answer = self.desk.ask(prompt, step, self.state.takes(step.number))
        if isinstance(answer, Heard):
            self._read(step, answer.token, answer.source)
        elif not self._commands.obey(answer.text, step):
            self._type(step, answer)

    def _ask_again(self, pending: Questioned) -> None:
        """Put the question about the pending reading; it may have been asked before a crash."""
        step = self._numbered[pending.step]
        model = pending.doubt in MODEL_DOUBTS and not pending.about
        self.show(f"Step {step.number}, {pending.value_mm:+.3f} mm:", "question")
        self.show(f"  {pending.question}", "question")
        keys = "k keep it, m the stand moved" if model else "k keep it"
        hint = f", {self.desk.hint}" if self.desk.hint else ""
        prompt = f"{step.number}. {keys}, or read again{hint} > "
        answer = self.desk.ask(prompt, step, self.state.takes(step.number))
        if isinstance(answer, Heard):
            self._read(step, answer.token, answer.source)
            return
        word = answer.text.lower()
        if word in ("k", "y", "keep", "yes"):
            self._keep(step, moved=False)
        elif word == "m" and model:
            self._keep(step, moved=True)
        elif word == "u":
            self.append(Answered, keep=False)
        elif not self._commands.obey(answer.text, step):
            self._type(step, answer)

    def _type(self, step: Step, answer: Typed) -> None:
        if not answer.text:
            self.show("Type the reading, or ? for help.")
            return
        understood = understand(answer, self.setting.unit)
        if isinstance(understood, Refused):
            self.show(understood.why, "bad")
            return
        token, doubt = understood
        self._read(step, token, "typed", doubt)

    def _read(self, step: Step, token: Token, source: str, doubt: Question | None = None) -> None:
        """A reading arrived: accept it, or put the question about it on the disk."""
        minutes = live.minutes_between(self.state.opened.at, self._now())
        arrived = weigh(self.state, self.setting, step, token, minutes, doubt)
        if arrived is None:
            return
        values = {
            "step": step.number,
            "minutes": arrived.minutes,
            "value_mm": arrived.value_mm,
            "raw": token.raw[:80],
            "source": source,
        }
        question = arrived.question
        if question is None:
            self.append(Taken, **values)
            self._acknowledge(step, arrived.value_mm)
            return
        asked = {"doubt": str(question.doubt), "question": question.text, "about": question.about}
        self.append(Questioned, **values, **asked)
        if arrived.confirmed:
            self.show("Read again, and the same: kept, with a note.")
            self._keep(step, moved=False)

    def _keep(self, step: Step, moved: bool) -> None:
        value = self.state.pending.value_mm if self.state.pending else 0.0
        self.append(Answered, keep=True, moved=moved)
        self._acknowledge(step, value)

    def _acknowledge(self, step: Step, value: float) -> None:
        """Say that it is saved; after the last gauge of a posture, the offsets so far."""
        self.show(f"   saved {value:+.3f} mm", "good")
        following = self.next_step()
        if following is not None and following.visit == step.visit:
            return
        solution = self._solution()
        if solution is None:
            return
        self.show(guide.offsets_line(solution), "dim")
        until = self.setting.until_mm
        if until is None or self.state.shortened or not live.is_known(solution, until):
            return
        dropped = live.unneeded(self.state, self.setting.steps)
        if dropped:
            self._shorten(dropped, until)

    def _solution(self) -> Solution | None:
        setting = self.setting
        return live.solve_so_far(self.state, setting.steps, setting.machine, setting.effects)

    def _shorten(self, dropped: Sequence[Step], until: float) -> None:
        pace = live.pace_min(self.state, self.setting.steps)
        saved = live.saved_cycles(dropped)
        reason = f"ended early, every offset is known within {until:g} mm"
        self.append(Shortened, drop=[step.number for step in dropped], reason=reason)
        minutes = minutes_left(dropped, pace)
        self.show(guide.saved(saved, len(dropped), minutes, until), "good")
        if self.next_step() is not None:
            self.show("The closing isotropic posture is still read: it shows drift and knocks.")
