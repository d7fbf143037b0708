"""The posture program: where the controller drives to, posture by posture, as CSV and as G-code.

Every carriage arrives from below (in the + direction), slowly over the last stretch. Lost motion
is then the same at every posture: it leaves no trace in the readings and is part of the offsets,
which are right as long as the machine works with the same approach.

A posture at the lower limit cannot be approached from below. There the carriage that stands at the
limit, and only that one, arrives from above.
"""

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import compress, groupby
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ValidationError

from orthoglide_cal.errors import PostureError, UsageError, command
from orthoglide_cal.files.text import FileText, csv_text, in_csv, read_document
from orthoglide_cal.files.tree import Content, nearest
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, ReadOnly
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.planning.plan import SessionForecast
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.schema import Positive, Schema, text_that
from orthoglide_cal.words import counted, plain, short

APPROACH_MM = 1.0  # far more than any lost motion, little enough for every plunger
# A controller that moves the joints evenly takes the tool off the leg's axis in between, by s²/8L:
# in one stretch of 160 mm by 10 mm, and the plunger may slip off the leg.
_STRETCH_MM = 20.0
_ROUNDING_MM = 1e-9
# Tenths of a micrometre. All are written: "X310" without a point is 0.31 mm to some controllers.
_DECIMALS = 4
# A comment ends at ")", a program at "%"; "#" and others make some controllers compute.
_FOREIGN = re.compile(r"[^A-Za-z0-9 .,:+=<>'/_-]")
_CSV, _GCODE = ".csv", (".nc", ".ngc", ".gcode", ".tap", ".cnc")


@dataclass(frozen=True, eq=False)
class Block(ReadOnly):
    """One visit: drive there, wait, read. Joints are those that the controller indicates [mm]."""

    first: SessionStep  # of those that are read there
    row: Mapping[str, str]  # column of the table → text; the numbers are joints and lengths in mm
    # To the isotropic posture, where the gauges are put to their places, (n, 3), perhaps empty.
    set_up: Floats
    # From the posture before, along the axes of the legs, to where it is slowly approached, (n, 3).
    way: Floats
    posture: Floats  # shape (3,)


@dataclass(frozen=True)
class PostureProgram:
    """All blocks in order; the machine stands at the isotropic posture when it begins."""

    machine: Machine
    session: str  # the command to measure with: in other sessions blocks mean other postures
    blocks: tuple[Block, ...]


def posture_program(model: Model, steps: Sequence[SessionStep], session: str) -> PostureProgram:
    """The program that takes the nominal machine through the postures of steps, in their order.

    Raises PostureError: a point is outside the joint limits.
    """
    machine = model.machine
    low, high = machine.limits_mm
    least, most = low - _ROUNDING_MM, high + _ROUNDING_MM
    blocks: list[Block] = []
    leg, here, stands = 0, 0.0, None
    for number, together in groupby(steps, key=lambda step: step.block):
        visit = tuple(together)
        set_up = np.empty((0, 3))
        if visit[0].setup != stands:
            set_up = _way(machine, leg, here, 0.0)
            here, stands = 0.0, visit[0].setup
        leg, there = visit[0].leg, visit[0].cell.displacement
        way = _way(machine, leg, here, there)
        posture, above = way[-1], way[-1] - machine.home_mm - APPROACH_MM < least
        approach = posture + np.where(above, APPROACH_MM, -APPROACH_MM)
        moved = np.vstack((set_up, way, approach)) - machine.home_mm
        for point, axis in np.argwhere((moved < least) | (moved > most)):
            raise PostureError(
                f"N{number}: carriage {AXES[axis].upper()} would be driven to"
                f" {moved[point, axis]:+.6g} mm from the isotropic posture. Its limits are"
                f" {low:+g} and {high:+g} mm.",
                "Choose postures inside the limits.",
            )
        tool = machine.nominal_rails.tool_for(posture)
        points = {"joint": posture, "tool": tool, "approach_joint": approach}
        row = {
            "block": f"N{number}",
            "set_up": str(stands),
            "leg": AXES[leg],
            "posture": str(visit[0].posture),
            "displacement_mm": short(there, _DECIMALS),
            "cycle": str(visit[0].cycle),
            "steps": " ".join(str(step.number) for step in visit),
            "gauges": " ".join(dict.fromkeys(AXES[step.direction] for step in visit)),
            **{
                f"{name}_{axis}_mm": plain(value, _DECIMALS)
                for name, point in points.items()
                for axis, value in zip(AXES, point, strict=True)
            },
            "from_above": " ".join(compress(AXES, above)),
            "machine": in_csv(machine.name),
            "session": in_csv(session),
        }
        blocks.append(Block(visit[0], row, set_up, np.vstack((way[:-1], approach)), posture))
        here = there
    return PostureProgram(machine, session, tuple(blocks))


def _way(machine: Machine, leg: int, start: float, end: float) -> Floats:
    """Joints from one displacement of a leg, left out, to another in short stretches, (n, 3)."""
    stretches = max(math.ceil(abs(end - start) / _STRETCH_MM), 1)
    return machine.joints_at(leg, np.linspace(start, end, stretches + 1)[1:])


# Comments in a template that begin with "orthocal" are settings, notes, or the marker that says
# where the blocks go; all other lines are copied as they stand.
_OURS = re.compile(r"\s*\(\s*orthocal\b([^()]*)\)\s*", re.IGNORECASE)
_WAITS = text_that(
    re.compile(r"M0?[01]|M60|G0?4( [A-Z][0-9]+(\.[0-9]+)?)+").fullmatch,
    "This code does not wait.",
    "Write M0, M1, or G4 P20 for 20 s.",
)
_REMARK = re.compile(r"\([^)]*\)?|;.*")
_NUMBER = re.compile(r"\s*/?\s*N0*([0-9]+)", re.IGNORECASE)
_CODE = re.compile(r"G0*([0-9]+)(?![0-9.])", re.IGNORECASE)
_PRINT = "For a complete one: orthocal template gcode"
# Codes of which the last one holds: that for which the blocks are written, and what others mean.
_MODES = (
    {"21": "", "71": "", "710": "", "20": "inches", "70": "inches", "700": "inches"},
    {"90": "", "91": "distances from the last point"},
    {"94": "", "93": "feeds as inverse times", "95": "feeds per turn"},
)


class Template(Schema):
    """A template as read."""

    before: tuple[str, ...]  # lines around the blocks
    after: tuple[str, ...]
    # Meaning of the numbers behind the axis words.
    values: Annotated[Literal["joints", "tool"], BeforeValidator(str.lower)] = "joints"
    pause: Annotated[str, AfterValidator(str.upper), _WAITS] = "M0"  # waits at each posture
    feed: Positive = 1000.0  # between postures [mm/min]
    slow: Positive = 100.0  # on arrival [mm/min]


def _template(document: FileText, program: PostureProgram) -> Template:
    """The template that a file holds. Raises InputError as `program_gcode` does."""
    content, taken = Content(document), {block.first.block for block in program.blocks}
    known = [name for name, field in Template.model_fields.items() if not field.is_required()]
    settings = content.value = dict[str, str]()
    before, after, marker = list[str](), list[str](), False
    modes: dict[int, tuple[int, str]] = {}
    for line, text in enumerate(document.text.rstrip("\n").split("\n"), start=1):
        if ours := _OURS.fullmatch(text):
            key, _, value = ours[1].partition(":")
            name = key.strip().lower()
            if name in settings or (name == "blocks" and marker):
                content.add("This is given twice.", "Take one out.", line=line, value=key)
            elif name == "blocks":
                marker = True
            elif name in known:
                settings[name], content.lines[name,] = " ".join(value.split()), line
            elif name != "note" and text != "(orthocal axes: X Y Z)":  # of earlier templates
                near = nearest(name, (*known, "note", "blocks"))
                content.add("This is not a setting.", f"{near}{_PRINT}", line=line, value=name)
            continue
        (after if marker else before).append(text)
        code = _REMARK.sub("", text)
        if (number := _NUMBER.match(code)) and int(number[1]) in taken:
            wrong, value = "A posture has this block number.", f"N{number[1]}"
            content.add(wrong, "Number your own lines otherwise, or not at all.", line, value=value)
        for mode in [] if marker else _CODE.findall(code):
            modes |= {k: (line, mode) for k, codes in enumerate(_MODES) if mode in codes}
    for k, (line, mode) in modes.items():
        if meaning := _MODES[k][mode]:
            wrong = f"The blocks are not written for this code ({meaning})."
            remedy = f"Write G{next(iter(_MODES[k]))} before the blocks."
            content.add(wrong, remedy, line=line, value=f"G{mode}")
    if not marker:
        wrong = "The template does not say where the blocks go."
        content.add(wrong, f"Put a line (orthocal blocks) there. {_PRINT}")
    try:
        template = Template.model_validate({"before": before, "after": after, **settings})
    except ValidationError as error:
        content.take(error, Template)
    content.check()
    return template


def chosen_program(
    chosen: SessionForecast, target: Path, template: Path | None, machine: Path | None
) -> tuple[str, int]:
    """The text of a session's program, or of a layout's places; and how many blocks or places.

    Raises UsageError: nothing of the kind can be written there; PostureError as `posture_program`.
    """
    session, model = chosen.session, chosen.model
    ends = (_CSV, *_GCODE) if session else (_CSV,)
    if str(target) != "-" and target.suffix.lower() not in ends:
        for_gcode = f", in {_GCODE[0]} for G-code" if session else ""
        fault = f"The name {target} does not say what to write."
        raise UsageError(fault, f"End it in {_CSV} for a table{for_gcode}.")
    if session is None:
        if template:
            raise UsageError("A printer's places are written as a table.", "Leave out --template.")
        plan = chosen.plan
        places = plan.spots[plan.touches].tolist()
        rows = ((f"{x:g}", f"{y:g}", f"{high:g}", None) for x, y, high in places)
        return csv_text(("x_mm", "y_mm", "z_mm", "reading_mm"), rows), len(plan)
    typed = command("measure", machine=machine, options=session.options)
    program = posture_program(model, session.steps(model.machine), typed)
    return program_text(program, target, template), len(program.blocks)


def program_text(program: PostureProgram, target: Path, template: Path | None) -> str:
    """A program as CSV or G-code, by the end of the name; "-" is a table.

    The table has one row per block; lengths in mm, joints as the controller indicates them. None is
    the template of `orthocal template gcode`. Raises UsageError: a template without G-code.
    """
    if target.suffix.lower() in _GCODE:
        path = template or files("orthoglide_cal.files") / "templates" / "gcode.nc"
        return program_gcode(program, read_document(str(path)))
    if template is not None:
        raise UsageError("--template is for G-code.", f"Name a file that ends in {_GCODE[0]}.")
    rows = [block.row for block in program.blocks]
    return csv_text([*rows[0]], [[*row.values()] for row in rows])


def program_gcode(program: PostureProgram, document: FileText) -> str:
    """The template in a file with the blocks in the place of its marker.

    A block drives to the approach point along the axis of its leg, then slowly to the posture, and
    waits. Coordinates are absolute, in mm. Raises InputError: a fault of the template, such as a
    mode (inches, relative) in which the blocks would drive elsewhere.
    """
    template = _template(document, program)
    machine, lines = program.machine, [*template.before]

    def comment(words: str) -> None:
        """Write comment lines with nothing in them that a controller obeys."""
        text = _FOREIGN.sub("?", words)
        # Some controllers obey comments that begin with a word of theirs, such as "MSG,".
        wrapped = textwrap.wrap(text, 76, subsequent_indent="- ", break_on_hyphens=False)
        lines.extend(f"({line})" for line in wrapped)  # some read no more than 80 characters

    def move(joints: Floats, feed: float) -> str:
        """A straight move, e.g. "G1 X309.25 Y309.25 Z309.25 F1000"."""
        values = machine.nominal_rails.tool_for(joints) if template.values == "tool" else joints
        pairs = zip("XYZ", values, strict=True)
        words = " ".join(f"{axis}{plain(value, _DECIMALS)}" for axis, value in pairs)
        return f"G1 {words} F{short(feed, 3)}"

    for words in _head(program, template):
        comment(words)
    for block in program.blocks:
        first, row = block.first, {name: text.upper() for name, text in block.row.items()}
        if len(block.set_up):
            waits = f"waits at the isotropic posture for the gauges on leg {row['leg']}."
            comment(f"Set-up {first.setup}: {waits}")
            lines += [move(joints, template.feed) for joints in block.set_up]
            lines.append("M0")  # waits for a button: nobody knows how long gauges take
        words = f"{row['block']}: leg {row['leg']}, {first.posture_name}, cycle {first.cycle}."
        words += f" Read steps {row['steps'].replace(' ', '-')}, gauges {row['gauges']}."
        above = row["from_above"]
        comment(f"{words} Carriage {above} arrives from above." if above else words)
        start, *way = (move(joints, template.feed) for joints in block.way)
        lines += [f"{row['block']} {start}", *way, move(block.posture, template.slow)]
        lines.append(template.pause)
    return "\n".join((*lines, *template.after, ""))


def _head(program: PostureProgram, template: Template) -> Iterator[str]:
    """Meaning of the numbers, the session of the blocks, and what the approach hides."""
    meaning = "tool positions: all 0"
    if template.values == "joints":
        home = short(program.machine.home_mm, _DECIMALS)
        meaning = f"joint positions as the controller shows them: all {home}"
    postures = counted(len(program.blocks), "posture")
    yield f"For {program.machine.name}: {postures}, each a numbered block."
    yield "Blocks and steps are those of this command, and of no other:"
    yield program.session
    yield (
        f"X Y Z are {meaning} at the isotropic posture. Absolute, in mm. Feeds in mm per minute. No"
        " work offset and no tool length may be active."
    )
    yield "Begin at the isotropic posture. To run a block again, drive there first."
    yield (
        f"Carriages arrive from below, slowly over the last {short(APPROACH_MM, 3)} mm."
        " Lost motion, also called backlash, then leaves no trace in the readings and is part of"
        " the offsets: let the machine work with the same approach."
    )
    rows = (block.row for block in program.blocks)
    above = [f"{row['block']} {row['from_above'].upper()}" for row in rows if row["from_above"]]
    if above:
        yield (
            "Except the carriage that stands at its lower limit, which arrives from above: its"
            f" lost motion still shows in these blocks: {', '.join(above)}."
        )
