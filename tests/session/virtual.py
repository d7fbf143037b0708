"""A virtual technician for the tests: readings of a whole session, blunders, scripted answers."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from orthoglide_cal.data import default_machine, machine_text
from orthoglide_cal.machine import Machine
from orthoglide_cal.session.checks import check_reading
from orthoglide_cal.session.desk import Desk
from orthoglide_cal.session.doubts import Question
from orthoglide_cal.session.entry import check_entry
from orthoglide_cal.session.events import Answered, Event, Opened, Questioned, Taken
from orthoglide_cal.session.gauges.simulated import SimulatedGauge
from orthoglide_cal.session.gauges.source import Gauge
from orthoglide_cal.session.history import history
from orthoglide_cal.session.intake import Setting
from orthoglide_cal.session.journal import Journal
from orthoglide_cal.session.run import Run
from orthoglide_cal.session.state import State, advance, replay
from orthoglide_cal.session.steps import Step, sequence

AT = "2025-03-01T09:00:00.000+01:00"


def stands(protocol: str) -> int:
    """Gauges side by side, as usual."""
    return 1 if protocol == "single-posture" else 2


def steps_of(protocol: str = "double-posture", cycles: int = 3) -> tuple[Step, ...]:
    """The usual steps on the prototype."""
    return sequence(default_machine(), protocol, cycles, "paper", stands(protocol))


def opened(protocol: str = "double-posture", cycles: int = 3, **other: object) -> Opened:
    """A first record."""
    values: dict[str, object] = {
        "at": AT,
        "version": 1,
        "machine": machine_text(default_machine()),
        "protocol": protocol,
        "cycles": cycles,
        "order": "paper",
        "stands": stands(protocol),
        "source": ["typed"],
        "seed": None,
        "operator": "",
        "temperature_c": None,
        "gauges": [],
    }
    return Opened(**{**values, **other})  # type: ignore[arg-type]


def readings_of(
    steps: Sequence[Step], seed: int = 1, machine: Machine | None = None
) -> list[float]:
    """What healthy gauges show at these steps [mm]."""
    gauge = SimulatedGauge(machine or default_machine(), steps, seed)
    values = []
    for step in steps:
        gauge.begin(step, 0)
        gauge.request()
        values.append(gauge.poll()[0].token.value or 0.0)
    return values


def taken(step: int, value: float, minutes: float = 0.0) -> Taken:
    """An accepted reading."""
    return Taken(AT, step, minutes, value, f"{value}", "typed")


def play(
    values: Sequence[float],
    steps: Sequence[Step],
    machine: Machine | None = None,
    minutes: Sequence[float] | None = None,
    protocol: str = "double-posture",
    questions: int = 60,
) -> list[tuple[int, Question]]:
    """Take readings and keep each one: (step number, question) wherever one was asked.

    Stops after that many `questions`.
    """
    nominal = machine or default_machine()
    state = replay([opened(protocol)])
    asked = []
    for index, step in enumerate(steps):
        value = float(values[index])
        now = 0.2 * index + 4.0 * (step.setup - 1) if minutes is None else float(minutes[index])
        past = history(state, steps, nominal, step, now)
        question = check_reading(past, value, nominal.gauge) or check_entry(
            state, past, value, nominal.gauge, inches=False
        )
        if question is None:
            state = advance(state, taken(step.number, value, now))
            continue
        asked.append((step.number, question))
        if len(asked) == questions:
            break
        state = advance(
            state,
            Questioned(
                AT, step.number, now, value, "", "typed", "",
                question.doubt, question.text, question.about,
            ),
        )  # fmt: skip
        state = advance(state, Answered(AT, keep=True))
    return asked


class Script:
    """A keyboard that gives prepared lines, then ends."""

    live = False

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines: Iterator[str] = iter(lines)

    def read(self, timeout_s: float | None) -> str | None:
        """The next line."""
        try:
            return next(self._lines)
        except StopIteration:
            raise EOFError from None

    def flush(self) -> None:
        """Nothing to forget."""


class Screen:
    """What was shown."""

    def __init__(self) -> None:
        self.text = ""

    def __call__(self, text: str, style: str = "", end: str = "\n") -> None:
        self.text += text + end


def a_clock(step_s: float = 10.0) -> Callable[[], str]:
    """A clock that goes on by `step_s` at each look."""
    from datetime import datetime, timedelta

    now = datetime.fromisoformat(AT)

    def look() -> str:
        nonlocal now
        now += timedelta(seconds=step_s)
        return now.isoformat(timespec="milliseconds")

    return look


def a_run(
    path: Path,
    lines: Iterable[str],
    *,
    first: Opened | None = None,
    gauge: Gauge | None = None,
    unit: str = "mm",
    until: float | None = None,
) -> tuple[Run, Screen, Journal]:
    """A session in `path` (a journal; resumed if it exists) that is answered by these lines."""
    journal = Journal.resume(path) if path.exists() else Journal.create(path, first or opened())
    begun = journal.recovered.events[0]
    assert isinstance(begun, Opened)
    machine = default_machine()
    steps = sequence(machine, begun.protocol, begun.cycles, begun.order, begun.stands)
    setting = Setting(machine, (), steps, "session.yaml", unit, until)
    screen = Screen()
    run = Run(journal, setting, Desk(Script(lines), screen, gauge), screen, a_clock())
    return run, screen, journal


def state_of(events: Sequence[Event]) -> State:
    """The state after a list of records."""
    return replay(events)
