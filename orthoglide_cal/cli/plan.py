"""`orthocal plan`: what a measurement will tell, before it is made; its program or places."""

from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, Count, File, Number, Text, argument, option
from orthoglide_cal.errors import UsageError, command

if TYPE_CHECKING:
    from orthoglide_cal.planning.program import PostureProgram

_GCODE = (".nc", ".ngc", ".gcode", ".tap", ".cnc")
_CSV = ".csv"


def plan(
    file: Text = argument("FILE", f"{MEASURED}. With it, also rank what to measure next."),
    protocol: common.Protocol = common.PROTOCOL,
    design: common.Design = common.DESIGN,
    gauges: Count = common.GAUGES,
    cycles: Count = common.CYCLES,
    layout: Text = option("NAME", "Linear delta: name of the layout; plan lists them."),
    target: Number = option(
        "MM", "U (95 %) to reach for each offset. Finds the number of cycles for it.", min=1e-4
    ),
    program: File = option(
        "FILE",
        "Write the posture program instead, as a table (.csv) or as G-code (.nc); - shows it.",
    ),
    template: File = option(
        "FILE", "Template of the G-code. `orthocal template gcode` prints one."
    ),
    order: common.Order = common.ORDER,
    data: common.Data = common.DATA,
    machine: File = common.MACHINE,
    html: File = common.HTML,
    details: bool = common.DETAILS,
    overwrite: bool = common.OVERWRITE,
    json: bool = common.JSON,
) -> None:
    """Predict readings, minutes and U; rank what to measure next."""
    from orthoglide_cal.files.readings import places_csv
    from orthoglide_cal.inference import diagnose
    from orthoglide_cal.planning.plan import chosen_session, measurement_plan, rank_measurements
    from orthoglide_cal.planning.program import posture_program
    from orthoglide_cal.planning.steps import GuidedSession, require_on_bar
    from orthoglide_cal.report.documents.plan import plan_document

    if target is not None and cycles is not None:
        raise UsageError("--target finds the number of cycles itself.", "Leave out --cycles.")
    if program is None and (template or order):
        raise UsageError("--template and --order need --program.", "Name its file: --program FILE")
    asked = common.asked_session(protocol, design, cycles, order, gauges)
    given = None if file is None else common.read_input(file, machine, data)
    model = given.model if given else common.usual_machine(machine)
    with common.working(file or "A plan"):
        session = GuidedSession().changed(**asked) if asked else None
        chosen = chosen_session(model, session, target, layout)
    if program is not None:
        guided = (session := chosen.session) is not None  # no layout
        if json or html or overwrite or (given and guided):
            fault = "--program writes nothing but the posture program."
            raise UsageError(fault, "Leave out --json, --html, --overwrite and FILE.")
        ends = (_CSV, *_GCODE) if guided else (_CSV,)
        if str(program) != "-" and program.suffix.lower() not in ends:
            remedy = f"End it in {_CSV} for a table{f', in {_GCODE[0]} for G-code' * guided}."
            raise UsageError(f"The name {program} does not say what to write.", remedy)
        if session is None:
            if template:
                fault = "A printer's places are written as a table."
                raise UsageError(fault, "Leave out --template.")
            message = f"{len(chosen.plan)} places written to {program}: {chosen.what}. Fill in"
            message += " reading_mm, the height at which the probe triggers, bed mesh off."
            common.put(places_csv(chosen.plan), program, message)
            return
        careful = require_on_bar(chosen.plan, model.machine)
        if careful is not None:
            common.tell(str(careful))
        typed = command("measure", machine=machine, options=session.options)
        steps = session.steps(model.machine)
        write_program(posture_program(model, steps, typed), program, template)
        return
    full = details or json or html is not None
    with common.working(file or "A plan"):
        diagnosis = diagnose(given.measured, model) if given else None
        ranked = rank_measurements(diagnosis) if diagnosis else ()
        planned = measurement_plan(chosen, target, ranked, full)
    begun = common.judged(given, diagnosed=diagnosis) if given else None
    document = plan_document(planned, machine, begun)
    common.deliver(document, as_json=json, html=html, overwrite=overwrite, details=details)


def write_program(program: "PostureProgram", target: Path, template: Path | None) -> None:
    """Write a posture program as CSV or G-code, by the end of the name; "-" shows its table.

    Raises UsageError: a template without G-code. None is that of `orthocal template gcode`.
    """
    from importlib.resources import files

    from orthoglide_cal.files.text import read_document
    from orthoglide_cal.planning.program import program_csv, program_gcode

    if target.suffix.lower() in _GCODE:
        path = template or files("orthoglide_cal.files") / "templates" / "gcode.nc"
        text = program_gcode(program, read_document(str(path)))
    elif template is None:
        text = program_csv(program)
    else:
        raise UsageError("--template is for G-code.", f"Name a file that ends in {_GCODE[0]}.")
    advice = "Try them first without gauges, slowly, a hand on the emergency stop."
    common.put(text, target, f"{len(program.blocks)} blocks written to {target}. {advice}")
