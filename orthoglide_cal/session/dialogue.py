"""The loop of a session: show a step, wait for an answer, check it, put it on the disk."""

import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from orthoglide_cal.errors import InputError, command, system_words, visible
from orthoglide_cal.files.readings import session_text
from orthoglide_cal.files.text import write_text
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.planning.steps import (
    GIVES_UP,
    MeasuringProtocol,
    SessionStep,
    clock,
    gauge_moves,
    step_name,
    with_set_ups,
)
from orthoglide_cal.session import events, wording
from orthoglide_cal.session.asking import Asker, Style, Unasked
from orthoglide_cal.session.checks import Question, check
from orthoglide_cal.session.events import Doubt, Event, Questioned, State, advance, replay
from orthoglide_cal.session.gauges import (
    NEAR_MM,
    SimulatedGauge,
    Standing,
    Stood,
    Token,
    parse_typed,
)
from orthoglide_cal.session.journal import Journal
from orthoglide_cal.session.readings import ReadingsSoFar, Setting, count_words
from orthoglide_cal.words import Unit, counted, decimals_for, signed

# What every U before the end leaves out: asking what else may be wrong takes all readings.
UNLESS = "95 % if nothing else is wrong"
WAIT_S = 0.3  # how often a machine that is followed is looked at

# Keys as words, too.
_KEYS = {
    **{key: key for key in "urnstq?"},
    **{"undo": "u", "back": "u", "retake": "r", "note": "n", "skip": "s", "help": "?"},
    **dict.fromkeys(("quit", "exit"), "q"),
}


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
    standing: Standing | None = None  # where a machine that is followed stands
    agreed: bool = False  # that what was left out is read, without asking
    so_far: ReadingsSoFar = field(init=False)  # that count now
    _shown: tuple[object, ...] = (None,)  # the visit of the machine that was shown last

    def __post_init__(self) -> None:
        self.so_far = ReadingsSoFar(replay(self.journal.events), self.setting)

    @property
    def state(self) -> State:
        """The state after all records."""
        return self.so_far.state

    def write(self, event: Event) -> None:
        """Put a record on the disk, then let it count."""
        self.journal.append(event)
        self.so_far = ReadingsSoFar(advance(self.state, event), self.setting)

    def greet(self) -> None:
        """Say what lies ahead, or what was there already."""
        opened, steps, first = self.state.opened, self.setting.steps, self.setting.first
        cycles = counted(opened.cycles, "cycle")
        head = f"{opened.protocol} session, {cycles}, order: {opened.order}"
        if opened.protocol is MeasuringProtocol.BEST:
            head += f"\nFewest readings for the offsets. What is given up: {GIVES_UP}."
            head += " To name what is wrong with a machine, leave out --design."
        if first:
            head = f"Continues {visible(first.path)}, {len(first.readings)} readings:"
            head += " both are solved together at the end."
        gauges = "two gauges" if any(step.stand for step in steps) else "one gauge"
        set_ups = counted(len({step.setup for step in steps}), "set-up")
        moves = counted(gauge_moves(steps), "gauge move")
        following = self.setting.following
        long = wording.duration(following.minutes if following else clock(steps)[-1]).lower()
        counts = f"{len(steps)} readings with {gauges}: {set_ups}, {moves}, {long}. ? is help."
        self.asker.say(f"{head}\nFile     {visible(str(self.path))}\n{counts}")
        if lost := self.journal.lost:
            self.asker.say(
                f"The interruption cut off the last entry ({lost} bytes): ignored. No reading that"
                " was shown as saved is missing.",
                Style.BAD,
            )
        if self.state.count > 1 + bool(self.state.planned):
            resumed = f"Resumed: {counted(len(self.state.accepted), 'reading')} so far."
            self.asker.say(resumed, Style.GOOD)
            self._say_offsets()

    def run(self) -> State:
        """Lead through what is left, to the state at the end.

        Raises Quit, EOFError, KeyboardInterrupt: left or interrupted; everything is saved.
        InputError: the journal cannot be written any more.
        """
        self.offer_again()
        while self.state.ended is None:
            if self.state.pending is not None:
                self._ask_about(self.state.pending)
            elif self.so_far.left:
                self._ask_for(self.so_far.left[0])
            else:
                whole = "ended" if self.state.skipped else "complete"
                reason = next(iter(self.state.dropped.values()), whole)
                self.write(events.Ended(at=self.now(), reason=reason))
        return self.state

    def offer_again(self) -> None:
        """Ask whether what was left out is read after all, and what was kept in doubt read again.

        Without a terminal nobody is asked. Raises Quit, EOFError, KeyboardInterrupt as `run`.
        """
        state, steps, live = self.state, self.setting.steps, self.asker.keyboard.live
        missing = [s for s in steps if s.number in {*state.skipped, *state.dropped}]
        last = self.so_far.steps[-1] if state.accepted else (missing or steps)[0]
        if missing and (self.agreed or live):
            again = with_set_ups(missing, last.setup, steps, state.accepted)
            old = sum(step.number in state.accepted for step in again)
            more = f" For that, {old} earlier readings are taken again: the stands were moved."
            self.asker.say(f"{_are(len(missing))} left out.{more if old else ''}", Style.QUESTION)
            if self.agreed or self._agrees("Read what is missing now? y/n > "):
                self._take_again(again, "reopened")
        taken = state.accepted.items()
        kept = [f"r {step}" for step, item in taken if isinstance(item.take, Questioned)]
        if kept and live and self.state.ended:
            self.asker.say(f"Questioned and kept: {', '.join(kept)}.", Style.QUESTION)
            for word in self._words("Retake which (such as r 14)? Return: none > ").split():
                self._retake(word, last)

    def publish(self) -> None:
        """Write the session file, and say so; a second time changes nothing.

        Raises UsageError if another file has the name, InputError if it cannot be written.
        """
        stored = self.path.read_bytes() if self.path.is_file() else None
        if stored != (text := session_text(self.so_far.session)).encode():
            # What this session wrote when it was ended before may be replaced, nothing else.
            records = self.journal.events
            ends = [at for at, event in enumerate(records, 1) if isinstance(event, events.Ended)]
            before = [ReadingsSoFar(replay(records[:at]), self.setting).session for at in ends]
            mine = stored in [session_text(session).encode() for session in before]
            try:
                write_text(self.path, text, overwrite=mine)
            except InputError as error:
                again = command("measure", str(self.path), options="--resume")
                error.remedy += f" The readings are safe in the journal; then: {again}"
                raise
        state, first = self.state, self.setting.first
        counts = count_words(len(state.accepted), len(state.replaced), len(state.skipped))
        reason = state.ended.reason if state.ended else "unfinished"
        lines = ["", f"Session {reason}: {counts}. Written to {visible(str(self.path))}"]
        until = self.until_mm
        if not (until is None or state.dropped or self._known_within(until)):
            enough = command("plan", options=f"--target {until:g}")
            lines.append(f"Not every offset is known within {until:g} mm. More cycles: {enough}")
        if first:
            lines.append(f"The {len(first.readings)} earlier readings are in the same file.")
        for leg in sorted({step.leg for step in self.setting.steps if step.cell.turned}):
            lines.append(f"Before the next session, turn the bar of leg {AXES[leg].upper()} back.")
        self.asker.show("\n".join(lines), Style.GOOD)

    def reveal(self) -> None:
        """Say, after a simulated session, which offsets were hidden."""
        if isinstance(gauge := self.asker.gauge, SimulatedGauge):
            offsets = zip(AXES, gauge.offsets_mm.tolist(), strict=True)
            words = " ".join(f"{axis} {signed(value, 3)}" for axis, value in offsets)
            self.asker.show(f"True offsets: {words} mm")

    # ---- what is asked

    def _ask_for(self, step: SessionStep) -> None:
        """Show where to drive, as far as it is new or has moved up the screen, and take a reading.

        A new set-up is shown whole; of another visit of the machine its place.
        """
        asker, setting = self.asker, self.setting
        new = step.visit != self._shown
        place = wording.place(step, setting)
        if new:
            gap = "\n"
            if step.setup != self._shown[0]:  # a visit's first entry
                begun = step.setup in {s.setup for s in self.so_far.steps}
                rule, text = wording.set_up(setting, step.setup, begun, asker.columns)
                asker.say(f"\n{rule}", Style.TITLE)
                asker.say(text)
                gap = ""
            left = clock(self.so_far.left)[-1]
            asker.say(f"{gap}{wording.step_line(step, setting, left)}", Style.TITLE)
        if asker.pushed:  # also by the line of a new step
            asker.say(place)
        if new:
            self._wait_for(step)
        self._shown = step.visit
        asker.pushed = False
        touched = step.cell.contact.end
        end = f" at the {touched.upper()} end" if touched else ""
        gauge = f"{step.number}. Gauge {AXES[step.direction].upper()}{end} [{self.unit}]"
        prompt = f"{place}\n{gauge}{asker.hint} > "
        answer = asker.ask(prompt, step, self.state.takes(step.number))
        self._receive(answer, step)

    def _stood(self, step: SessionStep) -> Stood:
        """Place of the machine, if it is followed; says once that it is not any more."""
        if self.standing is None:
            return Stood()
        point = wording.point(step, self.setting)
        try:
            return self.standing.at(*point, self.setting.machine.home_mm)
        except (OSError, ValueError) as gone:
            self.standing.close()
            self.standing = None
            lost = f"LinuxCNC does not answer any more: {system_words(gone)}."
            self.asker.say(f"{lost} Continue by hand: nothing is lost.", Style.BAD)
            return Stood()

    def _wait_for(self, step: SessionStep) -> None:
        """Wait until a machine that is followed stands where the step is read."""
        waiting, keyboard = False, self.asker.keyboard
        while self._stood(step).away_mm > NEAR_MM:
            if not waiting:
                self.asker.say("   waiting until the machine stands there (Return: continue)")
            waiting = True
            if not keyboard.live:
                time.sleep(WAIT_S)
            elif (line := keyboard.read(WAIT_S)) is not None:
                if _KEYS.get(line.text.strip().lower()) == "q":
                    raise Quit
                return

    def _ask_about(self, pending: Questioned) -> None:
        """Put the question about the pending reading; it may have been asked before a crash."""
        step = self.setting.steps[pending.step - 1]
        may_move = pending.doubt.compares and not pending.about
        value = wording.value_text(pending.value_mm, self.unit)
        asked = f"Step {step.number}, {value}:\n  {pending.question}"
        here = step.cell, step.zero
        alike = [s.number for s in self.so_far.steps if (s.cell, s.zero) == here]
        if len(alike) == 1 and pending.doubt.compares:  # either of the two may be the wrong one
            (number,) = alike
            asked += f"\n  Or was step {number} wrong? r {number} reads both again."
        self.asker.say(asked, Style.QUESTION)
        keep = "" if pending.doubt is Doubt.RANGE else "k keep, "
        moved = "m the stand moved, " if may_move else ""
        again = "or read again" if keep else "Read again"
        prompt = f"{asked}\n{step.number}. {keep}{moved}{again}{self.asker.hint} > "
        answer = self.asker.ask(prompt, step, self.state.takes(step.number))
        word, _, why = answer.partition(" ") if isinstance(answer, str) else ("", "", "")
        word = word.lower()
        if word in ("k", "y", "keep", "yes"):
            if not keep:
                self.asker.say(wording.OUT_OF_RANGE, Style.BAD)
                return
            if pending.doubt is Doubt.PLACE:
                why = _clean(why) or self._words("Why is it kept? (Return: it is not) > ")
                if not why:
                    return
                self.write(events.Noted(at=self.now(), step=step.number, text=why))
            self._keep(pending)
        elif word == "m" and may_move:
            self._keep(pending, moved=True)
        elif _KEYS.get(word) == "u":
            self._undo()
        else:
            self._receive(answer, step)

    def _agrees(self, prompt: str) -> bool:
        """True if a question is answered with yes, False with no or Return; else it is asked again.

        Raises Quit.
        """
        while (answer := self._words(prompt).lower()) not in ("y", "yes"):
            if answer in ("", "n", "no"):
                return False
            self.asker.say("Type y or n.")
        return True

    def _words(self, prompt: str) -> str:
        """The answer to a question that wants words. Raises Quit."""
        answer = self.asker.ask(prompt)
        if isinstance(answer, Unasked):
            self._take_back(answer)
        text = _clean(answer) if isinstance(answer, str) else ""
        key = _KEYS.get(text.lower())
        if key == "q":
            raise Quit
        if key == "?":
            self.asker.say("Answer in a few words; Return alone goes back; q saves and quits.")
            return self._words(prompt)
        return "" if key == "u" else text  # what is not yet written is not done

    # ---- readings

    def _receive(self, answer: str | Token | Unasked, step: SessionStep) -> None:
        """Take an answer for a reading or a key."""
        if isinstance(answer, Unasked):
            self._take_back(answer)
        elif isinstance(answer, Token):
            self._read(step, answer)
        elif not answer:
            self.asker.say("Type the reading, or ? for help.")
        elif key := _KEYS.get(answer.split()[0].lower()):
            self._obey(key, _clean(answer.partition(" ")[2]), step)
        else:
            try:
                token = parse_typed(answer)
            except InputError as refusal:
                self.asker.say(str(refusal), Style.BAD)
            else:
                self._read(step, token)

    def _take_back(self, stream: Unasked) -> None:
        """A gauge sends by itself: take back the readings that its messages became."""
        self.asker.say(wording.STREAM, Style.BAD)
        taken = 0
        while taken < stream.readings and (self.state.pending or self.state.before):
            self._undo()
            taken += 1
        if taken:
            self.asker.say(f"{_are(taken)} taken back: sent by that gauge.")

    def _undo(self) -> None:
        """Take back the reading that is questioned, else the last that counts, retake or skip."""
        if self.state.pending:
            self.write(events.Answered(at=self.now(), keep=False))
        else:
            self.write(events.Undone(at=self.now()))

    def _read(self, step: SessionStep, token: Token) -> None:
        """A reading arrived: accept it, or put the question about it on the disk."""
        stood = self._stood(step)
        taken = self._taken(step, token, stood.words)
        value = taken.value_mm
        readings = ReadingsSoFar(advance(self.state, taken), self.setting)
        question = check(readings, token.unit or self.unit)
        if stood.away_mm > NEAR_MM:
            far = f"The machine stands {stood.away_mm:.2f} mm from this posture: drive there first?"
            question = Question(Doubt.PLACE, far)
        if question is None:
            self.write(taken)
            self._acknowledge(step, value)
            return
        same = taken.model_dump(exclude={"kind"})
        doubt, text, about = question
        asked = Questioned(**same, doubt=doubt, question=text, about=about)
        self.write(asked)
        self.asker.rest(driving=False)
        before = [old for old, _ in self.state.replaced if old.step == step.number]
        near = (o for o in before if abs(value - o.value_mm) <= 3.0 * readings.sigma_mm)
        # Read again it stays wrong: the plunger cannot reach it, or the machine stands elsewhere.
        again = doubt is not Doubt.PLACE and any(isinstance(old, Questioned) for old in near)
        if again and doubt is Doubt.RANGE:
            self.asker.say(wording.OUT_OF_RANGE, Style.BAD)
        elif again:
            self.asker.say("The same reading again: kept, with a note.")
            self._keep(asked)

    def _taken(self, step: SessionStep, token: Token, remark: str = "") -> events.Taken:
        """The record of a reading that arrives now."""
        at, value = self.now(), token.mm(self.unit)
        if value is None:
            raise ValueError("an error message is not a reading")
        gone = datetime.fromisoformat(at) - datetime.fromisoformat(self.state.opened.at)
        # A clock that was set back must not turn the order of the readings around.
        earlier = [item.take.minutes for item in self.state.accepted.values()]
        return events.Taken(
            at=at,
            step=step.number,
            minutes=max([0.0, gone.total_seconds() / 60.0, *earlier]),
            value_mm=value,
            raw=token.raw[:80],
            source=token.source,
            remark=remark,
        )

    def _keep(self, reading: Questioned, moved: bool = False) -> None:
        self.write(events.Answered(at=self.now(), keep=True, moved=moved))
        self._acknowledge(self.setting.steps[reading.step - 1], reading.value_mm)

    def _acknowledge(self, step: SessionStep, value: float) -> None:
        """Say that it is saved; after the last gauge of a posture, the offsets so far."""
        so_far, last = self.so_far, ""
        stays = any(other.visit == step.visit for other in so_far.left[:1])
        self.asker.rest(driving=not stays)
        for i in so_far.repeats[-1:]:
            before = wording.value_text(float(so_far.value[i]), self.unit)
            last = f"   (cycle {so_far.steps[i].cycle}: {before})"
        saved = f"   saved {wording.value_text(value, self.unit)}{last}"
        self.asker.say(saved, Style.GOOD, pushes=not stays)
        if not stays:
            self._say_offsets()
            self._shorten()

    def _say_offsets(self) -> None:
        """The offsets so far with their U; what else may be wrong adds to it at the end only."""
        solution, expanded = self.so_far.solution, self.so_far.expanded_mm
        if solution is None or expanded is None:
            return
        decimals = decimals_for(float(expanded.min()))
        parts = (
            f"{axis.upper()} {value:+.{decimals}f} ± {reach:.{decimals}f}"
            for axis, value, reach in zip(AXES, solution.offsets_mm, expanded, strict=True)
        )
        self.asker.say(f"Offsets so far, {UNLESS}:\n  {'  '.join(parts)} mm", Style.DIM)

    def _known_within(self, until_mm: float) -> bool:
        known = self.so_far.expanded_mm
        return known is not None and bool((known <= until_mm).all())

    def _shorten(self) -> None:
        """Leave out what the offsets do not need any more, if they are known well enough."""
        if (until := self.until_mm) is None or self.state.dropped or not self._known_within(until):
            return
        if not (dropped := self.so_far.unneeded()):
            return
        reason = f"ended early, every offset is known within {until:g} mm"
        drop = tuple(step.number for step in dropped)
        self.write(events.Shortened(at=self.now(), drop=drop, reason=reason))
        self.asker.say(
            f"Every offset is known within {until:g} mm ({UNLESS}). Not needed: {len(dropped)}"
            f" readings, {wording.duration(clock(dropped)[-1]).lower()}.",
            Style.GOOD,
        )
        if self.so_far.left:
            self.asker.say(
                "The closing isotropic posture is still read: it shows drift and knocks."
            )

    # ---- keys

    def _obey(self, key: str, words: str, step: SessionStep) -> None:
        """Do what a key says, alone or with words after it."""
        match key:
            case "u" if self.state.before is None:
                self.asker.say("There is nothing to undo.")
            case "u":
                self._undo()
                left = self.so_far.left
                where = f" Back to step {left[0].number}." if left else ""
                self.asker.say(f"Undone; the old value is kept as replaced.{where}")
            case "r":
                asked = "Retake which step (number, or x, y, z for a leg)? > "
                self._retake(words or self._words(asked), step)
            case "n":
                if text := words or self._words("Note > "):
                    self.write(events.Noted(at=self.now(), step=step.number, text=text))
                    self.asker.say(f"Noted at step {step.number}.")
            case "s" if words.lower().split()[:1] == ["all"]:
                left, reason = self.so_far.left, words[3:].strip()
                self.asker.say(f"{_are(len(left))} missing.")
                # A script that gives its reason has said all.
                agreed = reason and not self.asker.keyboard.live
                if not agreed and not self._agrees("End the session here? y/n > "):
                    self.asker.say("Not ended.")
                    return
                for skipped in left:
                    self._skip(skipped, reason or "the session was ended")
            case "s":
                why = words or self._words("Why is it skipped? > ")
                with suppress(InputError):
                    parse_typed(why)
                    why = ""  # a reading is no reason
                if why:
                    self._skip(step, why)
                self.asker.say(
                    f"Skipped: {why}" if why else "Not skipped: a reason in words is needed."
                )
            case "t":
                last = list(self.state.accepted.items())[-20:]
                lines = [f"The last {counted(len(last), 'reading')}:"]
                for number, item in last:
                    take = item.take
                    name = step_name(self.setting.steps[number - 1])
                    kept = "  kept although questioned" if isinstance(take, Questioned) else ""
                    value = wording.value_text(take.value_mm, self.unit)
                    lines.append(f"  {number:>3}  {name}  {value}{kept}")
                self.asker.say("\n".join(lines))
            case "q":
                raise Quit
            case _:
                self.asker.say(wording.HELP)

    def _retake(self, words: str, step: SessionStep) -> None:
        """Measure a step, or a leg, again: "14 why", "x"; with all that its stands need."""
        which, _, reason = re.sub(r"^r\b *", "", words, flags=re.IGNORECASE).partition(" ")
        if not which:
            return
        state, steps, leg = self.state, self.setting.steps, which.lower() in AXES
        done = state.accepted if leg else {*state.accepted, *state.skipped}
        names = ((AXES[s.leg] if leg else str(s.number), s) for s in steps if s.number in done)
        chosen = [s for name, s in names if name == which.lower()]
        if not chosen:
            where = f"of leg {which.upper()}" if leg else f"at step {which[:20]}"
            self.asker.say(f"There is no reading {where} yet.")
            return
        again = with_set_ups(chosen, step.setup, steps, state.accepted)
        old = [s for s in again if s.number in state.accepted]
        if any(s.setup != step.setup for s in chosen) and any(s not in chosen for s in old):
            here = sum(s.setup == step.setup for s in old)
            of_this = f" and the {here} of this one" if here else ""
            self.asker.say(
                "The stands have been moved since then, so the gauges have new zeros: all"
                f" {len(old) - here} readings of that set-up{of_this} have to be taken again."
            )
            if not self._agrees("Take them all again? y/n > "):
                return
        self._take_again(again, reason or "retaken")
        retaken = f"step {again[0].number} ({step_name(again[0])})"
        if len(again) > 1:
            retaken = f"{len(again)} steps from step {again[0].number} on"
        self.asker.say(f"Retaking {retaken}; the old readings are kept as replaced.")

    def _take_again(self, steps: list[SessionStep], reason: str) -> None:
        if self.state.ended:
            self.write(events.Reopened(at=self.now(), source=self.state.source))
        numbers = tuple(step.number for step in steps)
        self.write(events.Retake(at=self.now(), steps=numbers, reason=reason))

    def _skip(self, step: SessionStep, why: str) -> None:
        self.write(events.Skipped(at=self.now(), step=step.number, reason=why))


def _are(readings: int) -> str:
    """ "14 readings are", "1 reading is"."""
    return f"{counted(readings, 'reading')} {'is' if readings == 1 else 'are'}"


def _clean(text: str) -> str:
    """Words as they may be stored and shown."""
    return visible(text)[:200].strip()
