"""A live adjustment: loosen, push until the gauge reads what it should, tighten, check.

Each parameter has five steps in the journal; the second is read again and again. Where one stands
follows from what was read last, so that an interruption or an undo changes nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Literal

from pydantic import Field

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError, UsageError, command
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.machine_file import machine_text
from orthoglide_cal.files.text import read_document
from orthoglide_cal.inference import Diagnosis
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.planning.adjustment import Adjustment
from orthoglide_cal.planning.steps import (
    NOTHING_ENTERED,
    MeasuringProtocol,
    Order,
    SessionStep,
)
from orthoglide_cal.results.answer import InputFile, MachineName
from orthoglide_cal.schema import Schema
from orthoglide_cal.session import events, wording
from orthoglide_cal.session.asking import Asker, Style
from orthoglide_cal.session.dialogue import Dialogue
from orthoglide_cal.session.events import State
from orthoglide_cal.session.gauges import Token
from orthoglide_cal.session.journal import Journal
from orthoglide_cal.session.opening import SIMULATED, TYPED, Request, clock, serial_gauge
from orthoglide_cal.session.readings import Setting
from orthoglide_cal.words import MM, counted, decimals_for

JOURNAL = ".adjust"  # not that of a session

HELP = """\
Type the reading, e.g. -0.12 (comma or point; mm, or add "in"), then Return.
  u            undo the last reading
  n text       note, kept with this step
  s why        leave this parameter as it is
  q            save and quit; continue later with --resume
  ?            this help
Every reading is on the disk before the next prompt."""


class Phase(IntEnum):
    """What is read for each parameter, in this order."""

    LOOSE = 1  # before it is loosened
    PUSHED = 2  # again and again
    TIGHT = 3
    HERE = 4  # with the drives on again
    THERE = 5  # at the second posture


_ASKED = {
    Phase.LOOSE: "Gauge before anything is loosened",
    Phase.HERE: "Gauge here, tightened, drives on",
    Phase.THERE: "Gauge there",
}


class Adjusted(Schema):
    """One adjustment, as far as it has come; null: not read yet."""

    adjustment: Adjustment
    status: Literal["adjusted", "failed", "left", "unfinished"] = Field(
        description="failed: the check does not agree; left: as it is, as the operator wished"
    )
    before_mm: float | None = Field(description="reading before it was loosened")
    target_mm: float | None = Field(description="reading at which the parameter is zero")
    reading_mm: float | None = Field(description="the last one, tightened")
    check_mm: float | None = Field(description="reading there less reading here, afterwards")


class AdjustmentAnswer(Schema):
    """What was adjusted after one measurement: the object of `adjust --json`."""

    schema_version: Literal[1] = 1
    input: InputFile
    machine: MachineName
    cause: str
    adjustments: tuple[Adjusted, ...]

    @property
    def failed(self) -> bool:
        """True if anything was not adjusted as it was meant to be."""
        return any(each.status == "failed" for each in self.adjustments)


def steps_of_adjustments(
    adjustments: Sequence[Adjustment], machine: Orthoglide
) -> tuple[SessionStep, ...]:
    """Five steps for each adjustment, in a gauge set-up of their own."""
    steps: list[SessionStep] = []
    for setup, adjustment in enumerate(adjustments, 1):
        here, there = adjustment.cells
        for phase in Phase:
            cell = there if phase is Phase.THERE else here
            posture = machine.posture_at(cell.displacement)
            number = len(steps) + 1
            assert posture is not None
            steps.append(SessionStep(number, cell, posture, phase, 0, setup, 10 * number))
    return tuple(steps)


@dataclass(frozen=True)
class Progress:
    """What was read for one adjustment in a state of the journal."""

    adjustment: Adjustment
    values: dict[Phase, float]  # the last reading of each phase
    tightened: bool  # it was read after the last push
    left: bool  # as the operator wished

    @classmethod
    def of(cls, state: State, adjustment: Adjustment, setup: int) -> "Progress":
        """Of the adjustment with this set-up, from 1."""
        numbers = {phase: len(Phase) * (setup - 1) + phase for phase in Phase}
        taken = {p: state.accepted[n] for p, n in numbers.items() if n in state.accepted}
        ranks = [taken[p].rank if p in taken else 0 for p in (Phase.PUSHED, Phase.TIGHT)]
        left = any(number in state.skipped for number in numbers.values())
        values = {phase: item.take.value_mm for phase, item in taken.items()}
        return cls(adjustment, values, ranks[1] > ranks[0], left)

    @property
    def target_mm(self) -> float | None:
        """Reading at which the parameter is zero; None before the first."""
        loose = self.values.get(Phase.LOOSE)
        return None if loose is None else loose + self.adjustment.change_mm

    @property
    def now_mm(self) -> float:
        """The last reading before the check."""
        return self.values[self._last]

    @property
    def _last(self) -> Phase:
        before = max(self.values.keys() & {Phase.LOOSE, Phase.PUSHED})
        return Phase.TIGHT if self.tightened else before

    @property
    def to_go_mm(self) -> float:
        """How far the gauge must still move, with its sign."""
        return (self.target_mm or 0.0) - self.now_mm

    @property
    def inside(self) -> bool:
        """True if the gauge reads what it should, within U."""
        return abs(self.to_go_mm) <= self.adjustment.expanded_mm

    @property
    def check_mm(self) -> float | None:
        """Difference between the two postures after it was tightened."""
        if not {Phase.HERE, Phase.THERE} <= self.values.keys():
            return None
        return self.values[Phase.THERE] - self.values[Phase.HERE]

    @property
    def next(self) -> Phase | None:
        """What is read next; None once it is done or left."""
        if self.left or Phase.THERE in self.values:
            return None
        if Phase.LOOSE not in self.values:
            return Phase.LOOSE
        if self._last is Phase.LOOSE or not self.inside:
            return Phase.PUSHED
        if not self.tightened:
            return Phase.TIGHT
        return Phase.THERE if Phase.HERE in self.values else Phase.HERE

    @property
    def result(self) -> Adjusted:
        """As other programs see it."""
        check, adjustment = self.check_mm, self.adjustment
        status = "left" if self.left else "unfinished"
        if check is not None:
            good = abs(check - adjustment.check_mm) <= adjustment.check_expanded_mm
            status = "adjusted" if good else "failed"
        target = self.target_mm
        return Adjusted(
            adjustment=adjustment, status=status, check_mm=check, target_mm=target,
            before_mm=self.values.get(Phase.LOOSE),
            reading_mm=None if target is None else self.now_mm,
        )  # fmt: skip


@dataclass(eq=False)
class AdjustingDialogue(Dialogue):
    """Leads through adjustments, one after the other, each with a gauge at one place."""

    id: str = ""  # of the cause
    adjustments: tuple[Adjustment, ...] = ()
    _safe: set[int] = field(default_factory=set)  # set-ups for which the drives are off
    _prompt: str = ""
    _stays: bool = False  # the two lines above the cursor are those of the last reading

    def progress(self, setup: int) -> Progress:
        """Of the adjustment with this set-up, from 1."""
        return Progress.of(self.state, self.adjustments[setup - 1], setup)

    def answer(self, given: Input) -> AdjustmentAnswer:
        """The result, of what was measured before."""
        machine = self.setting.machine
        setups = range(1, len(self.adjustments) + 1)
        return AdjustmentAnswer(
            input=InputFile.of(given),
            machine=MachineName(name=machine.name, kind=machine.kind),
            cause=self.id,
            adjustments=tuple(self.progress(setup).result for setup in setups),
        )

    def greet(self) -> None:
        """Say what is adjusted, in which order, and what was there already."""
        names = ", then ".join(adjustment.parameter for adjustment in self.adjustments)
        lines = f"Adjusting {self.id}: {CAUSES[self.id].title}.\nIn this order: {names}. ? is help."
        self.asker.say(lines, Style.TITLE)
        taken = len(self.state.accepted)
        if taken or self.state.replaced:
            self.asker.say(f"Resumed: {counted(taken, 'reading')} count so far.", Style.GOOD)

    def run(self) -> State:
        """Lead through what is left. Raises as `Dialogue.run`."""
        while self.state.ended is None:
            setups = range(1, len(self.adjustments) + 1)
            waiting = ((k, phase) for k in setups if (phase := self.progress(k).next))
            setup, phase = next(waiting, (0, Phase.LOOSE))
            if setup:
                self._ask_for(self.setting.steps[len(Phase) * (setup - 1) + phase - 1])
            else:
                self.write(events.Ended(at=self.now(), reason="complete"))
        return self.state

    def _ask_for(self, step: SessionStep) -> None:
        """Show what is to be done, where it is new, and take a reading."""
        asker, phase, hint = self.asker, Phase(step.cycle), ""
        progress = self.progress(step.setup)
        self._introduce(step, progress)
        if asker.gauge:
            hint = f" ({asker.gauge.hint})"
        if phase in (Phase.PUSHED, Phase.TIGHT):
            above, now = self._to_go(progress, phase)
            stays = self._stays and not asker.pushed and asker.keyboard.live
            asker.show(above, Style.ABOVE if stays else Style.PLAIN)
            prompt = f"{now} [{self.unit}] > "
        else:
            above, prompt = "", f"{_ASKED[phase]} [{self.unit}]{hint} > "
        asker.pushed, self._stays, self._prompt = False, False, prompt
        answer = asker.ask(f"{above}\n{prompt}", step, self.state.takes(step.number))
        self._receive(answer, step)

    def _introduce(self, step: SessionStep, progress: Progress) -> None:
        """Say what has to be done before a reading, once; ask that nothing can fall."""
        asker, adjustment, phase = self.asker, progress.adjustment, Phase(step.cycle)
        if step.setup != self._shown[0]:
            rule, text = wording.set_up(self.setting, step.setup, False, asker.columns)
            asker.say(f"\n{rule}", Style.TITLE)
            asker.say(text)
            unit, value = adjustment.unit, adjustment.value
            asker.say(
                f"Adjusted is {adjustment.parameter}: {value:+.3g} ± {adjustment.expanded:.2g}"
                f" {unit}. 1 {unit} moves this gauge by {adjustment.sensitivity:+.3f} mm."
            )
        loose = phase in (Phase.LOOSE, Phase.PUSHED, Phase.TIGHT)
        if loose != (step.setup in self._safe) or step.setup != self._shown[0]:
            if not loose:
                asker.say("Switch the drives on; home, if the controller asks for it.", Style.TITLE)
            asker.say(wording.place(step, self.setting))
        elif phase is Phase.THERE and self._shown[-1] is not phase:
            asker.say(wording.place(step, self.setting))
        if loose and step.setup not in self._safe:
            self._make_safe(step)
        if not loose:
            self._safe.discard(step.setup)
        if phase is Phase.PUSHED and self._shown[-1] is not phase:
            asker.say(f"Loosen {adjustment.loosen}.", Style.TITLE)
        self._shown = step.setup, phase

    def _make_safe(self, step: SessionStep) -> None:
        """Ask that the drives are off, until they are, and record the answer. Raises Quit."""
        asked = "Are the drives off, and is every axis secured so that none can fall? y/n > "
        self.asker.say("The machine stands there? Then switch the drives off.", Style.QUESTION)
        while not self._agrees(asked):
            self.asker.say("Nothing is loosened before that. q saves and quits.", Style.BAD)
        text = "drives off, no axis can fall: confirmed"
        self.write(events.Noted(at=self.now(), step=step.number, text=text))
        self._safe.add(step.setup)

    def _to_go(self, progress: Progress, phase: Phase) -> tuple[str, str]:
        """Two lines: what the gauge must read, and what it reads."""
        adjustment, go, unit = progress.adjustment, progress.to_go_mm, MM[self.unit]
        decimals = decimals_for(adjustment.expanded_mm / unit)
        within = f"{adjustment.expanded_mm / unit:.{decimals}f}"
        target, now = ((go + progress.now_mm) / unit, progress.now_mm / unit)
        aim = f"{target:+.{decimals}f} ± {within}"
        if phase is Phase.TIGHT:
            return f"Inside {aim}. Tighten it, then read once more.", f"now {now:+.{decimals}f} ✔"
        to = "+" if go > 0.0 else "-"
        way = f"{to}{AXES[adjustment.direction].upper()}"
        above = f"Push {adjustment.move} towards {way} until the gauge reads {aim}"
        arrow = "→" if go > 0.0 else "←"
        return above, f"now {now:+.{decimals}f} {arrow} {abs(go) / unit:.{decimals}f} to go"

    def _read(self, step: SessionStep, token: Token) -> None:
        """Record a reading; only one that the gauge cannot show is refused."""
        taken, gauge = self._taken(step, token), self.setting.machine.gauge
        loose = self.progress(step.setup).values.get(Phase.LOOSE, taken.value_mm)
        if abs(taken.value_mm - loose) > gauge.range_mm:
            far = f"That is farther away than the gauge's travel of {gauge.range_mm:g} mm"
            self.asker.say(f"{far}: not recorded.", Style.BAD)
            return
        self.write(taken)
        self.asker.rest(driving=False)
        self._stays = len(self._prompt) + len(token.raw) < self.asker.columns
        if Phase(step.cycle) not in (Phase.PUSHED, Phase.TIGHT):
            saved = f"   saved {wording.value_text(taken.value_mm, self.unit)}"
            self.asker.say(saved, Style.GOOD)
        result = self.progress(step.setup).result
        if result.check_mm is not None:
            self._say_check(result)

    def _say_check(self, result: Adjusted) -> None:
        """Say whether the difference between the two postures is as it should be."""
        plan = result.adjustment
        decimals = decimals_for(plan.check_expanded_mm)
        check = f"{result.check_mm:+.{decimals}f} mm there less here, expected"
        check += f" {plan.check_mm:+.{decimals}f} ± {plan.check_expanded_mm:.{decimals}f}"
        if result.status == "adjusted":
            self.asker.say(f"Check: {check}: {plan.parameter} is adjusted.", Style.GOOD)
        else:
            moved = "Something moved in another way than it was meant to: measure again."
            self.asker.say(f"Check FAILED: {check}. {moved}", Style.BAD)

    def _obey(self, key: str, words: str, step: SessionStep) -> None:
        """Do what a key says."""
        if key == "u" and self.state.before is not None:
            self.write(events.Undone(at=self.now()))
            self.asker.say("Undone: the last reading does not count.")
        elif key in ("r", "?"):
            self.asker.say(HELP)
        else:
            super()._obey(key, words, step)


def open_adjustments(
    path: Path,
    diagnosis: Diagnosis,
    id: str,
    adjustments: tuple[Adjustment, ...],
    request: Request,
    asker: Asker,
) -> AdjustingDialogue:
    """Begin the adjustments of a cause that a session names, or go on with them.

    Raises UsageError: they are begun already, or not yet; InputError: a file cannot be used;
    GaugeLost: the gauge cannot be reached.
    """
    if SIMULATED in request.source:
        what = "A simulated gauge does not see what you push."
        raise UsageError(what, "Leave out --gauge to type the readings, or name a real one.")
    model, target = diagnosis.model, path.with_suffix(f".{id}{JOURNAL}")
    steps = steps_of_adjustments(adjustments, model.orthoglide)
    cells = tuple(step.cell for step in steps)
    if gauge := serial_gauge(request.source):
        gauge.open()  # a missing gauge leaves no file behind
    if request.resume:
        journal = Journal.resume(target)
    elif target.exists():
        again = command("adjust", str(path), options=f"--cause {id} --resume")
        what = f"{path} was adjusted already, or that was begun: {target.name} is there."
        raise UsageError(what, f"Measure again before you adjust again; or continue: {again}")
    else:
        opened = events.Opened(
            at=clock(), version=2, protocol=MeasuringProtocol.DOUBLE,
            machine=machine_text(model), cycles=1, order=Order.PAPER, stands=1,
            source=request.source or (TYPED,), seed=None, operator="", temperature_c=None,
            gauges=(),
        )  # fmt: skip
        following = events.Following(
            data=read_document(str(path)), what=f"adjust {id}", minutes=0.0, continues=False,
            entered=NOTHING_ENTERED,
        )  # fmt: skip
        planned = events.Planned(at=clock(), readings=cells, following=following)
        journal = Journal.create(target, opened, planned)
    try:
        state = events.replay(journal.events)
        if state.planned is None or state.planned.readings != cells:
            what = "This journal is of another adjustment."
            raise InputError(what, "Move it away and begin again.", file=str(target))
        if gauge is None and (gauge := serial_gauge(state.source)):
            gauge.open()
        asker.gauge = gauge
        return AdjustingDialogue(
            path, journal, Setting(model, steps), asker, clock, request.unit,
            id=id, adjustments=adjustments,
        )  # fmt: skip
    except BaseException:
        journal.close()
        raise
