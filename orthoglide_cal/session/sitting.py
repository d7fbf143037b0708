"""One sitting at a session: its journal, steps and gauge, ready to run."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from orthoglide_cal.causes import machine_effects
from orthoglide_cal.data import default_machine
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.session.desk import Desk, Keyboard, Show
from orthoglide_cal.session.events import Reopened
from orthoglide_cal.session.files import journal_path, new_session, resumed_session
from orthoglide_cal.session.gauges.port import GaugePair, PortSpec, SerialGauge
from orthoglide_cal.session.gauges.simulated import SimulatedGauge
from orthoglide_cal.session.gauges.source import Gauge
from orthoglide_cal.session.intake import Setting
from orthoglide_cal.session.journal import Journal
from orthoglide_cal.session.opening import (
    SIMULATED,
    TYPED,
    Wanted,
    machine_of,
    open_record,
    refuse_changes,
)
from orthoglide_cal.session.run import Run
from orthoglide_cal.session.state import replay
from orthoglide_cal.session.steps import sequence


@dataclass(frozen=True)
class Request:
    """What the operator asked for on the command line.

    Attributes:
        path: session file; None for the usual one.
        resume: go on with an unfinished session.
        wanted: what must not change between sittings.
        unit: "mm" or "in", of readings without a unit.
        until_mm: end once every offset is known this well.
        operator, temperature_c, gauges: for the session file.
    """

    path: Path | None
    resume: bool
    wanted: Wanted
    unit: str = "mm"
    until_mm: float | None = None
    operator: str = ""
    temperature_c: float | None = None
    gauges: tuple[dict[str, str], ...] = ()


@dataclass(eq=False)
class Sitting:
    """An open journal with everything that belongs to it.

    Attributes:
        path: the session file to be.
        journal: locked and open.
        setting: machine, steps and options.
        gauge: besides the keyboard; None if readings are typed.
        simulated: the same, if it is the virtual machine.
        source: where readings come from, as given to --gauge.
    """

    path: Path
    journal: Journal
    setting: Setting
    gauge: Gauge | None
    simulated: SimulatedGauge | None
    source: tuple[str, ...]

    def run(self, keyboard: Keyboard, show: Show, now: Callable[[], str]) -> Run:
        """The loop, ready to be started."""
        run = Run(self.journal, self.setting, Desk(keyboard, show, self.gauge), show, now)
        if run.state.source != self.source and run.state.ended is None:
            run.append(Reopened, source=list(self.source))
        return run

    def close(self) -> None:
        """Let go of the gauge and the journal."""
        if self.gauge is not None:
            self.gauge.close()
        self.journal.close()


def clock() -> str:
    """The time of day, ISO 8601 with the offset from UTC, to the millisecond."""
    return datetime.now().astimezone().isoformat(timespec="milliseconds")


def open_sitting(request: Request, folder: Path, now: Callable[[], str]) -> Sitting:
    """Begin a session, or go on with one.

    Args:
        request: from the command line.
        folder: where files without a name go.
        now: the clock.

    Raises:
        UsageError: the options do not go together or with the session; the file exists; another
            session has it.
        InputError: a file cannot be used.
        GaugeLost: the gauge cannot be reached.
    """
    lines = serial_lines(request.wanted.source)
    if request.resume:
        path = resumed_session(request.path, folder)
        journal = Journal.resume(journal_path(path))
    else:
        path = new_session(request.path, folder)
        machine = request.wanted.machine or default_machine()
        opened = open_record(
            request.wanted,
            now(),
            machine,
            secrets.randbelow(1_000_000),
            request.operator,
            request.temperature_c,
            list(request.gauges),
        )
        # A machine that cannot be used, or a gauge that is not there, leaves no file behind.
        machine_effects(machine)
        _reach(lines)
        journal = Journal.create(journal_path(path), opened)
    try:
        return _sitting(request, path, journal, lines)
    except BaseException:
        journal.close()
        raise


def _sitting(request: Request, path: Path, journal: Journal, lines: list[SerialGauge]) -> Sitting:
    state = replay(journal.recovered.events)
    opened = state.opened
    machine = machine_of(opened, str(journal.path))
    if request.resume:
        refuse_changes(opened, machine, request.wanted)
    steps = sequence(machine, opened.protocol, opened.cycles, opened.order, opened.stands)
    for event in journal.recovered.events:
        if not 1 <= getattr(event, "step", 1) <= len(steps):
            raise InputError(
                "The journal speaks of a step that this session does not have.",
                "Restore the file from a copy.",
                file=str(journal.path),
            )
    effects = machine_effects(machine)
    setting = Setting(machine, effects, steps, str(path), request.unit, request.until_mm)
    source = request.wanted.source or state.source
    simulated: SimulatedGauge | None = None
    gauge: Gauge | None = None
    if source == (SIMULATED,):
        gauge = simulated = SimulatedGauge(machine, steps, opened.seed or 0, effects)
    elif source != (TYPED,):
        lines = lines or serial_lines(source)
        _reach([line for line in lines if not line.is_open])
        gauge = lines[0] if len(lines) == 1 else GaugePair(lines)
    return Sitting(path, journal, setting, gauge, simulated, source)


def serial_lines(source: Sequence[str]) -> list[SerialGauge]:
    """The serial gauges that --gauge names, not opened yet; none if readings are typed.

    Raises:
        UsageError: an unknown format, no port, or names that do not go together.
    """
    if tuple(source) in ((), (TYPED,), (SIMULATED,)):
        return []
    if TYPED in source or SIMULATED in source or len(source) > 2:
        raise UsageError(
            f"These gauges do not go together: {', '.join(source)}.",
            "Give typed, simulated, or one or two of FORMAT:PORT.",
        )
    return [SerialGauge(PortSpec.parse(text)) for text in source]


def _reach(lines: Sequence[SerialGauge]) -> None:
    for line in lines:
        line.open()
