"""The posture program: where the controller drives to, posture by posture, as CSV and as G-code.

Every carriage arrives from below (in the + direction), slowly over the last stretch. Lost motion
is then the same at every posture: it leaves no trace in the readings and is part of the offsets,
which are right as long as the machine works with the same approach.

A posture at the lower limit cannot be approached from below. There the carriage that stands at the
limit, and only that one, arrives from above. Where the carriages can go farther than the joint
limits of the machine file, which are the postures of the protocol, `travel_mm` says so.
"""

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from orthoglide_cal.errors import PostureError, UsageError
from orthoglide_cal.files.gcode_template import PostureValues, Template
from orthoglide_cal.files.text import csv_text, in_csv
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Bools, Floats, ReadOnly
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
_CSV = (
    *("block", "set_up", "leg", "posture", "displacement_mm", "cycle", "steps", "gauges"),
    *(f"{point}_{axis}_mm" for point in ("joint", "tool", "approach_joint") for axis in AXES),
    *("from_above", "machine", "session"),
)


@dataclass(frozen=True, eq=False)
class Block(ReadOnly):
    """One visit: drive there, wait, read. Joints are those that the controller indicates [mm]."""

    number: int  # as in "N10"
    steps: tuple[SessionStep, ...]  # readings that are taken there
    way: Floats  # from the posture before, along the axes of the legs, shape (n, 3)
    approach: Floats  # from here slowly to the posture, shape (3,)
    posture: Floats  # shape (3,)
    from_above: tuple[int, ...]  # carriages that arrive so: their lower limit is too near
    # To the isotropic posture, this one included, where the gauges are put to their places before
    # this block, shape (n, 3); empty where they stay as they are.
    set_up: Floats


@dataclass(frozen=True)
class PostureProgram:
    """All blocks in order; the machine stands at the isotropic posture when it begins."""

    machine: Machine
    approach_mm: float  # along each joint
    session: str  # the command to measure with: in other sessions blocks mean other postures
    blocks: tuple[Block, ...]


def posture_program(
    model: Model,
    steps: Sequence[SessionStep],
    session: str,
    approach_mm: float = APPROACH_MM,
    travel_mm: tuple[float, float] | None = None,
) -> PostureProgram:
    """The program that takes the nominal machine through the postures of some steps.

    Args:
        steps: of a session, in order.
        session, approach_mm: as of `PostureProgram`.
        travel_mm: (lowest, highest) displacement from the isotropic posture to which the
            controller may drive a carriage; None for the joint limits of the machine file.

    Raises:
        UsageError: the approach has no length, or the travel does not hold the isotropic posture.
        PostureError: a point is outside the limits, or they leave no room for the approach.
    """
    if not (math.isfinite(approach_mm) and approach_mm > 0.0):
        raise UsageError(
            f"The approach cannot be {approach_mm:g} mm long.", "Give a length such as 1."
        )
    machine = model.machine
    low, high = machine.limits_mm if travel_mm is None else travel_mm
    if not low <= 0.0 <= high or low == high:
        raise UsageError(
            f"The carriages cannot go from {low:+g} to {high:+g} mm of the isotropic posture.",
            "--travel LOW HIGH: LOW must be below HIGH, and 0 between them.",
        )

    def refuse(number: int, wrong: Bools, fault: str, remedy: str) -> None:
        """Raise PostureError for the first carriage with which something is wrong."""
        for axis in np.flatnonzero(wrong):
            at = f"carriage {AXES[axis].upper()} {fault.format(f'{moved[axis]:+.6g} mm')}"
            limits = f"Its limits are {low:+g} and {high:+g} mm."
            raise PostureError(f"N{number}: {at} {limits}", remedy)

    blocks: list[Block] = []
    leg, here, stands = 0, 0.0, None
    for number, together in groupby(steps, key=lambda step: step.block):
        visit = tuple(together)
        set_up = np.empty((0, 3))
        if visit[0].setup != stands:
            set_up = _way(machine, leg, here, 0.0)
            here, stands = 0.0, visit[0].setup
        leg, there = visit[0].leg, visit[0].cell.displacement
        *way, posture = _way(machine, leg, here, there)
        for joints in (*set_up, *way, posture):
            moved = joints - machine.home_mm
            outside = (moved < low - _ROUNDING_MM) | (moved > high + _ROUNDING_MM)
            fault = "would be driven to {} from the isotropic posture."
            refuse(number, outside, fault, "Choose postures inside the limits.")
        above = moved - approach_mm < low - _ROUNDING_MM
        narrow = above & (moved + approach_mm > high + _ROUNDING_MM)
        fault = f"has no room for an approach of {approach_mm:g} mm to {{}}."
        refuse(number, narrow, fault, "Take a shorter approach.")
        start = posture + np.where(above, approach_mm, -approach_mm)
        from_above = tuple(np.flatnonzero(above).tolist())
        blocks.append(Block(number, visit, np.array(way), start, posture, from_above, set_up))
        here = there
    return PostureProgram(machine, approach_mm, session, tuple(blocks))


def _way(machine: Machine, leg: int, start: float, end: float) -> Floats:
    """Joints from one displacement of a leg, left out, to another in short stretches, (n, 3)."""
    stretches = max(math.ceil(abs(end - start) / _STRETCH_MM), 1)
    return machine.joints_at(leg, np.linspace(start, end, stretches + 1)[1:])


# --- as text ----------------------------------------------------------------------------------


def program_csv(program: PostureProgram) -> str:
    """One row per block; lengths in mm, joints as the controller indicates them."""
    rows = []
    for block in program.blocks:
        first = block.steps[0]
        tool = program.machine.nominal_rails.tool_for(block.posture)
        points = block.posture, tool, block.approach
        rows.append(
            (
                f"N{block.number}",
                first.setup,
                AXES[first.leg],
                first.posture,
                short(first.cell.displacement, _DECIMALS),
                first.cycle,
                " ".join(str(step.number) for step in block.steps),
                _gauges(block),
                *(plain(value, _DECIMALS) for point in points for value in point),
                " ".join(AXES[axis] for axis in block.from_above),
                in_csv(program.machine.name),
                in_csv(program.session),
            )
        )
    return csv_text(_CSV, rows)


def program_gcode(program: PostureProgram, template: Template) -> str:
    """The template with the blocks in the place of its marker.

    A block drives to the approach point along the axis of its leg, then slowly to the posture, and
    waits. Coordinates are absolute, in mm.
    """
    blocks = (line for block in program.blocks for line in _block_lines(block, program, template))
    head = (line for words in _head(program, template) for line in _comment(words, template))
    return "\n".join((*template.before, *head, *blocks, *template.after, ""))


def _head(program: PostureProgram, template: Template) -> Iterator[str]:
    """Meaning of the numbers, the session of the blocks, and what the approach hides."""
    home, names = short(program.machine.home_mm, _DECIMALS), " ".join(template.axes)
    meaning = {
        PostureValues.JOINTS: f"joint positions as the controller shows them: all {home} at the"
        " isotropic posture",
        PostureValues.DISPLACEMENTS: f"displacements of the carriages from the isotropic posture,"
        f" where the joint positions are {home}",
        PostureValues.TOOL: "tool positions: all 0 at the isotropic posture",
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
        f"Carriages arrive from below, slowly over the last {short(program.approach_mm, 3)} mm."
        " Lost motion, also called backlash, then leaves no trace in the readings and is part of"
        " the offsets: let the machine work with the same approach."
    )
    above = [f"N{block.number} {_carriages(block)}" for block in program.blocks if block.from_above]
    if above:
        yield (
            "Except the carriage that stands at its lower limit, which arrives from above: its"
            f" lost motion still shows in these blocks: {', '.join(above)}."
        )


def _block_lines(block: Block, program: PostureProgram, template: Template) -> Iterator[str]:
    first, last = block.steps[0], block.steps[-1]
    leg = AXES[first.leg].upper()
    steps = str(first.number)
    steps += "" if last is first else f"-{last.number}"
    above = f" Carriage {_carriages(block)} arrives from above." if block.from_above else ""
    if len(block.set_up):
        words = f"Set-up {first.setup}: waits at the isotropic posture for the gauges on leg {leg}."
        yield from _comment(words, template)
        yield from (_move(joints, template.feed, program, template) for joints in block.set_up)
        yield "M0"  # waits for a button: nobody knows how long gauges take
    words = f"N{block.number}: leg {leg}, {posture_name(first)}, cycle {first.cycle}. Read steps"
    words += f" {steps}, gauges {_gauges(block).upper()}.{above}"
    yield from _comment(words, template)
    points = *block.way, block.approach
    way = [_move(joints, template.feed, program, template) for joints in points]
    yield from (f"N{block.number} {way[0]}", *way[1:])
    yield from (_move(block.posture, template.slow, program, template), template.pause)


def _move(joints: Floats, feed: float, program: PostureProgram, template: Template) -> str:
    """A straight move, e.g. "G1 X309.25 Y309.25 Z309.25 F1000"."""
    values = {
        PostureValues.JOINTS: joints,
        PostureValues.DISPLACEMENTS: joints - program.machine.home_mm,
        PostureValues.TOOL: program.machine.nominal_rails.tool_for(joints),
    }[template.values]
    pairs = zip(template.axes, values, strict=True)
    words = " ".join(f"{axis}{plain(value, _DECIMALS)}" for axis, value in pairs)
    return f"G1 {words} F{short(feed, 3)}"


def _comment(words: str, template: Template) -> list[str]:
    """Comment lines with nothing in them that a controller obeys."""
    harmless = _FOREIGN.sub("?", words)
    # Some controllers obey comments that begin with a word of theirs, such as "MSG,".
    lines = textwrap.wrap(harmless, _COMMENT_WIDTH, subsequent_indent="- ", break_on_hyphens=False)
    return [f"; {line}" if template.semicolon else f"({line})" for line in lines]


def _gauges(block: Block) -> str:
    return " ".join(dict.fromkeys(AXES[step.direction] for step in block.steps))


def _carriages(block: Block) -> str:
    return " ".join(AXES[axis].upper() for axis in block.from_above)
