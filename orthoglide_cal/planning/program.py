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
from itertools import compress, groupby

import numpy as np

from orthoglide_cal.errors import PostureError
from orthoglide_cal.files.gcode_template import Template
from orthoglide_cal.files.text import csv_text, in_csv
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, ReadOnly
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.planning.steps import SessionStep, posture_name
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
_COMMENT_WIDTH = 76  # some controllers read no more than 80 characters of a line


@dataclass(frozen=True, eq=False)
class Block(ReadOnly):
    """One visit: drive there, wait, read. Joints are those that the controller indicates [mm]."""

    first: SessionStep  # of those that are read there
    row: Mapping[str, str]  # column of the table → text; the numbers are joints and lengths in mm
    # To the isotropic posture, this one included, where the gauges are put to their places before
    # this block, shape (n, 3); empty where they stay as they are.
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
    """The program that takes the nominal machine through the postures of some steps.

    Args:
        steps: of a session, in order.
        session: as of `PostureProgram`.

    Raises:
        PostureError: a point is outside the joint limits.
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


# --- as text ----------------------------------------------------------------------------------


def program_csv(program: PostureProgram) -> str:
    """One row per block; lengths in mm, joints as the controller indicates them."""
    rows = [block.row for block in program.blocks]
    return csv_text([*rows[0]], [[*row.values()] for row in rows])


def program_gcode(program: PostureProgram, template: Template) -> str:
    """The template with the blocks in the place of its marker.

    A block drives to the approach point along the axis of its leg, then slowly to the posture, and
    waits. Coordinates are absolute, in mm.
    """
    machine, lines = program.machine, [*template.before]

    def comment(words: str) -> None:
        """Write comment lines with nothing in them that a controller obeys."""
        harmless = _FOREIGN.sub("?", words)
        # Some controllers obey comments that begin with a word of theirs, such as "MSG,".
        for line in textwrap.wrap(
            harmless, _COMMENT_WIDTH, subsequent_indent="- ", break_on_hyphens=False
        ):
            lines.append(f"; {line}" if template.semicolon else f"({line})")

    def move(joints: Floats, feed: float) -> str:
        """A straight move, e.g. "G1 X309.25 Y309.25 Z309.25 F1000"."""
        values = joints
        if template.values == "displacements":
            values = joints - machine.home_mm
        elif template.values == "tool":
            values = machine.nominal_rails.tool_for(joints)
        pairs = zip(template.axes, values, strict=True)
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
        words = f"{row['block']}: leg {row['leg']}, {posture_name(first)}, cycle {first.cycle}."
        words += f" Read steps {row['steps'].replace(' ', '-')}, gauges {row['gauges']}."
        above = row["from_above"]
        comment(f"{words} Carriage {above} arrives from above." if above else words)
        start, *way = (move(joints, template.feed) for joints in block.way)
        lines += [f"{row['block']} {start}", *way, move(block.posture, template.slow)]
        lines.append(template.pause)
    return "\n".join((*lines, *template.after, ""))


def _head(program: PostureProgram, template: Template) -> Iterator[str]:
    """Meaning of the numbers, the session of the blocks, and what the approach hides."""
    home, names = short(program.machine.home_mm, _DECIMALS), " ".join(template.axes)
    meaning = {
        "joints": f"joint positions as the controller shows them: all {home} at the"
        " isotropic posture",
        "displacements": f"displacements of the carriages from the isotropic posture,"
        f" where the joint positions are {home}",
        "tool": "tool positions: all 0 at the isotropic posture",
    }
    postures = counted(len(program.blocks), "posture")
    yield f"For {program.machine.name}: {postures}, each a numbered block."
    yield "Blocks and steps are those of this command, and of no other:"
    yield program.session
    yield (
        f"{names} are {meaning[template.values]}. Absolute, in mm. Feeds in mm per minute. No"
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
