"""The reading that would tell two explanations apart best."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from orthoglide_cal.causes import reading_label
from orthoglide_cal.diagnosis.explanations import Ids, Whitened, as_read
from orthoglide_cal.diagnosis.fit import Fitted, foretell
from orthoglide_cal.diagnosis.result import NextMeasurement
from orthoglide_cal.estimation import Problem
from orthoglide_cal.model import (
    AXES,
    Contact,
    Floats,
    Machine,
    Plan,
    Posture,
    double_posture,
    zero_free,
)

# Below this distance no reading of the kind is worth taking.
WORTHLESS_SIGMA = 1.0
ISO, MAX, MIN = Posture.ISO, Posture.MAX, Posture.MIN


@dataclass(frozen=True, eq=False)
class Option:
    """A measurement that could be taken next.

    Attributes:
        what: instruction.
        plan: its readings; those of the session come first if it goes on in its set-ups.
        continues: number of the session's readings in the plan; 0 for a new set-up.
    """

    what: str
    plan: Plan
    continues: int = 0

    @cached_property
    def matrix(self) -> Floats:
        """Combinations of its readings that no gauge zero enters, (q, n)."""
        plan, n = self.plan, self.continues
        if not n:
            return zero_free(plan)
        # The zeros are known from the session: compare with the mean of its residual readings.
        weights = np.linalg.pinv(plan.zeros[:n])
        return np.hstack([-plan.zeros[n:] @ weights, np.eye(len(plan) - n)])


def best_next(white: Whitened, first: Fitted, second: Fitted) -> NextMeasurement | None:
    """The option that separates two explanations best; None if none is worth taking."""
    options = [*_repeats(white.machine), *([_again(white)] if white.raw else [])]
    sigmas = [separation(white, first, second, option) for option in options]
    best = int(np.argmax(sigmas))
    if sigmas[best] < WORTHLESS_SIGMA:
        return None
    separates = _not_in(second, first), _not_in(first, second)
    if () in separates:
        # One adds to the other: without what they share it would have no name.
        separates = _ids(first), _ids(second)
    return NextMeasurement(options[best].what, separates, sigmas[best])


def separation(white: Whitened, first: Fitted, second: Fitted, option: Option) -> float:
    """Expected distance between the two predictions of the new readings [standard deviations]."""
    (mean_1, spread_1), (mean_2, spread_2) = (
        _forecast(white, fit, option) for fit in (first, second)
    )
    sigma2 = max(first.sigma, second.sigma) ** 2
    covariance = sigma2 * option.matrix @ option.matrix.T + 0.5 * (spread_1 + spread_2)
    gap = mean_1 - mean_2
    return float(np.sqrt(gap @ np.linalg.solve(covariance, gap)))


def _forecast(white: Whitened, fit: Fitted, option: Option) -> tuple[Floats, Floats]:
    """Mean (q,) and covariance (q, q) of what an explanation expects, free of gauge zeros."""
    plan, n = option.plan, option.continues
    # What belongs to the set-up goes on only where the set-up does, a step of estimated size with
    # its uncertainty.
    sized = [e for e in fit.effects if e.cause.lasting or (n and e.covariance is not None)]
    passing = [effect for effect in fit.effects if n and effect not in sized]
    problem = Problem(white.problem.model.extended(passing), as_read(plan, passing), option.matrix)
    return foretell(replace(white, problem=problem), fit, fit.offsets, sized, anew=not n)


def _repeats(machine: Machine) -> list[Option]:
    """Whole sessions, with the gauges set up afresh."""
    low, high = machine.joint_limits_mm
    usual = double_posture(machine)
    quarter, three = (replace(usual, gauge_at=np.full(len(usual), at)) for at in (0.25, 0.75))
    ways = [
        ("with the gauges set up afresh, their labels and + sides checked", usual),
        ("with the gauges a quarter of the leg from the carriage", quarter),
        ("with the gauges a quarter of the leg from the tool", three),
        (
            "in the order iso, min, max, so that every posture is reached from the other side",
            double_posture(machine, postures=(ISO, MIN, MAX)),
        ),
        (
            f"with two more postures per cycle, {0.5 * high:g} mm and {0.5 * low:g} mm",
            _with_middle(machine),
        ),
    ]
    return [Option(f"Repeat the session {how}.", plan) for how, plan in ways]


def _with_middle(machine: Machine) -> Plan:
    """The protocol with postures half-way to both limits."""
    plan = double_posture(machine, postures=(ISO, MAX, MIN, MAX, MIN))
    moved = plan.displacement.copy()
    for series in set(plan.series):
        for limit in machine.joint_limits_mm:
            cell = np.flatnonzero(plan.of(series) & (plan.displacement == limit))
            moved[cell[1::2]] *= 0.5
    return replace(plan, displacement=moved)


def _again(white: Whitened) -> Option:
    """Read the last posture again, gauges untouched.

    Only the stands of the leg that was read last are still where they were.
    """
    plan, n = white.plan, len(white.plan)
    leg = int(plan.leg[plan.in_time[-1]])
    last = [
        int(own[np.argmax(plan.order[own])])
        for own in (np.flatnonzero(plan.setup == setup) for setup in range(plan.setups))
        if plan.leg[own[0]] == leg and plan.contact[own[0]] == Contact.FIXED
    ]
    added = np.arange(1, len(last) + 1)
    extended = replace(
        plan.subset(np.array([*range(n), *last])),
        order=np.concatenate((plan.order, plan.order.max() + added)),
        hours=np.concatenate((plan.hours, np.full(len(last), plan.hours.max() + 1.0 / 60.0))),
    )
    where = reading_label(plan, white.machine, last[-1]) if last else f"leg {AXES[leg]}"
    what = f"Without touching the stands, read the last posture of leg {AXES[leg]} again ({where})."
    return Option(what, extended, n)


def _not_in(fit: Fitted, other: Fitted) -> Ids:
    """Ids of the causes that one explanation has and another lacks."""
    return tuple(id for id in _ids(other) if id not in _ids(fit))


def _ids(fit: Fitted) -> Ids:
    return tuple(effect.cause.id for effect in fit.effects)
