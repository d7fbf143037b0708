"""The record of a session as a file of the contract."""

from pathlib import Path

import numpy as np

from .plan import AXIS_NAMES, Plan
from .session import Session

HEADER = "seq,cycle,minutes,leg,direction,posture,reading_mm"
SITTINGS = "gauge_at,part,bar,entered"


def readings_csv(session: Session) -> str:
    """One reading per row, in the order of time; no word of the truth."""
    plan, places = session.plan, session.gauge.decimals
    rows = [
        f"{n + 1},{plan.cycle[n]},{plan.minutes[n]:.2f},{AXIS_NAMES[plan.leg[n]]},"
        f"{AXIS_NAMES[plan.direction[n]]},{plan.posture[n]},{session.readings[n]:.{places}f}"
        for n in range(plan.count)
    ]
    header = HEADER
    if plan.part.any() or plan.entered.any() or plan.turned.any() or np.any(plan.gauge_at != 0.5):
        header = f"{HEADER},{SITTINGS}"
        rows = [f"{row},{_sitting(plan, n)}" for n, row in enumerate(rows)]
    return "\n".join((header, *rows)) + "\n"


def _sitting(plan: Plan, n: int) -> str:
    bar = "turned" if plan.turned[n] else ""
    entered = " ".join(f"{offset:.6f}" for offset in plan.entered[n])
    return f"{plan.gauge_at[n]:.6f},{plan.part[n] + 1},{bar},{entered}"


def write_readings(session: Session, path: Path) -> Path:
    """Write the record and return its path."""
    path.write_text(readings_csv(session), encoding="utf-8")
    return path
