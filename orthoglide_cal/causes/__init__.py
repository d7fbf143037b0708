"""What can be wrong with a machine or a measurement: one file per cause.

A new cause is a new file with a `CAUSE`; it is found by its being here.
"""

from orthoglide_cal.causes.base import (
    MACHINE_WIDE,
    Acting,
    Cause,
    PatternCause,
    RelabelCause,
    Step,
    Where,
)
from orthoglide_cal.causes.registry import CAUSES, machine_effects

__all__ = [
    "CAUSES",
    "MACHINE_WIDE",
    "Acting",
    "Cause",
    "PatternCause",
    "RelabelCause",
    "Step",
    "Where",
    "machine_effects",
]
