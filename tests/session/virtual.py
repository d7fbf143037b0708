"""A virtual technician for the tests: readings of a whole session, blunders, scripted answers."""

import contextlib
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.files.machine_file import machine_text
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model
from orthoglide_cal.planning.steps import GuidedSession, MeasuringProtocol, Order, SessionStep
from orthoglide_cal.session.asking import Asker, Line, Show, Style
from orthoglide_cal.session.dialogue import Dialogue, Quit, Request
from orthoglide_cal.session.events import (
    Answered,
    Arrived,
    Doubt,
    Event,
    Journal,
    Noted,
    Opened,
    Questioned,
    Reopened,
    Retake,
    Shortened,
    Skipped,
    State,
    Taken,
    Undone,
    advance,
    replay,
)
from orthoglide_cal.session.gauges import LiveGauge, SimulatedGauge
from orthoglide_cal.session.readings import Question, ReadingsSoFar, Setting, check
from orthoglide_cal.words import Unit
from tests.machines import NOMINAL, PROTOTYPE

AT = "2025-03-01T09:00:00.000+01:00"
DOUBLE, SINGLE = MeasuringProtocol.DOUBLE, MeasuringProtocol.SINGLE
both_protocols = pytest.mark.parametrize("protocol", [DOUBLE, SINGLE])


def stands(protocol: MeasuringProtocol) -> int:
    return 1 if protocol is SINGLE else 2


def steps_of(protocol: MeasuringProtocol = DOUBLE, cycles: int = 3) -> tuple[SessionStep, ...]:
    return GuidedSession(protocol=protocol, cycles=cycles, stands=stands(protocol)).steps(PROTOTYPE)


def setting_of(steps: Sequence[SessionStep], machine: Machine | None = None) -> Setting:
    """These steps on the prototype or another machine without causes."""
    return Setting(Model(machine) if machine else NOMINAL, tuple(steps))


def opened(protocol: MeasuringProtocol = DOUBLE, cycles: int = 3, **other: object) -> Opened:
    values: dict[str, object] = {
        "at": AT,
        "version": 1,
        "machine": machine_text(NOMINAL),
        "protocol": protocol,
        "cycles": cycles,
        "order": Order.PAPER,
        "stands": stands(protocol),
        "source": ("typed",),
        "seed": None,
        "operator": "",
        "temperature_c": None,
        "gauges": (),
    }
    return Opened(**{**values, **other})  # type: ignore[arg-type]


def readings_of(
    steps: Sequence[SessionStep], seed: int = 1, machine: Machine | None = None
) -> list[float]:
    """What healthy gauges show at these steps [mm]."""
    gauge = SimulatedGauge(setting_of(steps, machine), seed)
    values = []
    for step in steps:
        gauge.begin(step, 0)
        values.append(gauge.poll(asked=True)[0].value or 0.0)
    return values


def typed(values: Iterable[float]) -> list[str]:
    return [f"{value:.2f}" for value in values]


def taken(step: int, value: float, minutes: float = 0.0, source: str = "typed") -> Taken:
    return Taken(at=AT, step=step, minutes=minutes, value_mm=value, raw=f"{value}", source=source)


def questioned(take: Taken, doubt: Doubt, question: str) -> Questioned:
    """The same reading, questioned."""
    return Questioned(**take.model_dump(exclude={"kind"}), doubt=doubt, question=question)


def random_events(seed: int, count: int, steps: int = 8) -> list[Event]:
    """Records in any order, sensible or not, but that an accepted step is read again only after a
    retake or an undo."""
    rng, state, events = np.random.default_rng(seed), replay([opened()]), list[Event]()
    for number in range(count):
        step = int(rng.integers(1, steps + 1))
        reading = taken(step, round(float(rng.normal()), 2), 1.0 / 3.0 + 0.4321987 * number)
        event = [
            reading,
            questioned(reading, Doubt.STAND, "really?"),
            Answered(at=AT, keep=bool(rng.integers(2)), moved=bool(rng.integers(2))),
            Undone(at=AT),
            Retake(at=AT, steps=(step, step + 1), reason="why"),
            Skipped(at=AT, step=step, reason="why"),
            Noted(at=AT, step=step, text="note"),
            Reopened(at=AT, source=("simulated",)),
            Shortened(at=AT, drop=(step, 9), reason="known"),
        ][int(rng.choice(9, p=[0.4, 0.1, 0.1, 0.1, 0.1, 0.05, 0.05, 0.05, 0.05]))]
        if not isinstance(event, Arrived) or state.is_open(step):
            state = advance(state, event)
            events.append(event)
    return events


def read_next(
    state: State,
    steps: Sequence[SessionStep],
    index: int,
    minutes: float,
    value: float = 0.0,
    machine: Machine | None = None,
) -> ReadingsSoFar:
    """The readings that the state holds, and last that of `steps[index]`."""
    state = advance(state, taken(steps[index].number, value, minutes))
    return ReadingsSoFar(state, setting_of(steps, machine))


def play(
    values: Sequence[float],
    steps: Sequence[SessionStep],
    machine: Machine | None = None,
    minutes: Sequence[float] | None = None,
    questions: int = 60,
    begin: int = 0,
) -> list[tuple[int, Question]]:
    """Take readings and keep each one: (step number, question) wherever one was asked.

    Stops after that many `questions`; those before number `begin` are taken without any.
    """
    state = replay([opened()])
    asked = []
    for index, step in enumerate(steps):
        value = float(values[index])
        now = 0.2 * index + 4.0 * (step.setup - 1) if minutes is None else float(minutes[index])
        coming = read_next(state, steps, index, now, value, machine) if index >= begin else None
        if coming is None or (question := check(coming, Unit.MM)) is None:
            state = advance(state, taken(step.number, value, now))
            continue
        asked.append((step.number, question))
        if len(asked) == questions:
            break
        doubtful = questioned(taken(step.number, value, now), *question)
        state = advance(advance(state, doubtful), Answered(at=AT, keep=True))
    return asked


class Script:
    """A keyboard that gives prepared lines, then ends."""

    live = False
    columns = 80
    partial = ""

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines: Iterator[str] = iter(lines)

    def read(self, timeout_s: float | None) -> Line | None:
        try:
            return Line(next(self._lines))
        except StopIteration:
            raise EOFError from None

    def disturbed(self) -> bool:
        return False


class Screen:
    """What was shown: all of it as one text, and each part with its style."""

    def __init__(self) -> None:
        self.text = ""
        self.shown: list[tuple[str, Style]] = []

    def __call__(self, text: str, style: Style = Style.PLAIN, end: str = "\n") -> None:
        self.text += text + end
        self.shown.append((text, style))


def a_clock() -> Callable[[], str]:
    """A clock that goes on by ten seconds at each look."""
    began, looks = datetime.fromisoformat(AT), itertools.count(1)
    return lambda: (began + next(looks) * timedelta(seconds=10)).isoformat(timespec="milliseconds")


def a_dialogue(
    path: Path,
    lines: Iterable[str],
    *,
    first: Opened | None = None,
    gauge: LiveGauge | None = None,
    show: Show | None = None,
    **wishes: Any,
) -> tuple[Dialogue, Screen, contextlib.ExitStack]:
    """A session in `path` (a journal; resumed if it exists) that is answered by these lines.

    The last is what closes its journal.
    """
    if not path.exists():
        Journal.create(path, first or opened())
    journal = Journal.resume(path, stack := contextlib.ExitStack())
    begun = journal.events[0]
    steps = begun.session.steps(PROTOTYPE)
    screen = Screen()
    asker = Asker(Script(lines), show or screen, gauge)
    file = path.with_suffix(".yaml")
    request = Request(**wishes)
    dialogue = Dialogue(file, journal, setting_of(steps), asker, request, now=a_clock())
    return dialogue, screen, stack


def answered(path: Path, lines: Iterable[str], **options: object) -> tuple[Dialogue, Screen]:
    """A dialogue that went on until the lines or the session ended, and what it showed."""
    dialogue, screen, stack = a_dialogue(path, lines, **options)  # type: ignore[arg-type]
    with stack, contextlib.suppress(EOFError, Quit):
        dialogue.run()
    return dialogue, screen


def values(dialogue: Dialogue) -> dict[int, float]:
    """Step number → reading that counts, from first to last [mm]."""
    return {number: item.take.value_mm for number, item in dialogue.state.accepted.items()}


def offsets(dialogue: Dialogue) -> np.ndarray:
    """The offsets that the readings so far give."""
    return dialogue.so_far.solution.offsets_mm


def without_times(text: str) -> str:
    """The text of a session file but for its times of day."""
    return re.sub(r"(minutes|timestamp|finished|started): [^,}\n]+", r"\1: -", text)


def state_of(events: Sequence[Event]) -> State:
    return replay([opened(), *events])
