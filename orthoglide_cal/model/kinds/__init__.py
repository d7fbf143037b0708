"""One file per kind of machine; the rest of the program does not ask which kind it has."""

from orthoglide_cal.model.kinds.layouts import Layout
from orthoglide_cal.model.kinds.linear_delta import DeltaMachine, LinearDelta
from orthoglide_cal.model.kinds.orthoglide import OFFSET_MM, Orthoglide
from orthoglide_cal.model.kinds.probe_plan import ProbePlan
from orthoglide_cal.model.kinds.protocols import (
    MINUTES_PER_POSTURE,
    MINUTES_PER_SETUP,
    PlannedReading,
    double_posture,
    plan_of,
    single_posture,
    visiting,
)

__all__ = [
    "MINUTES_PER_POSTURE",
    "MINUTES_PER_SETUP",
    "OFFSET_MM",
    "DeltaMachine",
    "Layout",
    "LinearDelta",
    "Orthoglide",
    "PlannedReading",
    "ProbePlan",
    "double_posture",
    "plan_of",
    "single_posture",
    "visiting",
]
