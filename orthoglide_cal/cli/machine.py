"""`orthocal machine`: a machine file made by question and answer, and shown."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Number, Text, Texts, argument, flag, option
from orthoglide_cal.errors import InputError, UsageError, command
from orthoglide_cal.schema import MACHINE_FILE, parse_number

if TYPE_CHECKING:
    from pydantic import BaseModel

    from orthoglide_cal.files.machine_file import StoredMachine

Answers = dict[str, Any]  # dotted key of the file → its value: a name, a number, or several
_BACK = "<"

machine = typer.Typer(
    help="Make a machine file, or show one.", rich_markup_mode=None, add_completion=False
)


@machine.command(cls=common.PlainCommand)
def new(
    target: Path = option(
        "FILE",
        f"File to write. Default: {MACHINE_FILE}. An existing file is never overwritten.",
        "--output",
        "-o",
        default=Path(MACHINE_FILE),
    ),
    kind: str = option(
        "KIND", "Kind of machine: orthoglide (default) or linear_delta.", default="orthoglide"
    ),
    name: Text = option("NAME", "Name of the machine."),
    leg_length: Number = option(
        "MM", "Length of a leg (or of a printer's arm) between its joint centres."
    ),
    width: Number = option("MM", "Distance between the two bars of a leg."),
    tool_offset: Number = option("MM", "Distance from the ends of the legs to the tool point."),
    limits: tuple[float, float] | None = option(
        "LOW HIGH", "Travel from the isotropic posture, mm."
    ),
    workspace: Number = option("MM", "Edge of the cube in which errors are shown."),
    resolution: Number = option("MM", "One division of the gauge."),
    range_: Number = option("MM", "Travel of the gauge's plunger.", "--range"),
    revolution: Number = option("MM", "One turn of the gauge's dial; 0 if it has no dial."),
    repeatability: Number = option("MM", "Standard deviation of one reading."),
    radius: Number = option("MM", "Linear delta: delta radius."),
    bed_radius: Number = option("MM", "Linear delta: radius of the bed."),
    endstop: Number = option("MM", "Linear delta: height of the three endstops."),
    tolerance: Texts = option(
        "CAUSE=SIZE",
        "Plausible size of a cause, such as axis_gap=0.3; 0 rules it out. May be repeated.",
    ),
    practice: bool = flag(
        "--practice", "To practise: simulated readings may be recorded in this file."
    ),
    yes: bool = flag("--yes", "Ask nothing: take the prototype's values for what is not given."),
    json: bool = common.JSON,
) -> None:
    """Make a machine file. It asks for what no option gives."""
    from orthoglide_cal.files.text import write_text
    from orthoglide_cal.model.kinds import MACHINES

    # Each option with the keys that it gives, on machines of this or that kind.
    given: dict[str, tuple[object, *tuple[str, ...]]] = {
        "--name": (name, "name"),
        "--leg-length": (leg_length, "leg_length_mm", "arm_length_mm"),
        "--width": (width, "parallelogram_width_mm"),
        "--tool-offset": (tool_offset, "tool_offset_mm"),
        "--limits": (list(limits) if limits else None, "joint_limits_mm"),
        "--workspace": (workspace, "workspace_mm"),
        "--resolution": (resolution, "gauge.resolution_mm", "probe.resolution_mm"),
        "--range": (range_, "gauge.range_mm"),
        "--revolution": (revolution, "gauge.revolution_mm"),
        "--repeatability": (repeatability, "gauge.repeatability_mm", "probe.repeatability_mm"),
        "--radius": (radius, "delta_radius_mm"),
        "--bed-radius": (bed_radius, "bed_radius_mm"),
        "--endstop": (endstop, "endstops_mm"),
    }
    answers: Answers = {"kind": kind}
    asked = dict(_questions(MACHINES.get(kind, MACHINES["orthoglide"])))
    for typed, (value, *keys) in given.items():
        known = [key for key in keys if key in asked]
        if value is not None and not known:
            fault = f"{typed} is not for a machine of kind {kind}."
            raise UsageError(fault, "Leave it out; --help lists what there is.")
        answers |= {} if value is None else {known[0]: value}
    for text in tolerance or ():
        cause, _, size = text.partition("=")
        try:
            answers[f"tolerances.{cause}"] = parse_number(size, decimal_comma=True)
        except InputError as error:
            fault = f"--tolerance {text}: {error.what}"
            raise UsageError(fault, "Write it as axis_gap=0.3") from error
    if practice:
        answers["practice"] = True
    common.agreement(yes, "`machine new` asks for what is not given.")
    if target.exists():
        raise UsageError(f"{target} exists and is not overwritten.", "Name another: --output FILE")
    try:
        _made(answers, target)
    except InputError as error:
        # What follows from a wrong value is no fault of its own.
        faults = [fault for fault in error.problems if fault.column in answers] or error.problems
        raise UsageError("\n".join(fault.alone for fault in faults)) from error
    if not yes:
        common.tell(
            "Return takes the value in brackets. It is the prototype's, scaled where that fits.\n"
            f"{_BACK} goes back one question."
        )
        keys, place = [key for key in asked if key not in answers], 0
        while place < len(keys):
            step = 1 if _ask(answers, keys[place], asked[keys[place]], target) else -1
            place = max(place + step, 0)
    text = _made(answers, target).document.text
    if str(target) == "-":
        common.put(text)
        return
    write_text(target, text)
    show(target, json)
    from orthoglide_cal.files.input import machine_in_folder
    from orthoglide_cal.report.sentences import sentence

    stored = common.usual_machine(target).machine
    for doubt in stored.instrument.implausible().values():
        common.tell(sentence(doubt))
    common.tell(
        f"Written to {target}, with the usual size of each error (tolerances). Check its values."
    )
    of = MACHINES[kind]
    following = command((of.practice_steps if practice else of.first_steps)[0][1])
    try:
        machine_in_folder(target.parent)
    except UsageError as several:
        common.tell(str(several))
    else:
        folder = "this" if target.parent == Path() else "its"
        common.tell(f"In {folder} folder every command uses it. Next: {following}")


@machine.command(cls=common.PlainCommand)
def show(
    file: File = argument("FILE", "Machine file. Default: the one in this folder."),
    json: bool = common.JSON,
) -> None:
    """Show a machine: its numbers, active offsets and accepted causes."""
    from orthoglide_cal.report.documents.short import machine_document

    chosen = common.chosen_machine(file)
    if chosen is None:
        fault = "There is no machine file in this folder."
        raise UsageError(fault, "Name one, or make one: orthocal machine new")
    common.deliver(machine_document(chosen.model), as_json=json)


def _questions(schema: "type[BaseModel]", group: str = "") -> Iterator[tuple[str, str]]:
    """Keys, and the questions of their fields (`ask`)."""
    for name, field in schema.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and hasattr(inner, "model_fields"):
            yield from _questions(inner, f"{name}.")
        elif field.title:
            yield group + name, field.title


def _ask(answers: Answers, key: str, question: str, target: Path) -> bool:
    """Ask until the answer makes a machine; it joins the others. False: go back one question.

    An implausible value is taken when it is given again.
    """
    usual = answers[key] if key in answers else _usual(key, answers)
    several, doubted = isinstance(usual, list), None
    texts = [usual] if key == "name" else [f"{n:.12g}" for n in (usual if several else [usual])]
    while True:
        typed = typer.prompt(question, default=" ".join(texts), type=str, err=True)
        if typed.strip() == _BACK:
            return False
        try:
            value: object = typed
            if key != "name":
                parts = typed.replace("mm", " ").split()
                numbers = [parse_number(part, decimal_comma=True) for part in parts]
                if len(numbers) != len(texts):
                    many = "One number is" if len(texts) == 1 else f"{len(texts)} numbers are"
                    raise InputError(f"{many} needed.", "Type it as in the brackets.", value=typed)
                value = numbers if several else numbers[0]
            instrument = _made({**answers, key: value}, target).model.machine.instrument
            doubt = instrument.implausible().get(key.rpartition(".")[2])
            if doubt and value != doubted:
                from orthoglide_cal.report.sentences import sentence

                common.tell(f"{sentence(doubt)} To take it anyway, type it again.")
                doubted = value
                continue
            answers[key] = value
            return True
        except InputError as error:
            # What follows from a wrong answer is not asked yet.
            mine = [fault for fault in error.problems if (fault.column or "").startswith(key)]
            # An answer has no other place than the question.
            common.tell(replace((mine or error.problems)[0], column=None, problems=()).alone)


def _made(answers: Answers, target: Path) -> "StoredMachine":
    """The file, not written yet. Raises InputError for values that make no machine."""
    from orthoglide_cal.files.machine_file import new_machine

    scaled = ("joint_limits_mm", "workspace_mm") if "leg_length_mm" in answers else ()
    usual = {key: _usual(key, answers) for key in scaled if key not in answers}
    values: Answers = {"name": "my machine", **answers, **usual}
    if "endstops_mm" in values:  # one number for all
        height = values.pop("endstops_mm")
        values |= {f"endstops_mm.{tower}": height for tower in "abc"}
    if answers.get("gauge.revolution_mm") == 0.0:
        values["gauge.revolution_mm"] = None
    return new_machine(values, str(target))


def _usual(key: str, answers: Answers) -> Any:
    """Proposed value: the prototype's, for travel and workspace in proportion to L."""
    from orthoglide_cal.files.machine_file import machine_values, read_machine_file, shipped_machine

    known = machine_values(read_machine_file(shipped_machine(answers["kind"])).model)
    value: Answers = {**known, "name": "my machine"}
    for part in key.split("."):
        value = value[part]
    if key in ("arm_length_mm", "endstops_mm"):  # one for all
        value = next(iter(value.values() if isinstance(value, dict) else value))
    if "leg_length_mm" in answers and key in ("joint_limits_mm", "workspace_mm"):
        share = answers["leg_length_mm"] / known["leg_length_mm"]
        return [round(n * share) for n in value] if key != "workspace_mm" else round(value * share)
    return value
