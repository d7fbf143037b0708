"""`orthocal plan`: what a measurement will tell, before it is made; its program or places."""

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, Count, File, Number, Text, argument, option
from orthoglide_cal.errors import UsageError


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
    from orthoglide_cal.inference.diagnose import diagnose
    from orthoglide_cal.planning.next_measurement import rank_measurements
    from orthoglide_cal.planning.plan import chosen_session, measurement_plan
    from orthoglide_cal.planning.program import chosen_program
    from orthoglide_cal.planning.steps import GuidedSession, require_on_bar
    from orthoglide_cal.report.documents.plan import plan_document

    if target is not None and cycles is not None:
        raise UsageError("--target finds the number of cycles itself.", "Leave out --cycles.")
    if program is None and (template or order):
        raise UsageError("--template and --order need --program.", "Name its file: --program FILE")
    asked = common.asked_session(protocol, design, cycles, order, gauges)
    given = None if file is None else common.read_input(file, machine, data)
    model = given.model if given else common.usual_machine(machine)
    with common.working(file or "plan"):
        session = GuidedSession().changed(**asked) if asked else None
        chosen = chosen_session(model, session, target, layout)
    if program is not None:
        guided = chosen.session is not None  # no layout
        if json or html or overwrite or (given and guided):
            fault = "--program writes nothing but the posture program."
            raise UsageError(fault, "Leave out --json, --html, --overwrite and FILE.")
        text, count = chosen_program(chosen, program, template, machine)
        if guided and (careful := require_on_bar(chosen.plan, model.machine)):
            common.tell(str(careful))
        message = f"{count} places written to {program}: {chosen.what}. Fill in reading_mm, the"
        message += " height at which the probe triggers, bed mesh off."
        if guided:
            message = f"{count} blocks written to {program}. Try them first without gauges, slowly,"
            message += " a hand on the emergency stop."
        common.put(text, program, message)
        return
    full = details or json or html is not None
    with common.working(file or "plan"):
        diagnosis = diagnose(given.measured, model) if given else None
        ranked = rank_measurements(diagnosis) if diagnosis else ()
        planned = measurement_plan(chosen, target, ranked, full)
    begun = common.judged(given, diagnosed=diagnosis) if given else None
    document = plan_document(planned, machine, begun)
    common.deliver(document, as_json=json, html=html, overwrite=overwrite, details=details)
