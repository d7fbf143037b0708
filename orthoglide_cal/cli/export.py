"""`orthocal export`: the offsets for the controller, unless they must not be used."""

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Text, Texts, argument, flag, option
from orthoglide_cal.errors import UnusableResultError, UsageError

if TYPE_CHECKING:
    from orthoglide_cal.files.input import Input
    from orthoglide_cal.inference import Diagnosis
    from orthoglide_cal.report.case import Case

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
    points: int = option(
        "N",
        "Points of the table along each edge of the workspace. Default: 7.",
        min=2,
        max=51,
        default=7,
    ),
    json: bool = common.JSON,
) -> None:
    """Print the new offsets for the controller, if released."""
    from orthoglide_cal.model.kinds import MACHINES
    from orthoglide_cal.model.workspace import compensation
    from orthoglide_cal.report import controller
    from orthoglide_cal.results import identify
    from orthoglide_cal.results.application import check_measured

    if json and format != "text":
        raise UsageError(f"--json does not go with --format {format}.", "Choose one of them.")

    def judge(path: str) -> None:
        given = common.read_input(path, machine, data, rule_out)
        known = given.model.machine
        if format not in ("text", *known.controller_formats):
            owner = next(kind for kind, of in MACHINES.items() if format in of.controller_formats)
            fault = f"--format {format} is for machines of kind {owner}; this one is of kind"
            remedy = f"Choose one of {', '.join(known.controller_formats)}, or text."
            raise UsageError(f"{fault} {known.kind}.", remedy)
        check_measured(given)
        case = released(given, machine, method, force, details=json)
        identity = identify([(case.source, given.model)], case.answer.method, machine)
        if format == "table":
            text = controller.as_table(compensation(given.model, points), case, identity)
        else:
            text = controller.exported(format, case, identity)
        text = common.json_line(case.data()) if json else text
        if case.answer.release.reasons:
            common.tell(f"FORCED: {' '.join(map(case.says, case.answer.release.reasons))}")
        title = f"{case.words.title} {identity.number}"
        common.put(text, target, f"{title} written to {target}")

    common.for_each([file], judge, as_json=json)


def released(
    given: "Input",
    machine: Path | None,
    method: str | None = None,
    force: bool | None = None,
    details: bool = False,
    corrects: Collection[str] = (),
    diagnosed: "Diagnosis | None" = None,
) -> "Case":
    """The offsets of an input, if they may be used or are forced to (None: cannot be forced).

    Raises UnusableResultError: they must not be used; with what to do instead.
    """
    from orthoglide_cal.report.case import Case
    from orthoglide_cal.results import answer_to

    with common.working(given.measured.source.path):
        answer = answer_to(given, method, diagnosed=diagnosed, details=details, corrects=corrects)
    case = Case(given, answer, machine)
    if not answer.parameters or not (answer.release.usable or force):
        remedies = [f"{step.content} {step.command or ''}".rstrip() for step in case.remedies()]
        if force is not None and answer.parameters:
            remedies.append("To export it anyway, marked as FORCED: --force")
        why = " ".join(map(case.says, answer.release.reasons))
        raise UnusableResultError(f"Do not use these {case.words.many}. {why}", "\n".join(remedies))
    return case
