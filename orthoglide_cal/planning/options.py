"""What can be measured next, given readings: each with its minutes.

Either the stands stay where they are, on the leg that was read last, and what was wrong with them
and their labels is still wrong; or they are set up again, and only what is wrong with the machine
and its bars is met again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    Orthoglide,
    PlannedReading,
    double_posture,
    plan_of,
)
from orthoglide_cal.model.plan import Floats, Plan
from orthoglide_cal.model.readings import AXES, Contact, GaugePlan, other_axes
from orthoglide_cal.planning.bar import bar_warning, places, reach_mm
from orthoglide_cal.planning.steps import (
    MeasuringProtocol,
    Order,
    clock,
    sequence,
    sequence_options,
    steps_of,
    timed_plan,
)
from orthoglide_cal.words import counted

# Long enough for what creeps to show.
WAIT_MIN = 15.0
# A step that every gauge shows and that no revolution of a dial is taken for [mm].
STEP_MM = 0.3
HALF_WAY = 0.5  # along the leg
# A gauge place nearer to another than this share of the leg teaches nothing new.
ANOTHER_PLACE = 0.08
LEGS = (0, 1, 2)
TIMES = ((1, "one cycle"), (5, "five cycles"))
ALONE = (1, 2, 3, 5)  # cycles of a session of its own
P = TypeVar("P", bound=Plan)


@dataclass(frozen=True, eq=False)
class Option:
    """A measurement that could be taken next."""

    what: str  # instruction, one or two sentences
    plan: Plan  # the new readings alone; part, set-ups, order and hours as in the joined data
    minutes: float  # that it takes
    continues: bool  # the stands are still where they were: same part, same set-ups
    # What `measure` is told for a session that is solved alone; None where what was read before
    # is solved together with it.
    session: str | None = None


def options(first: Plan | None, machine: Orthoglide) -> tuple[Option, ...]:
    """All that can be done next.

    Args:
        first: what was read with gauges that stand in space; None where nothing can be solved
            together with what was read.
        machine: its limits bound the postures.
    """
    if first is None:
        return tuple(_alone(machine))
    first = GaugePlan.require(first)
    return (*_going_on(first, machine), *_set_up_again(first, machine))


def further(first: Plan | None, model: Model) -> tuple[Option, ...]:
    """What the kind of machine has to offer other than gauges on legs; none for an Orthoglide."""
    if first is None:
        return ()
    return tuple(
        Option(what, _later(first, plan), minutes, continues=False)
        for what, plan, minutes in model.machine.further(first)
    )


def _later(first: Plan, plan: P) -> P:
    """A plan as a part of its own behind all that was read."""
    return replace(
        plan,
        order=plan.order + int(first.order.max()) + 1,
        hours=plan.hours + float(first.hours.max()),
        part=plan.part + first.parts,
    )


def _walks(machine: Orthoglide, gauge_at: float) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Ways to the joint limits, or as far as the plunger stays on the bar.

    Each in words, and one cycle of displacements [mm], of which the first closes the last.
    """
    low, high = reach_mm(machine, gauge_at)
    least, most = (machine.posture_at(at) or f"{at:+.4g} mm" for at in (low, high))
    return (
        (f"iso, {most}, {least} and iso", (0.0, high, low)),
        (f"iso, {least}, {most} and iso, each reached from the other side", (0.0, low, high)),
        (
            f"up to {most} and down to {least}, half-way ({high / 2:g}, {low / 2:g} mm) both going"
            " and coming back",
            (0.0, high / 2, high, high / 2, 0.0, low / 2, low, low / 2),
        ),
    )


def _going_on(first: GaugePlan, machine: Orthoglide) -> Iterator[Option]:
    """With the stands where they are, on the leg that was read last, if they are fixed in space."""
    standing = first.in_time[first.standing[first.in_time]]
    # Of each direction that is read there, its last reading.
    ends = dict(zip(first.direction[standing].tolist(), standing.tolist(), strict=True))
    if not ends:
        return
    leg = int(first.leg[standing[-1]])
    rows = [*ends.values()]

    def option(
        what: str, stops: Sequence[float], wait_min: float = 0.0, short_mm: Floats | float = 0.0
    ) -> Option:
        """Further postures, in the same set-ups, each carriage commanded short by `short_mm`."""
        index = np.array(rows * len(stops))
        plan = replace(
            first.subset(index),
            setup=first.setup[index],
            displacement=np.repeat(stops, len(rows)),
            order=int(first.order.max()) + 1 + np.arange(len(index)),
            entered=first.stood[index] + short_mm,
        )
        # A bar that was turned before is not turned again.
        as_it_lies = replace(plan, turned=np.zeros_like(plan.turned))
        *times, minutes = clock(steps_of(as_it_lies, machine, Order.PAPER, stands=2))
        start = float(first.hours.max()) + (MINUTES_PER_POSTURE + wait_min) / 60.0
        hours = start + np.array(times) / 60.0
        return Option(what, replace(plan, hours=hours), minutes + wait_min, continues=True)

    # Of two stands the one that is farther from half-way bounds the travel.
    farthest = max(first.gauge_at[rows].tolist(), key=lambda at: abs(at - HALF_WAY))
    walks = _walks(machine, farthest)
    still = f"Without touching the stands at leg {AXES[leg]}"
    last = float(first.displacement[first.in_time[-1]])
    again = f"read its last posture ({machine.posture_at(last) or f'{last:g} mm'}) again"
    once = option(f"{still}, {again}.", [last])
    after_a_while = "after a quarter of an hour"
    warning = bar_warning(once.plan, machine)
    if warning is None or not warning.leaves:
        yield once
        yield option(f"{still}, {again} {after_a_while}.", [last], wait_min=WAIT_MIN)
    for times, how_often in TIMES:
        for words, stops in walks:
            yield option(f"{still}, read {how_often}: {words}.", (*stops * times, 0.0))
    words, stops = walks[0]
    low, high = machine.joint_limits_mm
    for axis in other_axes(leg):
        moved = machine.joints_at(leg, np.array(stops))[:, axis] - machine.home_mm
        for step, way in ((STEP_MM, "short"), (-STEP_MM, "too far")):
            if low <= (moved - step).min() and (moved - step).max() <= high:
                what = f"carriage {AXES[axis]} {STEP_MM:g} mm {way}, as the screen shows: {words}"
                what = f"{still}, drive as before but with {what}."
                yield option(what, (*stops, 0.0), short_mm=step * np.eye(3)[axis])
                break


def _alone(machine: Orthoglide) -> Iterator[Option]:
    """Sessions as `measure` guides them, of the best design where plungers would leave the bar."""
    usual = double_posture(machine)
    protocol = MeasuringProtocol.BEST if bar_warning(usual, machine) else MeasuringProtocol.DOUBLE
    for cycles in ALONE:
        session = (protocol, cycles, Order.PAPER, 2)
        plan, minutes = timed_plan(sequence(machine, *session), MINUTES_PER_SETUP)
        how_often = counted(cycles, "cycle")
        what = (
            f"Measure a separate session, {protocol}, {how_often} per leg, reading by reading."
            " It is solved alone: leave the old data as they are."
        )
        told = sequence_options(*session)
        yield Option(what, plan, minutes, continues=False, session=told)


def _set_up_again(first: GaugePlan, machine: Orthoglide) -> Iterator[Option]:
    """With the stands set up again, labels and + sides of the gauges checked."""
    walks = _walks(machine, HALF_WAY)
    usual = walks[0][1]
    fixed = first.gauge_at[first.contact == Contact.FIXED]
    half_way = ", with the gauges half-way" if np.any(np.not_equal(fixed, HALF_WAY)) else ""
    checked = "labels and + sides checked"
    turn = "half round its own axis"
    for times, how_often in TIMES:
        for leg in LEGS:
            stand = f"et the stands up again at leg {AXES[leg]}{half_way}"
            for words, stops in walks:
                what = f"S{stand}, {checked}, and read {how_often}: {words}."
                yield _session(first, machine, (leg,), what, (*stops * times, 0.0))
            what = f"Turn the bar of leg {AXES[leg]} {turn}, s{stand} and read {how_often}."
            yield _session(first, machine, (leg,), what, (*usual * times, 0.0), turned=True)
        repeat = f"epeat the session, {how_often} per leg"
        for words, stops in walks:
            what = f"R{repeat}{half_way}: {words}; stands set up again, {checked}."
            yield _session(first, machine, LEGS, what, (*stops * times, 0.0))
        what = f"Turn every bar {turn}, and r{repeat}{half_way}."
        yield _session(first, machine, LEGS, what, (*usual * times, 0.0), turned=True)
        for at in places(machine):
            if np.any(np.abs(fixed - at) <= ANOTHER_PLACE):
                continue
            from_joint = at * machine.leg_length_mm
            what = f"R{repeat}, with the gauges {from_joint:.0f} mm from the carriage joint."
            yield _session(first, machine, LEGS, what, (*usual * times, 0.0), gauge_at=at)
    what = f"Repeat the session, one cycle per leg, with the legs in the order z, y, x{half_way}."
    yield _session(first, machine, LEGS[::-1], what, (*usual, 0.0))


def _session(
    first: GaugePlan,
    machine: Orthoglide,
    legs: Sequence[int],
    what: str,
    stops: Sequence[float],
    gauge_at: float = HALF_WAY,
    turned: bool = False,
) -> Option:
    """One leg after the other, with new set-ups, as a part of its own."""
    read = PlannedReading(0, 0, 0.0, Contact.FIXED, gauge_at=gauge_at, turned=turned)
    readings = [
        read._replace(leg=leg, direction=direction, displacement=displacement)
        for leg in legs
        for displacement in stops
        for direction in other_axes(leg)
    ]
    steps = steps_of(plan_of(readings), machine, Order.PAPER, stands=2)
    plan, minutes = timed_plan(steps, MINUTES_PER_SETUP)
    plan = replace(
        _later(first, plan),
        setup=plan.setup + first.setups,
        # What was commanded short was so for those readings alone.
        entered=plan.entered + first.stood[first.in_time[-1]],
    )
    return Option(what, plan, minutes, continues=False)
