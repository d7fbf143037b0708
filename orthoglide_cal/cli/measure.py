"""`orthocal measure`: a guided session, from the first set-up to the offsets."""

from __future__ import annotations

import errno
import math
import shlex
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from orthoglide_cal.cli.common import (
    MachineFile,
    NoColour,
    leave_closed_pipe,
    messages,
    output,
    print_json,
    read_input,
    tell,
)
from orthoglide_cal.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from orthoglide_cal.session import Run, Show, Sitting

INTERRUPTED = 130
_STYLES = {
    "title": "bold",
    "dim": "dim",
    "good": "green",
    "bad": "bold red",
    "question": "bold yellow",
    "prompt": "bold cyan",
}


class Order(StrEnum):
    """Order of the steps."""

    PAPER = "paper"
    FEWEST = "fewest-moves"


class Unit(StrEnum):
    """Unit of readings that come without one."""

    MM = "mm"
    IN = "in"


def measure(
    session: Annotated[
        Path | None,
        typer.Argument(
            metavar="SESSION.yaml",
            help="Session file to write; without it session.yaml, or the next free name.",
            show_default=False,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with an unfinished session at its next reading."),
    ] = False,
    protocol: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="double (posture, the default) or single.", show_default=False
        ),
    ] = None,
    cycles: Annotated[
        int | None,
        typer.Option(
            min=1, max=50, help="Repeats of the postures on each leg (3).", show_default=False
        ),
    ] = None,
    order: Annotated[
        Order | None,
        typer.Option(help="The paper's order (default) or fewer gauge moves.", show_default=False),
    ] = None,
    gauges: Annotated[
        int | None,
        typer.Option(
            min=1, max=2, help="Gauges read side by side (2; single: 1).", show_default=False
        ),
    ] = None,
    gauge: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOURCE",
            help="typed (also keyboard-wedge gauges), simulated, or FORMAT:PORT[@BAUD][#CHANNELS],"
            " e.g. sylvac:/dev/ttyUSB0; twice for two ports. Formats: cdi, mahr, mitutoyo, mux,"
            " plain, sylvac, uwave.",
            show_default=False,
        ),
    ] = None,
    unit: Annotated[Unit, typer.Option(help="Unit of readings without one.")] = Unit.MM,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="End as soon as every offset is known within this (95 %).",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Of the simulated gauge's hidden machine.", show_default=False),
    ] = None,
    operator: Annotated[str, typer.Option(help="Your name.", show_default=False)] = "",
    temperature: Annotated[
        float | None, typer.Option(metavar="C", help="Of the room.", show_default=False)
    ] = None,
    gauge_id: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="Of the gauge; again for the second.", show_default=False),
    ] = None,
    certificate: Annotated[
        list[str] | None,
        typer.Option(metavar="NO", help="Of its calibration; again for the second."),
    ] = None,
    machine: MachineFile = None,
    json: Annotated[
        bool, typer.Option("--json", help="At the end, the result as one JSON object.")
    ] = False,
    no_colour: NoColour = False,
) -> None:
    """Measure, guided step by step; every reading is saved at once and checked as it comes."""
    from orthoglide_cal.data import read_machine
    from orthoglide_cal.session import Request, Wanted, clock, open_sitting, protocol_name

    for name, given in (("--until", until), ("--temperature", temperature)):
        if given is not None and not math.isfinite(given):
            raise UsageError(f"{name} cannot be {given}.", "Give a plain number.")
    if until is not None and until <= 0.0:
        raise UsageError("--until must be greater than 0.", "Give millimetres, such as 0.02.")
    identities = _identities(gauge_id or [], certificate or [])
    wanted = Wanted(
        machine=read_machine(machine) if machine else None,
        protocol=protocol_name(protocol),
        cycles=cycles,
        order=order,
        stands=gauges,
        source=tuple(gauge or ()),
        seed=seed,
    )
    request = Request(
        path=session,
        resume=resume,
        wanted=wanted,
        unit=unit,
        until_mm=until,
        operator=operator,
        temperature_c=temperature,
        gauges=identities,
    )
    sitting = open_sitting(request, Path(), clock)
    try:
        show = _show_on(messages() if json else output())
        with _saved_when_interrupted(sitting.path):
            run = _lead(sitting, show)
            _finish(sitting, run, show, as_json=json)
    finally:
        sitting.close()


def _lead(sitting: Sitting, show: Show) -> Run:
    """Run the session to its end."""
    from orthoglide_cal.cli.keyboard import Keyboard
    from orthoglide_cal.session import clock

    with Keyboard(answers_itself=sitting.simulated is not None) as keyboard:
        run = sitting.run(keyboard, show, clock)
        run.greet(sitting.journal.recovered.lost)
        run.run()
    return run


def _finish(sitting: Sitting, run: Run, show: Show, *, as_json: bool) -> None:
    """Write the session file, then show what `solve` makes of it and what to do next."""
    from orthoglide_cal import estimation
    from orthoglide_cal.causes import machine_effects
    from orthoglide_cal.report.solve_json import as_json as json_of
    from orthoglide_cal.report.solve_text import render
    from orthoglide_cal.session import guide, publish

    publish(run.record(), sitting.path)
    for line in guide.closing(run.state, str(sitting.path)):
        show(line, "good")
    measured, judged_by = read_input(str(sitting.path), None)
    solution = estimation.solve(measured, judged_by, effects=machine_effects(judged_by))
    if as_json:
        print_json(json_of(solution))
    else:
        output().print(render(solution, judged_by))
    if sitting.simulated is not None:
        for line in guide.truth(solution, sitting.simulated.offsets_mm):
            show(line)
    show("Next, ask whether the model is right for this machine:")
    show(f"  orthocal diagnose {shlex.quote(str(sitting.path))}", "title")


@contextmanager
def _saved_when_interrupted(path: Path) -> Iterator[None]:
    """Whatever interrupts a session, it ends with exit code 130 and how to go on."""
    from orthoglide_cal.session import Quit

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    caught = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, interrupt) for number in caught}
    try:
        yield
    except (Quit, EOFError, KeyboardInterrupt, BrokenPipeError) as reason:
        said = "Saved." if isinstance(reason, Quit) else "\nInterrupted; everything is saved."
        _leave(f"{said} Go on with: orthocal measure {shlex.quote(str(path))} --resume")
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        _leave("")  # the terminal was closed
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(message: str) -> NoReturn:
    try:
        if message:
            tell(message)
        sys.stdout.flush()
    except OSError:
        # Nobody is there to read it; keep Python from complaining about that at its end.
        leave_closed_pipe()
    raise typer.Exit(INTERRUPTED)


def _show_on(console: Console) -> Show:
    def show(text: str, style: str = "", end: str = "\n") -> None:
        console.print(text, style=_STYLES.get(style, ""), end=end, soft_wrap=True)
        console.file.flush()

    return show


def _identities(ids: Sequence[str], certificates: Sequence[str]) -> tuple[dict[str, str], ...]:
    """One {"id", "certificate"} per gauge that has an id."""
    if len(certificates) > len(ids):
        raise UsageError(
            "There are more --certificate than --gauge-id.", "Give the gauge's id with it."
        )
    padded = [*certificates, *[""] * (len(ids) - len(certificates))]
    return tuple(
        {"id": name, "certificate": number} for name, number in zip(ids, padded, strict=True)
    )
