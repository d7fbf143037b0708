"""The posture program as CSV and as G-code."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator

from orthoglide_cal.files.gcode_template import PostureValues, Template
from orthoglide_cal.files.table import csv_text
from orthoglide_cal.model import AXES
from orthoglide_cal.planning.program import Block, Point, PostureProgram
from orthoglide_cal.planning.steps import posture_name
from orthoglide_cal.report.escape import in_csv
from orthoglide_cal.words import counted, plain, short

# Tenths of a micrometre. All are written: "X310" without a point is 0.31 mm to some controllers.
_DECIMALS = 4
# A comment ends at ")", a program at "%"; "#" and others make some controllers compute.
_FOREIGN = re.compile(r"[^A-Za-z0-9 .,:+=<>'/_-]")
_COMMENT_WIDTH = 76  # some controllers read no more than 80 characters of a line
_CSV = (
    *("block", "set_up", "leg", "posture", "displacement_mm", "cycle", "steps", "gauges"),
    *(f"{what}_{axis}_mm" for what in ("joint", "tool", "approach_joint") for axis in AXES),
    *("from_above", "machine", "session"),
)


def program_csv(program: PostureProgram) -> str:
    """One row per block; lengths in mm, joints as the controller indicates them."""
    rows = []
    for block in program.blocks:
        first = block.steps[0]
        points = (block.posture.joints, block.posture.tool, block.approach.joints)
        rows.append(
            (
                f"N{block.number}",
                first.setup,
                AXES[first.leg],
                first.posture,
                short(first.displacement_mm, _DECIMALS),
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
    said = (line for words in _head(program, template) for line in _comment(words, template))
    return "\n".join((*template.before, *said, *blocks, *template.after, ""))


def _head(program: PostureProgram, template: Template) -> Iterator[str]:
    """What the numbers are, to which session the blocks belong, and what the approach hides."""
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
    above = [f"N{each.number} {_carriages(each)}" for each in program.blocks if each.from_above]
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
    if block.set_up:
        words = f"Set-up {first.setup}: waits at the isotropic posture for the gauges on leg {leg}."
        yield from _comment(words, template)
        yield from (_move(point, template.feed, program, template) for point in block.set_up)
        yield "M0"  # waits for a button: nobody knows how long gauges take
    words = f"N{block.number}: leg {leg}, {posture_name(first)}, cycle {first.cycle}. Read steps"
    words += f" {steps}, gauges {_gauges(block).upper()}.{above}"
    yield from _comment(words, template)
    way = [_move(point, template.feed, program, template) for point in (*block.way, block.approach)]
    yield from (f"N{block.number} {way[0]}", *way[1:])
    yield from (_move(block.posture, template.slow, program, template), template.pause)


def _move(point: Point, feed: float, program: PostureProgram, template: Template) -> str:
    """A straight move, e.g. "G1 X309.25 Y309.25 Z309.25 F1000"."""
    values = {
        PostureValues.JOINTS: point.joints,
        PostureValues.DISPLACEMENTS: point.joints - program.machine.home_mm,
        PostureValues.TOOL: point.tool,
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
