"""The record of a session as a file of the contract."""

from pathlib import Path

from .plan import AXIS_NAMES
from .session import Session

HEADER = "seq,cycle,minutes,leg,direction,posture,reading_mm"


def readings_csv(session: Session) -> str:
    """One reading per row, in the order of time; no word of the truth."""
    plan, places = session.plan, session.gauge.decimals
    rows = [
        f"{n + 1},{plan.cycle[n]},{plan.minutes[n]:.2f},{AXIS_NAMES[plan.leg[n]]},"
        f"{AXIS_NAMES[plan.direction[n]]},{plan.posture[n]},{session.readings[n]:.{places}f}"
        for n in range(plan.count)
    ]
    return "\n".join((HEADER, *rows)) + "\n"


def write_readings(session: Session, path: Path) -> Path:
    """Write the record and return its path."""
    path.write_text(readings_csv(session), encoding="utf-8")
    return path
