"""The reading that would tell two explanations apart best."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.causes import Acting, PatternCause, RelabelCause
from orthoglide_cal.causes.base import reading_label
from orthoglide_cal.diagnosis.frame import Frame, differentiate
from orthoglide_cal.diagnosis.refine import Fitted
from orthoglide_cal.diagnosis.result import NextMeasurement
from orthoglide_cal.machine import Machine
from orthoglide_cal.plan import Contact, Plan
from orthoglide_cal.protocols import double_posture, zero_free

# Below this distance no reading of the kind is worth taking.
WORTHLESS_SIGMA = 1.0


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
    continues: int

    @cached_property
    def matrix(self) -> Floats:
        """Combinations of its readings that no gauge zero enters, (q, n)."""
        plan, n = self.plan, self.continues
        if not n:
            return zero_free(plan)
        # The zeros are known from the session: compare with the mean of its residual readings.
        weights = np.linalg.pinv(plan.zeros[:n])
        return np.hstack([-plan.zeros[n:] @ weights, np.eye(len(plan) - n)])


def best_next(frame: Frame, first: Fitted, second: Fitted) -> NextMeasurement | None:
    """The option that separates two explanations best; None if none is worth taking."""
    ranked = [
        (separation(frame, first, second, option), option) for option in _options(frame, first)
    ]
    sigma, option = max(ranked, key=lambda pair: pair[0])
    if sigma < WORTHLESS_SIGMA:
        return None
    return NextMeasurement(option.what, (_name(first, second), _name(second, first)), sigma)


def separation(frame: Frame, first: Fitted, second: Fitted, option: Option) -> float:
    """Expected distance between the two predictions of the new readings [standard deviations]."""
    forecasts = [_forecast(frame, fit, option) for fit in (first, second)]
    (mean_1, spread_1), (mean_2, spread_2) = forecasts
    sigma2 = max(first.sigma, second.sigma) ** 2
    covariance = sigma2 * option.matrix @ option.matrix.T + 0.5 * (spread_1 + spread_2)
    gap = mean_1 - mean_2
    return float(np.sqrt(gap @ np.linalg.solve(covariance, gap)))


def _forecast(frame: Frame, fit: Fitted, option: Option) -> tuple[Floats, Floats]:
    """Mean (q,) and covariance (q, q) of what an explanation expects, free of gauge zeros."""
    plan, n = option.plan, option.continues
    # What belongs to the set-up goes on only where the set-up does, a step of unknown size with
    # its uncertainty.
    sized = [act for act in fit.acting if act.cause.lasting or (n and _sized(act))]
    passing = [act for act in fit.acting if n and not act.cause.lasting and not _sized(act)]
    for act in passing:
        if isinstance(act.cause, RelabelCause) and not act.cause.reversible(plan, act.where):
            plan = act.cause.reread(plan, act.where)
    readings, slopes = differentiate(
        frame.machine, plan, fit.offsets, sized, (*frame.effects, *passing)
    )
    known = fit.covariance[: slopes.shape[1], : slopes.shape[1]]
    slope = option.matrix @ slopes
    return option.matrix @ readings, slope @ known @ slope.T


def _sized(act: Acting) -> bool:
    """Whether its size was estimated (a relabelling has none, a count of turns is tried)."""
    return isinstance(act.cause, PatternCause) and not act.cause.counts


def _options(frame: Frame, first: Fitted) -> list[Option]:
    machine = frame.machine
    low, high = machine.joint_limits_mm
    options = [
        Option(
            "Repeat the session with the gauges set up afresh, their labels and + sides checked.",
            double_posture(machine),
            0,
        ),
        Option(
            "Repeat the session with the gauges a quarter of the leg from the carriage.",
            double_posture(machine, gauge_at=0.25),
            0,
        ),
        Option(
            "Repeat the session with the gauges a quarter of the leg from the tool.",
            double_posture(machine, gauge_at=0.75),
            0,
        ),
        Option(
            "Repeat the session in the order iso, min, max, so that every posture is reached"
            " from the other side.",
            double_posture(machine, postures=("iso", "min", "max")),
            0,
        ),
        Option(
            "Repeat the session with two more postures per cycle,"
            f" {0.5 * high:g} mm and {0.5 * low:g} mm.",
            _with_middle(machine),
            0,
        ),
    ]
    if frame.timed:
        # Only the stands of the leg that was read last are still where they were.
        options.append(_again(frame, int(frame.plan.leg[frame.plan.in_time[-1]])))
    return options


def _with_middle(machine: Machine) -> Plan:
    """The protocol with postures half-way to both limits."""
    plan = double_posture(machine, postures=("iso", "max", "min", "max", "min"))
    low, high = machine.joint_limits_mm
    half = np.zeros(len(plan), dtype=bool)
    for series in np.unique(plan.series()):
        for limit in (low, high):
            cell = np.flatnonzero((plan.series() == series) & (plan.displacement == limit))
            half[cell[1::2]] = True
    moved = np.where(half, 0.5 * plan.displacement, plan.displacement)
    return Plan(
        plan.leg, plan.direction, moved, plan.contact, plan.gauge_at, plan.setup, plan.order,
        plan.hours,
    )  # fmt: skip


def _again(frame: Frame, leg: int) -> Option:
    """Read the last posture of one leg again, gauges untouched."""
    plan = frame.plan
    last = [
        int(own[np.argmax(plan.order[own])])
        for own in (np.flatnonzero(plan.setup == s) for s in range(plan.setups))
        if plan.leg[own[0]] == leg and plan.contact[own[0]] == Contact.FIXED
    ]
    order = np.concatenate((np.arange(len(plan)), last)).astype(np.intp)
    n = len(plan)
    extended = Plan(
        plan.leg[order],
        plan.direction[order],
        plan.displacement[order],
        plan.contact[order],
        plan.gauge_at[order],
        plan.setup[order],
        np.concatenate((plan.order, plan.order.max() + 1 + np.arange(len(last)))),
        np.concatenate((plan.hours, np.full(len(last), plan.hours.max() + 1.0 / 60.0))),
    )
    where = reading_label(plan, frame.machine, last[-1]) if last else f"leg {AXES[leg]}"
    what = f"Without touching the stands, read the last posture of leg {AXES[leg]} again ({where})."
    return Option(what, extended, n)


def _name(fit: Fitted, other: Fitted) -> str:
    """Id in which an explanation differs from another; "" for "nothing is wrong"."""
    shared = {act.cause.id for act in other.acting}
    return "+".join(act.cause.id for act in fit.acting if act.cause.id not in shared)
