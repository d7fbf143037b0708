"""`orthocal export`: the offsets for the controller, unless they must not be used."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, argument, flag, option
from orthoglide_cal.errors import UnusableResultError, UsageError

if TYPE_CHECKING:
    from orthoglide_cal.report.controller import Export

Format = Literal["text", "linuxcnc", "table", "klipper", "reprapfirmware", "marlin"]


def export(
    file: Annotated[str, argument("FILE", f"{MEASURED}; - is standard input.")],
    format: Annotated[
        Format,
        option(
            None,
            "table: joint corrections over the workspace, for causes that were accepted; klipper,"
            " reprapfirmware, marlin: the lines of a printer's firmware; without it text.",
        ),
    ] = "text",
    target: common.Target = None,
    machine: common.MachineFile = None,
    data: common.Data = None,
    method: common.MethodName = None,
    force: Annotated[
        bool, flag("--force", "Export what must not be used; it is marked as forced.")
    ] = False,
    points: Annotated[int, option("N", "Points of the table along each edge of the cube (7).")] = 7,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Write the new offsets for the controller, if they may be used."""
    from orthoglide_cal.files import write_text
    from orthoglide_cal.model.workspace import compensation
    from orthoglide_cal.report import controller
    from orthoglide_cal.report.firmware import FIRMWARES, as_firmware

    if json and format != "text":
        raise UsageError(f"--json does not go with --format {format}.", "Choose one of them.")

    def judge(path: str) -> None:
        found = released(path, machine, method, force, data=data, format=format, details=json)
        case = found.case
        if format == "table":
            text = controller.as_table(compensation(case.given.model, points), found)
        elif format in FIRMWARES:
            text = as_firmware(format, found)
        elif format == "linuxcnc":
            text = controller.as_linuxcnc(found)
        else:
            text = f"{case.answer.model_dump_json()}\n" if json else controller.as_text(found)
        if found.forced:
            common.tell(f"FORCED: {' '.join(found.forced)}")
        if target is None:
            print(text, end="")
        else:
            write_text(target, text)
            common.tell(f"{case.words.title} {found.identity.number} written to {target}")

    common.for_each([file], judge, as_json=json)


def released(
    path: str,
    machine: Path | None,
    method: str | None = None,
    force: bool | None = None,
    data: common.Stored | None = None,
    format: Format = "text",
    details: bool = False,
) -> Export:
    """The offsets of an input, if they may be used or are forced to (None: cannot be forced).

    Raises:
        UsageError: the format is of another kind of machine.
        UnusableResultError: they must not be used; with what to do instead.
    """
    from orthoglide_cal.model.machines import MACHINES
    from orthoglide_cal.report.case import Case
    from orthoglide_cal.report.controller import Export
    from orthoglide_cal.results import answer_to, identify

    given = common.read_input(path, machine, data)
    known = given.model.machine
    others = {each: kind for kind, other in MACHINES.items() for each in other.controller_formats}
    if format in others and format not in known.controller_formats:
        raise UsageError(
            f"--format {format} is for the controller of kind {others[format]}; this machine is of"
            f" kind {known.kind}.",
            f"Choose one of {', '.join(known.controller_formats)}, or text.",
        )
    answer = answer_to(given, method, details=details)
    case = Case(given, answer, machine)
    if not answer.parameters or not (answer.release.usable or force):
        remedies = [*case.remedy_lines()]
        if force is not None and answer.parameters:
            remedies.append("To export all the same, marked as forced: --force")
        raise UnusableResultError(
            f"Export refused. {' '.join(answer.release.reasons)}", "\n".join(remedies)
        )
    return Export(case, identify([(given.measured.source, given.model)], answer.method))
