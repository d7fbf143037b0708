"""`orthocal simulate`: synthetic sessions of any machine."""

from __future__ import annotations

import secrets
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from orthoglide_cal.cli.cause_option import effect_named
from orthoglide_cal.cli.common import MachineFile, NoColour, print_json, tell
from orthoglide_cal.errors import UsageError


class Protocol(StrEnum):
    """How the session is measured."""

    DOUBLE = "double"
    SINGLE = "single"


def simulate(
    protocol: Annotated[
        Protocol, typer.Option(help="Double-posture or single-posture (sec. 3.2, 3.3).")
    ] = Protocol.DOUBLE,
    offsets: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="DX DY DZ", help="True joint offsets, mm."),
    ] = (0.0, 0.0, 0.0),
    noise: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Standard deviation of a reading; the gauge's own if not given.",
            show_default=False,
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Smallest step of the gauge; 0: none; the gauge's own if not given.",
            show_default=False,
        ),
    ] = None,
    cycles: Annotated[int, typer.Option(min=1, max=1000, help="Repeats of the postures.")] = 3,
    gauge_at: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            help="Place of the gauges along the leg: 0 carriage joint, 1 tool (double only).",
        ),
    ] = 0.5,
    cause: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID[@PLACE]=VALUES",
            help="Something wrong, e.g. axis_gap=0.1,0.2,-0.1 or gauge_drift@x,y=0.05 (leg,"
            " direction) or misread@12=0.1 (twelfth reading); may be repeated.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="The same seed gives the same session.", show_default=False),
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write there instead of standard output: a session if it ends in .yaml, else a"
            " CSV; an existing file is not touched.",
            show_default=False,
        ),
    ] = None,
    machine: MachineFile = None,
    json: Annotated[
        bool, typer.Option("--json", help="The session as one JSON object instead of a CSV.")
    ] = False,
    no_colour: NoColour = False,
) -> None:
    """Make up a session: readings as a technician would write them down, as CSV."""
    from dataclasses import replace

    import numpy as np

    from orthoglide_cal.causes import machine_effects
    from orthoglide_cal.data import (
        read_machine,
        readings_csv,
        session_json,
        session_of_readings,
        write_session,
        write_text,
    )
    from orthoglide_cal.protocols import double_posture, single_posture, synthetic_session

    for name, size in (("--noise", noise), ("--resolution", resolution)):
        if size is not None and not 0.0 <= size < float("inf"):
            raise UsageError(f"{name} cannot be {size:g}.", "Give millimetres from 0.")
    chosen = secrets.randbelow(2**32) if seed is None else seed
    nominal = read_machine(machine)
    given = {"repeatability_mm": noise, "resolution_mm": resolution}
    gauge = replace(nominal.gauge, **{k: v for k, v in given.items() if v is not None})
    if protocol is Protocol.DOUBLE:
        plan = double_posture(nominal, cycles, gauge_at=gauge_at)
    else:
        plan = single_posture(nominal, cycles)
    rng = np.random.default_rng(chosen)
    wrong = [effect_named(text, plan, nominal, rng) for text in cause or ()]
    effects = (*machine_effects(nominal), *wrong)
    session = synthetic_session(nominal, plan, np.array(offsets), rng, effects, gauge)
    record = session_of_readings(session, nominal, {"source": f"simulated, seed {chosen}"})
    if target is not None:
        if target.suffix.lower() in (".yaml", ".yml"):
            write_session(record, target)
        else:
            write_text(target, readings_csv(session))
        tell(f"{len(session)} readings written to {target}")
    if json:
        print_json(session_json(record))
    elif target is None:
        print(readings_csv(session), end="")
    if seed is None:
        tell(f"seed {chosen}")
