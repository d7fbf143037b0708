"""The posture program as a table, as CSV and as G-code."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator

from orthoglide_cal.files.gcode_template import PostureValues, Template
from orthoglide_cal.files.table import csv_text
from orthoglide_cal.model import AXES
from orthoglide_cal.planning.program import Block, Point, PostureProgram
from orthoglide_cal.planning.steps import posture_name
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.escape import in_csv
from orthoglide_cal.words import counted, plain, short

# Tenths of a micrometre. All are written: "X310" without a point is 0.31 mm to some controllers.
_DECIMALS = 4
# A comment ends at ")", a program at "%"; "#" and others make some controllers compute.
_FOREIGN = re.compile(r"[^A-Za-z0-9 .,:+=<>'/_-]")
_COMMENT_WIDTH = 76  # some controllers read no more than 80 characters of a line
_SET_UP = "M0"  # waits for a button: nobody knows how long gauges take
# Some controllers obey comments that begin with a word of theirs, such as "MSG,".
_GOES_ON = "- "
_CSV = (
    *("block", "set_up", "leg", "posture", "displacement_mm", "cycle", "steps", "gauges"),
    *(f"{what}_{axis}_mm" for what in ("joint", "tool", "approach_joint") for axis in AXES),
    *("from_above", "machine", "session"),
)


def program_page(program: PostureProgram) -> doc.Page:
    """One row for each block, for people."""
    grid = doc.Grid(
        (
            "block",
            "steps",
            "leg",
            "posture",
            *(f"joint {axis}" for axis in AXES),
            "tool",
            "arrives",
        ),
        tuple(
            (
                f"N{block.number}",
                _range(block),
                AXES[block.steps[0].leg],
                block.steps[0].posture,
                *(plain(value, 3) for value in block.posture.joints),
                " ".join(short(value, 3) for value in block.posture.tool),
                _arrives(block),
            )
            for block in program.blocks
        ),
        words=(0, 1, 2, 3, 8),
        caption="Joint and tool positions in mm, as the controller shows them.",
    )
    notes = tuple(
        doc.Paragraph(line, small=True)
        for line in (*_session_words(program), *_approach_words(program))
    )
    section = doc.Section("Blocks", (grid, *notes))
    return doc.Page("Posture program", program.machine.name, sections=(section,))


def program_csv(program: PostureProgram) -> str:
    """One row per block; lengths in mm, joints as the controller indicates them."""
    return csv_text(_CSV, (_csv_row(block, program) for block in program.blocks))


def _csv_row(block: Block, program: PostureProgram) -> tuple[object, ...]:
    first = block.steps[0]
    points = (block.posture.joints, block.posture.tool, block.approach.joints)
    return (
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


def program_gcode(program: PostureProgram, template: Template) -> str:
    """The template with the blocks in the place of its marker.

    A block drives to the approach point along the axis of its leg, then slowly to the posture, and
    waits. Coordinates are absolute, in mm.
    """
    lines = [*template.before, *_head(program, template)]
    for block in program.blocks:
        lines += _block_lines(block, program, template)
    return "\n".join([*lines, *template.after]) + "\n"


def _head(program: PostureProgram, template: Template) -> Iterator[str]:
    """What the numbers are, and what the approach means."""
    home, names = short(program.home_mm, _DECIMALS), " ".join(template.axes)
    meaning = {
        PostureValues.JOINTS: f"joint positions as the controller shows them: all {home} at the"
        " isotropic posture",
        PostureValues.DISPLACEMENTS: f"displacements of the carriages from the isotropic posture,"
        f" where the joint positions are {home}",
        PostureValues.TOOL: "tool positions: all 0 at the isotropic posture",
    }
    said = (
        f"For {program.machine.name}: {counted(len(program.blocks), 'posture')}, each a"
        " numbered block.",
        *_session_words(program),
        f"{names} are {meaning[template.values]}. Absolute, in mm. Feeds in mm per minute. No"
        " work offset and no tool length may be active.",
        "Begin at the isotropic posture. To run a block again, drive there first.",
        *_approach_words(program),
    )
    for words in said:
        yield from _comment(words, template)


def _session_words(program: PostureProgram) -> tuple[str, str]:
    """To which session the blocks belong."""
    return "Blocks and steps are those of this command, and of no other:", program.session


def _approach_words(program: PostureProgram) -> Iterator[str]:
    """The side from which the carriages come, and what that hides."""
    length = short(program.approach_mm, 3)
    yield (
        f"Carriages arrive from below, slowly over the last {length} mm. Lost motion, also"
        " called backlash, then leaves no trace in the readings and is part of the offsets: let"
        " the machine work with the same approach."
    )
    above = [block for block in program.blocks if block.from_above]
    if above:
        names = ", ".join(f"N{block.number} {_carriages(block)}" for block in above)
        yield (
            "Except the carriage that stands at its lower limit, which arrives from above: its"
            f" lost motion still shows in these blocks: {names}."
        )


def _block_lines(block: Block, program: PostureProgram, template: Template) -> Iterator[str]:
    first = block.steps[0]
    above = f" Carriage {_carriages(block)} arrives from above." if block.from_above else ""
    if block.set_up:
        leg = AXES[first.leg].upper()
        words = f"Set-up {first.setup}: waits at the isotropic posture for the gauges on leg {leg}."
        yield from _comment(words, template)
        yield from (_move(point, template.feed, program, template) for point in block.set_up)
        yield _SET_UP
    yield from _comment(
        f"N{block.number}: leg {AXES[first.leg].upper()}, {posture_name(first)}, cycle"
        f" {first.cycle}. Read steps {_range(block)}, gauges {_gauges(block).upper()}.{above}",
        template,
    )
    start, *on = (*block.way, block.approach)
    yield f"N{block.number} {_move(start, template.feed, program, template)}"
    for point in on:
        yield _move(point, template.feed, program, template)
    yield _move(block.posture, template.slow, program, template)
    yield template.pause


def _move(point: Point, feed: float, program: PostureProgram, template: Template) -> str:
    """A straight move, e.g. "G1 X309.25 Y309.25 Z309.25 F1000"."""
    values = {
        PostureValues.JOINTS: point.joints,
        PostureValues.DISPLACEMENTS: point.joints - program.home_mm,
        PostureValues.TOOL: point.tool,
    }[template.values]
    words = (
        f"{axis}{plain(value, _DECIMALS)}"
        for axis, value in zip(template.axes, values, strict=True)
    )
    return f"G1 {' '.join(words)} F{short(feed, 3)}"


def _comment(words: str, template: Template) -> list[str]:
    """Comment lines with nothing in them that a controller obeys."""
    harmless = _FOREIGN.sub("?", words)
    lines = textwrap.wrap(
        harmless, _COMMENT_WIDTH, subsequent_indent=_GOES_ON, break_on_hyphens=False
    )
    return [f"; {line}" if template.semicolon else f"({line})" for line in lines]


def _range(block: Block) -> str:
    """ "5-6": the steps of a block, which follow each other."""
    first, last = block.steps[0].number, block.steps[-1].number
    return str(first) if first == last else f"{first}-{last}"


def _gauges(block: Block) -> str:
    return " ".join(dict.fromkeys(AXES[step.direction] for step in block.steps))


def _carriages(block: Block) -> str:
    return " ".join(AXES[axis].upper() for axis in block.from_above)


def _arrives(block: Block) -> str:
    return f"{_carriages(block)} from above" if block.from_above else "from below"
