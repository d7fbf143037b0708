"""`orthocal plan`: what a measurement will decide, before it is taken."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UsageError, command

if TYPE_CHECKING:
    from orthoglide_cal.planning import Next
    from orthoglide_cal.planning.steps import Order


class Protocol(StrEnum):
    """How the readings would be taken."""

    DOUBLE = "double"
    SINGLE = "single"
    BEST = "best"


def plan(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="FILE",
            help="Readings or a session: what to measure next beside them is ranked, too.",
            show_default=False,
        ),
    ] = None,
    protocol: Annotated[
        Protocol, typer.Option(help="Double-posture, single-posture, or the best design.")
    ] = Protocol.DOUBLE,
    gauges: Annotated[
        int, typer.Option(min=1, max=2, help="Gauges read side by side (single: always 1).")
    ] = 2,
    cycles: Annotated[
        int | None, common.option(min=1, max=50, help="Repeats of the postures on each leg (3).")
    ] = None,
    layout: Annotated[
        str | None,
        common.option(
            metavar="NAME", help="Of a printer: the layout to measure, as plan lists them."
        ),
    ] = None,
    target: Annotated[
        float | None,
        common.option(
            metavar="MM",
            help="How sure each offset is to be (95 %): as many cycles as that takes.",
        ),
    ] = None,
    program: Annotated[
        Path | None,
        common.option(
            metavar="FILE",
            help="Write the postures as a table (.csv) or as G-code (.nc) instead; - shows them.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        common.option(metavar="FILE", help="Of the G-code; orthocal template gcode prints one."),
    ] = None,
    order: Annotated[
        str | None,
        common.option(metavar="[paper|fewest-moves]", help="Of the program: that of measure."),
    ] = None,
    approach: Annotated[
        float | None,
        common.option(metavar="MM", help="Way over which carriages arrive slowly (1)."),
    ] = None,
    travel: Annotated[
        tuple[float, float] | None,
        common.option(
            metavar="LOW HIGH",
            help="How far carriages may go for it from the isotropic posture, mm; without it the"
            " joint limits of the machine file.",
        ),
    ] = None,
    data: common.Data = None,
    machine: common.MachineFile = None,
    html: common.HtmlFile = None,
    overwrite: common.Overwrite = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    no_colour: common.NoColour = False,
) -> None:
    """Say what readings will be worth, which causes they can tell apart, and what to read next."""
    from orthoglide_cal.cli.layouts import write_places
    from orthoglide_cal.cli.program import write_program
    from orthoglide_cal.model import Readings
    from orthoglide_cal.planning import ranked
    from orthoglide_cal.planning.bar import require_on_bar
    from orthoglide_cal.planning.layouts import layout_prospect
    from orthoglide_cal.planning.program import APPROACH_MM, posture_program
    from orthoglide_cal.planning.prospect import prospect
    from orthoglide_cal.planning.steps import (
        CYCLES,
        MeasuringProtocol,
        Order,
        sequence,
        sequence_options,
    )
    from orthoglide_cal.report.documents.layouts import layouts_document
    from orthoglide_cal.report.documents.plan import plan_document

    if target is not None and target <= 0.0:
        raise UsageError("--target must be greater than 0.", "Give millimetres, such as 0.02.")
    if target is not None and cycles is not None:
        raise UsageError("--target finds the number of cycles itself.", "Leave out --cycles.")
    if program is None and (template, order, approach, travel) != (None,) * 4:
        raise UsageError("These options are for a program.", "Name its file: --program FILE")
    if program is not None and (json or html is not None or overwrite):
        raise _alone()
    turn = Order.PAPER if order is None else _turn(order)
    following: tuple[Next, ...] = ()
    go_on = None
    if file is None:
        model = common.given_machine(machine) or common.folder_machine()
    else:
        from orthoglide_cal.diagnosis import diagnose

        given = common.read_input(file, machine, data)
        measured, model = given.measured, given.model
        if program is None:
            following = ranked(diagnose(measured, model))
    if model.kind.layouts(model.machine):
        beside = (cycles, target, template, order, approach, travel)
        if beside != (None,) * 6 or protocol is not Protocol.DOUBLE or gauges != 2:
            raise UsageError("A printer has no gauges and no protocol.", "Name a --layout instead.")
        laid = layout_prospect(model, layout)
        if program is not None:
            write_places(laid.chosen, program)
            return
        document = layouts_document(laid, file, machine, following)
        common.deliver(document, as_json=json, html=html, overwrite=overwrite)
        return
    if layout is not None:
        raise UsageError("--layout is for printers.", "Name a --protocol instead.")
    if program is not None and file is not None:
        raise _alone()
    if file not in (None, "-") and isinstance(measured, Readings) and measured.plan.fixed:
        go_on = command("measure --then", file, machine=machine)
    way = MeasuringProtocol[protocol.name]
    found = prospect(model, way, cycles or CYCLES, gauges, target)
    if program is not None:
        careful = require_on_bar(found.chosen.session.plan, model.machine)
        if careful is not None:
            common.tell(" ".join(careful))
        steps = sequence(model.machine, way, found.cycles, turn, gauges)
        length = APPROACH_MM if approach is None else approach
        told = sequence_options(way, found.cycles, turn, gauges)
        session = command("measure", machine=machine, options=told)
        write_program(posture_program(model, steps, session, length, travel), program, template)
        return
    document = plan_document(found, machine, following, go_on)
    common.deliver(document, as_json=json, html=html, overwrite=overwrite)


def _alone() -> UsageError:
    return UsageError(
        "--program writes the program of a protocol alone.",
        "Leave out --json, --html, --overwrite and FILE.",
    )


def _turn(order: str) -> Order:
    """The order of the steps by its name. Raises UsageError."""
    from orthoglide_cal.planning.steps import Order
    from orthoglide_cal.session import named

    return named(Order, "order", order) or Order.PAPER
