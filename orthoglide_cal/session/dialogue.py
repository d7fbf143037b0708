"""A guided session: how it begins or goes on, its loop, its words, and where its file is."""

import os
import re
import secrets
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from operator import attrgetter
from pathlib import Path

import numpy as np

from orthoglide_cal.errors import (
    InputError,
    OrthocalError,
    UsageError,
    command,
    system_words,
    visible,
)
from orthoglide_cal.files import machine_file
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.readings import implausible_temperatures, session_text
from orthoglide_cal.files.text import free_path, read_document, write_text
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.inference.result import NextMeasurement
from orthoglide_cal.model.machine import LARGEST_OFFSET_MM
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import PlannedReading
from orthoglide_cal.model.plan import AnyCell
from orthoglide_cal.model.readings import AXES, Contact, GaugePlan, other_axes
from orthoglide_cal.planning.next_measurement import rank_measurements
from orthoglide_cal.planning.steps import (
    GIVES_UP,
    MOST_CYCLES,
    GuidedSession,
    MeasuringProtocol,
    SessionStep,
    clock,
    gauge_moves,
    require_on_bar,
    steps_of,
)
from orthoglide_cal.schema import Reason, parse_number
from orthoglide_cal.session import events
from orthoglide_cal.session.asking import Asker, Style, Unasked
from orthoglide_cal.session.events import Doubt, Event, Journal, Questioned, State, advance, replay
from orthoglide_cal.session.gauges import (
    NEAR_MM,
    SerialGauge,
    SimulatedGauge,
    Standing,
    Token,
    by_axis,
    parse_typed,
)
from orthoglide_cal.session.readings import (
    PriorReadings,
    Question,
    ReadingsSoFar,
    Setting,
    check,
    count_words,
)
from orthoglide_cal.words import SIMULATED, Unit, counted, decimals_for, signed, value_text

TYPED, VIRTUAL = "typed", "simulated"
JOURNAL = ".journal"
_LONGEST = 200  # bytes; file systems take 255, also of the temporary file's name
UNLESS = "95 % if nothing else is wrong"  # of U: what else may be wrong shows at the end only
WAIT_S = 0.3  # how often a machine that is followed is looked at

HELP = """\
Type the reading, e.g. -0.12 (comma or point; mm, or add "in"), then Return.
  u            undo the last reading
  r 14 why     retake step 14 (r x: all of leg X); the old reading is kept
  n text       note, kept with this step
  s why        skip this step (s all: skip all that is left, and finish)
  t            the last 20 readings
  q            save and quit; continue later with --resume
  ?            this help
A reading that looks wrong is questioned once:
  k            keep it anyway
  m            the stand did move: keep it, with a new zero from here on
  or give the reading again.
The words undo, retake, note, skip, quit and help do the same.
Every accepted reading is on the disk before the next prompt."""

STREAM = """\
Many readings at once: a gauge that sends by itself, or pasted lines. None of
it is recorded. Switch off the gauge's continuous output (also: AUTO, STREAM,
INTERVAL), so that it sends when its button is pressed; type one at a time."""

OUT_OF_RANGE = """\
Not kept: the gauge cannot show this. Read it again, or skip it: s and why.
Set a gauge that has a preset to zero. If its stated range is wrong: q, then
correct range_mm in the machine file and begin anew."""

_KEYS = {  # as words, too
    **{key: key for key in "urnstq?"},
    **{"undo": "u", "back": "u", "retake": "r", "note": "n", "skip": "s", "help": "?"},
    **dict.fromkeys(("quit", "exit"), "q"),
}


class Quit(Exception):
    """The operator leaves a session before its end, to be resumed later."""


@dataclass(frozen=True)
class Request:
    """The operator's wishes on the command line; None where it says nothing."""

    path: Path | None = None  # of the session file
    resume: bool = False  # go on with an unfinished session
    agreed: bool = False  # to what is asked before the first reading, and to read what is missing
    offsets_mm: tuple[float, float, float] | None = None  # that the controller holds now
    model: Model | None = None
    otherwise: Callable[[], Model] = machine_file.default_machine  # where no file names one
    keeper: machine_file.StoredMachine | None = None  # of what is entered, where data continue
    following: str | None = None  # path of the data that the session continues
    choice: int | None = None  # which recommendation is carried out, from 1
    session: Mapping[str, object] = field(default_factory=dict)  # given fields of `GuidedSession`
    source: tuple[str, ...] = ()
    follow: str | None = None  # address of the controller whose machine is waited for
    seed: int | None = None
    unit: Unit = Unit.MM  # of readings without one
    until_mm: float | None = None  # end once every offset is known this well; else take them all
    operator: str = ""
    temperature_c: float | None = None
    gauges: tuple[events.GaugeLabel, ...] = ()
    says: Callable[[Reason], str] = attrgetter("code")  # words a reason


def time_of_day() -> str:
    """The time of day, ISO 8601 with the offset from UTC, to the millisecond."""
    return datetime.now().astimezone().isoformat(timespec="milliseconds")


@dataclass(eq=False)
class Dialogue:
    """Go on from where the journal ends to the end of the session, or to an interruption."""

    path: Path  # of the session file to be
    journal: Journal
    setting: Setting
    asker: Asker
    request: Request = Request()
    standing: Standing | None = None  # where a machine that is followed stands
    now: Callable[[], str] = time_of_day
    so_far: ReadingsSoFar = field(init=False)  # that count now
    _shown: tuple[object, ...] = (None,)  # the visit of the machine that was shown last

    def __post_init__(self) -> None:
        self.so_far = ReadingsSoFar(self.state, self.setting)

    @property
    def state(self) -> State:
        """The state after all records."""
        return self.journal.state

    def write(self, event: Event) -> None:
        """Put a record on the disk, then let it count."""
        self.journal.append(event)
        self.so_far = ReadingsSoFar(self.state, self.setting)

    def greet(self) -> None:
        """Say what lies ahead, or what was there already."""
        opened, steps, first = self.state.opened, self.setting.steps, self.setting.first
        cycles, moves = counted(opened.cycles, "cycle"), counted(gauge_moves(steps), "gauge move")
        head = f"{opened.protocol} session, {cycles}, order: {opened.order}"
        if opened.protocol is MeasuringProtocol.BEST:
            head += f"\nFewest readings for the offsets. What is given up: {GIVES_UP}."
            head += " To name what is wrong with a machine, leave out --design."
        if first:
            head = f"Continues {visible(first.path)}, {len(first.readings)} readings:"
            head += " both are solved together at the end."
        gauges = "two gauges" if any(step.stand for step in steps) else "one gauge"
        set_ups, following = counted(steps[-1].setup, "set-up"), self.setting.following
        long = duration(following.minutes if following else clock(steps)[-1]).lower()
        counts = f"{len(steps)} readings with {gauges}: {set_ups}, {moves}, {long}. ? is help."
        self.asker.say(f"{head}\nFile     {visible(str(self.path))}\n{counts}")
        if lost := self.journal.lost:
            cut = f"The interruption cut off the last entry ({lost} bytes): ignored."
            self.asker.say(f"{cut} No reading that was shown as saved is missing.", Style.BAD)
        if self.state.count > 1 + bool(self.state.planned):
            resumed = f"Resumed: {counted(len(self.state.accepted), 'reading')} so far."
            self.asker.say(resumed, Style.GOOD)
            self._say_offsets()

    def run(self) -> None:
        """Lead through what is left. Raises InputError: the journal cannot be written any more.

        Quit, EOFError, KeyboardInterrupt: left or interrupted; everything is saved.
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

    def offer_again(self) -> None:
        """Ask whether what was left out is read after all, and what was kept in doubt read again.

        Without a terminal nobody is asked. Raises Quit, EOFError, KeyboardInterrupt as `run`.
        """
        state, steps, live = self.state, self.setting.steps, self.asker.keyboard.live
        missing = [s for s in steps if s.number in {*state.skipped, *state.dropped}]
        last = self.so_far.steps[-1] if state.accepted else (missing or steps)[0]
        if missing and (self.request.agreed or live):
            again = self._with_set_ups(missing, last.setup)
            old = sum(step.number in state.accepted for step in again)
            more = f" For that, {old} earlier readings are taken again: the stands were moved."
            self.asker.say(f"{_are(len(missing))} left out.{more if old else ''}", Style.QUESTION)
            if self.request.agreed or self._agrees("Read what is missing now? y/n > "):
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
        state, stored = self.state, self.path.read_bytes() if self.path.is_file() else None
        if stored != (text := session_text(self.so_far.session)).encode():
            # What this session wrote when it was ended before may be replaced, nothing else.
            records = self.journal.events
            ends = [at for at, event in enumerate(records, 1) if isinstance(event, events.Ended)]
            before = (ReadingsSoFar(replay(records[:at]), self.setting).session for at in ends)
            mine = stored in [session_text(session).encode() for session in before]
            try:
                write_text(self.path, text, overwrite=mine)
            except InputError as error:
                again = command("measure", str(self.path), options="--resume")
                error.remedy += f" The readings are safe in the journal; then: {again}"
                raise
        counts = count_words(len(state.accepted), len(state.replaced), len(state.skipped))
        reason = state.ended.reason if state.ended else "unfinished"
        text = f"\nSession {reason}: {counts}. Written to {visible(str(self.path))}"
        for leg in sorted({step.leg for step in self.setting.steps if step.cell.turned}):
            text += f"\nBefore the next session, turn the bar of leg {AXES[leg].upper()} back."
        self.asker.show(text, Style.GOOD)

    def reveal(self) -> None:
        """Say, after a simulated session, which offsets were hidden."""
        if isinstance(gauge := self.asker.gauge, SimulatedGauge):
            offsets = zip(AXES, gauge.offsets_mm.tolist(), strict=True)
            words = " ".join(f"{axis} {signed(value, 3)}" for axis, value in offsets)
            self.asker.show(f"True offsets: {words} mm")

    # ---- the words that lead through it, in plain characters

    def _set_up(self, setup: int, begun: bool) -> tuple[str, str]:
        """Heading and instructions of a gauge set-up; once it is `begun` its stands must stay."""
        setting, columns = self.setting, self.asker.keyboard.columns
        here = [step for step in setting.steps if step.setup == setup]
        cell, following = here[0].cell, setting.following
        leg, names = AXES[cell.leg].upper(), sorted({AXES[s.direction].upper() for s in here})
        s = "s" * (len(names) > 1)
        heading = f"-- Set-up {setup} of {setting.steps[-1].setup}: leg {leg}, gauge{s}"
        heading += f" {' and '.join(names)} "
        right = f" steps {here[0].number}-{here[-1].number}"
        rule = f"{heading}{'-' * max(columns - 2 - len(heading) - len(right), 1)}{right}"
        if cell.contact is not Contact.FIXED:
            return rule, (
                "1. Gauge on the XY surface, plunger down on the leg: higher reads more.\n"
                f"2. Slide the stand between the ends of leg {leg}; never touch the gauge's zero.\n"
                "3. Joint end: at the carriage joint. Tool end: at the tool centre point."
            )
        if begun:
            return rule, (
                "The stands are in place: do not touch them. If one was moved anyway,\n"
                "just continue: the next reading will be questioned; then answer m."
            )
        if following and following.continues and setup == 1:
            return rule, (
                "Do not touch the stands: they must be where they were for the last reading\n"
                f"of {visible(following.data.path)}. If one was touched since: q, and measure anew."
            )
        rows, turn = setting.first.rows if setting.first else [], ""
        if cell.turned:
            sides = " and ".join(f"+{AXES[axis].upper()}" for axis in other_axes(cell.leg))
            turn = (
                f"0. Turn the bar of leg {leg}, unless it is turned already: loosen both ends,\n"
                f"   turn it half round its own axis (what faced {sides} then faces away),"
                " tighten.\n"
            )
        elif any([row.bar for row in rows if row.leg == AXES[cell.leg]][-1:]):
            turn = f"0. Turn the bar of leg {leg} back, as it was at first.\n"
        half = "half-way: " if cell.gauge_at == 0.5 else ""
        place = f"{half}{cell.gauge_at * setting.machine.leg_mm:.0f} mm from the carriage"
        moved = [step.cell.displacement for step in here]
        # A gauge on the + side reads more when the leg is pushed towards +.
        places = ", ".join(f"{name} on the +{name} side" for name in names)
        return rule, (
            f"{turn}1. Drive to the isotropic posture: each leg lies along its own axis.\n"
            f"   Put the stand{s} on the base, not on a moving part.\n"
            f"2. Plunger{s} on leg {leg}, {place}, square to the leg.\n"
            f"3. Gauge {places}: leg pushed to + must read more.\n"
            f"4. The leg stays under the plunger{s} from {min(moved):+g} to {max(moved):+g} mm."
            " Then touch no stand."
        )

    def _step_line(self, step: SessionStep) -> str:
        """Place of step n of N, and the time that is left."""
        setting, minutes = self.setting, clock(self.so_far.left)[-1]
        # The isotropic posture once more than the others closes a set-up.
        repeats = Counter(other.cell for other in setting.steps if other.setup == step.setup)
        here = repeats[step.cell]
        moved = [number for cell, number in repeats.items() if cell.displacement != 0.0]
        closes = step.cell.displacement == 0.0 and here == max(moved, default=here) + 1
        when = f"cycle {step.cycle} of {here - closes}"
        if closes and step.cycle == here:
            when = "closing"
        short = "".join(
            f", carriage {axis.upper()} {abs(mm):g} mm {'short' if mm > 0.0 else 'too far'}"
            for axis, mm in zip(AXES, setting.short_mm(step).tolist(), strict=True)
            if mm
        )
        return (
            f"Step {step.number} of {len(setting.steps)}: leg {AXES[step.leg].upper()},"
            f" {step.posture_name}{short}, {when}. {duration(minutes)} left."
        )

    def _place(self, step: SessionStep) -> str:
        """Point to drive to, in words: its joints, and its tool; either is the same posture."""
        if step.cell.words:
            return step.cell.words
        joints, tool = self.setting.point(step)
        return (
            f"Drive to  joints   {by_axis(joints, '.3f', '   ')}  mm\n"
            f"          tool     {by_axis(tool.round(6) + 0.0, '.3f', '   ')}  mm"
        )

    # ---- what is asked

    def _ask_for(self, step: SessionStep) -> None:
        """Show where to drive, if it is new or has moved up the screen, and take a reading."""
        asker, place, new = self.asker, self._place(step), step.visit != self._shown
        if new:
            gap = "\n"
            if step.setup != self._shown[0]:  # a visit's first entry
                begun = step.setup in {s.setup for s in self.so_far.steps}
                rule, text = self._set_up(step.setup, begun)
                asker.say(f"\n{rule}", Style.TITLE)
                asker.say(text)
                gap = ""
            asker.say(f"{gap}{self._step_line(step)}", Style.TITLE)
        if asker.pushed:  # also by the line of a new step
            asker.say(place)
        if new:
            self._wait_for(step)
        self._shown = step.visit
        asker.pushed = False
        touched = step.cell.contact.end
        end = f" at the {touched.upper()} end" if touched else ""
        gauge = f"{step.number}. Gauge {AXES[step.direction].upper()}{end} [{self.request.unit}]"
        prompt = f"{place}\n{gauge}{asker.hint} > "
        self._receive(asker.ask(prompt, step, self.state.takes(step.number)), step)

    def _stood(self, step: SessionStep) -> tuple[float, str]:
        """As `Standing.at`; nowhere if it is not followed, which is said once if it was."""
        if standing := self.standing:
            try:
                return standing.at(*self.setting.point(step), self.setting.machine.home_mm)
            except (OSError, ValueError) as gone:
                standing.close()
                self.standing = None
                lost = f"LinuxCNC does not answer any more: {system_words(gone)}."
                self.asker.say(f"{lost} Continue by hand: nothing is lost.", Style.BAD)
        return 0.0, ""

    def _wait_for(self, step: SessionStep) -> None:
        """Wait until a machine that is followed stands where the step is read."""
        waiting, keyboard = False, self.asker.keyboard
        while self._stood(step)[0] > NEAR_MM:
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
        may_move, value = pending.doubt.compares, value_text(pending.value_mm, self.request.unit)
        asked, here = f"Step {step.number}, {value}:\n  {pending.question}", (step.cell, step.zero)
        alike = [s.number for s in self.so_far.steps if (s.cell, s.zero) == here]
        if len(alike) == 1 and may_move:  # either of the two may be the wrong one
            asked += f"\n  Or was step {alike[0]} wrong? r {alike[0]} reads both again."
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
                self.asker.say(OUT_OF_RANGE, Style.BAD)
                return
            if pending.doubt is Doubt.PLACE:
                asked = "Why is it kept? (Return: it is not) > "
                if not (why := _clean(why) or self._words(asked)):
                    return
                self.write(events.Noted(at=self.now(), step=step.number, text=why))
            self._accept(events.Answered(at=self.now(), keep=True))
        elif word == "m" and may_move:
            self._accept(events.Answered(at=self.now(), keep=True, moved=True))
        elif _KEYS.get(word) == "u":
            self._undo()
        else:
            self._receive(answer, step)

    def _agrees(self, prompt: str) -> bool:
        """True for yes, False for no or Return; else it is asked again. Raises Quit."""
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
        self.asker.say(STREAM, Style.BAD)
        taken = 0
        while taken < stream.readings and (self.state.pending or self.state.before):
            self._undo()
            taken += 1
        if taken:
            self.asker.say(f"{_are(taken)} taken back: sent by that gauge.")

    def _undo(self) -> None:
        """Take back the reading that is questioned, else the last that counts, retake or skip."""
        at, pending = self.now(), self.state.pending
        self.write(events.Answered(at=at, keep=False) if pending else events.Undone(at=at))

    def _read(self, step: SessionStep, token: Token) -> None:
        """A reading arrived: accept it, or put the question about it on the disk."""
        away_mm, remark = self._stood(step)
        taken = self._taken(step, token, remark)
        value = taken.value_mm
        readings = ReadingsSoFar(advance(self.state, taken), self.setting)
        question = check(readings, token.unit or self.request.unit)
        if away_mm > NEAR_MM:
            far = f"The machine stands {away_mm:.2f} mm from this posture: drive there first?"
            question = Question(Doubt.PLACE, far)
        if question is None:
            self._accept(taken)
            return
        doubt, text = question
        self.write(Questioned(**taken.model_dump(exclude={"kind"}), doubt=doubt, question=text))
        self.asker.rest(driving=False)
        before = [old for old, _ in self.state.replaced if old.step == step.number]
        near = (o for o in before if abs(value - o.value_mm) <= 3.0 * readings.sigma_mm)
        # Read again it stays wrong: the plunger cannot reach it, or the machine stands elsewhere.
        again = doubt is not Doubt.PLACE and any(isinstance(old, Questioned) for old in near)
        if again and doubt is Doubt.RANGE:
            self.asker.say(OUT_OF_RANGE, Style.BAD)
        elif again:
            self.asker.say("The same reading again: kept, with a note.")
            self._accept(events.Answered(at=self.now(), keep=True))

    def _taken(self, step: SessionStep, token: Token, remark: str = "") -> events.Taken:
        """The record of a reading that arrives now."""
        at = self.now()
        gone = datetime.fromisoformat(at) - datetime.fromisoformat(self.state.opened.at)
        # A clock that was set back must not turn the order of the readings around.
        earlier = [item.take.minutes for item in self.state.accepted.values()]
        return events.Taken(
            at=at, step=step.number, minutes=max([0.0, gone.total_seconds() / 60.0, *earlier]),
            value_mm=token.mm(self.request.unit), raw=token.raw[:80], source=token.source,
            remark=remark,
        )  # fmt: skip

    def _accept(self, event: Event) -> None:
        """Save a reading; after the last gauge of a posture, say the offsets so far."""
        self.write(event)
        so_far, unit, last = self.so_far, self.request.unit, ""
        stays = any(other.visit == so_far.steps[-1].visit for other in so_far.left[:1])
        self.asker.rest(driving=not stays)
        for i in so_far.repeats[-1:]:
            last = f"   (cycle {so_far.steps[i].cycle}: {value_text(float(so_far.value[i]), unit)})"
        saved = f"   saved {value_text(float(so_far.value[-1]), unit)}{last}"
        self.asker.say(saved, Style.GOOD, pushes=not stays)
        if not stays:
            self._say_offsets()
            self._shorten()

    def _say_offsets(self) -> None:
        """The offsets so far with their U."""
        solution, expanded = self.so_far.solution, self.so_far.expanded_mm
        if solution is None or expanded is None:
            return
        decimals = decimals_for(float(expanded.min()))
        parts = (
            f"{axis.upper()} {value:+.{decimals}f} ± {reach:.{decimals}f}"
            for axis, value, reach in zip(AXES, solution.offsets_mm, expanded, strict=True)
        )
        self.asker.say(f"Offsets so far, {UNLESS}:\n  {'  '.join(parts)} mm", Style.DIM)

    def _shorten(self) -> None:
        """Leave out what the offsets do not need any more, if they are known well enough."""
        until, known = self.request.until_mm, self.so_far.expanded_mm
        if until is None or self.state.dropped or known is None or (known > until).any():
            return
        if dropped := self.so_far.unneeded():
            reason = f"ended early, every offset is known within {until:g} mm"
            drop = tuple(step.number for step in dropped)
            self.write(events.Shortened(at=self.now(), drop=drop, reason=reason))
            left_out = f"{len(dropped)} readings, {duration(clock(dropped)[-1]).lower()}"
            text = f"Every offset is known within {until:g} mm ({UNLESS}). Not needed: {left_out}."
            self.asker.say(text, Style.GOOD)

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
                text = words or self._words("Note > ")
                # A script means what it says.
                doubtful = self.asker.keyboard.live and _is_reading(text)
                if doubtful and not self._agrees(f"{text} is a number. Keep it as a note? y/n > "):
                    self.asker.say("Not kept.")
                elif text:
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
                why = reason or "the session was ended"
                for skipped in left:
                    self.write(events.Skipped(at=self.now(), step=skipped.number, reason=why))
            case "s":
                why = words or self._words("Why is it skipped? > ")
                if why and not _is_reading(why):
                    self.write(events.Skipped(at=self.now(), step=step.number, reason=why))
                    self.asker.say(f"Skipped: {why}")
                else:
                    self.asker.say("Not skipped: a reason in words is needed.")
            case "t":
                last = list(self.state.accepted.items())[-20:]
                lines = [f"The last {counted(len(last), 'reading')}:"]
                for number, (take, _) in last:
                    name = self.setting.steps[number - 1].name
                    kept = "  kept although questioned" if isinstance(take, Questioned) else ""
                    value = value_text(take.value_mm, self.request.unit)
                    lines.append(f"  {number:>3}  {name}  {value}{kept}")
                self.asker.say("\n".join(lines))
            case "q":
                raise Quit
            case _:
                self.asker.say(HELP)

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
        again = self._with_set_ups(chosen, step.setup)
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
        retaken = f"step {again[0].number} ({again[0].name})"
        if len(again) > 1:
            retaken = f"{len(again)} steps from step {again[0].number} on"
        self.asker.say(f"Retaking {retaken}; the old readings are kept as replaced.")

    def _with_set_ups(self, chosen: Sequence[SessionStep], here: int) -> list[SessionStep]:
        """Steps, with all that must be read again with them while the stands are in set-up `here`.

        For other set-ups the stands are moved: the zeros are then new ones, also those of the
        set-up in hand, to which they come back.
        """
        numbers, setups = {step.number for step in chosen}, {step.setup for step in chosen}
        moved = set() if setups <= {here} else setups | {here}
        numbers |= {step.number for step in self.so_far.steps if step.setup in moved}
        return [step for step in self.setting.steps if step.number in numbers]

    def _take_again(self, steps: list[SessionStep], reason: str) -> None:
        if self.state.ended:
            self.write(events.Reopened(at=self.now(), source=self.state.source))
        numbers = tuple(step.number for step in steps)
        self.write(events.Retake(at=self.now(), steps=numbers, reason=reason))


def _is_reading(words: str) -> bool:
    """True if words are nothing but a number, with or without a unit."""
    with suppress(InputError):
        return parse_typed(words).value is not None
    return False


def _are(readings: int) -> str:
    """ "14 readings are", "1 reading is"."""
    return f"{counted(readings, 'reading')} {'is' if readings == 1 else 'are'}"


def _clean(text: str) -> str:
    """Words as they may be stored and shown."""
    return visible(text)[:200].strip()


def duration(minutes: float) -> str:
    """About so long, whole minutes."""
    return f"About {minutes:.0f} min" if minutes >= 0.95 else "Under a minute"


# ---- how it begins, or goes on only if nothing essential has changed


def open_session(request: Request, asker: Asker, opened: ExitStack) -> Dialogue:
    """Begin a session, or go on with one; what is `opened` is closed with it.

    Raises UsageError: what is asked for does not go together, or with what is there; InputError,
    GaugeLost: a file or the gauge cannot be used; EOFError: nobody answers.
    """
    _check_options(request)
    path = session_file(request.path, Path(), request.resume)
    # What is missing leaves no file behind.
    standing = opened.enter_context(closing(Standing(request.follow))) if request.follow else None
    asker.gauge = serial_gauge(request.source, opened)
    target = path.with_suffix(JOURNAL)
    if not request.resume:
        Journal.create(target, *_first_records(request, asker))
    journal = Journal.resume(target, opened)
    state, setting = journal.state, _setting_in(journal)
    source = request.source or state.source
    if request.resume:
        _refuse_changes(state.opened, setting.held, request)
        asker.gauge = asker.gauge or serial_gauge(source, opened)
        asker.say(_machine_words(setting.held, state.opened.seed, setting.first))
        if setting.following:
            asker.say(setting.following.words, Style.TITLE)
    if source == (VIRTUAL,):
        asker.gauge = SimulatedGauge(setting, state.opened.seed or 0)
    dialogue = Dialogue(path, journal, setting, asker, request, standing)
    if request.source and request.source != state.source and state.ended is None:
        dialogue.write(events.Reopened(at=dialogue.now(), source=request.source))
    return dialogue


def _check_options(request: Request) -> None:
    """Raises UsageError if what is asked for does not go together."""
    path, following = request.path, request.following
    for doubt in implausible_temperatures([request.temperature_c]):
        raise UsageError(request.says(doubt), "Correct it, or leave it out.")
    if following is None:
        if request.choice is not None:
            raise UsageError("--choice needs a recommendation.", "Name its data: --then FILE")
        return
    if path and session_path(path).resolve() == Path(following).resolve():
        fault = f"{following} is never changed: it cannot be the new session, too."
        raise UsageError(fault, "Name another file for the session that will hold both.")
    options = {
        "--resume": request.resume,
        "--protocol or --design": request.session.get("protocol"),
        "--cycles": request.session.get("cycles"),
        "--order": request.session.get("order"),
        "--until": request.until_mm,
    }
    for name in (name for name, value in options.items() if value):
        fault = f"--then and {name} do not go together."
        raise UsageError(fault, "Leave out one of them: what is read follows from what was begun.")


def _first_records(request: Request, asker: Asker) -> list[events.Event]:
    """The first records, once machine, offsets and any recommended measurement are agreed to.

    Nobody is asked who has agreed already, or has no terminal.
    """
    first, following, change = None, None, ""
    session = GuidedSession().changed(**request.session)
    if request.following is None:
        model = request.model or request.otherwise()
        model.machine.check_guided()
        if session.protocol is MeasuringProtocol.SINGLE:
            session = session.changed(stands=1)
        steps = session.steps(model.machine)
        plan = PlannedReading.planned([step.cell for step in steps])
    else:
        first, options, model = _rank(request.following, request)
    model = _holding(model, request.offsets_mm)
    source, seed = _source(request, first)
    confirmed: Model | None = None
    while confirmed is not model:  # what was typed is shown, and asked once more
        model = confirmed or model
        if first:
            plan, following, change = planned_next(first, options, request, model)
        careful = require_on_bar(plan, model.machine)
        asker.say(_machine_words(model, seed, first))
        doubts = map(request.says, model.machine.instrument.implausible().values())
        for doubt in filter(None, (careful and str(careful), *doubts, change)):
            asker.say(doubt, Style.BAD)
        if following:
            asker.say(following.words, Style.TITLE)
        silent = request.agreed or not asker.keyboard.live
        confirmed = model if silent else _confirmed(model, first is not None, asker)
    if first:
        # What others are joined to keeps the machine as it was for the first of them.
        model = first.model
        steps = steps_of(plan, model.machine, session.order, session.stands)
        session = session.changed(cycles=min(max(step.cycle for step in steps), MOST_CYCLES))
    version = 2 if first or session.protocol is MeasuringProtocol.BEST else 1
    opened = events.Opened(
        **dict(session), at=time_of_day(), version=version, source=source, seed=seed,
        machine=machine_file.machine_text(model), operator=request.operator,
        temperature_c=request.temperature_c, gauges=request.gauges,
    )  # fmt: skip
    readings = tuple(step.cell for step in steps)
    planned = events.Planned(at=opened.at, readings=readings, following=following)
    return [opened, planned] if version == 2 else [opened]


def _confirmed(model: Model, also: bool, asker: Asker) -> Model:
    """The machine once it is agreed to, or with the offsets that are typed instead.

    `also`: to measure what is recommended. Raises UsageError: it is another machine; EOFError.
    """
    question = "Is it this machine, with these offsets in its controller"
    question += f"{', and shall this be measured now' * also}? Return: yes.  n: no."
    question += "  Other offsets: type the three, in mm."
    asker.say(question, Style.QUESTION)
    while True:
        answer = asker.ask("Return, n, or the three offsets > ")
        match answer.lower() if isinstance(answer, str) else "?":
            case "" | "y" | "yes":
                return model
            case "q" | "quit":
                raise EOFError
            case "n" | "no":
                remedy = "Name the file of your machine, --machine FILE, or make one:"
                raise UsageError("Nothing was begun.", f"{remedy} orthocal machine new")
            case "?" | "help":
                asker.say(question, Style.QUESTION)
            case text:
                try:
                    parts = text.replace(";", " ").split()
                    offsets = tuple(parse_number(part, decimal_comma=True) for part in parts)
                    return _holding(model, offsets)
                except OrthocalError as error:
                    asker.say(str(error), Style.BAD)


def _machine_words(model: Model, seed: int | None, first: PriorReadings | None) -> str:
    """The machine and its numbers, as they are confirmed before the first move."""
    machine, gauge = model.machine, model.machine.instrument
    known = ", ".join(effect.cause.id for effect in model.accepted)
    simulated = seed is not None or (first is not None and first.readings.source.simulated)
    return "\n".join([
        *([SIMULATED] if simulated else []),
        f"Machine  {visible(machine.name)}",
        f"         {machine.geometry_words}",
        *([f"         known causes: {known}"] if known else []),
        f"Gauge    {gauge.resolution_mm:g} mm divisions, {gauge.most_mm:g} mm travel,"
        f" repeats within {gauge.repeatability_mm:g} mm",
        f"Offsets  {by_axis(machine.active, '+.4g')} mm are in the controller now",
    ])  # fmt: skip


def planned_next(
    first: PriorReadings, options: tuple[NextMeasurement, ...], request: Request, model: Model
) -> tuple[GaugePlan, events.Following, str]:
    """Plan what is recommended next, best first, with the offsets that the machine has now.

    The last is what was entered since the first readings, in a sentence. Raises UsageError.
    """
    before = first.model.machine.active
    x, y, z = np.subtract(model.machine.active, before).round(9).tolist()
    change = np.subtract((x, y, z), first.left_entered)
    # To act they were homed for, and that has pushed stands that were still there.
    moved = bool(change.round(6).any())
    possible = (option for option in options if not (moved and option.continues))
    option = options[request.choice - 1] if request.choice else next(possible)
    plan = GaugePlan.require(option.plan)
    if moved and option.continues:
        fault = "The offsets in the controller were changed since the last reading: that"
        fault += " measurement needs the machine and the stands as they were."
        raise UsageError(fault, "Leave out --choice for one with the stands set up again.")
    if option.continues and request.session.get("stands") == 1 and len(set(plan.series)) > 1:
        fault = "That measurement needs the two gauges where they are."
        raise UsageError(fault, "Use two gauges, or take another recommendation: --choice 2")
    following = events.Following(
        data=first.data, what=request.says(option.what), minutes=option.minutes,
        continues=option.continues, entered=(x, y, z),
    )  # fmt: skip
    plan = replace(plan, entered=(plan.entered + change).round(9))
    if not moved:
        return plan, following, ""
    path, by = visible(first.path), by_axis(change, "+.4g")
    changed = f"Since {path} was measured, the offsets in the controller were changed by {by} mm:"
    return plan, following, f"{changed} the new readings are written with that difference."


def _rank(path: str, request: Request) -> tuple[PriorReadings, tuple[NextMeasurement, ...], Model]:
    """Rank what to measure next, given the readings in a file, and on which machine."""
    keeper, choice = request.keeper, request.choice or 1
    if path == "-":
        raise UsageError("--then needs a file; standard input is the keyboard.", "Name the file.")
    data = read_document(path)
    given = read_input(data, request.model, request.otherwise)
    given.model.machine.check_guided()
    if names := machine_file.differing(given.recorded or given.model, given.model):
        fault = f"{path} was measured on another machine than that of --machine: they differ in"
        remedy = "Leave out --machine to use the machine of the session."
        raise UsageError(f"{fault} {', '.join(names)}.", remedy)
    first = PriorReadings(data, given)
    if not first.plan.fixed:
        fault = f"{path} was measured with the single-posture protocol. Further readings need fixed"
        fault += " gauges; readings of both kinds cannot be joined."
        raise UsageError(fault, "Measure a separate session: orthocal measure")
    options = rank_measurements(diagnose(first.readings, first.model))
    if choice > len(options):
        fault = f"There is no recommendation {choice} for {path}: there are {len(options)}."
        raise UsageError(fault, "Leave out --choice for the best one.")
    offsets = first.model.machine.active + first.left_entered
    if keeper is not None and not machine_file.differing(keeper.model, first.model):
        offsets = np.array(keeper.model.machine.active)
    return first, options, first.model.holding(tuple(offsets.round(9).tolist()))


def _holding(model: Model, offsets_mm: tuple[float, ...] | None) -> Model:
    """The machine with other offsets in its controller. Raises UsageError."""
    if offsets_mm is None:
        return model
    most = min(model.machine.travel_mm, LARGEST_OFFSET_MM)
    if len(offsets_mm) != 3 or not all(abs(value) < most for value in offsets_mm):
        remedy = f"Give X, Y and Z in mm, none beyond the travel of {most:g} mm: 0.412 -0.3 0"
        raise UsageError("These are not three joint offsets.", remedy)
    return model.holding(offsets_mm)


def _source(request: Request, first: PriorReadings | None) -> tuple[tuple[str, ...], int | None]:
    """Source of the readings; and the seed of a simulated gauge. Raises UsageError."""
    environment = dict(first.conditions.environment) if first else {}
    drawn = re.fullmatch("[0-9]{1,18}", environment.get("seed", ""))
    # Of the simulated gauge that gave the first readings.
    hidden = int(drawn[0]) if drawn and environment.get("readings_from") == VIRTUAL else None
    source = request.source or ((TYPED,) if hidden is None else (VIRTUAL,))
    if source != (VIRTUAL,):
        if request.seed is not None:
            raise UsageError("A seed belongs to the simulated gauge.", "Add --gauge simulated.")
        return source, None
    if first and (hidden is None or request.seed not in (None, hidden)):
        remedy = f"Leave out --gauge and --seed{': it is measured again' if drawn else ''}."
        raise UsageError(f"{first.path} was not measured on this simulated machine.", remedy)
    seeds = (hidden, request.seed, secrets.randbelow(1_000_000))
    return source, next(seed for seed in seeds if seed is not None)


def _setting_in(journal: Journal) -> Setting:
    """Machine, steps and earlier readings. Raises InputError."""
    path, opened, planned = str(journal.path), journal.state.opened, journal.state.planned
    model = machine_file.stored_machine(opened.machine, path).model
    if planned is None:
        steps = opened.session.steps(model.machine)
    else:
        cells: tuple[AnyCell, ...] = planned.readings
        steps = steps_of(cells[0].planned(cells), model.machine, opened.order, opened.stands)
    known = all(1 <= getattr(event, "step", 1) <= len(steps) for event in journal.events)
    if not known or (planned is None) != (opened.version == 1):
        fault = "The journal has a step that this session does not have, or another reading for it"
        remedy = "Restore the file from a copy; or move it away and begin again."
        raise InputError(f"{fault}.", remedy, file=path)
    return Setting(model, steps, planned.following if planned else None)


def serial_gauge(source: Sequence[str], opened: ExitStack) -> SerialGauge | None:
    """Open the serial gauges that --gauge names; None for others. Raises UsageError, GaugeLost."""
    if tuple(source) in ((), (TYPED,), (VIRTUAL,)):
        return None
    if TYPED in source or VIRTUAL in source or len(source) > 2:
        fault = f"These gauges do not go together: {', '.join(source)}."
        raise UsageError(fault, "Give typed, simulated, or one or two of FORMAT:PORT.")
    gauge = SerialGauge(source)
    for port in gauge.ports:
        opened.callback(port.close)
        port.open()
    return gauge


def _refuse_changes(opened: events.Opened, model: Model, request: Request) -> None:
    """Raises UsageError, naming every difference, if the session asked for is another one."""
    # What the controller held was asked when the session began; the file may say otherwise.
    asked = _holding(request.model or model, request.offsets_mm or model.machine.active)
    one, other = machine_file.machine_values(model), machine_file.machine_values(asked)
    names = {"stands": "gauges side by side"}
    pairs: list[tuple[str, object, object]] = [
        *((names.get(k, k), getattr(opened, k), now) for k, now in request.session.items()),
        ("seed", opened.seed, request.seed),
        *((f"machine, {k}", one.get(k, "none"), other.get(k, "none")) for k in one | other),
    ]
    if request.source and (VIRTUAL in request.source) != (VIRTUAL in opened.source):
        pairs.append(("gauge", ", ".join(opened.source), ", ".join(request.source)))
    differences = [
        f"{name}: {before} in the session, {now} asked for"
        for name, before, now in pairs
        if now not in (None, before)
    ]
    if differences:
        fault = "This is not the session that was begun. " + "; ".join(differences) + "."
        raise UsageError(fault, "Leave those options out, or begin a new session in another file.")


# ---- its file: `session.yaml` in the end, `session.journal` meanwhile


def session_path(given: Path) -> Path:
    """The session file of a name, perhaps without suffix. Raises UsageError: no name of a file."""
    if given.name in ("", ".."):
        fault = "A session must be a file; this is not one."
        raise UsageError(fault, "Name a file, such as session.yaml, or leave the name out.")
    if len(os.fsencode(given.name)) > _LONGEST:
        raise UsageError("The name of the file is too long.", "Choose a shorter one.")
    named = given.suffix in (".yaml", ".yml")
    return given if named else given.with_name(f"{given.name}.yaml")


def session_file(given: Path | None, folder: Path, resume: bool) -> Path:
    """The file of the session to begin or to go on with.

    Without a name it is, in the folder, the first free one of `session.yaml`, `session-2.yaml` …,
    or that of the only unfinished session. Raises UsageError: it exists, or a session that is no
    practice is unfinished; to go on, there is none, or there are several.
    """
    if given is None:
        waiting = unfinished(folder)
        names = ", ".join(path.name for path in waiting)
        if resume:
            if len(waiting) == 1:
                return waiting[0].with_suffix(".yaml")
            several = f"There are {len(waiting)} unfinished sessions here: {names}."
            fault = several if waiting else "There is no unfinished session in this folder."
            raise UsageError(fault, "Name its file: orthocal measure NAME.yaml --resume")
        if not all(map(is_practice, waiting)):  # a practice is no part of the loop
            fault = f"There is an unfinished session here: {names}."
            remedy = "Continue with --resume, or name a file for a new one:"
            raise UsageError(fault, f"{remedy} orthocal measure NAME.yaml")
        return free_path(folder, "session", ".yaml", JOURNAL)
    path = session_path(given)
    journal = path.with_suffix(JOURNAL)
    if not resume and path.exists():
        remedy = "Name another file, or continue an unfinished session with --resume."
        raise UsageError(f"{path} exists; a session is never overwritten.", remedy)
    if not resume and journal.exists():
        fault = f"{journal} holds a session that is not finished."
        raise UsageError(fault, f"Continue it: {command('measure', str(path), options='--resume')}")
    return path


def set_aside(given: Path | None, folder: Path, agrees: Callable[[str], bool]) -> str | None:
    """Give up an unfinished session if its operator `agrees`; the name that its journal has then.

    Raises UsageError: there is none, it is finished, or in use; InputError: it cannot be renamed.
    """
    path = session_file(given, folder, resume=True)
    journal, readings = path.with_suffix(JOURNAL), "readings, but is damaged"
    if path.exists() or not journal.exists():
        fault = f"There is no unfinished session {path}: nothing is discarded."
        raise UsageError(fault, "See what is in this folder: orthocal")
    with suppress(InputError), ExitStack() as opened:
        readings = counted(len(Journal.resume(journal, opened).state.accepted), "reading")
    aside = free_path(path.parent, path.stem, ".discarded")
    fate = f"It will be kept as {aside}\nand cannot be resumed. Discard it?"
    if not agrees(f"{journal} holds {readings}.\n{fate}"):
        return None
    try:
        journal.rename(aside)
    except OSError as error:
        fault = f"{journal} cannot be renamed: {error.strerror}."
        raise InputError(fault, "Check the folder and its permissions.") from error
    return str(aside)


def is_practice(journal: Path) -> bool:
    """True if an unfinished session reads a simulated machine; False if it cannot be read."""
    with suppress(OrthocalError, OSError):
        return Journal.decode(journal.read_bytes(), journal).state.opened.seed is not None
    return False


def unfinished(folder: Path) -> list[Path]:
    """Journals without a session file, in alphabetical order."""
    journals = folder.glob(f"*{JOURNAL}")
    return sorted(path for path in journals if not path.with_suffix(".yaml").exists())
