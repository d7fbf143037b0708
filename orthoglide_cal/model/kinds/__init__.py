"""One file per kind of machine; the rest of the program does not ask which kind it has."""

from orthoglide_cal.model.kinds.orthoglide import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    Moments,
    Orthoglide,
    PlannedReading,
    double_posture,
    plan_of,
    single_posture,
    visiting,
)

__all__ = [
    "MINUTES_PER_POSTURE",
    "MINUTES_PER_SETUP",
    "Moments",
    "Orthoglide",
    "PlannedReading",
    "double_posture",
    "plan_of",
    "single_posture",
    "visiting",
]
