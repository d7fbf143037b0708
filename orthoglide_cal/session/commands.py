"""The keys that work at every prompt: u r n s t p q ?"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from orthoglide_cal.axes import AXES
from orthoglide_cal.session import guide
from orthoglide_cal.session.desk import Typed
from orthoglide_cal.session.events import (
    Continued,
    Noted,
    Paused,
    Retake,
    Skipped,
    Undone,
)
from orthoglide_cal.session.quit import Quit
from orthoglide_cal.session.steps import Step, step_name

if TYPE_CHECKING:
    from orthoglide_cal.session.run import Run

_KEY = re.compile(r"(?P<key>[urnstpqURNSTPQ?])(?:\s+(?P<rest>.+))?")


class Commands:
    """What the keys do in a running session."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._keys: dict[str, Callable[[str, Step], None]] = {
            "u": self._undo,
            "r": self._retake,
            "n": self._note,
            "s": self._skip,
            "t": self._table,
            "p": self._pause,
            "q": self._quit,
            "?": self._help,
        }

    def obey(self, text: str, step: Step) -> bool:
        """Do what the text says if it is a key, alone or with words after it; else False."""
        match = _KEY.fullmatch(text)
        if match is None:
            return False
        self._keys[match["key"].lower()](_clean(match["rest"] or ""), step)
        return True

    def _undo(self, rest: str, step: Step) -> None:
        state = self._run.state
        if state.before is None:
            self._run.show("There is nothing to undo.")
            return
        self._run.append(Undone)
        after = self._run.next_step()
        where = f" Back to step {after.number}." if after else ""
        self._run.show(f"Undone; the old value is kept as replaced.{where}")

    def _retake(self, rest: str, step: Step) -> None:
        which, _, reason = rest.partition(" ")
        if not which:
            which = self._words("Retake which step (number, or x, y, z for a leg)? > ")
            which, _, reason = which.partition(" ")
        if not which:
            return
        chosen = self._chosen(which, step)
        if not chosen:
            return
        numbers = [item.number for item in chosen]
        self._run.append(Retake, steps=numbers, reason=reason or "retaken")
        self._run.show(f"Retaking {_listed(chosen)}; the old readings are kept as replaced.")

    def _chosen(self, which: str, step: Step) -> list[Step]:
        """The steps to retake; empty after saying why not."""
        run, accepted = self._run, self._run.state.accepted
        if which.lower() in AXES:
            leg = AXES.index(which.lower())
            chosen = [s for s in run.setting.steps if s.leg == leg and s.number in accepted]
            if not chosen:
                run.show(f"Leg {which.upper()} has no reading yet.")
                return []
        else:
            target = run.step(int(which)) if re.fullmatch("[0-9]{1,4}", which) else None
            if target is None or target.number not in {*accepted, *run.state.skipped}:
                run.show(f"There is no reading at step {which[:20]} yet. t shows what there is.")
                return []
            chosen = [target]
        if all(s.setup == step.setup for s in chosen):
            return chosen
        return self._set_up_again({s.setup for s in chosen}, step)

    def _set_up_again(self, setups: set[int], step: Step) -> list[Step]:
        """Earlier set-ups, and the one in hand, whose stands have to move for them."""
        run = self._run
        again = [
            s
            for s in run.setting.steps
            if s.setup in {*setups, step.setup} and s.number in run.state.accepted
        ]
        here = sum(s.setup == step.setup for s in again)
        of_this = f" and the {here} of this one" if here else ""
        run.show(
            "The stands have been moved since then, so the gauges' zeros are others: all"
            f" {len(again) - here} readings of that set-up{of_this} have to be taken again."
        )
        answer = self._words("Take them all again? y/n > ")
        return again if answer.lower() in ("y", "yes") else []

    def _note(self, rest: str, step: Step) -> None:
        text = rest or self._words("Note > ")
        if text:
            self._run.append(Noted, step=step.number, text=text)
            self._run.show(f"Noted at step {step.number}.")

    def _skip(self, rest: str, step: Step) -> None:
        first, _, reason = rest.partition(" ")
        everything = first.lower() == "all"
        why = (reason if everything else rest) or self._words("Why is it skipped? > ")
        if not why:
            self._run.show("Not skipped: a reason is needed.")
            return
        steps = self._run.setting.steps if everything else (step,)
        for item in steps:
            if item.number == step.number or (everything and self._run.state.is_open(item.number)):
                self._run.append(Skipped, step=item.number, reason=why)
        self._run.show(f"Skipped: {why}")

    def _table(self, rest: str, step: Step) -> None:
        for line in guide.table_lines(self._run.state, self._run.setting.steps):
            self._run.show(line)

    def _pause(self, rest: str, step: Step) -> None:
        self._run.append(Paused)
        self._words("Paused; everything is saved. Touch no stand. Return goes on > ")
        self._run.append(Continued)

    def _quit(self, rest: str, step: Step) -> None:
        raise Quit

    def _help(self, rest: str, step: Step) -> None:
        for line in guide.HELP.splitlines():
            self._run.show(line)

    def _words(self, prompt: str) -> str:
        answer = self._run.desk.ask(prompt)
        text = _clean(answer.text) if isinstance(answer, Typed) else ""
        if text == "q":
            raise Quit
        if text == "?":
            self._run.show("Type a few words; Return alone goes back; q saves and quits.")
            return self._words(prompt)
        return text


def _clean(text: str) -> str:
    """Words as they may be stored and shown."""
    return "".join(c for c in text if c.isprintable())[:200].strip()


def _listed(steps: list[Step]) -> str:
    if len(steps) == 1:
        return f"step {steps[0].number} ({step_name(steps[0])})"
    return f"{len(steps)} steps from step {steps[0].number} on"
