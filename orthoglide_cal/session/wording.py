"""The words, tables and pictures that lead through a session, in plain characters."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Sequence

from orthoglide_cal.errors import visible
from orthoglide_cal.estimation import Solution
from orthoglide_cal.estimation.accuracy import decimals_for
from orthoglide_cal.model import AXES, Contact, Floats, Posture
from orthoglide_cal.session.events import Questioned
from orthoglide_cal.session.gauges.formats import Unit
from orthoglide_cal.session.readings import Setting
from orthoglide_cal.session.state import State
from orthoglide_cal.session.steps import SessionStep, gauge_moves, minutes_left

WIDTH = 79

HELP = """\
Type the reading, e.g. -0.12 (comma or point; mm, or add "in"), then Return.
  u            undo the last reading
  r 14 why     retake step 14 (r x: all of leg X); the old reading is kept
  n text       note, kept with this step
  s why        skip this step (s all why: skip all that is left, and finish)
  t            table of the readings so far
  p            pause
  q            save and quit; go on later with --resume
  ?            this help
A reading that looks wrong is questioned once:
  k            keep it all the same
  m            the stand did move: keep it, with a new zero from here on
  or give the reading again.
Every accepted reading is on the disk before the next prompt."""


def opening_lines(state: State, setting: Setting, name: str) -> list[str]:
    """What lies ahead; `name` is the session file's."""
    opened, steps, gauge = state.opened, setting.steps, setting.machine.gauge
    setups = len({step.setup for step in steps})
    gauges = "two gauges" if any(step.stand for step in steps) else "one gauge"
    repeats = "cycle" if opened.cycles == 1 else "cycles"
    return [
        f"{opened.protocol} session, {opened.cycles} {repeats}, order: {opened.order}",
        f"Machine  {visible(setting.machine.name)}",
        f"Gauge    {gauge.resolution_mm:g} mm divisions, {gauge.range_mm:g} mm travel,"
        f" repeats within {gauge.repeatability_mm:g} mm",
        f"File     {visible(name)}",
        f"{len(steps)} readings with {gauges}: {setups} set-ups, {gauge_moves(steps)} gauge moves,"
        f" about {minutes_left(steps):.0f} min. ? is help.",
    ]


def setup_lines(setting: Setting, setup: int, begun: bool = False) -> list[str]:
    """Heading, picture and instructions of a gauge set-up.

    Once it is `begun`, readings were taken in it: the stands must stay where they are.
    """
    here = [step for step in setting.steps if step.setup == setup]
    last = max(step.setup for step in setting.steps)
    leg, contact = here[0].leg, here[0].contact
    directions = sorted({step.direction for step in here})
    names = " and ".join(AXES[direction].upper() for direction in directions)
    gauges = f"gauge{'s' if len(directions) > 1 else ''} {names}"
    heading = f"-- Set-up {setup} of {last}: leg {AXES[leg].upper()}, {gauges} "
    right = f" steps {here[0].number}-{here[-1].number}"
    if contact is not Contact.FIXED:
        words = [
            "1. Gauge on the XY surface, plunger down on the leg: higher reads more.",
            f"2. Slide the stand between the ends of leg {AXES[leg].upper()}; never touch the"
            " gauge's zero.",
            "3. Joint end: at the carriage joint. Tool end: at the tool centre point.",
        ]
    elif begun:
        words = [
            "The stands are in place: do not touch them. Should one have been moved all the",
            "same, just go on: the next reading will be questioned; then answer m.",
        ]
    else:
        words = _fixed_words(leg, directions, setting)
    rule = f"{heading}{'-' * max(WIDTH - 1 - len(heading) - len(right), 1)}{right}"
    return [rule, "", *_picture(leg, directions, contact), "", *words]


def _fixed_words(leg: int, directions: Sequence[int], setting: Setting) -> list[str]:
    name = AXES[leg].upper()
    half = setting.machine.leg_length_mm / 2.0
    low, high = setting.machine.joint_limits_mm
    # A gauge on the + side reads more when the leg is pushed towards +.
    places = ", ".join(f"{AXES[d].upper()} on the +{AXES[d].upper()} side" for d in directions)
    s = "s" if len(directions) > 1 else ""
    return [
        f"1. Drive to the isotropic posture. Stand{s} on the base, not on a moving part.",
        f"2. Plunger{s} on leg {name}, half-way: {half:.0f} mm from the carriage,"
        " square to the leg.",
        f"3. Gauge {places}: leg pushed to + must read more.",
        f"4. The leg stays under the plunger{s} from {low:+g} to {high:+g} mm."
        " Then touch no stand.",
    ]


def step_lines(step: SessionStep, state: State, setting: Setting, minutes: float) -> list[str]:
    """Where step n of N is, and where to drive; `minutes` are those left."""
    at = setting.model.kind.joints_at(setting.machine, step.leg, step.displacement_mm)
    joints = zip("XYZ", at, strict=True)
    targets = "   ".join(f"{axis} {joint:.3f}" for axis, joint in joints)
    cycles = state.opened.cycles
    closing = step.posture is Posture.ISO and step.cycle > cycles
    when = "closing" if closing else f"cycle {step.cycle} of {cycles}"
    return [
        f"Step {step.number} of {len(setting.steps)}: leg {AXES[step.leg].upper()},"
        f" {step.posture.upper()}, {when}. {_duration(minutes)} left.",
        f"Drive to  {targets}  mm",
    ]


def _duration(minutes: float) -> str:
    return f"About {minutes:.0f} min" if minutes >= 0.95 else "Less than a minute"


def prompt(step: SessionStep, hint: str | None, unit: Unit) -> str:
    """What is asked, short enough to leave room for the answer."""
    end = f" at the {step.end.upper()} end" if step.end else ""
    doing = f" ({hint})" if hint else ""
    return f"{step.number}. Gauge {AXES[step.direction].upper()}{end} [{unit}]{doing} > "


def question_prompt(reading: Questioned, hint: str | None, moved: bool) -> str:
    """What can be answered; `moved`: also that the stand was moved."""
    keys = "k keep it, m the stand moved" if moved else "k keep it"
    return f"{reading.step}. {keys}, or read again{f', {hint}' if hint else ''} > "


def with_uncertainty(value: float, uncertainty: float) -> str:
    """ "-0.530 +/-0.021": the value ends at the digit of its uncertainty."""
    decimals = decimals_for(uncertainty)
    return f"{value:+.{decimals}f} +/-{uncertainty:.{decimals}f}"


def offsets_line(solution: Solution) -> str:
    """The offsets so far with the half-widths of their 95 % intervals."""
    half = solution.expanded_mm
    decimals = decimals_for(float(half.min()))
    parts = [
        f"{axis.upper()} {value:+.{decimals}f} +/-{width:.{decimals}f}"
        for axis, value, width in zip(AXES, solution.offsets_mm, half, strict=True)
    ]
    return f"Offsets, 95 %: {'  '.join(parts)} mm"


def saved_line(dropped: Sequence[SessionStep], minutes: float, until_mm: float) -> str:
    """What --until has made unnecessary."""
    cycles = len({(s.leg, s.cycle) for s in dropped if s.posture is not Posture.ISO})
    return (
        f"Every offset is known within {until_mm:g} mm (95 %). Saved: {cycles}"
        f" cycle{'' if cycles == 1 else 's'} of a leg, {len(dropped)} readings,"
        f" {_duration(minutes).lower()}."
    )


def closing_lines(state: State, session: str) -> list[str]:
    """What was measured and where it is."""
    reason = state.ended.reason if state.ended else "unfinished"
    counts = f"{len(state.accepted)} readings"
    for number, word in ((len(state.replaced), "replaced"), (len(state.skipped), "skipped")):
        if number:
            counts += f", {number} {word}"
    return ["", f"Session {reason}: {counts}.", f"Written to {visible(session)}", ""]


def truth_lines(solution: Solution, hidden_mm: Floats) -> list[str]:
    """After a simulated session: what was hidden, beside what was found."""
    lines = ["This machine was simulated. Hidden in it, and found (mm):"]
    low, high = solution.interval_mm.T
    for axis, hidden, *known in zip(AXES, hidden_mm, solution.offsets_mm, low, high, strict=True):
        decimals = decimals_for((known[2] - known[1]) / 2.0)
        found, least, most = (f"{value:+.{decimals}f}" for value in known)
        lines.append(
            f"  {axis.upper()}  hidden {hidden:+.4f}   found {found}   95 % from {least} to {most}"
        )
    if ((low <= hidden_mm) & (hidden_mm <= high)).all():
        return [*lines, "All three lie inside their intervals."]
    verdict = "Not all lie inside their intervals; chance alone does that once in seven sessions."
    return [*lines, verdict]


def table_lines(state: State, steps: Sequence[SessionStep]) -> list[str]:
    """The readings so far: one line per leg, gauge and posture, one column per cycle."""
    cycles = max(step.cycle for step in steps)
    columns = range(max(cycles - 6, 0) + 1, cycles + 1)  # what fits into 79 columns
    rows: dict[object, list[SessionStep]] = {}
    for step in steps:
        rows.setdefault(step.cell, []).append(step)
    heads = "".join(f"{f'cycle {number}':>10}" for number in columns)
    lines = [f"{'leg gauge posture':<24}{heads}"]
    for row in rows.values():
        cells = {step.cycle: _cell(state, step.number) for step in row}
        leg, direction = (AXES[axis].upper() for axis in row[0].series)
        name = f" {leg}    {direction}    {row[0].posture} {row[0].end or ''}"
        values = "".join(f"{cells.get(number, ''):>10}" for number in columns)
        lines.append(f"{name:<24}{values}".rstrip())
    marks = "? kept although questioned   - skipped   . to come"
    return [*lines, f"{marks}   replaced: {len(state.replaced)}"]


def _cell(state: State, number: int) -> str:
    if number in state.accepted:
        take = state.accepted[number].take
        return f"{take.value_mm:+.3f}{'?' if isinstance(take, Questioned) else ' '}"
    return ". " if state.is_open(number) else "- "


def wrapped(text: str) -> str:
    """Text whose lines end where the screen does; what goes on is indented like its beginning."""
    lines: list[str] = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()))
        lines += (
            textwrap.wrap(line, WIDTH, subsequent_indent=indent) if len(line) > WIDTH else [line]
        )
    return "\n".join(lines)


# Pictures of the gauge set-ups, x to the right, y away, z up: (row, column, text) of the machine's
# parts, and of each gauge with its plunger, for every leg.
_Marks = tuple[tuple[int, int, str], ...]

# fmt: off
_LEGS: tuple[_Marks, ...] = (
    ((4, 3, "tool o========*========(X)- - - rail X"), (5, 24, "carriage")),
    ((0, 24, "/ rail Y"), (1, 22, "(Y) carriage"), (2, 21, "/"), (3, 19, "/"), (4, 17, "*"),
     (5, 15, "/"), (6, 13, "/"), (7, 6, "tool o")),
    ((0, 17, "| rail Z"), (1, 16, "(Z) carriage"), (2, 17, "|"), (3, 17, "|"), (4, 17, "*"),
     (5, 17, "|"), (6, 17, "|"), (7, 12, "tool o")),
)
_GAUGES: dict[tuple[int, int], _Marks] = {
    (0, 1): ((2, 21, "[Y]"), (3, 19, "/")),
    (0, 2): ((1, 16, "[Z]"), (2, 17, "|"), (3, 17, "v")),
    (1, 0): ((4, 19, "<----[X]"),),
    (1, 2): ((1, 16, "[Z]"), (2, 17, "|"), (3, 17, "v")),
    (2, 0): ((4, 19, "<----[X]"),),
    (2, 1): ((2, 21, "[Y]"), (3, 19, "/")),
}
_SLIDING: tuple[_Marks, ...] = (
    ((1, 8, "[Z] tool end"), (2, 9, "|"), (3, 9, "v"), (1, 25, "[Z] joint end"), (2, 26, "|"),
     (3, 26, "v"), (4, 4, "tool o===============(X)- - - rail X")),
    ((0, 20, "[Z] joint end"), (1, 21, "|"), (2, 21, "v"), (3, 20, "(Y) carriage"),
     (4, 3, "tool end [Z]"), (4, 19, "/"), (5, 13, "|"), (5, 17, "/"), (6, 13, "v"),
     (6, 15, "/"), (7, 8, "tool o")),
)
_AXES: _Marks = (
    (2, 48, "+Z"), (3, 48, "|   +Y"), (4, 48, "|  /"), (5, 48, "| /"), (6, 48, "+------ +X"),
)
# fmt: on


def _picture(leg: int, directions: Collection[int], contact: Contact) -> list[str]:
    """The gauges of a set-up, at most 72 columns wide.

    Fixed on stands half-way along the leg (double-posture), or one that slides on the xy-surface
    between the ends of the leg (single-posture).
    """
    marks = [*_LEGS[leg], *_AXES]
    if contact is not Contact.FIXED:
        marks = [*_SLIDING[leg], *_AXES]
        directions = ()
    for direction in directions:
        marks += _GAUGES[leg, direction]
    canvas = [[" "] * 72 for _ in range(1 + max(row for row, _, _ in marks))]
    for row, column, text in marks:
        canvas[row][column : column + len(text)] = text
    lines = ["".join(line).rstrip() for line in canvas]
    return lines[next(index for index, line in enumerate(lines) if line) :]
