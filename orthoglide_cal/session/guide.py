"""The words and tables that lead through a session, as plain lines of at most 79 characters."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.estimation import Solution
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact
from orthoglide_cal.session.desk import Show
from orthoglide_cal.session.pictures import fixed_gauges, side, sliding_gauge
from orthoglide_cal.session.state import State
from orthoglide_cal.session.steps import Step, gauge_moves

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


def opening(
    machine: Machine, steps: Sequence[Step], state: State, session: str, minutes: float
) -> list[str]:
    """What lies ahead."""
    opened = state.opened
    setups = len({step.setup for step in steps})
    gauge = machine.gauge
    gauges = "two gauges" if any(step.stand for step in steps) else "one gauge"
    repeats = "cycle" if opened.cycles == 1 else "cycles"
    return [
        f"{opened.protocol} session, {opened.cycles} {repeats}, order: {opened.order}",
        f"Machine  {machine.name}",
        f"Gauge    {gauge.resolution_mm:g} mm divisions, {gauge.range_mm:g} mm travel,"
        f" repeats within {gauge.repeatability_mm:g} mm",
        f"File     {session}",
        f"{len(steps)} readings with {gauges}: {setups} set-ups, {gauge_moves(steps)} gauge moves,"
        f" about {minutes:.0f} min. ? is help.",
    ]


def setup_lines(
    steps: Sequence[Step], setup: int, machine: Machine, begun: bool = False
) -> list[str]:
    """Heading, picture and instructions of a gauge set-up.

    Args:
        steps: of the session.
        setup: number of the set-up.
        machine: nominal machine.
        begun: readings were taken in it already, so the stands must stay where they are.
    """
    here = [step for step in steps if step.setup == setup]
    last = max(step.setup for step in steps)
    leg, first, final = here[0].leg, here[0].number, here[-1].number
    directions = sorted({step.direction for step in here})
    names = " and ".join(AXES[direction].upper() for direction in directions)
    heading = (
        f"Set-up {setup} of {last}: leg {AXES[leg].upper()},"
        f" gauge{'s' if len(directions) > 1 else ''} {names}"
    )
    if here[0].contact is Contact.FIXED:
        picture = fixed_gauges(leg, directions)
        words = _fixed_words(leg, directions, machine)
    else:
        picture = sliding_gauge(leg)
        words = _sliding_words(leg)
    if begun and here[0].contact is Contact.FIXED:
        words = [
            "The stands are in place: do not touch them. Should one have been moved all the",
            "same, just go on: the next reading will be questioned; then answer m.",
        ]
    return [_ruled(heading, f"steps {first}-{final}"), "", *picture, "", *words]


def _fixed_words(leg: int, directions: Sequence[int], machine: Machine) -> list[str]:
    name = AXES[leg].upper()
    half = machine.leg_length_mm / 2.0
    low, high = machine.joint_limits_mm
    places = ", ".join(f"{AXES[d].upper()} on the {side(d)}" for d in directions)
    many = len(directions) > 1
    return [
        f"1. Drive to the isotropic posture. Stand{'s' if many else ''} on the base,"
        " not on a moving part.",
        f"2. Plunger{'s' if many else ''} on leg {name}, half-way: {half:.0f} mm from the carriage,"
        " square to the leg.",
        f"3. Gauge {places}: leg pushed to + must read more.",
        f"4. The leg stays under the plunger{'s' if many else ''} from {low:+g} to"
        f" {high:+g} mm. Then touch no stand.",
    ]


def _sliding_words(leg: int) -> list[str]:
    name = AXES[leg].upper()
    return [
        "1. Gauge on the XY surface, plunger down on the leg: higher reads more.",
        f"2. Slide the stand between the ends of leg {name}; never touch the gauge's zero.",
        "3. Joint end: at the carriage joint. Tool end: at the tool centre point.",
    ]


def step_lines(
    step: Step, total: int, cycles: int, machine: Machine, minutes_left: float
) -> list[str]:
    """Where step n of N is, and where to drive."""
    joints = step.joints_mm(machine)
    targets = "   ".join(f"{AXES[i].upper()} {joints[i]:.3f}" for i in range(3))
    closing = step.posture == "iso" and step.cycle > cycles
    when = "closing" if closing else f"cycle {step.cycle} of {cycles}"
    return [
        f"Step {step.number} of {total}: leg {AXES[step.leg].upper()}, {step.posture.upper()},"
        f" {when}. {_duration(minutes_left)} left.",
        f"Drive to  {targets}  mm",
    ]


def _duration(minutes: float) -> str:
    return f"About {minutes:.0f} min" if minutes >= 0.95 else "Less than a minute"


def saved(cycles: int, readings: int, minutes: float, until_mm: float) -> str:
    """What --until has made unnecessary."""
    repeats = f"{cycles} cycle{'' if cycles == 1 else 's'} of a leg"
    return (
        f"Every offset is known within {until_mm:g} mm (95 %). Saved: {repeats},"
        f" {readings} readings, {_duration(minutes).lower()}."
    )


def prompt(step: Step, hint: str, unit: str) -> str:
    """What is asked, short enough to leave room for the answer."""
    end = f" at the {step.end.upper()} end" if step.end else ""
    doing = f" ({hint})" if hint else ""
    return f"{step.number}. Gauge {AXES[step.direction].upper()}{end} [{unit}]{doing} > "


def offsets_line(solution: Solution) -> str:
    """The offsets so far with the half-widths of their 95 % intervals."""
    half = (solution.interval_mm[:, 1] - solution.interval_mm[:, 0]) / 2.0
    parts = [
        f"{axis.upper()} {value:+.3f} +/-{width:.3f}"
        for axis, value, width in zip(AXES, solution.offsets_mm, half, strict=True)
    ]
    return f"Offsets, 95 %: {'  '.join(parts)} mm"


def closing(state: State, session: str) -> list[str]:
    """What was measured and where it is."""
    reason = state.ended.reason if state.ended else "unfinished"
    counts = f"{len(state.accepted)} readings"
    for number, word in ((len(state.replaced), "replaced"), (len(state.skipped), "skipped")):
        if number:
            counts += f", {number} {word}"
    return ["", f"Session {reason}: {counts}.", f"Written to {session}", ""]


def truth(solution: Solution, hidden_mm: Floats) -> list[str]:
    """After a simulated session: what was hidden, beside what was found."""
    lines = ["This machine was simulated. Hidden in it, and found (mm):"]
    inside = True
    for k, axis in enumerate(AXES):
        low, high = solution.interval_mm[k]
        inside = inside and bool(low <= hidden_mm[k] <= high)
        lines.append(
            f"  {axis.upper()}  hidden {hidden_mm[k]:+.4f}   found {solution.offsets_mm[k]:+.4f}"
            f"   95 % from {low:+.4f} to {high:+.4f}"
        )
    verdict = (
        "All three lie inside their intervals."
        if inside
        else "Not all lie inside their intervals; chance alone does that once in seven sessions."
    )
    return [*lines, verdict]


def table_lines(state: State, steps: Sequence[Step]) -> list[str]:
    """The readings so far: one line per leg, gauge and posture, one column per cycle."""
    cycles = max(step.cycle for step in steps)
    shown = min(cycles, 6)  # what fits into 79 columns
    rows: dict[tuple[int, int, str, Contact], dict[int, str]] = {}
    for step in steps:
        rows.setdefault(step.cell, {})[step.cycle] = _cell(state, step)
    heads = "".join(f"{f'cycle {n + 1}':>10}" for n in range(cycles - shown, cycles))
    lines = [f"{'leg gauge posture':<24}{heads}"]
    for (leg, direction, posture, contact), cells in rows.items():
        end = {Contact.FIXED: "", Contact.JOINT: "joint", Contact.TOOL: "tool"}[contact]
        name = f" {AXES[leg].upper()}    {AXES[direction].upper()}    {posture} {end}"
        values = "".join(f"{cells.get(n + 1, ''):>10}" for n in range(cycles - shown, cycles))
        lines.append(f"{name:<24}{values}".rstrip())
    marks = "? kept although questioned   - skipped   . to come"
    return [*lines, f"{marks}   replaced: {len(state.replaced)}"]


def _cell(state: State, step: Step) -> str:
    if step.number in state.accepted:
        take = state.accepted[step.number].take
        return f"{take.value_mm:+.3f}{'?' if take.kind == 'questioned' else ' '}"
    return "- " if step.number in state.skipped or step.number in state.dropped else ". "


def _ruled(heading: str, right: str) -> str:
    """A line across the screen with a heading and a word at its right."""
    dashes = WIDTH - len(heading) - len(right) - 6
    return f"-- {heading} {'-' * max(dashes, 1)} {right}"


def wrapping(show: Show) -> Show:
    """The same, with lines broken where the screen ends; prompts stay as they are."""

    def show_wrapped(text: str, style: str = "", end: str = "\n") -> None:
        if end != "\n" or len(text) <= WIDTH:
            show(text, style, end)
            return
        indent = " " * (len(text) - len(text.lstrip()))
        for line in textwrap.wrap(text, WIDTH, subsequent_indent=indent):
            show(line, style)

    return show_wrapped
