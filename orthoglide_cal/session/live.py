"""The result while the session runs: offsets so far, when they are known well enough, the pace."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from statistics import median

from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import OrthocalError
from orthoglide_cal.estimation import Solution, solve
from orthoglide_cal.machine import Machine
from orthoglide_cal.session.record import readings
from orthoglide_cal.session.state import State
from orthoglide_cal.session.steps import Step


def solve_so_far(
    state: State, steps: Sequence[Step], machine: Machine, effects: Sequence[Effect] = ()
) -> Solution | None:
    """The solution from the readings so far; None while they do not determine the offsets."""
    if not state.accepted:
        return None
    try:
        return solve(readings(state, steps, machine, ""), machine, effects=effects)
    except OrthocalError:
        return None


def is_known(solution: Solution, until_mm: float) -> bool:
    """True if the half-width of every offset's 95 % interval is at most `until_mm`."""
    half = (solution.interval_mm[:, 1] - solution.interval_mm[:, 0]) / 2.0
    return bool((half <= until_mm).all())


def unneeded(state: State, steps: Sequence[Step]) -> list[Step] | None:
    """Steps that can be left out once the offsets are known.

    None as long as some leg, gauge and posture was not measured: a model that was not compared
    with all of them may be wrong. The closing isotropic reading of the leg in hand stays.
    """
    numbered = {step.number: step for step in steps}
    measured = {numbered[number].cell for number in state.accepted}
    skipped = {numbered[number].cell for number in state.skipped}
    if {step.cell for step in steps} - measured - skipped:
        return None
    open_steps = [step for step in steps if state.is_open(step.number)]
    last = numbered[state.last_step] if state.last_step else steps[0]
    if open_steps and open_steps[0].visit == last.visit:
        return None  # the other gauge of this posture is still to be read
    closing = [step for step in open_steps if step.setup == last.setup and step.posture == "iso"]
    if last.posture == "iso":
        closing = []
    kept = {step.number for step in closing if step.visit == closing[0].visit}
    return [step for step in open_steps if step.number not in kept]


def saved_cycles(dropped: Sequence[Step]) -> int:
    """How many cycles of a leg were not needed."""
    return len({(step.leg, step.cycle) for step in dropped if step.posture != "iso"})


def pace_min(state: State, steps: Sequence[Step]) -> float | None:
    """Median time from one posture to the next within a set-up so far [min]; None at first."""
    numbered = {step.number: step for step in steps}
    taken = [(numbered[number], item.take.minutes) for number, item in state.in_time()]
    times = [
        after - before
        for (one, before), (other, after) in pairwise(taken)
        if one.setup == other.setup and one.visit != other.visit
    ]
    return median(times) if len(times) >= 3 else None


def minutes_between(start: str, now: str) -> float:
    """Minutes from one ISO time to another; a clock that was set back counts as standing."""
    gone = datetime.fromisoformat(now) - datetime.fromisoformat(start)
    return max(gone.total_seconds() / 60.0, 0.0)
