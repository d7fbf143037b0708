"""A live adjustment: loosen, push until the gauge reads what it should, tighten, check.

Each parameter has a step in the journal for each phase. Progress follows from what was read.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Literal

from pydantic import computed_field

from orthoglide_cal.errors import InputError, UnusableResultError, UsageError, command
from orthoglide_cal.files.input import ADJUSTMENT, Input, InputFile, adjustments_by
from orthoglide_cal.files.machine_file import machine_text
from orthoglide_cal.files.text import read_document
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.model.measured import Source
from orthoglide_cal.model.model import Estimate
from orthoglide_cal.model.plan import AnyCell
from orthoglide_cal.planning.adjustment import Adjustment, Removed, choose_adjustments
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.results.answer import MachineName
from orthoglide_cal.schema import Schema
from orthoglide_cal.session import events
from orthoglide_cal.session.asking import Asker, Style
from orthoglide_cal.session.dialogue import TYPED, VIRTUAL, Dialogue, serial_gauge, time_of_day
from orthoglide_cal.session.events import Journal, State
from orthoglide_cal.session.gauges import Token
from orthoglide_cal.session.readings import Setting
from orthoglide_cal.words import decimals_for, signed, value_text, with_uncertainty

HELP = """\
Type the reading, e.g. -0.12 (comma or point; mm, or add "in"), then Return.
  u            undo the last reading
  n text       note, kept with this step
  s why        leave this parameter as it is
  q            save and quit; continue later with --resume
Every reading is on the disk before the next prompt."""

BEGUN = """\
Leave the gauge and the machine where they stand while anything is loose.
If one of them was moved: q, and measure again."""

HOMED = """
The reading shows a push only after homing. After each push: keep clear,
drives on, home, drive back here, read; drives off before the next."""

PROBED = """\
Read the height at which the probe triggers (Klipper: z of PROBE). A dial
indicator on the effector does as well: always at this place and one height."""


class Phase(StrEnum):
    """Readings of each parameter, in this order."""

    LOOSE = "loose"
    PUSHED = "pushed"
    TIGHT = "tight"
    HERE = "here"
    THERE = "there"


PHASES = tuple(Phase)
_ASKED = {
    Phase.LOOSE: "{} before anything is loosened",
    Phase.HERE: "{} here, tightened, drives on",
    Phase.THERE: "{} there, for the check",
}


class Adjusted(Schema):
    """One adjustment as far as it has come."""

    adjustment: Adjustment
    readings_mm: Mapping[Phase, float]  # of the gauge, the last of each phase
    left: bool  # as it is: the operator wished so

    @classmethod
    def of(cls, state: State, adjustment: Adjustment, number: int) -> "Adjusted":
        """Progress of an adjustment in a journal; the first adjustment is number 0."""
        steps = dict(enumerate(PHASES, len(PHASES) * number + 1))
        read = {steps[n]: item.take.value_mm for n, item in state.accepted.items() if n in steps}
        left = not steps.keys().isdisjoint(state.skipped)
        return cls(adjustment=adjustment, readings_mm=read, left=left)

    @computed_field  # reading at which the parameter is zero
    @property
    def target_mm(self) -> float | None:
        loose = self.readings_mm.get(Phase.LOOSE)
        return None if loose is None else loose + self.adjustment.change_mm

    @computed_field  # reading there less reading here, tightened
    @property
    def check_mm(self) -> float | None:
        here, there = map(self.readings_mm.get, (Phase.HERE, Phase.THERE))
        return None if here is None or there is None else there - here

    @computed_field  # check failed: something moved in another way
    @property
    def status(self) -> Literal["adjusted", "check failed", "left as it is", "not finished"]:
        if self.left or self.check_mm is None:
            return "left as it is" if self.left else "not finished"
        off = self.check_mm - self.adjustment.check_mm
        return "adjusted" if abs(off) <= self.adjustment.check_expanded_mm else "check failed"

    @property
    def removed(self) -> Removed:
        """Errors that it took away, by as much as the gauge moved."""
        if self.status != "adjusted":
            return ()
        moved = self.readings_mm[Phase.TIGHT] - self.readings_mm[Phase.LOOSE]
        share = moved / self.adjustment.change_mm
        return [(id, by.changed(value=by.value * share)) for id, by in self.adjustment.removes]

    @property
    def now_mm(self) -> float:
        """The last reading before it was tightened."""
        return self.readings_mm.get(Phase.PUSHED, self.readings_mm.get(Phase.LOOSE, 0.0))

    def to_go_mm(self, now: float) -> float:
        """Distance that the gauge must move from a reading, with its sign; 0 within U."""
        away = (self.target_mm or 0.0) - now
        return away if abs(away) > self.adjustment.expanded_mm else 0.0

    @property
    def next(self) -> Phase | None:
        """Phase that is read next; None once it is done or left."""
        phase = next((phase for phase in PHASES if phase not in self.readings_mm), None)
        return None if self.left or phase is None else self.counts_as(phase, self.now_mm)

    def counts_as(self, phase: Phase, value: float) -> Phase:
        """The phase of a reading: what is outside U is pushed, also once it was tightened."""
        return Phase.PUSHED if phase is Phase.TIGHT and self.to_go_mm(value) else phase


class AdjustmentAnswer(Schema):
    """Adjustments after one measurement: the object of `adjust --json`."""

    schema_version: Literal[1] = 1
    input: InputFile
    machine: MachineName
    cause: str
    adjustments: tuple[Adjusted, ...]

    @property
    def failed(self) -> bool:
        """True if anything did not move as it was meant to."""
        return any(one.status == "check failed" for one in self.adjustments)


@dataclass(eq=False)
class AdjustingDialogue(Dialogue):
    """Leads through adjustments, one after the other, each with a gauge at one place."""

    adjustments: tuple[Adjustment, ...] = ()
    _safe: bool = False  # the drives are off
    _stays: bool = False  # the two lines above the cursor are those of the last reading

    @property
    def adjusted(self) -> tuple[Adjusted, ...]:
        """All adjustments as far as they have come."""
        return tuple(Adjusted.of(self.state, one, k) for k, one in enumerate(self.adjustments))

    def greet(self) -> None:
        """Say what is adjusted, in which order."""
        names = ", then ".join(adjustment.name for adjustment in self.adjustments)
        begun = f" Resumed: {len(self.state.accepted)} readings." if self.state.accepted else ""
        self.asker.say(f"To be adjusted: {names}.{begun} ? is help.", Style.TITLE)

    def run(self) -> None:
        """Lead through what is left, unless a check fails. Raises as `Dialogue.run`."""
        while self.state.ended is None:
            for setup, one in enumerate(self.adjusted, start=1):
                steps = [step for step in self.setting.steps if step.setup == setup]
                if one.next:
                    self._ask_for(steps[PHASES.index(one.next)])
                    break
                if one.status == "check failed":
                    if self._doubted(one):
                        self._take_again(steps[-2:], "check read again")
                    else:
                        self.write(events.Ended(at=self.now(), reason="a check failed"))
                    break
            else:
                self.write(events.Ended(at=self.now(), reason="complete"))

    def _doubted(self, one: Adjusted) -> bool:
        """True if the operator takes the readings of a check that failed again."""
        if not self.asker.keyboard.live:
            return False
        plan, moved = one.adjustment, one.check_mm or 0.0
        wanted = with_uncertainty(plan.check_mm, plan.check_expanded_mm)
        digits = decimals_for(plan.check_expanded_mm)
        text = f"From here to there it changes by {signed(moved, digits)} instead of {wanted} mm."
        self.asker.say(text, Style.QUESTION)
        return self._agrees("Read both again? y/n > ")

    def _ask_for(self, step: SessionStep) -> None:
        """Show what is to be done, where it is new, and take a reading."""
        asker, one, phase = self.asker, self.adjusted[step.setup - 1], Phase(step.posture)
        self._introduce(step, phase, one)
        noun = self.setting.machine.vocabulary.noise  # the instrument that is read
        if phase in _ASKED:
            above = self._place(step)
            now = f"{_ASKED[phase].format(noun.capitalize())} [mm]{asker.hint}"
        else:
            above, now = _lines(one, noun)
            stays = self._stays and not asker.pushed and asker.keyboard.live
            asker.show(above, Style.ABOVE if stays else Style.PLAIN)
        asker.pushed = False
        answer = asker.ask(f"{above}\n{now} > ", step, self.state.takes(step.number))
        raw = answer.raw if isinstance(answer, Token) else str(answer)
        longest = max(len(above), len(f"{now} > {raw}"))
        self._stays = phase not in _ASKED and longest < asker.keyboard.columns
        self._receive(answer, step)

    def _introduce(self, step: SessionStep, phase: Phase, one: Adjusted) -> None:
        """Say, once, what has to be done before a reading; ask that nothing can fall."""
        if self._shown == (step.setup, phase):
            return
        asker, plan, begun = self.asker, one.adjustment, Phase.LOOSE in one.readings_mm
        driven = (Phase.HERE, Phase.THERE, *[Phase.LOOSE] * plan.homed)
        drives_off, new = phase not in driven, step.setup != self._shown[0]
        if new:
            if step.cell.words:
                rule, text = f"-- {plan.name} ".ljust(asker.keyboard.columns - 2, "-"), PROBED
            else:
                rule, text = self._set_up(step.setup, begun)
                text = BEGUN if begun else text
            asker.say(f"\n{rule}", Style.TITLE)
            asker.say(
                f"{text}\n{plan.name} is {with_uncertainty(plan.value, plan.expanded)} {plan.unit}:"
                f" each {plan.unit} moves this reading by {plan.sensitivity:+.3f} mm."
            )
            self._safe = False
        if phase is Phase.HERE:
            asker.say("Switch the drives on; home, if the controller asks for it.", Style.TITLE)
        if not (drives_off and begun) or (new and plan.homed):
            asker.say(self._place(step))
        asked = "Are the drives off, and is every axis secured so that none can fall? y/n > "
        if drives_off and not self._safe:
            while not self._agrees(asked):
                asker.say("Loosen nothing until then. q saves and quits.", Style.BAD)
            text = "drives off, no axis can fall: confirmed"
            self.write(events.Noted(at=self.now(), step=step.number, text=text))
        self._safe = drives_off
        if phase is Phase.PUSHED:
            asker.say(f"Loosen {plan.loosen}.{HOMED if plan.homed else ''}", Style.TITLE)
        self._shown = step.setup, phase

    def _read(self, step: SessionStep, token: Token) -> None:
        """Record a reading; only one that the gauge cannot show is refused."""
        taken, one = self._taken(step, token), self.adjusted[step.setup - 1]
        phase, most = Phase(step.posture), self.setting.machine.instrument.most_mm
        loose = one.readings_mm.get(Phase.LOOSE, taken.value_mm)
        if abs(taken.value_mm - loose) > most:
            far = f"That is more than {most:g} mm away from the first reading"
            self.asker.say(f"{far}: not recorded.", Style.BAD)
            return
        later = PHASES.index(one.counts_as(phase, taken.value_mm)) - PHASES.index(phase)
        self.write(taken.changed(step=step.number + later))
        self.asker.rest(driving=False)
        if phase in _ASKED:
            self.asker.say(f"   saved {value_text(taken.value_mm, self.request.unit)}", Style.GOOD)

    def _obey(self, key: str, words: str, step: SessionStep) -> None:
        """Do what a key says; nothing is read again but what was undone."""
        if key in ("r", "t", "?"):
            self.asker.say(HELP)
        else:
            if key == "s":
                self.warn()
            super()._obey(key, words, step)

    def warn(self) -> None:
        """Say what comes first where something may be loose."""
        if self._safe:
            self.asker.say("\nTighten what is loose before the drives are on.", Style.BAD)


def _lines(one: Adjusted, noun: str) -> tuple[str, str]:
    """Two lines: what the gauge or probe must read, and what it reads."""
    plan, now, target = one.adjustment, one.now_mm, one.target_mm or 0.0
    decimals, go = decimals_for(plan.expanded_mm), one.to_go_mm(one.now_mm)
    aim = f"{target:+.{decimals}f} ± {plan.expanded_mm:.{decimals}f}"
    if not go:
        return f"Inside {aim}. Tighten it, then read it once more.", f"now {now:+.{decimals}f} ✔"
    arrow, way = ("→", plan.ways[0]) if go > 0.0 else ("←", plan.ways[1])
    above = f"Push {plan.move} {way} until the {noun} reads {aim}"
    return above, f"now {now:+.{decimals}f} {arrow} {abs(go):.{decimals}f} to go [mm]"


def open_adjustments(
    given: Input,
    cause: str,
    adjustments: tuple[Adjustment, ...],
    source: tuple[str, ...],
    resume: bool,
    asker: Asker,
    opened: ExitStack,
) -> AdjustingDialogue:
    """Begin the adjustments of a cause that an input names, or go on with them.

    Raises UsageError: they are begun already, or not yet; InputError: a file cannot be used;
    GaugeLost: the gauge cannot be reached.
    """
    if VIRTUAL in source:
        problem = "A simulated gauge does not see what you push."
        raise UsageError(problem, "Leave out --gauge to type the readings, or name a real one.")
    session = Path(given.measured.source.path)
    target = session.with_suffix(f".{cause}{ADJUSTMENT}")
    if target.exists() and not resume:
        problem = f"{session} was adjusted already, or this was begun: {target.name} exists."
        remedy = "Measure again before you adjust again, or continue with --resume."
        raise UsageError(problem, remedy)
    asker.gauge = serial_gauge(source, opened)  # a missing one leaves no file behind
    following = events.Following(data=read_document(str(session)), what=cause)
    cells = _cells(adjustments)
    if not resume:
        at, machine, source = time_of_day(), machine_text(given.model), source or (TYPED,)
        begun = events.Opened(at=at, version=2, machine=machine, source=source)
        Journal.create(target, begun, events.Planned(at=at, readings=cells, following=following))
    journal = Journal.resume(target, opened)
    _check_same(journal.state, following, adjustments, target)
    asker.gauge = asker.gauge or serial_gauge(journal.state.source, opened)
    places = product(range(1, len(adjustments) + 1), PHASES)
    steps = tuple(
        SessionStep(number, cell, phase, 1, 0, setup, 10 * setup)
        for number, (cell, (setup, phase)) in enumerate(zip(cells, places, strict=True), start=1)
    )
    setting = Setting(given.model, steps, following)
    dialogue = AdjustingDialogue(session, journal, setting, asker, adjustments=adjustments)
    opened.callback(dialogue.warn)  # however it is left
    return dialogue


def _cells(adjustments: Sequence[Adjustment]) -> tuple[AnyCell, ...]:
    """Cells that are read, in all phases of each adjustment."""
    return tuple(c for one in adjustments for c in (*[one.here] * (len(PHASES) - 1), one.there))


def _check_same(
    state: State, following: events.Following, adjustments: Sequence[Adjustment], journal: Path
) -> None:
    """Raise InputError for a journal of other adjustments."""
    then = state.planned
    if then is None or (then.readings, then.following) != (_cells(adjustments), following):
        problem = "This is the journal of another adjustment, or of other readings."
        remedy = "Judge them by the machine of that time (--machine FILE), or measure again."
        raise InputError(problem, remedy, file=str(journal))


def _begun(source: Source) -> Iterator[tuple[Path, State, events.Following]]:
    """The journals of what was adjusted by these data, as far as they come."""
    for path in adjustments_by(source.path):
        state = Journal.decode(path.read_bytes(), path).state
        following = state.planned and state.planned.following
        if following and following.data.sha256 == source.sha256:
            yield path, state, following


def check_not_adjusted(given: Input) -> None:
    """Raise UnusableResultError if a screw was turned since, or may be loose."""
    path = given.measured.source.path
    for journal, state, following in _begun(given.measured.source):
        problem = f"It was adjusted since then ({journal.name}): these readings are out of date."
        if state.ended:
            raise UnusableResultError(problem, "Measure again, and apply the new session.")
        problem = f"An adjustment was begun ({journal.name}): something may be loose."
        options = f"--cause {following.what} --resume"
        finish = command("adjust", path, machine=given.machine_file, options=options)
        remedy = "Delete that file, if nothing was loosened. Or finish it, then measure again:"
        raise UnusableResultError(problem, f"{remedy} {finish}")


def adjusted_since(given: Input) -> Removed:
    """Errors that were taken away since the measurement, by as much as the gauge moved.

    Raises InputError: what is judged now is not what was adjusted then.
    """
    removed: list[tuple[str, Estimate]] = []
    diagnosis: Diagnosis | None = None
    for journal, state, following in _begun(given.measured.source):
        adjustments: tuple[Adjustment, ...] = ()
        with suppress(UnusableResultError):
            diagnosis = diagnosis or diagnose(given.measured, given.model)
            _, adjustments = choose_adjustments(diagnosis, following.what)
        _check_same(state, following, adjustments, journal)
        for number, adjustment in enumerate(adjustments):
            removed += Adjusted.of(state, adjustment, number).removed
    return removed
