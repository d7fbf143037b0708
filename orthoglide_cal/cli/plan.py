"""`orthocal plan`: what a measurement will decide, before it is taken."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UsageError, command

if TYPE_CHECKING:
    from orthoglide_cal.planning.prospect import Prospect


def plan(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="FILE",
            help=f"{common.MEASURED}: what to measure next beside it is ranked, too.",
            show_default=False,
        ),
    ] = None,
    protocol: common.ProtocolName = None,
    design: common.Design = None,
    gauges: Annotated[
        int, typer.Option(min=1, max=2, help="Gauges read side by side (single: always 1).")
    ] = 2,
    cycles: common.Cycles = None,
    layout: Annotated[
        str | None,
        common.option(metavar="NAME", help="Layout to measure on a printer, as plan lists them."),
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
        common.option(
            metavar="FILE", help="Template of the G-code; orthocal template gcode prints one."
        ),
    ] = None,
    order: Annotated[
        str | None,
        common.option(
            metavar="[paper|fewest-moves]", help="Order of the program's postures; that of measure."
        ),
    ] = None,
    approach: Annotated[
        float | None,
        common.option(
            metavar="MM", help="Way over which the program's carriages arrive slowly (1)."
        ),
    ] = None,
    travel: Annotated[
        tuple[float, float] | None,
        common.option(
            metavar="LOW HIGH",
            help="How far the program may drive carriages from the isotropic posture, mm; without"
            " it to the joint limits of the machine file.",
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
    from orthoglide_cal.diagnosis import diagnose
    from orthoglide_cal.planning import ranked
    from orthoglide_cal.planning.layouts import layout_prospect
    from orthoglide_cal.planning.prospect import prospect
    from orthoglide_cal.planning.steps import CYCLES, MeasuringProtocol
    from orthoglide_cal.report.documents.layouts import layouts_document
    from orthoglide_cal.report.documents.plan import plan_document
    from orthoglide_cal.results import calibrate

    if target is not None and target <= 0.0:
        raise UsageError("--target must be greater than 0.", "Give millimetres, such as 0.02.")
    if target is not None and cycles is not None:
        raise UsageError("--target finds the number of cycles itself.", "Leave out --cycles.")
    if program is None and (template, order, approach, travel) != (None,) * 4:
        raise UsageError("These options are for a program.", "Name its file: --program FILE")
    if program is not None and (json or html is not None or overwrite):
        raise _alone()
    way = common.measuring_protocol(protocol, design)
    given = None if file is None else common.read_input(file, machine, data)
    model = given.model if given else common.given_machine(machine) or common.folder_machine()
    diagnosis = diagnose(given.measured, model) if given and program is None else None
    following = () if diagnosis is None else ranked(diagnosis)
    if model.machine.layouts():
        beside = (way, cycles, target, template, order, approach, travel)
        if beside != (None,) * 7 or gauges != 2:
            raise UsageError("A printer has no gauges and no protocol.", "Name a --layout instead.")
        laid = layout_prospect(model, layout)
        if program is not None:
            from orthoglide_cal.cli.program import write_places

            write_places(laid.chosen, program)
            return
        source = given.measured.source if given else None
        document = layouts_document(laid, source, machine, following)
    else:
        if layout is not None:
            raise UsageError("--layout is for printers.", "Name a --protocol instead.")
        if program is not None and given is not None:
            raise _alone()
        way = way or MeasuringProtocol.DOUBLE
        found = prospect(model, way, cycles or CYCLES, gauges, target)
        if program is not None:
            _write_program(found, machine, program, template, order, approach, travel)
            return
        begun = calibrate(given, diagnosed=diagnosis) if given else None
        document = plan_document(found, machine, begun, following)
    common.deliver(document, as_json=json, html=html, overwrite=overwrite)


def _write_program(
    found: Prospect,
    machine: Path | None,
    program: Path,
    template: Path | None,
    order: str | None,
    approach: float | None,
    travel: tuple[float, float] | None,
) -> None:
    """Write the postures of a session."""
    from orthoglide_cal.cli.program import write_program
    from orthoglide_cal.planning.bar import require_on_bar
    from orthoglide_cal.planning.program import APPROACH_MM, posture_program
    from orthoglide_cal.planning.steps import Order, sequence, sequence_options

    careful = require_on_bar(found.chosen.session.plan, found.model.machine)
    if careful is not None:
        common.tell(" ".join(careful.lines))
    turn = common.named(Order, "order", order) or Order.PAPER
    session = (found.protocol, found.cycles, turn, found.stands)
    told = command("measure", machine=machine, options=sequence_options(*session))
    length = APPROACH_MM if approach is None else approach
    steps = sequence(found.model.machine, *session)
    write_program(posture_program(found.model, steps, told, length, travel), program, template)


def _alone() -> UsageError:
    return UsageError(
        "--program writes the program of a protocol alone.",
        "Leave out --json, --html, --overwrite and FILE.",
    )
