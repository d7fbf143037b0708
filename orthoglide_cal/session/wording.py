"""The words that lead through a session, in plain characters."""

from collections import Counter
from collections.abc import Iterable

from orthoglide_cal.errors import visible
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES, Contact, other_axes
from orthoglide_cal.planning.steps import SessionStep, posture_name
from orthoglide_cal.session.readings import Setting
from orthoglide_cal.words import MM_PER_INCH, SIMULATED, Unit, plain, typed

HELP = """\
Type the reading, e.g. -0.12 (comma or point; mm, or add "in"), then Return.
  u            undo the last reading
  r 14 why     retake step 14 (r x: all of leg X); the old reading is kept
  n text       note, kept with this step
  s why        skip this step (s all: skip all that is left, and finish)
  t            the last 20 readings
  q            save and quit; continue later with --resume
  ?            this help
A reading that looks wrong is questioned once:
  k            keep it anyway
  m            the stand did move: keep it, with a new zero from here on
  or give the reading again.
The words undo, retake, note, skip, quit and help do the same.
Every accepted reading is on the disk before the next prompt."""

STREAM = """\
Many readings at once: a gauge that sends by itself, or pasted lines. None of
it is recorded. Switch off the gauge's continuous output (also: AUTO, STREAM,
INTERVAL), so that it sends when its button is pressed; type one at a time."""

OUT_OF_RANGE = """\
Not kept: the gauge cannot show this. Read it again, or skip it: s and why.
Set a gauge that has a preset to zero. If its stated range is wrong: q, then
correct range_mm in the machine file and begin anew."""


def machine(model: Model, simulated: bool) -> str:
    """The machine and its numbers, as they are confirmed before the first move."""
    machine, gauge = model.machine, model.machine.instrument
    known = ", ".join(effect.cause.id for effect in model.accepted)
    return "\n".join([
        *([SIMULATED] if simulated else []),
        f"Machine  {visible(machine.name)}",
        f"         {machine.geometry_words}",
        *([f"         known causes: {known}"] if known else []),
        f"Gauge    {gauge.resolution_mm:g} mm divisions, {gauge.most_mm:g} mm travel,"
        f" repeats within {gauge.repeatability_mm:g} mm",
        f"Offsets  {by_axis(machine.active, '+.4g')} mm are in the controller now",
    ])  # fmt: skip


def set_up(setting: Setting, setup: int, begun: bool, columns: int) -> tuple[str, str]:
    """Heading of a gauge set-up, and its instructions.

    Once it is `begun`, readings were taken in it: the stands must stay where they are.
    """
    here = [step for step in setting.steps if step.setup == setup]
    planned, following = here[0].cell, setting.following
    leg, contact = AXES[planned.leg].upper(), planned.contact
    directions = sorted({step.direction for step in here})
    names = [AXES[direction].upper() for direction in directions]
    s = "s" if len(directions) > 1 else ""
    last = max(step.setup for step in setting.steps)
    heading = f"-- Set-up {setup} of {last}: leg {leg}, gauge{s} {' and '.join(names)} "
    right = f" steps {here[0].number}-{here[-1].number}"
    rule = f"{heading}{'-' * max(columns - 2 - len(heading) - len(right), 1)}{right}"
    if contact is not Contact.FIXED:
        words = [
            "1. Gauge on the XY surface, plunger down on the leg: higher reads more.",
            f"2. Slide the stand between the ends of leg {leg}; never touch the gauge's zero.",
            "3. Joint end: at the carriage joint. Tool end: at the tool centre point.",
        ]
    elif following and following.continues and not begun and setup == 1:
        path = visible(following.data.path)
        words = [
            "Do not touch the stands: they must be where they were for the last reading",
            f"of {path}. If one was touched since: q, and measure anew.",
        ]
    elif begun:
        words = [
            "The stands are in place: do not touch them. If one was moved anyway,",
            "just continue: the next reading will be questioned; then answer m.",
        ]
    else:
        words = []
        rows = setting.first.rows if setting.first else []
        bars = [row.bar for row in rows if row.leg == AXES[planned.leg]]
        if planned.turned:
            sides = " and ".join(f"+{AXES[axis].upper()}" for axis in other_axes(planned.leg))
            words = [
                f"0. Turn the bar of leg {leg}, unless it is turned already: loosen both ends,",
                f"   turn it half round its own axis (what faced {sides} then faces away),"
                " tighten.",
            ]
        elif bars and bars[-1]:
            words = [f"0. Turn the bar of leg {leg} back, as it was at first."]
        half = "half-way: " if planned.gauge_at == 0.5 else ""
        place = f"{planned.gauge_at * setting.machine.leg_mm:.0f} mm from the carriage"
        moved = [step.cell.displacement for step in here]
        # A gauge on the + side reads more when the leg is pushed towards +.
        places = ", ".join(f"{name} on the +{name} side" for name in names)
        words += [
            "1. Drive to the isotropic posture: each leg lies along its own axis.",
            f"   Put the stand{s} on the base, not on a moving part.",
            f"2. Plunger{s} on leg {leg}, {half}{place}, square to the leg.",
            f"3. Gauge {places}: leg pushed to + must read more.",
            f"4. The leg stays under the plunger{s} from {min(moved):+g} to {max(moved):+g} mm."
            " Then touch no stand.",
        ]
    return rule, "\n".join(words)


def step_line(step: SessionStep, setting: Setting, minutes: float) -> str:
    """Place of step n of N; `minutes` are those left."""
    # The isotropic posture once more than the others closes a set-up.
    repeats = Counter(other.cell for other in setting.steps if other.setup == step.setup)
    here = repeats[step.cell]
    moved = [number for cell, number in repeats.items() if cell.displacement != 0.0]
    closes = step.cell.displacement == 0.0 and here == max(moved, default=here) + 1
    when = f"cycle {step.cycle} of {here - closes}"
    if closes and step.cycle == here:
        when = "closing"
    short = "".join(
        f", carriage {axis.upper()} {abs(mm):g} mm {'short' if mm > 0.0 else 'too far'}"
        for axis, mm in zip(AXES, setting.short_mm(step).tolist(), strict=True)
        if mm
    )
    return (
        f"Step {step.number} of {len(setting.steps)}: leg {AXES[step.leg].upper()},"
        f" {posture_name(step)}{short}, {when}. {duration(minutes)} left."
    )


def point(step: SessionStep, setting: Setting) -> tuple[Floats, Floats]:
    """Point to drive to: joints and tool, shape (3,) each [mm]."""
    machine = setting.machine
    joints = machine.joints_at(step.leg, step.cell.displacement) - setting.short_mm(step)
    return joints, machine.nominal_rails.tool_for(joints)


def place(step: SessionStep, setting: Setting) -> str:
    """Point to drive to, in words: its joints, and its tool; either is the same posture."""
    if step.cell.words:
        return step.cell.words
    joints, tool = point(step, setting)
    return (
        f"Drive to  joints   {by_axis(joints, '.3f', '   ')}  mm\n"
        f"          tool     {by_axis(tool.round(6) + 0.0, '.3f', '   ')}  mm"
    )


def by_axis(values: Iterable[float], form: str, gap: str = "  ") -> str:
    """ "X 1.5  Y 0  Z -2": one number for each axis, never parted from it."""
    parts = (f"{axis.upper()} {value:{form}}" for axis, value in zip(AXES, values, strict=True))
    return gap.join(parts)


def duration(minutes: float) -> str:
    """About so long, whole minutes."""
    return f"About {minutes:.0f} min" if minutes >= 0.95 else "Under a minute"


def value_text(value_mm: float, unit: Unit, sign: str = "+") -> str:
    """A reading in a unit: "+0.127 mm", "+0.0050 in (+0.127 mm)"; without `sign` a size."""
    metric = f"{typed(value_mm, 3) if sign else plain(value_mm, 3)} mm"
    if unit is Unit.MM:
        return metric
    inches = f"{value_mm / MM_PER_INCH:{sign}.5f}"  # no dial divides an inch more finely
    return f"{inches.removesuffix('0')} in ({metric})"


def in_unit(value_mm: float, unit: Unit, form: str = "g") -> str:
    """Another length in a unit: "10 mm", "0.393701 in (10 mm)"."""
    metric = f"{value_mm:{form}} mm"
    return metric if unit is Unit.MM else f"{value_mm / MM_PER_INCH:{form}} in ({metric})"
