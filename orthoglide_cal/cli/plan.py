"""`orthocal plan`: what a measurement will tell, before it is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Number, Text, argument, option
from orthoglide_cal.errors import UsageError, command

if TYPE_CHECKING:
    from orthoglide_cal.model import Model
    from orthoglide_cal.planning.plan import Wanted


def plan(
    file: Annotated[
        Text, argument("FILE", f"{MEASURED}. With it, also rank what to measure next.")
    ] = None,
    protocol: common.Protocol = None,
    design: common.Design = None,
    gauges: common.Gauges = None,
    cycles: common.Cycles = None,
    layout: Annotated[
        Text, option("NAME", "Linear delta: name of the layout; plan lists them.")
    ] = None,
    target: Annotated[
        Number,
        option("MM", "U (95 %) to reach for each offset. Finds the number of cycles for it."),
    ] = None,
    program: Annotated[
        File,
        option(
            "FILE",
            "Write the posture program instead, as a table (.csv) or as G-code (.nc); - shows it.",
        ),
    ] = None,
    template: Annotated[
        File, option("FILE", "Template of the G-code. `orthocal template gcode` prints one.")
    ] = None,
    order: common.Order = None,
    approach: Annotated[
        Number, option("MM", "With --program: length of the slow approach. Default: 1.")
    ] = None,
    travel: Annotated[
        tuple[float, float] | None,
        option(
            "LOW HIGH",
            "With --program: limits of the carriages, mm from the isotropic posture. Default: the"
            " joint limits of the machine file.",
        ),
    ] = None,
    data: common.Data = None,
    machine: common.MachineFile = None,
    html: common.HtmlFile = None,
    details: common.WithDetails = False,
    overwrite: common.Overwrite = False,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Predict readings, minutes and U; rank what to measure next."""
    from orthoglide_cal.diagnosis import diagnose
    from orthoglide_cal.planning import ranked
    from orthoglide_cal.planning.plan import Wanted, measurement_plan
    from orthoglide_cal.report.documents.plan import plan_document
    from orthoglide_cal.results import answer_to

    if target is not None and target <= 0.0:
        raise UsageError("--target must be greater than 0.", "Give millimetres, such as 0.02.")
    if target is not None and cycles is not None:
        raise UsageError("--target finds the number of cycles itself.", "Leave out --cycles.")
    moves = (template, order, approach, travel)
    if program is None and moves != (None,) * 4:
        raise UsageError(
            "--template, --approach and --travel need --program.", "Name its file: --program FILE"
        )
    wanted = Wanted(
        common.measuring_protocol(protocol, design), cycles, gauges or 2, target, layout
    )
    given = None if file is None else common.read_input(file, machine, data)
    model = given.model if given else common.given_machine(machine) or common.folder_machine()
    if program is not None:
        if json or html or overwrite or (given and not model.machine.layouts()):
            raise UsageError(
                "--program writes nothing but the posture program.",
                "Leave out --json, --html, --overwrite and FILE.",
            )
        _write_program(model, wanted, machine, program, *moves)
        return
    diagnosis = diagnose(given.measured, model) if given else None
    found = measurement_plan(model, wanted, ranked(diagnosis) if diagnosis else ())
    begun = answer_to(given, diagnosed=diagnosis) if given else None
    source = given.measured.source if given else None
    document = plan_document(found, machine, begun, source)
    common.deliver(document, as_json=json, html=html, overwrite=overwrite, details=details)


def _write_program(
    model: Model,
    wanted: Wanted,
    machine: Path | None,
    program: Path,
    template: Path | None,
    order: str | None,
    approach: float | None,
    travel: tuple[float, float] | None,
) -> None:
    """Write the postures of a session, or the places of a layout."""
    from orthoglide_cal.cli.program import write_places, write_program
    from orthoglide_cal.planning.bar import require_on_bar
    from orthoglide_cal.planning.plan import chosen_session
    from orthoglide_cal.planning.program import APPROACH_MM, posture_program
    from orthoglide_cal.planning.steps import MeasuringProtocol, Order, sequence, sequence_options

    chosen = chosen_session(model, wanted)
    if model.machine.layouts():
        if (template, order, approach, travel) != (None,) * 4:
            raise UsageError(
                "A printer's places are written as a table.", "Leave these options out."
            )
        write_places(chosen, program)
        return
    careful = require_on_bar(chosen.plan, model.orthoglide)
    if careful is not None:
        common.tell(" ".join(careful.lines))
    turn = Order(order or "paper")
    session = (MeasuringProtocol(chosen.name), chosen.cycles, turn, wanted.stands)
    told = command("measure", machine=machine, options=sequence_options(*session))
    length = APPROACH_MM if approach is None else approach
    steps = sequence(model.orthoglide, *session)
    write_program(posture_program(model, steps, told, length, travel), program, template)
