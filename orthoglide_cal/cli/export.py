"""`orthocal export`: the offsets for the controller, unless they must not be used."""

from typing import Literal

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Text, Texts, argument, flag, option
from orthoglide_cal.errors import UsageError

Format = Literal["text", "linuxcnc", "table", "klipper", "reprapfirmware", "marlin"]


def export(
    file: str = argument("FILE", f"{MEASURED}; - is standard input.", required=True),
    format: Format = option(
        None,
        "text (default); linuxcnc: lines of its INI; table: joint corrections over the"
        " workspace, for accepted causes; klipper, reprapfirmware, marlin: lines for a"
        " printer's firmware.",
        default="text",
    ),
    target: File = common.OUTPUT,
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    rule_out: Texts = common.RULE_OUT,
    method: Text = common.METHOD,
    force: bool = flag("--force", "Export a result that must not be used, marked as FORCED."),
    json: bool = common.JSON,
) -> None:
    """Print the new offsets for the controller, if released."""
    from orthoglide_cal.model.kinds import MACHINES
    from orthoglide_cal.model.workspace import compensation
    from orthoglide_cal.report import controller
    from orthoglide_cal.results.answer import identify
    from orthoglide_cal.results.application import check_measured

    if json and format != "text":
        raise UsageError(f"--json does not go with --format {format}.", "Choose one of them.")
    given = common.read_input(file, machine, data, rule_out)
    known = given.model.machine
    if format not in ("text", *known.controller_formats):
        owner = next(kind for kind, of in MACHINES.items() if format in of.controller_formats)
        fault = f"--format {format} is for machines of kind {owner}; this one is of kind"
        remedy = f"Choose one of {', '.join(known.controller_formats)}, or text."
        raise UsageError(f"{fault} {known.kind}.", remedy)
    check_measured(given)
    case = common.judged(given, method=method, details=json)
    case.require_usable(force)
    identity = identify([given], case.answer.method, machine)
    if format == "table":
        text = controller.as_table(compensation(given.model), case)
    else:
        text = controller.exported(format, case, identity)
    text = common.json_line(case.data()) if json else text
    if case.answer.release.reasons:
        common.tell(f"FORCED: {' '.join(map(case.says, case.answer.release.reasons))}")
    title = f"{case.words.title} {identity.number}"
    common.put(text, target, f"{title} written to {target}")
